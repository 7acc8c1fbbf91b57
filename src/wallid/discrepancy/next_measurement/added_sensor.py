"""The readings that fits predict for one more sensor at any place in the wall.

The model of a diagnosis has a position parameter for each sensor. A sensor that is moved by it, without the errors of
its own, is the sensor at the other place, so no other model is compiled.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..._internal.arrays import on_device
from ...case.wall_and_sensors import Sensor
from ...experiment_design.fisher_information import typical_sensor
from ...inference.noise_covariance import BinnedReadings
from ...inference.noise_of_record import noise_shape_of_record
from ...inference.nuisance_kinds import FacePositions, SensorOffsets, SensorPositions
from ...inference.parameters import Parameters, kind_of, target_of
from ...models.flux_plates import face_noise_of_model
from ..effect_fit import EffectFit
from ..face_error_responses import FaceErrorResponses
from ..model_with_effects import linearise
from ..problem import DiagnosisProblem
from .present_record import PresentRecord
from .separation import Explanation

_OWN_ERRORS = (SensorOffsets.kind, SensorPositions.kind)


@dataclass(frozen=True, eq=False)
class AddedSensor:
    """One more sensor, and what each fit predicts for it.

    More readings may be means over longer bins, as the diagnosis of such a record will take them.

    Args:
        sensor: its position and standard deviations.
        like: index of the sensor in whose rows it has readings.
        whitening: W of all readings with those of this sensor last, `(reading, reading)`.
        explanations: the readings of all sensors with this one by each fit.
    """

    sensor: Sensor
    like: int
    whitening: np.ndarray = field(repr=False)
    explanations: tuple[Explanation, ...] = field(repr=False)


def another_sensor(problem: DiagnosisProblem, position: float) -> Sensor:
    """A sensor at a place with the noise, the offset and the position error of those of the case."""
    typical = typical_sensor(problem.case.sensors, noise_std=None, position_std=None, offset_std=None)
    taken = {sensor.name for sensor in problem.case.sensors}
    name = next(name for count in range(1, len(taken) + 2) if (name := f"new {count}") not in taken)
    return replace(typical, name=name, position=position)


def added_sensors(present: PresentRecord, positions: Sequence[float]) -> Iterator[AddedSensor]:
    """One more sensor at each of some places.

    Args:
        present: the record without it, and its fits.
        positions: m from the left face.
    """
    fits, problem, size = present.fits, present.problem, present.problem.sensor_count
    of_present = problem.responses_to_face_errors(fits[0].parameters)
    for first in range(0, len(positions), size):
        some = positions[first : first + size]
        parameters = [_moved(fit.parameters, problem.case.sensors, some) for fit in fits]
        moved = problem.responses_at(_with_stated_faces(parameters[0]))
        predictions = [_Prediction.of(fit, at) for fit, at in zip(fits, parameters, strict=True)]
        for slot, position in enumerate(some):
            sensor = another_sensor(problem, position)
            finer = _with_readings_of_last(problem.bins, slot)
            bins = finer.in_bins_for(finer.present.size, problem.spacing)
            average = bins.in_coarser_bins(finer)
            extended = tuple(
                prediction.extend(one, sensor, slot).mapped(average)
                for prediction, one in zip(predictions, present.explanations, strict=True)
            )
            whitening = _whitening(fits[0], sensor, bins, of_present.with_last(moved, slot))
            yield AddedSensor(sensor, slot, whitening, extended)


def _with_readings_of_last(bins: BinnedReadings, like: int) -> BinnedReadings:
    """The readings with one more sensor, which has them in the rows of the sensor `like`."""
    observed, present = (np.asarray(rows) for rows in (bins.observed, bins.present))
    return BinnedReadings(
        on_device(np.column_stack([observed, observed[:, like]])),
        on_device(np.column_stack([present, present[:, like]])),
        bins.rows_per_bin,
    )


def _moved(parameters: Parameters, sensors: Sequence[Sensor], positions: Sequence[float]) -> Parameters:
    """The parameters with the first sensors at other places, and all without errors of their own."""
    names = {sensor.name for sensor in sensors}
    own = [name for name in parameters.names if _is_of_a_sensor(name) and target_of(name) in names]
    moves = {
        f"{SensorPositions.kind}[{sensor.name}]": position - sensor.position
        for sensor, position in zip(sensors, positions, strict=False)
    }
    return parameters.with_values(dict.fromkeys(own, 0.0) | moves)


def _with_stated_faces(parameters: Parameters) -> Parameters:
    """The parameters without position errors of the faces' sensors."""
    return parameters.with_values(dict.fromkeys(parameters.of_kind(FacePositions.kind), 0.0))


def _is_of_a_sensor(name: str) -> bool:
    """Whether a parameter is an error of one sensor: an offset, a position, a lag, a gain, a drift."""
    return kind_of(name) in _OWN_ERRORS or kind_of(name).startswith("effect.sensor_")


@dataclass(frozen=True, eq=False)
class _Prediction:
    """The moved sensors' readings by one fit: bin means `(reading,)`, and derivatives by name, `(reading,)` each."""

    fit: EffectFit
    predicted: np.ndarray
    columns: dict[str, np.ndarray]

    @classmethod
    def of(cls, fit: EffectFit, parameters: Parameters) -> _Prediction:
        problem = fit.problem
        shared = [name for name in fit.parameters.estimated_names if not _is_of_a_sensor(name)]
        names = [*shared, *parameters.of_kind(SensorPositions.kind)]
        linear = problem.is_linear(fit.active)
        predicted, slopes = linearise(problem.model, problem.bins, parameters, names, linear=linear)
        return cls(fit, problem.binned(predicted), dict(zip(names, slopes, strict=True)))

    def extend(self, explanation: Explanation, sensor: Sensor, slot: int) -> Explanation:
        """The explanation of all readings with those of the new sensor, evaluated in the place of the sensor `slot`."""
        problem = self.fit.problem
        bins = len(self.predicted) // problem.instrument_count
        rows = slice(slot * bins, (slot + 1) * bins)
        zeros = np.zeros(bins)
        shared = [
            zeros if _is_of_a_sensor(name) else self.columns[name][rows] for name in self.fit.parameters.estimated_names
        ]
        gradient = self.columns[f"{SensorPositions.kind}[{problem.case.sensors[slot].name}]"][rows]
        errors = (
            (SensorOffsets.kind, sensor.offset_std, np.ones(bins)),
            (SensorPositions.kind, sensor.position_std, gradient),
        )
        own = [(f"{kind}[{sensor.name}]", std, column) for kind, std, column in errors if std > 0]
        new = np.stack([*shared, *(column for *_, column in own)], axis=1)
        present = np.pad(explanation.jacobian, ((0, 0), (0, len(own))))
        return Explanation(
            (*explanation.names, *(name for name, *_ in own)),
            np.concatenate([explanation.predicted, self.predicted[rows]]),
            np.concatenate([present, new]),
            np.concatenate([explanation.values, np.zeros(len(own))]),
            np.concatenate([explanation.prior_std, [std for _, std, _ in own]]),
            explanation.penalty,
        )


def _whitening(fit: EffectFit, sensor: Sensor, bins: BinnedReadings, responses: FaceErrorResponses) -> np.ndarray:
    """W of all readings with those of one more sensor."""
    problem = fit.problem
    stds = np.append(problem.noise_stds, sensor.noise_std)
    face_noise, errors = face_noise_of_model(problem.case)
    shape = noise_shape_of_record(
        problem.record, responses.impulse, bins, problem.spacing, stds, face_noise, errors,
        responses.binned_shared(bins),
    )  # fmt: skip
    return shape.covariance_like(fit.noise).whitening
