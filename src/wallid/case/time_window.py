"""Windows of a record: consecutive rows without a long gap."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime
from typing import Protocol, runtime_checkable
from zoneinfo import ZoneInfo

import numpy as np

from .._internal.errors import InputError
from .._internal.result_object import ResultObject
from .._internal.units import DAY
from ..records.table_columns import MIN_ROWS
from ..records.uniform_record import Record
from .case_definition import Case

MIN_FACE_RANGE = 1e-6  # K; a face temperature with a smaller range is constant


@dataclass(frozen=True)
class Window(ResultObject):
    """Consecutive rows of a record.

    Args:
        row: index of the first row.
        rows: number of rows.
    """

    row: int
    rows: int

    @property
    def as_slice(self) -> slice:
        """The slice of the record's arrays."""
        return slice(self.row, self.row + self.rows)


@runtime_checkable
class HasBestWindow(Protocol):
    """An object with a best window, such as a `Design`."""

    @property
    def best(self) -> Window:
        """The best window."""
        ...


def row_at(record: Record, option: str, time: str | float | int, *, beyond: int = 0) -> int:
    """The first row at or after a time.

    Args:
        record: of the case.
        option: by which the time is stated, for messages.
        time: as in the record's file, on its clock: ISO 8601, with an offset from UTC or without, or s where it has
            seconds.
        beyond: rows after the last that are allowed.

    Raises:
        InputError: a time that is not one, or outside the record.
    """
    if isinstance(record.stamps[0], np.datetime64):
        try:
            moment = datetime.fromisoformat(str(time))
        except ValueError:
            raise InputError(f"{option} {time}: it must be a time such as {record.stamp(0)}") from None
        if moment.tzinfo is None and record.timezone is not None:  # the record keeps the offset of its first row
            moment = moment.replace(tzinfo=ZoneInfo(record.timezone))
        local = moment if moment.tzinfo is None else _local_time(moment, record, option)
        seconds = float((np.datetime64(local.replace(tzinfo=None)) - record.stamps[0]) / np.timedelta64(1, "s"))
    else:
        try:
            seconds = float(time) - float(record.stamps[0])
        except ValueError:
            seconds = math.nan
        if not math.isfinite(seconds):
            raise InputError(f"{option} {time}: the record has seconds; state such as {record.stamp(0):g}")
    row = math.ceil(seconds / record.step - 1e-6)
    last = record.rows - 1 + beyond
    if not 0 < row <= last:
        raise InputError(f"{option} {time}: it must lie between {record.stamp(1)} and {record.stamp(last)}")
    return row


def _local_time(moment: datetime, record: Record, option: str) -> datetime:
    """A time with an offset from UTC, in the zone of the record."""
    if record.zone is None:
        raise InputError(
            f"{option} {moment.isoformat()}: the times of the record have no zone; state one such as {record.stamp(0)}"
        )
    zone = datetime.fromisoformat(f"2000-01-01T00:00{record.zone}").tzinfo
    return moment.astimezone(zone)


def as_window(window: Window | HasBestWindow) -> Window:
    """The window itself, or the best window of a design."""
    return window if isinstance(window, Window) else window.best


def entire_record(case: Case) -> Window:
    """The entire record as one window; for a record with long gaps its longest unbroken part."""
    return Window(*case.record.longest_part)


def diagnosis_window(case: Case) -> Window:
    """The window of the diagnosis: the first `diagnose_days` of `entire_record`, or all of it."""
    longest, days = entire_record(case), case.choices.diagnose_days
    return longest if days is None else Window(longest.row, min(case.record.rows_in_days(days), longest.rows))


def check_unbroken(case: Case, window: Window, *, remedy: str = "take another window") -> None:
    """Check that a window contains no break of the record.

    Args:
        case: with the record.
        window: of its rows.
        remedy: what to do about a break, for the message.

    Raises:
        InputError: a face temperature is missing over a long gap in the window.
    """
    record = case.record
    inside = window.row >= 0 and window.row + window.rows <= record.rows  # else `Record.window` raises the error
    if inside and not record.contains_windows(window.row, window.rows):
        first = next(b for b in record.cleaning.breaks if b.row + b.rows > window.row)
        raise InputError(
            f"{record.file}: a window of {window.rows} rows from {record.stamp(window.row)} lies across a break of the "
            f"record ({first}); {remedy}, or state a longer [record] longest_gap (hours)"
        )


def window_rows(case: Case, days: float) -> int:
    """The number of rows of a window; all rows of a record that has one row more.

    Args:
        days: length of the window.

    Raises:
        InputError: the window has too few rows, or more than the longest unbroken part of the record.
    """
    rows, available = case.record.rows_in_days(days), entire_record(case).rows
    if not MIN_ROWS <= rows <= available:
        limit = "the length of the record"
        if available < case.record.rows:
            limit = (
                f"the length of its longest unbroken part ({available * case.record.step / DAY:.4g} days; a longer "
                "[record] longest_gap makes fewer breaks)"
            )
        raise InputError(
            f"window_days = {days:g} makes {rows} rows of {case.record.step:g} s; it must make {MIN_ROWS} to "
            f"{available}, {limit}"
        )
    return case.record.rows if case.record.rows - rows == 1 else rows
