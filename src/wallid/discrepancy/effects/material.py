"""Effects in the wall's material: layers, joints, temperature, frost, drying and wetting."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import jax.numpy as jnp
from jax.scipy.special import ndtr
from jaxtyping import Array, Float

from ..._internal.units import DAY
from .base import AbstractEffect, Parameter, not_below, number
from .equation_terms import ForcingData, Step, Terms, Wetting
from .search_range import Search

LATENT_WIDTH = 0.5
"""Standard deviation of the capacity's bump at a phase change, K."""


class _Placed(AbstractEffect):
    """An effect at a place that has to be found."""

    def scan(self, search: Search) -> Iterator[dict[str, float]]:
        """Each candidate place."""
        place = self.parameters[1].name
        yield from ({place: value} for value in search.places)

    def bounds(self, parameter: Parameter, search: Search) -> tuple[float, float]:
        """A place lies between the outermost sensors."""
        if parameter.is_size:
            return super().bounds(parameter, search)
        return search.places[0], search.places[-1]


class LayeredConductivity(_Placed):
    """`ln(k right of the interface / k left of it) = log_ratio`."""

    name: ClassVar[str] = "layered_conductivity"
    parameters: ClassVar = (
        Parameter("log_ratio", "", 0.2, worth=0.03, least=-5.0, most=5.0),
        Parameter("interface", "m", 0.02),
    )
    log_ratio: Float[Array, ""] = number()
    interface: Float[Array, ""] = number()

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return terms.add(conductivity_steps=(Step(self.log_ratio, self.interface),))


class LayeredCapacity(_Placed):
    """`ln(c right of the interface / c left of it) = log_ratio`."""

    name: ClassVar[str] = "layered_capacity"
    parameters: ClassVar = LayeredConductivity.parameters
    log_ratio: Float[Array, ""] = number()
    interface: Float[Array, ""] = number()

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return terms.add(capacity_steps=(Step(self.log_ratio, self.interface),))


class ContactResistance(_Placed):
    """A joint whose resistance is that of `thickness` metres of the wall."""

    name: ClassVar[str] = "contact_resistance"
    parameters: ClassVar = (
        Parameter("thickness", "m", 0.02, worth=3e-3, least=0.0, most=100.0),
        Parameter("place", "m", 0.02),
    )
    thickness: Float[Array, ""] = number()
    place: Float[Array, ""] = number()

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return terms.add(joints=(Step(not_below(self.thickness, 0.0), self.place),))


class TemperatureDependentConductivity(AbstractEffect):
    """`k = k0 (1 + slope (T - T0))`."""

    name: ClassVar[str] = "temperature_dependent_conductivity"
    parameters: ClassVar = (Parameter("slope", "1/K", 5e-3, worth=5e-4, least=-0.1, most=0.1),)
    linear: ClassVar[bool] = False
    slope: Float[Array, ""] = number()

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return terms.add(conductivity_slope=self.slope)


class TemperatureDependentCapacity(AbstractEffect):
    """`c = c0 (1 + slope (T - T0))`."""

    name: ClassVar[str] = "temperature_dependent_capacity"
    parameters: ClassVar = TemperatureDependentConductivity.parameters
    linear: ClassVar[bool] = False
    slope: Float[Array, ""] = number()

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return terms.add(capacity_slope=self.slope)


class PhaseChange(AbstractEffect):
    """`c = c0 (1 + area N(T; temperature, 0.5 K))`, N the normal density."""

    name: ClassVar[str] = "phase_change"
    parameters: ClassVar = (
        Parameter("area", "K", 2.0, worth=0.2, least=0.0, most=500.0),
        Parameter("temperature", "degC", 1.0),
    )
    linear: ClassVar[bool] = False
    area: Float[Array, ""] = number()
    temperature: Float[Array, ""] = number()

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return terms.add(latent=(Step(not_below(self.area, 0.0), self.temperature),))

    def scan(self, search: Search) -> Iterator[dict[str, float]]:
        """Water's 0 degC, and a grid over the temperatures seen."""
        low, high = self.bounds(self.parameters[1], search)
        grid = [low + (high - low) * i / 6 for i in range(7)]
        if low < 0.0 < high:
            grid = sorted([0.0, *(value for value in grid if abs(value) > 0.5)])
        yield from ({"temperature": value} for value in grid)

    def bounds(self, parameter: Parameter, search: Search) -> tuple[float, float]:
        """A temperature that the wall passes through."""
        if parameter.is_size:
            return super().bounds(parameter, search)
        margin = 0.1 * (search.warmest - search.coldest)
        return search.coldest + margin, search.warmest - margin


class DiffusivityDrift(AbstractEffect):
    """`alpha (1 + rate t)`, t in days since the first row: a wall that dries."""

    name: ClassVar[str] = "diffusivity_drift"
    parameters: ClassVar = (Parameter("rate", "1/day", 5e-3, worth=5e-4, least=-0.2, most=0.5),)
    linear: ClassVar[bool] = False
    rate: Float[Array, ""] = number()

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return terms.add(drift=self.rate)

    def bounds(self, parameter: Parameter, search: Search) -> tuple[float, float]:
        """A diffusivity that stays above a tenth to the record's end."""
        return -0.9 * DAY / search.duration, 10 * DAY / search.duration


class WettingByRain(AbstractEffect):
    """`alpha (1 + jump exp(-(t - time)/time_constant))` from `time` on."""

    name: ClassVar[str] = "wetting"
    parameters: ClassVar = (
        Parameter("jump", "", 0.1, worth=0.02, least=-0.8, most=5.0),
        Parameter("time_constant", "s", DAY),
        Parameter("time", "s", DAY / 4),
    )
    linear: ClassVar[bool] = False
    jump: Float[Array, ""] = number()
    time_constant: Float[Array, ""] = number(DAY)
    time: Float[Array, ""] = number()

    @property
    def event(self) -> tuple[float, float]:
        """The rain, and the time constant of the drying."""
        return float(self.time), float(self.time_constant)

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return terms.add(wettings=(Wetting(self.jump, not_below(self.time_constant, 3600.0), self.time),))

    def scan(self, search: Search) -> Iterator[dict[str, float]]:
        """The rain events, or a grid of times where no rain was logged; two time constants."""
        times = search.rain or tuple(search.duration * (0.05 + 0.1 * i) for i in range(9))
        longest = self.bounds(self.parameters[1], search)[1]
        for constant in sorted({min(1.5 * DAY, longest), min(5 * DAY, longest)}):
            yield from ({"time": time, "time_constant": constant} for time in times if time < 0.9 * search.duration)

    def bounds(self, parameter: Parameter, search: Search) -> tuple[float, float]:
        """A time constant over half the record would be a drift by another name."""
        if parameter.name == "time_constant":
            return 0.1 * DAY, max(0.2 * DAY, 0.5 * search.duration)
        if parameter.name == "time":
            return 0.0, 0.95 * search.duration
        return super().bounds(parameter, search)


def latent_capacity(latent: tuple[Step, ...], temperature: Array) -> Array:
    """The bumps' capacity over the wall's, at these temperatures."""
    total = jnp.zeros_like(temperature)
    for bump in latent:
        z = (temperature - bump.place) / LATENT_WIDTH
        total = total + bump.size * jnp.exp(-0.5 * z * z) / (LATENT_WIDTH * jnp.sqrt(2 * jnp.pi))
    return total


def latent_heat(latent: tuple[Step, ...], temperature: Array) -> Array:
    """The bumps' capacity integrated up to these temperatures, K of the wall's own heat."""
    total = jnp.zeros_like(temperature)
    for bump in latent:
        total = total + bump.size * ndtr((temperature - bump.place) / LATENT_WIDTH)
    return total
