"""A column of times as moments: ISO 8601, day-first or month-first dates, seconds; zones and daylight saving."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from ._fields import show
from ._format import Format
from ._place import Place

HOUR = 3600.0
STEP_TOLERANCE = 1e-3  # of the step: stamps rounded by the logger
_YEARS = (1678, 2261)  # of datetime64[ns]
_ZONE = re.compile(r"(?:([zZ])|([+-]\d{2}):?(\d{2})?)$")
DATE = re.compile(r"(\d{1,2})([./-])(\d{1,2})\2(\d{4}|\d{2})(?:([ T,]+)(\d{1,2}:\d{2}.*))?$")
_CLOCKS = ("%H:%M:%S", "%H:%M", "%H:%M:%S.%f", "%I:%M:%S %p", "%I:%M %p")
_JUMP_MONTHS = (3, 4, 9, 10, 11)  # in which clocks are put forward or back somewhere
_JUMP_TOLERANCE = 120.0  # s


@dataclass(frozen=True, eq=False)
class Stamps:
    """The rows' times, in the file's order.

    Arguments:
        seconds: since the first row, (time,).
        stamps: datetime64[ns] by the clock of `zone`, or s as in the file, (time,).
        zone: fixed offset of the stamps from UTC; None where none is given.
    """

    seconds: np.ndarray
    stamps: np.ndarray
    zone: str | None

    @property
    def may_jump(self) -> bool:
        """Whether this is a wall clock that may follow daylight saving."""
        return self.zone is None and np.issubdtype(self.stamps.dtype, np.datetime64)

    def __getitem__(self, rows: Any) -> Stamps:
        """Some rows; the seconds count from where they did."""
        return Stamps(self.seconds[rows], self.stamps[rows], self.zone)

    def show(self, row: int) -> str:
        """A row's time as a message shows it."""
        return show_stamp(self.stamps[row], self.zone)


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

    Arguments:
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


def show_stamp(stamp: np.generic, zone: str | None) -> str:
    """A time as a message shows it: to the second where it has no fraction."""
    if not isinstance(stamp, np.datetime64):
        return f"{float(stamp):.15g} s"  # pyright: ignore[reportArgumentType]
    return str(stamp).removesuffix(".000000000") + (zone or "")
