"""The diffusivity of one window: the paper's Gauss-Newton iteration, then generalised least squares (GLS).

The paper's iteration treats the readings as independent (`weighted_least_squares`). GLS continues from its result with
the full covariance: sensor noise and face noise, which propagates through the wall, each white or autocorrelated;
offsets, position errors and the initial profile are nuisance parameters with priors.
"""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import jax
import numpy as np

from .._internal.arrays import on_device
from .._internal.blas_threads import one_blas_thread
from .._internal.errors import InputError
from .._internal.progress import Progress, no_progress, part_of, shown_progress
from .._internal.validation import one_of
from ..case.case_definition import Case
from ..case.initial_profile import scales
from ..case.time_window import HasBestWindow, Window, as_window, check_unbroken, entire_record
from ..inference.gls_fit import GLSFit
from ..inference.nuisance_kinds import NUISANCE_KINDS, NuisanceKind
from ..inference.physical_bounds import HIGHEST, LOWEST
from ..inference.weighted_least_squares import fit_weighted_least_squares
from ..models.flux_plates import fluxes_of, full_order_model_with_plates, with_flux
from ..models.integration import Integrator
from ..models.sensitivity_equations import explicit
from ..models.state_space import StateSpace
from ..models.window_inputs import check_driven, full_order_model, order_of_full_model, window_data
from ..reduction.modal_identification import LearnedModel
from ..reduction.training_signals import learn
from .conclusion import InitialFit, estimate_from_gls, gls_minima, initial_estimate
from .heat_flux import thermal_properties, why_flux_is_doubtful
from .result_objects import Estimate

_MIN_TIMED_RUNS, _MAX_TIMED_RUNS = 3, 30  # computing time is the median over this many runs
_TIMED_SECONDS = 0.3  # s, after which the minimum number of runs is enough
_MIN_DRAWS = 20  # of a bootstrap, for a 95 % interval


@one_blas_thread
def estimate(
    case: Case,
    window: Window | HasBestWindow | None = None,
    model: StateSpace | LearnedModel | None = None,
    *,
    start: float | None = None,
    weights: Literal["noise", "none"] = "noise",
    sensitivity: Literal["explicit", "autodiff"] = "explicit",
    integrator: Integrator = "propagator",
    eta: float | None = None,
    draws: int = 0,
    nuisance: Sequence[NuisanceKind] = NUISANCE_KINDS,
    progress: Progress | None = None,
) -> Estimate:
    """Estimate the diffusivity of a case from one window of its record.

    Minimises `(y - f(p))' R^-1 (y - f(p)) + z' z` over `p = (ln(alpha), z)`, with z the nuisance parameters in units of
    their prior standard deviations and R the covariance of the readings' noise.

    Args:
        window: rows of the record; None for the whole record, or its longest unbroken part.
        model: None for the model in the case's `[choices]`: the full-order model, or a reduced-order model learned for
            the window. With heat flux in the record the full-order model is used, unless the given model has the
            plates' outputs (`learn` with `plates`). With other free wall parameters (`[choices] free`) it is always
            used.
        start: initial diffusivity, m2/s; None for the case's prior.
        weights: "noise" for the full covariance of the readings; "none" for the paper's unweighted sum of squares,
            whose standard error treats the paper's simple sigma as white noise.
        sensitivity: "explicit" for the theta system, "autodiff" for automatic differentiation. With an untied H_theta
            use "explicit".
        integrator: time integration of the model.
        eta: stopping criterion on the relative change of the diffusivity; its square, but at least 1e-14, is the one on
            the cost. None for the case's.
        draws: of a parametric bootstrap that checks the interval; 0 for none.
        nuisance: kinds of nuisance parameters; add one of your own to `NUISANCE_KINDS` (`weights` "noise").
        progress: called as `progress(text, share)` with the step that begins and the completed share, 0 to 1;
            None for a bar in a notebook, and nothing elsewhere.

    Returns:
        the diffusivity with its interval, and all about the fit.

    Raises:
        InputError: a reduced-order model lacks an input of this window, the start is outside `LOWEST` to `HIGHEST`, an
            option is unknown, or there are too few draws.

    Example:
        `fit = wallid.estimate(case, wallid.design(case))`

    Source: Berger and Kadoch, Section 4.2; G. A. F. Seber, C. J. Wild, Nonlinear Regression (1989), 5.4.
    """
    one_of("weights", weights, ("noise", "none"))
    one_of("sensitivity", sensitivity, ("explicit", "autodiff"))
    start = case.wall.diffusivity_prior if start is None else start
    if not LOWEST < start < HIGHEST:
        raise InputError(f"start = {start} m2/s; it must lie between {LOWEST} and {HIGHEST}")
    check_draws(draws, weights)
    window = entire_record(case) if window is None else as_window(window)
    check_unbroken(case, window)
    if case.choices.free and weights == "none":
        raise InputError('[choices] free: --weights none estimates the diffusivity alone; take "noise"')
    eta = case.choices.eta if eta is None else eta
    if weights == "none" and not case.sensors:
        raise InputError(f"{case.path}: no [[sensor]]: --weights none takes temperatures inside the wall, not fluxes")
    explicit_theta = sensitivity == "explicit"
    with shown_progress(progress) as report:
        fitting: Progress = report
        if (fluxes_of(case) or case.choices.free) and weights == "noise":
            if model is None or case.choices.free or not _has_plate_outputs(case, model):
                model = full_order_model_with_plates(case)
        elif model is None and case.choices.model == "lom":
            model = full_order_model(case)
        elif model is None:
            model = learn(case, window, integrator=integrator, progress=part_of(report, 0.0, 0.4))
            fitting = part_of(report, 0.4, 1.0)
        if weights == "none":
            fitting("estimate: Gauss-Newton with independent readings", 0.0)
            return initial_estimate(_initial_fit(case, window, model, start, eta, explicit_theta, integrator, False))
        return estimate_by_gls(
            case,
            window,
            model,
            start,
            eta,
            explicit_theta=explicit_theta,
            integrator=integrator,
            draws=draws,
            nuisance=nuisance,
            progress=fitting,
        )[0]


def _initial_fit(
    case: Case,
    window: Window,
    model: StateSpace | LearnedModel,
    start: float,
    eta: float,
    explicit_theta: bool,
    integrator: Integrator,
    weighted: bool = True,
) -> InitialFit:
    """The paper's iteration, whose result is the start of the GLS rounds."""
    system, description, reduced = _system_and_description(case, model)
    check_driven(system, case, window)
    system = system.select(list(range(len(case.sensors))))
    data = window_data(case, window, weighted=weighted)
    fit = fit_weighted_least_squares(
        system,
        data,
        on_device(scales(case).fourier_number(1.0)),
        on_device(start),
        on_device(eta),
        explicit_theta=explicit_theta,
        integrator=integrator,
        max_iterations=case.choices.max_iterations,
    )
    return InitialFit(case, window, data, system, fit, reduced, description)


def _has_plate_outputs(case: Case, model: StateSpace | LearnedModel) -> bool:
    """Whether a model's outputs are the case's sensors and plates."""
    system = model.system if isinstance(model, LearnedModel) else model
    return system.C.shape[0] == len(case.sensors) + len(fluxes_of(case))


def _system_and_description(case: Case, model: StateSpace | LearnedModel) -> tuple[StateSpace, str, bool]:
    """A model's system, its description, and whether it is a reduced-order model."""
    system = model.system if isinstance(model, LearnedModel) else model
    reduced = isinstance(model, LearnedModel) or system.order < order_of_full_model(case)
    kind = "reduced-order model" if reduced else "full-order model" if case.section is None else "model of the section"
    return system, f"{kind} of order {system.order}", reduced


def estimate_by_gls(
    case: Case,
    window: Window,
    model: StateSpace | LearnedModel,
    start: float,
    eta: float,
    *,
    explicit_theta: bool = True,
    integrator: Integrator = "propagator",
    draws: int = 0,
    nuisance: Sequence[NuisanceKind] = NUISANCE_KINDS,
    with_contacts: bool = False,
    progress: Progress = no_progress,
) -> tuple[Estimate, GLSFit]:
    """The estimate with the full covariance, and the GLS fit that it is computed from.

    The paper's iteration gives the start. With heat flux or other free wall parameters it is omitted.

    Args:
        model: its outputs are the sensors, then the plates.
        with_contacts: whether contact resistances at plates are estimated also where the record shows none. The other
            arguments are as in `estimate`.
    """
    plates = fluxes_of(case)
    if plates or case.choices.free:
        system, description, reduced = _system_and_description(case, model)
        check_driven(system, case, window)
        description += f", with the flux of the {' and the '.join(plates)} face" if plates else ""
        description += f", free: {', '.join(case.choices.free).replace('_', ' ')}" if case.choices.free else ""
        data = with_flux(case, window, window_data(case, window))
        initial = InitialFit(case, window, data, system, None, reduced, description)
    else:
        progress("estimate: Gauss-Newton with independent readings", 0.0)
        initial = _initial_fit(case, window, model, start, eta, explicit_theta, integrator)
    progress("estimate: generalised least squares", 0.2)
    best_fit, other_minima = gls_minima(initial, eta, explicit_theta, integrator, start, nuisance, with_contacts)
    progress(f"estimate: bootstrap of {draws} records" if draws else "estimate: interval and checks", 0.7)
    result = estimate_from_gls(initial, best_fit, other_minima, draws)
    if initial.weighted_fit is None:
        steps = int(best_fit.minimum.trace.count) - 1
        thermal = thermal_properties(case, window, best_fit) if plates else None
        reason = result.reason or ("" if thermal is None else why_flux_is_doubtful(case, thermal))
        result = replace(result, thermal=thermal, iterations=steps, evaluations=steps + 1)
        doubt = "" if thermal is None or reason else thermal.disagreement
        advice = (*result.advice, doubt) if doubt else result.advice
        result = replace(result, reliable=not reason, reason=reason, advice=advice)
    return result, best_fit


def check_draws(draws: int, weights: str = "noise") -> None:
    """Check the number of draws of a bootstrap.

    Raises:
        InputError: too few draws, or a bootstrap of the paper's unweighted cost.
    """
    if draws and (draws < _MIN_DRAWS or weights == "none"):
        raise InputError(
            f"--bootstrap {draws}: a 95 % interval needs at least {_MIN_DRAWS} draws"
            if weights == "noise"
            else '--bootstrap: it draws from the full covariance, which --weights none leaves out; take "noise"'
        )


def seconds_of_estimate(case: Case, window: Window, model: StateSpace) -> float:
    """The computing time of one estimate without compilation, s: the median over several runs."""
    data, per_alpha = window_data(case, window), on_device(scales(case).fourier_number(1.0))
    start, eta = on_device(case.wall.diffusivity_prior), on_device(case.choices.eta)
    jax.block_until_ready(fit_weighted_least_squares(model, data, per_alpha, start, eta))
    seconds: list[float] = []
    # a short run is as short as other processes' interruptions, so a few runs would not be enough
    while len(seconds) < _MIN_TIMED_RUNS or (len(seconds) < _MAX_TIMED_RUNS and sum(seconds) < _TIMED_SECONDS):
        began = clock.perf_counter()
        jax.block_until_ready(fit_weighted_least_squares(model, data, per_alpha, start, eta))
        seconds.append(clock.perf_counter() - began)
    return float(np.median(seconds))


def sensitivity_in_kelvin(system: StateSpace, case: Case, window: Window, diffusivity: float) -> np.ndarray:
    """`dT/d(ln alpha)` at the outputs of a model over a window, K, `(time, output)`; of a flux that of q L / k."""
    fourier = scales(case).fourier_number(diffusivity)
    _, theta = explicit(system, fourier, window_data(case, window))
    return np.asarray(theta) * fourier * scales(case).temperature
