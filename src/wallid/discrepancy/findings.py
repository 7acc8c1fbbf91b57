"""What the search found: one record from which every table, figure and result.json derives."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from .acceptance import refusal
from .cross_validation import Gap, Windows
from .effect_fit import Fit
from .problem import DiagnosisProblem, EffectParameters
from .residual_tests import ResidualTests
from .result_entries import result
from .score_test import Screen
from .summary import sentence, summary

LEFT_OVER = 1e-3
"""How often chance may make one test say that something is left; a right name is asked some five."""
FURTHER = 0.01
"""How often chance may make a further effect, or a pair where no single effect stands out."""
CHANCE = 0.03
"""Over the whole library: above it, a gain is no more than chance makes."""
_ALIKE = 0.95  # cosine from which two effects look alike
_FORETOLD = 2.0  # times the noise's variance, that a model may leave on days held out
_PLAIN_TO_SEE = 3.0  # times the gain that chance makes in the whole library
_CLEAR = 9.0  # of -2 log L: the size that would have been told apart from none


@dataclass
class Trial:
    """A fit that was tried.

    Args:
        base: what it was tried beside. expected: the drop of `-2 log L` that the screen promised.
        reason: why it was refused; empty where it was not.
    """

    base: Fit
    fit: Fit
    expected: float
    reason: str = ""

    @property
    def gain(self) -> float:
        """The drop of `-2 log L`."""
        return self.base.cost - self.fit.cost

    @property
    def added(self) -> tuple[EffectParameters, ...]:
        """What it added."""
        return tuple(slot for slot in self.fit.active if slot not in self.base.active)


@dataclass(frozen=True, eq=False)
class NamedEffect:
    """An effect that was found.

    Args:
        values: of each parameter: (value, standard deviation).
        expected, gain: drop of `-2 log L`, by the screen's linear prediction and by the refit.
        p_value: of the gain, over the whole library.
        alternatives: effects that this record cannot tell from it.
        windows: its size in each quarter of the record.
    """

    slot: EffectParameters
    values: dict[str, tuple[float, float]]
    expected: float
    gain: float
    p_value: float
    alternatives: tuple[EffectParameters, ...]
    windows: Windows


@dataclass(frozen=True, eq=False)
class RankedEffect:
    """An effect in the ranked table, beside the plain model.

    Args:
        expected, gain: drop of `-2 log L`, by the linear prediction and after a refit (None where none was made).
        size, std: in `unit`. shift: relative change of the diffusivity.
        rivals: effects whose trace in this record is nearly the same.
        reason: why it is in the model or not.
    """

    slot: EffectParameters
    label: str
    expected: float
    gain: float | None
    size: float
    std: float
    unit: str
    shift: float
    rivals: tuple[str, ...]
    reason: str

    def __str__(self) -> str:
        gain = "" if self.gain is None else f"{self.gain:.0f}"
        size = f"{self.size:.3g} +- {self.std:.1g} {self.unit}".rstrip()
        like = f" (like {', '.join(self.rivals[:2])})" if self.rivals else ""
        numbers = f"{self.expected:8.0f} {gain:>7}  {size:<28} {100 * self.shift:+6.1f} %"
        return f"{self.label:<36} {numbers}  {self.reason}{like}"


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What the plain model misses in a record.

    Args:
        before, after: the plain model and the one with the effects in.
        effects: that were found, the largest gain first.
        screen: the whole library beside the plain model.
        trials: every fit that was tried.
        rivals: fits that come close to `after`.
        left_before, left_after: where the two models and the readings part.
        wanting: p-value of what one effect more than are looked for would explain; 1 where there are fewer.
    """

    study: DiagnosisProblem = field(repr=False)
    before: Fit = field(repr=False)
    after: Fit = field(repr=False)
    effects: tuple[NamedEffect, ...]
    screen: Screen = field(repr=False)
    trials: tuple[Trial, ...] = field(repr=False)
    gap: Gap
    left_before: ResidualTests = field(repr=False)
    left_after: ResidualTests = field(repr=False)
    wanting: float
    rivals: tuple[Fit, ...] = field(repr=False)

    @property
    def verdict(self) -> str:
        """`adequate`, `named`, `confusable`, `unnamed` or `uninformative`; see `__str__` for the sentence."""
        if self.incomplete:
            return "unnamed"
        low, high = self.interval_95
        if high / low > self.study.case.choices.largest_interval_factor:
            return "uninformative"
        if not self.effects:
            return "adequate"
        return "confusable" if any(named.alternatives for named in self.effects) else "named"

    @cached_property
    def incomplete(self) -> str:
        """Why what was found is not all that is missing, and no name stands; empty where nothing says so."""
        if self.left_after.p_value < LEFT_OVER:
            return f"{self._added}the omnibus test still finds something (p = {self.left_after.p_value:.1g})"
        if self.wanting < LEFT_OVER:
            return f"{self._added}a third would still explain more than chance does (p = {self.wanting:.1g})"
        for named in self.effects:
            if named.windows.p_value < LEFT_OVER:
                label, p = self.study.label(named.slot.effect), named.windows.p_value
                return f"the best name, {label}, would have another size at another time (p = {p:.1g})"
        if self._refused:
            likeliest = max(self._refused, key=lambda trial: trial.gain)
            labels = " and ".join(self.study.label(slot.effect) for slot in likeliest.added)
            return (
                f"{labels} would explain {likeliest.gain:.0f} of -2 log L, where chance makes {self._by_chance:.0f}, "
                f"and was refused: {likeliest.reason}"
            )
        if self._foretold_badly:
            after, floor = self.gap.held_out_after, self.gap.floor
            return f"{self._added}days held out are still missed by {after:.3g} K, where noise leaves {floor:.3g} K"
        return ""

    @property
    def _foretold_badly(self) -> bool:
        """Whether the model leaves more on days held out than noise does, as far as its power is known."""
        held_out, noise = self.gap.held_out_after, self.after.noise
        if held_out is None:
            return False
        return bool((held_out / self.gap.floor) ** 2 > _FORETOLD * np.exp(2.0 * noise.spread))

    @property
    def _by_chance(self) -> float:
        """The gain that chance seldom makes beside the plain model."""
        return self.screen.threshold(CHANCE)

    @cached_property
    def _refused(self) -> list[Trial]:
        """What explains far more of the plain model's misfit than chance does, and may not stand all the same.

        It ended at a bound, or does not foretell days held out; an effect too small to report is no such thing.
        Nothing once an effect was found.
        """
        if self.effects:
            return []
        return [
            trial
            for trial in self.trials
            if trial.reason
            and not trial.base.active
            and trial.gain > _PLAIN_TO_SEE * self._by_chance
            and (trial.fit.at_bound or not refusal(trial.fit))
        ]

    @property
    def _added(self) -> str:
        labels = " and ".join(self.study.label(named.slot.effect) for named in self.effects)
        return f"beside {labels} " if labels else ""

    @cached_property
    def interval_95(self) -> tuple[float, float]:
        """Of the diffusivity, m2/s: spanning every rival; widened where something unnamed is left."""
        low, high = self.after.interval_95
        near = [fit for fit in self.rivals if any(slot in fit.active for slot in self._alternatives)]
        ends = [low, high, *(end for fit in near for end in fit.interval_95)]
        low, high = min(ends), max(ends)
        if self.incomplete:
            doubted = [end for trial in self._refused for end in trial.fit.interval_95]
            low, high = min([low, *doubted]), max([high, *doubted])
            # as if what is left were noise of that size
            left = self.left_after
            missed = max(self.gap.after, self.gap.held_out_after or 0.0)
            wider = max(1.0, missed / self.gap.floor, np.sqrt(left.statistic / left.freedom))
            centre = self.after.diffusivity
            low, high = centre * (low / centre) ** wider, centre * (high / centre) ** wider
            plain = self.before.diffusivity
            low, high = min(low, plain), max(high, plain)
        return float(low), float(high)

    @property
    def _alternatives(self) -> list[EffectParameters]:
        return [slot for named in self.effects for slot in named.alternatives]

    def smallest(self) -> dict[str, float]:
        """The size of each effect that this record would have shown beside the plain model, in its unit."""
        screen = self.screen
        needed = np.sqrt(max(_CLEAR, screen.threshold(0.05)))
        return {
            self.study.label(slot.effect): float(needed / screen.norm[places].max())
            for slot, places in screen.groups.items()
        }

    @cached_property
    def table(self) -> tuple[RankedEffect, ...]:
        """Every effect of the library beside the plain model, the largest expected gain first."""
        screen, study = self.screen, self.study
        tried = {trial.added[0]: trial for trial in self.trials if len(trial.added) == 1 and not trial.base.active}
        found = {named.slot: named for named in self.effects}
        rows = []
        for place in screen.best(len(screen.groups)):
            slot = screen.candidates[place].slot
            trial = tried.get(slot)
            rivals = _likenesses(screen, place)
            rows.append(
                RankedEffect(
                    slot,
                    study.label(slot.effect),
                    float(screen.gain[place]),
                    None if trial is None else trial.gain,
                    float(screen.size[place]),
                    float(1.0 / screen.norm[place]),
                    slot.effect.parameters[0].unit,
                    float(np.expm1(screen.shift[place])),
                    tuple(study.label(other.effect) for other in rivals),
                    self._reason(slot, place, trial, found),
                )
            )
        return tuple(rows)

    def _reason(
        self, slot: EffectParameters, place: int, trial: Trial | None, found: dict[EffectParameters, NamedEffect]
    ) -> str:
        """Why an effect is in or not, in a few words."""
        taken = "the nearest known effect" if self.incomplete else "what is in the model"
        if slot in found:
            return "the nearest known effect, refused" if self.incomplete else "in the model"
        if any(slot is other for named in self.effects for other in named.alternatives):
            return f"cannot be told from {taken}"
        if trial is not None and trial.reason:
            return trial.reason
        if self.screen.gain[place] == 0.0:
            return "its size would have the wrong sign"
        if self.screen.p_value(self.screen.gain[place]) > CHANCE:
            return "no more than chance makes"
        if not self.effects:
            return "does not explain what is left"
        return f"explained by {taken}"

    @property
    def sentence(self) -> str:
        """The verdict in one sentence."""
        return sentence(self)

    def __str__(self) -> str:
        return summary(self)

    def result(self) -> dict[str, Any]:
        """The part of result.json that is the diagnosis."""
        return result(self)


def _likenesses(screen: Screen, place: int) -> list[EffectParameters]:
    """The other effects whose derivative is nearly that of a candidate, the likest first."""
    likeness = np.abs(screen.cosine[place])
    own = screen.candidates[place].slot
    found: dict[EffectParameters, float] = {}
    for other in np.argsort(-likeness):
        slot = screen.candidates[other].slot
        if likeness[other] < _ALIKE:
            break
        if slot is not own and slot not in found:
            found[slot] = float(likeness[other])
    return list(found)


__all__ = ["Diagnosis", "NamedEffect", "RankedEffect", "Trial"]
