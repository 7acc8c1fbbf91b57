"""A case as the search for a missing effect sees it: what each parameter is, how far it may go, which are free.

The parameters are the diffusivity, what is free beside it (sine modes of the initial profile, position
errors and offsets within what the case says of its sensors, each with its prior), and those of every effect of the
library. An effect is in when its parameters are among those that a fit may move; the others keep their neutral
values.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from threading import Lock

import numpy as np
import scipy

from .._internal.arrays import on_device
from .._internal.errors import InputError
from .._internal.units import DAY
from ..case.case_definition import Case
from ..case.initial_profile import PROFILE_MODES
from ..case.time_window import diagnosed
from ..case.wall_and_sensors import SIDES
from ..inference.noise_covariance import MOST_READINGS, Bins
from ..models.finite_volume_wall import wall_cells
from ..models.state_space import require_x64
from ..records.uniform_record import Record
from .effects.base import AbstractEffect
from .effects.catalogue import library
from .effects.equation_terms import ForcingData
from .effects.heat_sources import AIRS
from .effects.search_range import Search, record_search
from .forward.time_stepping import LONGEST_SUBSTEP
from .model_with_effects import ModelWithEffects, first_order_columns, impulses, linearise

_NODES = 61


@dataclass(frozen=True, eq=False)
class EffectParameters:
    """Where an effect's parameters stand in the vector."""

    effect: AbstractEffect
    first: int

    @property
    def indices(self) -> range:
        """Of all its parameters; the first is the size."""
        return range(self.first, self.first + len(self.effect.parameters))

    def values(self, theta: np.ndarray) -> dict[str, float]:
        """Its parameters in a vector, by their names."""
        return {
            parameter.name: float(theta[i]) for parameter, i in zip(self.effect.parameters, self.indices, strict=True)
        }


@dataclass(frozen=True, eq=False)
class DiagnosisProblem:
    """A case prepared for the search.

    Args:
        record: the rows used.
        model: the wall with the whole library in. bins: the readings.
        slots: the library, in the vector's order. search: where and when to look.
    """

    case: Case
    record: Record
    model: ModelWithEffects = field(repr=False)
    bins: Bins = field(repr=False)
    library: tuple[EffectParameters, ...] = field(repr=False)
    search: Search

    @property
    def sensors(self) -> int:
        """How many inner sensors."""
        return self.model.sensors

    @property
    def size(self) -> int:
        """The number of parameters in the vector."""
        return self.library[-1].indices.stop

    def binned(self, values: np.ndarray) -> np.ndarray:
        """The means of values at the rows over each bin's readings; 0 in an empty bin."""
        present = np.asarray(self.bins.present) > 0
        short = -len(values) % self.bins.rows
        padded = np.pad(np.where(present, values, 0.0), ((0, short), (0, 0)))
        total = padded.reshape(-1, self.bins.rows, self.sensors).sum(axis=1)
        return (total / np.maximum(np.asarray(self.bins.counts()), 1.0)).T.reshape(-1)

    @cached_property
    def profile(self) -> range:
        """Of the initial profile's amplitudes."""
        return range(1, 1 + PROFILE_MODES)

    @cached_property
    def positions(self) -> range:
        """Of the position errors."""
        return range(self.profile.stop, self.profile.stop + self.sensors)

    @cached_property
    def offsets(self) -> range:
        """Of the offsets."""
        return range(self.positions.stop, self.positions.stop + self.sensors)

    @cached_property
    def depths(self) -> range:
        """Of the places of the faces' sensors, m inside the wall."""
        return range(self.offsets.stop, self.offsets.stop + len(SIDES))

    @cached_property
    def prior_width(self) -> np.ndarray:
        """Each parameter's prior width; infinite where there is none."""
        width = np.full(self.size, np.inf)
        span = max(1.0, self.search.warmest - self.search.coldest)
        width[self.profile] = span / np.arange(1, PROFILE_MODES + 1)
        for s, sensor in enumerate(self.case.sensors):
            width[self.positions[s]] = sensor.position_std
            width[self.offsets[s]] = sensor.offset_std
        width[self.depths] = self.record.face_position_std
        return width

    @cached_property
    def scale(self) -> np.ndarray:
        """A typical size of each parameter."""
        scale = np.where(np.isfinite(self.prior_width), self.prior_width, 0.1)
        for slot in self.library:
            scale[list(slot.indices)] = [p.scale for p in slot.effect.parameters]
        return scale

    @cached_property
    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Between which values each parameter is searched."""
        low, high = np.full(self.size, -np.inf), np.full(self.size, np.inf)
        for slot in self.library:
            for index, parameter in zip(slot.indices, slot.effect.parameters, strict=True):
                low[index], high[index] = slot.effect.bounds(parameter, self.search)
        return low, high

    @cached_property
    def neutral(self) -> np.ndarray:
        """The plain model's parameters at the prior diffusivity; places and times are where the scan begins."""
        theta = np.zeros(self.size)
        for slot in self.library:
            first = next(iter(slot.effect.scan(self.search)), {})
            for index, parameter in zip(slot.indices, slot.effect.parameters, strict=True):
                if not parameter.is_size:
                    default = float(getattr(slot.effect, parameter.name))
                    theta[index] = first.get(parameter.name, default)
        return theta

    def replaced(self, active: tuple[EffectParameters, ...]) -> list[tuple[int, EffectParameters]]:
        """The errors within a sensor's accuracy that an effect stands for without a prior, by index."""
        kinds = {"sensor_position": self.positions, "sensor_offset": self.offsets, "face_depth": self.depths}
        found = []
        for slot in active:
            target = slot.effect.target
            place = SIDES.index(target) if target in SIDES else target
            if slot.effect.name in kinds and isinstance(place, int):
                found.append((kinds[slot.effect.name][place], slot))
        return found

    def free(self, active: tuple[EffectParameters, ...]) -> list[int]:
        """What a fit with these effects moves: an error with a prior only where no effect stands for it."""
        replaced = {error for error, _ in self.replaced(active)}
        errors = [*self.positions, *self.offsets, *self.depths]
        found = [0, *self.profile, *(i for i in errors if self.prior_width[i] > 0 and i not in replaced)]
        return [*found, *(index for slot in active for index in slot.indices)]

    @cached_property
    def most_free(self) -> int:
        """How many parameters the compiled fit can move: three effects with places fit in."""
        return len(self.free(())) + 8

    def is_linear(self, active: tuple[EffectParameters, ...]) -> bool:
        """Whether the wall stays linear and constant in time with these effects."""
        return all(slot.effect.linear for slot in active)

    def target_name(self, effect: AbstractEffect) -> str | None:
        """An effect's target as result.json says it."""
        target = effect.target
        return self.case.sensors[target].name if isinstance(target, int) else target

    def label(self, effect: AbstractEffect) -> str:
        """An effect and its target in words."""
        target = self.target_name(effect)
        words = effect.name.replace("_", " ")
        words = f"{words} ({effect.variant})" if effect.variant else words
        if effect.name.startswith("face_"):
            return f"{words.removeprefix('face ')} of the {target} face"
        if target in SIDES:
            return f"{words} of the {target} face"
        if target in AIRS:
            return f"{words} to {target} air"
        return words if target is None else f"{words} of {target}"


def diagnosis_problem(case: Case) -> DiagnosisProblem:
    """Prepare a case for the search.

    Raises:
        InputError: no inner sensor, or no reading in the rows used.
        RuntimeError: 64-bit floats are switched off.
    """
    require_x64()
    if not case.sensors:
        raise InputError(
            f"{case.path}: no [[sensor]]: what is missing shows in a temperature inside the wall; add a sensor"
        )
    record = _rows_used(case)
    present = np.isfinite(record.sensors)
    if not present.any():
        raise InputError(f"{case.record.file}: no inner sensor has a reading in the rows used")
    sensors = len(case.sensors)
    positions = tuple(sensor.position for sensor in case.sensors)
    search = record_search(record, positions, case.wall.length)
    effects = library(sensors, record.regressors)
    model = ModelWithEffects(
        forcing=_campaign(case, record),
        effects=effects,
        log_prior=on_device(np.log(case.wall.diffusivity_prior)),
        sensors=sensors,
        substeps=max(1, int(np.ceil(record.step / LONGEST_SUBSTEP))),
    )
    bins = Bins(
        observed=on_device(np.where(present, record.sensors, 0.0)),
        present=on_device(present.astype(float)),
        rows=max(1, int(np.ceil(record.rows * sensors / MOST_READINGS))),
    )
    slots, first = [], 1 + PROFILE_MODES + 2 * sensors + len(SIDES)
    for effect in effects:
        slots.append(EffectParameters(effect, first))
        first += len(effect.parameters)
    return DiagnosisProblem(case, record, model, bins, tuple(slots), search)


def _rows_used(case: Case) -> Record:
    window = diagnosed(case)
    return case.record.window(window.row, window.rows)


def _campaign(case: Case, record: Record) -> ForcingData:
    """The record between its rows, and the wall's cells."""
    rows = np.arange(record.rows)

    def cubic(values: np.ndarray) -> np.ndarray:
        there = np.isfinite(values)
        held = np.interp(rows, rows[there], values[there]) if not there.all() else values
        return scipy.interpolate.PchipInterpolator(rows, held).c[::-1].T  # powers of s, (interval, power)

    zeros = np.zeros(record.rows)

    def logged(key: str) -> np.ndarray:
        values = record.regressors.get(key)
        return cubic(zeros if values is None or not np.isfinite(values).any() else values)

    heating = record.regressors.get("heating", zeros)
    largest = np.nanmax(np.abs(heating)) if np.isfinite(heating).any() else 0.0
    places, resistance, capacity = (case.wall.length * part for part in wall_cells(case.wall, _NODES))
    everything = np.concatenate([record.faces.ravel(), record.sensors.ravel()])
    return ForcingData(
        step=on_device(record.step),
        faces=on_device(np.stack([cubic(record.faces[:, side]) for side in (0, 1)], axis=-1)),
        irradiance=on_device(logged("irradiance")),
        outdoor=on_device(logged("air_outdoor")),
        indoor=on_device(logged("air_indoor")),
        heating=on_device(logged("heating") / (largest or 1.0)),
        hour=on_device(_hours(record)[:-1]),
        start_profile=on_device(record.faces[0]),
        reference=on_device(np.nanmean(everything)),
        places=on_device(places),
        resistance=on_device(resistance),
        capacity=on_device(capacity),
        position=on_device(np.array([sensor.position for sensor in case.sensors])),
        length=on_device(case.wall.length),
    )


def _hours(record: Record) -> np.ndarray:
    """Hour of the day of each row, by the record's own clock; since the first row where it has only seconds."""
    stamps = record.stamps
    if np.issubdtype(stamps.dtype, np.datetime64):
        since = (stamps - stamps.astype("datetime64[D]")) / np.timedelta64(1, "s")
        return np.asarray(since, float) / 3600.0
    return np.mod(np.asarray(stamps, float), DAY) / 3600.0


_compiled: set[tuple[object, ...]] = set()
_compiling = Lock()


def compile_together(study: DiagnosisProblem) -> None:
    """Compile what every search needs side by side: a person waits for the sum otherwise.

    Does nothing where records of this shape have been searched before, and waits where that has just begun.
    """
    with _compiling:
        _compile(study)


def _compile(study: DiagnosisProblem) -> None:
    shape = (
        study.record.rows,
        study.sensors,
        study.model.substeps,
        tuple(type(s.effect) for s in study.library),
    )
    if shape in _compiled:
        return
    theta = study.neutral
    none = np.zeros((study.most_free, study.size))
    work = (
        lambda: linearise(study.model, study.bins, theta, none, linear=True),
        lambda: first_order_columns(study.model, study.bins, theta, theta[None], none[:1]),
        lambda: impulses(study.model, theta),
    )
    with ThreadPoolExecutor(min(len(work), os.cpu_count() or 1)) as pool:
        for done in [pool.submit(one) for one in work]:
            done.result()
    _compiled.add(shape)
