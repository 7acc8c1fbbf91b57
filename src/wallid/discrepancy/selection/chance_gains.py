"""The largest gain in the entire library that chance alone gives, by random draws of the scores.

If the model is true, the scores are normal with the cosines as covariance. The part of a score that the readings
contribute is larger by the factor `exp(s e / 2)` where the noise is larger than estimated, with the uncertainty s of
its log variance and a normal e; the part of the priors is not. A gain that rests on priors is therefore surer than an
equal one that rests on readings. Its weight is the ratio of the squared scores that both exceed equally rarely.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy
from jaxtyping import Float
from numpy.polynomial.hermite_e import hermegauss

_DRAWS = 2000
_RARE = 1e-3  # probability of the scores whose ratio is the weight
_NODES = 40  # of the Gauss-Hermite rule
_SHARES = np.linspace(0.0, 1.0, 21)  # of the priors in a squared score


def draw_scores(
    covariance: Float[np.ndarray, "candidate candidate"], count: int, random: np.random.Generator
) -> Float[np.ndarray, "draw candidate"]:
    """Normal scores with a covariance that may be singular."""
    value, vector = np.linalg.eigh(covariance)
    root = vector * np.sqrt(np.maximum(value, 0.0))
    return random.standard_normal((count, len(value))) @ root.T


@dataclass(frozen=True, eq=False)
class ChanceGains:
    """What chance alone gives to the candidates of a score test.

    Args:
        cosine: covariance of the scores, `(candidate, candidate)`.
        prior_cosine: the part of it by the priors.
        required_signs: +1 or -1 where the size must be positive or negative, else 0.
        log_power_std: standard deviation of the log variance of the noise.
        random: generator of the draws.
    """

    cosine: np.ndarray = field(repr=False)
    prior_cosine: np.ndarray = field(repr=False)
    required_signs: np.ndarray = field(repr=False)
    log_power_std: float
    random: np.random.Generator = field(repr=False)

    @cached_property
    def weight(self) -> Float[np.ndarray, " candidate"]:
        """The weight of each candidate's gain: 1 where it rests on readings, more where it rests on priors."""
        quantiles = np.array([_rare_score(share, self.log_power_std) for share in _SHARES])
        shares = np.clip(np.diag(self.prior_cosine), 0.0, 1.0)
        return np.asarray((quantiles[0] / np.interp(shares, _SHARES, quantiles)) ** 2)

    @cached_property
    def largest(self) -> Float[np.ndarray, " draw"]:
        """The largest weighted gain of each draw, sorted."""
        inflation = np.exp(0.5 * self.log_power_std * self.random.standard_normal((_DRAWS, 1)))
        of_readings = draw_scores(self.cosine - self.prior_cosine, _DRAWS, self.random)
        draws = inflation * of_readings + draw_scores(self.prior_cosine, _DRAWS, self.random)
        gains = np.where(self.required_signs * draws < 0, 0.0, self.weight * draws**2)
        return np.sort(gains.max(axis=1, initial=0.0))

    def p_value(self, weighted_gain: float) -> float:
        """Probability that the largest weighted gain exceeds a value by chance; at least 1/(draws + 1)."""
        larger = len(self.largest) - np.searchsorted(self.largest, weighted_gain)
        return float(1 + larger) / (1 + len(self.largest))

    def threshold(self, p: float) -> float:
        """The weighted gain that the largest one exceeds by chance with this probability."""
        return float(np.quantile(self.largest, 1 - p)) if len(self.cosine) else np.inf


def _rare_score(share: float, log_power_std: float) -> float:
    """The score that is exceeded with the probability `_RARE`, where this share of its square is the priors'."""
    node, weight = hermegauss(_NODES)
    weight = weight / weight.sum()
    std = np.sqrt((1.0 - share) * np.exp(log_power_std * node) + share)
    highest = 10.0 * float(std.max())
    return float(scipy.optimize.brentq(lambda q: 2.0 * weight @ scipy.special.ndtr(-q / std) - _RARE, 0.0, highest))
