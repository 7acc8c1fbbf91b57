"""A value with its interval."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from .._internal.number_formats import value_and_interval
from .physical_bounds import clip_to_physical

NORMAL_95 = 1.959963984540054
"""The normal distribution's 97.5 % quantile: half the width of a 95 % interval, in standard deviations."""


@dataclass(frozen=True)
class Quantity:
    """A value with its interval.

    Args:
        value, std: the value and its standard error, in `unit`.
        interval_95: ends of the 95 % interval, in `unit`.
        unit: such as "W/m/K".
    """

    value: float
    std: float
    interval_95: tuple[float, float]
    unit: str

    def result(self) -> dict[str, Any]:
        """The entry of result.json."""
        return {"value": self.value, "std": self.std, "interval_95": list(self.interval_95), "unit": self.unit}

    def __str__(self) -> str:
        return value_and_interval(self.value, self.std, self.interval_95, self.unit)


def lognormal(value: float, variance: float, quantile: float, unit: str) -> Quantity:
    """A quantity whose logarithm is normally distributed; its interval ends at the physical bounds of its unit.

    Args:
        value: in `unit`.
        variance: of its logarithm.
        quantile: half the width of the 95 % interval of the logarithm, in standard deviations.
    """
    std = math.sqrt(max(variance, 0.0))
    factor = math.exp(min(quantile * std, 300.0))
    return Quantity(value, value * std, clip_to_physical(value / factor, value * factor, unit), unit)
