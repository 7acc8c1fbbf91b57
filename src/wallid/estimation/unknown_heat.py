"""The course of heat that the model does not know: when, how large, and which logged column it follows.

A Kalman smoother gives the disturbance of an estimate given all readings. Its correlation with each logged column is
searched over lags. The p-value knows that search: the same largest correlation is taken of surrogates. They are the
course with random signs of its cosine coefficients. These are nearly independent for a stationary process and for a
random walk, so the p-value holds for heat with a memory as long as the record too.

Source: A. Winkler and others, NeuroImage 92 (2014), 381 (sign flips); J. Durbin, S. J. Koopman, Time Series Analysis by
State Space Methods (2012), 4.4.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from jaxtyping import Float

from .._internal.blas_threads import one_blas_thread
from .._internal.errors import InputError
from .._internal.html import html_table
from .._internal.result_object import ResultObject, plain_value
from .._internal.units import DAY
from ..case.case_definition import Case
from ..case.time_window import HasBestWindow, Window, as_window, check_unbroken, entire_record
from ..inference.disturbance_search import Disturbance
from ..inference.filter_model import filter_model
from ..inference.generalised_least_squares import fit_generalised_least_squares
from ..models.disturbance import MaternProcess
from ..models.flux_plates import full_order_model_with_plates
from ..models.window_inputs import window_data
from ..records.row_times import RecordStart

if TYPE_CHECKING:
    from pandas import DataFrame

LONGEST_LAG = 6.0
"""Hours by which the heat may follow a column."""
SURROGATES = 999
_MOST_LAGS = 24
_SIGNIFICANT = 0.05
_FEWEST_DAYS = 2.0  # for a mean day
_DAYS_OF_SPECTRUM = 8.0  # of a part of the record whose spectrum is computed


@dataclass(frozen=True)
class Follows(ResultObject):
    """The logged column that the heat follows most.

    Args:
        column: of the record, as in `[record]`. lag: s, by which the heat is later.
        correlation: between heat and column at this lag.
        p_value: of the largest correlation over all columns and lags.
    """

    column: str
    lag: float
    correlation: float
    p_value: float

    @property
    def significant(self) -> bool:
        """Whether so large a correlation would be rare by chance."""
        return self.p_value < _SIGNIFICANT

    def __str__(self) -> str:
        later = f"{self.lag / 3600.0:.2g} h later" if self.lag > 0 else "at once"
        evidence = f"correlation {self.correlation:.2f}, p = {self.p_value:.2g}"
        return f"it follows {self.column.replace('_', ' ')} {later} ({evidence})"


@dataclass(frozen=True, eq=False)
class UnknownHeat(ResultObject):
    """The course of a disturbance.

    Args:
        disturbance: its place, size, memory and evidence.
        days: of each row since the record's start, `(time,)`.
        course, std: of the heat given all readings, and its standard deviation, in `unit`, `(time,)`.
        record_start: the origin of `days`.
        follows: the column that it follows most; None without a column.
        flux: W/m2 for 1 K a day, where the heat capacity of the wall is stated and the unit is not W/m2 already.
    """

    disturbance: Disturbance
    days: np.ndarray = field(repr=False)
    course: np.ndarray = field(repr=False)
    std: np.ndarray = field(repr=False)
    record_start: RecordStart
    follows: Follows | None
    flux: float | None = None

    @property
    def unit(self) -> str:
        """W/m2 or K/day."""
        return self.disturbance.unit

    @property
    def _step(self) -> float:
        """Between rows, days."""
        return float(np.median(np.diff(self.days)))

    @property
    def mean_day(self) -> tuple[np.ndarray, np.ndarray]:
        """Hours of the day, and the mean heat at each; empty for less than two days."""
        step = self._step
        rows = round(1.0 / step)
        if len(self.days) * step < _FEWEST_DAYS or rows < 2:
            return np.zeros(0), np.zeros(0)
        first = 0.0 if self.record_start.stamp is None else _share_of_day(self.record_start.stamp)
        slot = np.floor(((self.days + first) % 1.0) * rows + 0.5).astype(int) % rows
        total, count = (np.bincount(slot, w, minlength=rows) for w in (self.course, np.ones_like(self.course)))
        return 24.0 * np.arange(rows) / rows, total / np.maximum(count, 1)

    @property
    def spectrum(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Its periods, h, the power of the course at each, and that of a process of its size and memory.

        The power is the variance for each unit of frequency, in `unit` squared times h (Welch's method, over parts of
        up to eight days). The course is smoothed: the noise hides its fast part, whose power is then too small.

        Source: P. D. Welch, IEEE Trans. Audio Electroacoust. 15 (1967), 70.
        """
        hours = 24.0 * self._step
        part = min(len(self.course), round(_DAYS_OF_SPECTRUM * 24.0 / hours))
        frequency, power = scipy.signal.welch(self.course, 1.0 / hours, "hann", nperseg=part)
        frequency, power = frequency[1:], power[1:]  # without the mean
        found = self.disturbance
        process = MaternProcess(found.std, found.time_constant / 3600.0, found.smoothness)
        return 1.0 / frequency, power, np.asarray(process.spectral_density(frequency))

    @property
    def warm_hours(self) -> tuple[float, float] | None:
        """From when to when the mean day is in the upper half of its range; None without a day that stands out."""
        hours, heat = self.mean_day
        if not len(hours) or np.ptp(heat) < float(np.median(self.std)):
            return None
        above, peak = heat > heat.min() + 0.5 * np.ptp(heat), int(np.argmax(heat))
        rows = len(hours)
        begin = next((k for k in range(rows) if not above[(peak - k) % rows]), rows)
        end = next((k for k in range(rows) if not above[(peak + k) % rows]), rows)
        return float(hours[(peak - begin + 1) % rows]), float(hours[(peak + end) % rows])

    @property
    def sentence(self) -> str:
        """What a person can act on."""
        where = "the wall" if self.disturbance.place == "wall" else f"the {self.disturbance.place} part of the wall"
        unit = "W/m2" if self.unit == "W/m2" else "K a day"
        largest = float(np.abs(self.course).max())
        of_flux = "" if self.flux is None else f" ({largest * self.flux:.2g} W/m2)"
        text = f"something warms and cools {where} by up to {largest:.2g} {unit}{of_flux}"
        if (hours := self.warm_hours) is not None:
            text += f", most from {hours[0]:.0f} to {hours[1]:.0f} h"
        if self.follows is not None and self.follows.significant:
            text += f"; {self.follows}"
        elif self.follows is not None:
            text += f"; it follows no logged column (largest correlation: p = {self.follows.p_value:.2g})"
        return text

    def summary(self) -> str:
        """The disturbance and the sentence, as text."""
        return f"disturbance  {self.disturbance}\nheat         {self.sentence}"

    __str__ = summary

    def to_dict(self) -> dict[str, Any]:
        """The disturbance, the column that it follows, and the sentence; no time series."""
        hours = self.warm_hours
        entries = {"disturbance": self.disturbance.to_dict(), "hours": None if hours is None else list(hours)}
        return plain_value(entries | {"follows": self.follows, "sentence": self.sentence})

    def to_frame(self) -> DataFrame:
        """One row for each time: `heat` and `std`, in `unit`."""
        import pandas as pd

        index = self.record_start.index_after(np.round(self.days * DAY, 6))
        return pd.DataFrame({"heat": self.course, "std": self.std}, index=index)

    def _repr_html_(self) -> str:
        rows = [("size", f"{self.disturbance.std:.2g}", "", self.unit)]
        rows.append(("memory", f"{self.disturbance.time_constant / 3600.0:.2g}", "", "h"))
        return html_table(f"Unknown heat: {self.sentence}", rows)


@one_blas_thread
def smoothed_disturbance(case: Case, window: Window | HasBestWindow | None = None) -> UnknownHeat:
    """The course of the heat that the model does not know, over a window of a record.

    Args:
        case: the case; its disturbance is taken as "on".
        window: None for the whole record, or its longest unbroken part.

    Raises:
        InputError: the window lies across a break of the record, or has too few readings.
    """
    window = entire_record(case) if window is None else as_window(window)
    check_unbroken(case, window)
    case = replace(case, choices=replace(case.choices, disturbance="on", noise=None))
    data, model = window_data(case, window), full_order_model_with_plates(case)
    fit = fit_generalised_least_squares(case, window, data, model, case.wall.diffusivity_prior, eta=case.choices.eta)
    if fit.disturbance is None:
        raise InputError(
            "smoothed_disturbance: the readings do not determine a disturbance: they are too few, or do not depend on "
            "the diffusivity; take a longer window"
        )
    return unknown_heat_of(case, window, fit.disturbance, *filter_model(case, window, fit).smoothed_heat())


def unknown_heat_of(
    case: Case,
    window: Window,
    disturbance: Disturbance,
    course: Float[np.ndarray, " time"],
    std: Float[np.ndarray, " time"],
) -> UnknownHeat:
    """The heat with the column that it follows.

    Args:
        case, window: of the readings.
        disturbance: found in them.
        course, std: of the heat and its standard deviation.
    """
    part, wall = case.record.window(window.row, window.rows), case.wall
    columns = {key: np.asarray(values) for key, values in part.regressors.items() if not key.startswith("flux_")}
    capacity = wall.heat_capacity
    if capacity is None and wall.effective_conductivity is not None:
        capacity = wall.effective_conductivity / wall.diffusivity_prior
    in_kelvin = disturbance.unit == "K/day"
    return UnknownHeat(
        disturbance=disturbance,
        days=case.record.days[window.as_slice],
        course=course,
        std=std,
        record_start=case.record.start,
        follows=column_followed(course, columns, part.step, case.choices.seed),
        flux=None if capacity is None or not in_kelvin else capacity * wall.length / DAY,
    )


def column_followed(
    course: Float[np.ndarray, " time"], columns: Mapping[str, np.ndarray], step: float, seed: int = 0
) -> Follows | None:
    """The column with the largest correlation with a course, over lags up to `LONGEST_LAG`.

    Args:
        course: of the heat.
        columns: by name, NaN where missing, `(time,)`.
        step: between rows, s.
        seed: of the surrogates.

    Returns:
        None where no column varies.
    """
    rows, stride = len(course), max(1, math.ceil(LONGEST_LAG * 3600.0 / step / _MOST_LAGS))
    lags = np.arange(0, min(round(LONGEST_LAG * 3600.0 / step), rows // 4) + 1, stride)
    names, shifted = [], []
    for name, values in columns.items():
        known = np.isfinite(values)
        if known.mean() < 0.5 or np.ptp(values[known]) == 0.0:
            continue
        whole = np.where(known, values, values[known].mean())
        for lag in lags:
            late = np.concatenate([np.full(lag, whole[0]), whole[: rows - lag]])
            late = late - late.mean()
            names.append((name, lag))
            shifted.append(late / max(float(np.linalg.norm(late)), 1e-300))
    if not names:
        return None
    bank = np.stack(shifted)
    centred = course - course.mean()
    correlations = bank @ centred / max(float(np.linalg.norm(centred)), 1e-300)
    best = int(np.argmax(np.abs(correlations)))
    largest = np.abs(bank @ _surrogates(centred, seed)).max(axis=0)
    p_value = (1 + int((largest >= abs(correlations[best])).sum())) / (SURROGATES + 1)
    name, lag = names[best]
    return Follows(name, float(lag * step), float(correlations[best]), p_value)


def _surrogates(course: np.ndarray, seed: int) -> Float[np.ndarray, "time surrogate"]:
    """Courses of norm 1 with the same cosine coefficients, each with a random sign."""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], (len(course), SURROGATES))
    coefficients = scipy.fft.dct(course, norm="ortho")
    drawn = scipy.fft.idct(coefficients[:, None] * signs, axis=0, norm="ortho")
    return drawn / np.linalg.norm(drawn, axis=0)


def _share_of_day(stamp: np.datetime64) -> float:
    """The time of day, from 0 to 1."""
    return float((stamp - stamp.astype("datetime64[D]")) / np.timedelta64(1, "s")) / DAY
