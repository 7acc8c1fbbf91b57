"""Parsing of a column of times: ISO 8601, dates with the day or the month first, or seconds; time zones."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from .._internal.validation import format_value
from .daylight_saving import resolve_local_times, utc_offset
from .file_format import FileFormat
from .file_position import FilePosition
from .row_times import RowTimes

_YEARS = (1678, 2261)  # the range of datetime64[ns]
_ZONE = re.compile(r"(?:([zZ])|([+-]\d{2}):?(\d{2})?)$")
DATE = re.compile(r"(\d{1,2})([./-])(\d{1,2})\2(\d{4}|\d{2})(?:([ T,]+)(\d{1,2}:\d{2}.*))?$")
_CLOCKS = ("%H:%M:%S", "%H:%M", "%H:%M:%S.%f", "%I:%M:%S %p", "%I:%M %p")


def parse_times(location: FilePosition, column: str, cells: Any, file_format: FileFormat) -> RowTimes:
    """Parse a column of times; they need not increase.

    Args:
        location: of the rows in the file.
        column: name of the column.
        cells: a pandas series of texts or numbers, (time,).
        file_format: of the file.

    Raises:
        InputError: a cell is not a time, or some times have a zone and others do not.
    """
    empty = cells.isna().to_numpy()
    if empty.any():
        location.raise_at_cell(column, int(empty.argmax()), "the time is missing; every row with readings needs one")
    if cells.dtype.kind in "iuf" or np.isfinite(_as_numbers(cells.iloc[:1])).all():
        return _read_seconds(location, column, cells, file_format)
    texts = cells.astype(str).str.strip()
    if DATE.match(texts.iloc[0]):
        moments, zone, offset = _read_dates(location, column, texts, file_format), None, 0
    else:
        moments, zone, offset = _read_iso(location, column, texts)
    if file_format.timezone is not None:
        if zone is not None:
            location.raise_at_cell(
                column,
                0,
                f"found {format_value(texts.iloc[0])}, which states its own zone; remove [record] timezone",
            )
        moments = resolve_local_times(location, column, moments, file_format.timezone)
        zone, offset = utc_offset(moments.min(), file_format.timezone)
    stamps = moments + np.timedelta64(offset, "s")
    # counted from the first row, so that float64 resolves nanoseconds
    return RowTimes((stamps - stamps[0]) / np.timedelta64(1, "s"), stamps, zone)


def _as_numbers(cells: Any) -> np.ndarray:
    """A series of texts as numbers; NaN where a text is not a number."""
    import pandas as pd

    return np.asarray(pd.to_numeric(cells.astype(str).where(cells.notna()), errors="coerce"), float)


def _read_seconds(location: FilePosition, column: str, cells: Any, file_format: FileFormat) -> RowTimes:
    seconds = cells.to_numpy(float) if cells.dtype.kind in "iuf" else _as_numbers(cells)
    bad = ~np.isfinite(seconds)
    if bad.any():
        row = int(bad.argmax())
        cell = format_value(str(cells.iloc[row]))
        location.raise_at_cell(column, row, f"found {cell}; it must be a number of seconds, as in the first row")
    large = np.abs(seconds) > 1e15
    if large.any():
        row = int(large.argmax())
        location.raise_at_cell(column, row, f"found {seconds[row]:g} s; a time must be within 1e15 s of 0")
    if file_format.timezone is not None:
        location.raise_at_cell(
            column, 0, f"found {seconds[0]:.15g}: seconds have no time zone; remove [record] timezone"
        )
    return RowTimes(seconds - seconds[0], seconds, None)


def _read_iso(location: FilePosition, column: str, texts: Any) -> tuple[np.ndarray, str | None, int]:
    """Times in UTC (local times where no zone is given), the first row's zone, and its offset in s."""
    import pandas as pd

    times = pd.to_datetime(texts, format="ISO8601", utc=True, errors="coerce")
    bad = ~times.dt.year.between(*_YEARS).to_numpy()  # NaT is not between either
    if bad.any():
        row = int(bad.argmax())
        cell = texts.iloc[row]
        remedy = (
            "for dates such as 31/12/2014 07:00 set [record] day_first = true (or false)"
            if DATE.match(cell)
            else "correct or delete this row"
        )
        location.raise_at_cell(
            column,
            row,
            f"found {format_value(cell)}; a time must be ISO 8601 (2014-12-01T00:00:00, with or without a zone) or a "
            f"number of seconds; {remedy}",
        )
    zone, offset = _read_zone(location, column, texts)
    return times.dt.tz_localize(None).to_numpy().astype("datetime64[ns]"), zone, offset


def _read_zone(location: FilePosition, column: str, texts: Any) -> tuple[str | None, int]:
    """The first row's fixed offset from UTC, as text and in s; all rows must have a zone, or none."""
    import pandas as pd

    # a date alone has at most ten characters, and its day looks like an offset
    tails, kinds = pd.factorize(texts.str[-6:].where(texts.str.len() > 10, ""))
    zones = [_ZONE.search(str(kind)) for kind in kinds]
    zoned = np.array([zone is not None for zone in zones])[tails]
    if (zoned != zoned[0]).any():
        row = int((zoned != zoned[0]).argmax())
        location.raise_at_cell(
            column,
            row,
            f"found {format_value(texts.iloc[row])} {'without' if zoned[0] else 'with'} a zone, and "
            f"{format_value(texts.iloc[0])} in the first row; either every time must have a zone, or none",
        )
    match = zones[tails[0]]
    if match is None:
        return None, 0
    letter, hours, minutes = match.groups()
    if letter:
        return "Z", 0
    minutes = minutes or "00"
    seconds = int(hours[1:]) * 3600 + int(minutes) * 60
    return f"{hours}:{minutes}", -seconds if hours[0] == "-" else seconds


def _read_dates(location: FilePosition, column: str, texts: Any, file_format: FileFormat) -> np.ndarray:
    """Local times from dates that begin with the day or the month."""
    import pandas as pd

    if file_format.day_first is None:
        location.raise_at_cell(
            column,
            0,
            f"found {format_value(texts.iloc[0])}, which may begin with the day or the month; set [record] "
            "day_first = true (or false), or use ISO 8601",
        )
    match = DATE.match(texts.iloc[0])
    assert match is not None
    mark, year = match[2], "%Y" if len(match[4]) == 4 else "%y"
    date = (f"%d{mark}%m{mark}" if file_format.day_first else f"%m{mark}%d{mark}") + year
    times = pd.to_datetime(texts, format=date, errors="coerce")
    one_space = texts.str.replace(r"[ T,]+(?=\d{1,2}:)", " ", regex=True) if match[5] not in (None, " ") else texts
    for clock in _CLOCKS:  # some loggers omit zero seconds, or the clock time at midnight
        remaining = times.isna()
        if not remaining.any():
            break
        parsed = pd.to_datetime(one_space.where(remaining), format=f"{date} {clock}", errors="coerce")
        times = times.where(~remaining, parsed)
    bad = ~times.dt.year.between(*_YEARS).to_numpy()
    if bad.any():
        row = int(bad.argmax())
        order = "day, month, year" if file_format.day_first else "month, day, year"
        other = "false" if file_format.day_first else "true"
        location.raise_at_cell(
            column,
            row,
            f"found {format_value(texts.iloc[row])}; a time must be {order} as {format_value(texts.iloc[0])} in the "
            f"first row; correct it, or set [record] day_first = {other}",
        )
    return times.to_numpy().astype("datetime64[ns]")
