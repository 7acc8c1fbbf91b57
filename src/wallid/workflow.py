"""The whole method on a case, stage by stage: design, learn, estimate, reliability, diagnose."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal

from ._internal.errors import InputError
from .case.case_definition import Case
from .case.record_check import Check, check
from .case.time_window import Window, whole
from .discrepancy.findings import Diagnosis
from .discrepancy.search_for_effects import diagnose
from .estimation.diffusivity import check_draws, estimate, seconds_of_estimate
from .estimation.many_windows import CampaignEstimate, campaign
from .estimation.prediction import Prediction, predict
from .estimation.result_objects import Estimate
from .experiment_design.fisher_information import Criterion, Of, Robust
from .experiment_design.sampling_step import SamplingComparison, compare_sampling_steps
from .experiment_design.sensor_placement import SensorPlacement, place_sensors
from .experiment_design.window_lengths import LengthComparison, compare_lengths, days_within
from .experiment_design.window_selection import Design, design
from .models.flux_plates import fluxes_of
from .models.integration import Integrator
from .models.state_space import StateSpace
from .models.window_inputs import full_order_model
from .reduction.modal_identification import LearnedModel, sweep_orders
from .reduction.training_signals import learn, training_signals

Progress = Callable[[str, float], None]
"""Told the stage now beginning, and the share of the work done before it, 0 to 1."""

STAGES = ("design", "learn", "orders", "estimate", "reliability", "lengths")
"""Of a run; `orders` is the reduced model's error against its order. `diagnose` is one more, which takes as long as all
of these together many times over, and `check` one that only looks at the record. `places` asks where a further sensor
would help, `campaign` every window."""


@dataclass(frozen=True)
class Designing:
    """How a design chooses.

    Args:
        criterion, of, robust, full: as in `design`.
        added: further sensors to find places for.
    """

    criterion: Criterion = "D"
    of: Of = "diffusivity"
    robust: Robust = "no"
    full: bool | None = None
    added: int = 1

    @property
    def words(self) -> dict[str, Any]:
        """For `design` and `lengths`."""
        return {"criterion": self.criterion, "of": self.of, "robust": self.robust, "full": self.full}


@dataclass
class Run:
    """What a run has found so far; None where it did not go there.

    Args:
        seconds: per stage, wall clock, compilation included.
    """

    case: Case
    design: Design | None = None
    lengths: LengthComparison | None = None
    places: SensorPlacement | None = None
    sampling: SamplingComparison | None = None
    learned: LearnedModel | None = None
    orders: list[LearnedModel] = field(default_factory=list)
    fit: Estimate | None = None
    prediction: Prediction | None = None
    campaign: CampaignEstimate | None = None
    diagnosis: Diagnosis | None = None
    check: Check | None = None
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def timed(self, stage: str):
        """Add a block's wall clock to a stage."""
        began = clock.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + clock.perf_counter() - began

    @property
    def unreliable(self) -> str:
        """Why there is no number to rely on; empty where there is one, or none was asked for."""
        if self.diagnosis is not None:  # its diffusivity is the final answer
            return self.diagnosis.sentence if self.diagnosis.verdict == "uninformative" else ""
        if self.fit is not None:
            return self.fit.reason
        if self.campaign is not None:
            return self.campaign.reason
        if self.check is not None:
            return "; ".join(self.check.stops)
        return str(self.design) if self.design is not None and not self.design.informative else ""

    def __str__(self) -> str:
        parts = [self.case, self.design, self.lengths, self.places, self.sampling, self.learned, self.fit]
        parts += [self.campaign, self.prediction, self.diagnosis]
        told = [str(part) for part in parts if part is not None]
        if self.check is not None:
            told.append(str(self.check))
        if len(self.case.record.unbroken) > 1 and (self.prediction or self.diagnosis):
            told.append(f"the record is broken: the whole record means its longest unbroken part, {self._part()}")
        return "\n\n".join(told)

    def _part(self) -> str:
        """The longest unbroken part of the record, in words."""
        record, part = self.case.record, whole(self.case)
        return f"{part.rows} rows from {record.stamp(part.row)} to {record.stamp(part.row + part.rows)}"


def run(
    case: Case,
    *,
    stages: Sequence[str] = STAGES,
    window: Window | None = None,
    orders: Sequence[int] = (),
    weights: Literal["noise", "none"] = "noise",
    integrator: Integrator = "propagator",
    draws: int = 0,
    designing: Designing = Designing(),
    progress: Progress = lambda stage, share: None,
) -> Run:
    """The method on a case; the stages asked for, in their order.

    Args:
        window: given by hand; None for the design's best.
        orders: reduced models to learn for the figure of error against order; none for a few up to the case's.
        weights: of the estimate's readings.
        integrator: how the design's, the learning's and the estimate's rows are stepped through.
        draws: of a bootstrap that checks the estimate's interval; 0 for none.
        designing: by which criterion days are chosen.
        progress: told of each stage.

    Raises:
        InputError: what the case cannot give, named.
    """
    done = Run(case)
    _check_orders(case, orders)
    check_draws(draws, weights)
    begin = _Shares(stages, len(orders), progress)
    if "check" in stages:
        begin("check", "check: what the record holds")
        with done.timed("check"):
            done.check = check(case)
    if "campaign" in stages:
        begin("campaign", "estimate: every window")
        with done.timed("campaign"):
            done.campaign = campaign(
                case, progress=lambda k, of: begin.within(f"estimate: window {k + 1} of {of}", k / of)
            )
    if set(stages) - {"diagnose", "check", "campaign"}:
        _of_window(done, stages, window, orders, weights, integrator, draws, begin, designing)
    if "diagnose" in stages:
        begin("diagnose", "diagnose: what the plain model misses")
        with done.timed("diagnose"):
            done.diagnosis = diagnose(case, progress=begin.within)
    progress("done", 1.0)
    return done


class _Shares:
    """Tells a progress bar how much of the work is done, by what each stage takes."""

    def __init__(self, stages: Sequence[str], orders: int, progress: Progress):
        work = {
            "check": 1.0,
            "design": 2.0,
            "lengths": 4.0,
            "places": 4.0,
            "learn": 5.0,
            "orders": 2.0 * (orders or 2),
            "estimate": 3.0,
            "reliability": 4.0,
            "campaign": 10.0,
            "diagnose": 60.0,
        }
        self.work = {stage: work[stage] for stage in stages}
        self.progress = progress
        self.before = self.after = 0.0

    def __call__(self, stage: str, words: str) -> None:
        """A stage begins."""
        self.before, self.after = self.after, self.after + self.work.get(stage, 0.0)
        self.within(words, 0.0)

    def within(self, words: str, share: float) -> None:
        """A part of the stage begins, with this share of it done."""
        done = self.before + share * (self.after - self.before)
        self.progress(words, done / sum(self.work.values()))


def _of_window(
    done: Run,
    stages: Sequence[str],
    window: Window | None,
    orders: Sequence[int],
    weights: Literal["noise", "none"],
    integrator: Integrator,
    draws: int,
    begin: _Shares,
    designing: Designing,
) -> None:
    """The stages about one window: all but the diagnosis."""
    case = done.case
    if not case.sensors:
        _of_fluxes(done, stages, window, weights, integrator, draws, begin, designing)
        return
    if "design" in stages:
        begin("design", "design: which days tell most")
        with done.timed("design"):
            done.design = design(case, integrator=integrator, **designing.words)
        if not done.design.informative and window is None:
            return
    if window is None:
        window = (done.design or design(case, integrator=integrator, **designing.words)).best
    model: StateSpace
    if "learn" in stages and case.choices.model == "mim" and not case.choices.free:
        begin("learn", "learn: a reduced model for these days")
        with done.timed("learn"):
            # with order "auto", every order tried on the way is one of the figure's
            done.learned = learn(case, window, integrator=integrator, on_try=done.orders.append)
        if orders or ("orders" in stages and not done.orders):
            begin("orders", "learn: the error of other orders")
            with done.timed("orders"):
                done.orders = _by_order(case, window, done.learned, orders, integrator)
        model = done.learned.system
    else:
        model = full_order_model(case)
    if "estimate" in stages:
        checked = f", then {draws} draws of a bootstrap" if draws else ""
        begin("estimate", f"estimate: Gauss-Newton{checked}")
        with done.timed("estimate"):
            done.fit = estimate(case, window, model, weights=weights, integrator=integrator, draws=draws)
    # the whole record is held against the plain wall, which is not what was fitted where more of it was free
    if "reliability" in stages and done.fit is not None and not case.choices.free:
        begin("reliability", "reliability: the whole record")
        with done.timed("reliability"):
            done.prediction = predict(case, done.fit, model)
    if "lengths" in stages:
        _compare_lengths(done, begin, designing, model)
    if "places" in stages and designing.added:
        begin("places", "design: where a further sensor helps, and other steps")
        with done.timed("places"):
            choice = {name: word for name, word in designing.words.items() if name != "full"}
            done.places = place_sensors(case, window, count=designing.added, **choice)
            done.sampling = compare_sampling_steps(case, window)


def _by_order(
    case: Case, window: Window, learned: LearnedModel, orders: Sequence[int], integrator: Integrator
) -> list[LearnedModel]:
    """Reduced models of these orders, or of two below the one at hand beside it; none where there is none below."""
    own = learned.system.order
    wanted = orders or sorted({max(own // 5, 1), max(own // 2, 1), own})
    if not orders and len(wanted) < 2:
        return []
    others = [order for order in wanted if order != own]
    large, signals = full_order_model(case), training_signals(case, window)
    found = {one.system.order: one for one in sweep_orders(large, others, signals, integrator=integrator)}
    return [found.get(order, learned) for order in wanted]


def _compare_lengths(done: Run, begin: _Shares, designing: Designing, model: StateSpace | None) -> None:
    """What longer windows give, and what an estimate by a model costs where there is no flux in it."""
    case, days = done.case, days_within(done.case)
    if len(days) < 2:
        return
    begin("lengths", "design: what longer windows give and cost")
    with done.timed("lengths"):
        cost = None if model is None or fluxes_of(case) else partial(seconds_of_estimate, case, model=model)
        done.lengths = compare_lengths(case, days, cost, **designing.words)


def _of_fluxes(
    done: Run,
    stages: Sequence[str],
    window: Window | None,
    weights: Literal["noise", "none"],
    integrator: Integrator,
    draws: int,
    begin: _Shares,
    designing: Designing,
) -> None:
    """A case without a sensor inside: which days its plates tell most of, or an estimate from all of its record."""
    case = done.case
    if "estimate" not in stages:
        begin("design", "design: which days tell most")
        with done.timed("design"):
            done.design = design(case, integrator=integrator, **designing.words)
        if done.design.informative and "lengths" in stages:
            _compare_lengths(done, begin, designing, None)
        return
    begin("estimate", "estimate: conductivity and heat capacity from the fluxes")
    with done.timed("estimate"):
        done.fit = estimate(case, window, weights=weights, integrator=integrator, draws=draws)


def _check_orders(case: Case, orders: Sequence[int]) -> None:
    """Refuse orders that cannot be learned before anything long begins."""
    largest = case.choices.nodes - 2
    if orders and not case.sensors:
        raise InputError("--orders: fluxes are estimated by the large model, so no reduced model is learned")
    if orders and case.choices.model == "lom":
        raise InputError('--orders: the case\'s model is "lom", so no reduced model is learned; take --model mim')
    if wrong := [order for order in orders if not 1 <= order <= largest]:
        raise InputError(f"--orders: {wrong[0]}; with {case.choices.nodes} nodes an order lies between 1 and {largest}")
