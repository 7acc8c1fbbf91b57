"""Extend: the model with chosen effects in, fitted again with everything that is free."""

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

_LONGEST_STEP = 1.5  # of ln(alpha), from where a fit starts
_AT_BOUND = 1e-6
_ENOUGH = 0.05  # of -2 log L
_MOST_STEPS = 20


@dataclass(frozen=True, eq=False)
class Fit:
    """A model fitted to the readings.

    Args:
        active: the effects that are in.
        theta: all parameters. cost: `-2 log L` up to what the noise alone sets, priors included.
        noise: by which it was fitted.
        jacobian: whitened, of the free parameters, priors' rows below, `(reading + free, free)`.
        residual: whitened, measured minus predicted, the priors' pull below.
        predicted: the inner readings at the rows, degC.
        trained: the same model found without some of the rows, made once.
    """

    study: DiagnosisProblem
    active: tuple[EffectParameters, ...]
    theta: np.ndarray
    cost: float
    converged: bool
    noise: Noise
    jacobian: np.ndarray = field(repr=False)
    residual: np.ndarray = field(repr=False)
    predicted: np.ndarray = field(repr=False)
    trained: dict[bytes, Fit] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def free(self) -> list[int]:
        """The parameters that were moved."""
        return self.study.free(self.active)

    @cached_property
    def covariance(self) -> np.ndarray:
        """Of the free parameters."""
        size = np.maximum(np.linalg.norm(self.jacobian, axis=0), 1e-300)
        inverse = np.linalg.pinv(self.jacobian / size, rcond=1e-10)
        return (inverse @ inverse.T) / np.outer(size, size)

    @property
    def diffusivity(self) -> float:
        """m2/s."""
        return float(np.exp(float(self.study.model.log_prior) + self.theta[0]))

    @property
    def log_std(self) -> float:
        """Standard deviation of ln(diffusivity)."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def interval_95(self) -> tuple[float, float]:
        """m2/s, symmetric in ln(diffusivity)."""
        width = np.exp(min(NORMAL_95 * self.log_std, 50.0))
        return self.diffusivity / width, self.diffusivity * width

    @property
    def events(self) -> list[tuple[float, float]]:
        """When what happens once begins and how long it lasts, s."""
        found = (slot.effect.at(slot.values(self.theta)).event for slot in self.active)
        return [event for event in found if event]

    def std(self, index: int) -> float:
        """Standard deviation of a free parameter."""
        place = self.free.index(index)
        return float(np.sqrt(self.covariance[place, place]))

    @property
    def at_bound(self) -> tuple[EffectParameters, ...]:
        """The effects of which a parameter ended at a bound."""
        low, high = self.study.limits
        return tuple(
            slot
            for slot in self.active
            if any(
                min(self.theta[i] - low[i], high[i] - self.theta[i]) <= _AT_BOUND * self.study.scale[i]
                for i in slot.indices
            )
        )

    @cached_property
    def residual_at_rows(self) -> np.ndarray:
        """Measured minus predicted at the rows, K; NaN where missing."""
        return self.study.record.sensors - self.predicted

    @property
    def prior_residual(self) -> np.ndarray:
        """Of the priors on the free parameters, in their standard deviations."""
        return self.residual[-len(self.free) :]

    def in_kelvin(self) -> tuple[np.ndarray, np.ndarray]:
        """Jacobian and residual of the binned readings, before whitening and without the priors' rows."""
        W = self.noise.whiten
        J, r = (scipy.linalg.solve_triangular(W, part[: len(W)], lower=True) for part in (self.jacobian, self.residual))
        return J, r

    @property
    def gap(self) -> float:
        """Root mean square of the remainder, K."""
        return float(np.sqrt(np.nanmean(self.residual_at_rows**2)))


def refit(
    study: DiagnosisProblem,
    active: tuple[EffectParameters, ...],
    theta: np.ndarray,
    noise: Noise,
    *,
    step: np.ndarray | None = None,
    used: np.ndarray | None = None,
) -> Fit:
    """Fit the model with these effects, from given parameters.

    Args:
        theta: where the search starts; parameters that are not free stay there.
        step: of the free parameters from there, such as the screen's linear prediction.
        used: the binned readings that count; None for all.
    """
    free = study.free(active)
    whiten = noise.whiten if used is None else whiten_part(noise, np.flatnonzero(used))
    begin = theta.copy()
    for error, slot in study.replaced(active):  # what the error had found is the effect's to explain
        begin[slot.first] += begin[error]
        begin[error] = 0.0
    ahead = begin.copy()
    if step is not None:
        ahead[free] += step
        ahead[0] = begin[0] + np.clip(step[0], -_LONGEST_STEP, _LONGEST_STEP)
    problem = _Problem(study, active, free, whiten)
    theta, at, converged = levenberg_marquardt(problem, ahead)
    if not at.is_finite:  # the prediction left the model's reach
        theta, at, converged = levenberg_marquardt(problem, begin)
    cost = float(at.residual @ at.residual) if at.is_finite else np.inf
    return Fit(study, active, theta, cost, converged, noise, at.jacobian, at.residual, at.predicted)


class _Linear(NamedTuple):
    """A problem at some parameters; see `Fit`."""

    residual: np.ndarray
    jacobian: np.ndarray
    predicted: np.ndarray

    @property
    def is_finite(self) -> bool:
        """Whether the model gave values there."""
        return bool(np.isfinite(self.residual).all() and np.isfinite(self.jacobian).all())


@dataclass(frozen=True, eq=False)
class _Problem:
    """`|W (measured - model(theta))|^2 + |theta / prior|^2` over the free parameters."""

    study: DiagnosisProblem
    active: tuple[EffectParameters, ...]
    free: list[int]
    whiten: np.ndarray

    def bounded(self, theta: np.ndarray) -> np.ndarray:
        """The parameters within their bounds."""
        return np.clip(theta, *self.study.limits)

    def at(self, theta: np.ndarray) -> _Linear:
        """The residual, measured minus model, and the model's Jacobian, priors' rows below."""
        study, free = self.study, self.free
        directions = np.zeros((max(study.most_free, len(free)), study.size))
        directions[np.arange(len(free)), free] = 1.0
        linear = study.is_linear(self.active)
        predicted, slope = linearise(study.model, study.bins, theta, directions, linear=linear)
        weight = 1.0 / study.prior_width[free]  # 0 where there is no prior
        return _Linear(
            np.concatenate([self.whiten @ study.binned(study.record.sensors - predicted), -weight * theta[free]]),
            np.concatenate([self.whiten @ slope[: len(free)].T, np.diag(weight)]),
            predicted,
        )


def levenberg_marquardt(problem: _Problem, theta: np.ndarray) -> tuple[np.ndarray, _Linear, bool]:
    """Least squares within bounds, damped by the Jacobian's own scales.

    Stepped from outside the compiled model: every set of effects then shares one compilation, and bounds hold
    exactly (optimistix, which the estimate runs through, ignores them). A parameter at a bound that the step
    would push beyond it stands still. It ends where a step promises less than `_ENOUGH` of the cost, or at once where
    the model gives no finite values.

    Returns:
        Parameters, the problem there, and whether it converged.

    Source: J. J. More, Lect. Notes Math. 630 (1978), 105.
    """
    free, damping = problem.free, 1e-6
    theta = problem.bounded(theta)
    here = problem.at(theta)
    if not here.is_finite:
        return theta, here, False
    low, high = (limit[free] for limit in problem.study.limits)
    for _ in range(_MOST_STEPS):
        residual, jacobian = here.residual, here.jacobian
        gradient = jacobian.T @ residual
        moving = ~(((theta[free] <= low) & (gradient < 0)) | ((theta[free] >= high) & (gradient > 0)))
        J = jacobian[:, moving]
        scale = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
        J = J / scale
        damped = np.concatenate([J, np.sqrt(damping) * np.eye(J.shape[1])])
        step = np.linalg.lstsq(damped, np.concatenate([residual, np.zeros(J.shape[1])]), rcond=None)[0]
        promised = float(residual @ residual - np.sum((residual - J @ step) ** 2))
        if promised < _ENOUGH:
            return theta, here, True
        trial = theta.copy()
        trial[np.array(free)[moving]] += step / scale
        trial = problem.bounded(trial)
        there = problem.at(trial)
        if there.is_finite and there.residual @ there.residual < residual @ residual:
            theta, here = trial, there
            damping = max(damping / 10.0, 1e-9)
        else:
            damping = max(10.0 * damping, 1e-3)
    return theta, here, False


def whiten_block(noise: Noise, chosen: np.ndarray) -> np.ndarray:
    """A W for some of the readings, given by their places."""
    lower = np.linalg.cholesky(noise.covariance[np.ix_(chosen, chosen)])
    return scipy.linalg.solve_triangular(lower, np.eye(len(chosen)), lower=True)


def whiten_part(noise: Noise, chosen: np.ndarray) -> np.ndarray:
    """The same among all readings: zero for the others. Kept, as every model is tried on the same days."""
    key = chosen.tobytes()
    if key not in noise.parts:
        part = np.zeros_like(noise.covariance)
        part[np.ix_(chosen, chosen)] = whiten_block(noise, chosen)
        noise.parts[key] = part
    return noise.parts[key]
