"""What a true effect may be, by what the present record leaves open of its size, position, hours and temperatures.

The parameters of an effect are normal about the fit, with the covariance that the present record gives. Before any
record a size is as likely in each decade, so the mean of the size phi is lower by `std^2 / phi`. A draw that would pass
a bound of the search range, or change the sign of the size, ends there.
"""

from __future__ import annotations

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
