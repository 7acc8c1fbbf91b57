"""A 95 % interval from a minimum: by its curvature where the cost is a parabola, else by the profile likelihood.

    -2 log L(alpha) <= min + q^2 w

with all else that is free integrated out (`likelihood.profile`), `q` the 97.5 % quantile in standard errors, and `w`
how much larger the variance is than the weights make it.

Source: G. A. F. Seber, C. J. Wild, Nonlinear Regression (1989), 5.9.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .._internal.arrays import on_device
from .likelihood import LikelihoodProblem, profile_likelihood

_SCAN = 25  # diffusivities between the bounds, to see minima elsewhere
_LOCAL = 8  # steps from two half widths below the minimum to two above it
_PARABOLA = (0.85, 1.2)  # of the cost's rise at the interval's ends over that of a parabola
_DEEPER = 1.0  # of -2 log L: a minimum elsewhere is taken if it is lower by more
_LARGEST = 700.0  # exp(709) is the largest float


class Interval(NamedTuple):
    """A 95 % interval of ln(alpha/start).

    Args:
        kind: "normal", or "profile likelihood" where the cost is no parabola.
        deeper: ln(alpha/start) of a point outside where the cost is lower than at the minimum found; or None.
    """

    low: float
    high: float
    kind: str
    deeper: float | None


def interval_95(
    problem: LikelihoodProblem, at: float, std: float, quantile: float, widening: float, least: float
) -> Interval:
    """The interval about a minimum.

    Args:
        at, std: ln(alpha/start) of the minimum, and its standard error.
        quantile: 97.5 %, in standard errors.
        widening: the variance over what the problem's weights make it.
        least: `-2 log L` at the minimum, as `likelihood.profile` gives it.
    """

    def rise(points: np.ndarray) -> np.ndarray:
        change = np.asarray(profile_likelihood(problem, on_device(points))) - least
        return np.where(np.isfinite(change), change, np.inf)  # the model has no value there

    low, high = (math.log(float(end) / float(problem.start)) for end in (problem.lowest, problem.highest))
    half = min(quantile * std, _LARGEST)
    limit = quantile**2 * widening  # of the weights' own cost
    near = np.clip(at + half * np.linspace(-2.0, 2.0, _LOCAL + 1)[np.arange(_LOCAL + 1) != _LOCAL // 2], low, high)
    points = np.concatenate([near, np.linspace(low, high, _SCAN)])
    change = rise(points)
    ends = change[[_LOCAL // 4, _LOCAL // 4 + _LOCAL // 2 - 1]]
    outside = np.abs(points - at) > half
    elsewhere = np.where(outside, change, np.inf)
    deeper = float(points[np.argmin(elsewhere)]) if elsewhere.min() < -_DEEPER else None
    parabolic = np.all((ends > _PARABOLA[0] * limit) & (ends < _PARABOLA[1] * limit))
    if half < high - low and parabolic and not np.any(change[outside] < _PARABOLA[0] * limit):
        return Interval(at - half, at + half, "normal", deeper)
    points, change = np.append(points, at), np.append(change, 0.0)
    low, high = (_crossing(rise, points, change, limit, side) for side in (-1, 1))
    return Interval(low, high, "profile likelihood", deeper)


def _crossing(
    rise: Callable[[np.ndarray], np.ndarray], points: np.ndarray, change: np.ndarray, limit: float, side: int
) -> float:
    """The outermost point on one side where the profile passes `limit`; the bound where it does not."""
    order = np.argsort(points * side)
    points, change = points[order], change[order]
    inside = int(np.flatnonzero(change <= limit)[-1])
    if inside == len(points) - 1:
        return float(points[inside])
    fine = np.linspace(points[inside], points[inside + 1], _LOCAL + _SCAN)
    fine_change = rise(fine)
    last = min(int(np.flatnonzero(fine_change <= limit)[-1]) if (fine_change <= limit).any() else 0, len(fine) - 2)
    a, b = (math.sqrt(max(c, 0.0)) for c in fine_change[last : last + 2])
    share = (math.sqrt(limit) - a) / (b - a) if math.isfinite(b) and b > a else 0.0
    return float(fine[last] + min(max(share, 0.0), 1.0) * (fine[last + 1] - fine[last]))
