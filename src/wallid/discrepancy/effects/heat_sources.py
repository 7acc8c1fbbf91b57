"""Effects that bring heat in or take it away inside the wall."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .base import AbstractEffect, Parameter, not_below, number
from .equation_terms import CONSTANT, ForcingData, Source, Terms
from .search_range import Search

Air = Literal["outdoor", "indoor"]
AIRS: tuple[Air, Air] = ("outdoor", "indoor")
SOURCE_WIDTH = 0.05
"""Standard deviation of a source's profile about its place, over the wall's length."""


class _HeatSource(AbstractEffect):
    """`rate p(x) c(t)`, p = 1 or `exp(-((x - place)/(L/20))^2/2)`."""

    def scan(self, search: Search) -> Iterator[dict[str, float]]:
        """Places and hours on a grid, as far as this form has them."""
        names = {parameter.name for parameter in self.parameters}
        places = [search.length * share for share in _SHARES] if "place" in names else [None]
        widths = (7,) if "place" in names else (5, 9)
        spans = (
            [(float(a), float(a + width)) for width in widths for a in range(0, 24, 4)] if "start" in names else [None]
        )
        for place in places:
            for span in spans:
                found = {} if place is None else {"place": place}
                yield found | ({} if span is None else {"start": span[0], "end": span[1]})

    def bounds(self, parameter: Parameter, search: Search) -> tuple[float, float]:
        """A place lies inside the wall, hours within a day and the next."""
        if parameter.name == "place":
            return 0.02 * search.length, 0.98 * search.length
        if parameter.name == "start":
            return -6.0, 30.0
        if parameter.name == "end":
            return -5.0, 40.0
        return super().bounds(parameter, search)


_SHARES = (0.1, 0.3, 0.5, 0.7, 0.9)  # of the wall's length: where the scan looks for a placed source
_RATE = Parameter("rate", "K/s", 2e-6, worth=1e-7)
_PLACE = Parameter("place", "m", 0.02)
_HOURS = (Parameter("start", "h", 1.0), Parameter("end", "h", 1.0))


def _constant(campaign: ForcingData) -> Array:
    return jnp.ones((campaign.intervals, 1)) * CONSTANT


def hours_course(campaign: ForcingData, start: Array, end: Array) -> Array:
    """The share of each interval between rows that lies within these hours of the day."""
    width = campaign.step / 3600.0
    total = jnp.zeros(campaign.intervals)
    for day in (-1, 0, 1, 2):  # hours may pass midnight, a row's interval too
        low = jnp.maximum(campaign.hour, start + 24.0 * day)
        high = jnp.minimum(campaign.hour + width, end + 24.0 * day)
        total = total + jnp.maximum(high - low, 0.0) / width
    return total[:, None] * CONSTANT


class UniformSource(_HeatSource):
    """`q/(rho c) = rate` everywhere and always."""

    name: ClassVar[str] = "heat_source"
    parameters: ClassVar = (_RATE,)
    rate: Float[Array, ""] = number()

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return terms.add(sources=(Source(self.rate, None, _constant(campaign)),))


class PlacedSource(_HeatSource):
    """`q/(rho c) = rate exp(-((x - place)/(L/20))^2/2)` always."""

    name: ClassVar[str] = "heat_source"
    parameters: ClassVar = (_RATE, _PLACE)
    rate: Float[Array, ""] = number()
    place: Float[Array, ""] = number()

    @property
    def variant(self) -> str:
        """Which form."""
        return "placed"

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return terms.add(sources=(Source(self.rate, self.place, _constant(campaign)),))


class HourlySource(_HeatSource):
    """`q/(rho c) = rate` everywhere, between two hours of each day."""

    name: ClassVar[str] = "heat_source"
    parameters: ClassVar = (_RATE, *_HOURS)
    rate: Float[Array, ""] = number()
    start: Float[Array, ""] = number()
    end: Float[Array, ""] = number(1.0)

    @property
    def variant(self) -> str:
        """Which form."""
        return "hourly"

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return terms.add(sources=(Source(self.rate, None, hours_course(campaign, self.start, self.end)),))


class PlacedHourlySource(_HeatSource):
    """`q/(rho c) = rate exp(-((x - place)/(L/20))^2/2)`, between two hours of each day."""

    name: ClassVar[str] = "heat_source"
    parameters: ClassVar = (_RATE, _PLACE, *_HOURS)
    rate: Float[Array, ""] = number()
    place: Float[Array, ""] = number()
    start: Float[Array, ""] = number()
    end: Float[Array, ""] = number(1.0)

    @property
    def variant(self) -> str:
        """Which form."""
        return "placed, hourly"

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return terms.add(sources=(Source(self.rate, self.place, hours_course(campaign, self.start, self.end)),))


class HeatedSource(_HeatSource):
    """`q/(rho c) = rate heating(t)` everywhere, with the record's heating over its largest value."""

    name: ClassVar[str] = "heat_source"
    parameters: ClassVar = (_RATE,)
    needs: ClassVar[tuple[str, ...]] = ("heating",)
    rate: Float[Array, ""] = number()

    @property
    def variant(self) -> str:
        """Which form."""
        return "with the heating"

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return terms.add(sources=(Source(self.rate, None, campaign.heating),))


class LateralLoss(AbstractEffect):
    """`rate (T_air - T)`, to outdoor or indoor air."""

    name: ClassVar[str] = "lateral_loss"
    parameters: ClassVar = (Parameter("rate", "1/s", 2e-6, worth=1e-7, least=0.0, most=1e-3),)
    air: Air = eqx.field(static=True, default="outdoor")
    rate: Float[Array, ""] = number()

    @property
    def target(self) -> Air:
        """The air."""
        return self.air

    def required(self) -> tuple[str, ...]:
        """That air's temperature."""
        return (f"air_{self.air}",)

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        here = np.array([float(air == self.air) for air in AIRS])
        return terms.add(loss=not_below(self.rate, 0.0) * here)


class AirFlow(AbstractEffect):
    """`- velocity dT/dx`, effective, positive along +x."""

    name: ClassVar[str] = "air_flow"
    parameters: ClassVar = (Parameter("velocity", "m/s", 5e-7, worth=3e-8, least=-1e-4, most=1e-4),)
    velocity: Float[Array, ""] = number()

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return terms.add(velocity=self.velocity)
