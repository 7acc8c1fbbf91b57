"""How rivals fall behind a true effect by fits to readings without noise.

A derivative mis-states what films, depths and layers can explain. The refits cost more, so they are made for the
best actions only, and there for the most probable effects and their nearest rivals. A rival's best position, hour or
temperature in the next record may be far from that in the present one, so it is also fitted from where a score test
finds it best, as in a diagnosis.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...inference.likelihood import LOG_DIFFUSIVITY
from ...inference.noise_covariance import NoiseCovariance, bin_readings
from ...models.flux_plates import fluxes_of
from ..effect_fit import EffectFit, linearised_at, refit
from ..model_with_effects import linearise
from ..problem import DiagnosisProblem, EffectParameters
from ..selection.candidate_fits import CandidateFits
from ..selection.score_test import CandidateScores
from .candidate_records import CandidateRecord
from .confusable_sets import ConfusableSet
from .present_record import explanation_of
from .separation import Explanation, FitWithoutNoise, Separation, separation

_TRUE, _NEAREST = 3, 3  # effects that are taken as the true one, and rivals of each, for which refits are made
_CLEAR_EXCESS = 60.0  # of a penalised cost: a rival that far behind is excluded whatever a refit says


class Refits(NamedTuple):
    """Fits to the readings of the next record that one effect of a set predicts, without noise.

    Args:
        true: what the effect predicts.
        rivals: the fits of some rivals, by their indices in `ConfusableSet.rivals_of`.
    """

    true: EffectFit
    rivals: dict[int, EffectFit]


def refits_without_noise(confusable: ConfusableSet, candidate: CandidateRecord) -> dict[int, Refits]:
    """The refits where they matter: the most probable effects of a set as the true one, and their nearest rivals."""
    derivatives = confusable.separations(candidate)
    return {
        int(k): _refits(confusable, candidate, int(k), derivatives[k]) for k in np.argsort(-confusable.weights)[:_TRUE]
    }


def refitted_separations(
    confusable: ConfusableSet, candidate: CandidateRecord, refits: dict[int, Refits]
) -> tuple[Separation, ...]:
    """How the others fall behind each effect of a set, by refits where there are some and by the derivatives elsewhere.

    Args:
        confusable: the set.
        candidate: the next record.
        refits: of this record; for a longer one, those of a repeat of the present one.
    """
    return tuple(
        _with_refits(confusable, candidate, k, one, refits[k]) if k in refits else one
        for k, one in enumerate(confusable.separations(candidate))
    )


def _refits(confusable: ConfusableSet, candidate: CandidateRecord, k: int, derivative: Separation) -> Refits:
    """The refits where effect k of the set is the true one."""
    problem, fits = candidate.problem, confusable.present.fits
    parameters = candidate.next_parameters(fits[k])
    covariance = problem.noise_shape(parameters).covariance_like(fits[0].noise)
    without_noise = _with_readings_of(candidate, fits[k])
    refits = _RefitsWithoutNoise(candidate, CandidateFits(without_noise), covariance)
    rivals, excess = confusable.rivals_of(k), derivative.excess.mean(axis=0)
    nearest = np.argsort((excess + derivative.penalties)[: len(rivals)])[:_NEAREST]
    return Refits(
        linearised_at(without_noise, same_effects(candidate, fits[k]), parameters, covariance),
        {int(j): refits.best(fits[rivals[j]]) for j in nearest if excess[j] < _CLEAR_EXCESS},
    )


def _with_refits(
    confusable: ConfusableSet, candidate: CandidateRecord, k: int, derivative: Separation, refits: Refits
) -> Separation:
    """The separations of effect k, with those of the refits for the rivals that have one."""
    explained = [
        candidate.whitened_refit(one, refits.true.noise)
        for one in (explanation_of(refits.true), *map(_within_bounds, refits.rivals.values()))
    ]
    blocks, length = candidate.blocks(len(explained[0].predicted)), candidate.length
    true, *rivals = (FitWithoutNoise(one, length, blocks) for one in explained)
    exact = separation(true, rivals, confusable.next_truths(candidate, k))
    excess, penalties, refitted = np.array(derivative.excess), np.array(derivative.penalties), list(refits.rivals)
    excess[:, refitted], penalties[refitted] = exact.excess, exact.penalties
    return replace(derivative, excess=excess, penalties=penalties)


def _within_bounds(fit: EffectFit) -> Explanation:
    """The readings by a fit, linear in the parameters that are at no bound: there the others alone can change."""
    return explanation_of(fit).without(fit.names_at_bound)


@dataclass(frozen=True, eq=False)
class _RefitsWithoutNoise:
    """Fits to what a true effect predicts for the next record, without noise.

    Args:
        candidate: the next record.
        fits: of the problem with these readings.
        covariance: of the readings' noise.
    """

    candidate: CandidateRecord
    fits: CandidateFits
    covariance: NoiseCovariance = field(repr=False)

    def best(self, fit: EffectFit) -> EffectFit:
        """The fit of the lowest cost with the effects of a fit of the present record."""
        from_present = self._refit(fit)
        best = [k for one in from_present.active if one in self._searched for k in self._scores.candidates_of(one)[:1]]
        tried = [from_present, *(self.fits.add_candidates(self._scores, (k,)) for k in best)]
        return min(tried, key=lambda one: one.cost)

    def _refit(self, fit: EffectFit) -> EffectFit:
        """The fit with the same effects, from the parameters that they have in the present record."""
        effects, parameters = same_effects(self.candidate, fit), self.candidate.next_parameters(fit)
        return refit(self.fits.problem, effects, parameters, self.covariance)

    @cached_property
    def _searched(self) -> tuple[EffectParameters, ...]:
        """The effects of the set that have a position, an hour or a temperature, in the library of the next record."""
        *of_set, base = (same_effects(self.candidate, fit) for fit in self.candidate.present.fits)
        effects = dict.fromkeys(one for active in of_set for one in active if one not in base)
        return tuple(one for one in effects if len(one.names) > 1)

    @cached_property
    def _scores(self) -> CandidateScores:
        """The score test of these against the fit without the effects of the set."""
        return self.fits.score_effects(self._refit(self.candidate.present.fits[-1]), self._searched, {})


def same_effects(candidate: CandidateRecord, fit: EffectFit) -> tuple[EffectParameters, ...]:
    """The effects of a fit in the library of the next record."""
    by_names = {effect.names: effect for effect in candidate.problem.library}
    return tuple(by_names[tuple(map(candidate.next_name, effect.names))] for effect in fit.active)


def _with_readings_of(candidate: CandidateRecord, fit: EffectFit) -> DiagnosisProblem:
    """The next record with the readings that a fit predicts, without noise, in the rows that have a reading."""
    problem = candidate.problem
    # by the compiled function of the fits: another one would be compiled for each kind of record
    parameters, linear = candidate.next_parameters(fit), problem.is_linear(fit.active)
    predicted, _ = linearise(problem.model, problem.bins, parameters, (LOG_DIFFUSIVITY,), linear=linear)
    present = np.isfinite(problem.readings)
    bins, _ = bin_readings(present, np.where(present, predicted, 0.0), plates=bool(fluxes_of(problem.case)))
    return replace(problem, readings=np.where(present, predicted, np.nan), bins=bins)
