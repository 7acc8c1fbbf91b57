"""The sets of effects that a record cannot distinguish, as explanations of its readings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..effect_fit import EffectFit
from ..problem import EffectParameters
from ..result.findings import Findings
from ..selection.acceptance import FIRST_EFFECT_LEVEL, RIVAL, penalised_cost
from ..selection.effect_results import NamedEffect
from ..selection.stepwise_selection import added_effect
from .candidate_records import CandidateRecord
from .present_record import PresentRecord
from .separation import Separation, separation

_FAR_BEHIND = 30.0  # of the penalised cost; a rival that far behind the best is no alternative of another record either


@dataclass(frozen=True, eq=False)
class ConfusableSet:
    """Effects that a record cannot distinguish, each with a fit of the record, and the other rivals.

    Args:
        effects: the named effect and its alternatives.
        present: the record with the fits of each of these effects, of each further rival, and without any of them.
        chance_gain: the gain over the last fit that chance alone gives.
    """

    effects: tuple[EffectParameters, ...]
    present: PresentRecord = field(repr=False)
    chance_gain: float

    @cached_property
    def weights(self) -> np.ndarray:
        """The probability that each of the effects is the true one, by the evidence of the record, `(effect,)`."""
        costs = np.array([penalised_cost(fit) for fit in self.present.fits[: len(self.effects)]])
        weights = np.exp(-0.5 * (costs - costs.min()))
        return np.asarray(weights / weights.sum())

    @cached_property
    def relative_stds(self) -> np.ndarray:
        """Standard deviation of each effect's size at its fitted position over the size, at most 1, `(effect,)`."""
        pairs = zip(self.present.fits, self.effects, strict=False)
        values = [(fit.std_of_size(effect), abs(float(fit.parameters[effect.names[0]]))) for fit, effect in pairs]
        return np.array([min(std / size, 1.0) if size > 0 else 1.0 for std, size in values])

    def separations(self, candidate: CandidateRecord) -> tuple[Separation, ...]:
        """How the others fall behind each of the effects where it is the true one, by the derivatives.

        The others are those with a fit of the present record, then the further rivals of the candidate.
        """
        explanations, further = candidate.whitened_explanations, candidate.whitened_further
        return tuple(
            separation(true, [*(one for one in explanations if one is not true), *further], candidate.length)
            for true in explanations[: len(self.effects)]
        )

    def probability(self, separations: Sequence[Separation]) -> float:
        """The probability that the true effect is named and has no alternative, over which of them is true."""
        without = len(self.present.fits) - 2
        criteria = np.full(len(separations[0].excess), RIVAL)
        criteria[without] = self.chance_gain
        each = [one.probability(criteria, std) for one, std in zip(separations, self.relative_stds, strict=True)]
        return float(self.weights @ each)


def confusable_sets(findings: Findings) -> Iterator[ConfusableSet]:
    """The sets of a diagnosis, one for each named effect with alternatives."""
    for named in findings.effects:
        if not named.alternatives:
            continue
        own, best = named.effect_parameters, _best_by_effect(named)
        alternatives = tuple(dict.fromkeys(effect for effect in named.alternatives if effect in best))
        limit = penalised_cost(findings.after) + _FAR_BEHIND
        further = [fit for effect, fit in best.items() if effect not in alternatives and penalised_cost(fit) < limit]
        fits = (findings.after, *(best[effect] for effect in alternatives), *further, named.without)
        yield ConfusableSet((own, *alternatives), PresentRecord(fits), findings.scores.threshold(FIRST_EFFECT_LEVEL))


def _best_by_effect(named: NamedEffect) -> dict[EffectParameters, EffectFit]:
    """The best fit with each other effect in the place of a named one."""
    best: dict[EffectParameters, EffectFit] = {}
    for fit in sorted(named.exchanged, key=penalised_cost):
        best.setdefault(added_effect(fit, named.without), fit)
    return best
