"""Effects that add or remove heat inside the wall: heat sources, lateral loss, air flow."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .base import AbstractEffect, Parameter, lower_bounded, parameter_field
from .equation_terms import CONSTANT, ForcingData, Source, Terms
from .search_range import SearchRange

Air = Literal["outdoor", "indoor"]
AIRS: tuple[Air, Air] = ("outdoor", "indoor")
SOURCE_WIDTH = 0.05
"""Standard deviation of the profile of a placed source over the length of the wall."""


class _HeatSource(AbstractEffect):
    """`dT/dt = ... + rate p(x) c(t)`, with p = 1 or `p = exp(-((x - place)/(L/20))^2/2)`, and a signal c."""

    def scan(self, search_range: SearchRange) -> Iterator[dict[str, float]]:
        """Positions and hours on a grid, where this form has them."""
        names = {parameter.name for parameter in self.parameters}
        positions = [search_range.length * share for share in _SHARES] if "place" in names else [None]
        widths = (7,) if "place" in names else (5, 9)
        spans = (
            [(float(a), float(a + width)) for width in widths for a in range(0, 24, 4)] if "start" in names else [None]
        )
        for position in positions:
            for span in spans:
                point = {} if position is None else {"place": position}
                yield point | ({} if span is None else {"start": span[0], "end": span[1]})

    def bounds(self, parameter: Parameter, search_range: SearchRange) -> tuple[float, float]:
        """Positions inside the wall; hours of a day and of parts of its neighbours."""
        if parameter.name == "place":
            return 0.02 * search_range.length, 0.98 * search_range.length
        if parameter.name == "start":
            return -6.0, 30.0
        if parameter.name == "end":
            return -5.0, 40.0
        return super().bounds(parameter, search_range)


_SHARES = (0.1, 0.3, 0.5, 0.7, 0.9)  # positions of the grid over the length of the wall
_RATE = Parameter("rate", "K/s", 2e-6, smallest_reported=1e-7)
_PLACE = Parameter("place", "m", 0.02)
_HOURS = (Parameter("start", "h", 1.0), Parameter("end", "h", 1.0))


def _constant(forcing: ForcingData) -> Array:
    return jnp.ones((forcing.intervals, 1)) * CONSTANT


def hours_signal(forcing: ForcingData, start: Array, end: Array) -> Array:
    """Share of each interval between rows that lies between two hours of the day, `(interval, power)`.

    Args:
        forcing: with the hour of the day at each row.
        start: first hour.
        end: last hour; may be after midnight.
    """
    width = forcing.step / 3600.0
    days = 24.0 * np.arange(-1, 3)  # the hours, and the interval between two rows, may contain midnight
    hour = forcing.hour[:, None]
    low, high = jnp.maximum(hour, start + days), jnp.minimum(hour + width, end + days)
    share = jnp.sum(jnp.maximum(high - low, 0.0) / width, axis=1)
    return share[:, None] * CONSTANT


class UniformSource(_HeatSource):
    """Constant heat source in the entire wall: `q/(rho c) = rate`."""

    name: ClassVar[str] = "heat_source"
    parameters: ClassVar = (_RATE,)
    rate: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(sources=(Source(self.rate, None, _constant(forcing)),))


class PlacedSource(_HeatSource):
    """Constant heat source at one position: `q/(rho c) = rate exp(-((x - place)/(L/20))^2/2)`."""

    name: ClassVar[str] = "heat_source"
    variant: ClassVar[str] = "placed"
    parameters: ClassVar = (_RATE, _PLACE)
    rate: Float[Array, ""] = parameter_field()
    place: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(sources=(Source(self.rate, self.place, _constant(forcing)),))


class HourlySource(_HeatSource):
    """Heat source in the entire wall between two hours of each day: `q/(rho c) = rate`, else 0."""

    name: ClassVar[str] = "heat_source"
    variant: ClassVar[str] = "hourly"
    parameters: ClassVar = (_RATE, *_HOURS)
    rate: Float[Array, ""] = parameter_field()
    start: Float[Array, ""] = parameter_field()
    end: Float[Array, ""] = parameter_field(1.0)

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(sources=(Source(self.rate, None, hours_signal(forcing, self.start, self.end)),))


class PlacedHourlySource(_HeatSource):
    """Heat source at one position between two hours of a day: `q/(rho c) = rate exp(-((x - place)/(L/20))^2/2)`."""

    name: ClassVar[str] = "heat_source"
    variant: ClassVar[str] = "placed, hourly"
    parameters: ClassVar = (_RATE, _PLACE, *_HOURS)
    rate: Float[Array, ""] = parameter_field()
    place: Float[Array, ""] = parameter_field()
    start: Float[Array, ""] = parameter_field()
    end: Float[Array, ""] = parameter_field(1.0)

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(sources=(Source(self.rate, self.place, hours_signal(forcing, self.start, self.end)),))


class HeatedSource(_HeatSource):
    """Heat source in the entire wall: `q/(rho c) = rate heating(t)`, heating relative to its largest value."""

    name: ClassVar[str] = "heat_source"
    variant: ClassVar[str] = "with the heating"
    parameters: ClassVar = (_RATE,)
    needs: ClassVar[tuple[str, ...]] = ("heating",)
    rate: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(sources=(Source(self.rate, None, forcing.heating),))


class LateralLoss(AbstractEffect):
    """Lateral loss to outdoor or indoor air: `dT/dt = ... + rate (T_air - T)`."""

    name: ClassVar[str] = "lateral_loss"
    parameters: ClassVar = (Parameter("rate", "1/s", 2e-6, smallest_reported=1e-7, lower=0.0, upper=1e-3),)
    air: Air = eqx.field(static=True, default="outdoor")
    rate: Float[Array, ""] = parameter_field()

    @property
    def target(self) -> Air:
        """The air."""
        return self.air

    def required_regressors(self) -> tuple[str, ...]:
        """The temperature of that air."""
        return (f"air_{self.air}",)

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        mask = np.array([float(air == self.air) for air in AIRS])
        return terms.add(loss=lower_bounded(self.rate, 0.0) * mask)


class AirFlow(AbstractEffect):
    """Air flow through the wall: `dT/dt = ... - velocity dT/dx`, effective velocity, positive along +x."""

    name: ClassVar[str] = "air_flow"
    parameters: ClassVar = (Parameter("velocity", "m/s", 5e-7, smallest_reported=3e-8, lower=-1e-4, upper=1e-4),)
    velocity: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(velocity=self.velocity)
