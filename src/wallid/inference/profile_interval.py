"""A 95 % interval about a minimum: by its curvature where the cost is a parabola, else by the profile likelihood.

    -2 log L(alpha) <= min + q^2 w

with the nuisance parameters integrated out (`likelihood.profile_likelihood`), `q` the 97.5 % quantile in standard
errors, and `w` the inflation of the variance over that of the weights.

Source: G. A. F. Seber, C. J. Wild, Nonlinear Regression (1989), 5.9.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .._internal.arrays import on_device
from .likelihood import LikelihoodProblem, profile_likelihood

_SCAN = 25  # diffusivities between the bounds, to find other minima
_LOCAL = 8  # steps from two half widths below the minimum to two above it
_PARABOLA = (0.85, 1.2)  # range of the cost's increase at the interval's ends, over that of a parabola
_LOWER = 1.0  # of -2 log L: another minimum counts if it is lower by more
_MAX_EXPONENT = 700.0  # exp(709) is the largest float


class Interval(NamedTuple):
    """A 95 % interval of ln(alpha/start).

    Args:
        low, high: ends of the interval.
        method: "normal", or "profile likelihood" where the cost is no parabola.
        lower_minimum: ln(alpha/start) of a point outside where the cost is lower than at the minimum; or None.
    """

    low: float
    high: float
    method: str
    lower_minimum: float | None


def interval_95(
    problem: LikelihoodProblem, log_alpha: float, std: float, quantile: float, variance_inflation: float, minimum: float
) -> Interval:
    """The interval about a minimum.

    Args:
        log_alpha, std: ln(alpha/start) of the minimum, and its standard error.
        quantile: 97.5 %, in standard errors.
        variance_inflation: the variance over that of the problem's weights.
        minimum: `-2 log L` at the minimum, as `likelihood.profile_likelihood` gives it.
    """

    def increase(points: np.ndarray) -> np.ndarray:
        change = np.asarray(profile_likelihood(problem, on_device(points))) - minimum
        return np.where(np.isfinite(change), change, np.inf)  # the model's value is not finite there

    low, high = (math.log(float(end) / float(problem.start)) for end in (problem.lowest, problem.highest))
    half = min(quantile * std, _MAX_EXPONENT)
    limit = quantile**2 * variance_inflation  # of the increase of the problem's cost
    steps = np.delete(np.linspace(-2.0, 2.0, _LOCAL + 1), _LOCAL // 2)  # without 0
    near = np.clip(log_alpha + half * steps, low, high)
    points = np.concatenate([near, np.linspace(low, high, _SCAN)])
    change = increase(points)
    ends = change[[_LOCAL // 4, _LOCAL // 4 + _LOCAL // 2 - 1]]
    outside = np.abs(points - log_alpha) > half
    change_outside = np.where(outside, change, np.inf)
    lower_minimum = float(points[np.argmin(change_outside)]) if change_outside.min() < -_LOWER else None
    parabolic = np.all((ends > _PARABOLA[0] * limit) & (ends < _PARABOLA[1] * limit))
    if half < high - low and parabolic and not np.any(change[outside] < _PARABOLA[0] * limit):
        return Interval(log_alpha - half, log_alpha + half, "normal", lower_minimum)
    points, change = np.append(points, log_alpha), np.append(change, 0.0)
    low, high = (_crossing(increase, points, change, limit, side) for side in (-1, 1))
    return Interval(low, high, "profile likelihood", lower_minimum)


def _crossing(
    increase: Callable[[np.ndarray], np.ndarray], points: np.ndarray, change: np.ndarray, limit: float, side: int
) -> float:
    """The outermost point on one side where the profile passes `limit`; the bound where it does not."""
    order = np.argsort(points * side)
    points, change = points[order], change[order]
    inside = int(np.flatnonzero(change <= limit)[-1])
    if inside == len(points) - 1:
        return float(points[inside])
    fine = np.linspace(points[inside], points[inside + 1], _LOCAL + _SCAN)
    fine_change = increase(fine)
    last = min(int(np.flatnonzero(fine_change <= limit)[-1]) if (fine_change <= limit).any() else 0, len(fine) - 2)
    a, b = (math.sqrt(max(c, 0.0)) for c in fine_change[last : last + 2])
    share = (math.sqrt(limit) - a) / (b - a) if math.isfinite(b) and b > a else 0.0
    return float(fine[last] + min(max(share, 0.0), 1.0) * (fine[last + 1] - fine[last]))
