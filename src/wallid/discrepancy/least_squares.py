"""Bounded least squares for the parameters of the model with chosen effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Array

from ..inference.parameters import Parameters
from .model_with_effects import linearise
from .problem import DiagnosisProblem, EffectParameters

_COST_TOLERANCE = 2.5e-3  # predicted drop of -2 log L at which the fit has converged: 0.05 standard errors
_MAX_STEPS = 40


class Linearisation(NamedTuple):
    """Residual, Jacobian and prediction at some parameters; see `effect_fit.EffectFit`."""

    residual: np.ndarray
    jacobian: np.ndarray
    predicted: np.ndarray

    @property
    def is_finite(self) -> bool:
        """Whether the model is finite at these parameters."""
        return bool(np.isfinite(self.residual).all() and np.isfinite(self.jacobian).all())


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """Minimise `|W (measured - model(x))|^2 + |x / prior_std|^2` over the vector x of the estimated parameters."""

    problem: DiagnosisProblem
    active: tuple[EffectParameters, ...]
    initial: Parameters
    whiten: np.ndarray

    def estimated(self, values: Array) -> np.ndarray:
        """Those of the estimated parameters."""
        return np.asarray(values)[np.asarray(self.initial.estimated)]

    @property
    def is_linear(self) -> bool:
        """Whether the wall with these effects is linear and constant in time."""
        return self.problem.is_linear(self.active)

    def at(self, x: np.ndarray) -> Linearisation:
        """The residual, measured minus model, and the Jacobian of the model, with the rows of the priors below."""
        parameters = self.initial.unflatten(x)
        predicted, slope = self._linearise(parameters, parameters.estimated_names)
        jacobian = np.concatenate([self.whiten @ slope.T, np.diag(self._prior_weight)])
        return Linearisation(self._residual(x, predicted), jacobian, predicted)

    def better(self, x: np.ndarray, cost: float) -> Linearisation | None:
        """The same where the cost is below another; None where it is not, or where the model is not finite.

        The derivatives of a linear wall take ten times as long as its readings. So they follow only where the cost is
        lower, as at about three of five trials.
        """
        if self.is_linear:
            residual = self._residual(x, self._linearise(self.initial.unflatten(x), ())[0])
            if not residual @ residual < cost:
                return None
        at = self.at(x)
        return at if at.is_finite and at.residual @ at.residual < cost else None

    def _linearise(self, parameters: Parameters, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        return linearise(self.problem.model, self.problem.bins, parameters, names, linear=self.is_linear)

    def _residual(self, x: np.ndarray, predicted: np.ndarray) -> np.ndarray:
        whitened = self.whiten @ self.problem.binned(self.problem.readings - predicted)
        return np.concatenate([whitened, -self._prior_weight * x])

    @cached_property
    def _prior_weight(self) -> np.ndarray:
        """Reciprocals of the prior standard deviations; 0 where there is no prior."""
        return 1.0 / self.estimated(self.initial.prior_std)


def levenberg_marquardt(least_squares: LeastSquares, x: np.ndarray) -> tuple[np.ndarray, Linearisation, bool]:
    """Bounded least squares by the Levenberg-Marquardt method, scaled by the column norms of the Jacobian.

    The loop is outside the compiled model, so that all sets of effects share one compilation. It holds bounds
    exactly, which optimistix does not: a parameter at a bound stays there while the gradient points outwards.
    It converges where the predicted drop of the cost is below `_COST_TOLERANCE`, and stops at once where the model
    is not finite.

    Returns:
        The estimated parameters, residual and Jacobian there, and whether it converged.

    Source: J. J. More, Lect. Notes Math. 630 (1978), 105.
    """
    low, high = (least_squares.estimated(limit) for limit in (least_squares.initial.lower, least_squares.initial.upper))
    x, damping = np.clip(x, low, high), 1e-6
    current = least_squares.at(x)
    if not current.is_finite:
        return x, current, False
    for _ in range(_MAX_STEPS):
        residual, jacobian = current.residual, current.jacobian
        gradient = jacobian.T @ residual
        moving = ~(((x <= low) & (gradient < 0)) | ((x >= high) & (gradient > 0)))
        J = jacobian[:, moving]
        scale = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
        J = J / scale
        damped = np.concatenate([J, np.sqrt(damping) * np.eye(J.shape[1])])
        step = np.linalg.lstsq(damped, np.concatenate([residual, np.zeros(J.shape[1])]), rcond=None)[0]
        predicted_drop = float(residual @ residual - np.sum((residual - J @ step) ** 2))
        if predicted_drop < _COST_TOLERANCE:
            return x, current, True
        trial = x.copy()
        trial[moving] += step / scale
        trial = np.clip(trial, low, high)
        new = least_squares.better(trial, float(residual @ residual))
        if new is not None:
            x, current = trial, new
            damping = max(damping / 10.0, 1e-9)
        else:
            damping = max(10.0 * damping, 1e-3)
    return x, current, False
