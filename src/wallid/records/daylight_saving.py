"""Clocks that are put forward and back: zones with daylight saving, and clocks that seem to follow it unsaid."""

from __future__ import annotations

from typing import Any

import numpy as np

from .file_position import Place
from .stamp import Stamps, show_stamp

HOUR = 3600.0
_JUMP_MONTHS = (3, 4, 9, 10, 11)  # in which clocks are put forward or back somewhere
_JUMP_TOLERANCE = 120.0  # s


def _resolve(place: Place, column: str, clock: np.ndarray, timezone: str) -> np.ndarray:
    """Moments in UTC from a wall clock; of the hour that comes twice, by the rows' order."""
    import pandas as pd

    steps = np.diff(clock)
    if np.sum(steps < np.timedelta64(0)) > np.sum(steps > np.timedelta64(0)):  # the newest first
        return _resolve(Place(place.file, place.lines[::-1]), column, clock[::-1], timezone)[::-1]
    local = pd.DatetimeIndex(clock)
    first = local.tz_localize(timezone, ambiguous=np.ones(len(local), bool), nonexistent="NaT")
    if (missing := np.asarray(first.isna())).any():
        row = int(missing.argmax())
        place.refuse(
            column,
            row,
            f"found {show_stamp(clock[row], None)}, which the clock of {timezone} leaves out when it is put forward; "
            "the logger did not follow daylight saving: state its fixed zone (such as timezone = "
            '"Etc/GMT-1", which is UTC+1)',
        )
    second = local.tz_localize(timezone, ambiguous=np.zeros(len(local), bool), nonexistent="NaT")
    early, late = (
        index.tz_convert("UTC").tz_localize(None).to_numpy().astype("datetime64[ns]") for index in (first, second)
    )
    twice = early != late
    if not twice.any():
        return early
    return np.where(_second_pass(early, late, twice), late, early)


def _second_pass(early: np.ndarray, late: np.ndarray, twice: np.ndarray) -> np.ndarray:
    """Of the rows in an hour that comes twice, those of its second pass: past the row where the clock goes back."""
    chosen = np.zeros(len(early), bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], twice, [False]]).astype(int)))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        back = np.flatnonzero(np.diff(early[start:stop]) <= np.timedelta64(0))
        if len(back):
            chosen[start + back[0] + 1 : stop] = True
            continue
        # the clock passes the hour once in this record: the side that it joins without a gap tells which time
        ahead = early[start] - early[start - 1] if start > 0 else None
        behind = late[stop] - late[stop - 1] if stop < len(early) else None
        chosen[start:stop] = ahead is None or (behind is not None and behind < ahead)
    return chosen


def _offset_of(moment: np.datetime64, timezone: str) -> tuple[str, int]:
    """A zone's offset at a moment in UTC, as text and in s."""
    import pandas as pd

    here: Any = pd.Timestamp(moment, tz="UTC").tz_convert(timezone)
    seconds = int(here.utcoffset().total_seconds())
    hours, minutes = divmod(abs(seconds) // 60, 60)
    return f"{'-' if seconds < 0 else '+'}{hours:02d}:{minutes:02d}", seconds


def check_daylight(place: Place, column: str, found: Stamps, same: np.ndarray, usual: float) -> None:
    """Refuse a wall clock that seems to have been put forward or back by an hour, and say how to resolve it.

    Args:
        same: whether a row repeats the reading before it, (time - 1,).
        usual: step, s.
    """
    if not found.may_jump or len(found.seconds) < 2:
        return
    steps = np.diff(found.seconds)
    tolerance = min(0.2 * usual, _JUMP_TOLERANCE)
    jumps = (np.abs(np.abs(steps - usual) - HOUR) <= tolerance) & ~((steps == 0) & same)
    for row in np.flatnonzero(jumps).tolist():
        earlier = min(found.stamps[row], found.stamps[row + 1])
        if _at_a_change(earlier, max(found.stamps[row], found.stamps[row + 1])):
            way = "forward" if steps[row] > usual else "back"
            place.refuse(
                column,
                row + 1,
                f"the clock goes from {found.show(row)} to {found.show(row + 1)}, {steps[row]:g} s where {usual:g} s "
                f"are usual, on a Sunday on which clocks are put {way} somewhere (daylight saving); state whose clock "
                'it is: [record] timezone = "Europe/Berlin", or timezone = "UTC" for one that never jumps',
            )


def _at_a_change(earlier: np.datetime64, later: np.datetime64) -> bool:
    """Whether an interval meets the first hours of a Sunday in a month in which clocks change."""
    import pandas as pd

    day: Any = pd.Timestamp(later).floor("D")
    sunday = day.day_of_week == 6
    return sunday and day.month in _JUMP_MONTHS and pd.Timestamp(earlier) <= day + pd.Timedelta(hours=4)
