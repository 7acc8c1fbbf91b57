"""The estimate: Gauss-Newton through optimistix, its interval, and whether it can be relied on.

First the paper's iteration, each reading by itself (`least_squares`); from there the likelihood under the full
covariance (`interval`): the sensors' noise and the faces', which goes through the wall, as white noise and as noise
that remembers, with offsets, position errors and the initial profile free within their priors.
"""

from __future__ import annotations

import time as clock
from dataclasses import replace
from typing import Literal

import jax
import numpy as np

from .._internal.arrays import on_device
from .._internal.errors import InputError
from .._internal.validation import one_of
from ..case.case_definition import Case
from ..case.initial_profile import scales
from ..case.time_window import HasBest, Window, as_window, check_unbroken, whole
from ..inference.gls_fit import GLSFit
from ..inference.likelihood import HIGHEST, LOWEST
from ..inference.weighted_least_squares import fit_weighted_least_squares, paper_sigma
from ..models.flux_plates import fluxes_of, with_flux
from ..models.integration import Integrator
from ..models.plate_model import full_order_model_with_plates
from ..models.sensitivity_equations import explicit
from ..models.state_space import StateSpace
from ..models.window_inputs import check_driven, full_order_model, window_data
from ..reduction.modal_identification import LearnedModel
from ..reduction.training_signals import learn
from .conclusion import InitialFit, estimate_from_gls, gls_minima, initial_estimate
from .heat_flux import thermal
from .result_objects import Estimate

__all__ = [
    "HIGHEST",
    "LOWEST",
    "Estimate",
    "estimate",
    "fit_weighted_least_squares",
    "paper_sigma",
    "seconds_of_estimate",
    "theta_kelvin",
]

_FEWEST_TIMED, _MOST_TIMED = 3, 30  # runs that an estimate's cost is the median of
_TIMED_FOR = 0.3  # s, after which the fewest are enough
_FEWEST_DRAWS = 20  # of a bootstrap that is to give a 95 % interval


def estimate(
    case: Case,
    window: Window | HasBest | None = None,
    model: StateSpace | LearnedModel | None = None,
    *,
    start: float | None = None,
    weights: Literal["noise", "none"] = "noise",
    sensitivity: Literal["explicit", "autodiff"] = "explicit",
    integrator: Integrator = "propagator",
    eta: float | None = None,
    draws: int = 0,
) -> Estimate:
    """The diffusivity of a case from one window of its record.

    Args:
        window: None for the whole record, or its longest unbroken part.
        model: None for the case's choice: the large model, or a reduced one learned for the window. With heat flux in
            the record the large model is taken, unless the one given has the plates' outputs too (`learn` with
            `plates`); with more of the wall free (`[choices] free`) it is, whatever is given.
        start: m2/s; None for the case's prior.
        weights: the full covariance of the readings, or the paper's plain sum of squares, whose standard error
            takes the paper's simple sigma for white noise.
        sensitivity: the explicit theta system, or autodiff (with a free H_theta, the first).
        eta: the stopping criterion on the relative change of the diffusivity, and by its square the one
            on the cost's, not under 1e-14; None for the case's.
        draws: of a parametric bootstrap that checks the interval; 0 for none.

    Raises:
        InputError: a reduced model that does not know what a face of this window does.
            Or a start outside `LOWEST` to `HIGHEST`, an unknown choice, or too few draws.
    """
    one_of("weights", weights, ("noise", "none"))
    one_of("sensitivity", sensitivity, ("explicit", "autodiff"))
    start = case.wall.diffusivity_prior if start is None else start
    if not LOWEST < start < HIGHEST:
        raise InputError(f"start = {start} m2/s; it must lie between {LOWEST} and {HIGHEST}")
    check_draws(draws, weights)
    window = whole(case) if window is None else as_window(window)
    check_unbroken(case, window)
    if case.choices.free and weights == "none":
        raise InputError('[choices] free: --weights none estimates the diffusivity alone; take "noise"')
    eta = case.choices.eta if eta is None else eta
    if weights == "none" and not case.sensors:
        raise InputError(f"{case.path}: no [[sensor]]: --weights none takes temperatures inside the wall, not fluxes")
    if (fluxes_of(case) or case.choices.free) and weights == "noise":
        if model is None or case.choices.free or not _has_plates(case, model):
            model = full_order_model_with_plates(case)
        return fit_with_flux(
            case, window, model, start, eta,
            explicit_theta=sensitivity == "explicit", integrator=integrator, draws=draws,
        )[0]  # fmt: skip
    if model is None:
        model = full_order_model(case) if case.choices.model == "lom" else learn(case, window, integrator=integrator)
    told = initial_fit(
        case, window, model, start, eta, weighted=weights == "noise", sensitivity=sensitivity, integrator=integrator
    )
    if weights == "none":
        return initial_estimate(told)
    settled, others = gls_minima(told, eta, sensitivity == "explicit", integrator)
    return estimate_from_gls(told, settled, others, draws)


def initial_fit(
    case: Case,
    window: Window,
    model: StateSpace | LearnedModel,
    start: float,
    eta: float,
    *,
    weighted: bool = True,
    sensitivity: Literal["explicit", "autodiff"] = "explicit",
    integrator: Integrator = "propagator",
) -> InitialFit:
    """The paper's iteration, from which the rounds under the full covariance go on.

    Arguments: as in `estimate`.
    """
    system, words, reduced = _named(case, model)
    check_driven(system, case, window)
    system = system.select(list(range(len(case.sensors))))
    data = window_data(case, window, weighted=weighted)
    fit = fit_weighted_least_squares(
        system,
        data,
        on_device(scales(case).fourier(1.0)),
        on_device(start),
        on_device(eta),
        explicit_theta=sensitivity == "explicit",
        integrator=integrator,
        max_iterations=case.choices.max_iterations,
    )
    return InitialFit(case, window, data, system, fit, reduced, words)


def _has_plates(case: Case, model: StateSpace | LearnedModel) -> bool:
    """Whether a model gives out what the case's sensors and plates read."""
    system = model.system if isinstance(model, LearnedModel) else model
    return system.C.shape[0] == len(case.sensors) + len(fluxes_of(case))


def _named(case: Case, model: StateSpace | LearnedModel) -> tuple[StateSpace, str, bool]:
    """A model's system, what it is in words, and whether it is a reduced one."""
    system = model.system if isinstance(model, LearnedModel) else model
    reduced = isinstance(model, LearnedModel) or system.order < case.choices.nodes - 2
    return system, f"{'reduced' if reduced else 'large'} model of order {system.order}", reduced


def fit_with_flux(
    case: Case,
    window: Window,
    model: StateSpace | LearnedModel,
    start: float,
    eta: float,
    *,
    explicit_theta: bool = True,
    integrator: Integrator = "propagator",
    draws: int = 0,
) -> tuple[Estimate, GLSFit]:
    """The estimate of a case with heat flux, or with more of the wall free.

    Args:
        model: its outputs are the sensors, then the plates: `whole_model`, or a reduced one; the others as in
            `estimate`.
    """
    plates, (system, words, reduced) = fluxes_of(case), _named(case, model)
    check_driven(system, case, window)
    words += f", with the flux of the {' and the '.join(plates)} face" if plates else ""
    words += f", free: {', '.join(case.choices.free).replace('_', ' ')}" if case.choices.free else ""
    data = with_flux(case, window, window_data(case, window))
    told = InitialFit(case, window, data, system, None, reduced, words)
    settled, others = gls_minima(told, eta, explicit_theta, integrator, start)
    fit = estimate_from_gls(told, settled, others, draws)
    steps = int(settled.minimum.trace.count) - 1
    found = thermal(case, window, settled) if plates else None
    return replace(fit, thermal=found, iterations=steps, evaluations=steps + 1), settled


def check_draws(draws: int, weights: str = "noise") -> None:
    """Refuse a bootstrap that could say nothing.

    Raises:
        InputError: too few draws, or one of the paper's plain cost.
    """
    if draws and (draws < _FEWEST_DRAWS or weights == "none"):
        raise InputError(
            f"--bootstrap {draws}: a 95 % interval needs at least {_FEWEST_DRAWS} draws"
            if weights == "noise"
            else '--bootstrap: it draws from the full covariance, which --weights none leaves out; take "noise"'
        )


def seconds_of_estimate(case: Case, window: Window, model: StateSpace) -> float:
    """What one warm estimate costs: the median of up to thirty in some tenths of a second, compilation apart."""
    data, per_alpha = window_data(case, window), on_device(scales(case).fourier(1.0))
    start, eta = on_device(case.wall.diffusivity_prior), on_device(case.choices.eta)
    jax.block_until_ready(fit_weighted_least_squares(model, data, per_alpha, start, eta))
    taken: list[float] = []
    # a short one takes no longer than what else the machine does in between: a few would tell of that
    while len(taken) < _FEWEST_TIMED or (len(taken) < _MOST_TIMED and sum(taken) < _TIMED_FOR):
        began = clock.perf_counter()
        jax.block_until_ready(fit_weighted_least_squares(model, data, per_alpha, start, eta))
        taken.append(clock.perf_counter() - began)
    return float(np.median(taken))


def theta_kelvin(system: StateSpace, case: Case, window: Window, diffusivity: float) -> np.ndarray:
    """`dT/d(ln alpha)` at a model's outputs over a window, K, `(time, output)`; of a flux that of q L / k."""
    fourier = scales(case).fourier(diffusivity)
    _, theta = explicit(system, fourier, window_data(case, window))
    return np.asarray(theta) * fourier * scales(case).temperature
