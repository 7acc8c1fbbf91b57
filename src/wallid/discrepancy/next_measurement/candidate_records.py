"""The next records that are compared: a longer one, one with another sensor, in the shade, or heated.

By the derivatives each costs little. For the best ones the rivals are fitted to readings without noise, because a
derivative mis-states what films, depths and layers can explain.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property

import numpy as np

from ..._internal.units import DAY
from ...inference.noise_covariance import bin_readings
from ...inference.parameters import Parameters
from ..effect_fit import EffectFit, refit
from ..model_with_effects import linearise, predict
from ..problem import DiagnosisProblem, EffectParameters, diagnosis_problem
from .actions import ActionKind
from .added_sensor import AddedSensor, added_sensors
from .changed_faces import HEATING_HOURS, HEATING_POWER, heated, shaded
from .confusable_sets import ConfusableSet
from .separation import Explanation, Separation

_SHARES = np.linspace(0.1, 0.9, 9)  # of the wall's length, at which a sensor is tried
_CLEAR_EXCESS = 60.0  # of a penalised cost: a rival that far behind is excluded whatever a refit says


class CandidateRecord(ABC):
    """A possible next record, and how the rivals of a set fall behind the true effect in it.

    Args:
        confusable: the set.
    """

    kind: ActionKind

    def __init__(self, confusable: ConfusableSet):
        self.confusable = confusable

    @property
    def days(self) -> float:
        """Length of the record, days."""
        record = self.confusable.problem.record
        return (record.duration + record.step) / DAY

    @abstractmethod
    def parameters(self) -> dict[str, object]:
        """The parameters of the action, as in result.json."""

    @cached_property
    @abstractmethod
    def separations(self) -> tuple[Separation, ...]:
        """How the rivals fall behind each effect of the set where it is the true one, by the derivatives."""

    @cached_property
    @abstractmethod
    def next_problem(self) -> DiagnosisProblem:
        """The next record prepared for a diagnosis."""

    @cached_property
    def refitted_separations(self) -> tuple[Separation, ...]:
        """The same by fits of the rivals to readings without noise."""
        return tuple(self._refitted(k, one) for k, one in enumerate(self.separations))

    def _refitted(self, k: int, derivative: Separation) -> Separation:
        """The refits where effect k of the set is the true one; those of rivals far behind are left out."""
        problem, fits = self.next_problem, self.confusable.fits
        true, noise = fits[k], fits[0].noise
        shape = problem.noise_shape(_carried_over(problem, true))
        covariance = shape.covariance_of(noise.white, noise.autocorrelated, noise.correlation)
        exact = _with_readings_of(problem, true)

        def cost(fit: EffectFit) -> float:
            return refit(exact, _same_effects(problem, fit), _carried_over(problem, fit), covariance).cost

        own, excess = cost(true), np.array(derivative.excess)
        for j, rival in enumerate(fits[:k] + fits[k + 1 :]):
            if excess[j] < _CLEAR_EXCESS:
                excess[j] = max(cost(rival) - own, 0.0)
        return derivative.with_excess(excess)


class LongerRecord(CandidateRecord):
    """A record of some times the length, with like weather.

    Args:
        confusable: the set.
        length: in lengths of the present record; 1 for a repeat of it.
    """

    kind = "longer"

    def __init__(self, confusable: ConfusableSet, length: float):
        super().__init__(confusable)
        self.length = length

    @property
    def days(self) -> float:
        """Length of the record, days."""
        return self.length * super().days

    def parameters(self) -> dict[str, object]:
        """None beside the days."""
        return {}

    @cached_property
    def separations(self) -> tuple[Separation, ...]:
        """With the readings of the present record, `length` times."""
        confusable = self.confusable
        return confusable.separations(confusable.explanations, confusable.fits[0].noise.whitening, self.length)

    @cached_property
    def next_problem(self) -> DiagnosisProblem:
        """The present record."""
        return self.confusable.problem

    @cached_property
    def refitted_separations(self) -> tuple[Separation, ...]:
        """By the refits of the present record, which each length multiplies as the derivatives say."""
        if self.length == 1.0:
            return super().refitted_separations
        once = LongerRecord(self.confusable, 1.0)
        pairs = zip(self.separations, once.separations, once.refitted_separations, strict=True)
        return tuple(
            many.with_excess(refitted.excess * many.excess / np.maximum(one.excess, 1e-300))
            for many, one, refitted in pairs
        )


class RecordWithSensor(CandidateRecord):
    """A record with one more sensor.

    Args:
        confusable: the set.
        added: the sensor with what each fit predicts for it.
    """

    kind = "sensor"

    def __init__(self, confusable: ConfusableSet, added: AddedSensor):
        super().__init__(confusable)
        self.added = added

    def parameters(self) -> dict[str, object]:
        """The position, m."""
        return {"position": self.added.sensor.position}

    @cached_property
    def separations(self) -> tuple[Separation, ...]:
        """With the readings of the present sensors and of this one."""
        return self.confusable.separations(self.added.explanations, self.added.whitening)

    @cached_property
    def next_problem(self) -> DiagnosisProblem:
        """The present record with one more column, which has readings where a present sensor has them."""
        case = self.confusable.problem.case
        record = case.record
        columns = np.column_stack([record.sensors, record.sensors[:, self.added.like]])
        names = (*record.names, self.added.sensor.name)
        record = replace(record, sensors=columns, names=names)
        return diagnosis_problem(replace(case, record=record, sensors=(*case.sensors, self.added.sensor)))


class _ChangedRecord(CandidateRecord):
    """A record whose faces take other courses."""

    @cached_property
    def separations(self) -> tuple[Separation, ...]:
        """With what the fits predict for the changed faces."""
        confusable, problem = self.confusable, self.next_problem
        explanations = tuple(
            _explanation_in(problem, fit, one)
            for fit, one in zip(confusable.fits, confusable.explanations, strict=True)
        )
        return confusable.separations(explanations, confusable.fits[0].noise.whitening)


class ShadedRecord(_ChangedRecord):
    """A record with the outer face in the shade during its second half."""

    kind = "shade"

    def parameters(self) -> dict[str, object]:
        """The face."""
        return {"face": self.confusable.problem.case.wall.outside}

    @cached_property
    def next_problem(self) -> DiagnosisProblem:
        """The present record with less sun."""
        return shaded(self.confusable.problem)


class HeatedRecord(_ChangedRecord):
    """A record with the inner face heated once."""

    kind = "heating"

    def parameters(self) -> dict[str, object]:
        """Duration, h, and power, W/m2."""
        return {"hours": HEATING_HOURS, "power": HEATING_POWER}

    @cached_property
    def next_problem(self) -> DiagnosisProblem:
        """The present record with a warmer inner face."""
        return heated(self.confusable.problem, self.confusable.fits[0].diffusivity)


def records_with_sensor(confusable: ConfusableSet) -> Iterator[RecordWithSensor]:
    """A record with one more sensor at each of nine places across the wall."""
    positions = (_SHARES * confusable.problem.case.wall.length).tolist()
    for added in added_sensors(confusable.fits, confusable.explanations, positions):
        yield RecordWithSensor(confusable, added)


def _explanation_in(problem: DiagnosisProblem, fit: EffectFit, present: Explanation) -> Explanation:
    """What a fit predicts for the readings of another problem with the same sensors and rows."""
    names, linear = fit.parameters.estimated_names, problem.is_linear(fit.active)
    predicted, slopes = linearise(problem.model, problem.bins, fit.parameters, names, linear=linear)
    return replace(present, predicted=problem.binned(predicted), jacobian=slopes.T)


def _carried_over(problem: DiagnosisProblem, fit: EffectFit) -> Parameters:
    """The parameters of a problem with the values of a fit; what the fit does not have keeps its neutral value."""
    own = fit.parameters.to_dict()
    return problem.parameters.with_values({name: own[name] for name in problem.parameters.names if name in own})


def _same_effects(problem: DiagnosisProblem, fit: EffectFit) -> tuple[EffectParameters, ...]:
    """The effects of a fit in the library of a problem."""
    by_names = {effect.names: effect for effect in problem.library}
    return tuple(by_names[effect.names] for effect in fit.active)


def _with_readings_of(problem: DiagnosisProblem, fit: EffectFit) -> DiagnosisProblem:
    """The problem with the readings that a fit predicts, without noise, in the rows that have a reading."""
    linear = problem.is_linear(fit.active)
    predicted = np.asarray(predict(problem.model, _carried_over(problem, fit), linear))
    present = np.isfinite(problem.record.sensors)
    readings = np.where(present, predicted, np.nan)
    bins, _ = bin_readings(present, np.where(present, predicted, 0.0))
    return replace(problem, record=replace(problem.record, sensors=readings), bins=bins)
