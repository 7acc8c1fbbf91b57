"""A case prepared for the diagnosis: its model, readings, parameters, priors and bounds.

The readings are those of the inner sensors and of the heat flux plates. The parameters are ln(alpha / prior), the
nuisance parameters with their priors (amplitudes of the initial profile, position errors and offsets of the sensors;
with plates the conductivity and their calibrations) and the parameters of every effect. A model contains an effect
where the parameters of the effect are estimated; otherwise they keep their neutral values.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import equinox as eqx
import numpy as np
from jaxtyping import Float

from .._internal.arrays import on_device
from .._internal.errors import InputError
from .._internal.units import DAY
from ..case.case_definition import Case
from ..case.time_window import Window, diagnosis_window
from ..case.wall_and_sensors import SIDES
from ..inference.likelihood import LOG_DIFFUSIVITY, PLATE_GAIN
from ..inference.noise_covariance import BinnedReadings, NoiseShape, bin_readings
from ..inference.noise_of_record import noise_shape_of_record
from ..inference.nuisance_kinds import CommonNoise, FacePositions, SensorHeights, SensorOffsets, SensorPositions
from ..inference.nuisance_parameters import window_parameters
from ..inference.parameters import Parameter, Parameters, kind_of, target_of
from ..inference.validity import distinguishable_range
from ..models.flux_plates import (
    face_noise_of_model,
    faces_of_model,
    flux_noise_std,
    flux_readings,
    fluxes_of,
    initial_conductivity,
    plate_outputs,
)
from ..models.state_space import require_x64
from ..records.face_spectrum import NoiseMemory
from ..records.uniform_record import Record, cubic_coefficients, spline_slopes
from .effects.base import AbstractEffect
from .effects.catalogue import library, unlogged
from .effects.heat_sources import AIRS
from .effects.search_range import SearchRange, search_range_of_record
from .face_error_responses import FaceErrorResponses
from .forward.time_stepping import MAX_SUBSTEP
from .heterogeneity.section_pattern import section_pattern
from .model_with_effects import DEPTH_SIGNS, ModelWithEffects, face_change_response, face_impulse_response
from .record_forcing import forcing_of_window

_PLAIN_KINDS = (SensorOffsets(), SensorPositions(), SensorHeights(), FacePositions(), CommonNoise())
_INSTRUMENT_ERRORS = {  # the instrument's error that an effect estimates without a prior
    "sensor_position": SensorPositions.kind,
    "sensor_offset": SensorOffsets.kind,
    "face_depth": FacePositions.kind,
    "plate_gain": PLATE_GAIN,
}


@dataclass(frozen=True, eq=False)
class EffectParameters:
    """An effect and the names of its parameters.

    Args:
        effect: the effect.
        names: of its parameters in `DiagnosisProblem.parameters`; the first is the size.
    """

    effect: AbstractEffect
    names: tuple[str, ...]

    @property
    def full_names(self) -> dict[str, str]:
        """The names of its parameters in the problem, by their names in the effect."""
        return {parameter.name: name for parameter, name in zip(self.effect.parameters, self.names, strict=True)}

    def values(self, parameters: Parameters) -> dict[str, float]:
        """The values of its parameters, by their names in the effect."""
        return {key: float(parameters[name]) for key, name in self.full_names.items()}


@dataclass(frozen=True, eq=False)
class DiagnosisProblem:
    """A case prepared for the diagnosis.

    Args:
        case: the case, in one dimension.
        stated: the case as it is stated, with its section if it has one.
        record: the rows used.
        readings: of the inner sensors, degC, then of the plates, W/m2, `(time, instrument)`; NaN where missing.
        model: the wall with these effects, and with those of columns that were not logged.
        bins, spacing: the readings, averaged over bins of rows, as from `bin_readings`.
        library: the effects that the record can be tested for, with the names of their parameters.
        parameters: of the plain model at the prior diffusivity, each effect with size 0 at the first point of its
            grid. The plain model estimates those of the mask.
        search_range: ranges of the positions, times and temperatures of effects.
        has_pattern: whether the model has what a section changes.
    """

    case: Case
    stated: Case = field(repr=False)
    record: Record
    readings: np.ndarray = field(repr=False)
    model: ModelWithEffects = field(repr=False)
    bins: BinnedReadings = field(repr=False)
    spacing: int
    library: tuple[EffectParameters, ...] = field(repr=False)
    parameters: Parameters = field(repr=False)
    search_range: SearchRange
    has_pattern: bool = False

    @property
    def diffusivity_bounds(self) -> tuple[float, float]:
        """The range of diffusivities that the record can distinguish, the bounds of every fit, m2/s."""
        index, prior = self.parameters.index(LOG_DIFFUSIVITY), self.case.wall.diffusivity_prior
        low, high = (float(np.exp(bound[index])) for bound in (self.parameters.lower, self.parameters.upper))
        return prior * low, prior * high

    @property
    def sensor_count(self) -> int:
        """Number of inner sensors."""
        return len(self.case.sensors)

    @property
    def instrument_count(self) -> int:
        """Number of inner sensors and plates."""
        return self.readings.shape[1]

    @property
    def instruments(self) -> tuple[str, ...]:
        """The names of the inner sensors and the plates, "flux_left" or "flux_right"."""
        return (*self.model.sensors, *(output.name for output in plate_outputs(self.case)))

    @property
    def instruments_of_gap(self) -> slice:
        """The instruments over which a root mean square is taken: those inside the wall, else the plates."""
        return slice(0, self.sensor_count or None)

    @property
    def unit_of_gap(self) -> str:
        """Of their readings, K or W/m2."""
        return "K" if self.sensor_count else "W/m2"

    @property
    def units(self) -> tuple[str, ...]:
        """The unit of each instrument's residual."""
        return ("K",) * self.sensor_count + ("W/m2",) * (self.instrument_count - self.sensor_count)

    @property
    def noise_stds(self) -> np.ndarray:
        """Stated standard deviation of each instrument's readings, K or W/m2."""
        plates = self.instrument_count - self.sensor_count
        return np.array([sensor.noise_std for sensor in self.case.sensors] + [flux_noise_std(self.case)] * plates)

    def readings_of(self, record: Record) -> np.ndarray:
        """The readings of the instruments in another record of the same rows, `(time, instrument)`."""
        return _readings(self.case, record)

    def binned(self, values: np.ndarray) -> np.ndarray:
        """Means over the readings of each bin, instrument by instrument, `(..., reading)`; 0 in an empty bin.

        Args:
            values: at the rows, `(..., time, instrument)`.
        """
        present, counts = self._present_and_counts
        *others, rows, instruments = values.shape
        padded = np.zeros((*others, len(counts) * self.bins.rows_per_bin, instruments))
        padded[..., :rows, :] = np.where(present, values, 0.0)
        total = padded.reshape(*others, len(counts), self.bins.rows_per_bin, instruments).sum(axis=-2)
        return np.swapaxes(total / counts, -1, -2).reshape(*others, -1)

    @cached_property
    def _present_and_counts(self) -> tuple[np.ndarray, np.ndarray]:
        """Which readings are present, `(time, instrument)`, and their number in each bin, at least 1."""
        return np.asarray(self.bins.present) > 0, np.maximum(np.asarray(self.bins.counts()), 1.0)

    def replaced_errors(self, active: tuple[EffectParameters, ...]) -> dict[str, EffectParameters]:
        """The names of the errors with a prior that an effect replaces without one, each with the effect."""
        return {
            f"{_INSTRUMENT_ERRORS[one.effect.name]}[{self.target_name(one.effect)}]": one
            for one in active
            if one.effect.name in _INSTRUMENT_ERRORS
        }

    def taken_over(self, error: str, value: float) -> float:
        """The size of an effect that replaces an instrument's error of this value."""
        is_face = kind_of(error) == FacePositions.kind
        return float(DEPTH_SIGNS[SIDES.index(target_of(error))]) * value if is_face else value

    def noise_shape(self, parameters: Parameters, bins: BinnedReadings | None = None) -> NoiseShape:
        """The structure of the noise covariance, with the response to the faces at some parameters.

        As in an estimate the response is that of the stated positions.

        Args:
            parameters: of the wall.
            bins: of the readings; None for those of the diagnosis.
        """
        bins = self.bins if bins is None else bins
        responses = self.responses_to_face_errors(parameters)
        face_noise, errors = face_noise_of_model(self.case)
        return noise_shape_of_record(
            self.record, responses.impulse, bins, self.spacing, self.noise_stds, face_noise, errors,
            responses.binned_shared(bins),
        )  # fmt: skip

    def responses_to_face_errors(self, parameters: Parameters) -> FaceErrorResponses:
        """The responses of the readings to errors of the faces, at the stated positions."""
        positions = parameters.of_kind(SensorPositions.kind, FacePositions.kind)
        return self.responses_at(parameters.with_values(dict.fromkeys(positions, 0.0)))

    def responses_at(self, parameters: Parameters) -> FaceErrorResponses:
        """The same at the positions of some parameters."""
        plates = fluxes_of(self.case)
        return FaceErrorResponses(
            impulse=face_impulse_response(self.model, parameters),
            shared=face_change_response(self.model, parameters, self._changed_faces) if plates else None,
        )

    @cached_property
    def _changed_faces(self) -> Float[np.ndarray, "change interval power face"]:
        """One standard deviation of each error of a filtered face with one share in all rows, as changes of both, K.

        How its slow and its fast part bend between the rows, and what is uncertain in the filter.
        """
        whole, record = self.case.record, self.record
        filtered = faces_of_model(self.case)[0][diagnosis_window(self.case).as_slice]
        bent = whole.face_errors.bent_courses(record.faces, filtered, record.step)
        of_filter = whole.face_filter.courses_of_deviations(record.faces, record.step)
        as_splines = [[cubic_coefficients(face, spline_slopes(face, 1.0)) for face in faces] for faces in of_filter]
        courses = np.concatenate([bent, as_splines])
        changes = np.zeros((2 * len(courses), *courses.shape[2:], 2))
        for k, (part, side) in enumerate(np.ndindex(courses.shape[:2])):
            changes[k, ..., side] = courses[part, side]
        return changes

    def with_noise_memory(self, memory: NoiseMemory) -> DiagnosisProblem:
        """The same problem with the faces filtered for noise with a memory."""
        case = replace(self.case, record=self.case.record.with_noise_memory(memory))
        model = eqx.tree_at(lambda model: model.forcing, self.model, forcing_of_window(case, diagnosis_window(case)))
        return replace(self, case=case, record=self.record.with_noise_memory(memory), model=model)

    def with_pattern_at(self, diffusivity: float) -> DiagnosisProblem:
        """The same problem with the section's pattern computed at another diffusivity, m2/s."""
        pattern = section_pattern(self.stated, diagnosis_window(self.case), diffusivity)
        return replace(self, model=eqx.tree_at(lambda model: model.pattern, self.model, pattern))

    def without_pattern(self) -> DiagnosisProblem:
        """The same problem of a homogeneous wall: the section's pattern changes nothing."""
        assert self.model.pattern is not None
        model = eqx.tree_at(lambda model: model.pattern, self.model, self.model.pattern.without())
        kept = [name for name in self.parameters.estimated_names if kind_of(name) != SensorHeights.kind]
        return replace(self, model=model, parameters=self.parameters.estimating(kept), has_pattern=False)

    def estimated_names(self, active: tuple[EffectParameters, ...]) -> tuple[str, ...]:
        """The names of the parameters that a fit with these effects estimates."""
        replaced = self.replaced_errors(active)
        plain = (name for name in self.parameters.estimated_names if name not in replaced)
        return (*plain, *(name for one in active for name in one.names))

    def is_linear(self, active: tuple[EffectParameters, ...]) -> bool:
        """Whether the wall with these effects is linear and constant in time."""
        return all(effect_parameters.effect.linear for effect_parameters in active)

    def target_name(self, effect: AbstractEffect) -> str | None:
        """The target of an effect as in result.json."""
        return effect.target_name(self.model.sensors)

    def label(self, effect: AbstractEffect) -> str:
        """The effect and its target as text."""
        target = self.target_name(effect)
        text = effect.name.replace("_", " ")
        text = f"{text} ({effect.variant})" if effect.variant else text
        for instrument in ("face", "plate"):
            if effect.name.startswith(f"{instrument}_"):
                return f"{text.removeprefix(f'{instrument} ')} of the {target} {instrument}"
        if target in SIDES:
            return f"{text} of the {target} face"
        if target in AIRS:
            return f"{text} to {target} air"
        return text if target is None else f"{text} of {target}"


def diagnosis_problem(case: Case) -> DiagnosisProblem:
    """Prepare a case for the diagnosis.

    A wall with a section is taken as the equivalent homogeneous wall, and what the section changes in the readings is
    added to the model as a pattern.

    Args:
        case: the case; the rows used are the entire record, or `[choices] diagnose_days`.

    Returns:
        The model with all effects, the readings, and the parameters with their priors and bounds.

    Raises:
        InputError: no inner sensor and no plate has a reading in the rows used.
        RuntimeError: 64-bit floats are switched off.
    """
    require_x64()
    window = diagnosis_window(case)
    # no part of a diagnosis has windows of its own, and its record may be shorter than one
    days = min(case.choices.window_days, window.rows * case.record.step / DAY)
    stated = replace(case, choices=replace(case.choices, window_days=days))
    case = stated if stated.section is None else stated.in_one_dimension()
    has_pattern = stated.section is not None and not stated.section.is_homogeneous
    record = case.record.window(window.row, window.rows)
    readings = _readings(case, record)
    present = np.isfinite(readings)
    if not present.any():
        instruments = [name for name, some in (("inner sensor", case.sensors), ("plate", fluxes_of(case))) if some]
        raise InputError(f"{case.record.file}: no {' and no '.join(instruments)} has a reading in the rows used")
    positions = tuple(sensor.position for sensor in case.sensors)
    plates = tuple(float(output.position) for output in plate_outputs(case))
    search_range = search_range_of_record(record, positions, case.wall.length, plates)
    sensors, logged = len(case.sensors), set(record.regressors)
    # those of columns that were not logged are in the model too: one compilation serves the record with them as well
    effects = library(sensors, logged | set(unlogged(sensors, logged)))
    model = ModelWithEffects(
        forcing=forcing_of_window(case, window),
        effects=effects,
        log_prior=on_device(np.log(case.wall.diffusivity_prior)),
        reference_conductivity=on_device(initial_conductivity(case, window) if fluxes_of(case) else 1.0),
        pattern=section_pattern(stated, window, case.wall.diffusivity_prior) if has_pattern else None,
        sensors=tuple(sensor.name for sensor in case.sensors),
        substeps=max(1, int(np.ceil(record.step / MAX_SUBSTEP))),
    )
    bins, spacing = bin_readings(present, np.where(present, readings, 0.0), plates=bool(fluxes_of(case)))
    entries = tuple(EffectParameters(effect, effect.parameter_names(model.sensors)) for effect in effects)
    testable = tuple(one for one in entries if logged.issuperset(one.effect.required_regressors()))
    parameters = _parameters(stated if has_pattern else case, window, search_range, entries)
    return DiagnosisProblem(
        case, stated, record, readings, model, bins, spacing, testable, parameters, search_range,
        has_pattern=has_pattern,
    )  # fmt: skip


def _readings(case: Case, record: Record) -> np.ndarray:
    """The readings of the inner sensors, then of the plates, `(time, instrument)`."""
    plates = flux_readings(replace(case, record=record), Window(0, record.rows))
    return np.concatenate([record.sensors, plates], axis=1)


def _parameters(
    case: Case, window: Window, search_range: SearchRange, library: tuple[EffectParameters, ...]
) -> Parameters:
    """The parameters of the plain model, which are those of an estimate, and of all effects."""
    lowest, highest = np.log(np.array(distinguishable_range(case, window)) / case.wall.diffusivity_prior)
    plain = window_parameters(case, window, _PLAIN_KINDS).within(LOG_DIFFUSIVITY, lowest, highest)
    parameters = []
    for one in library:
        first = next(iter(one.effect.scan(search_range)), {})
        for name, parameter in zip(one.names, one.effect.parameters, strict=True):
            low, high = one.effect.bounds(parameter, search_range)
            value = first.get(parameter.name, float(getattr(one.effect, parameter.name)))
            value = min(max(value, low), high)
            parameters.append(Parameter(name, parameter.unit, value, lower=low, upper=high, scale=parameter.scale))
    return plain.followed_by(parameters).estimating(plain.estimated_names)
