"""The information of windows of several lengths, against the computing time of their estimates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .._internal.arrays import on_device
from .._internal.progress import Progress, shown_progress
from .._internal.result_object import ResultObject
from ..case.case_definition import Case
from ..case.initial_profile import scales
from ..case.time_window import Window, entire_record, window_rows
from ..models.flux_plates import plate_outputs
from ..models.window_inputs import full_order_model
from ..records.table_columns import MIN_ROWS
from .fisher_information import (
    Criterion,
    ParametersOfInterest,
    Robust,
    check_choices,
    design_diffusivities,
    relative_criterion,
)
from .window_information import (
    PlateSettings,
    full_covariance_criterion,
    initial_profiles,
    record_with_plates,
    uses_full_covariance,
    window_information,
)
from .window_selection import candidate_starts

if TYPE_CHECKING:
    from pandas import DataFrame

_COMPARED_DAYS = (1.0, 2.0, 3.0, 5.0, 10.0)
_MAX_ROWS = 20_000  # above this the comparison takes seconds per length


def days_within(case: Case) -> tuple[float, ...]:
    """Default window lengths to compare, days: those up to half the record; none for a very long record."""
    if case.record.rows > _MAX_ROWS:
        return ()
    rows = {days: case.record.rows_in_days(days) for days in _COMPARED_DAYS}
    return tuple(days for days in _COMPARED_DAYS if MIN_ROWS <= rows[days] <= entire_record(case).rows // 2)


@dataclass(frozen=True)
class LengthComparison(ResultObject):
    """Information and computing time for several window lengths.

    Args:
        days: window lengths, days, `(length,)`.
        criterion: criterion of the best window of each length, divided by the largest of them.
        seconds: computing time of one estimate, s; NaN where it was not measured.
    """

    days: np.ndarray
    criterion: np.ndarray
    seconds: np.ndarray

    def to_frame(self) -> DataFrame:
        """One row for each length: `criterion` and `seconds`; the index is the length, days."""
        import pandas as pd

        columns = {"criterion": self.criterion, "seconds": self.seconds}
        return pd.DataFrame(columns, index=pd.Index(self.days, name="days"))

    def _html_title(self) -> str:
        return "Window lengths: criterion of the best window, and seconds of its estimate"

    def __str__(self) -> str:
        lines = []
        for days, criterion, seconds in zip(self.days, self.criterion, self.seconds, strict=True):
            cost = "" if np.isnan(seconds) else f"   {1e3 * seconds:6.2f} ms"
            lines.append(f"  {days:6.2f} days   criterion {criterion:5.3f}{cost}")
        timed = ", and the computing time of its estimate" if np.isfinite(self.seconds).any() else ""
        return "\n".join([f"lengths      the best window of each{timed}", *lines])


def compare_lengths(
    case: Case,
    days: Sequence[float],
    cost: Callable[[Window], float] | None = None,
    *,
    full: bool | None = None,
    criterion: Criterion = "D",
    of: ParametersOfInterest = "diffusivity",
    robust: Robust = "no",
    diffusivities: Sequence[float] | None = None,
    progress: Progress | None = None,
) -> LengthComparison:
    """The criterion of the best window of each length, and the computing time of its estimate.

    Args:
        days: window lengths, days.
        cost: returns the computing time of an estimate from a window, s, for instance by `seconds_of_estimate`. Called
            for the shortest, the middle and the longest window only, since each needs a compilation. None for no times.
        full, criterion, of, robust, diffusivities: as in `design`.
        progress: called as `progress(text, share)` with the step that begins and the completed share, 0 to 1;
            None for a bar in a notebook, and nothing elsewhere.

    Returns:
        relative criterion and computing time for each length.

    Raises:
        InputError: a window does not fit into the record, or an option is unknown.

    Source: Berger and Kadoch, Section 4.1.
    """
    with shown_progress(progress) as report:
        report("lengths: the information of all windows", 0.0)
        return _compare(case, days, cost, full, criterion, of, robust, diffusivities, report)


def _compare(
    case: Case,
    days: Sequence[float],
    cost: Callable[[Window], float] | None,
    full: bool | None,
    criterion: Criterion,
    of: ParametersOfInterest,
    robust: Robust,
    diffusivities: Sequence[float] | None,
    report: Progress,
) -> LengthComparison:
    """The comparison of `compare_lengths`, which reports its progress."""
    check_choices(criterion, of, robust)
    rows = tuple(window_rows(case, length) for length in days)
    starts = candidate_starts(case.record, min(rows), None)
    alphas = design_diffusivities(case, diffusivities, robust)
    if uses_full_covariance(case, full):
        information = full_covariance_criterion(case, starts, rows, alphas, criterion, of)[0]
    else:
        fourier = on_device(scales(case).fourier_number(np.asarray(alphas)))
        profiles, system = initial_profiles(case, starts), full_order_model(case, plate_outputs(case))
        data, plates = record_with_plates(case), PlateSettings.of_case(case, rows)
        per_fourier = window_information(system, fourier, data, on_device(starts), profiles, plates, rows=rows)
        information = np.asarray(per_fourier) * np.square(np.asarray(fourier))[:, None, None]
    best, seconds = [], np.full(len(days), np.nan)
    timed = {0, len(days) // 2, len(days) - 1}
    for k, length in enumerate(days):
        report(f"lengths: {length:g} d", 0.5 + 0.5 * k / len(days))
        inside = np.flatnonzero(case.record.contains_windows(starts, rows[k]))
        values = information[:, inside, k]
        index = int(np.argmax(relative_criterion(values, robust)))
        best.append(values[:, index])
        if cost is not None and k in timed:
            seconds[k] = cost(Window(int(starts[inside[index]]), rows[k]))
    return LengthComparison(np.asarray(days, float), relative_criterion(np.array(best).T, robust), seconds)
