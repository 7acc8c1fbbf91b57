"""A column of times as moments: ISO 8601, day-first or month-first dates, seconds; zones and daylight saving."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from .._internal.validation import show
from .daylight_saving import _offset_of, _resolve
from .file_format import Format
from .file_position import Place
from .stamp import Stamps

_YEARS = (1678, 2261)  # of datetime64[ns]
_ZONE = re.compile(r"(?:([zZ])|([+-]\d{2}):?(\d{2})?)$")
DATE = re.compile(r"(\d{1,2})([./-])(\d{1,2})\2(\d{4}|\d{2})(?:([ T,]+)(\d{1,2}:\d{2}.*))?$")
_CLOCKS = ("%H:%M:%S", "%H:%M", "%H:%M:%S.%f", "%I:%M:%S %p", "%I:%M %p")


def read_stamps(place: Place, column: str, cells: Any, form: Format) -> Stamps:
    """A series of texts or numbers as times; whether they increase is for later.

    Raises:
        InputError: a cell that is no time, or zones that do not fit each other.
    """
    empty = cells.isna().to_numpy()
    if empty.any():
        place.refuse(column, int(empty.argmax()), "the time is missing; every row with readings needs one")
    if cells.dtype.kind in "iuf" or np.isfinite(_as_numbers(cells.iloc[:1])).all():
        return _read_seconds(place, column, cells, form)
    texts = cells.astype(str).str.strip()
    if DATE.match(texts.iloc[0]):
        moments, zone, offset = _read_dates(place, column, texts, form), None, 0
    else:
        moments, zone, offset = _read_iso(place, column, texts)
    if form.timezone is not None:
        if zone is not None:
            place.refuse(
                column,
                0,
                f"found {show(texts.iloc[0])}, which has a zone of its own; leave [record] timezone out",
            )
        moments = _resolve(place, column, moments, form.timezone)
        zone, offset = _offset_of(moments.min(), form.timezone)
    stamps = moments + np.timedelta64(offset, "s")
    # from the first row on, so that float64 holds nanoseconds
    return Stamps((stamps - stamps[0]) / np.timedelta64(1, "s"), stamps, zone)


def _as_numbers(cells: Any) -> np.ndarray:
    """A series of texts as numbers, NaN where a text is none."""
    import pandas as pd

    return np.asarray(pd.to_numeric(cells.astype(str).where(cells.notna()), errors="coerce"), float)


def _read_seconds(place: Place, column: str, cells: Any, form: Format) -> Stamps:
    seconds = cells.to_numpy(float) if cells.dtype.kind in "iuf" else _as_numbers(cells)
    bad = ~np.isfinite(seconds)
    if bad.any():
        row = int(bad.argmax())
        found = show(str(cells.iloc[row]))
        place.refuse(column, row, f"found {found}; it must be a number of seconds, as in the first row")
    large = np.abs(seconds) > 1e15
    if large.any():
        row = int(large.argmax())
        place.refuse(column, row, f"found {seconds[row]:g} s; a time must be within 1e15 s of 0")
    if form.timezone is not None:
        place.refuse(column, 0, f"found {seconds[0]:.15g}: seconds have no time zone; leave [record] timezone out")
    # a record's own format: the seconds of its first row are kept in the stamps
    return Stamps(seconds - seconds[0], seconds, None)


def _read_iso(place: Place, column: str, texts: Any) -> tuple[np.ndarray, str | None, int]:
    """Moments in UTC (or by the clock, where no zone is given), the first row's zone and its offset in s."""
    import pandas as pd

    times = pd.to_datetime(texts, format="ISO8601", utc=True, errors="coerce")
    bad = ~times.dt.year.between(*_YEARS).to_numpy()  # NaT is not between either
    if bad.any():
        row = int(bad.argmax())
        found = texts.iloc[row]
        way = (
            "for dates such as 31/12/2014 07:00 state [record] day_first = true (or false)"
            if DATE.match(found)
            else "correct or delete this row"
        )
        place.refuse(
            column,
            row,
            f"found {show(found)}; a time must be ISO 8601 (2014-12-01T00:00:00, with or without a zone) or a "
            f"number of seconds; {way}",
        )
    zone, offset = _read_zone(place, column, texts)
    return times.dt.tz_localize(None).to_numpy().astype("datetime64[ns]"), zone, offset


def _read_zone(place: Place, column: str, texts: Any) -> tuple[str | None, int]:
    """The first row's fixed offset from UTC, as text and in s; all rows must have one, or none."""
    import pandas as pd

    # a date alone has at most ten characters, and its day looks like an offset
    tails, kinds = pd.factorize(texts.str[-6:].where(texts.str.len() > 10, ""))
    zones = [_ZONE.search(str(kind)) for kind in kinds]
    zoned = np.array([zone is not None for zone in zones])[tails]
    if (zoned != zoned[0]).any():
        row = int((zoned != zoned[0]).argmax())
        place.refuse(
            column,
            row,
            f"found {show(texts.iloc[row])} {'without' if zoned[0] else 'with'} a zone, and "
            f"{show(texts.iloc[0])} in the first row; either every time must have a zone, or none",
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


def _read_dates(place: Place, column: str, texts: Any, form: Format) -> np.ndarray:
    """Dates that begin with a day or a month, by the clock."""
    import pandas as pd

    if form.day_first is None:
        place.refuse(
            column,
            0,
            f"found {show(texts.iloc[0])}, which may begin with the day or the month; state [record] "
            "day_first = true (or false), or log ISO 8601",
        )
    found = DATE.match(texts.iloc[0])
    assert found is not None
    mark, year = found[2], "%Y" if len(found[4]) == 4 else "%y"
    date = (f"%d{mark}%m{mark}" if form.day_first else f"%m{mark}%d{mark}") + year
    times = pd.to_datetime(texts, format=date, errors="coerce")
    tidy = texts.str.replace(r"[ T,]+(?=\d{1,2}:)", " ", regex=True) if found[5] not in (None, " ") else texts
    for clock in _CLOCKS:  # a logger may leave out the seconds of some rows, and midnight altogether
        left = times.isna()
        if not left.any():
            break
        times = times.where(~left, pd.to_datetime(tidy.where(left), format=f"{date} {clock}", errors="coerce"))
    bad = ~times.dt.year.between(*_YEARS).to_numpy()
    if bad.any():
        row = int(bad.argmax())
        order = "day, month, year" if form.day_first else "month, day, year"
        other = "false" if form.day_first else "true"
        place.refuse(
            column,
            row,
            f"found {show(texts.iloc[row])}; a time must be {order} as {show(texts.iloc[0])} in the first row; "
            f"correct it, or state [record] day_first = {other}",
        )
    return times.to_numpy().astype("datetime64[ns]")
