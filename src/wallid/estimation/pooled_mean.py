"""The mean of correlated values, and a chi-square test of whether they agree.

With `y_i` the values, `C` their covariance and `m` their common mean::

    m = (1' V^-1 1)^-1 1' V^-1 y,     V = C + tau^2 1,     X^2 = (y - m)' C^-1 (y - m) on n - 1 degrees of freedom
    C_ij = sum_c b_ic b_jc for i != j,      b_ic = dy_i / dc

with c the instrument constants that all values have in common, in prior standard deviations. Where the values disagree
(p below 5 %), the between-value variance `tau^2` is chosen so that `X^2`, computed with V, equals n - 1, and the
interval uses Student's quantile with n - 1 degrees of freedom.

Source: R. C. Paule, J. Mandel, J. Res. NBS 87 (1982), 377; G. Knapp, J. Hartung, Stat. Med. 22 (2003), 2693.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from .._internal.result_object import ResultObject
from ..inference.quantity import NORMAL_95

DISAGREEMENT_P_VALUE = 0.05  # a p-value below this means that the values disagree


@dataclass(frozen=True)
class PooledMean(ResultObject):
    """The mean of correlated values.

    Args:
        value, std: the mean and its standard deviation, the variance between the values included.
        quantile: the 97.5 % quantile, in units of `std`.
        chi_square, degrees_of_freedom, p_value: of the test of agreement; the p-value is NaN for a single value.
        between_std: standard deviation between the values beyond their own; 0 where they agree.
        weights: of the values, `(value,)`.
    """

    value: float
    std: float
    quantile: float
    chi_square: float
    degrees_of_freedom: int
    p_value: float
    between_std: float
    weights: np.ndarray

    @property
    def agreement(self) -> str:
        """The result of the test of agreement between windows, as text."""
        if not self.degrees_of_freedom:
            return "nothing to compare"
        tested = (
            f"chi-square {self.chi_square:.3g} on {self.degrees_of_freedom} degrees of freedom, p = {self.p_value:.2g}"
        )
        if not self.between_std:
            return f"{tested}: the windows agree"
        return (
            f"{tested}: the windows DISAGREE beyond their intervals; a standard deviation between windows of "
            f"{self.between_std:.1%} is included, and the interval uses Student's quantile"
        )


def pooled_mean(values: np.ndarray, covariance: np.ndarray, quantile: float = NORMAL_95) -> PooledMean:
    """The GLS mean of correlated values, with a between-value variance where they disagree.

    Args:
        values: `(value,)`. covariance: of the values, `(value, value)`.
        quantile: the 97.5 % quantile of the values' own intervals, in standard deviations.

    Returns:
        the mean and the test of agreement.

    Source: R. C. Paule, J. Mandel, J. Res. NBS 87 (1982), 377; G. Knapp, J. Hartung, Stat. Med. 22 (2003), 2693.
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
    if not p_value < DISAGREEMENT_P_VALUE:
        return PooledMean(m, math.sqrt(variance), quantile, chi_square, freedom, p_value, 0.0, weights)

    top = 2.0 * float(np.ptp(values)) + 1e-12
    while mean(top)[2] > freedom:
        top *= 2.0
    solution = scipy.optimize.root_scalar(
        lambda tau: mean(float(tau))[2] - freedom, bracket=(0.0, top), xtol=1e-9 * top, method="brentq"
    )
    between = float(solution.root)
    m, variance, _, weights = mean(between)
    student = max(quantile, float(scipy.special.stdtrit(freedom, 0.975)))
    return PooledMean(m, math.sqrt(variance), student, chi_square, freedom, p_value, between, weights)


def covariance_with_shared_errors(stds: np.ndarray, shared: np.ndarray) -> np.ndarray:
    """The covariance C of values with instrument errors in common.

    Args:
        stds: total standard deviation of each value, `(value,)`.
        shared: b, effect of one standard deviation of each common error on each value, `(value, constant)`.
    """
    covariance = shared @ shared.T
    np.fill_diagonal(covariance, stds**2)
    return covariance
