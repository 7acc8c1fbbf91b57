"""The information of windows of several lengths, against the computing time of their estimates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .._internal.arrays import on_device
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

_COMPARED_DAYS = (1.0, 2.0, 3.0, 5.0, 10.0)
_MAX_ROWS = 20_000  # above this the comparison takes seconds per length


def days_within(case: Case) -> tuple[float, ...]:
    """Default window lengths to compare, days: those up to half the record; none for a very long record."""
    if case.record.rows > _MAX_ROWS:
        return ()
    rows = {days: case.record.rows_in_days(days) for days in _COMPARED_DAYS}
    return tuple(days for days in _COMPARED_DAYS if MIN_ROWS <= rows[days] <= entire_record(case).rows // 2)


@dataclass(frozen=True)
class LengthComparison:
    """Information and computing time for several window lengths.

    Args:
        days: window lengths, days, `(length,)`.
        criterion: criterion of the best window of each length, divided by the largest of them.
        seconds: computing time of one estimate, s; NaN where it was not measured.
    """

    days: np.ndarray
    criterion: np.ndarray
    seconds: np.ndarray

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
    on_length: Callable[[float], None] = lambda days: None,
) -> LengthComparison:
    """The criterion of the best window of each length, and the computing time of its estimate.

    Args:
        days: window lengths, days.
        cost: returns the computing time of an estimate from a window, s, for instance by `seconds_of_estimate`. Called
            for the shortest, the middle and the longest window only, since each needs a compilation. None for no times.
        full, criterion, of, robust, diffusivities: as in `design`.
        on_length: called with each length, days, when it has been evaluated.

    Returns:
        relative criterion and computing time for each length.

    Raises:
        InputError: a window does not fit into the record, or an option is unknown.

    Source: Berger and Kadoch, Section 4.1.
    """
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
        inside = np.flatnonzero(case.record.contains_windows(starts, rows[k]))
        values = information[:, inside, k]
        index = int(np.argmax(relative_criterion(values, robust)))
        best.append(values[:, index])
        if cost is not None and k in timed:
            seconds[k] = cost(Window(int(starts[inside[index]]), rows[k]))
        on_length(length)
    return LengthComparison(np.asarray(days, float), relative_criterion(np.array(best).T, robust), seconds)
