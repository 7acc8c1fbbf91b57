"""What a wall is: its layers, the sensors in it, and the way to and from the dimensionless form.

SI units, temperatures in degC, plain floats; `x` counts from the left face.
"""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from itertools import accumulate
from typing import Literal, no_type_check

from .._internal.errors import InputError
from .._internal.validation import number, one_of, settle, text

Side = Literal["left", "right"]
SIDES: tuple[Side, Side] = ("left", "right")
"""Of the two faces, x = 0 first."""

_DIFFUSIVITY = (1e-9, 1e-3)  # m2/s; aerogel to metals lie far inside
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
        InputError: a value that is not a number above 0.
    """

    thickness: float
    conductivity: float
    heat_capacity: float

    def __post_init__(self) -> None:
        for name, unit in (("thickness", "m"), ("conductivity", "W/m/K"), ("heat_capacity", "J/m3/K")):
            settle(self, **{name: number(name, getattr(self, name), unit, above=0.0)})


@no_type_check
@dataclass(frozen=True)
class Wall:
    """A wall between its two faces.

    Its effective diffusivity is `length^2 / (R C) = k_eff / c_eff`, with `k_eff = L / sum(d/k)` and
    `c_eff = sum(c d) / L` over the layers.

    Args:
        length: m, between the two faces.
        diffusivity_prior: m2/s, the effective diffusivity to start from; left out (NaN), it follows
            from conductivity and heat capacity, or else from the layers.
        conductivity: W/m/K.
        heat_capacity: per volume, J/m3/K.
        outside: the face outdoors, "left" (x = 0) or "right".
        layers: from left to right; none means homogeneous.

    Raises:
        InputError: a value beyond what is possible, or layers that do not add up to the length.
    """

    length: float
    diffusivity_prior: float = math.nan
    conductivity: float | None = None
    heat_capacity: float | None = None
    outside: Side = "left"
    layers: tuple[Layer, ...] = ()

    def __post_init__(self) -> None:
        settle(self, length=number("length", self.length, "m", above=0.0), layers=tuple(self.layers))
        for name, unit in (("conductivity", "W/m/K"), ("heat_capacity", "J/m3/K")):
            if getattr(self, name) is not None:
                settle(self, **{name: number(name, getattr(self, name), unit, above=0.0)})
        one_of("outside", self.outside, SIDES)
        total = sum(layer.thickness for layer in self.layers)
        if self.layers and abs(total - self.length) > _THICKNESS_TOLERANCE * self.length:
            raise InputError(
                f"the layers' thicknesses sum to {total:.9g} m; they must sum to length = {self.length!r} m"
            )
        settle(self, diffusivity_prior=self._prior())

    @property
    def inside(self) -> Side:
        """The face indoors."""
        return "right" if self.outside == "left" else "left"

    @property
    def joints(self) -> tuple[float, ...]:
        """Where one layer meets the next, m from the left face."""
        return tuple(accumulate(layer.thickness for layer in self.layers[:-1]))

    @property
    def effective_conductivity(self) -> float | None:
        """W/m/K: as stated, or else of the layers in series, or None."""
        if self.conductivity is None and self.layers:
            return self._effective()[0]
        return self.conductivity

    def relative_layers(self) -> tuple[tuple[float, float, float], ...]:
        """Each layer's thickness (m), and conductivity and heat capacity over the wall's effective ones."""
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
        """The prior as given, or from what else was given, once it is plausible."""
        value, basis, hint = self.diffusivity_prior, "", _UNITS_OF_DIFFUSIVITY
        if isinstance(value, float) and math.isnan(value):
            hint = _UNITS_OF_CAPACITY
            if self.conductivity is not None and self.heat_capacity is not None:
                value, basis = self.conductivity / self.heat_capacity, " (conductivity / heat_capacity)"
            elif self.layers:
                k, c = self._effective()
                value, basis = k / c, " (of the layers)"
            else:
                raise InputError("diffusivity_prior is missing; give it, or conductivity and heat_capacity, or layers")
        low, high = _DIFFUSIVITY
        return number(f"diffusivity_prior{basis}", value, "m2/s", least=low, most=high, hint=hint)


@no_type_check
@dataclass(frozen=True)
class Sensor:
    """A temperature sensor in a wall.

    Args:
        name: the record's column.
        position: m from the left face.
        noise_std: K, of each reading.
        position_std: m.
        offset_std: K, prior of a constant offset; 0 means that none is estimated.
        unit: of the record's column, "degC", "degF" or "K"; None for the record's own.

    Raises:
        InputError: a value that is not a number within its limits.
    """

    name: str
    position: float
    _: KW_ONLY
    noise_std: float
    position_std: float = 0.0
    offset_std: float = 0.0
    unit: Literal["degC", "degF", "K"] | None = None

    def __post_init__(self) -> None:
        text("name", self.name)
        if self.unit is not None:
            one_of("unit", self.unit, ("degC", "degF", "K"))
        settle(
            self,
            position=number("position", self.position, "m"),
            noise_std=number("noise_std", self.noise_std, "K", above=0.0),
            position_std=number("position_std", self.position_std, "m", least=0.0),
            offset_std=number("offset_std", self.offset_std, "K", least=0.0),
        )
