"""Whether a fit may stand: what it is worth with what its effects chose paid for, and why it is refused."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from .effect_fit import Fit
from .problem import EffectParameters

_TOLD = 2.0  # standard deviations from none that a size must be, with its places and hours free
_MOVES = 0.5  # of the diffusivity's standard deviation: an effect too small to report stays if it moves it so far


def price(fit: Fit, slots: Iterable[EffectParameters]) -> float:
    """What the places, hours and temperatures that some effects chose must bring of `-2 log L` to be worth it.

    `ln(readings)` each, by the Bayesian criterion: an effect that may choose explains a little of anything.

    Source: G. Schwarz, Ann. Stat. 6 (1978), 461.
    """
    chosen = sum(not parameter.is_size for slot in slots for parameter in slot.effect.parameters)
    return chosen * float(np.log(len(fit.noise.whiten)))


def weighed(fit: Fit) -> float:
    """Its `-2 log L` with what its effects chose paid for."""
    return fit.cost + price(fit, fit.active)


def refusal(fit: Fit) -> str:
    """Why a fit is not acceptable; empty where it is."""
    study = fit.study
    if fit.at_bound:
        return f"{study.label(fit.at_bound[0].effect)} at the bound of its search"
    if not np.isfinite(fit.cost):
        return "no finite fit"
    for slot in fit.active:
        size = slot.effect.parameters[0]
        if abs(fit.theta[slot.first]) < _TOLD * fit.std(slot.first):
            return f"{study.label(slot.effect)} of a size that this record cannot tell from none"
        if size.worth is not None and abs(fit.theta[slot.first]) < size.worth and _pull(fit, slot) < _MOVES:
            return f"{study.label(slot.effect)} smaller than {size.worth:g} {size.unit}, and moves nothing"
    return ""


def _pull(fit: Fit, slot: EffectParameters) -> float:
    """How far an effect moves ln(diffusivity), in its standard deviations without the effect, to first order."""
    place = fit.free.index(slot.first)
    covariance = fit.covariance
    shift = abs(covariance[0, place] / covariance[place, place] * fit.theta[slot.first])
    alone = max(covariance[0, 0] - covariance[0, place] ** 2 / covariance[place, place], 1e-300)
    return float(shift / np.sqrt(alone))
