"""What a case is: a wall, its sensors, the record and the options, each field checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import no_type_check

import numpy as np

from .._internal.errors import InputError
from .._internal.validation import number, series, settle, within
from ..records.uniform_record import Record
from .options import Choices, check_choices
from .wall_and_sensors import Sensor, Wall

_LEARNING_FACTORS = (0.25, 1.0, 4.0, 16.0)  # of the prior, which may be wrong by several times


@no_type_check
@dataclass(frozen=True, eq=False)
class LearningSignal:
    """One run of the large model that the reduced model learns from.

    Args:
        diffusivity: m2/s.
        time: s from the first row, at a uniform step, (time,).
        faces: left and right face temperature, degC, (time, 2).
        coefficients: of the initial profile `sum_k a_k (x/L)^k`, degC.

    Raises:
        InputError: a diffusivity that is not above 0, or a coefficient that is no number.
    """

    diffusivity: float
    time: np.ndarray
    faces: np.ndarray
    coefficients: tuple[float, ...]

    def __post_init__(self) -> None:
        settle(
            self,
            diffusivity=number("diffusivity", self.diffusivity, "m2/s", above=0.0),
            coefficients=series("initial_coefficients", self.coefficients, "degC"),
        )


@dataclass(frozen=True)
class Case:
    """A wall, what was logged of it, and what to do with it.

    Args:
        name: how tables and reports call it.
        path: of the TOML file.
        wall: the wall.
        sensors: one per sensor inside the wall, in the order of the record's columns.
        record: what was logged.
        choices: what to do; learning diffusivities that are None follow from the wall's prior.
        learning: runs to learn from, in place of ones derived from the record; may be empty.
        description: one line.

    Raises:
        InputError: parts that do not fit each other.
    """

    name: str
    path: Path
    wall: Wall
    sensors: tuple[Sensor, ...]
    record: Record
    choices: Choices = field(default_factory=Choices)
    learning: tuple[LearningSignal, ...] = ()
    description: str = ""

    def __post_init__(self) -> None:
        settle(self, sensors=tuple(self.sensors), learning=tuple(self.learning))
        _check_sensors(self.wall, self.sensors)
        names, logged = tuple(sensor.name for sensor in self.sensors), self.record.names
        if logged != names:
            found, wanted = (", ".join(group) or "none" for group in (logged, names))
            raise InputError(f"the record's sensors are {found}; they must be the case's, {wanted}")
        if not self.sensors and not {"flux_left", "flux_right"} & set(self.record.regressors):
            raise InputError("no [[sensor]] and no flux; at least one sensor, flux_left or flux_right is needed")
        with within("[choices]"):
            check_choices(self.choices, self.record)
            if "layers" in self.choices.free and len(self.wall.layers) < 2:
                raise InputError('free = "layers": the wall has no layers; state two [[wall.layer]] at least')
        if self.choices.learning_diffusivities is None:
            derived = tuple(factor * self.wall.diffusivity_prior for factor in _LEARNING_FACTORS)
            settle(self, choices=replace(self.choices, learning_diffusivities=derived))

    def __str__(self) -> str:
        wall, choices = self.wall, self.choices
        order = f" of order {choices.order}" if choices.model == "mim" else ""
        layers = f", {len(wall.layers)} layers" if wall.layers else ""
        sensors = ", ".join(f"{sensor.name} at {sensor.position:g} m" for sensor in self.sensors)
        if self.sensors:
            sensors += f"; noise {_span([s.noise_std for s in self.sensors])} K"
            sensors += f", position +-{_span([1e3 * s.position_std for s in self.sensors])} mm"
        faces = self.record.face_position_std
        lines = [
            f"{self.name}{self.description and f': {self.description}'}",
            f"wall      {wall.length:g} m{layers}, outside on the {wall.outside}, "
            f"prior diffusivity {wall.diffusivity_prior:.3g} m2/s"
            + (f"; the faces' sensors +-{1e3 * faces:.3g} mm" if faces else ""),
            f"sensors   {sensors or 'none'}",
            f"record    {self.record.summary()}",
            f"choices   windows of {choices.window_days:g} d, model {choices.model}{order}, {choices.nodes} nodes",
        ]
        return "\n".join(lines).replace("\n", "\n  ")


def _place(count: int, name: object) -> str:
    """How messages call a sensor's table."""
    return f'[[sensor]] {count} "{name}"' if isinstance(name, str) else f"[[sensor]] {count}"


def _check_sensors(wall: Wall, sensors: Sequence[Sensor]) -> None:
    """Sensors are inside the wall, each with a name and a place of its own."""
    for count, sensor in enumerate(sensors, start=1):
        with within(_place(count, sensor.name)):
            if not 0.0 < sensor.position < wall.length:
                raise InputError(
                    f"position = {sensor.position!r} m is not inside the wall; it must lie between 0 and "
                    f"length = {wall.length!r} m"
                )
            for other, earlier in enumerate(sensors[: count - 1], start=1):
                if sensor.name == earlier.name:
                    raise InputError(f"name is that of [[sensor]] {other}; names must differ")
                if sensor.position == earlier.position:
                    there = f"is that of [[sensor]] {other}; positions must differ"
                    raise InputError(f"position = {sensor.position!r} m {there}")


def _span(values: Sequence[float]) -> str:
    low, high = min(values), max(values)
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"
