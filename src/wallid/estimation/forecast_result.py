"""The result of a forecast."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from .._internal.html import html_table
from .._internal.number_formats import value_and_std
from .._internal.result_object import ResultObject, plain_value
from .._internal.units import DAY
from ..case.case_definition import Case
from ..case.time_window import Window
from ..inference.disturbance_search import Disturbance
from ..inference.quantity import NORMAL_95
from ..records.row_times import RecordStart

if TYPE_CHECKING:
    from pandas import DataFrame

_TESTED_HOURS = 6.0  # ahead: predictions further ahead are too few and too dependent to judge by
_FEWEST_INSIDE = 0.8  # of earlier predictions in their 95 % band


@dataclass(frozen=True)
class StepErrors(ResultObject):
    """How well readings are predicted some hours ahead, from all the readings up to then.

    Args:
        hours: ahead.
        rms: root mean square of reading minus prediction, of each output, K or W/m2; NaN without one.
        coverage: share of the readings in their 95 % band, of each output.
        count: of the predictions.
    """

    hours: float
    rms: tuple[float, ...]
    coverage: tuple[float, ...]
    count: int


@dataclass(frozen=True, eq=False)
class Forecast(ResultObject):
    """The readings after a time, with their standard deviations.

    Args:
        case: with the record, which may have been lengthened.
        window: rows of the estimate, then those of the forecast.
        first: the first row of the forecast, within the window.
        names: of the outputs: the sensors, then `flux_left` and `flux_right`.
        mean, std: of the readings, degC, K and W/m2, `(time, output)`; the noise of a reading is part of `std`.
        measured: readings of the whole window, NaN where there is none, `(time, output)`.
        logged: rows of the forecast whose faces are those of the record; the others are as on the day before.
        disturbance: found in the readings before; None where there is none.
        step_errors: how well the readings before were predicted, for some hours ahead.
    """

    case: Case = field(repr=False)
    window: Window
    first: int
    names: tuple[str, ...]
    mean: np.ndarray = field(repr=False)
    std: np.ndarray = field(repr=False)
    measured: np.ndarray = field(repr=False)
    logged: int
    disturbance: Disturbance | None
    step_errors: tuple[StepErrors, ...]

    @property
    def faces(self) -> str:
        """ "record", or "persistence" where the faces of the last rows are as on the day before."""
        return "record" if self.logged == len(self.mean) else "persistence"

    @property
    def unreliable_reason(self) -> str:
        """Why the bands are not to be relied on, by the readings before; empty where nothing speaks against them."""
        for one in self.step_errors:
            shares = np.array(one.coverage)
            if one.hours <= _TESTED_HOURS and np.any(shares < _FEWEST_INSIDE):
                worst = int(np.nanargmin(shares))
                return (
                    f"of the earlier predictions {one.hours:g} h ahead only {shares[worst]:.0%} of {self.names[worst]} "
                    f"lie in their 95 % band; run wallid diagnose to search for what the model misses"
                )
        return ""

    @property
    def hours(self) -> float:
        """Length of the forecast, h."""
        return len(self.mean) * self.case.record.step / 3600.0

    @property
    def units(self) -> tuple[str, ...]:
        """degC or W/m2, of each output."""
        return tuple("W/m2" if name.startswith("flux_") else "degC" for name in self.names)

    @property
    def start(self) -> str | float:
        """Time of the first row of the forecast."""
        return self.case.record.stamp(self.window.row + self.first)

    @property
    def record_start(self) -> RecordStart:
        """When the record begins."""
        return self.case.record.start

    @property
    def inside(self) -> tuple[float, ...]:
        """The share of each output's readings after the start that lie in their 95 % band; NaN without readings."""
        measured = self.measured[self.first :]
        within = np.abs(measured - self.mean) <= NORMAL_95 * self.std
        counts = np.isfinite(measured).sum(axis=0)
        return tuple(float(w.sum() / c) if c else math.nan for w, c in zip(within.T, counts, strict=True))

    @property
    def faces_text(self) -> str:
        """Where the faces are from, in words."""
        if self.faces == "record":
            return "the faces as in the record"
        if self.logged == 0:
            return "the faces as on the day before"
        end = self.case.record.stamp(self.window.row + self.first + self.logged - 1)
        return f"the faces as in the record until {end}, then as on the day before"

    def last(self, output: int) -> str:
        """The last value of an output with its standard deviation, as text."""
        return value_and_std(float(self.mean[-1, output]), float(self.std[-1, output]), self.units[output])

    def to_dict(self) -> dict[str, Any]:
        """The entries of result.json; the rows are in `forecast.csv`."""
        entries = {
            "start": self.start,
            "hours": self.hours,
            "faces": self.faces,
            "reliable": not self.unreliable_reason,
            "reason": self.unreliable_reason,
            "training_days": self.first * self.case.record.step / DAY,
            "outputs": {
                name: {
                    "unit": unit,
                    "last": {"value": float(self.mean[-1, k]), "std": float(self.std[-1, k])},
                    "inside_95": self.inside[k],
                }
                for k, (name, unit) in enumerate(zip(self.names, self.units, strict=True))
            },
            "step_errors": [
                {"hours": one.hours, "rms": list(one.rms), "coverage_95": list(one.coverage), "count": one.count}
                for one in self.step_errors
            ],
        }
        return plain_value(entries)

    def to_frame(self) -> DataFrame:
        """One row for each time: each output's mean, and its standard deviation as `NAME_std`."""
        import pandas as pd

        columns: dict[str, np.ndarray] = {}
        for k, name in enumerate(self.names):
            columns |= {name: self.mean[:, k], f"{name}_std": self.std[:, k]}
        rows = self.window.row + self.first + np.arange(len(self.mean))
        seconds = np.asarray(self.case.record.time)[rows]
        return pd.DataFrame(columns, index=self.record_start.index_after(seconds).rename("time"))

    def to_csv(self) -> str:
        """`forecast.csv`: `time` as in the record, then each output's mean and `NAME_std`."""
        stamps = [self.case.record.stamp(self.window.row + self.first + k) for k in range(len(self.mean))]
        frame = self.to_frame()
        # as texts, which `float_format` leaves as they are
        frame.index = [f"{stamp:.15g}" if isinstance(stamp, float) else stamp for stamp in stamps]
        return frame.rename_axis("time").to_csv(float_format="%.6g", lineterminator="\n")

    def summary(self) -> str:
        """The forecast of each output at its end, and how well earlier readings were predicted, as text."""
        lines = [
            f"forecast     {self.hours:.3g} h from {self.start}, {self.faces_text}, "
            f"from {self.first * self.case.record.step / DAY:.3g} days of readings"
        ]
        if self.unreliable_reason:
            lines.append(f"unreliable   {self.unreliable_reason}")
        for k, name in enumerate(self.names):
            known = f"; {self.inside[k]:.0%} of its readings lie in the 95 % band" if self.inside[k] >= 0 else ""
            lines.append(f"  {name:<11} {self.last(k)} at the end{known}")
        if self.disturbance is not None:
            lines.append(f"disturbance  {self.disturbance}")
        for one in self.step_errors:
            each = ", ".join(
                f"{name} {rms:.2g} {'W/m2' if unit == 'W/m2' else 'K'} ({share:.0%})"
                if math.isfinite(rms)
                else f"{name} without a reading"
                for name, unit, rms, share in zip(self.names, self.units, one.rms, one.coverage, strict=True)
            )
            lines.append(f"{one.hours:g} h ahead".ljust(13) + f"{each}; in parentheses the share in the 95 % band")
        return "\n".join(lines)

    __str__ = summary

    def _repr_html_(self) -> str:
        rows = [(name, self.last(k), "", "") for k, name in enumerate(self.names)]
        return html_table(f"Forecast for {self.hours:.3g} h from {self.start}: at its end", rows)
