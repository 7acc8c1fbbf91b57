"""The next records that are compared: a longer one, one with another sensor, in the shade, or heated."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ..._internal.units import DAY
from ..effect_fit import EffectFit
from ..model_with_effects import linearise
from ..problem import DiagnosisProblem, diagnosis_problem
from .actions import ActionKind
from .added_sensor import AddedSensor, added_sensors
from .changed_faces import HEATING_HOURS, HEATING_POWER, heated, shaded
from .separation import Explanation

_SHARES = np.linspace(0.1, 0.9, 9)  # of the wall's length, at which a sensor is tried
_LENGTHS = (1.5, 2.0, 3.0, 4.0, 6.0)  # of a longer record, in lengths of the present one
_LONGEST = 366.0  # days


@dataclass(frozen=True, eq=False)
class PresentRecord:
    """The record of a diagnosis, and what some fits predict for its readings.

    Args:
        fits: of one problem, with one noise.
        explanations: the readings by each fit.
    """

    fits: tuple[EffectFit, ...] = field(repr=False)
    explanations: tuple[Explanation, ...] = field(repr=False)

    @property
    def problem(self) -> DiagnosisProblem:
        """The case prepared for the search."""
        return self.fits[0].problem

    @property
    def whitening(self) -> np.ndarray:
        """W of the readings."""
        return self.fits[0].noise.whitening

    @property
    def days(self) -> float:
        """Length of the record, days."""
        return (self.problem.record.duration + self.problem.record.step) / DAY


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
    def whitening(self) -> np.ndarray:
        """W of these readings."""
        return self.present.whitening

    @cached_property
    @abstractmethod
    def problem(self) -> DiagnosisProblem:
        """The next record, over one length of the present one, prepared for a diagnosis."""


class LongerRecord(CandidateRecord):
    """A record of some times the length, with like weather.

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
    def explanations(self) -> tuple[Explanation, ...]:
        """Those of the present record."""
        return self.present.explanations

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
        problem = diagnosis_problem(replace(case, record=record, sensors=(*case.sensors, self.added.sensor)))
        forcing = replace(
            problem.model.forcing,
            initial=present.model.forcing.initial,
            reference=present.model.forcing.reference,
        )
        return replace(problem, model=replace(problem.model, forcing=forcing))


class _ChangedRecord(CandidateRecord):
    """A record whose faces take other courses."""

    @cached_property
    def explanations(self) -> tuple[Explanation, ...]:
        """What the fits predict with the changed faces."""
        pairs = zip(self.present.fits, self.present.explanations, strict=True)
        return tuple(_explanation_in(self.problem, fit, one) for fit, one in pairs)


class ShadedRecord(_ChangedRecord):
    """A record with the outer face in the shade during its second half."""

    kind = "shade"

    def parameters(self) -> dict[str, Any]:
        """The face."""
        return {"face": self.present.problem.case.wall.outside}

    @cached_property
    def problem(self) -> DiagnosisProblem:
        """The present record with less sun."""
        return shaded(self.present.problem)


class HeatedRecord(_ChangedRecord):
    """A record with the inner face heated once."""

    kind = "heating"

    def parameters(self) -> dict[str, Any]:
        """Duration, h, and power, W/m2."""
        return {"hours": HEATING_HOURS, "power": HEATING_POWER}

    @cached_property
    def problem(self) -> DiagnosisProblem:
        """The present record with a warmer inner face."""
        return heated(self.present.problem, self.present.fits[0].diffusivity)


def records_with_sensor(present: PresentRecord) -> Iterator[RecordWithSensor]:
    """A record with one more sensor at each of nine places across the wall."""
    positions = (_SHARES * present.problem.case.wall.length).tolist()
    for added in added_sensors(present.fits, present.explanations, positions):
        yield RecordWithSensor(present, added)


def other_records(present: PresentRecord) -> Iterator[CandidateRecord]:
    """A heated record, one in the shade where the sun was logged, and longer ones, the shortest first."""
    yield HeatedRecord(present)
    if "irradiance" in present.problem.record.regressors:
        yield ShadedRecord(present)
    yield from (LongerRecord(present, length) for length in _LENGTHS if length * present.days <= _LONGEST)


def _explanation_in(problem: DiagnosisProblem, fit: EffectFit, present: Explanation) -> Explanation:
    """What a fit predicts for the readings of another problem with the same sensors and rows."""
    names, linear = fit.parameters.estimated_names, problem.is_linear(fit.active)
    predicted, slopes = linearise(problem.model, problem.bins, fit.parameters, names, linear=linear)
    return replace(present, predicted=problem.binned(predicted), jacobian=slopes.T)
