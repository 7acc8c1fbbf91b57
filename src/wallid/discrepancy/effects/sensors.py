"""Effects in the inner sensors and their logger: position, lag, clock, offset, gain, drift."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from ..._internal.units import DAY
from .base import AbstractEffect, Parameter, lower_bounded, parameter_field
from .equation_terms import ForcingData, Terms

_MM = 1e-3


class _OneSensor(AbstractEffect):
    """An effect in one inner sensor, given by its index in the record."""

    sensor: eqx.AbstractVar[int]

    @property
    def target(self) -> int:
        """The index of the sensor in the record."""
        return self.sensor

    def _add(self, terms: Terms, term: str, value: Array) -> Terms:
        mask = np.arange(terms.position.shape[0]) == self.sensor
        return terms.add(**{term: value * mask})


class SensorPosition(_OneSensor):
    """Position error: the sensor reads `T(x_s + shift)`, shift the true position minus the stated one."""

    name: ClassVar[str] = "sensor_position"
    parameters: ClassVar = (Parameter("shift", "m", 5 * _MM, smallest_reported=2 * _MM),)
    sensor: int = eqx.field(static=True, default=0)
    shift: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return self._add(terms, "position", self.shift)


class SensorLag(_OneSensor):
    """Lag of a sensor: `time_constant dy/dt + y = T(x_s)`."""

    name: ClassVar[str] = "sensor_lag"
    parameters: ClassVar = (Parameter("time_constant", "s", 600.0, smallest_reported=120.0, lower=0.0, upper=4 * DAY),)
    sensor: int = eqx.field(static=True, default=0)
    time_constant: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return self._add(terms, "lag", lower_bounded(self.time_constant, 0.0))


class ClockShift(AbstractEffect):
    """Delay of the clock of all inner sensors against that of the faces: `y(t) = T(t - delay)`."""

    name: ClassVar[str] = "clock_shift"
    parameters: ClassVar = (Parameter("delay", "s", 600.0, smallest_reported=120.0, lower=-DAY, upper=DAY),)
    delay: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(delay=self.delay)


class SensorOffset(_OneSensor):
    """Offset of a sensor: `y = T + offset`."""

    name: ClassVar[str] = "sensor_offset"
    parameters: ClassVar = (Parameter("offset", "K", 0.2, smallest_reported=0.05),)
    sensor: int = eqx.field(static=True, default=0)
    offset: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return self._add(terms, "offset", self.offset)


class SensorGain(_OneSensor):
    """Gain error of a sensor: `y = T0 + (1 + gain) (T - T0)`, T0 the mean of all readings."""

    name: ClassVar[str] = "sensor_gain"
    parameters: ClassVar = (Parameter("gain", "", 0.02, smallest_reported=0.005, lower=-0.9),)
    sensor: int = eqx.field(static=True, default=0)
    gain: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return self._add(terms, "gain", self.gain)


class SensorDrift(_OneSensor):
    """Drift of a sensor: `y = T + rate t`, t in days since the first row."""

    name: ClassVar[str] = "sensor_drift"
    parameters: ClassVar = (Parameter("rate", "K/day", 0.02, smallest_reported=0.002),)
    sensor: int = eqx.field(static=True, default=0)
    rate: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return self._add(terms, "rate", self.rate)
