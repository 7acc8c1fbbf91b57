"""The sets of effects that a record cannot distinguish, as explanations of its readings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..effect_fit import EffectFit, refit
from ..problem import EffectParameters
from ..result.findings import Findings
from ..selection.acceptance import FIRST_EFFECT_LEVEL, RIVAL, penalised_cost, reason_for_refusal
from ..selection.effect_results import NamedEffect
from ..selection.score_test import same_effect_and_target
from ..selection.stepwise_selection import added_effect
from .candidate_records import CandidateRecord
from .possible_truths import PossibleTruths, minus_twice_log_evidence, possible_truths
from .present_record import PresentRecord
from .separation import Explanation, FitWithoutNoise, Separation, separation

_FAR_BEHIND = 30.0  # of the penalised cost; a rival that far behind the best is no alternative of another record either


@dataclass(frozen=True, eq=False)
class ConfusableSet:
    """Effects that a record cannot distinguish, each with a fit of the record, and the other rivals.

    Args:
        effects: the named effect, its alternatives, and other forms of the named effect (placed, hourly). Forms of the
            same effect on the same target are no rivals of each other.
        present: the record with the fits of each of these effects, of each further rival, and without any of them.
        chance_gain: the gain over the last fit that chance alone gives.
    """

    effects: tuple[EffectParameters, ...]
    present: PresentRecord = field(repr=False)
    chance_gain: float
    _separations: dict[CandidateRecord, tuple[Separation, ...]] = field(default_factory=dict, init=False, repr=False)

    @property
    def distinct_effects(self) -> tuple[EffectParameters, ...]:
        """One form of each effect, the named one first."""
        by_name = {(one.effect.name, one.effect.target): one for one in reversed(self.effects)}
        return tuple(one for one in self.effects if one in by_name.values())

    @cached_property
    def weights(self) -> np.ndarray:
        """The probability that each of the effects is the true one, by the evidence of the record, `(effect,)`."""
        costs = np.array([minus_twice_log_evidence(fit, one) for fit, one in self._fits_of_effects])
        weights = np.exp(-0.5 * (costs - costs.min()))
        return np.asarray(weights / weights.sum())

    @cached_property
    def possible_truths(self) -> tuple[PossibleTruths, ...]:
        """What each of the effects may be where it is the true one."""
        return tuple(possible_truths(fit, one) for fit, one in self._fits_of_effects)

    @property
    def _fits_of_effects(self) -> Iterator[tuple[EffectFit, EffectParameters]]:
        """Each of the effects with its fit of the present record."""
        return zip(self.present.fits[: len(self.effects)], self.effects, strict=True)

    def separations(self, candidate: CandidateRecord) -> tuple[Separation, ...]:
        """How the others fall behind each of the effects where it is the true one, by the derivatives.

        The others are those with a fit of the present record, then the further rivals of the candidate. A parameter of
        a rival that is at a bound of its search range stays there. Computed once for each candidate.
        """
        if candidate not in self._separations:
            self._separations[candidate] = self._separate(candidate)
        return self._separations[candidate]

    def _separate(self, candidate: CandidateRecord) -> tuple[Separation, ...]:
        blocks = candidate.blocks(len(candidate.whitening))

        def fit_of(explanation: Explanation) -> FitWithoutNoise:
            return FitWithoutNoise(explanation, candidate.length, blocks)

        fits = [fit_of(one) for one in candidate.whitened_explanations]
        rivals = [
            fit_of(one.explanation.without(names)) if names else one
            for one, names in zip(fits, self._at_bound(candidate), strict=True)
        ]
        further = [fit_of(one) for one in candidate.whitened_further]
        return tuple(
            separation(fits[k], [*(rivals[j] for j in self.rivals_of(k)), *further], self.next_truths(candidate, k))
            for k in range(len(self.effects))
        )

    def _at_bound(self, candidate: CandidateRecord) -> Iterator[set[str]]:
        """The parameters of each fit that are at a bound of their search range, by the names of the next record."""
        return (set(map(candidate.next_name, fit.names_at_bound)) for fit in self.present.fits)

    def next_truths(self, candidate: CandidateRecord, k: int) -> PossibleTruths:
        """What effect k may be, by the names of the next record."""
        truths = self.possible_truths[k]
        return truths._replace(names=tuple(map(candidate.next_name, truths.names)))

    def rivals_of(self, k: int) -> tuple[int, ...]:
        """The fits of the present record that have another effect than the k-th, and last the one without any."""
        *others, without = self.present.fits
        added = (*self.effects, *(added_effect(fit, without) for fit in others[len(self.effects) :]))
        differ = (j for j, one in enumerate(added) if not same_effect_and_target(one, self.effects[k]))
        return (*differ, len(others))

    def probability(self, separations: Sequence[Separation]) -> float:
        """The probability that the true effect is named and has no alternative, over which of them is true."""
        each = [one.probability(self._criteria(k, len(one.penalties))) for k, one in enumerate(separations)]
        return float(self.weights @ each)

    def _criteria(self, k: int, rivals: int) -> np.ndarray:
        """What each rival of the k-th effect must fall behind."""
        criteria = np.full(rivals, RIVAL)
        criteria[len(self.rivals_of(k)) - 1] = self.chance_gain
        return criteria


def confusable_sets(findings: Findings) -> Iterator[ConfusableSet]:
    """The sets of a diagnosis, one for each named effect with alternatives."""
    for named in findings.effects:
        if not named.alternatives:
            continue
        own, best = named.effect_parameters, _best_by_effect(named)
        alternatives = tuple(dict.fromkeys(effect for effect in named.alternatives if effect in best))
        limit = penalised_cost(findings.after) + _FAR_BEHIND
        further = [fit for effect, fit in best.items() if effect not in alternatives and penalised_cost(fit) < limit]
        forms = {one: fit for one, fit in _other_forms(findings, named).items() if penalised_cost(fit) < limit}
        fits = (findings.after, *(best[effect] for effect in alternatives), *forms.values(), *further, named.without)
        effects = (own, *alternatives, *forms)
        yield ConfusableSet(effects, PresentRecord(fits), findings.scores.threshold(FIRST_EFFECT_LEVEL))


def _best_by_effect(named: NamedEffect) -> dict[EffectParameters, EffectFit]:
    """The best fit with each other effect in the place of a named one."""
    best: dict[EffectParameters, EffectFit] = {}
    for fit in sorted(named.exchanged, key=penalised_cost):
        best.setdefault(added_effect(fit, named.without), fit)
    return best


def _other_forms(findings: Findings, named: NamedEffect) -> dict[EffectParameters, EffectFit]:
    """Fits of other forms of a named effect in its place, of those that the diagnosis tried."""
    own, without, noise = named.effect_parameters, named.without, findings.after.noise
    found: dict[EffectParameters, EffectFit] = {}
    for trial in sorted(findings.trials, key=lambda trial: penalised_cost(trial.fit)):
        added = [one for one in trial.fit.active if one not in without.active]
        if len(added) == 1 and set(without.active) < set(trial.fit.active):
            (form,) = added
            if form is not own and form not in found and same_effect_and_target(form, own):
                found[form] = refit(findings.problem, trial.fit.active, trial.fit.parameters, noise)
    return {form: fit for form, fit in found.items() if not reason_for_refusal(fit)}
