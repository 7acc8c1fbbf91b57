"""The wall, its layers and its sensors, in SI units; x is the distance from the left face, m.

JAX may trace the numbers of a wall, a layer or a sensor. Of a traced number only a known value is checked.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from itertools import accumulate
from typing import Literal, no_type_check

from .._internal.arrays import known_value
from .._internal.errors import InputError
from .._internal.validation import error_context, number, one_of, set_fields, text

Side = Literal["left", "right"]
SIDES: tuple[Side, Side] = ("left", "right")
"""The two faces: "left" is x = 0, "right" is x = length."""

_DIFFUSIVITY = (1e-9, 1e-3)  # m2/s; all materials from aerogel to metals are inside this range
_UNITS_OF_DIFFUSIVITY = "a value in mm2/s is to be multiplied by 1e-6, one in m2/h divided by 3600"
_UNITS_OF_CAPACITY = "heat_capacity is per volume, J/m3/K: density x specific heat"
_THICKNESS_TOLERANCE = 1e-6  # of the wall's length


@no_type_check
@dataclass(frozen=True)
class Layer:
    """A homogeneous layer of a wall.

    Args:
        thickness: m.
        conductivity: W/m/K.
        heat_capacity: per volume, J/m3/K.

    Raises:
        InputError: a value is not a number above 0.
    """

    thickness: float
    conductivity: float
    heat_capacity: float

    def __post_init__(self) -> None:
        for name, unit in (("thickness", "m"), ("conductivity", "W/m/K"), ("heat_capacity", "J/m3/K")):
            set_fields(self, **{name: number(name, getattr(self, name), unit, above=0.0)})


@no_type_check
@dataclass(frozen=True)
class Wall:
    """A wall between its two faces.

    Its effective diffusivity is `L^2 / (R C) = k_eff / c_eff`, with the length `L`, the resistance `R = sum(d / k)`,
    the areal heat capacity `C = sum(c d)`, `k_eff = L / R` and `c_eff = C / L`.

    Args:
        length: m, between the two faces.
        diffusivity_prior: prior of the effective diffusivity, m2/s. Without it (NaN) the prior is conductivity /
            heat_capacity, or else the effective diffusivity of the layers.
        conductivity: W/m/K.
        heat_capacity: per volume, J/m3/K.
        outside: the face outdoors, "left" (x = 0) or "right".
        layers: from left to right; empty for a homogeneous wall.

    Raises:
        InputError: a value is not plausible, or the thicknesses of the layers do not sum to the length.
    """

    length: float
    diffusivity_prior: float = math.nan
    conductivity: float | None = None
    heat_capacity: float | None = None
    outside: Side = "left"
    layers: tuple[Layer, ...] = ()

    def __post_init__(self) -> None:
        set_fields(self, length=number("length", self.length, "m", above=0.0), layers=tuple(self.layers))
        for name, unit in (("conductivity", "W/m/K"), ("heat_capacity", "J/m3/K")):
            if getattr(self, name) is not None:
                set_fields(self, **{name: number(name, getattr(self, name), unit, above=0.0)})
        one_of("outside", self.outside, SIDES)
        if self.layers:
            self._check_thicknesses()
        set_fields(self, diffusivity_prior=self._prior())

    def _check_thicknesses(self) -> None:
        total, length = known_value(sum(layer.thickness for layer in self.layers)), known_value(self.length)
        if total is None or length is None:  # traced by JAX
            return
        if abs(total - length) > _THICKNESS_TOLERANCE * length:
            raise InputError(f"the layers' thicknesses sum to {total:.9g} m; they must sum to length = {length!r} m")

    @property
    def inside(self) -> Side:
        """The face indoors."""
        return "right" if self.outside == "left" else "left"

    @property
    def interfaces(self) -> tuple[float, ...]:
        """The positions of the interfaces between layers, m from the left face."""
        return tuple(accumulate(layer.thickness for layer in self.layers[:-1]))

    @property
    def effective_conductivity(self) -> float | None:
        """The stated conductivity, or else that of the layers in series, W/m/K; None where neither is stated."""
        if self.conductivity is None and self.layers:
            return self._effective()[0]
        return self.conductivity

    def relative_layers(self) -> tuple[tuple[float, float, float], ...]:
        """Thickness (m), conductivity and heat capacity of each layer, the last two relative to the effective ones."""
        if not self.layers:
            return ((self.length, 1.0, 1.0),)
        k, c = self._effective()
        return tuple((layer.thickness, layer.conductivity / k, layer.heat_capacity / c) for layer in self.layers)

    def _effective(self) -> tuple[float, float]:
        """Effective conductivity (W/m/K) and heat capacity (J/m3/K) of the layers."""
        resistance = sum(layer.thickness / layer.conductivity for layer in self.layers)
        capacity = sum(layer.thickness * layer.heat_capacity for layer in self.layers)
        return self.length / resistance, capacity / self.length

    def _prior(self) -> float:
        """The prior diffusivity, m2/s: as stated, or derived from the other properties."""
        value, basis, hint = self.diffusivity_prior, "", _UNITS_OF_DIFFUSIVITY
        if isinstance(value, float) and math.isnan(value):  # a traced value is stated
            hint = _UNITS_OF_CAPACITY
            if self.conductivity is not None and self.heat_capacity is not None:
                value, basis = self.conductivity / self.heat_capacity, " (conductivity / heat_capacity)"
            elif self.layers:
                k, c = self._effective()
                value, basis = k / c, " (of the layers)"
            else:
                raise InputError("diffusivity_prior is missing; give it, or conductivity and heat_capacity, or layers")
        low, high = _DIFFUSIVITY
        return number(f"diffusivity_prior{basis}", value, "m2/s", minimum=low, maximum=high, hint=hint)


@no_type_check
@dataclass(frozen=True)
class Sensor:
    """A temperature sensor in a wall.

    Args:
        name: the column of the record.
        position: m from the left face.
        noise_std: standard deviation of each reading, K.
        position_std: standard deviation of the position, m.
        offset_std: prior standard deviation of a constant offset, K; with 0 no offset is estimated.
        unit: of the column, "degC", "degF" or "K"; None for the unit of the record.
        height: of a sensor in a section, m from the section's bottom; None where it is not known.
        height_std: standard deviation of the height, m.

    Raises:
        InputError: a value is not a number within its limits.
    """

    name: str
    position: float
    _: KW_ONLY
    noise_std: float
    position_std: float = 0.0
    offset_std: float = 0.0
    unit: Literal["degC", "degF", "K"] | None = None
    height: float | None = None
    height_std: float = 0.0

    def __post_init__(self) -> None:
        text("name", self.name)
        if self.unit is not None:
            one_of("unit", self.unit, ("degC", "degF", "K"))
        set_fields(
            self,
            position=number("position", self.position, "m"),
            noise_std=number("noise_std", self.noise_std, "K", above=0.0),
            position_std=number("position_std", self.position_std, "m", minimum=0.0),
            offset_std=number("offset_std", self.offset_std, "K", minimum=0.0),
            height_std=number("height_std", self.height_std, "m", minimum=0.0),
        )
        if self.height is not None:
            set_fields(self, height=number("height", self.height, "m", minimum=0.0))
        elif self.height_std > 0.0:
            raise InputError("height_std is given, but no height; without both the height is taken as not known")


def sensor_label(count: int, name: object) -> str:
    """The table of a sensor as messages name it, such as `[[sensor]] 2 "T2"`."""
    return f'[[sensor]] {count} "{name}"' if isinstance(name, str) else f"[[sensor]] {count}"


def check_sensors(wall: Wall, sensors: Sequence[Sensor], in_section: bool = False) -> None:
    """Check that all sensors are inside the wall, and that their names and positions differ.

    Args:
        wall: the wall. sensors: inside it.
        in_section: whether it has a section, in which sensors at one distance from the left face differ by their
            heights.

    Raises:
        InputError: one of these is not so.
    """
    for count, sensor in enumerate(sensors, start=1):
        with error_context(sensor_label(count, sensor.name)):
            position, length = known_value(sensor.position), known_value(wall.length)
            if position is not None and length is not None and not 0.0 < position < length:
                raise InputError(
                    f"position = {position!r} m is not inside the wall; it must lie between 0 and length = {length!r} m"
                )
            for other, earlier in enumerate(sensors[: count - 1], start=1):
                if sensor.name == earlier.name:
                    raise InputError(f"name is that of [[sensor]] {other}; names must differ")
                same_height = sensor.height == earlier.height and not (in_section and sensor.height is None)
                if position is not None and position == known_value(earlier.position) and same_height:
                    also = f" at height = {sensor.height:g} m" if sensor.height is not None else ""
                    raise InputError(
                        f"position = {position!r} m{also} is that of [[sensor]] {other}; positions must differ"
                    )
