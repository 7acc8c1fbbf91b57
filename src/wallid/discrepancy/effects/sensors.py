"""Effects in the inner sensors: where they are, how fast, how true; their logger's clock."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from ..._internal.units import DAY
from .base import AbstractEffect, Parameter, not_below, number
from .equation_terms import ForcingData, Terms

_MM = 1e-3


class _OneSensor(AbstractEffect):
    """An effect in one inner sensor, given by its place in the record's order."""

    sensor: eqx.AbstractVar[int]

    @property
    def target(self) -> int:
        """The sensor's place in the record's order."""
        return self.sensor

    def _add(self, terms: Terms, term: str, value: Array) -> Terms:
        here = np.arange(terms.position.shape[0]) == self.sensor
        return terms.add(**{term: value * here})


class SensorPosition(_OneSensor):
    """`T(x_s + shift)`: the true place minus the stated one."""

    name: ClassVar[str] = "sensor_position"
    parameters: ClassVar = (Parameter("shift", "m", 5 * _MM, worth=2 * _MM),)
    sensor: int = eqx.field(static=True, default=0)
    shift: Float[Array, ""] = number()

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return self._add(terms, "position", self.shift)


class SensorLag(_OneSensor):
    """`time_constant y' + y = T(x_s)`."""

    name: ClassVar[str] = "sensor_lag"
    parameters: ClassVar = (Parameter("time_constant", "s", 600.0, worth=120.0, least=0.0, most=4 * DAY),)
    sensor: int = eqx.field(static=True, default=0)
    time_constant: Float[Array, ""] = number()

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return self._add(terms, "lag", not_below(self.time_constant, 0.0))


class ClockShift(AbstractEffect):
    """`y(t) = T(t - delay)` for all inner sensors together: their logger's clock against the faces'."""

    name: ClassVar[str] = "clock_shift"
    parameters: ClassVar = (Parameter("delay", "s", 600.0, worth=120.0, least=-DAY, most=DAY),)
    delay: Float[Array, ""] = number()

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return terms.add(delay=self.delay)


class SensorOffset(_OneSensor):
    """`y = T + offset`."""

    name: ClassVar[str] = "sensor_offset"
    parameters: ClassVar = (Parameter("offset", "K", 0.2, worth=0.05),)
    sensor: int = eqx.field(static=True, default=0)
    offset: Float[Array, ""] = number()

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return self._add(terms, "offset", self.offset)


class SensorGain(_OneSensor):
    """`y = T0 + (1 + gain) (T - T0)`, T0 the mean of all readings."""

    name: ClassVar[str] = "sensor_gain"
    parameters: ClassVar = (Parameter("gain", "", 0.02, worth=0.005, least=-0.9),)
    sensor: int = eqx.field(static=True, default=0)
    gain: Float[Array, ""] = number()

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return self._add(terms, "gain", self.gain)


class SensorDrift(_OneSensor):
    """`y = T + rate t`, t in days since the first row."""

    name: ClassVar[str] = "sensor_drift"
    parameters: ClassVar = (Parameter("rate", "K/day", 0.02, worth=0.002),)
    sensor: int = eqx.field(static=True, default=0)
    rate: Float[Array, ""] = number()

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return self._add(terms, "rate", self.rate)
