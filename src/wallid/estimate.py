"""The estimate: Gauss-Newton through optimistix, its covariance, and whether it can be relied on.

Minimised over `y = (ln(alpha/alpha_0), beta)`::

    J(y) = sum over readings ((T_model(alpha) + offset_std beta - T_measured) / sigma)^2 + |beta|^2

with an offset `offset_std beta` for each sensor whose case states an `offset_std`.
"""

from __future__ import annotations

import time as clock
from dataclasses import dataclass, field
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from ._fields import one_of
from .case import Case
from .experiment import (
    Experiment,
    HasBest,
    Profile,
    Window,
    as_window,
    check_driven,
    check_unbroken,
    experiment,
    fit_profile,
    large_model,
    scales,
    whole,
)
from .gauss_newton import GaussNewton, Trace
from .learning import learn
from .mim import Learned
from .sensitivity import explicit, field_with_theta, run
from .simulate import Integrator
from .statespace import StateSpace
from .wall import InputError

LOWEST, HIGHEST = 1e-10, 1e-2
"""Bounds of the search, m2/s: past any solid. An estimate at one is none."""

NORMAL_95 = 1.959963984540054  # 97.5 % quantile of the normal distribution
_NO_INFORMATION = 1e-9  # singular value over the largest: this direction is not in the record


class _Fit(eqx.Module):
    """What the compiled estimate gives back."""

    parameters: Float[Array, " param"]
    trace: Trace
    residual: Array
    predicted: Array
    jacobian: Array
    evaluations: Array
    converged: Array


@dataclass(frozen=True)
class Estimate:
    """A diffusivity with its interval, and how it was found.

    Arguments:
        value, std: m2/s. `std` is that of ln(alpha) times alpha, from the inner sensors' stated noise and
            offsets, and wider by the square root of the reduced chi-square where that is above 1. The
            faces' noise and position errors are not in it.
        interval_95: m2/s, symmetric in ln(alpha).
        offsets: per sensor with an `offset_std`: name -> (value, std), K.
        result: "converged", or what stopped the iteration.
        reliable: False where the record gives no number to rely on; `reason` says why.
        iterations: Gauss-Newton steps taken; `evaluations` counts halved tries too.
        history: per iterate: diffusivity, cost, gamma_1, gamma_2.
        reduced_chi_square: the cost over its degrees of freedom.
        predicted, residual: degC and K (measured minus predicted; NaN where missing),
            `(time, sensor)`, offsets included.
        covariance: of (ln alpha, offsets in units of their prior).
        singular_values: of the weighted sensitivity, largest first.
        model_shift: relative change of the estimate that a reduced model's error against the large
            model makes; 0 for the large model. It is counted in `std`.
        profile: the initial profile that the window starts from.
        model: what was fitted, in words.
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

    def __str__(self) -> str:
        low, high = self.interval_95
        lines = [
            f"diffusivity  {self.value:.4g} m2/s  +- {self.std:.1g}   (95 %: {low:.4g} to {high:.4g})",
            f"model        {self.model}; {self.result} after {self.iterations} Gauss-Newton steps",
            f"residual     {np.sqrt(np.nanmean(self.residual**2)):.3g} K root mean square, "
            f"reduced chi-square {self.reduced_chi_square:.2f}",
        ]
        if self.profile.eps_2 is not None:
            degree = len(self.profile.coefficients) - 1
            fit = f"eps_2 {self.profile.eps_2:.2g} K" if self.profile.eps_2 > 1e-9 else "through all its readings"
            lines.append(f"profile      initial polynomial of degree {degree}, {fit}")
        lines += [f"offset       {name} {value:+.3f} +- {std:.3f} K" for name, (value, std) in self.offsets.items()]
        if not self.reliable:
            lines.append(f"NOT TO BE RELIED ON: {self.reason}")
        return "\n".join(lines)


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
) -> Estimate:
    """The diffusivity of a case from one window of its record.

    Arguments:
        window: None for the whole record, or its longest unbroken part.
        model: None for the case's choice: the large model, or a reduced one learned for the window.
        start: m2/s; None for the case's prior.
        weights: each sensor by its `noise_std`, or the paper's plain sum of squares, whose covariance
            then counts what each sensor's noise does to it.
        sensitivity: the explicit theta system, or autodiff (with a free H_theta, the first).
        eta: the stopping criterion on the relative change of the diffusivity, and by its square the one
            on the cost's, not under 1e-14; None for the case's.

    Raises:
        InputError: a reduced model that does not know what a face of this window does.
            Or a start outside `LOWEST` to `HIGHEST`, or an unknown choice.
    """
    one_of("weights", weights, ("noise", "none"))
    one_of("sensitivity", sensitivity, ("explicit", "autodiff"))
    start = case.wall.diffusivity_prior if start is None else start
    if not LOWEST < start < HIGHEST:
        raise InputError(f"start = {start} m2/s; it must lie between {LOWEST} and {HIGHEST}")
    window = whole(case) if window is None else as_window(window)
    check_unbroken(case, window)
    if model is None:
        model = large_model(case) if case.choices.model == "lom" else learn(case, window, integrator=integrator)
    system = model.system if isinstance(model, Learned) else model
    check_driven(system, case, window)
    data = experiment(case, window, weighted=weights == "noise")
    eta = case.choices.eta if eta is None else eta
    per_alpha = jnp.asarray(scales(case).fourier(1.0))
    fit = fit_experiment(
        system,
        data,
        per_alpha,
        jnp.asarray(start),
        jnp.asarray(eta),
        explicit_theta=sensitivity == "explicit",
        integrator=integrator,
        max_iterations=case.choices.max_iterations,
    )
    reduced = isinstance(model, Learned) or system.order < case.choices.nodes - 2
    shift = float(_model_shift(large_model(case), system, data, per_alpha, fit)) if reduced else 0.0
    name = f"{'reduced' if reduced else 'large'} model of order {system.order}"
    return _conclude(case, window, data, fit, name, shift)


class _Problem(eqx.Module):
    """What the Gauss-Newton iteration minimises over `y = (ln(alpha/start), beta)`."""

    system: StateSpace
    data: Experiment
    fourier_per_alpha: Float[Array, ""]
    start: Float[Array, ""]
    explicit_theta: bool = eqx.field(static=True)
    integrator: Integrator = eqx.field(static=True)

    def predicted(self, y: Float[Array, " param"]) -> Float[Array, "time sensor"]:
        """Temperatures in degC, offsets included."""
        fourier = self.fourier_per_alpha * self.start * jnp.exp(y[0])
        initial, offset = self.data.initial, jnp.zeros_like(self.data.offset_std)
        if self.data.offsets:
            places = np.asarray(self.data.offsets)
            offset = offset.at[places].set(self.data.offset_std[places] * y[1:])
            # the profile was fitted through readings that hold the offsets
            initial = initial - self.data.profile_per_offset @ offset
        if self.explicit_theta:
            u = field_with_theta(fourier, initial, self.system, self.data, self.integrator)
        else:
            u = run(self.system, fourier, self.data.starting_from(initial), integrator=self.integrator)[0]
        return self.data.celsius(u) + offset

    def residual(self, y: Float[Array, " param"]) -> Float[Array, " reading"]:
        """The weighted misfit of every reading, then of every offset's prior."""
        misfit = self.data.weight * (self.predicted(y) - self.data.observed)
        return jnp.concatenate([misfit.reshape(-1), y[1:]])


@eqx.filter_jit
def fit_experiment(
    system: StateSpace,
    data: Experiment,
    fourier_per_alpha: Float[Array, ""],
    start: Float[Array, ""],
    eta: Float[Array, ""],
    *,
    explicit_theta: bool = True,
    integrator: Integrator = "propagator",
    max_iterations: int = 100,
) -> _Fit:
    """The compiled estimate: one compilation for all windows of a length, all starts, all values.

    Arguments:
        fourier_per_alpha: Fo for a diffusivity of 1 m2/s.
        start: m2/s.
        eta: the stopping criterion on the diffusivity; its square is that on the cost.
    """
    problem = _Problem(system, data, fourier_per_alpha, start, explicit_theta, integrator)
    solver = GaussNewton(
        # near the minimum gamma_1 goes with the square of gamma_2; under 1e-14 a sum of squares is round-off
        eta_1=jnp.maximum(eta**2, 1e-14),
        eta_2=eta,
        lower=jnp.log(LOWEST / start),
        upper=jnp.log(HIGHEST / start),
        longest_trace=max_iterations,
    )
    solution = optx.least_squares(
        lambda y, problem: problem.residual(y),
        solver,
        jnp.zeros(1 + len(data.offsets)),
        args=problem,
        max_steps=max_iterations + 1,
        throw=False,
    )
    y = solution.value
    trace = solution.stats["trace"]
    trace = eqx.tree_at(
        lambda t: t.parameters, trace, trace.parameters.at[:, 0].set(start * jnp.exp(trace.parameters[:, 0]))
    )
    predicted = problem.predicted(y)
    return _Fit(
        parameters=y,
        trace=trace,
        residual=data.observed - predicted,
        predicted=predicted,
        jacobian=jax.jacfwd(problem.residual)(y),
        evaluations=solution.stats["num_steps"],
        converged=solution.result == optx.RESULTS.successful,
    )


@eqx.filter_jit
def _model_shift(
    large: StateSpace, system: StateSpace, data: Experiment, fourier_per_alpha: Float[Array, ""], fit: _Fit
) -> Float[Array, ""]:
    """How far a reduced model's own error moves ln(alpha): `(J^T J)^-1 J^T W (T_large - T_reduced)`."""
    fourier = fourier_per_alpha * fit.trace.parameters[fit.trace.count - 1, 0]
    apart = run(large, fourier, data)[0] - run(system, fourier, data)[0]
    weighted = (data.weight * data.temperature * apart).reshape(-1)
    rows = jnp.concatenate([weighted, jnp.zeros(len(data.offsets))])
    return jnp.linalg.lstsq(fit.jacobian, rows)[0][0]


def _conclude(case: Case, window: Window, data: Experiment, fit: _Fit, model: str, shift: float) -> Estimate:
    """Covariance, interval and verdict from what the compiled estimate gave."""
    weight, residual = np.asarray(data.weight), np.asarray(fit.residual)
    present = weight > 0
    noise = np.array([sensor.noise_std for sensor in case.sensors])
    row_std = np.concatenate([(weight * noise).reshape(-1), np.ones(len(data.offsets))])
    singular, covariance = _covariance(np.asarray(fit.jacobian), row_std)
    count = int(fit.trace.count)
    beta = np.asarray(fit.parameters[1:])
    freedom = int(present.sum()) - 1
    chi_square = float(np.sum((residual / noise)[present] ** 2) + np.sum(beta**2)) / max(freedom, 1)
    covariance = covariance * max(1.0, chi_square)
    noise_std_log = float(np.sqrt(covariance[0, 0]))
    covariance[0, 0] += shift**2
    value = float(fit.trace.parameters[count - 1, 0])
    std_log = float(np.sqrt(covariance[0, 0]))
    half = min(NORMAL_95 * std_log, 700.0)  # exp(709) is the largest float
    interval = (value * float(np.exp(-half)), value * float(np.exp(half)))
    offset_std = np.asarray(data.offset_std)[list(data.offsets)]
    names = [case.sensors[s].name for s in data.offsets]
    offsets = {
        name: (float(std * beta), float(std * np.sqrt(variance)))
        for name, std, beta, variance in zip(names, offset_std, beta, np.diag(covariance)[1:], strict=True)
    }
    reason = _why_unreliable(case, value, interval, singular, bool(fit.converged))
    if not reason and abs(shift) > noise_std_log:
        reason = (
            f"the reduced model's own error moves the estimate by {shift:+.1%}, more than the noise does; take a "
            'higher order, learning_diffusivities around the estimate, or model = "lom"'
        )
    history = {"diffusivity": fit.trace.parameters[:count, 0], "cost": fit.trace.cost[:count]}
    history |= {"gamma_1": fit.trace.gamma_1[:count], "gamma_2": fit.trace.gamma_2[:count]}
    return Estimate(
        value=value,
        std=value * std_log,
        interval_95=interval,
        offsets=offsets,
        result="converged" if bool(fit.converged) else "stopped at the largest number of iterations",
        reliable=not reason,
        reason=reason,
        iterations=count - 1,
        evaluations=int(fit.evaluations),
        history={name: np.asarray(rows) for name, rows in history.items()},
        reduced_chi_square=chi_square,
        predicted=np.asarray(fit.predicted),
        residual=np.where(present, residual, np.nan),
        covariance=covariance,
        singular_values=singular,
        model_shift=shift,
        profile=fit_profile(case, window.row),
        model=model,
        window=window,
    )


def _covariance(jacobian: np.ndarray, row_std: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Singular values of J, and `J^+ diag(row_std^2) J^+T` (infinite where a direction is missing).

    With each row weighted by its own noise that is `(J^T J)^-1`.
    """
    parameters = jacobian.shape[1]
    if not np.all(np.isfinite(jacobian)):
        return np.full(parameters, np.nan), np.full((parameters, parameters), np.inf)
    U, singular, V = np.linalg.svd(jacobian, full_matrices=False)
    if singular[-1] <= _NO_INFORMATION * max(singular[0], 1.0):
        return singular, np.full((parameters, parameters), np.inf)
    spread = (V.T / singular) @ U.T * row_std
    return singular, spread @ spread.T


def _why_unreliable(
    case: Case, value: float, interval: tuple[float, float], singular: np.ndarray, converged: bool
) -> str:
    """Why the estimate is no number to rely on, or an empty string."""
    if not np.isfinite(value) or not np.all(np.isfinite(singular)):
        return "the model gave values that are not finite"
    if value <= LOWEST * 1.001 or value >= HIGHEST / 1.001:
        return f"the estimate ran to the bound of its search, {value:.3g} m2/s: the record does not hold it"
    factor = interval[1] / interval[0]
    if factor > case.choices.largest_interval_factor:
        return (
            f"its 95 % interval spans a factor of {factor:.3g}, more than {case.choices.largest_interval_factor:g}: "
            "the temperatures vary too little for their noise"
        )
    if not converged:
        return "the iteration did not converge"
    return ""


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


def paper_sigma(
    noise_std: np.ndarray, gradient: np.ndarray, position_std: np.ndarray
) -> Float[np.ndarray, "time sensor"]:
    """The paper's combined uncertainty, `sqrt(sigma_m^2 + (dT/dx delta_x)^2)`, K.

    A position error is the same all the time: this is for the paper's figure, and no weight.

    Arguments:
        noise_std: sigma_m per sensor, K.
        gradient: dT/dx at the sensors, K/m, `(time, sensor)`.
        position_std: delta_x per sensor, m.
    """
    return np.sqrt(noise_std**2 + (gradient * position_std) ** 2)


def theta_kelvin(system: StateSpace, case: Case, window: Window, diffusivity: float) -> np.ndarray:
    """`dT/d(ln alpha)` at the sensors over a window, K, `(time, sensor)`."""
    fourier = scales(case).fourier(diffusivity)
    _, theta = explicit(system, fourier, experiment(case, window))
    return np.asarray(theta) * fourier * scales(case).temperature
