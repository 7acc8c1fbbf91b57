"""Which effect may be the true one, and what it may be: its size, position, hours and temperatures.

Each effect of a set was as likely before the record. By Laplace's approximation the record has with it the probability

    p ~ exp(-cost / 2) prod_i min(1, sqrt(2 pi) s_i / range_i)

with the standard deviations s_i of its position, hours or temperatures, which were as likely anywhere in their search
range. The size and the parameters of the wall have about the same factor with each effect.

The parameters of an effect are normal about the fit, with the covariance that the present record gives. Before any
record a size is as likely in each decade, so the mean of the size phi is lower by `std^2 / phi`. A draw that would pass
a bound of the search range, or change the sign of the size, ends there.

Source: D. J. C. MacKay, Neural Comput. 4 (1992), 415 (the share of a range that the data leave open).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..effect_fit import EffectFit
from ..problem import EffectParameters

_DRAWS = 16


class PossibleTruths(NamedTuple):
    """Draws of the parameters of an effect.

    Args:
        names: of the parameters, the size first.
        draws: each minus the fitted value, `(draw, param)`.
    """

    names: tuple[str, ...]
    draws: np.ndarray


def minus_twice_log_evidence(fit: EffectFit, effect: EffectParameters) -> float:
    """`-2 ln p` of the present record with an effect of a fit, but for a constant that the effects of a set share."""
    parameters, (_, *searched) = fit.parameters, effect.names
    lower, upper = (np.asarray(bound)[parameters.indices(searched)] for bound in (parameters.lower, parameters.upper))
    shares = open_shares(np.array([fit.std(name) for name in searched]), lower, upper)
    return float(fit.cost - 2.0 * np.log(shares).sum())


def open_shares(
    std: Float[np.ndarray, " param"], lower: Float[np.ndarray, " param"], upper: Float[np.ndarray, " param"]
) -> Float[np.ndarray, " param"]:
    """The shares of their ranges that standard deviations leave open."""
    return np.minimum(math.sqrt(2.0 * math.pi) * std / (upper - lower), 1.0)


def possible_truths(fit: EffectFit, effect: EffectParameters) -> PossibleTruths:
    """The draws of an effect of a fit."""
    parameters, indices = fit.parameters, fit.parameters.indices(effect.names)
    values, *bounds = (np.asarray(p)[indices] for p in (parameters.values, parameters.lower, parameters.upper))
    estimated = [fit.index(name) for name in effect.names]
    covariance = fit.covariance[np.ix_(estimated, estimated)]
    return PossibleTruths(effect.names, possible_changes(values, covariance, fit.std_of_size(effect), *bounds))


def possible_changes(
    values: Float[np.ndarray, " param"],
    covariance: Float[np.ndarray, "param param"],
    std_of_size: float,
    lower: Float[np.ndarray, " param"],
    upper: Float[np.ndarray, " param"],
) -> Float[np.ndarray, "draw param"]:
    """The draws minus the fitted values.

    Args:
        values: that are fitted, the size first.
        covariance: of them.
        std_of_size: at the fitted position, hours and temperatures.
        lower, upper: bounds of the search.
    """
    draws, size = normal_draws(covariance), values[0]
    draws[:, 0] -= std_of_size**2 / size if size else 0.0
    if size > 0.0:
        lower = np.append(0.0, lower[1:])
    else:
        upper = np.append(0.0, upper[1:])
    return shortened(draws, lower - values, upper - values)


def normal_draws(covariance: Float[np.ndarray, "param param"]) -> Float[np.ndarray, "draw param"]:
    """Draws of a normal distribution about zero, each with its opposite; they have exactly the covariance."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    value, vector = np.linalg.eigh(covariance / np.outer(scale, scale))
    half = _DRAWS // 2
    standard = np.linalg.qr(np.random.default_rng(0).standard_normal((half, len(scale))))[0] * np.sqrt(half)
    draws = (standard @ (vector * np.sqrt(np.maximum(value, 0.0))).T) * scale
    return np.concatenate([draws, -draws])


def shortened(
    draws: Float[np.ndarray, "draw param"], lower: Float[np.ndarray, " param"], upper: Float[np.ndarray, " param"]
) -> Float[np.ndarray, "draw param"]:
    """Draws that end at the bounds, in their direction."""
    room = np.where(draws < 0.0, lower, upper)
    share = np.where(draws != 0.0, room / np.where(draws != 0.0, draws, 1.0), np.inf)
    return draws * np.clip(share.min(axis=1, keepdims=True), 0.0, 1.0)
