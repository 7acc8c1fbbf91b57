"""From a fit to an `Estimate`: interval and reliability by GLS, or the paper's simple standard error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._internal.arrays import on_device
from ..case.case_definition import Case
from ..case.initial_profile import fit_profile, scales
from ..case.time_window import Window
from ..case.wall_and_sensors import SIDES
from ..inference.gauss_newton import Trace
from ..inference.generalised_least_squares import fit_generalised_least_squares
from ..inference.gls_fit import GLSFit
from ..inference.identifiability import identifiability
from ..inference.material_values import material_values
from ..inference.nuisance_kinds import NUISANCE_KINDS, NuisanceKind, WallParameters
from ..inference.parameters import kind_of, target_of
from ..inference.parametric_bootstrap import bootstrap
from ..inference.physical_bounds import HIGHEST, LOWEST, clip_to_physical, limited_log_std
from ..inference.quantity import NORMAL_95, Quantity, lognormal
from ..inference.sensor_places import sensor_places
from ..inference.validity import (
    FAR_LARGER,
    noise_advice,
    noise_ratio,
    settling_advice,
    why_contradicted,
    why_noisier,
    why_not_constant,
    why_too_coarse,
    why_unreliable,
    why_weak_signal,
)
from ..inference.weighted_least_squares import WeightedFit, covariance, model_difference, paper_sigma_of_readings
from ..models.flux_plates import plate_outputs
from ..models.integration import Integrator
from ..models.state_space import StateSpace
from ..models.wall_parameters import film_lengths_at, layer_ratios, prior_std_of
from ..models.window_inputs import WindowData, full_order_model
from .materials import implausible
from .result_objects import Estimate

_FAR_FROM_PRIOR = 3.0  # a start that is further from the prior by this factor: the prior is tried as a start as well
_MAX_MINIMA = 4
_INSTRUMENT_ERRORS = {"offsets": "sensor_offset", "positions": "sensor_position", "face_positions": "face_position"}


@dataclass(frozen=True, eq=False)
class InitialFit:
    """The result of the paper's weighted least squares, with its data and model.

    Args:
        data, system: of the window; the outputs are the sensors, then the plates if any.
        weighted_fit: the paper's iteration; None where it is omitted (heat flux or free wall parameters).
        reduced: whether `system` is a reduced-order model.
        model_description: the model as text.
    """

    case: Case
    window: Window
    data: WindowData
    system: StateSpace
    weighted_fit: WeightedFit | None
    reduced: bool
    model_description: str

    @property
    def present(self) -> np.ndarray:
        """Where a reading is present, `(time, output)`."""
        return np.asarray(self.data.weight) > 0

    def reduction_error(self, diffusivity: float, data: WindowData) -> np.ndarray | None:
        """Full-order minus reduced-order predictions, K (a flux as q L / k); None for a full-order model.

        Args:
            data: of the window, as the fit has them: beside plates its faces are filtered.
        """
        if not self.reduced or not np.isfinite(diffusivity):
            return None
        plates = plate_outputs(self.case) if self.data.observed.shape[1] > len(self.case.sensors) else []
        fourier = on_device(scales(self.case).fourier_number(diffusivity))
        return np.asarray(model_difference(full_order_model(self.case, plates), self.system, data, fourier))

    def history(self, traces: tuple[Trace, ...] = ()) -> dict[str, np.ndarray]:
        """The iterates of the paper's iteration, then those of the GLS rounds."""
        prior, fit = self.case.wall.diffusivity_prior, self.weighted_fit
        parts = [] if fit is None else [_iterates(fit.trace, np.asarray(fit.trace.parameters)[:, 0])]
        parts += [_iterates(trace, prior * np.exp(np.asarray(trace.parameters)[:, 0])) for trace in traces]
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def to_estimate(self, **fields) -> Estimate:
        """An `Estimate` from these fields and those that both kinds of estimate have in common."""
        fit = self.weighted_fit
        return Estimate(
            iterations=0 if fit is None else int(fit.trace.count) - 1,
            evaluations=0 if fit is None else int(fit.evaluations),
            profile=fit_profile(self.case, self.window.row),
            model_description=self.model_description,
            window=self.window,
            **fields,
        )


def _iterates(trace: Trace, diffusivity) -> dict[str, np.ndarray]:
    count = int(trace.count)
    columns = {"diffusivity": diffusivity, "cost": trace.cost, "gamma_1": trace.gamma_1, "gamma_2": trace.gamma_2}
    return {name: np.asarray(column)[:count] for name, column in columns.items()}


def gls_minima(
    initial: InitialFit,
    eta: float,
    explicit_theta: bool,
    integrator: Integrator,
    start: float | None = None,
    kinds: Sequence[NuisanceKind] = NUISANCE_KINDS,
    with_contacts: bool = False,
) -> tuple[GLSFit, list[GLSFit]]:
    """The best minimum of the GLS cost, and others that the record does not exclude.

    The search starts from the paper's estimate (else from `start`), from the prior where that is far away, and from
    every diffusivity at which a profile likelihood was found to be lower.
    """
    prior = initial.case.wall.diffusivity_prior
    if (weighted := initial.weighted_fit) is not None:
        start = float(np.asarray(weighted.trace.parameters)[int(weighted.trace.count) - 1, 0])
    first = prior if start is None else start
    starts = [first] if LOWEST * 1.001 < first < HIGHEST / 1.001 else []
    if not starts or abs(np.log(first / prior)) > np.log(_FAR_FROM_PRIOR):
        starts.append(prior)
    fits: list[GLSFit] = []
    while starts and len(fits) < _MAX_MINIMA:
        one = fit_generalised_least_squares(
            initial.case, initial.window, initial.data, initial.system, starts.pop(0),
            eta=eta, explicit_theta=explicit_theta, integrator=integrator, kinds=kinds, with_contacts=with_contacts,
        )  # fmt: skip
        fits.append(one)
        if one.interval.lower_minimum is not None:
            starts.append(prior * float(np.exp(one.interval.lower_minimum)))
    fits = (
        sorted((one for one in fits if np.isfinite(one.marginal_deviance)), key=lambda one: one.marginal_deviance)
        or fits
    )
    best = fits[0]
    return best, [one for one in fits[1:] if one.marginal_deviance - best.marginal_deviance < best.quantile**2]


def estimate_from_gls(initial: InitialFit, best_fit: GLSFit, other_minima: list[GLSFit], draws: int) -> Estimate:
    """The estimate with its interval and its reliability, from the best GLS fit.

    The interval spans the intervals of all minima that the record does not exclude, and the error of a reduced-order
    model is added in quadrature.

    Args:
        initial: data and model of the window.
        best_fit, other_minima: as from `gls_minima`.
        draws: of a parametric bootstrap; 0 for none.

    Returns:
        the estimate, with `reliable` False and a reason where the record does not determine the diffusivity.
    """
    case, best = initial.case, best_fit.minimum
    value, std_log = best_fit.diffusivity, best_fit.log_std
    reduction_error = initial.reduction_error(value, best_fit.problem.data)
    shift = 0.0 if reduction_error is None else best_fit.model_shift(reduction_error)
    interval = best_fit.interval
    low, high = (
        pick(getattr(one.interval, end) for one in (best_fit, *other_minima))
        for pick, end in ((min, "low"), (max, "high"))
    )
    kind = interval.method if (low, high) == (interval.low, interval.high) else "profile likelihood"
    ends = [
        float(np.exp(np.clip(np.sign(end) * np.hypot(end, best_fit.quantile * shift), -700.0, 700.0))) * value
        for end in (low - best_fit.log_alpha, high - best_fit.log_alpha)
    ]
    parameters = {name: (float(best_fit.parameters[name]), best_fit.std(name)) for name in best_fit.names[1:]}
    instrument_errors = {
        field: {target_of(name): value for name, value in parameters.items() if kind_of(name) == kind}
        for field, kind in _INSTRUMENT_ERRORS.items()
    }
    singular = np.linalg.svd(best_fit.jacobian, compute_uv=False) if best_fit.finite else np.array([np.nan])
    materials = material_values(case, best_fit)
    bounds = float(best_fit.problem.lowest), float(best_fit.problem.highest)
    reason = why_unreliable(case, value, (ends[0], ends[1]), singular, bool(best.converged), bounds)
    if reason and noise_ratio(best_fit) > FAR_LARGER:  # the window is informative: its model is wrong
        reason = why_noisier(case, best_fit)
    reason = reason or why_too_coarse(shift, std_log) or why_weak_signal(case, best_fit)
    reason = (
        reason or why_contradicted(case, best_fit) or why_not_constant(case, best_fit) or why_noisier(case, best_fit)
    )
    covariance = best_fit.covariance.copy()
    covariance[0, 0] += shift**2
    # the reasons above are about the ends as computed
    interval_95 = clip_to_physical(ends[0], ends[1], "m2/s")
    return initial.to_estimate(
        value=value,
        std=value * limited_log_std(float(np.hypot(std_log, shift))),
        interval_95=interval_95,
        interval_kind=kind,
        **instrument_errors,
        parameters=parameters,
        message="converged" if bool(best.converged) else "stopped at the largest number of iterations",
        reliable=not reason,
        reason=reason,
        rounds=best_fit.iterations,
        history=initial.history((best.trace,)),
        reduced_chi_square=best_fit.reduced_chi_square,
        noise_description=_noise_description(best_fit),
        noise_ratio=noise_ratio(best_fit),
        disturbance=best_fit.disturbance,
        sensor_places=sensor_places(case, best_fit) if not reason else {},
        noise_rms=tuple(best_fit.noise_shape.stated_rms_of_outputs().tolist()),
        advice=tuple(
            text for text in (settling_advice(best_fit), noise_advice(case, best_fit), _doubt(case, value)) if text
        ),
        variance_shares=best_fit.variance_shares() if not reason else {},
        predicted=np.asarray(best.predicted),
        residual=np.where(initial.present, np.asarray(initial.data.observed) - np.asarray(best.predicted), np.nan),
        covariance=covariance,
        singular_values=singular,
        model_shift=shift,
        identifiability=identifiability(case, best_fit) if best_fit.finite and len(best_fit.names) > 1 else None,
        wall_parameters=_wall_parameters(case, best_fit) if materials is None else materials.quantities,
        materials=materials,
        bootstrap=bootstrap(best_fit, draws, case.choices.seed) if draws and not reason else None,
    )


def _doubt(case: Case, value: float) -> str:
    """Why the value is not that of a wall; empty for a case of fluxes only, whose stated length may be a guess."""
    return implausible(value, case.wall.diffusivity_prior) if case.sensors else ""


def _wall_parameters(case: Case, fit: GLSFit) -> dict[str, Quantity]:
    """The estimated parameters of the wall beside its diffusivity: layer diffusivities and film lengths."""
    indices, quantities = fit.indices(WallParameters.kind), {}
    if not len(indices) or not fit.finite or case.section is not None:
        return {}
    names, z = [target_of(fit.names[k]) for k in indices], fit.z[indices]
    used = [0, *indices.tolist()]
    covariance = fit.covariance[np.ix_(used, used)]
    if any(name.startswith("layer") for name in names):
        ratios = layer_ratios(case, names, z)
        for i, ratio in enumerate(ratios):
            derivative = [np.log(layer_ratios(case, names, z + step)[i] / ratio) for step in 1e-5 * np.eye(len(z))]
            combination = np.array([1.0, *(np.array(derivative) / 1e-5)])
            quantities[f"layer {i + 1}"] = lognormal(
                fit.diffusivity * float(ratio), float(combination @ covariance @ combination), fit.quantile, "m2/s"
            )
    for side, length in zip(SIDES, film_lengths_at(case, names, z), strict=True):
        if (name := f"film_{side}") in names:
            index = 1 + names.index(name)
            variance = prior_std_of(case, name) ** 2 * float(covariance[index, index])
            quantities[name] = lognormal(length, variance, fit.quantile, "m")
    return quantities


def _noise_description(fit: GLSFit) -> str:
    """The noise that the interval is based on, as text."""
    if fit.robust is not None:
        return f"weighted as stated, the interval by {fit.robust}"
    if fit.disturbance is not None:
        return f"{fit.noise} beside the disturbance"
    return str(fit.noise) if fit.noise_estimated else "noise as stated"


def initial_estimate(initial: InitialFit) -> Estimate:
    """The paper's simple estimate: unweighted least squares.

    Its standard error treats noise and position errors together as white noise with standard deviations S,
    `Var(p) = (J' J)^-1 J' S^2 J (J' J)^-1`, times the reduced chi-square where that is above 1.
    """
    case, data, fit = initial.case, initial.data, initial.weighted_fit
    assert fit is not None
    present, weight = initial.present, np.asarray(data.weight)
    residual = np.asarray(data.observed) - np.asarray(fit.predicted)
    count = int(fit.trace.count)
    value = float(fit.trace.parameters[count - 1, 0])
    noise = paper_sigma_of_readings(case, data, value)
    row_std = np.concatenate([(weight * noise).reshape(-1), np.ones(len(data.offsets))])
    singular, spread = covariance(np.asarray(fit.jacobian), row_std)
    beta = np.asarray(fit.parameters[1:])
    freedom = max(int(present.sum()) - 1, 1)
    chi_square = float(np.sum((residual / noise)[present] ** 2) + np.sum(beta**2)) / freedom
    spread = spread * max(1.0, chi_square)
    noise_std_log, shift = float(np.sqrt(spread[0, 0])), 0.0
    if (error := initial.reduction_error(value, initial.data)) is not None:
        rows = np.concatenate([(weight * error).reshape(-1), np.zeros(len(data.offsets))])
        shift = float(np.linalg.lstsq(np.asarray(fit.jacobian), rows)[0][0])
    spread[0, 0] += shift**2
    std_log = float(np.sqrt(spread[0, 0]))
    half = min(NORMAL_95 * std_log, 700.0)  # exp(709) is the largest float
    interval = (value * float(np.exp(-half)), value * float(np.exp(half)))
    offset_std = np.asarray(data.offset_std)[list(data.offsets)]
    names = [case.sensors[s].name for s in data.offsets]
    reason = why_unreliable(case, value, interval, singular, bool(fit.converged))
    reason = reason or why_too_coarse(shift, noise_std_log)
    return initial.to_estimate(
        value=value,
        std=value * limited_log_std(std_log),
        interval_95=clip_to_physical(*interval, "m2/s"),
        offsets={
            name: (float(std * beta), float(std * np.sqrt(variance)))
            for name, std, beta, variance in zip(names, offset_std, beta, np.diag(spread)[1:], strict=True)
        },
        message="converged" if bool(fit.converged) else "stopped at the largest number of iterations",
        reliable=not reason,
        reason=reason,
        history=initial.history(),
        reduced_chi_square=chi_square,
        predicted=np.asarray(fit.predicted),
        residual=np.where(present, residual, np.nan),
        advice=tuple(text for text in (_doubt(case, value),) if text),
        covariance=spread,
        singular_values=singular,
        model_shift=shift,
    )
