"""When a fit with effects is accepted: significance levels, penalty for searched parameters, reasons for rejection."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from ...inference.likelihood import LOG_DIFFUSIVITY
from ..effect_fit import EffectFit
from ..problem import EffectParameters

FIRST_EFFECT_LEVEL = 0.03
"""Significance level of the first effect, family-wise over the entire library."""
FURTHER_EFFECT_LEVEL = 0.01
"""Significance level of a further effect, and of a pair where no single effect is significant."""
RIVAL = 9.0
"""Models within this of the best in penalised `-2 log L` cannot be distinguished from it."""
RESIDUAL_TEST_LEVEL = 1e-3
"""Significance level of each of the about five tests of a final model."""
_MIN_SIZE_RATIO = 2.0  # smallest size of an effect over its standard deviation where it is
_MIN_SHIFT = 0.5  # shift of ln(alpha) over its standard deviation from which a small effect is kept


def bic_penalty(fit: EffectFit, effects: Iterable[EffectParameters]) -> float:
    """The penalty on `-2 log L` for the searched positions, hours and temperatures of some effects, `k ln(n)`.

    k is the number of these parameters, n that of the readings. The sizes of the effects are not counted: their
    gain is tested against the score test of the entire library.

    Source: G. Schwarz, Ann. Stat. 6 (1978), 461.
    """
    chosen = sum(
        not parameter.is_size for effect_parameters in effects for parameter in effect_parameters.effect.parameters
    )
    return chosen * float(np.log(len(fit.noise.whitening)))


def penalised_cost(fit: EffectFit) -> float:
    """`-2 log L` of a fit plus the penalty of its effects."""
    return fit.cost + bic_penalty(fit, fit.active)


def gain_by_chance(threshold: Callable[[float], float], effects: int) -> float:
    """The gain in `-2 log L` that chance alone gives to so many effects.

    Args:
        threshold: the gain that the best effect of the library exceeds by chance, by its probability.
        effects: their number.
    """
    levels = (FIRST_EFFECT_LEVEL, *(FURTHER_EFFECT_LEVEL,) * effects)[:effects]
    return sum(threshold(level) for level in levels)


def reason_for_refusal(fit: EffectFit) -> str:
    """Why a fit is rejected, whatever else explains the record; empty where it is accepted."""
    problem = fit.problem
    if fit.at_bound:
        return f"{problem.label(fit.at_bound[0].effect)} is at the bound of its search range"
    if not np.isfinite(fit.cost):
        return "the fit is not finite"
    for effect_parameters in fit.active:
        value = abs(float(fit.parameters[effect_parameters.names[0]]))
        if value < _MIN_SIZE_RATIO * fit.std_of_size(effect_parameters):
            return f"{problem.label(effect_parameters.effect)} has a size that this record cannot distinguish from zero"
    return ""


def reason_to_neglect(fit: EffectFit, effect_parameters: EffectParameters) -> str:
    """Why an effect of a fit is too small to be reported; empty where it is reported."""
    size, value = effect_parameters.effect.parameters[0], abs(float(fit.parameters[effect_parameters.names[0]]))
    small = size.smallest_reported is not None and value < size.smallest_reported
    if not small or _relative_shift(fit, effect_parameters) >= _MIN_SHIFT:
        return ""
    label, limit = fit.problem.label(effect_parameters.effect), f"{size.smallest_reported:g} {size.unit}"
    return f"{label} is smaller than {limit} and does not change the diffusivity"


def _relative_shift(fit: EffectFit, effect_parameters: EffectParameters) -> float:
    """Shift of ln(alpha) by an effect over its standard deviation without the effect, to first order."""
    size, both = effect_parameters.names[0], [fit.index(LOG_DIFFUSIVITY), fit.index(effect_parameters.names[0])]
    (variance, covariance), (_, size_variance) = fit.covariance[np.ix_(both, both)]
    shift = abs(covariance / size_variance * float(fit.parameters[size]))
    alone = max(variance - covariance**2 / size_variance, 1e-300)
    return float(shift / np.sqrt(alone))
