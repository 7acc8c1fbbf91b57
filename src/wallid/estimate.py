"""The estimate: Gauss-Newton through optimistix, its interval, and whether it can be relied on.

First the paper's iteration, each reading by itself (`least_squares`); from there the likelihood under the full
covariance (`interval`): the sensors' noise and the faces', which goes through the wall, as white noise and as noise
that remembers, with offsets, position errors and the initial profile free within their priors.
"""

from __future__ import annotations

import time as clock
from dataclasses import dataclass, field, replace
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np

from ._fields import one_of
from .bootstrap import Bootstrap, bootstrap
from .case import Case
from .experiment import (
    Experiment,
    HasBest,
    Profile,
    Window,
    as_window,
    check_driven,
    experiment,
    fit_profile,
    large_model,
    scales,
)
from .free import fluxes_of, whole_model, with_flux
from .interval import NORMAL_95, Settled, settle
from .learning import learn
from .least_squares import Fit, apart, covariance, fit_experiment, paper_sigma, simple_sigma
from .likelihood import HIGHEST, LOWEST
from .mim import Learned
from .sensitivity import explicit
from .simulate import Integrator
from .statespace import StateSpace
from .thermal import Thermal, thermal
from .wall import InputError

__all__ = ["Estimate", "estimate", "fit_experiment", "paper_sigma", "seconds_of_estimate", "theta_kelvin"]

_FAR = 3.0  # from the prior: the prior is tried as a start as well
_MOST_MINIMA = 4
_FEWEST_DRAWS = 20  # of a bootstrap that is to give a 95 % interval


@dataclass(frozen=True)
class Estimate:
    """A diffusivity with its interval, and how it was found.

    Arguments:
        value, std: m2/s. `std` is that of ln(alpha) times alpha: from the noise of sensors and faces, and from
            offsets, position errors and the initial profile within their priors. With `weights="none"` from
            the paper's simple sigma, and wider by the square root of the reduced chi-square where that is above 1.
        interval_95: m2/s; `interval_kind` is "normal" (symmetric in ln(alpha)), or "profile likelihood" where the
            cost is no parabola.
        offsets: per sensor with an `offset_std`: name -> (value, std), K. `positions`: per sensor with a
            `position_std`: name -> (true place minus stated, std), m.
        result: "converged", or what stopped the iteration.
        reliable: False where the record gives no number to rely on; `reason` says why.
        iterations: Gauss-Newton steps of the paper's iteration; `evaluations` counts halved tries too. `rounds`: of
            Gauss-Newton again, under the covariance found.
        history: per iterate: diffusivity, cost, gamma_1, gamma_2; of the paper's iteration, then of the rounds.
        reduced_chi_square: the cost under the noise as stated, over its degrees of freedom.
        noise: what the record says of the noise, in words; `shares`: what each kind of error makes of the
            variance, 1.
        predicted, residual: degC and K (measured minus predicted; NaN where missing),
            `(time, sensor)`, all that is free included.
        covariance: of (ln alpha, offsets, positions, profile), those in units of their prior.
        singular_values: of the weighted sensitivity, largest first.
        model_shift: relative change of the estimate that a reduced model's error against the large
            model makes; 0 for the large model. It is counted in `std`.
        profile: the initial profile that the window starts from.
        model: what was fitted, in words.
        bootstrap: a check of `std` and interval by drawn readings; None where none was asked for.
        thermal: what heat fluxes told; None without any. `predicted` and `residual` then hold the plates' columns
            after the sensors', W/m2, and there is no paper's iteration: `iterations` are of the rounds.
    """

    value: float
    std: float
    interval_95: tuple[float, float]
    offsets: dict[str, tuple[float, float]]
    result: str
    reliable: bool
    reason: str
    iterations: int
    evaluations: int
    history: dict[str, np.ndarray] = field(repr=False)
    reduced_chi_square: float
    predicted: np.ndarray = field(repr=False)
    residual: np.ndarray = field(repr=False)
    covariance: np.ndarray = field(repr=False)
    singular_values: np.ndarray = field(repr=False)
    model_shift: float
    profile: Profile
    model: str
    window: Window
    positions: dict[str, tuple[float, float]] = field(default_factory=dict)
    interval_kind: Literal["normal", "profile likelihood"] = "normal"
    rounds: int = 0
    noise: str = "the paper's simple sigma"
    shares: dict[str, float] = field(default_factory=dict)
    bootstrap: Bootstrap | None = None
    thermal: Thermal | None = None

    def __str__(self) -> str:
        low, high = self.interval_95
        by = "" if self.interval_kind == "normal" else f", by the {self.interval_kind}"
        found = f"{self.value:.4g} m2/s  +- {self.std:.1g}   (95 %: {low:.4g} to {high:.4g}{by})"
        lines = [f"diffusivity  {found}"]
        if not self.reliable:
            lines = [f"diffusivity  NOT TO BE RELIED ON: {self.reason}", f"             the search ended at {found}"]
        rounds = f", {self.rounds} rounds under the full covariance" if self.rounds else ""
        lines += [
            f"model        {self.model}; {self.result} after {self.iterations} Gauss-Newton steps{rounds}",
            f"residual     {self._left()} root mean square, "
            f"reduced chi-square {self.reduced_chi_square:.2f}; {self.noise}",
        ]
        if self.thermal is not None:
            lines.append(str(self.thermal))
        if self.shares:
            lines.append("variance     " + ", ".join(f"{name} {share:.0%}" for name, share in self.shares.items()))
        if self.bootstrap is not None:
            lines.append(str(self.bootstrap))
        if self.profile.eps_2 is not None:
            degree = len(self.profile.coefficients) - 1
            fit = f"eps_2 {self.profile.eps_2:.2g} K" if self.profile.eps_2 > 1e-9 else "through all its readings"
            lines.append(f"profile      initial polynomial of degree {degree}, {fit}")
        lines += [f"offset       {name} {value:+.3f} +- {std:.3f} K" for name, (value, std) in self.offsets.items()]
        lines += [
            f"position     {name} {1e3 * value:+.1f} +- {1e3 * std:.1f} mm"
            for name, (value, std) in self.positions.items()
        ]
        return "\n".join(lines)

    @property
    def sensors(self) -> int:
        """How many columns of `residual` are temperatures."""
        return self.residual.shape[1] - (0 if self.thermal is None else len(self.thermal.gains))

    def _left(self) -> str:
        """The residual's size."""
        parts = (self.residual[:, : self.sensors], "K"), (self.residual[:, self.sensors :], "W/m2")
        return " and ".join(f"{np.sqrt(np.nanmean(part**2)):.3g} {unit}" for part, unit in parts if part.size)


def estimate(
    case: Case,
    window: Window | HasBest | None = None,
    model: StateSpace | Learned | None = None,
    *,
    start: float | None = None,
    weights: Literal["noise", "none"] = "noise",
    sensitivity: Literal["explicit", "autodiff"] = "explicit",
    integrator: Integrator = "propagator",
    eta: float | None = None,
    draws: int = 0,
) -> Estimate:
    """The diffusivity of a case from one window of its record.

    Arguments:
        window: None for the whole record.
        model: None for the case's choice: the large model, or a reduced one learned for the window.
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
    window = Window(0, case.record.rows) if window is None else as_window(window)
    plates = fluxes_of(case)
    if plates and weights == "noise":
        return _with_fluxes(case, window, start, eta, sensitivity == "explicit", integrator, draws)
    if model is None:
        model = large_model(case) if case.choices.model == "lom" else learn(case, window, integrator=integrator)
    system = model.system if isinstance(model, Learned) else model
    check_driven(system, case, window)
    data = experiment(case, window, weighted=weights == "noise")
    eta = case.choices.eta if eta is None else eta
    fit = fit_experiment(
        system,
        data,
        jnp.asarray(scales(case).fourier(1.0)),
        jnp.asarray(start),
        jnp.asarray(eta),
        explicit_theta=sensitivity == "explicit",
        integrator=integrator,
        max_iterations=case.choices.max_iterations,
    )
    reduced = isinstance(model, Learned) or system.order < case.choices.nodes - 2
    words = f"{'reduced' if reduced else 'large'} model of order {system.order}"
    told = _Told(case, window, data, system, fit, reduced, words)
    if weights == "none":
        return _simple(told)
    settled, others = _settled(told, eta, sensitivity == "explicit", integrator)
    return _conclude(told, settled, others, draws)


def _with_fluxes(
    case: Case,
    window: Window,
    start: float,
    eta: float | None,
    explicit_theta: bool,
    integrator: Integrator,
    draws: int,
) -> Estimate:
    """The estimate of a case with heat flux, by the large model: a reduced one does not learn a face's flux."""
    data, system = experiment(case, window), whole_model(case)
    words = f"large model of order {system.order}, with the flux of the {' and the '.join(fluxes_of(case))} face"
    told = _Told(case, window, with_flux(case, window, data), system, None, False, words)
    eta = case.choices.eta if eta is None else eta
    settled, others = _settled(told, eta, explicit_theta, integrator, start)
    fit = _conclude(told, settled, others, draws)
    return replace(fit, thermal=thermal(case, window, settled))


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


@dataclass(frozen=True, eq=False)
class _Told:
    """What the paper's iteration gave, and what it was given."""

    case: Case
    window: Window
    data: Experiment
    system: StateSpace
    fit: Fit | None
    reduced: bool
    words: str

    @property
    def present(self) -> np.ndarray:
        """Where there is a reading."""
        return np.asarray(self.data.weight) > 0

    def apart(self, diffusivity: float) -> np.ndarray | None:
        """The large model's predictions less the reduced one's, K; None for the large one."""
        if not self.reduced or not np.isfinite(diffusivity):
            return None
        fourier = jnp.asarray(scales(self.case).fourier(diffusivity))
        return np.asarray(apart(large_model(self.case), self.system, self.data, fourier))

    def history(self, traces=()) -> dict[str, np.ndarray]:
        """The iterates, those of later rounds appended."""
        start = self.case.wall.diffusivity_prior
        rows = [] if self.fit is None else [_rows(self.fit.trace, self.fit.trace.parameters[:, 0])]
        rows += [_rows(trace, start * np.exp(trace.parameters[:, 0])) for trace in traces]
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


def _rows(trace, diffusivity) -> dict[str, np.ndarray]:
    count = int(trace.count)
    columns = {"diffusivity": diffusivity, "cost": trace.cost, "gamma_1": trace.gamma_1, "gamma_2": trace.gamma_2}
    return {name: np.asarray(column)[:count] for name, column in columns.items()}


def _settled(
    told: _Told, eta: float, explicit_theta: bool, integrator: Integrator, start: float | None = None
) -> tuple[Settled, list[Settled]]:
    """The best minimum under the full covariance, and others that the record does not exclude.

    Looked for from the paper's estimate, from the prior where that is far away, and from wherever the cost of one of
    these is lower.
    """
    prior = told.case.wall.diffusivity_prior
    if told.fit is not None:
        start = float(told.fit.trace.parameters[int(told.fit.trace.count) - 1, 0])
    first = prior if start is None else start
    starts = [first] if LOWEST * 1.001 < first < HIGHEST / 1.001 else []
    if not starts or abs(np.log(first / prior)) > np.log(_FAR):
        starts.append(prior)
    found: list[Settled] = []
    while starts and len(found) < _MOST_MINIMA:
        one = settle(
            told.case, told.window, told.data, told.system, starts.pop(0),
            eta=eta, explicit_theta=explicit_theta, integrator=integrator,
        )  # fmt: skip
        found.append(one)
        if one.interval.deeper is not None:
            starts.append(prior * float(np.exp(one.interval.deeper)))
    found = sorted((one for one in found if np.isfinite(one.evidence)), key=lambda one: one.evidence) or found
    best = found[0]
    return best, [one for one in found[1:] if one.evidence - best.evidence < best.quantile**2]


def _conclude(told: _Told, settled: Settled, others: list[Settled], draws: int) -> Estimate:
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
    offsets, positions = {}, {}
    for k, s in enumerate((*names.offsets, *names.positions)):
        sensor, is_offset = case.sensors[s], k < len(names.offsets)
        std = sensor.offset_std if is_offset else sensor.position_std
        (offsets if is_offset else positions)[sensor.name] = (float(std * free[k]), float(std * widths[k]))
    singular = np.linalg.svd(settled.jacobian, compute_uv=False) if _finite(settled) else np.array([np.nan])
    bounds = float(settled.problem.lowest), float(settled.problem.highest)
    reason = _why_unreliable(case, value, (ends[0], ends[1]), singular, bool(best.converged), bounds)
    reason = reason or _why_too_coarse(shift, std_log)
    covariance = settled.covariance.copy()
    covariance[0, 0] += shift**2
    return told.finished(
        value=value,
        std=value * float(np.hypot(std_log, shift)),
        interval_95=(ends[0], ends[1]),
        interval_kind=kind,
        offsets=offsets,
        positions=positions,
        result="converged" if bool(best.converged) else "stopped at the largest number of iterations",
        reliable=not reason,
        reason=reason,
        rounds=settled.rounds,
        history=told.history([best.trace]),
        reduced_chi_square=settled.reduced_chi_square,
        noise=_noise_words(settled),
        shares=settled.shares() if not reason else {},
        predicted=np.asarray(best.predicted),
        residual=np.where(told.present, np.asarray(told.data.observed - best.predicted), np.nan),
        covariance=covariance,
        singular_values=singular,
        model_shift=shift,
        bootstrap=bootstrap(settled, draws, case.choices.seed) if draws and not reason else None,
    )


def _noise_words(settled: Settled) -> str:
    if settled.robust is not None:
        return f"weighted as stated, the interval by {settled.robust}"
    return str(settled.noise) if settled.estimated else "noise as stated"


def _finite(settled: Settled) -> bool:
    return bool(np.all(np.isfinite(settled.jacobian)))


def _simple(told: _Told) -> Estimate:
    """The paper's: plain weights, whose standard error takes noise and positions for white."""
    case, data, fit = told.case, told.data, told.fit
    present, weight, residual = told.present, np.asarray(data.weight), np.asarray(fit.residual)
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
    reason = _why_unreliable(case, value, interval, singular, bool(fit.converged))
    reason = reason or _why_too_coarse(shift, noise_std_log)
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


def _why_unreliable(
    case: Case,
    value: float,
    interval: tuple[float, float],
    singular: np.ndarray,
    converged: bool,
    bounds: tuple[float, float] = (LOWEST, HIGHEST),
) -> str:
    """Why the estimate is no number to rely on, or an empty string."""
    if not np.isfinite(value) or not np.all(np.isfinite(singular)):
        return "the model gave values that are not finite"
    if not bounds[0] * 1.001 < value < bounds[1] / 1.001:
        return f"the estimate ran to the bound of its search, {value:.3g} m2/s: the record does not hold it"
    if interval[0] <= bounds[0] * 1.001 or interval[1] >= bounds[1] / 1.001:
        return (
            f"its 95 % interval, {interval[0]:.3g} to {interval[1]:.3g} m2/s, reaches the bound of what this window "
            "can tell: the temperatures vary too little for their noise"
        )
    factor = interval[1] / interval[0]
    if factor > case.choices.largest_interval_factor:
        return (
            f"its 95 % interval spans a factor of {factor:.3g}, more than {case.choices.largest_interval_factor:g}: "
            "the temperatures vary too little for their noise"
        )
    if not converged:
        return "the iteration did not converge"
    return ""


def _why_too_coarse(shift: float, noise_std_log: float) -> str:
    """Why a reduced model cannot be relied on here, or an empty string."""
    if abs(shift) <= noise_std_log:
        return ""
    return (
        f"the reduced model's own error moves the estimate by {shift:+.1%}, more than the noise does; take a "
        'higher order, learning_diffusivities around the estimate, or model = "lom"'
    )


def seconds_of_estimate(case: Case, window: Window, model: StateSpace) -> float:
    """What one warm estimate costs: the median of three, compilation apart."""
    data, per_alpha = experiment(case, window), jnp.asarray(scales(case).fourier(1.0))
    start, eta = jnp.asarray(case.wall.diffusivity_prior), jnp.asarray(case.choices.eta)
    taken = []
    for _ in range(4):
        began = clock.perf_counter()
        jax.block_until_ready(fit_experiment(model, data, per_alpha, start, eta))
        taken.append(clock.perf_counter() - began)
    return float(np.median(taken[1:]))


def theta_kelvin(system: StateSpace, case: Case, window: Window, diffusivity: float) -> np.ndarray:
    """`dT/d(ln alpha)` at the sensors over a window, K, `(time, sensor)`."""
    fourier = scales(case).fourier(diffusivity)
    _, theta = explicit(system, fourier, experiment(case, window))
    return np.asarray(theta) * fourier * scales(case).temperature
