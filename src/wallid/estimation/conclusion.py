"""From a minimum to an estimate: its interval, its verdict, and the paper's simple one beside it."""

from __future__ import annotations

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
from ..inference.likelihood import HIGHEST, LOWEST
from ..inference.nuisance_parameters import instrument_errors_of
from ..inference.parametric_bootstrap import bootstrap
from ..inference.quantity import NORMAL_95, Quantity, lognormal
from ..inference.validity import why_strained, why_too_coarse, why_too_faint, why_unreliable, why_unsteady
from ..inference.weighted_least_squares import WeightedFit, covariance, model_difference, simple_sigma
from ..models.flux_plates import plate_outputs
from ..models.integration import Integrator
from ..models.state_space import StateSpace
from ..models.wall_parameters import film_at, layer_ratios, std_of
from ..models.window_inputs import WindowData, full_order_model
from .result_objects import Estimate

_FAR = 3.0  # from the prior: the prior is tried as a start as well
_MOST_MINIMA = 4


@dataclass(frozen=True, eq=False)
class InitialFit:
    """What the paper's iteration gave, and what it was given."""

    case: Case
    window: Window
    data: WindowData
    system: StateSpace
    fit: WeightedFit | None
    reduced: bool
    words: str

    @property
    def present(self) -> np.ndarray:
        """Where there is a reading."""
        return np.asarray(self.data.weight) > 0

    def apart(self, diffusivity: float) -> np.ndarray | None:
        """The large model's predictions less the reduced one's, K, of a flux q L / k; None for the large one."""
        if not self.reduced or not np.isfinite(diffusivity):
            return None
        plates = plate_outputs(self.case) if self.data.observed.shape[1] > len(self.case.sensors) else []
        fourier = on_device(scales(self.case).fourier(diffusivity))
        return np.asarray(model_difference(full_order_model(self.case, plates), self.system, self.data, fourier))

    def history(self, traces: tuple[Trace, ...] = ()) -> dict[str, np.ndarray]:
        """The iterates, those of later rounds appended."""
        start = self.case.wall.diffusivity_prior
        rows = [] if self.fit is None else [_rows(self.fit.trace, np.asarray(self.fit.trace.parameters)[:, 0])]
        rows += [_rows(trace, start * np.exp(np.asarray(trace.parameters)[:, 0])) for trace in traces]
        return {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}

    def finished(self, **found) -> Estimate:
        """An estimate with what every kind of it has."""
        return Estimate(
            iterations=0 if self.fit is None else int(self.fit.trace.count) - 1,
            evaluations=0 if self.fit is None else int(self.fit.evaluations),
            profile=fit_profile(self.case, self.window.row),
            model=self.words,
            window=self.window,
            **found,
        )


def _rows(trace: Trace, diffusivity) -> dict[str, np.ndarray]:
    count = int(trace.count)
    columns = {"diffusivity": diffusivity, "cost": trace.cost, "gamma_1": trace.gamma_1, "gamma_2": trace.gamma_2}
    return {name: np.asarray(column)[:count] for name, column in columns.items()}


def gls_minima(
    told: InitialFit, eta: float, explicit_theta: bool, integrator: Integrator, start: float | None = None
) -> tuple[GLSFit, list[GLSFit]]:
    """The best minimum under the full covariance, and others that the record does not exclude.

    Looked for from the paper's estimate, from the prior where that is far away, and from wherever the cost of one of
    these is lower.
    """
    prior = told.case.wall.diffusivity_prior
    if told.fit is not None:
        start = float(np.asarray(told.fit.trace.parameters)[int(told.fit.trace.count) - 1, 0])
    first = prior if start is None else start
    starts = [first] if LOWEST * 1.001 < first < HIGHEST / 1.001 else []
    if not starts or abs(np.log(first / prior)) > np.log(_FAR):
        starts.append(prior)
    found: list[GLSFit] = []
    while starts and len(found) < _MOST_MINIMA:
        one = fit_generalised_least_squares(
            told.case, told.window, told.data, told.system, starts.pop(0),
            eta=eta, explicit_theta=explicit_theta, integrator=integrator,
        )  # fmt: skip
        found.append(one)
        if one.interval.deeper is not None:
            starts.append(prior * float(np.exp(one.interval.deeper)))
    found = sorted((one for one in found if np.isfinite(one.evidence)), key=lambda one: one.evidence) or found
    best = found[0]
    return best, [one for one in found[1:] if one.evidence - best.evidence < best.quantile**2]


def estimate_from_gls(told: InitialFit, settled: GLSFit, others: list[GLSFit], draws: int) -> Estimate:
    """Interval and verdict from the minimum under the full covariance."""
    case, names, best = told.case, settled.names, settled.minimum
    value, std_log = settled.diffusivity, settled.log_std
    apart = told.apart(value)
    shift = 0.0 if apart is None else settled.model_shift(apart)
    found = settled.interval
    low, high = (
        pick(getattr(one.interval, end) for one in (settled, *others)) for pick, end in ((min, "low"), (max, "high"))
    )
    kind = found.kind if (low, high) == (found.low, found.high) else "profile likelihood"
    ends = [
        float(np.exp(np.clip(np.sign(end) * np.hypot(end, settled.quantile * shift), -700.0, 700.0))) * value
        for end in (low - settled.log_alpha, high - settled.log_alpha)
    ]
    free, widths = np.asarray(best.parameters)[1:], np.sqrt(np.diag(settled.covariance))[1:]
    constants: dict[str, dict[str, tuple[float, float]]] = {"offsets": {}, "positions": {}, "face_positions": {}}
    for k, one in enumerate(instrument_errors_of(case, names)):
        constants[one.kind][one.name] = (float(one.std * free[k]), float(one.std * widths[k]))
    singular = np.linalg.svd(settled.jacobian, compute_uv=False) if settled.finite else np.array([np.nan])
    bounds = float(settled.problem.lowest), float(settled.problem.highest)
    reason = why_unreliable(case, value, (ends[0], ends[1]), singular, bool(best.converged), bounds)
    reason = reason or why_too_coarse(shift, std_log) or why_too_faint(case, settled)
    reason = reason or why_strained(case, settled) or why_unsteady(settled)
    covariance = settled.covariance.copy()
    covariance[0, 0] += shift**2
    return told.finished(
        value=value,
        std=value * float(np.hypot(std_log, shift)),
        interval_95=(ends[0], ends[1]),
        interval_kind=kind,
        **constants,
        result="converged" if bool(best.converged) else "stopped at the largest number of iterations",
        reliable=not reason,
        reason=reason,
        rounds=settled.rounds,
        history=told.history((best.trace,)),
        reduced_chi_square=settled.reduced_chi_square,
        noise=_noise_words(settled),
        shares=settled.shares() if not reason else {},
        predicted=np.asarray(best.predicted),
        residual=np.where(told.present, np.asarray(told.data.observed) - np.asarray(best.predicted), np.nan),
        covariance=covariance,
        singular_values=singular,
        model_shift=shift,
        identifiability=identifiability(case, settled) if settled.finite and names.count else None,
        structure=_structure(case, settled),
        bootstrap=bootstrap(settled, draws, case.choices.seed) if draws and not reason else None,
    )


def _structure(case: Case, settled: GLSFit) -> dict[str, Quantity]:
    """The wall's own parameters that were free: each layer's diffusivity, and films."""
    names, found = settled.names.structure, {}
    if not names or not settled.finite:
        return {}
    places = slice(1 + settled.names.of_structure.start, 1 + settled.names.of_structure.stop)
    z, spread = np.asarray(settled.minimum.parameters)[places], settled.covariance
    picked = [0, *range(places.start, places.stop)]
    spread = spread[np.ix_(picked, picked)]
    if any(name.startswith("layer") for name in names):
        ratios = layer_ratios(case, names, z)
        for i, ratio in enumerate(ratios):
            slope = [np.log(layer_ratios(case, names, z + step)[i] / ratio) for step in 1e-5 * np.eye(len(z))]
            along = np.array([1.0, *(np.array(slope) / 1e-5)])
            found[f"layer {i + 1}"] = lognormal(
                settled.diffusivity * float(ratio), float(along @ spread @ along), settled.quantile, "m2/s"
            )
    for side, length in zip(SIDES, film_at(case, names, z), strict=True):
        if (name := f"film_{side}") in names:
            place = 1 + names.index(name)
            variance = std_of(name) ** 2 * float(spread[place, place])
            found[name] = lognormal(length, variance, settled.quantile, "m")
    return found


def _noise_words(settled: GLSFit) -> str:
    if settled.robust is not None:
        return f"weighted as stated, the interval by {settled.robust}"
    return str(settled.noise) if settled.estimated else "noise as stated"


def initial_estimate(told: InitialFit) -> Estimate:
    """The paper's: plain weights, whose standard error takes noise and positions for white."""
    case, data, fit = told.case, told.data, told.fit
    assert fit is not None
    present, weight = told.present, np.asarray(data.weight)
    residual = np.asarray(data.observed) - np.asarray(fit.predicted)
    count = int(fit.trace.count)
    value = float(fit.trace.parameters[count - 1, 0])
    noise = simple_sigma(case, data, value)
    row_std = np.concatenate([(weight * noise).reshape(-1), np.ones(len(data.offsets))])
    singular, spread = covariance(np.asarray(fit.jacobian), row_std)
    beta = np.asarray(fit.parameters[1:])
    freedom = max(int(present.sum()) - 1, 1)
    chi_square = float(np.sum((residual / noise)[present] ** 2) + np.sum(beta**2)) / freedom
    spread = spread * max(1.0, chi_square)
    noise_std_log, shift = float(np.sqrt(spread[0, 0])), 0.0
    if (apart := told.apart(value)) is not None:
        rows = np.concatenate([(weight * apart).reshape(-1), np.zeros(len(data.offsets))])
        shift = float(np.linalg.lstsq(np.asarray(fit.jacobian), rows)[0][0])
    spread[0, 0] += shift**2
    std_log = float(np.sqrt(spread[0, 0]))
    half = min(NORMAL_95 * std_log, 700.0)  # exp(709) is the largest float
    interval = (value * float(np.exp(-half)), value * float(np.exp(half)))
    offset_std = np.asarray(data.offset_std)[list(data.offsets)]
    names = [case.sensors[s].name for s in data.offsets]
    reason = why_unreliable(case, value, interval, singular, bool(fit.converged))
    reason = reason or why_too_coarse(shift, noise_std_log)
    return told.finished(
        value=value,
        std=value * std_log,
        interval_95=interval,
        offsets={
            name: (float(std * beta), float(std * np.sqrt(variance)))
            for name, std, beta, variance in zip(names, offset_std, beta, np.diag(spread)[1:], strict=True)
        },
        result="converged" if bool(fit.converged) else "stopped at the largest number of iterations",
        reliable=not reason,
        reason=reason,
        history=told.history(),
        reduced_chi_square=chi_square,
        predicted=np.asarray(fit.predicted),
        residual=np.where(present, residual, np.nan),
        covariance=spread,
        singular_values=singular,
        model_shift=shift,
    )
