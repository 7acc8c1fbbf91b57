"""The stages of the method on a case: design, learn, estimate, prediction, diagnosis."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ._internal.errors import InputError
from ._internal.html import html_text
from ._internal.progress import Progress, shown_progress
from ._internal.result_object import ResultObject, plain_value
from .case.case_definition import Case
from .case.mixups import Mixup, visible_mixups
from .case.record_check import RecordCheck, check
from .case.time_window import Window, diagnosis_window, entire_record
from .discrepancy.result.diagnosis_result import Diagnosis
from .discrepancy.screening import Screening, screen
from .discrepancy.search_for_effects import diagnose
from .estimation.diffusivity import check_draws, estimate, seconds_of_estimate
from .estimation.many_windows import CampaignEstimate, campaign
from .estimation.prediction import Prediction, predict
from .estimation.result_objects import Estimate
from .experiment_design.expected_errors import with_expected_errors
from .experiment_design.fisher_information import Criterion, ParametersOfInterest, Robust
from .experiment_design.sampling_step import SamplingComparison, compare_sampling_steps
from .experiment_design.sensor_placement import SensorPlacement, place_sensors
from .experiment_design.window_lengths import LengthComparison, compare_lengths, days_within
from .experiment_design.window_selection import Design, design
from .inference.quantity import Quantity, quantity_frame
from .models.flux_plates import fluxes_of
from .models.integration import Integrator
from .models.state_space import StateSpace
from .models.window_inputs import full_order_model
from .reduction.modal_identification import LearnedModel, sweep_orders
from .reduction.training_signals import learn, training_signals

if TYPE_CHECKING:
    from pandas import DataFrame

STAGES = ("design", "learn", "orders", "estimate", "reliability", "screening")
"""The default stages of a run. `orders`: error of the reduced-order model against its order. `reliability`: prediction
over the entire record. `screening`: test whether an effect is missing from the model. Further stages: `check` (the
record), `lengths` (windows of other lengths), `places` (further sensors), `campaign` (the estimate from all windows)
and `diagnose` (many times slower than all default stages together; it does the screening too)."""


@dataclass(frozen=True)
class DesignOptions:
    """Options of the experiment design.

    Args:
        criterion, of, robust, full: as in `design`.
        further_sensors: number of further sensors to place.
    """

    criterion: Criterion = "D"
    of: ParametersOfInterest = "diffusivity"
    robust: Robust = "no"
    full: bool | None = None
    further_sensors: int = 1

    @property
    def options(self) -> dict[str, Any]:
        """The keyword arguments of `design` and `compare_lengths`."""
        return {"criterion": self.criterion, "of": self.of, "robust": self.robust, "full": self.full}


@dataclass
class Run(ResultObject):
    """The results of a run; None for stages that were not run.

    Args:
        seconds: wall-clock time of each stage, compilation included.
    """

    case: Case
    design: Design | None = None
    lengths: LengthComparison | None = None
    sensor_placement: SensorPlacement | None = None
    sampling: SamplingComparison | None = None
    learned: LearnedModel | None = None
    orders: list[LearnedModel] = field(default_factory=list)
    fit: Estimate | None = None
    prediction: Prediction | None = None
    campaign: CampaignEstimate | None = None
    screening: Screening | None = None
    diagnosis: Diagnosis | None = None
    check: RecordCheck | None = None
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def visible_mixups(self) -> tuple[Mixup, ...]:
        """Mix-ups of columns, units and clocks that are certain without a model; a diagnosis has its own."""
        estimated = (self.fit or self.campaign) is not None and self.diagnosis is None
        return visible_mixups(self.case) if estimated else ()

    @property
    def unreliable_reason(self) -> str:
        """Why the result is unreliable; empty if it is reliable, or if the stages give no result."""
        if self.diagnosis is not None:  # its diffusivity is the final answer
            return self.diagnosis.sentence if self.diagnosis.verdict == "uninformative" else ""
        estimate = self.fit or self.campaign
        if estimate is not None:
            if self.visible_mixups:
                return "; ".join(mixup.words for mixup in self.visible_mixups)
            return estimate.reason or ("" if self.screening is None else self.screening.missing)
        if self.check is not None:
            return "; ".join(self.check.stops)
        return str(self.design) if self.design is not None and not self.design.informative else ""

    @property
    def parts(self) -> dict[str, Any]:
        """The results of the stages that were run, by name, in the order of the method."""
        names = ("design", "lengths", "sensor_placement", "sampling", "learned", "fit", "campaign", "screening")
        results = {name: getattr(self, name) for name in (*names, "prediction", "diagnosis", "check")}
        return {name: one for name, one in results.items() if one is not None}

    def to_dict(self) -> dict[str, Any]:
        """The case, each result by its name, why the run is unreliable, and the seconds of the stages."""
        reason = {"unreliable_reason": self.unreliable_reason}
        return plain_value({"case": self.case} | self.parts | reason | {"seconds": self.seconds})

    def to_frame(self) -> DataFrame:
        """One row for each estimated quantity; the diffusivity is that of the diagnosis, if there is one."""
        quantities: dict[str, Quantity] = {}
        for result in (self.campaign, self.fit, self.diagnosis):
            quantities |= {} if result is None else result.quantities
        return quantity_frame(quantities)

    def _repr_html_(self) -> str:
        reason = self.unreliable_reason
        title = html_text(f"Not to be relied on: {reason}" if reason else f"Run of {self.case.name}")
        return "".join([title, self.case._repr_html_(), *(one._repr_html_() for one in self.parts.values())])

    def __str__(self) -> str:
        parts: list[Any] = [self.case]
        if self.unreliable_reason and self.diagnosis is None and (self.fit or self.campaign) is not None:
            parts.append(f"verdict      NOT TO BE RELIED ON: {self.unreliable_reason}")
        parts += [self.design, self.lengths, self.sensor_placement, self.sampling, self.learned, self.fit]
        parts += [self.campaign, self.screening, self.prediction, self.diagnosis]
        texts = [str(part) for part in (*parts, self.check) if part is not None]
        record = self.case.record
        if len(record.unbroken_parts) > 1 and (self.prediction or self.diagnosis):
            longest = entire_record(self.case)
            texts.append(
                f"the record has breaks: its longest unbroken part, {longest.rows} rows from "
                f"{record.stamp(longest.row)} to {record.stamp(longest.row + longest.rows)}, is used as entire record"
            )
        return "\n\n".join(texts)


Finished = Callable[[Run, str], None]
"""Called at the end of each stage with the results so far and the name of the stage."""


def run(
    case: Case,
    *,
    stages: Sequence[str] = STAGES,
    window: Window | None = None,
    orders: Sequence[int] = (),
    weights: Literal["noise", "none"] = "noise",
    integrator: Integrator = "propagator",
    draws: int = 0,
    design_options: DesignOptions = DesignOptions(),
    progress: Progress | None = None,
    finished: Finished = lambda run, stage: None,
) -> Run:
    """Run stages of the method on a case, in the order of the method.

    Args:
        case: the case.
        stages: names of stages, see `STAGES`.
        window: of the estimate; None for the best window of the design.
        orders: of the reduced-order models in the figure of error against order; empty for a few up to the case's.
        weights: of the readings in the estimate, "noise" (generalised least squares) or "none" (ordinary).
        integrator: time integration in the design, the learning and the estimate.
        draws: number of simulated records in the bootstrap of the interval; 0 for no bootstrap.
        design_options: of the experiment design.
        progress: called as `progress(text, share)` with the step that begins and the completed share, 0 to 1;
            None for a bar in a notebook, and nothing elsewhere.
        finished: called at the end of each stage.

    Raises:
        InputError: the case or an option does not permit a stage.
    """
    _check_orders(case, orders)
    check_draws(draws, weights)
    with shown_progress(progress) as report:
        begin = _StageProgress(Run(case), stages, len(orders), report, finished)
        return _run_stages(begin, stages, window, orders, weights, integrator, draws, design_options)


def _run_stages(
    begin: _StageProgress,
    stages: Sequence[str],
    window: Window | None,
    orders: Sequence[int],
    weights: Literal["noise", "none"],
    integrator: Integrator,
    draws: int,
    design_options: DesignOptions,
) -> Run:
    """Run the stages of `run`, which reports their progress."""
    result = begin.run
    case = result.case
    if "check" in stages:
        with begin("check", "check: the record"):
            result.check = check(case)
    if "campaign" in stages:
        with begin("campaign", "estimate: all windows"):
            result.campaign = campaign(case, progress=begin.within)
    if set(stages) - {"diagnose", "check", "campaign", "screening"}:
        _run_window_stages(result, stages, window, orders, weights, integrator, draws, begin, design_options)
    if "screening" in stages and "diagnose" not in stages and _can_be_screened(result):
        with begin("screening", "test: is an effect missing from the model?"):
            result.screening = screen(case)
    if "diagnose" in stages:
        with begin("diagnose", "diagnose: effects missing from the model"):
            result.diagnosis = diagnose(case, progress=begin.within)
    return result


def _can_be_screened(result: Run) -> bool:
    """Whether there is an estimate of the plain model, which alone is tested, and a temperature to test it with.

    With further parameters of the wall free, the fitted model is not the plain one.
    """
    if result.fit is None and result.campaign is None:
        return False
    case = result.case
    window = diagnosis_window(case)
    return not case.choices.free and bool(np.isfinite(case.record.sensors[window.as_slice]).any())


class _StageProgress:
    """Times stages, and converts progress within a stage to progress of the run by the usual duration of each."""

    def __init__(self, run: Run, stages: Sequence[str], orders: int, progress: Progress, finished: Finished):
        self.durations = {
            "check": 1.0,
            "design": 2.0,
            "lengths": 4.0,
            "places": 4.0,
            "learn": 5.0,
            "orders": 2.0 * (orders or 2),
            "estimate": 3.0,
            "reliability": 4.0,
            "campaign": 10.0,
            "screening": 8.0,
            "diagnose": 60.0,
        }
        self.work = {stage: self.durations[stage] for stage in stages}
        self.run, self.progress, self.finished = run, progress, finished
        self.before = self.after = 0.0

    @contextmanager
    def __call__(self, stage: str, text: str) -> Iterator[None]:
        """Report the beginning of a stage, time it, and report its end."""
        self.before, self.after = self.after, self.after + self.work.get(stage, 0.0)
        self.within(text, 0.0)
        start = clock.perf_counter()
        yield
        self.run.seconds[stage] = clock.perf_counter() - start
        self.finished(self.run, stage)

    def within(self, text: str, share: float) -> None:
        """Report the beginning of a step within the stage, after this share of the stage; its end is not the run's."""
        if text == "done":
            return
        completed = self.before + share * (self.after - self.before)
        self.progress(text, completed / sum(self.work.values()))


def _run_window_stages(
    result: Run,
    stages: Sequence[str],
    window: Window | None,
    orders: Sequence[int],
    weights: Literal["noise", "none"],
    integrator: Integrator,
    draws: int,
    begin: _StageProgress,
    design_options: DesignOptions,
) -> None:
    """Run the stages for one window: all but check, campaign and diagnose."""
    case = result.case
    if not case.sensors:
        _run_flux_stages(result, stages, window, weights, integrator, draws, begin, design_options)
        return
    if "design" in stages:
        with begin("design", "design: the most informative days"):
            found = design(case, integrator=integrator, **design_options.options)
            result.design = with_expected_errors(case, found)
        if not result.design.informative and window is None:
            return
    if window is None:
        window = (result.design or design(case, integrator=integrator, **design_options.options)).best
    model: StateSpace
    if "learn" in stages and case.choices.model == "mim" and not case.choices.free:
        with begin("learn", "learn: the reduced-order model"):
            # with order "auto", the figure shows every order that is tried
            result.learned = learn(
                case, window, integrator=integrator, on_try=result.orders.append, progress=begin.within
            )
        if orders or ("orders" in stages and not result.orders):
            with begin("orders", "learn: error against order"):
                result.orders = _models_by_order(case, window, result.learned, orders, integrator)
        model = result.learned.system
    else:
        model = full_order_model(case)
    if "estimate" in stages:
        bootstrap = f", then a bootstrap with {draws} records" if draws else ""
        with begin("estimate", f"estimate: Gauss-Newton{bootstrap}"):
            result.fit = estimate(
                case, window, model, weights=weights, integrator=integrator, draws=draws, progress=begin.within
            )
    # the prediction uses the plain wall, which is not the fitted model where further parameters were estimated
    if "reliability" in stages and result.fit is not None and not case.choices.free:
        with begin("reliability", "reliability: prediction over the entire record"):
            result.prediction = predict(case, result.fit, model)
    if "lengths" in stages:
        _compare_lengths(result, begin, design_options, model)
    if "places" in stages and design_options.further_sensors:
        with begin("places", "design: further sensors and sampling steps"):
            options = {name: value for name, value in design_options.options.items() if name != "full"}
            result.sensor_placement = place_sensors(case, window, count=design_options.further_sensors, **options)
            result.sampling = compare_sampling_steps(case, window)


def _models_by_order(
    case: Case, window: Window, learned: LearnedModel, orders: Sequence[int], integrator: Integrator
) -> list[LearnedModel]:
    """Reduced-order models of these orders; by default of the learned order and two lower ones, if there are any."""
    learned_order = learned.system.order
    if not orders:
        orders = sorted({max(learned_order // 5, 1), max(learned_order // 2, 1), learned_order})
        if len(orders) < 2:
            return []
    others = [order for order in orders if order != learned_order]
    models = sweep_orders(full_order_model(case), others, training_signals(case, window), integrator=integrator)
    by_order = {model.system.order: model for model in models}
    return [by_order.get(order, learned) for order in orders]


def _compare_lengths(
    result: Run, begin: _StageProgress, design_options: DesignOptions, model: StateSpace | None
) -> None:
    """Compare window lengths: the information, and for a case without flux the duration of an estimate."""
    case, days = result.case, days_within(result.case)
    if len(days) < 2:
        return
    with begin("lengths", "design: window lengths"):
        cost = None if model is None or fluxes_of(case) else partial(seconds_of_estimate, case, model=model)
        result.lengths = compare_lengths(case, days, cost, progress=begin.within, **design_options.options)


def _run_flux_stages(
    result: Run,
    stages: Sequence[str],
    window: Window | None,
    weights: Literal["noise", "none"],
    integrator: Integrator,
    draws: int,
    begin: _StageProgress,
    design_options: DesignOptions,
) -> None:
    """Run the stages for a case without a sensor inside the wall: a design, or an estimate from the heat fluxes."""
    case = result.case
    if "estimate" not in stages:
        with begin("design", "design: the most informative days"):
            found = design(case, integrator=integrator, **design_options.options)
            result.design = with_expected_errors(case, found)
        if result.design.informative and "lengths" in stages:
            _compare_lengths(result, begin, design_options, None)
        return
    with begin("estimate", "estimate: conductivity and heat capacity from the fluxes"):
        result.fit = estimate(case, window, weights=weights, integrator=integrator, draws=draws, progress=begin.within)


def _check_orders(case: Case, orders: Sequence[int]) -> None:
    """Check that reduced-order models of these orders can be learned."""
    largest = case.choices.nodes - 2
    if orders and not case.sensors:
        raise InputError(
            "--orders: the estimate from fluxes uses the full-order model; no reduced-order model is learned"
        )
    if orders and case.choices.model == "lom":
        raise InputError('--orders: the model of the case is "lom"; no reduced-order model is learned; use --model mim')
    if wrong := [order for order in orders if not 1 <= order <= largest]:
        raise InputError(f"--orders: {wrong[0]}; with {case.choices.nodes} nodes an order must be from 1 to {largest}")
