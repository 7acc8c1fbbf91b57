"""Stepwise selection of effects: forward with single effects and pairs, then exchange, addition and removal."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import islice

import numpy as np

from ..cross_validation import effect_by_window, held_out, held_out_cost
from ..effect_fit import EffectFit, refit
from ..problem import EffectParameters
from .acceptance import (
    FIRST_EFFECT_LEVEL,
    FURTHER_EFFECT_LEVEL,
    RESIDUAL_TEST_LEVEL,
    RIVAL,
    gain_by_chance,
    penalised_cost,
    reason_for_refusal,
    reason_to_neglect,
)
from .candidate_fits import CandidateFits
from .effect_results import NamedEffect
from .score_test import CandidateScores, same_effect_and_target

MAX_EFFECTS = 2
"""The largest number of effects in a model. Where a third is significant, the library probably lacks the true one."""
_PAIR_TEST_LEVEL = 0.02  # below this p-value of the omnibus test after one effect, pairs and other forms are tried
_SINGLES, _PAIRS, _RIVALS = 5, 3, 8  # candidates that are refitted: alone, as pairs, in exchange for an effect
_LARGE_SHIFTS, _FORMS, _STARTS = 3, 2, 3  # refits of candidates that shift alpha far, of other forms, other starts
_PARTNERS = 2  # candidates that are refitted together with the best single effect
_GAIN_MARGIN = 0.35  # relative error allowed for in an expected gain
_EXCHANGE_MARGIN = 0.2  # the same where one effect is exchanged for another
_MAX_ROUNDS = 4
_CLEARLY_BETTER = 0.1  # in penalised -2 log L; effects with the same equation differ by the tolerance of their fits


class StepwiseSelection:
    """The stepwise selection for one diagnosis problem.

    Args:
        fits: of the problem; the selection adds those that it tries.

    `rivals` has the fits of the last exchange, with one effect exchanged each.
    """

    def __init__(self, fits: CandidateFits):
        self.problem, self.fits = fits.problem, fits
        self.rivals: list[EffectFit] = []

    def select_first(self, plain: EffectFit, scores: CandidateScores, progress: Callable[[float], None]) -> EffectFit:
        """The best of a few single effects and pairs, or the plain model where none is significant."""
        singles, pairs = scores.best_penalised(_SINGLES), scores.best_pairs(_PAIRS)
        top = scores.gain.max(initial=0.0)
        single_significant = bool(singles) and scores.p_value(scores.weighted_gain.max()) <= FIRST_EFFECT_LEVEL
        pair_significant = bool(pairs) and scores.pair_gain[pairs[0]] > max(
            scores.pair_threshold(FURTHER_EFFECT_LEVEL), top + scores.threshold(FURTHER_EFFECT_LEVEL)
        )
        if not single_significant and not pair_significant:
            return plain
        single: list[int] = []
        if single_significant:
            near = [k for k in singles if scores.gain[k] >= (1 - _GAIN_MARGIN) * top - RIVAL]
            surest = int(np.argmax(scores.weighted_gain))
            single = list(dict.fromkeys([*near, surest, *scores.largest_shifts(FIRST_EFFECT_LEVEL, _LARGE_SHIFTS)]))
        double = [pair for pair in pairs if scores.pair_gain[pair] > top + scores.threshold(FURTHER_EFFECT_LEVEL)]
        fits: list[EffectFit] = []
        for count, k in enumerate(single):
            progress(count / (len(single) + len(double)))
            fits.append(self.fits.add_candidates(scores, (k,)))
        best = min(fits, key=lambda fit: fit.cost, default=None)
        # pairs only where a single effect leaves a significant residual, which is rare: a refit of a pair costs most
        if pair_significant and (best is None or self.fits.residual_tests(best).p_value < _PAIR_TEST_LEVEL):
            for count, pair in enumerate(double):
                progress((len(single) + count) / (len(single) + len(double)))
                fits.append(self.fits.add_candidates(scores, pair))
            fits += self._pairs_with_best_single(fits)

        def threshold(added: tuple[EffectParameters, ...]) -> float:
            if len(added) == 1:
                return scores.threshold(FIRST_EFFECT_LEVEL, scores.weight_of(added[0]))
            return gain_by_chance(scores.threshold, len(added))

        return self._best(plain, fits, threshold)

    def _pairs_with_best_single(self, fits: list[EffectFit]) -> list[EffectFit]:
        """Fits of the best single effect with the best candidates beside it, scored after its refit."""
        singles = [fit for fit in fits if len(fit.active) == 1 and self.fits.acceptable(fit)]
        if not singles:
            return []
        best = min(singles, key=penalised_cost)
        scores, known = self.fits.score_candidates(best), {frozenset(fit.active) for fit in fits}
        partners = [k for k in scores.best_penalised(_PARTNERS) if {*best.active, scores.effect(k)} not in known]
        return [self.fits.add_candidates(scores, (k,)) for k in partners]

    def _best(
        self, base: EffectFit, fits: Iterable[EffectFit], threshold: Callable[[tuple[EffectParameters, ...]], float]
    ) -> EffectFit:
        """The accepted fit with the lowest penalised cost, or the base.

        It must also predict the days held out better than the fits with fewer effects.

        Args:
            base: the fit without the added effects.
            fits: fits with effects added.
            threshold: gain of `-2 log L` that some added effects must exceed.
        """

        def penalised(fit: EffectFit) -> float:
            added = tuple(effect for effect in fit.active if effect not in base.active)
            return penalised_cost(fit) + (threshold(added) if added else 0.0)

        ordered = sorted((fit for fit in fits if self.fits.acceptable(fit)), key=penalised)
        for fit in ordered:
            if penalised(fit) >= penalised_cost(base):
                break
            fewer = [base, *(other for other in ordered if len(other.active) < len(fit.active))]
            rows = held_out(self.problem, fit.events)
            if rows is None or held_out_cost(fit, rows) < min(held_out_cost(other, rows) for other in fewer[:2]):
                return fit
            self.fits.set_reason(fit, "does not predict the days held out better")
        return base

    def select_further(self, fit: EffectFit, progress: Callable[[float], None]) -> EffectFit:
        """Exchange, add and remove effects until the set of effects stays the same.

        Where these effects leave a significant residual, pairs that start from other single effects are tried too: two
        wrong effects may be better than each pair with one of them and one right effect. At last effects are left out
        that are too small to be reported.
        """
        removed = set[EffectParameters]()
        fit = self._until_stable(fit, removed, lambda share: progress(0.6 * share))
        other = self._pair_from_another_single(fit)
        if other is not fit:
            fit = self._until_stable(other, removed, lambda share: progress(0.6 + 0.4 * share))
        while (smaller := self._without_negligible(fit)) is not fit:
            removed |= {*fit.active} - {*smaller.active}
            fit = self._until_stable(smaller, removed, progress)
        return fit

    def _without_negligible(self, fit: EffectFit) -> EffectFit:
        """The fit without an effect that need not be reported, or the fit itself.

        The other effects have to be significant without it.
        """
        negligible = next((one for one in fit.active if self._is_negligible(fit, one)), None)
        if negligible is None:
            return fit
        base = self.fits.without(fit, negligible)
        unneeded = next((one for one in base.active if not self._is_significant(base, one)), None)
        return base if unneeded is None else self.fits.without(base, unneeded)

    def _is_negligible(self, fit: EffectFit, effect_parameters: EffectParameters) -> bool:
        """Whether an effect is too small to be reported, and its absence changes no conclusion.

        It does where the residual shows that the effect is missing, and where an effect that would be reported explains
        the record nearly as well.
        """
        if not reason_to_neglect(fit, effect_parameters):
            return False
        base = self.fits.without(fit, effect_parameters)
        rivals = self._close_rivals(fit, base)
        if any(not reason_to_neglect(other, added_effect(other, base)) for other in rivals):
            return False
        return self.fits.residual_tests(base).p_value >= RESIDUAL_TEST_LEVEL

    def _close_rivals(self, fit: EffectFit, base: EffectFit) -> list[EffectFit]:
        """The fits with another effect in the place of the one that a base lacks, which explain the record as well.

        One that ends at a bound explains it nearly as well inside, so it is not excluded: heat behind the last sensor
        goes up to the face, where it is an offset of the face.
        """
        exchanged = (other for other in self.rivals if _has_one_more(other, base))
        close = (other for other in exchanged if penalised_cost(other) - penalised_cost(fit) < RIVAL)
        return [other for other in close if other.at_bound or not reason_for_refusal(other)]

    def _pair_from_another_single(self, fit: EffectFit) -> EffectFit:
        """The best pair that contains one of the best single effects; the fit itself where none is better.

        Pairs are tried in the order of their expected cost, until one leaves no significant residual.
        """
        singles = {trial.fit.active: trial.fit for trial in self.fits.trials if len(trial.fit.active) == 1}
        if not singles or self.fits.residual_tests(fit).p_value >= _PAIR_TEST_LEVEL:
            return fit
        of_plain = self.fits.score_candidates(self.fits.plain_model_with_noise_of(fit))

        def price(one: EffectFit) -> float:
            """The penalised cost, with the gain that chance gives to as many effects."""
            return penalised_cost(one) + gain_by_chance(of_plain.threshold, len(one.active))

        expected: dict[frozenset[EffectParameters], tuple[float, CandidateScores, int]] = {}
        for single in sorted(singles.values(), key=penalised_cost)[:_SINGLES]:
            scores = self.fits.score_candidates(refit(self.problem, single.active, single.parameters, fit.noise))
            for k in scores.best_penalised(_RIVALS):
                pair, cost = frozenset({*single.active, scores.effect(k)}), scores.base.cost - scores.gain[k]
                if pair != set(fit.active) and cost < expected.get(pair, (np.inf,))[0]:
                    expected[pair] = (cost, scores, k)
        best = fit
        for _, scores, k in sorted(expected.values(), key=lambda one: one[0])[:_RIVALS]:
            other = self.fits.add_candidates(scores, (k,))
            if price(other) < price(best) - _CLEARLY_BETTER and self.fits.acceptable(other):
                rows = held_out(self.problem, other.events)
                if rows is None or held_out_cost(other, rows) < held_out_cost(best, rows):
                    best = other
                    if self.fits.residual_tests(best).p_value >= _PAIR_TEST_LEVEL:
                        break
        return best

    def _until_stable(
        self, fit: EffectFit, removed: set[EffectParameters], progress: Callable[[float], None]
    ) -> EffectFit:
        """Exchange, add and remove effects until the set of effects stays the same.

        With the noise estimated again, an effect that was added may not be needed. Once removed, it is not added again.
        """
        if not fit.active:
            return fit
        fit, removed = self.fits.refit_with_estimated_noise(fit), removed.copy()
        for count in range(_MAX_ROUNDS):
            progress(count / _MAX_ROUNDS)
            new = self._exchange(fit)
            larger = self._add_one(new, removed) if len(new.active) < MAX_EFFECTS else new
            new = self._remove_one(larger)
            if set(new.active) == set(fit.active):
                return new
            if len(new.active) < max(len(larger.active), len(fit.active)):
                removed |= {*fit.active, *larger.active} - set(new.active)
            fit = self.fits.refit_with_estimated_noise(new)
        return fit

    def _add_one(self, fit: EffectFit, removed: set[EffectParameters]) -> EffectFit:
        scores = self.fits.score_candidates(fit)
        best = (k for k in scores.best_penalised(2 + len(removed)) if scores.effect(k) not in removed)
        significant = (k for k in islice(best, 2) if scores.gain[k] > self._threshold(scores, scores.effect(k)))
        fits = [self.fits.add_candidates(scores, (k,)) for k in significant]
        return self._best(fit, fits, lambda added: self._threshold(scores, added[0]))

    def _threshold(self, scores: CandidateScores, effect: EffectParameters) -> float:
        """The gain that a further effect must exceed: of chance, and of the model error of the other effects."""
        by_chance = scores.threshold(FURTHER_EFFECT_LEVEL, scores.weight_of(effect))
        return max(by_chance, self.fits.model_error_allowance(scores.base))

    def _remove_one(self, fit: EffectFit) -> EffectFit:
        """The fit without an effect that is not significant beside the others."""
        if len(fit.active) < 2:
            return fit
        for effect_parameters in fit.active:
            reduced = self.fits.without(fit, effect_parameters)
            if not self._is_significant(fit, effect_parameters) and self.fits.acceptable(reduced):
                return reduced
        return fit

    def _is_significant(self, fit: EffectFit, effect_parameters: EffectParameters) -> bool:
        """Whether an effect of a fit gains more than chance and the model error of its others give."""
        reduced = self.fits.without(fit, effect_parameters)
        threshold = self._threshold(self.fits.score_candidates(reduced), effect_parameters)
        return penalised_cost(reduced) - penalised_cost(fit) >= threshold

    def _exchange(self, fit: EffectFit) -> EffectFit:
        """The best fit with one of the effects exchanged, or the fit itself; the others are kept as rivals.

        Where the omnibus test rejects the fit, an effect may have another form, or its fit may have ended in a local
        minimum: other forms, and other positions and times to start from, are tried too.
        """
        best, rejected = fit, self.fits.residual_tests(fit).p_value < _PAIR_TEST_LEVEL
        self.rivals = []
        for effect_parameters in fit.active:
            base = self.fits.without(fit, effect_parameters)
            scores = self.fits.score_candidates(base)
            near = [k for k in scores.best_penalised(_RIVALS + 1) if scores.gain[k] >= _comparable(base, fit)]
            near, far = (
                [k for k in chosen if not same_effect_and_target(scores.effect(k), effect_parameters)]
                for chosen in (near, scores.largest_shifts(FURTHER_EFFECT_LEVEL, _LARGE_SHIFTS))
            )
            fits = [self.fits.add_candidates(scores, (k,)) for k in dict.fromkeys([*near[:_RIVALS], *far])]
            self.rivals += fits
            if rejected:
                fits += self._other_forms(fit, effect_parameters, base)
                starts = scores.candidates_of(effect_parameters)[1 : 1 + _STARTS]
                fits += [self.fits.add_candidates(scores, (k,)) for k in starts]
            for other in fits:
                special = best is fit and _is_special_case(other, base, effect_parameters)
                least_gain = -_CLEARLY_BETTER if special else _CLEARLY_BETTER
                if penalised_cost(other) < penalised_cost(best) - least_gain and self.fits.acceptable(other):
                    best = other
        return best

    def _other_forms(self, fit: EffectFit, effect_parameters: EffectParameters, base: EffectFit) -> list[EffectFit]:
        """Fits of other forms of an effect (placed, hourly), started from its fitted positions and hours."""
        same = [other for other in self.problem.library if same_effect_and_target(other, effect_parameters)]
        forms = [other for other in same if other is not effect_parameters]
        if not forms:
            return []
        sizes = {parameter.name for parameter in effect_parameters.effect.parameters if parameter.is_size}
        known = {name: value for name, value in effect_parameters.values(fit.parameters).items() if name not in sizes}
        scores = self.fits.score_effects(base, forms, known)
        chosen = [k for k in scores.best(_FORMS) if scores.gain[k] >= _comparable(base, fit)]
        fits = [self.fits.add_candidates(scores, (k,)) for k in chosen]
        # an effect that replaced the right form may not be needed beside it
        return [*fits, *(self.fits.without(other, partner) for other in fits for partner in base.active)]

    def p_value_of_one_more(self, fit: EffectFit) -> float:
        """The p-value of one effect more, where the fit has the largest number allowed; else 1."""
        if len(fit.active) < MAX_EFFECTS:
            return 1.0
        scores = self.fits.score_candidates(fit)
        if scores.gain.max(initial=0.0) < self.fits.model_error_allowance(fit):
            return 1.0
        return scores.p_value(float(scores.weighted_gain.max(initial=0.0)))

    def named_effects(self, fit: EffectFit) -> tuple[NamedEffect, ...]:
        """Each effect of a fit with its parameters, its gain and its rivals, largest gain first."""
        named_effects = []
        for effect_parameters in fit.active:
            base = self.fits.without(fit, effect_parameters)
            scores = self.fits.score_candidates(base)
            indices = scores.by_effect.get(effect_parameters)
            gain = base.cost - fit.cost
            expected = float(scores.gain[indices].max()) if indices is not None else float("nan")
            values = {
                key: (float(fit.parameters[name]), fit.std(name)) for key, name in effect_parameters.full_names.items()
            }
            exchanged = [other for other in self.rivals if _has_one_more(other, base)]
            others = (added_effect(other, base) for other in self._close_rivals(fit, base))
            alternatives = tuple(dict.fromkeys(other for other in others if other is not effect_parameters))
            named_effects.append(
                NamedEffect(
                    effect_parameters,
                    values,
                    expected,
                    gain,
                    scores.p_value(gain, scores.weight_of(effect_parameters)),
                    alternatives,
                    effect_by_window(fit, effect_parameters),
                    base,
                    tuple(exchanged),
                )
            )
        return tuple(sorted(named_effects, key=lambda named: -named.gain))


def _is_special_case(fit: EffectFit, base: EffectFit, effect: EffectParameters) -> bool:
    """Whether a fit has a special case of an effect in its place, which is named where both explain a record alike."""
    return _has_one_more(fit, base) and added_effect(fit, base).effect.is_special_case_of(effect.effect)


def _has_one_more(fit: EffectFit, base: EffectFit) -> bool:
    """Whether a fit has the effects of a base and one more."""
    return len(fit.active) == len(base.active) + 1 and set(base.active) < set(fit.active)


def added_effect(fit: EffectFit, base: EffectFit) -> EffectParameters:
    """The effect of a fit that a base does not have."""
    return next(effect for effect in fit.active if effect not in base.active)


def _comparable(base: EffectFit, fit: EffectFit) -> float:
    """The expected gain in `-2 log L` over the base from which a refit may be comparable with the fit."""
    return (1 - _EXCHANGE_MARGIN) * (base.cost - fit.cost) - RIVAL
