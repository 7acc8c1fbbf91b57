"""Daylight saving: local times converted to UTC, and a check of local times without a zone for clock changes."""

from __future__ import annotations

from typing import Any

import numpy as np

from .file_position import FilePosition
from .row_times import RowTimes, format_time

HOUR = 3600.0
_CHANGE_MONTHS = (3, 4, 9, 10, 11)  # in which some country changes its clocks
_CHANGE_TOLERANCE = 120.0  # s


def resolve_local_times(location: FilePosition, column: str, local_times: np.ndarray, timezone: str) -> np.ndarray:
    """Convert local times to UTC; in the repeated hour at the end of daylight saving the order of the rows decides.

    Args:
        location: of the rows in the file.
        column: of the times, for messages.
        local_times: datetime64, (time,).
        timezone: IANA name, such as "Europe/Berlin".

    Returns:
        Times in UTC, datetime64[ns], (time,).

    Raises:
        InputError: a time that does not exist in this zone, because the clock skips it in spring.
    """
    import pandas as pd

    steps = np.diff(local_times)
    if np.sum(steps < np.timedelta64(0)) > np.sum(steps > np.timedelta64(0)):  # the newest row first
        reversed_location = FilePosition(location.file, location.lines[::-1])
        return resolve_local_times(reversed_location, column, local_times[::-1], timezone)[::-1]
    local = pd.DatetimeIndex(local_times)
    first = local.tz_localize(timezone, ambiguous=np.ones(len(local), bool), nonexistent="NaT")
    if (missing := np.asarray(first.isna())).any():
        row = int(missing.argmax())
        location.raise_at_cell(
            column,
            row,
            f"found {format_time(local_times[row], None)}, which does not exist in {timezone}: clocks skip this hour "
            "when daylight saving begins; the logger did not follow daylight saving: set its fixed zone (such as "
            'timezone = "Etc/GMT-1", which is UTC+1)',
        )
    second = local.tz_localize(timezone, ambiguous=np.zeros(len(local), bool), nonexistent="NaT")
    early, late = (
        index.tz_convert("UTC").tz_localize(None).to_numpy().astype("datetime64[ns]") for index in (first, second)
    )
    ambiguous = early != late
    return np.where(_in_second_pass(early, late, ambiguous), late, early) if ambiguous.any() else early


def _in_second_pass(early: np.ndarray, late: np.ndarray, ambiguous: np.ndarray) -> np.ndarray:
    """Which rows in a repeated hour belong to its second pass: those after the row where the clock goes back."""
    second = np.zeros(len(early), bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], ambiguous, [False]]).astype(int)))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        back = np.flatnonzero(np.diff(early[start:stop]) <= np.timedelta64(0))
        if len(back):
            second[start + back[0] + 1 : stop] = True
            continue
        # the rows cover only one pass: it is the one that leaves the shorter gap to the neighbouring row
        before = early[start] - early[start - 1] if start > 0 else None
        after = late[stop] - late[stop - 1] if stop < len(early) else None
        second[start:stop] = before is None or (after is not None and after < before)
    return second


def utc_offset(utc_time: np.datetime64, timezone: str) -> tuple[str, int]:
    """The offset of a time zone from UTC at a time in UTC, as text such as "+01:00" and in s."""
    import pandas as pd

    local: Any = pd.Timestamp(utc_time, tz="UTC").tz_convert(timezone)
    seconds = int(local.utcoffset().total_seconds())
    hours, minutes = divmod(abs(seconds) // 60, 60)
    return f"{'-' if seconds < 0 else '+'}{hours:02d}:{minutes:02d}", seconds


def check_daylight_saving(
    location: FilePosition, column: str, times: RowTimes, same: np.ndarray, typical_step: float
) -> None:
    """Check local times without a zone for a change of the clock by an hour.

    Args:
        location: of the rows in the file.
        column: of the times, for messages.
        times: of the rows.
        same: whether a row repeats the readings of the row before, (time - 1,).
        typical_step: s.

    Raises:
        InputError: a step differs by an hour from the typical one on a Sunday on which clocks may change.
    """
    if not times.may_have_daylight_saving or len(times.seconds) < 2:
        return
    steps = np.diff(times.seconds)
    tolerance = min(0.2 * typical_step, _CHANGE_TOLERANCE)
    jumps = (np.abs(np.abs(steps - typical_step) - HOUR) <= tolerance) & ~((steps == 0) & same)
    for row in np.flatnonzero(jumps).tolist():
        if _may_contain_clock_change(*sorted(times.stamps[row : row + 2])):
            change = "forward" if steps[row] > typical_step else "back"
            location.raise_at_cell(
                column,
                row + 1,
                f"the step from {times.format(row)} to {times.format(row + 1)} is {steps[row]:g} s, the usual one "
                f"{typical_step:g} s, on a Sunday on which some countries set clocks {change} (daylight saving); set "
                'the time zone: [record] timezone = "Europe/Berlin", or timezone = "UTC" for a clock without changes',
            )


def _may_contain_clock_change(earlier: np.datetime64, later: np.datetime64) -> bool:
    """Whether an interval includes part of the first hours of a Sunday in a month in which clocks change."""
    import pandas as pd

    day: Any = pd.Timestamp(later).floor("D")
    sunday = day.day_of_week == 6
    return sunday and day.month in _CHANGE_MONTHS and pd.Timestamp(earlier) <= day + pd.Timedelta(hours=4)
