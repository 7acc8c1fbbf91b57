"""The data and the verdict of the search for a missing effect."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...case.mixups import Mixup
from ...estimation.heat_flux import transmittance
from ...estimation.unknown_heat import UnknownHeat
from ...inference.physical_bounds import clip_to_physical
from ...inference.quantity import Quantity
from ..cross_validation import Gap
from ..effect_fit import EffectFit
from ..heterogeneity.heterogeneity import Heterogeneity
from ..next_measurement.actions import Prescription
from ..problem import DiagnosisProblem, EffectParameters
from ..residual_tests import ResidualTests, run_residual_tests
from ..selection.acceptance import (
    FIRST_EFFECT_LEVEL,
    RESIDUAL_TEST_LEVEL,
    reason_for_refusal,
    reason_to_neglect,
)
from ..selection.effect_results import NamedEffect, RankedEffect, Trial
from ..selection.score_test import CandidateScores
from ..unexplained_heat import UnexplainedHeat
from .wall_properties import DIFFUSIVITY, RESISTANCE, WallProperty, wall_properties

_SIMILAR_COSINE = 0.95  # from this cosine of two derivatives on, two effects count as similar
_HELD_OUT_VARIANCE_RATIO = 2.0  # largest mean square on the days held out over the noise variance
_CLEAR_GAIN_RATIO = 3.0  # gain over the chance gain from which a rejected trial makes the diagnosis incomplete
_AT_BOUND = 1.001  # ratio of a diffusivity to a bound of the search, up to which it is at the bound
_DETECTABLE_GAIN = 9.0  # drop of -2 log L of an effect of three standard deviations


class ShownModel(NamedTuple):
    """A model as figures show it: its label, its fit, and the tests of its residual."""

    label: str
    fit: EffectFit
    tests: ResidualTests


@dataclass(frozen=True, eq=False)
class Findings:
    """The data of a diagnosis, and the verdict that follows from them.

    Args:
        problem: the case prepared for the search.
        plain: the estimate with the plain model, the noise estimated from its own residual (`wallid.estimate`).
        before: the fit of the plain model with the noise of `after`, which the effects are compared with.
        after: the fit with the named effects.
        effects: the named effects, largest gain first.
        scores: the score test of the entire library against the plain model.
        trials: every fit that was tried.
        gap: root mean squares of the residuals of both fits.
        residual_tests_before: residual tests of `before`.
        residual_tests_after: residual tests of `after`.
        p_value_of_one_more: p-value of one effect more where `effects` has the largest number allowed, else 1.
        rivals: fits with one effect exchanged.
        mixups: mistakes in the case, with whose correction all of the above was computed.
        uncorrected: the estimate with the plain model before the correction; None where there was none.
        prescriptions: what to measure next, for each question that the record leaves open.
        unexplained: heat that would explain the residual of `final`; sought where no test shows anything else.
        unknown_heat: the course of the heat that would explain what no known effect does; None where nothing is left.
        heterogeneity: the pattern of the case's section as the record shows it; None without a section.
        other_wall: the findings in the homogeneous wall, or in the section where that is contradicted; None without a
            section.
    """

    problem: DiagnosisProblem = field(repr=False)
    plain: EffectFit = field(repr=False)
    before: EffectFit = field(repr=False)
    after: EffectFit = field(repr=False)
    effects: tuple[NamedEffect, ...]
    scores: CandidateScores = field(repr=False)
    trials: tuple[Trial, ...] = field(repr=False)
    gap: Gap
    residual_tests_before: ResidualTests = field(repr=False)
    residual_tests_after: ResidualTests = field(repr=False)
    p_value_of_one_more: float
    rivals: tuple[EffectFit, ...] = field(repr=False)
    mixups: tuple[Mixup, ...] = ()
    uncorrected: EffectFit | None = field(default=None, repr=False)
    prescriptions: tuple[Prescription, ...] = field(default=(), repr=False)
    unexplained: UnexplainedHeat | None = field(default=None, repr=False)
    unknown_heat: UnknownHeat | None = field(default=None, repr=False)
    heterogeneity: Heterogeneity | None = None
    other_wall: Findings | None = field(default=None, repr=False)

    @property
    def final(self) -> EffectFit:
        """The fit of the reported diffusivity: with the named effects, or the plain estimate where there is none."""
        return self.after if self.effects else self.plain

    @property
    def verdict(self) -> str:
        """`adequate`, `named`, `confusable`, `unnamed` or `uninformative`."""
        if self.uninformative:
            return "uninformative"
        if self.incomplete:
            return "unnamed"
        if not self.effects:
            found = self.mixups or self.shows_heterogeneity
            return "confusable" if self._walls_differ else "named" if found else "adequate"
        ambiguous = self._walls_differ or any(named.alternatives for named in self.effects)
        return "confusable" if ambiguous else "named"

    @property
    def undecided_wall(self) -> Findings | None:
        """The findings in the other wall, where the record tells neither the section nor a homogeneous wall."""
        found = self.heterogeneity
        return None if found is None or found.is_clear or found.is_contradicted else self.other_wall

    @property
    def _walls_differ(self) -> bool:
        """Whether the record tells neither wall, and other effects are named in the other one."""
        names = [{self.problem.label(one.effect_parameters.effect) for one in found.effects}
                 for found in (self, self.undecided_wall or self)]  # fmt: skip
        return names[0] != names[1]

    @cached_property
    def uninformative(self) -> str:
        """Why the record does not determine the diffusivity, whatever is missing; empty where it does."""
        (low, high), largest = self.interval_95, self.problem.case.choices.largest_interval_factor
        lowest, highest = self.problem.diffusivity_bounds
        if not lowest * _AT_BOUND < self.final.diffusivity < highest / _AT_BOUND:
            return f"the estimate is at a bound of what this record can distinguish, {self.final.diffusivity:.2g} m2/s"
        if high / low > largest:
            return f"its 95 % interval, {low:.2g} to {high:.2g} m2/s, has a ratio of {high / low:.3g}, over {largest:g}"
        return ""

    @cached_property
    def incomplete(self) -> str:
        """Why the named effects do not explain the entire model error; empty where they do."""
        if self.residual_tests_after.p_value < RESIDUAL_TEST_LEVEL:
            p = self.residual_tests_after.p_value
            return f"{self._named_labels}the omnibus test still rejects the model (p = {p:.1g})"
        if self.p_value_of_one_more < RESIDUAL_TEST_LEVEL:
            p = self.p_value_of_one_more
            return f"{self._named_labels}a third effect would explain more than chance alone gives (p = {p:.1g})"
        for named in self.effects:
            if named.windows.p_value < RESIDUAL_TEST_LEVEL:
                label, p = self.problem.label(named.effect_parameters.effect), named.windows.p_value
                return f"the best candidate, {label}, has a different size at different times (p = {p:.1g})"
        if self._rejected:
            best = max(self._rejected, key=lambda trial: trial.gain)
            labels = " and ".join(self.problem.label(added.effect) for added in best.added_effects)
            return (
                f"{labels} would lower -2 log L by {best.gain:.0f}, where chance alone gives {self._chance_gain:.0f}, "
                f"but was rejected: {best.reason}"
            )
        if self._predicts_held_out_badly:
            after, floor = self.gap.held_out_after, self.gap.noise_floor
            return (
                f"{self._named_labels}the error on the days held out is still {after:.3g} {self.gap.unit}, "
                f"where noise alone gives {floor:.3g} {self.gap.unit}"
            )
        if self.heat_left is not None:
            disturbance = self.heat_left.disturbance
            return f"{self._named_labels}what looks like noise that lasts for hours is rather {disturbance}"
        return ""

    @property
    def estimate_before(self) -> EffectFit:
        """The estimate before a correction, or of the homogeneous wall where the record shows it to be none."""
        shown = self.other_wall if self.shows_heterogeneity else None
        return self.uncorrected or (self.plain if shown is None else shown.plain)

    @property
    def shows_heterogeneity(self) -> bool:
        """Whether the record shows the pattern of the case's section."""
        return self.heterogeneity is not None and self.heterogeneity.is_clear

    @cached_property
    def shown_models(self) -> tuple[ShownModel, ...]:
        """The model to begin with, and the final one where it is another: with effects, or with a section."""
        plain = ShownModel("plain model", self.before, self.residual_tests_before)
        if self.other_wall is not None and self.shows_heterogeneity:
            homogeneous = self.other_wall.plain
            first = ShownModel("homogeneous wall", homogeneous, run_residual_tests(homogeneous))
            plain = plain._replace(label="with the section")
        else:
            first = plain
        if not self.after.active:
            return (first,) if first is plain else (first, plain)
        refused, nearest = (", refused", "nearest ") if self.incomplete else ("", "")
        label = f"with the {nearest}effect{'s' if len(self.effects) > 1 else ''}{refused}"
        return first, ShownModel(label, self.after, self.residual_tests_after)

    @property
    def heat_left(self) -> UnexplainedHeat | None:
        """Heat that explains the residual far better than noise with a memory does."""
        return self.unexplained if self.unexplained is not None and self.unexplained.is_clear else None

    @property
    def _predicts_held_out_badly(self) -> bool:
        """Whether the error on the days held out exceeds that of the noise, whose variance is uncertain."""
        held_out, noise = self.gap.held_out_after, self.after.noise
        if held_out is None:
            return False
        return bool(
            (held_out / self.gap.noise_floor) ** 2 > _HELD_OUT_VARIANCE_RATIO * np.exp(2.0 * noise.log_power_std)
        )

    @property
    def _chance_gain(self) -> float:
        """The gain over the plain model that chance alone gives with probability `FIRST_EFFECT_LEVEL`."""
        return self.scores.threshold(FIRST_EFFECT_LEVEL)

    @cached_property
    def _rejected(self) -> list[Trial]:
        """The trials that gain far more than chance gives but were rejected; none where an effect was named.

        They ended at a bound, or do not predict the days held out. Sizes that may be zero are not among them.
        """
        if self.effects:
            return []
        return [
            trial
            for trial in self.trials
            if trial.reason
            and not trial.base.active
            and trial.gain > _CLEAR_GAIN_RATIO * self._chance_gain
            and (trial.fit.at_bound or not reason_for_refusal(trial.fit))
        ]

    @property
    def _named_labels(self) -> str:
        labels = " and ".join(self.problem.label(named.effect_parameters.effect) for named in self.effects)
        return f"beside {labels} " if labels else ""

    @cached_property
    def interval_95(self) -> tuple[float, float]:
        """95 % interval of the diffusivity, m2/s; see `interval_of`."""
        return self.interval_of(DIFFUSIVITY)

    def interval_of(self, one: WallProperty) -> tuple[float, float]:
        """95 % interval of a property of the wall: spans all alternatives, wider where a model error remains."""
        low, high = one.of(self.final).interval_95
        rivals = [fit for fit in self.rivals if any(effect in fit.active for effect in self._alternatives)]
        ends = [low, high, *(end for fit in rivals for end in one.of(fit).interval_95)]
        if self.undecided_wall is not None:
            ends += self.undecided_wall.interval_of(one)
        if self.heat_left is not None:
            ends += one.of(self.heat_left.fit_beside).interval_95
        low, high = min(ends), max(ends)
        if self.incomplete:
            rejected = [end for trial in self._rejected for end in one.of(trial.fit).interval_95]
            low, high = min([low, *rejected]), max([high, *rejected])
            # as if the remaining model error were noise of that size
            tests, gap = self.residual_tests_after, self.gap
            error = max(gap.after, gap.held_out_after or 0.0)
            factor = max(1.0, error / gap.noise_floor, np.sqrt(tests.statistic / tests.degrees_of_freedom))
            centre, plain = one.value(self.final), one.value(self.plain)
            low, high = centre * (low / centre) ** factor, centre * (high / centre) ** factor
            low, high = min(low, plain), max(high, plain)
        return clip_to_physical(float(low), float(high), one.unit)

    @cached_property
    def quantities(self) -> dict[str, Quantity]:
        """The properties of the wall with the named effects in the model, by their names in result.json.

        With plates the transmittance follows from the resistance, with the standard surface resistances of ISO 6946.
        """
        found = {}
        for one in wall_properties(self.final):
            found[one.name] = replace(one.of(self.final), interval_95=self.interval_of(one))
        if RESISTANCE.name in found:
            found["transmittance"] = transmittance(found[RESISTANCE.name])
        return found

    @property
    def _alternatives(self) -> list[EffectParameters]:
        return [effect_parameters for named in self.effects for effect_parameters in named.alternatives]

    def smallest_detectable(self) -> dict[str, float]:
        """The smallest size of each effect that this record would have shown, in its unit, by the effect's label."""
        scores = self.scores

        def needed(effect_parameters: EffectParameters) -> float:
            return max(_DETECTABLE_GAIN, scores.threshold(0.05, scores.weight_of(effect_parameters))) ** 0.5

        return {
            self.problem.label(effect_parameters.effect): needed(effect_parameters) / float(scores.norm[indices].max())
            for effect_parameters, indices in scores.by_effect.items()
        }

    @cached_property
    def table(self) -> tuple[RankedEffect, ...]:
        """Every effect of the library against the plain model, largest expected gain first."""
        scores, problem = self.scores, self.problem
        tried = {
            trial.added_effects[0]: trial
            for trial in self.trials
            if len(trial.added_effects) == 1 and not trial.base.active
        }
        rows = []
        for index in scores.best(len(scores.by_effect)):
            effect_parameters = scores.candidates[index].effect_parameters
            trial = tried.get(effect_parameters)
            rivals = _similar_effects(scores, index)
            rows.append(
                RankedEffect(
                    effect_parameters,
                    problem.label(effect_parameters.effect),
                    float(scores.gain[index]),
                    None if trial is None else trial.gain,
                    float(scores.size[index]),
                    float(1.0 / scores.norm[index]),
                    effect_parameters.effect.parameters[0].unit,
                    float(np.expm1(scores.shift[index])),
                    tuple(problem.label(other.effect) for other in rivals),
                    self._reason(effect_parameters, index, trial),
                )
            )
        return tuple(rows)

    def _reason(self, effect_parameters: EffectParameters, index: int, trial: Trial | None) -> str:
        """Why an effect is in the model or not."""
        nearest = "the nearest known effect" if self.incomplete else "the effect in the model"
        if effect_parameters in [named.effect_parameters for named in self.effects]:
            return "the nearest known effect, refused" if self.incomplete else "in the model"
        if effect_parameters in self._alternatives:
            return f"cannot be distinguished from {nearest}"
        if trial is not None and (reason := trial.reason or reason_to_neglect(trial.fit, effect_parameters)):
            return reason
        if self.scores.gain[index] == 0.0:
            return "its size has the wrong sign"
        if self.scores.p_value(self.scores.weighted_gain[index]) > FIRST_EFFECT_LEVEL:
            return "no more than chance alone gives"
        if not self.effects:
            return "does not explain the residual"
        return f"explained by {nearest}"


def _similar_effects(scores: CandidateScores, index: int) -> list[EffectParameters]:
    """The other effects whose derivative is nearly parallel to that of a candidate, most similar first."""
    cosine = np.abs(scores.cosine[index])
    similar = [k for k in np.argsort(-cosine) if cosine[k] >= _SIMILAR_COSINE]
    effects = dict.fromkeys(scores.candidates[k].effect_parameters for k in similar)
    return [effect for effect in effects if effect is not scores.candidates[index].effect_parameters]
