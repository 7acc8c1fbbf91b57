"""The next records that are compared: their interface, a longer record, one with another sensor."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Int

from ...inference.noise_covariance import BinnedReadings, NoiseCovariance
from ...inference.parameters import Parameters
from ..effect_fit import EffectFit
from ..problem import DiagnosisProblem, diagnosis_problem
from .actions import ActionKind
from .added_sensor import AddedSensor, added_sensors
from .other_weather import blocks_of_days
from .present_record import PresentRecord
from .separation import Explanation

SHARES = np.linspace(0.1, 0.9, 9)
"""Positions over the wall's length at which a sensor is tried."""
_APART = 1e-3  # m: two sensors are not closer
_LENGTHS = (1.5, 2.0, 3.0, 4.0, 6.0)  # of a longer record, in lengths of the present one
_LONGEST = 366.0  # days


class CandidateRecord(ABC):
    """A possible next record.

    Args:
        present: the present one.

    Attributes:
        kind: of the action that leads to it.
        length: in lengths of the present record.
    """

    kind: ClassVar[ActionKind]
    length: float = 1.0

    def __init__(self, present: PresentRecord):
        self.present = present

    @abstractmethod
    def parameters(self) -> dict[str, Any]:
        """The parameters of the action, as in result.json."""

    @cached_property
    @abstractmethod
    def explanations(self) -> tuple[Explanation, ...]:
        """Its readings by each fit, over one length of the present record."""

    @cached_property
    def further(self) -> tuple[Explanation, ...]:
        """Its readings by further rivals, which the present record excludes; none where it would exclude them too."""
        return ()

    @cached_property
    def whitening(self) -> np.ndarray:
        """W of these readings."""
        return self.present.whitening

    @cached_property
    def whitened_explanations(self) -> tuple[Explanation, ...]:
        """The same readings, whitened."""
        return tuple(one.whitened(self.whitening) for one in self.explanations)

    @cached_property
    def whitened_further(self) -> tuple[Explanation, ...]:
        """The readings by further rivals, whitened."""
        return tuple(one.whitened(self.whitening) for one in self.further)

    @cached_property
    @abstractmethod
    def problem(self) -> DiagnosisProblem:
        """The next record, over one length of the present one, prepared for a diagnosis."""

    @property
    def instruments(self) -> int:
        """The number of sensors and plates."""
        return self.problem.instrument_count

    def blocks(self, readings: int) -> Int[np.ndarray, " reading"]:
        """The block of days to which each of so many means belongs, or `SAME_WEATHER`."""
        return blocks_of_days(readings, self.instruments, self.present.days)

    def own_whitening(self, bins: BinnedReadings | None = None) -> np.ndarray:
        """W by the record's own model, with the noise of the present record; `bins` as in `noise_shape`."""
        first = self.present.fits[0]
        return self.problem.noise_shape(self.next_parameters(first), bins).covariance_like(first.noise).whitening

    def whitened_refit(self, explanation: Explanation, noise: NoiseCovariance) -> Explanation:
        """What a fit of `problem`, with some noise, predicts for its readings, whitened."""
        return explanation.whitened(noise.whitening)

    def next_name(self, name: str) -> str:
        """The name in the next record of a parameter of the present one."""
        return name

    def next_parameters(self, fit: EffectFit) -> Parameters:
        """The parameters of the next record with the values of a fit; others keep their neutral values."""
        parameters = self.problem.parameters
        return parameters.with_known_values(
            {self.next_name(name): value for name, value in fit.parameters.to_dict().items()}
        )


class LongerRecord(CandidateRecord):
    """A record of some times the length, with like weather.

    Its readings are means over longer bins, as a diagnosis of it will take them.

    Args:
        present: the present one.
        length: in lengths of the present record; 1 for a repeat of it.
    """

    kind = "longer"

    def __init__(self, present: PresentRecord, length: float):
        super().__init__(present)
        self.length = length

    def parameters(self) -> dict[str, Any]:
        """None beside the days."""
        return {}

    @cached_property
    def _bins(self) -> BinnedReadings:
        """The bins of the present readings, as long as those of the longer record."""
        bins, spacing = self.present.problem.bins, self.present.problem.spacing
        return bins.in_bins_for(round(self.length * bins.present.size), spacing)

    @cached_property
    def explanations(self) -> tuple[Explanation, ...]:
        """Those of the present record, in the bins of this one."""
        return tuple(self._in_its_bins(one) for one in self.present.explanations)

    def _in_its_bins(self, explanation: Explanation) -> Explanation:
        return explanation.mapped(self._bins.in_coarser_bins(self.present.problem.bins))

    def whitened_refit(self, explanation: Explanation, noise: NoiseCovariance) -> Explanation:
        """What a fit of the present record predicts, as means over longer bins, with the noise of these."""
        return self._in_its_bins(explanation).whitened(self.whitening)

    @cached_property
    def whitening(self) -> np.ndarray:
        """W of the means over its bins."""
        return self.own_whitening(self._bins)

    @cached_property
    def whitened_explanations(self) -> tuple[Explanation, ...]:
        """The same, whitened; where the bins are the present ones, once for all lengths."""
        has_present_bins = self._bins.rows_per_bin == self.present.problem.bins.rows_per_bin
        return self.present.whitened_explanations if has_present_bins else super().whitened_explanations

    @cached_property
    def problem(self) -> DiagnosisProblem:
        """The present record."""
        return self.present.problem


class RecordWithSensor(CandidateRecord):
    """A record with one more sensor.

    Args:
        present: the present one.
        added: the sensor with what each fit predicts for it.
    """

    kind = "sensor"

    def __init__(self, present: PresentRecord, added: AddedSensor):
        super().__init__(present)
        self.added = added

    def parameters(self) -> dict[str, Any]:
        """The position, m."""
        return {"position": self.added.sensor.position}

    @property
    def instruments(self) -> int:
        """The present ones and this sensor."""
        return self.present.problem.instrument_count + 1

    @cached_property
    def explanations(self) -> tuple[Explanation, ...]:
        """The readings of the present sensors and of this one."""
        return self.added.explanations

    @cached_property
    def whitening(self) -> np.ndarray:
        """W of these readings."""
        return self.added.whitening

    @cached_property
    def problem(self) -> DiagnosisProblem:
        """The present record with one more column, which has readings where a present sensor has them.

        The readings themselves are not used: the initial profile and the mean temperature stay those of the present
        record.
        """
        present = self.present.problem
        case = present.case
        record = case.record
        columns = np.column_stack([record.sensors, record.sensors[:, self.added.like]])
        names = (*record.names, self.added.sensor.name)
        record = replace(record, sensors=columns, names=names)
        extended = replace(case, record=record, sensors=(*case.sensors, self.added.sensor))
        return with_profile_of(diagnosis_problem(extended), present)


def records_with_sensor(present: PresentRecord) -> Iterator[RecordWithSensor]:
    """A record with one more sensor at each of nine places across the wall but where there is one.

    None without a present sensor.
    """
    case = present.problem.case
    if not case.sensors:
        return
    taken = np.array([sensor.position for sensor in case.sensors])
    positions = [place for place in (SHARES * case.wall.length).tolist() if np.abs(taken - place).min() > _APART]
    for added in added_sensors(present, positions):
        yield RecordWithSensor(present, added)


def longer_records(present: PresentRecord) -> Iterator[LongerRecord]:
    """Longer records, the shortest first."""
    yield from (LongerRecord(present, length) for length in _LENGTHS if length * present.days <= _LONGEST)


def with_profile_of(problem: DiagnosisProblem, present: DiagnosisProblem) -> DiagnosisProblem:
    """A problem with the initial profile and the mean temperature of another, whatever its readings are."""
    forcing = replace(
        problem.model.forcing, initial=present.model.forcing.initial, reference=present.model.forcing.reference
    )
    return replace(problem, model=replace(problem.model, forcing=forcing))
