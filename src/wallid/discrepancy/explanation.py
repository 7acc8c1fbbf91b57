"""What the search found: one record from which every table, figure and result.json derives."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ..record import Record
from .compare import Gap, Windows
from .extend import Fit
from .locate import Remainder
from .rank import Screen
from .study import Slot, Study

LEFT_OVER = 1e-3
"""How often chance may make the omnibus test say that something is left."""
_CLEAR = 9.0  # of -2 log L: the size that would have been told apart from none


@dataclass
class Trial:
    """A fit that was tried.

    Arguments:
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
    def added(self) -> tuple[Slot, ...]:
        """What it added."""
        return tuple(slot for slot in self.fit.active if slot not in self.base.active)


@dataclass(frozen=True, eq=False)
class Named:
    """An effect that was found.

    Arguments:
        values: of each parameter: (value, standard deviation).
        expected, gain: drop of `-2 log L`, by the screen's linear prediction and by the refit.
        p_value: of the gain, over the whole library.
        alternatives: effects that this record cannot tell from it.
        windows: its size in each quarter of the record.
    """

    slot: Slot
    values: dict[str, tuple[float, float]]
    expected: float
    gain: float
    p_value: float
    alternatives: tuple[Slot, ...]
    windows: Windows


@dataclass(frozen=True, eq=False)
class Explanation:
    """What the plain model misses in a record.

    Arguments:
        before, after: the plain model and the one with the effects in.
        effects: that were found, the largest gain first.
        screen: the whole library beside the plain model.
        trials: every fit that was tried.
        rivals: fits that come close to `after`.
        left_before, left_after: where the two models and the readings part.
    """

    study: Study = field(repr=False)
    before: Fit = field(repr=False)
    after: Fit = field(repr=False)
    effects: tuple[Named, ...]
    screen: Screen = field(repr=False)
    trials: tuple[Trial, ...] = field(repr=False)
    gap: Gap
    left_before: Remainder = field(repr=False)
    left_after: Remainder = field(repr=False)
    rivals: tuple[Fit, ...] = field(repr=False)

    @property
    def verdict(self) -> str:
        """`adequate`, `named`, `confusable`, `unnamed` or `uninformative`; see `__str__` for the sentence."""
        if self.left_after.p_value < LEFT_OVER:
            return "unnamed"
        low, high = self.interval_95
        if high / low > self.study.case.choices.largest_interval_factor:
            return "uninformative"
        if not self.effects:
            return "adequate"
        return "confusable" if any(named.alternatives for named in self.effects) else "named"

    @cached_property
    def interval_95(self) -> tuple[float, float]:
        """Of the diffusivity, m2/s: spanning every rival; widened where something unnamed is left."""
        low, high = self.after.interval_95
        near = [fit for fit in self.rivals if any(slot in fit.active for slot in self._alternatives)]
        ends = [low, high, *(end for fit in near for end in fit.interval_95)]
        low, high = min(ends), max(ends)
        if self.left_after.p_value < LEFT_OVER:
            wider = np.sqrt(max(1.0, self.left_after.statistic / self.left_after.freedom))
            centre = self.after.diffusivity
            low, high = centre * (low / centre) ** wider, centre * (high / centre) ** wider
            plain = self.before.diffusivity
            low, high = min(low, plain), max(high, plain)
        return float(low), float(high)

    @property
    def _alternatives(self) -> list[Slot]:
        return [slot for named in self.effects for slot in named.alternatives]

    def smallest(self) -> dict[str, float]:
        """The size of each effect that this record would have shown beside the plain model, in its unit."""
        screen = self.screen
        needed = np.sqrt(max(_CLEAR, screen.threshold(0.05)))
        return {
            self.study.label(slot.effect): float(needed / screen.norm[places].max())
            for slot, places in screen.groups.items()
        }

    def result(self) -> dict[str, Any]:
        """The part of result.json that is the diagnosis."""
        study = self.study
        verdict = self.verdict
        told = self.effects if verdict in ("named", "confusable") else ()
        gap = self.gap
        low, high = self.interval_95
        return {
            "diffusivity": _quantity(self.after, (low, high)),
            "diffusivity_before": _quantity(self.before, self.before.interval_95),
            "verdict": verdict,
            "effects": [
                {
                    "name": named.slot.effect.name,
                    "target": study.target_name(named.slot.effect),
                    "parameters": parameters(named, study.record),
                    "alternatives": [
                        {"name": slot.effect.name, "target": study.target_name(slot.effect)}
                        for slot in named.alternatives
                    ],
                    "expected_gain": named.expected,
                    "gain": named.gain,
                    "p_value": named.p_value,
                }
                for named in told
            ],
            "gap": {
                "before_K": gap.before,
                "after_K": gap.after,
                "floor_K": gap.floor,
                "held_out_before_K": gap.held_out_before,
                "held_out_after_K": gap.held_out_after,
            },
        }


def _quantity(fit: Fit, interval: tuple[float, float]) -> dict[str, Any]:
    value = fit.diffusivity
    return {"value": value, "std": value * fit.log_std, "interval_95": list(interval), "unit": "m2/s"}


def parameters(named: Named, record: Record) -> dict[str, Any]:
    """An effect's parameters as result.json says them: hours as one pair, a time in the record's format."""
    effect = named.slot.effect
    found: dict[str, Any] = {}
    for parameter in effect.parameters:
        value, std = named.values[parameter.name]
        found[parameter.name] = {"value": value, "std": std, "unit": parameter.unit}
    if effect.name == "heat_source":
        hours = [found.pop(key, None) for key in ("start", "end")]
        found.setdefault("place", None)
        found["hours"] = None if hours[0] is None else [hour["value"] % 24.0 for hour in hours if hour]
    if effect.name == "wetting":
        found["time"] = record.stamp_at(named.values["time"][0])
    return found


__all__ = ["Explanation", "Named", "Trial", "parameters"]
