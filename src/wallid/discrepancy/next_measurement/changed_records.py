"""Next records with the same sensors: the faces in the shade or heated, another season, two sensors exchanged."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
from jaxtyping import Int

from ..._internal.units import DAY
from ...experiment_design.campaign_plan.typical_case import day_of_year
from ...inference.nuisance_kinds import SensorPositions
from ...inference.parameters import kind_of, target_of
from ...records.weather_year import HOURS, WeatherYear
from ..effect_fit import EffectFit
from ..model_with_effects import first_order_columns, linearise
from ..problem import DiagnosisProblem, EffectParameters, diagnosis_problem
from .candidate_records import CandidateRecord, with_profile_of
from .changed_faces import HEATING_HOURS, HEATING_POWER, heated, heating_start, in_season, shaded
from .other_weather import SAME_WEATHER
from .present_record import PresentRecord
from .separation import Explanation

_INSTRUMENT_ERRORS = ("sensor_lag", "sensor_offset", "sensor_gain", "sensor_drift")
_PLACE_ERRORS = (SensorPositions.kind, "effect.sensor_position")
_SEASONS = 6  # first days that are tried


class ChangedRecord(CandidateRecord):
    """A record whose model is another one: under other conditions, or with other instruments."""

    @cached_property
    def explanations(self) -> tuple[Explanation, ...]:
        """What the fits predict for it."""
        pairs = zip(self.present.fits, self.present.explanations, strict=True)
        return tuple(self._explanation(fit, one) for fit, one in pairs)

    def _explanation(self, fit: EffectFit, present: Explanation) -> Explanation:
        """What a fit predicts for the next record, with the parameters under their names there."""
        problem, parameters = self.problem, self.next_parameters(fit)
        names = [self.next_name(name) for name in fit.parameters.estimated_names]
        linear = problem.is_linear(fit.active)
        predicted, slopes = linearise(problem.model, problem.bins, parameters, names, linear=linear)
        return replace(present, names=tuple(names), predicted=problem.binned(predicted), jacobian=slopes.T)

    @cached_property
    def whitening(self) -> np.ndarray:
        """W of the readings by its own model: other faces have other errors between their rows."""
        return self.own_whitening()


class ShadedRecord(ChangedRecord):
    """A record with the outer face in the shade during its second half."""

    kind = "shade"

    def parameters(self) -> dict[str, Any]:
        """The face."""
        return {"face": self.present.problem.case.wall.outside}

    @cached_property
    def problem(self) -> DiagnosisProblem:
        """The present record with less sun."""
        return shaded(self.present.problem)


class HeatedRecord(ChangedRecord):
    """A record with the inner face heated once."""

    kind = "heating"

    def parameters(self) -> dict[str, Any]:
        """Duration, h, and power, W/m2."""
        return {"hours": HEATING_HOURS, "power": HEATING_POWER}

    @cached_property
    def problem(self) -> DiagnosisProblem:
        """The present record with a warmer inner face."""
        return heated(self.present.problem, self.present.diffusivity)

    def blocks(self, readings: int) -> Int[np.ndarray, " reading"]:
        """Those of the days; the heating and the day after it tell the same in any weather."""
        record, bins = self.problem.record, readings // self.instruments
        since = record.span * np.arange(bins) / bins - heating_start(record)
        is_warm = (since >= 0.0) & (since < HEATING_HOURS * 3600.0 + DAY)
        return np.where(np.tile(is_warm, self.instruments), SAME_WEATHER, super().blocks(readings))


class SeasonRecord(ChangedRecord):
    """A record from another day of a typical year on.

    Args:
        present: the present one.
        weather: of the typical year.
        start: the hour of the typical year at which its first day begins.
    """

    kind = "season"

    def __init__(self, present: PresentRecord, weather: WeatherYear, start: int):
        super().__init__(present)
        self.weather, self.start = weather, start

    def parameters(self) -> dict[str, Any]:
        """The first day, as day of the year."""
        return {"start": day_of_year(self.start)}

    @cached_property
    def problem(self) -> DiagnosisProblem:
        """The present record with faces, air and sun of that season."""
        return in_season(self.present.problem, self.weather, self.start, self.present.diffusivity)


class SwappedRecord(ChangedRecord):
    """A record with two sensors exchanged: the errors of instruments go with them, those of places stay.

    At its new place a sensor's error may be like another effect than before. So each effect that has one parameter and
    keeps the wall linear is a rival, to first order, also where the present record excludes it.

    Args:
        present: the present one.
        pair: names of the two sensors.
    """

    kind = "swap"

    def __init__(self, present: PresentRecord, pair: tuple[str, str]):
        super().__init__(present)
        self.pair = pair

    def parameters(self) -> dict[str, Any]:
        """The names of the sensors."""
        return {"sensors": list(self.pair)}

    def next_name(self, name: str) -> str:
        """The position error of a place is that of the other sensor in the next record."""
        target = target_of(name)
        if kind_of(name) not in _PLACE_ERRORS or target not in self.pair:
            return name
        other = self.pair[1 - self.pair.index(target)]
        return name.replace(f"[{target}]", f"[{other}]")

    @cached_property
    def problem(self) -> DiagnosisProblem:
        """The present record with the two sensors at each other's places."""
        present = self.present.problem
        at = {sensor.name: sensor for sensor in present.case.sensors}
        one, other = (at[name] for name in self.pair)
        places = {one.name: other, other.name: one}
        sensors = tuple(
            replace(sensor, position=place.position, position_std=place.position_std)
            for sensor in present.case.sensors
            for place in (places.get(sensor.name, sensor),)
        )
        return with_profile_of(diagnosis_problem(replace(present.case, sensors=sensors)), present)

    @cached_property
    def further(self) -> tuple[Explanation, ...]:
        """What the effects predict that are in no fit, each beside the fit without the effects of the set."""
        problem, base, beside = self.problem, self.present.fits[-1], self.explanations[-1]
        taken = {self.next_name(one.names[0]) for fit in self.present.fits for one in fit.active}
        effects = [
            one
            for one in problem.library
            if len(one.names) == 1 and one.names[0] not in taken and problem.is_linear((*base.active, one))
        ]
        sizes = [(one.names[0], {}) for one in effects]
        columns = first_order_columns(problem.model, problem.bins, self.next_parameters(base), sizes)
        return tuple(self._with_effect(beside, one, column) for one, column in zip(effects, columns, strict=True))

    def _with_effect(self, beside: Explanation, one: EffectParameters, column: np.ndarray) -> Explanation:
        """An explanation with one more effect, in the place of the error with a prior that it replaces."""
        replaced = self.problem.replaced_errors((one,))
        kept = beside.without(replaced)
        return replace(
            kept,
            names=(*kept.names, one.names[0]),
            jacobian=np.column_stack([kept.jacobian, column]),
            values=np.append(kept.values, 0.0),
            prior_std=np.append(kept.prior_std, np.inf),
            growth=None,  # the record has the length of the present one
        )


def changed_records(present: PresentRecord, weather: WeatherYear | None) -> Iterator[CandidateRecord]:
    """A heated record; one in the shade where the sun was logged; other seasons where there is a typical year."""
    problem = present.problem
    yield HeatedRecord(present)
    if "irradiance" in problem.record.regressors:
        yield ShadedRecord(present)
    if weather is not None:
        year = HOURS // 24
        starts = 24 * np.linspace(0, year, _SEASONS, endpoint=False).astype(int) if present.days < year else []
        yield from (SeasonRecord(present, weather, int(start)) for start in starts)


def swapped_records(present: PresentRecord) -> Iterator[SwappedRecord]:
    """Each sensor that one of the effects blames, exchanged with each other one."""
    blamed = {
        fit.problem.target_name(one.effect)
        for fit in present.fits
        for one in fit.active
        if one.effect.name in _INSTRUMENT_ERRORS
    }
    names = [sensor.name for sensor in present.problem.case.sensors]
    for pair in combinations(names, 2):
        if blamed & set(pair):
            yield SwappedRecord(present, pair)
