"""Effects in the material: layers, joints, temperature dependence, phase change, drying and wetting."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import jax.numpy as jnp
from jax.scipy.special import ndtr
from jaxtyping import Array, Float

from ..._internal.units import DAY
from .base import AbstractEffect, Parameter, lower_bounded, parameter_field
from .equation_terms import ForcingData, LatentHeat, Step, Terms, Wetting
from .search_range import SearchRange

LATENT_WIDTH = 0.5
"""Standard deviation of the peak of the heat capacity at a phase change, K."""


class _Placed(AbstractEffect):
    """An effect at an unknown position."""

    def scan(self, search_range: SearchRange) -> Iterator[dict[str, float]]:
        """Each candidate position of an interface."""
        name = self.parameters[1].name
        yield from ({name: value} for value in search_range.interface_positions)

    def bounds(self, parameter: Parameter, search_range: SearchRange) -> tuple[float, float]:
        """Positions between the outermost sensors."""
        if parameter.is_size:
            return super().bounds(parameter, search_range)
        return search_range.interface_positions[0], search_range.interface_positions[-1]


class LayeredConductivity(_Placed):
    """Two layers: `ln(k right of the interface / k left of it) = log_ratio`."""

    name: ClassVar[str] = "layered_conductivity"
    parameters: ClassVar = (
        Parameter("log_ratio", "", 0.2, smallest_reported=0.03, lower=-5.0, upper=5.0),
        Parameter("interface", "m", 0.02),
    )
    log_ratio: Float[Array, ""] = parameter_field()
    interface: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(conductivity_steps=(Step(self.log_ratio, self.interface),))


class LayeredCapacity(_Placed):
    """Two layers: `ln(rho c right of the interface / rho c left of it) = log_ratio`."""

    name: ClassVar[str] = "layered_capacity"
    parameters: ClassVar = LayeredConductivity.parameters
    log_ratio: Float[Array, ""] = parameter_field()
    interface: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(capacity_steps=(Step(self.log_ratio, self.interface),))


class ContactResistance(_Placed):
    """A joint with the resistance `thickness / k`, that of so many metres of the wall, in m2 K/W."""

    name: ClassVar[str] = "contact_resistance"
    parameters: ClassVar = (
        Parameter("thickness", "m", 0.02, smallest_reported=3e-3, lower=0.0, upper=100.0),
        Parameter("place", "m", 0.02),
    )
    thickness: Float[Array, ""] = parameter_field()
    place: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(joints=(Step(lower_bounded(self.thickness, 0.0), self.place),))


class TemperatureDependentConductivity(AbstractEffect):
    """Conductivity linear in temperature: `k = k0 (1 + slope (T - T0))`."""

    name: ClassVar[str] = "temperature_dependent_conductivity"
    parameters: ClassVar = (Parameter("slope", "1/K", 5e-3, smallest_reported=5e-4, lower=-0.1, upper=0.1),)
    linear: ClassVar[bool] = False
    slope: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(conductivity_slope=self.slope)


class TemperatureDependentCapacity(AbstractEffect):
    """Heat capacity linear in temperature: `c = c0 (1 + slope (T - T0))`."""

    name: ClassVar[str] = "temperature_dependent_capacity"
    parameters: ClassVar = TemperatureDependentConductivity.parameters
    linear: ClassVar[bool] = False
    slope: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(capacity_slope=self.slope)


class PhaseChange(AbstractEffect):
    """Phase change: `c = c0 (1 + area N(T; temperature, 0.5 K))`, N the normal density in 1/K."""

    name: ClassVar[str] = "phase_change"
    parameters: ClassVar = (
        Parameter("area", "K", 2.0, smallest_reported=0.2, lower=0.0, upper=500.0),
        Parameter("temperature", "degC", 1.0),
    )
    linear: ClassVar[bool] = False
    area: Float[Array, ""] = parameter_field()
    temperature: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(latent=(LatentHeat(lower_bounded(self.area, 0.0), self.temperature),))

    def scan(self, search_range: SearchRange) -> Iterator[dict[str, float]]:
        """A grid over the temperatures of the readings, with 0 degC for water."""
        low, high = self.bounds(self.parameters[1], search_range)
        grid = [low + (high - low) * i / 6 for i in range(7)]
        if low < 0.0 < high:
            grid = sorted([0.0, *(value for value in grid if abs(value) > 0.5)])
        yield from ({"temperature": value} for value in grid)

    def bounds(self, parameter: Parameter, search_range: SearchRange) -> tuple[float, float]:
        """Temperatures between the lowest and the highest reading, with a margin."""
        if parameter.is_size:
            return super().bounds(parameter, search_range)
        margin = 0.1 * (search_range.warmest - search_range.coldest)
        return search_range.coldest + margin, search_range.warmest - margin


class DiffusivityDrift(AbstractEffect):
    """Drift of the diffusivity, as in a wall that dries: `alpha (1 + rate t)`, t in days since the first row."""

    name: ClassVar[str] = "diffusivity_drift"
    parameters: ClassVar = (Parameter("rate", "1/day", 5e-3, smallest_reported=5e-4, lower=-0.2, upper=0.5),)
    linear: ClassVar[bool] = False
    rate: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(drift=self.rate)

    def bounds(self, parameter: Parameter, search_range: SearchRange) -> tuple[float, float]:
        """Rates with which alpha stays above a tenth of its first value."""
        return -0.9 * DAY / search_range.duration, 10 * DAY / search_range.duration


class WettingByRain(AbstractEffect):
    """Wetting by rain: `alpha (1 + jump exp(-(t - time)/time_constant))` for t > time."""

    name: ClassVar[str] = "wetting"
    parameters: ClassVar = (
        Parameter("jump", "", 0.1, smallest_reported=0.02, lower=-0.8, upper=5.0),
        Parameter("time_constant", "s", DAY),
        Parameter("time", "s", DAY / 4),
    )
    linear: ClassVar[bool] = False
    jump: Float[Array, ""] = parameter_field()
    time_constant: Float[Array, ""] = parameter_field(DAY)
    time: Float[Array, ""] = parameter_field()

    @property
    def event(self) -> tuple[float, float]:
        """Time of the rain and time constant of the drying, s."""
        return float(self.time), float(self.time_constant)

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(wettings=(Wetting(self.jump, lower_bounded(self.time_constant, 3600.0), self.time),))

    def scan(self, search_range: SearchRange) -> Iterator[dict[str, float]]:
        """The rain events, or a grid of times where no rain was logged, with two time constants."""
        times = search_range.rain or tuple(search_range.duration * (0.05 + 0.1 * i) for i in range(9))
        longest = self.bounds(self.parameters[1], search_range)[1]
        for constant in sorted({min(1.5 * DAY, longest), min(5 * DAY, longest)}):
            yield from (
                {"time": time, "time_constant": constant} for time in times if time < 0.9 * search_range.duration
            )

    def bounds(self, parameter: Parameter, search_range: SearchRange) -> tuple[float, float]:
        """Time constants up to half the record; a longer one cannot be distinguished from a drift."""
        if parameter.name == "time_constant":
            return 0.1 * DAY, max(0.2 * DAY, 0.5 * search_range.duration)
        if parameter.name == "time":
            return 0.0, 0.95 * search_range.duration
        return super().bounds(parameter, search_range)


def latent_capacity(latent: tuple[LatentHeat, ...], temperature: Array) -> Array:
    """Heat capacity of the phase changes over that of the wall: `sum area N(T; temperature, 0.5 K)`.

    Args:
        latent: the phase changes.
        temperature: degC, any shape.
    """
    total = jnp.zeros_like(temperature)
    for change in latent:
        z = (temperature - change.temperature) / LATENT_WIDTH
        total = total + change.area * jnp.exp(-0.5 * z * z) / (LATENT_WIDTH * jnp.sqrt(2 * jnp.pi))
    return total


def latent_heat(latent: tuple[LatentHeat, ...], temperature: Array) -> Array:
    """Integral of `latent_capacity` from minus infinity to a temperature, K.

    Args:
        latent: the phase changes.
        temperature: degC, any shape.
    """
    total = jnp.zeros_like(temperature)
    for change in latent:
        total = total + change.area * ndtr((temperature - change.temperature) / LATENT_WIDTH)
    return total
