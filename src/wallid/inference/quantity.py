"""A value with its interval."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from .._internal.html import html_table, interval_row
from .._internal.number_formats import value_and_interval
from .._internal.result_object import ResultObject, plain_value
from .physical_bounds import clip_to_physical

if TYPE_CHECKING:
    from pandas import DataFrame

NORMAL_95 = 1.959963984540054
"""The normal distribution's 97.5 % quantile: half the width of a 95 % interval, in standard deviations."""


@dataclass(frozen=True)
class Quantity(ResultObject):
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

    def to_dict(self) -> dict[str, Any]:
        """Value, standard error, interval and unit; None for a number that is not finite."""
        return plain_value(self.result())

    def to_frame(self) -> DataFrame:
        """One row: `value`, `std`, `low` and `high` of the 95 % interval, `unit`."""
        return quantity_frame({"": self}).reset_index(drop=True)

    def _repr_html_(self) -> str:
        return html_table("Quantity", [interval_row("", self)])

    def __str__(self) -> str:
        return value_and_interval(self.value, self.std, self.interval_95, self.unit)


def quantity_frame(quantities: Mapping[str, Quantity]) -> DataFrame:
    """One row for each quantity, with its name as index: `value`, `std`, `low` and `high` (95 % interval), `unit`."""
    import pandas as pd

    rows = [(one.value, one.std, *one.interval_95, one.unit) for one in quantities.values()]
    index = pd.Index(list(quantities), name="quantity", dtype=object)
    return pd.DataFrame(rows, index=index, columns=["value", "std", "low", "high", "unit"])


def normal(value: float, std: float, unit: str) -> Quantity:
    """A quantity that is normally distributed."""
    return Quantity(value, std, (value - NORMAL_95 * std, value + NORMAL_95 * std), unit)


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
