"""How rivals fall behind a true effect by fits to readings without noise.

A derivative mis-states what films, depths and layers can explain. The refits cost more, so they are made for the
best actions only, and there for the most probable effects and their nearest rivals. A rival's best position, hour or
temperature in the next record may be far from that in the present one, so it is also fitted from where a score test
finds it best, as in a diagnosis.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ...inference.likelihood import LOG_DIFFUSIVITY
from ...inference.noise_covariance import NoiseCovariance, bin_readings
from ...models.flux_plates import fluxes_of
from ..effect_fit import EffectFit, refit
from ..model_with_effects import linearise
from ..problem import DiagnosisProblem, EffectParameters
from ..selection.candidate_fits import CandidateFits
from ..selection.score_test import CandidateScores
from .candidate_records import CandidateRecord, LongerRecord
from .confusable_sets import ConfusableSet
from .other_weather import LeastSquaresInOtherWeather
from .separation import Separation, mean_weather, ratio_of_excess

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
        many.with_excess(
            exact.excess * many.excess / np.maximum(once.excess, 1e-12),
            mean_weather(exact.weather, longer.length),
        )
        for many, once, exact in zip(confusable.separations(longer), repeat, refitted_repeat, strict=True)
    )


def _refitted(confusable: ConfusableSet, candidate: CandidateRecord, k: int, derivative: Separation) -> Separation:
    """The refits where effect k of the set is the true one."""
    problem, fits = candidate.problem, confusable.present.fits
    true = fits[k]
    covariance = problem.noise_shape(candidate.next_parameters(true)).covariance_like(fits[0].noise)
    refits = _RefitsWithoutNoise(candidate, CandidateFits(_with_readings_of(candidate, true)), covariance)
    own, rivals = refits.best(true), [fits[j] for j in confusable.rivals_of(k)]
    own_squares = refits.squared_residuals(own)
    excess, weather = np.array(derivative.excess), np.array(derivative.weather)
    with_fit = (excess + derivative.penalties)[: len(rivals)]
    for j in np.argsort(with_fit)[:_NEAREST]:
        if excess[j] < _CLEAR_EXCESS:
            rival = refits.best(rivals[j])
            excess[j] = max(rival.cost - own.cost, 0.0)
            in_draws = refits.squared_residuals(rival) - own_squares
            weather[:, j] = ratio_of_excess(in_draws[:, None], excess[j, None])[:, 0]
    return derivative.with_excess(excess, weather)


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

    def squared_residuals(self, fit: EffectFit) -> np.ndarray:
        """The squared residual of a fit in each draw of the weather, linear about it, `(draw,)`."""
        blocks = self.candidate.blocks(len(fit.noise.whitening))
        return LeastSquaresInOtherWeather(fit.jacobian, blocks).squared_residuals(fit.residual)

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
