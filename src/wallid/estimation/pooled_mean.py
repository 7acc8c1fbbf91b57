"""The mean of values that have errors in common, and whether they agree.

With `y_i` the values, `C` their covariance and one mean `m`::

    m = (1' V^-1 1)^-1 1' V^-1 y,     V = C + tau^2 1,     X^2 = (y - m)' C^-1 (y - m) on n - 1 degrees of freedom
    C_ij = sum_c b_ic b_jc for i != j,      b_ic = dy_i / dc

with c the constants that all of them share, one standard deviation of its prior each. Where the values disagree (p
under 5 %), `tau^2` is the variance between them that makes `X^2` what it should be, and Student's quantile with n - 1
degrees of freedom stands for the normal one.

Source: R. C. Paule, J. Mandel, J. Res. NBS 87 (1982), 377; G. Knapp, J. Hartung, Stat. Med. 22 (2003), 2693.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from ..inference.quantity import NORMAL_95

DISAGREE = 0.05  # p under which values do not agree


@dataclass(frozen=True)
class PooledMean:
    """The mean of correlated values.

    Args:
        value, std: of the mean; std with the variance between them. quantile: 97.5 %, in `std`.
        chi_square, freedom, p_value: of their agreement; p is NaN for a single value.
        between: standard deviation between them beyond their own, 0 where they agree.
        weights: of each value.
    """

    value: float
    std: float
    quantile: float
    chi_square: float
    freedom: int
    p_value: float
    between: float
    weights: np.ndarray

    @property
    def agreement(self) -> str:
        """Whether the values, one of each window, agree, in a sentence."""
        if not self.freedom:
            return "nothing to compare"
        tested = f"chi-square {self.chi_square:.3g} on {self.freedom} degrees of freedom, p = {self.p_value:.2g}"
        if not self.between:
            return f"{tested}: the windows agree"
        return (
            f"{tested}: the windows DISAGREE beyond their intervals; a variance between windows of {self.between:.1%} "
            "is counted, and the interval is by Student's quantile"
        )


def mean_of(values: np.ndarray, covariance: np.ndarray, quantile: float = NORMAL_95) -> PooledMean:
    """The generalised least-squares mean of values, widened where they disagree.

    Args:
        quantile: of each value's own interval, 97.5 %.
    """
    count, freedom = len(values), len(values) - 1

    def mean(between: float) -> tuple[float, float, float, np.ndarray]:
        V = covariance + between**2 * np.eye(count)
        solved = np.linalg.solve(V, np.ones(count))
        weights = solved / solved.sum()
        m = float(weights @ values)
        return m, float(1.0 / solved.sum()), float((values - m) @ np.linalg.solve(V, values - m)), weights

    m, variance, chi_square, weights = mean(0.0)
    p_value = float(scipy.special.chdtrc(freedom, chi_square)) if freedom else math.nan
    if not p_value < DISAGREE:
        return PooledMean(m, math.sqrt(variance), quantile, chi_square, freedom, p_value, 0.0, weights)

    top = 2.0 * float(np.ptp(values)) + 1e-12
    while mean(top)[2] > freedom:
        top *= 2.0
    found = scipy.optimize.root_scalar(
        lambda tau: mean(float(tau))[2] - freedom, bracket=(0.0, top), xtol=1e-9 * top, method="brentq"
    )
    between = float(found.root)
    m, variance, _, weights = mean(between)
    wide = max(quantile, float(scipy.special.stdtrit(freedom, 0.975)))
    return PooledMean(m, math.sqrt(variance), wide, chi_square, freedom, p_value, between, weights)


def covariance_of(stds: np.ndarray, shared: np.ndarray) -> np.ndarray:
    """C: each value's own standard deviation, and what the same constants make of all of them.

    Args:
        stds: `(value,)`. shared: `b`, `(value, constant)`.
    """
    covariance = shared @ shared.T
    np.fill_diagonal(covariance, stds**2)
    return covariance
