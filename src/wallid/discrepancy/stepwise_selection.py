"""Which effects a record wants: from the plain model by single effects, pairs, swaps and drops."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from ..inference.noise_covariance import Noise
from .acceptance import refusal, weighed
from .cross_validation import cost_outside, held_out, windows
from .effect_fit import Fit, refit
from .findings import CHANCE as FIRST
from .findings import FURTHER, NamedEffect, Trial
from .problem import DiagnosisProblem, EffectParameters
from .residual_noise import NoiseModel, estimate_noise
from .residual_tests import omnibus_directions, test_residual
from .score_test import CandidateJacobian, Screen, candidate_jacobian, candidate_jacobian_of_forms, same, screen

RIVAL = 9.0
"""Models within this of the best in `-2 log L`, places paid for, cannot be told from it."""
_CLEAN = 0.02  # p-value of the omnibus test above which a single effect is not asked for a partner at once
_MOST_EFFECTS = 2  # where a third is wanted, what is missing is likelier none of the library
_SINGLES, _PAIRS, _RIVALS = 5, 3, 8
_FARTHEST, _FORMS, _STARTS = 3, 2, 3  # what moves the diffusivity far; an effect's other forms, its other starts
_PARTNERS = 2  # of the best single effect, as seen beside it
_NEAR = 0.35  # how far a rival's expected gain may fall short, relative, to be worth a refit
_CLOSE = 0.2  # the same for an effect in the place of one that has been fitted
_GRAIN = 1e-3  # share of what an effect explains that its own form, cells and soft edges, may leave: 3 % of its size
_ROUNDS = 4


class Selection:
    """The search in one record, and what it has tried."""

    def __init__(self, study: DiagnosisProblem):
        self.study = study
        self.random = np.random.default_rng(study.case.choices.seed)
        self.trials: list[Trial] = []
        self.rivals: list[Fit] = []
        self._outlooks: dict[frozenset[EffectParameters], CandidateJacobian] = {}
        self._fewer: dict[tuple[frozenset[EffectParameters], Noise], Fit] = {}

    def plain(self) -> Fit:
        """The plain model, under the noise that it shows beside the whole library."""
        study = self.study
        stated = NoiseModel(study, study.neutral).noise(1.0, 0.0, 0.8)
        return self.settle(refit(study, (), study.neutral, stated))

    def settle(self, fit: Fit) -> Fit:
        """The same model under the noise that it shows beside the library's and the omnibus tests' directions."""
        study = self.study
        free, gap = fit.in_kelvin()
        directions = np.concatenate([self.look(fit).columns, free.T, *omnibus_directions(fit)])
        noise = estimate_noise(NoiseModel(study, fit.theta), gap, directions)
        return refit(study, fit.active, fit.theta, noise)

    def plain_beside(self, fit: Fit) -> Fit:
        """The plain model under the noise of a better one."""
        while fit.active:
            fit = self.without(fit, fit.active[-1])
        return fit

    def screen(self, fit: Fit) -> Screen:
        """The whole library beside a fit."""
        return screen(fit, self.look(fit), self.random)

    def look(self, fit: Fit) -> CandidateJacobian:
        """The library's derivatives, made once for a set of effects: they hardly change from fit to fit."""
        effects = frozenset(fit.active)
        if effects not in self._outlooks:
            self._outlooks[effects] = candidate_jacobian(self.study, fit)
        return self._outlooks[effects]

    def without(self, fit: Fit, slot: EffectParameters) -> Fit:
        """A model less one of its effects, under the same noise; made once."""
        active = tuple(other for other in fit.active if other is not slot)
        key = (frozenset(active), fit.noise)
        if key not in self._fewer:
            theta = fit.theta.copy()
            theta[slot.first] = 0.0
            self._fewer[key] = refit(self.study, active, theta, fit.noise)
        return self._fewer[key]

    def add(self, screened: Screen, chosen: tuple[int, ...]) -> Fit:
        """The base of a screen with some of its candidates in, fitted from the linear prediction."""
        base, study = screened.base, self.study
        theta = base.theta.copy()
        for k in chosen:
            where = screened.candidates[k].where
            theta[list(where)] = list(where.values())
        active = (*base.active, *(screened.candidates[k].slot for k in chosen))
        size, move = screened.prediction(chosen)
        step = dict.fromkeys(study.free(active), 0.0)
        step |= {i: m for i, m in zip(base.free, move, strict=True) if i in step}
        for k, value in zip(chosen, size, strict=True):
            step[screened.candidates[k].slot.first] = value
        moved = dict(zip(base.free, move, strict=True))
        for error, slot in study.replaced(active):
            if slot not in base.active:
                step[slot.first] += moved.get(error, 0.0)
        made = refit(study, active, theta, base.noise, step=np.array(list(step.values())))
        if not made.cost < base.cost:  # the prediction went astray: without it the base itself is where it begins
            made = min(made, refit(study, active, theta, base.noise), key=lambda fit: fit.cost)
        self.trials.append(Trial(base, made, float(_joint_gain(screened, chosen))))
        return made

    def first(self, plain: Fit, ranked: Screen, tell: Callable[[float], None]) -> Fit:
        """The plain model, or the best of a few single effects and pairs."""
        singles, pairs = ranked.likeliest(_SINGLES), ranked.best_pairs(_PAIRS)
        top = ranked.gain.max(initial=0.0)
        single_stands = bool(singles) and ranked.p_value(top) <= FIRST
        pair_stands = bool(pairs) and ranked.pair_gain[pairs[0]] > max(
            ranked.pair_threshold(FURTHER), top + ranked.threshold(FURTHER)
        )
        if not single_stands and not pair_stands:
            return plain
        near = [k for k in singles if ranked.gain[k] >= (1 - _NEAR) * top - RIVAL]
        likely = list(dict.fromkeys([*near, *ranked.farthest(FIRST, _FARTHEST)])) if single_stands else []
        double = [pair for pair in pairs if ranked.pair_gain[pair] > top + ranked.threshold(FURTHER)]
        made: list[Fit] = []
        for count, k in enumerate(likely):
            tell(count / (len(likely) + len(double)))
            made.append(self.add(ranked, (k,)))
        best = min(made, key=lambda fit: fit.cost, default=None)
        # a pair only where one effect leaves something, which is seldom: a refit of a pair costs the most
        if pair_stands and (best is None or test_residual(best).p_value < _CLEAN):
            for count, pair in enumerate(double):
                tell((len(likely) + count) / (len(likely) + len(double)))
                made.append(self.add(ranked, pair))
            made += self._partnered(made)
        threshold = {1: ranked.threshold(FIRST), 2: ranked.threshold(FIRST) + ranked.threshold(FURTHER)}
        return self._best(plain, made, threshold)

    def _partnered(self, made: list[Fit]) -> list[Fit]:
        """The best of the single effects with what looks best beside it: refitted it may explain more."""
        best = min((fit for fit in made if len(fit.active) == 1 and self._acceptable(fit)), key=weighed, default=None)
        if best is None:
            return []
        ranked, known = self.screen(best), {frozenset(fit.active) for fit in made}
        partners = [k for k in ranked.likeliest(_PARTNERS) if {*best.active, ranked.candidates[k].slot} not in known]
        return [self.add(ranked, (k,)) for k in partners]

    def _best(self, base: Fit, made: Iterable[Fit], threshold: dict[int, float]) -> Fit:
        """The best acceptable fit by its cost and a penalty for each effect, or the base.

        It must also predict days better that it has not seen than whatever has fewer effects.
        """

        def penalised(fit: Fit) -> float:
            added = [slot for slot in fit.active if slot not in base.active]
            return weighed(fit) + threshold.get(len(added), 0.0)

        ordered = sorted((fit for fit in made if self._acceptable(fit)), key=penalised)
        for fit in ordered:
            if penalised(fit) >= weighed(base):
                break
            fewer = [base, *(other for other in ordered if len(other.active) < len(fit.active))]
            held = held_out(self.study, fit.events)
            if held is None or cost_outside(fit, held) < min(cost_outside(other, held) for other in fewer[:2]):
                return fit
            self._refuse(fit, "predicts days that it has not seen no better")
        return base

    def _refuse(self, fit: Fit, reason: str) -> None:
        for trial in self.trials:
            if trial.fit is fit:
                trial.reason = reason

    def _acceptable(self, fit: Fit) -> bool:
        """Inside its bounds, and each effect of a size worth reporting or one that moves the diffusivity."""
        reason = refusal(fit)
        self._refuse(fit, reason)
        return not reason

    def further(self, fit: Fit, tell: Callable[[float], None]) -> Fit:
        """More effects beside those found, swaps and drops, until nothing more is worth it."""
        if not fit.active:
            return fit
        fit = self.settle(fit)
        for count in range(_ROUNDS):
            tell(count / _ROUNDS)
            better = self._swap(fit)
            better = self._grow(better) if len(better.active) < _MOST_EFFECTS else better
            better = self._drop(better)
            if set(better.active) == set(fit.active):
                return better
            fit = self.settle(better)
        return fit

    def _grow(self, fit: Fit) -> Fit:
        ranked = self.screen(fit)
        tops = ranked.likeliest(2)
        threshold = self._threshold(ranked)
        made = [self.add(ranked, (k,)) for k in tops if ranked.gain[k] > threshold]
        return self._best(fit, made, {1: threshold})

    def _threshold(self, ranked: Screen) -> float:
        """What an effect beside others must explain: more than chance, and than what the others' own shape may miss."""
        return max(ranked.threshold(FURTHER), self._own_form(ranked.base))

    def _own_form(self, fit: Fit) -> float:
        """What the effects' own form may leave of what they explain."""
        return _GRAIN * (self.plain_beside(fit).cost - fit.cost)

    def _drop(self, fit: Fit) -> Fit:
        """Without an effect that the others have made needless."""
        if len(fit.active) < 2:
            return fit
        for slot in fit.active:
            less = self.without(fit, slot)
            if weighed(less) - weighed(fit) < self._threshold(self.screen(less)) and self._acceptable(less):
                return less
        return fit

    def _swap(self, fit: Fit) -> Fit:
        """The best model with one of the effects exchanged, if it is better; what comes close is kept as a rival.

        Where something is left, the effect may be there in another form, or have ended in a minimum of its own: it
        begins again at other places and times.
        """
        best, left = fit, test_residual(fit).p_value < _CLEAN
        self.rivals = []
        for slot in fit.active:
            base = self.without(fit, slot)
            ranked = self.screen(base)
            near = [k for k in ranked.likeliest(_RIVALS + 1) if ranked.gain[k] >= _comparable(base, fit)]
            near, far = (
                [k for k in found if not same(ranked.candidates[k].slot, slot)]
                for found in (near, ranked.farthest(FURTHER, _FARTHEST))
            )
            made = [self.add(ranked, (k,)) for k in dict.fromkeys([*near[:_RIVALS], *far])]
            self.rivals += made
            if left:
                made += self._forms(fit, slot, base)
                made += [self.add(ranked, (k,)) for k in ranked.places(slot)[1 : 1 + _STARTS]]
            for other in made:
                if weighed(other) < weighed(best) and self._acceptable(other):
                    best = other
        return best

    def _forms(self, fit: Fit, slot: EffectParameters, base: Fit) -> list[Fit]:
        """Other forms of an effect (placed, hourly), begun from what is known of it."""
        forms = [other for other in self.study.library if other is not slot and same(other, slot)]
        if not forms:
            return []
        sizes = {parameter.name for parameter in slot.effect.parameters if parameter.is_size}
        known = {name: value for name, value in slot.values(fit.theta).items() if name not in sizes}
        ranked = screen(base, candidate_jacobian_of_forms(self.study, base, forms, known), self.random)
        made = [self.add(ranked, (k,)) for k in ranked.best(_FORMS) if ranked.gain[k] >= _comparable(base, fit)]
        # what stood in for the right form may be needless beside it
        return [*made, *(self.without(other, partner) for other in made for partner in base.active)]

    def wanting(self, fit: Fit) -> float:
        """The p-value of what one effect more would explain, where there are as many as are looked for; else 1."""
        if len(fit.active) < _MOST_EFFECTS:
            return 1.0
        ranked = self.screen(fit)
        largest = float(ranked.gain.max(initial=0.0))
        return 1.0 if largest < self._own_form(fit) else ranked.p_value(largest)

    def named(self, fit: Fit) -> tuple[NamedEffect, ...]:
        """Each effect with its sizes, what it explains, and who else could."""
        found = []
        for slot in fit.active:
            base = self.without(fit, slot)
            ranked = self.screen(base)
            places = ranked.groups.get(slot)
            gain = base.cost - fit.cost
            expected = float(ranked.gain[places].max()) if places is not None else float("nan")
            rest = base.active
            rivals = [
                other
                for other in self.rivals
                if weighed(other) - weighed(fit) < RIVAL and set(rest) < set(other.active) and not refusal(other)
            ]
            found.append(
                NamedEffect(
                    slot,
                    {
                        p.name: (float(fit.theta[i]), fit.std(i))
                        for p, i in zip(slot.effect.parameters, slot.indices, strict=True)
                    },
                    expected,
                    gain,
                    ranked.p_value(gain),
                    tuple(next(s for s in other.active if s not in rest) for other in rivals),
                    windows(fit, slot),
                )
            )
        return tuple(sorted(found, key=lambda named: -named.gain))


def _joint_gain(screened: Screen, chosen: tuple[int, ...]) -> float:
    places = np.array(chosen)
    score = screened.score[places]
    return float(score @ np.linalg.lstsq(screened.cosine[np.ix_(places, places)], score, rcond=None)[0])


def _comparable(base: Fit, fit: Fit) -> float:
    """The expected gain over the base from which a refit may come near what the fit gains, in -2 log L."""
    return (1 - _CLOSE) * (base.cost - fit.cost) - RIVAL
