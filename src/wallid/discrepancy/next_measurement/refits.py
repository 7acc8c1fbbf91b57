"""How rivals fall behind a true effect by fits to readings without noise.

A derivative mis-states what films, depths and layers can explain. The refits cost more, so they are made for the
best actions only, and there for the most probable effects and their nearest rivals.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...inference.noise_covariance import bin_readings
from ...models.flux_plates import fluxes_of
from ..effect_fit import EffectFit, refit
from ..model_with_effects import predict
from ..problem import DiagnosisProblem, EffectParameters
from .candidate_records import CandidateRecord, LongerRecord
from .confusable_sets import ConfusableSet
from .separation import Separation

_TRUE, _NEAREST = 3, 3  # effects that are taken as the true one, and rivals of each, for which refits are made
_CLEAR_EXCESS = 60.0  # of a penalised cost: a rival that far behind is excluded whatever a refit says


def refitted_separations(confusable: ConfusableSet, candidate: CandidateRecord) -> tuple[Separation, ...]:
    """How the others fall behind each effect of a set, by refits where they matter and by the derivatives elsewhere."""
    most_probable = np.argsort(-confusable.weights)[:_TRUE]
    return tuple(
        _refitted(confusable, candidate, k, one) if k in most_probable else one
        for k, one in enumerate(confusable.separations(candidate))
    )


def lengthened_separations(
    confusable: ConfusableSet, longer: LongerRecord, refitted_repeat: tuple[Separation, ...]
) -> tuple[Separation, ...]:
    """The same for a longer record: the refits of a repeat, multiplied as the derivatives say."""
    repeat = confusable.separations(LongerRecord(longer.present, 1.0))
    return tuple(
        many.with_excess(exact.excess * many.excess / np.maximum(once.excess, 1e-12))
        for many, once, exact in zip(confusable.separations(longer), repeat, refitted_repeat, strict=True)
    )


def _refitted(confusable: ConfusableSet, candidate: CandidateRecord, k: int, derivative: Separation) -> Separation:
    """The refits where effect k of the set is the true one."""
    problem, fits = candidate.problem, confusable.present.fits
    true = fits[k]
    covariance = problem.noise_shape(candidate.next_parameters(true)).covariance_like(fits[0].noise)
    exact = _with_readings_of(candidate, true)

    def cost(fit: EffectFit) -> float:
        return refit(exact, same_effects(candidate, fit), candidate.next_parameters(fit), covariance).cost

    own, excess, rivals = cost(true), np.array(derivative.excess), fits[:k] + fits[k + 1 :]
    with_fit = (excess + derivative.penalties)[: len(rivals)]
    for j in np.argsort(with_fit)[:_NEAREST]:
        if excess[j] < _CLEAR_EXCESS:
            excess[j] = max(cost(rivals[j]) - own, 0.0)
    return derivative.with_excess(excess)


def same_effects(candidate: CandidateRecord, fit: EffectFit) -> tuple[EffectParameters, ...]:
    """The effects of a fit in the library of the next record."""
    by_names = {effect.names: effect for effect in candidate.problem.library}
    return tuple(by_names[tuple(map(candidate.next_name, effect.names))] for effect in fit.active)


def _with_readings_of(candidate: CandidateRecord, fit: EffectFit) -> DiagnosisProblem:
    """The next record with the readings that a fit predicts, without noise, in the rows that have a reading."""
    problem = candidate.problem
    linear = problem.is_linear(fit.active)
    predicted = np.asarray(predict(problem.model, candidate.next_parameters(fit), linear))
    present = np.isfinite(problem.readings)
    bins, _ = bin_readings(present, np.where(present, predicted, 0.0), plates=bool(fluxes_of(problem.case)))
    return replace(problem, readings=np.where(present, predicted, np.nan), bins=bins)
