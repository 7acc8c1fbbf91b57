"""The fit of the model with chosen effects: least squares for the effects and the nuisance parameters."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from ..inference.noise_covariance import Noise
from ..inference.quantity import NORMAL_95
from .model_with_effects import linearise
from .problem import DiagnosisProblem, EffectParameters

_MAX_INITIAL_STEP = 1.5  # of ln(alpha)
_BOUND_TOLERANCE = 1e-6  # distance from a bound over the scale of the parameter
_COST_TOLERANCE = 0.05  # predicted drop of -2 log L at which the fit has converged
_MAX_STEPS = 20


@dataclass(frozen=True, eq=False)
class EffectFit:
    """A model fitted to the readings.

    Args:
        problem: the case prepared for the search.
        active: the effects in the model.
        theta: all parameters, `(param,)`.
        cost: `-2 log L` without the normalisation by the noise, with the priors.
        converged: whether the optimizer converged.
        noise: the noise covariance of the fit.
        jacobian: whitened, of the estimated parameters, with the rows of the priors below,
            `(reading + estimated, estimated)`.
        residual: whitened, measured minus predicted, with the prior residuals below, `(reading + estimated,)`.
        predicted: the inner readings, degC, `(time, sensor)`.
        training_fits: fits of the same model to a part of the rows, by the rows held out.
    """

    problem: DiagnosisProblem
    active: tuple[EffectParameters, ...]
    theta: np.ndarray
    cost: float
    converged: bool
    noise: Noise
    jacobian: np.ndarray = field(repr=False)
    residual: np.ndarray = field(repr=False)
    predicted: np.ndarray = field(repr=False)
    training_fits: dict[bytes, EffectFit] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def estimated_indices(self) -> list[int]:
        """Indices of the estimated parameters."""
        return self.problem.estimated_indices(self.active)

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance of the estimated parameters, `(estimated, estimated)`."""
        size = np.maximum(np.linalg.norm(self.jacobian, axis=0), 1e-300)
        inverse = np.linalg.pinv(self.jacobian / size, rcond=1e-10)
        return (inverse @ inverse.T) / np.outer(size, size)

    @property
    def diffusivity(self) -> float:
        """Diffusivity alpha, m2/s."""
        return float(np.exp(float(self.problem.model.log_prior) + self.theta[0]))

    @property
    def log_std(self) -> float:
        """Standard deviation of ln(alpha)."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def interval_95(self) -> tuple[float, float]:
        """95 % interval of the diffusivity, m2/s, symmetric in ln(alpha)."""
        width = np.exp(min(NORMAL_95 * self.log_std, 50.0))
        return self.diffusivity / width, self.diffusivity * width

    @property
    def events(self) -> list[tuple[float, float]]:
        """Start and duration of each single event (rain), s."""
        events = (
            effect_parameters.effect.at(effect_parameters.values(self.theta)).event for effect_parameters in self.active
        )
        return [event for event in events if event]

    def std(self, index: int) -> float:
        """Standard deviation of an estimated parameter, by its index."""
        k = self.estimated_indices.index(index)
        return float(np.sqrt(self.covariance[k, k]))

    @property
    def at_bound(self) -> tuple[EffectParameters, ...]:
        """The effects with a parameter at a bound of its search range."""
        low, high = self.problem.bounds
        distance = np.minimum(self.theta - low, high - self.theta)
        at_bound = distance <= _BOUND_TOLERANCE * self.problem.scale
        return tuple(effect for effect in self.active if at_bound[list(effect.indices)].any())

    @cached_property
    def residual_at_rows(self) -> np.ndarray:
        """Measured minus predicted readings, K, `(time, sensor)`; NaN where a reading is missing."""
        return self.problem.record.sensors - self.predicted

    @property
    def prior_residual(self) -> np.ndarray:
        """Prior residuals of the estimated parameters, in prior standard deviations."""
        return self.residual[-len(self.estimated_indices) :]

    def unwhitened(self) -> tuple[np.ndarray, np.ndarray]:
        """Jacobian (K per unit) and residual (K) of the binned readings, before whitening and without the priors."""
        W = self.noise.whiten
        J, r = (scipy.linalg.solve_triangular(W, part[: len(W)], lower=True) for part in (self.jacobian, self.residual))
        return J, r

    @property
    def gap(self) -> float:
        """Root mean square of the residual, K."""
        return float(np.sqrt(np.nanmean(self.residual_at_rows**2)))


def refit(
    problem: DiagnosisProblem,
    active: tuple[EffectParameters, ...],
    theta: np.ndarray,
    noise: Noise,
    *,
    step: np.ndarray | None = None,
    used: np.ndarray | None = None,
) -> EffectFit:
    """Fit the model with these effects, starting from given parameters.

    Args:
        problem: the case prepared for the search.
        active: the effects in the model.
        theta: initial parameters, `(param,)`; those that are not estimated keep their values.
        noise: the noise covariance.
        step: first step of the estimated parameters, such as the linear prediction; None for none.
        used: mask of the binned readings to fit; None for all.
    """
    estimated = problem.estimated_indices(active)
    whiten = noise.whiten if used is None else whitening_of_subset(noise, np.flatnonzero(used))
    initial = theta.copy()
    for error, effect_parameters in problem.errors_replaced_by_effects(active):
        # the effect takes over the value of the error
        initial[effect_parameters.size_index] += initial[error]
        initial[error] = 0.0
    ahead = initial.copy()
    if step is not None:
        ahead[estimated] += step
        ahead[0] = initial[0] + np.clip(step[0], -_MAX_INITIAL_STEP, _MAX_INITIAL_STEP)
    least_squares = _LeastSquares(problem, active, estimated, whiten)
    theta, at, converged = levenberg_marquardt(least_squares, ahead)
    if not at.is_finite:  # the model is not finite at the first step
        theta, at, converged = levenberg_marquardt(least_squares, initial)
    cost = float(at.residual @ at.residual) if at.is_finite else np.inf
    return EffectFit(problem, active, theta, cost, converged, noise, at.jacobian, at.residual, at.predicted)


class _Linearisation(NamedTuple):
    """Residual, Jacobian and prediction at some parameters; see `EffectFit`."""

    residual: np.ndarray
    jacobian: np.ndarray
    predicted: np.ndarray

    @property
    def is_finite(self) -> bool:
        """Whether the model is finite at these parameters."""
        return bool(np.isfinite(self.residual).all() and np.isfinite(self.jacobian).all())


@dataclass(frozen=True, eq=False)
class _LeastSquares:
    """Minimise `|W (measured - model(theta))|^2 + |theta / prior_std|^2` over the estimated parameters."""

    problem: DiagnosisProblem
    active: tuple[EffectParameters, ...]
    estimated: list[int]
    whiten: np.ndarray

    def bounded(self, theta: np.ndarray) -> np.ndarray:
        """The parameters clipped to their bounds."""
        return np.clip(theta, *self.problem.bounds)

    def at(self, theta: np.ndarray) -> _Linearisation:
        """The residual, measured minus model, and the Jacobian of the model, with the rows of the priors below."""
        problem, estimated = self.problem, self.estimated
        directions = np.zeros((max(problem.max_estimated, len(estimated)), problem.parameter_count))
        directions[np.arange(len(estimated)), estimated] = 1.0
        linear = problem.is_linear(self.active)
        predicted, slope = linearise(problem.model, problem.bins, theta, directions, linear=linear)
        weight = 1.0 / problem.prior_std[estimated]  # 0 where there is no prior
        return _Linearisation(
            np.concatenate(
                [self.whiten @ problem.binned(problem.record.sensors - predicted), -weight * theta[estimated]]
            ),
            np.concatenate([self.whiten @ slope[: len(estimated)].T, np.diag(weight)]),
            predicted,
        )


def levenberg_marquardt(least_squares: _LeastSquares, theta: np.ndarray) -> tuple[np.ndarray, _Linearisation, bool]:
    """Bounded least squares by the Levenberg-Marquardt method, scaled by the column norms of the Jacobian.

    The loop is outside the compiled model, so that all sets of effects share one compilation. It holds bounds
    exactly, which optimistix does not: a parameter at a bound stays there while the gradient points outwards.
    It converges where the predicted drop of the cost is below `_COST_TOLERANCE`, and stops at once where the model
    is not finite.

    Returns:
        Parameters, residual and Jacobian there, and whether it converged.

    Source: J. J. More, Lect. Notes Math. 630 (1978), 105.
    """
    estimated, damping = least_squares.estimated, 1e-6
    theta = least_squares.bounded(theta)
    current = least_squares.at(theta)
    if not current.is_finite:
        return theta, current, False
    low, high = (limit[estimated] for limit in least_squares.problem.bounds)
    for _ in range(_MAX_STEPS):
        residual, jacobian = current.residual, current.jacobian
        gradient = jacobian.T @ residual
        moving = ~(((theta[estimated] <= low) & (gradient < 0)) | ((theta[estimated] >= high) & (gradient > 0)))
        J = jacobian[:, moving]
        scale = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
        J = J / scale
        damped = np.concatenate([J, np.sqrt(damping) * np.eye(J.shape[1])])
        step = np.linalg.lstsq(damped, np.concatenate([residual, np.zeros(J.shape[1])]), rcond=None)[0]
        predicted_drop = float(residual @ residual - np.sum((residual - J @ step) ** 2))
        if predicted_drop < _COST_TOLERANCE:
            return theta, current, True
        trial = theta.copy()
        trial[np.array(estimated)[moving]] += step / scale
        trial = least_squares.bounded(trial)
        new = least_squares.at(trial)
        if new.is_finite and new.residual @ new.residual < residual @ residual:
            theta, current = trial, new
            damping = max(damping / 10.0, 1e-9)
        else:
            damping = max(10.0 * damping, 1e-3)
    return theta, current, False


def whitening_block(noise: Noise, chosen: np.ndarray) -> np.ndarray:
    """The whitening matrix for some of the readings, by their indices."""
    lower = np.linalg.cholesky(noise.covariance[np.ix_(chosen, chosen)])
    return scipy.linalg.solve_triangular(lower, np.eye(len(chosen)), lower=True)


def whitening_of_subset(noise: Noise, chosen: np.ndarray) -> np.ndarray:
    """The same with zero rows and columns for the other readings; cached, as all fits share the days held out."""
    key = chosen.tobytes()
    if key not in noise.parts:
        part = np.zeros_like(noise.covariance)
        part[np.ix_(chosen, chosen)] = whitening_block(noise, chosen)
        noise.parts[key] = part
    return noise.parts[key]
