"""A case prepared for the diagnosis: its model, readings, parameters, priors and bounds.

The parameter vector holds ln(alpha / prior), the nuisance parameters with their priors (amplitudes of the initial
profile, position errors and offsets of the sensors) and the parameters of every effect of the library. A model
contains an effect where the parameters of the effect are estimated; otherwise they keep their neutral values.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .._internal.arrays import on_device
from .._internal.errors import InputError
from ..case.case_definition import Case
from ..case.initial_profile import PROFILE_MODES
from ..case.time_window import diagnosis_window
from ..case.wall_and_sensors import SIDES
from ..inference.noise_covariance import MOST_READINGS, Bins
from ..models.state_space import require_x64
from ..records.uniform_record import Record
from .effects.base import AbstractEffect, Parameter
from .effects.catalogue import library
from .effects.heat_sources import AIRS
from .effects.search_range import SearchRange, search_range_of_record
from .forward.time_stepping import MAX_SUBSTEP
from .model_with_effects import ModelWithEffects
from .record_forcing import forcing_of_record


@dataclass(frozen=True, eq=False)
class EffectParameters:
    """An effect and the indices of its parameters in the parameter vector.

    Args:
        effect: the effect.
        size_index: index of its first parameter, the size.
    """

    effect: AbstractEffect
    size_index: int

    @property
    def indices(self) -> range:
        """Indices of all its parameters; the first is the size."""
        return range(self.size_index, self.size_index + len(self.effect.parameters))

    def values(self, theta: np.ndarray) -> dict[str, float]:
        """The values of its parameters in a parameter vector, by their names."""
        return {parameter.name: float(theta[i]) for i, parameter in self.indexed_parameters}

    @property
    def indexed_parameters(self) -> list[tuple[int, Parameter]]:
        """Each of its parameters with its index."""
        return list(zip(self.indices, self.effect.parameters, strict=True))


@dataclass(frozen=True, eq=False)
class DiagnosisProblem:
    """A case prepared for the diagnosis.

    Args:
        case: the case.
        record: the rows used.
        model: the wall with all effects of the library.
        bins: the readings, averaged over bins of rows.
        library: the effects with the indices of their parameters, in the order of the parameter vector.
        search_range: ranges of the positions, times and temperatures of effects.
    """

    case: Case
    record: Record
    model: ModelWithEffects = field(repr=False)
    bins: Bins = field(repr=False)
    library: tuple[EffectParameters, ...] = field(repr=False)
    search_range: SearchRange

    @property
    def sensor_count(self) -> int:
        """Number of inner sensors."""
        return self.model.sensor_count

    @property
    def parameter_count(self) -> int:
        """Length of the parameter vector."""
        return self.library[-1].indices.stop

    def binned(self, values: np.ndarray) -> np.ndarray:
        """Means over the readings of each bin, sensor by sensor, `(reading,)`; 0 in an empty bin.

        Args:
            values: at the rows, `(time, sensor)`.
        """
        present = np.asarray(self.bins.present) > 0
        short = -len(values) % self.bins.rows
        padded = np.pad(np.where(present, values, 0.0), ((0, short), (0, 0)))
        total = padded.reshape(-1, self.bins.rows, self.sensor_count).sum(axis=1)
        return (total / np.maximum(np.asarray(self.bins.counts()), 1.0)).T.reshape(-1)

    @cached_property
    def profile(self) -> range:
        """Indices of the amplitudes of the initial profile, K."""
        return range(1, 1 + PROFILE_MODES)

    @cached_property
    def positions(self) -> range:
        """Indices of the position errors of the inner sensors, m."""
        return range(self.profile.stop, self.profile.stop + self.sensor_count)

    @cached_property
    def offsets(self) -> range:
        """Indices of the offsets of the inner sensors, K."""
        return range(self.positions.stop, self.positions.stop + self.sensor_count)

    @cached_property
    def face_positions(self) -> range:
        """Indices of the depths of the two face sensors inside the wall, m."""
        return range(self.offsets.stop, self.offsets.stop + len(SIDES))

    @cached_property
    def prior_std(self) -> np.ndarray:
        """Prior standard deviation of each parameter; infinite where there is no prior."""
        std = np.full(self.parameter_count, np.inf)
        span = max(1.0, self.search_range.warmest - self.search_range.coldest)
        std[self.profile] = span / np.arange(1, PROFILE_MODES + 1)
        for s, sensor in enumerate(self.case.sensors):
            std[self.positions[s]] = sensor.position_std
            std[self.offsets[s]] = sensor.offset_std
        std[self.face_positions] = self.record.face_position_std
        return std

    @cached_property
    def scale(self) -> np.ndarray:
        """Typical magnitude of each parameter."""
        scale = np.where(np.isfinite(self.prior_std), self.prior_std, 0.1)
        for effect_parameters in self.library:
            scale[list(effect_parameters.indices)] = [p.scale for p in effect_parameters.effect.parameters]
        return scale

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of each parameter, `(param,)` each."""
        low, high = np.full(self.parameter_count, -np.inf), np.full(self.parameter_count, np.inf)
        for effect_parameters in self.library:
            for index, parameter in effect_parameters.indexed_parameters:
                low[index], high[index] = effect_parameters.effect.bounds(parameter, self.search_range)
        return low, high

    @cached_property
    def neutral(self) -> np.ndarray:
        """Parameters of the plain model at the prior diffusivity; the first grid point of each effect."""
        theta = np.zeros(self.parameter_count)
        for effect_parameters in self.library:
            first = next(iter(effect_parameters.effect.scan(self.search_range)), {})
            for index, parameter in effect_parameters.indexed_parameters:
                if not parameter.is_size:
                    default = float(getattr(effect_parameters.effect, parameter.name))
                    theta[index] = first.get(parameter.name, default)
        return theta

    def errors_replaced_by_effects(self, active: tuple[EffectParameters, ...]) -> list[tuple[int, EffectParameters]]:
        """Indices of the sensor errors with a prior that an effect replaces without one, each with the effect."""
        kinds = {"sensor_position": self.positions, "sensor_offset": self.offsets, "face_depth": self.face_positions}
        replaced = []
        for effect_parameters in active:
            target = effect_parameters.effect.target
            index = SIDES.index(target) if target in SIDES else target
            if effect_parameters.effect.name in kinds and isinstance(index, int):
                replaced.append((kinds[effect_parameters.effect.name][index], effect_parameters))
        return replaced

    def estimated_indices(self, active: tuple[EffectParameters, ...]) -> list[int]:
        """Indices of the parameters that a fit with these effects estimates."""
        replaced = {error for error, _ in self.errors_replaced_by_effects(active)}
        errors = [*self.positions, *self.offsets, *self.face_positions]
        plain = [0, *self.profile, *(i for i in errors if self.prior_std[i] > 0 and i not in replaced)]
        return [*plain, *(index for effect_parameters in active for index in effect_parameters.indices)]

    @cached_property
    def max_estimated(self) -> int:
        """Largest number of estimated parameters of the compiled fit: eight for the effects."""
        return len(self.estimated_indices(())) + 8

    def is_linear(self, active: tuple[EffectParameters, ...]) -> bool:
        """Whether the wall with these effects is linear and constant in time."""
        return all(effect_parameters.effect.linear for effect_parameters in active)

    def target_name(self, effect: AbstractEffect) -> str | None:
        """The target of an effect as in result.json."""
        target = effect.target
        return self.case.sensors[target].name if isinstance(target, int) else target

    def label(self, effect: AbstractEffect) -> str:
        """The effect and its target as text."""
        target = self.target_name(effect)
        text = effect.name.replace("_", " ")
        text = f"{text} ({effect.variant})" if effect.variant else text
        if effect.name.startswith("face_"):
            return f"{text.removeprefix('face ')} of the {target} face"
        if target in SIDES:
            return f"{text} of the {target} face"
        if target in AIRS:
            return f"{text} to {target} air"
        return text if target is None else f"{text} of {target}"


def diagnosis_problem(case: Case) -> DiagnosisProblem:
    """Prepare a case for the diagnosis.

    Args:
        case: the case; the rows used are the entire record, or `[choices] diagnose_days`.

    Returns:
        The model with all effects, the readings, and the parameters with their priors and bounds.

    Raises:
        InputError: the case has no inner sensor, or no inner sensor has a reading in the rows used.
        RuntimeError: 64-bit floats are switched off.
    """
    require_x64()
    if not case.sensors:
        raise InputError(f"{case.path}: no [[sensor]]: a diagnosis needs a temperature inside the wall; add a sensor")
    window = diagnosis_window(case)
    record = case.record.window(window.row, window.rows)
    present = np.isfinite(record.sensors)
    if not present.any():
        raise InputError(f"{case.record.file}: no inner sensor has a reading in the rows used")
    sensors = len(case.sensors)
    positions = tuple(sensor.position for sensor in case.sensors)
    search_range = search_range_of_record(record, positions, case.wall.length)
    effects = library(sensors, record.regressors)
    model = ModelWithEffects(
        forcing=forcing_of_record(case, record),
        effects=effects,
        log_prior=on_device(np.log(case.wall.diffusivity_prior)),
        sensor_count=sensors,
        substeps=max(1, int(np.ceil(record.step / MAX_SUBSTEP))),
    )
    bins = Bins(
        observed=on_device(np.where(present, record.sensors, 0.0)),
        present=on_device(present.astype(float)),
        rows=max(1, int(np.ceil(record.rows * sensors / MOST_READINGS))),
    )
    entries, index = [], 1 + PROFILE_MODES + 2 * sensors + len(SIDES)
    for effect in effects:
        entries.append(EffectParameters(effect, index))
        index += len(effect.parameters)
    return DiagnosisProblem(case, record, model, bins, tuple(entries), search_range)
