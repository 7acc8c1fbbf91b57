"""Reading columns of a CSV file against uniform time; every refusal names file, line and column."""

from __future__ import annotations

import csv
import os
import re
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from ._fields import InputError, nearest, show

FEWEST_ROWS = 8
_KELVIN = 200.0  # degC: a median above it was logged in kelvin
_EXTREME = 150.0  # degC: beyond it stands a spike, or another unit
_STEP_TOLERANCE = 1e-3  # of the step: stamps rounded by the logger
_HOUR = 3600.0
_YEARS = (1678, 2261)  # of datetime64[ns]
_ZONE = re.compile(r"(?:([zZ])|([+-]\d{2}):?(\d{2})?)$")


@dataclass(frozen=True, eq=False)
class Place:
    """Where rows stand in a file.

    Arguments:
        file: its path.
        lines: of each row; the header is line 1, (time,).
    """

    file: str
    lines: np.ndarray

    def refuse(self, column: str, row: int, message: str) -> NoReturn:
        """Raise an InputError that names file, line and column."""
        raise InputError(f'{self.file}: line {self.lines[row]}, column "{column}": {message}')


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of a CSV file against uniform time.

    Arguments:
        place: where the rows stand.
        time: s since the first row, (time,).
        stamps: the rows' times as in the file: datetime64[ns] by the clock of `zone`, or s, (time,).
        zone: fixed offset of the stamps from UTC, such as "+01:00" or "Z"; None where none is given.
        values: each column, NaN where a cell is empty, (time,).
    """

    place: Place
    time: np.ndarray
    stamps: np.ndarray
    zone: str | None
    values: Mapping[str, np.ndarray]

    def face(self, column: str) -> np.ndarray:
        """The temperatures of a face, degC: complete and plausible."""
        empty = np.isnan(self.values[column])
        if empty.any():
            self.place.refuse(
                column,
                int(empty.argmax()),
                f"the cell is empty ({empty.sum()} of {empty.size} are); a face temperature is needed in "
                "every row: fill the gaps, or cut the record",
            )
        return self.temperature(column)

    def temperature(self, column: str) -> np.ndarray:
        """Temperatures in degC, NaN where missing: at least one, and plausible."""
        values = self.present(column)
        median = float(np.nanmedian(values))
        if median > _KELVIN:
            raise InputError(
                f'{self.place.file}: column "{column}": the median is {median:.6g}, which looks like kelvin; '
                "temperatures must be in degC"
            )
        extreme = np.abs(values) > _EXTREME
        if extreme.any():
            row = int(extreme.argmax())
            self.place.refuse(
                column,
                row,
                f"found {values[row]:.6g}; temperatures must be in degC and within +-{_EXTREME:g} (a spike, "
                "or another unit?)",
            )
        return values

    def present(self, column: str) -> np.ndarray:
        """A column that holds at least one value."""
        if np.isnan(self.values[column]).all():
            raise InputError(f'{self.place.file}: column "{column}" holds no value; it must hold numbers')
        return self.values[column]


def read_columns(path: str | os.PathLike[str], time: str, columns: Iterable[str]) -> Columns:
    """Columns of a CSV file with a header, against a column of uniform time.

    Raises:
        InputError: a file that cannot be read, a column that is missing, a cell that is no number, or
            times that do not go on in one step.
    """
    file, columns = str(path), list(dict.fromkeys(columns))
    header = _read_header(file)
    for name in (time, *columns):
        count = header.count(name)
        if not count:
            there = ", ".join(header)
            raise InputError(f'{file}: no column "{name}"; the columns are {there}{nearest(name, header)}')
        if count > 1:
            raise InputError(f'{file}: {count} columns are called "{name}"; names must differ')
    cells = _read_cells(file).set_axis(header, axis=1)[[time, *columns]].dropna(how="all")
    lines = cells.index.to_numpy() + 2  # blank lines are dropped after they were counted
    if len(lines) < FEWEST_ROWS:
        raise InputError(f"{file}: found {len(lines)} rows below the header; at least {FEWEST_ROWS} are needed")
    place = Place(file, lines)
    seconds, stamps, zone = _read_time(place, time, cells[time])
    _check_step(place, time, seconds, stamps, zone)
    values = {name: _read_numbers(place, name, cells[name]) for name in columns}
    return Columns(place, seconds - seconds[0], stamps, zone, values)


def _read_header(file: str) -> list[str]:
    """The column names: pandas would rename those that stand twice."""
    try:
        with open(file, encoding="utf-8-sig", newline="") as stream:
            header = next(csv.reader(stream), None)
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise _not_utf8(file) from error
    except csv.Error as error:
        raise InputError(f"{file}: line 1: cannot be read as CSV ({error}); is a quotation mark not closed?") from error
    if not header:
        raise InputError(f"{file}: line 1 is empty; it must be a header of column names")
    if len(header) == 1 and (found := re.search("[;\t|]", header[0])):
        raise InputError(f"{file}: line 1: the columns are separated by {show(found[0])}; they must be by a comma")
    return [name.strip() for name in header]


def _read_cells(file: str) -> Any:
    """All columns as a data frame, each as numbers where every cell is one; its index counts lines."""
    import pandas as pd

    try:
        with warnings.catch_warnings():
            # every row longer than the header: pandas would cut them and only warn
            warnings.simplefilter("error", pd.errors.ParserWarning)
            return pd.read_csv(
                file,
                encoding="utf-8-sig",
                low_memory=False,
                skip_blank_lines=False,
                skipinitialspace=True,
                index_col=False,
            )
    except UnicodeDecodeError as error:
        raise _not_utf8(file) from error
    except pd.errors.ParserWarning as error:
        raise InputError(
            f"{file}: line 2: more cells than the header has columns; every row must have one cell for each "
            "(decimal commas? a point is wanted)"
        ) from error
    except pd.errors.ParserError as error:
        detail = str(error).replace("Error tokenizing data. C error: ", "").strip()
        raise InputError(f"{file}: {detail}; every row must have one cell for each column of the header") from error


def _not_utf8(file: str) -> InputError:
    content = Path(file).read_bytes()
    try:
        content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        return InputError(f"{file}: line {line}: not UTF-8; the file must be saved as UTF-8")
    raise AssertionError("the file changed while it was read")


def _as_numbers(cells: Any) -> np.ndarray:
    """A series of texts as numbers, NaN where a text is none."""
    import pandas as pd

    return np.asarray(pd.to_numeric(cells.astype(str).where(cells.notna()), errors="coerce"), float)


def _read_numbers(place: Place, column: str, cells: Any) -> np.ndarray:
    """A series of finite numbers, NaN where a cell is empty."""
    values = cells.to_numpy() if cells.dtype.kind in "iuf" else _as_numbers(cells)
    values = np.asarray(values, float)
    bad = np.isnan(values) & cells.notna().to_numpy()
    if bad.any():
        row = int(bad.argmax())
        cell = str(cells.iloc[row])
        point = " with a decimal point" if "," in cell else ""
        place.refuse(column, row, f"found {show(cell)}; it must be a number{point}, or empty")
    if np.isinf(values).any():
        row = int(np.isinf(values).argmax())
        place.refuse(column, row, "found an infinite value; it must be a finite number")
    return values


def _read_time(place: Place, column: str, cells: Any) -> tuple[np.ndarray, np.ndarray, str | None]:
    """A series of times as s, as stamps, and their zone; whether they increase is for later."""
    import pandas as pd

    empty = cells.isna().to_numpy()
    if empty.any():
        place.refuse(column, int(empty.argmax()), "the time is missing; every row needs one")
    if np.isfinite(_as_numbers(cells.iloc[:1])).all():
        seconds = _read_numbers(place, column, cells)
        return seconds, seconds, None
    texts = cells.astype(str).str.strip()
    times = pd.to_datetime(texts, format="ISO8601", utc=True, errors="coerce")
    bad = ~times.dt.year.between(*_YEARS).to_numpy()  # NaT is not between either
    if bad.any():
        row = int(bad.argmax())
        place.refuse(
            column,
            row,
            f"found {show(texts.iloc[row])}; a time must be ISO 8601 (2014-12-01T00:00:00, with or without "
            "a zone) or a number of seconds",
        )
    zone, offset = _read_zone(place, column, texts)
    stamps = times.dt.tz_localize(None).to_numpy().astype("datetime64[ns]") + np.timedelta64(offset, "s")
    # from the first row on, so that float64 holds nanoseconds
    return (stamps - stamps[0]) / np.timedelta64(1, "s"), stamps, zone


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


def _check_step(place: Place, column: str, seconds: np.ndarray, stamps: np.ndarray, zone: str | None) -> None:
    """Times must increase, all by one step."""
    steps = np.diff(seconds)
    usual = float(np.median(steps))
    back = steps <= 0
    odd = np.abs(steps - usual) > _STEP_TOLERANCE * abs(usual)
    if not (back | odd).any():
        return
    wrong = back if back.any() else odd
    row = int(wrong.argmax()) + 1
    step = float(steps[row - 1])
    before, after = (_show_stamp(stamps[i], zone) for i in (row - 1, row))
    clock = zone is None and np.issubdtype(stamps.dtype, np.datetime64)  # it may follow daylight saving
    cure = "; log in UTC or standard time" if clock else ""
    if back.any():
        cause = "a row that stands twice" if step == 0 else "rows out of order"
        if clock and step >= -_HOUR:
            cause += f", or the end of daylight saving{cure}"
        place.refuse(column, row, f"{after} follows {before}; times must increase from row to row ({cause})")
    summer = clock and abs(step - usual - _HOUR) <= _STEP_TOLERANCE * usual
    cause = f" (a gap, or the start of daylight saving{cure})" if summer else ""
    place.refuse(
        column,
        row,
        f"the step from {before} to {after} is {step:g} s, the usual one {usual:g} s ({wrong.sum()} steps "
        f"differ){cause}; an irregular record cannot be read yet: resample it to a uniform step",
    )


def _show_stamp(stamp: np.generic, zone: str | None) -> str:
    """A time as a message shows it: to the second where it has no fraction."""
    if not isinstance(stamp, np.datetime64):
        return f"{float(stamp):.15g} s"  # pyright: ignore[reportArgumentType]
    return str(stamp).removesuffix(".000000000") + (zone or "")
