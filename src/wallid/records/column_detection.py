"""What columns a logger's file has, before anybody says what they are."""

from __future__ import annotations

import os
import re
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from .._internal.errors import InputError
from .cell_values import as_numbers, unit_of
from .file_format import SEPARATORS, Format
from .file_position import Place
from .logger_file import NUMBER, head_of, read_sheet, read_text, split_cells
from .time_stamps import DATE

_TIME = re.compile(r"time|date|zeit|datum|heure|fecha|stamp|hour|sec|^t$|^s$", re.IGNORECASE)
_ISO = re.compile(r"\d{4}-?\d{2}-?\d{2}")
_FLUX = re.compile(r"flux|^q|heat|w/m", re.IGNORECASE)
_MOST = 0.5  # of a column's cells


@dataclass(frozen=True)
class Column:
    """A column of a file.

    Args:
        name: as in the header.
        kind: "time", "temperature", "flux", "number" or "text".
        low, high: of its numbers; NaN where it has none.
        unit: of a temperature as the file says it, or as its size does; None where neither tells.
    """

    name: str
    kind: str
    low: float
    high: float
    unit: str | None

    def __str__(self) -> str:
        span = "" if np.isnan(self.low) else f", {self.low:g} to {self.high:g}{f' {self.unit}' if self.unit else ''}"
        return f"{self.name} ({self.kind}{span})"


@dataclass(frozen=True)
class Look:
    """What a file seems to hold.

    Args:
        columns: in the file's order.
        day_first: of dates that are not ISO 8601: True or False where one of them tells, else None.
        ambiguous: whether there are such dates and none tells.
    """

    columns: tuple[Column, ...]
    day_first: bool | None
    ambiguous: bool

    def of(self, *kinds: str) -> list[Column]:
        """The columns of some kinds."""
        return [column for column in self.columns if column.kind in kinds]

    def __getitem__(self, name: str) -> Column:
        """A column by its name."""
        return next(column for column in self.columns if column.name == name)


def look(path: str | os.PathLike[str], form: Format, time: str | None = None) -> Look:
    """Read a file's columns without being told of them.

    Args:
        time: the column of times, if a person has named it.

    Raises:
        InputError: a file that cannot be read as a table, or without a column that looks like times.
    """
    file = str(path)
    separator, names = _header(file, form)
    known = [name for name, count in Counter(names).items() if name and count == 1]
    sheet = read_sheet(file, known, replace(form, separator=separator))
    cells = sheet.cells.dropna(how="all")
    place = Place(file, cells.index.to_numpy())
    columns, dates = [], None
    for name in known:
        texts = cells[name].dropna().astype(str).str.strip()
        days = texts[texts.str.match(DATE.pattern)]
        if len(days) > _MOST * len(texts) > 0:
            columns.append(Column(name, "time", np.nan, np.nan, None))
            dates = days if dates is None else dates
            continue
        if len(texts) and texts.str.match(_ISO.pattern).mean() > _MOST and cells[name].dtype.kind not in "iuf":
            columns.append(Column(name, "time", np.nan, np.nan, None))
            continue
        found = as_numbers(place, name, cells[name], form, sheet.decimal)
        columns.append(_column(name, found.values, sheet.units[name], float(found.text.mean())))
    if time is None and not any(column.kind == "time" for column in columns):
        there = ", ".join(map(str, columns))
        raise InputError(f"{file}: no column of times; found {there}; name it with --time")
    day_first = None if dates is None else _day_first(dates)
    return Look(tuple(columns), day_first, dates is not None and day_first is None)


def _header(file: str, form: Format) -> tuple[str, list[str]]:
    """The separator that makes most columns, and of the lines as wide without a number the first with most names.

    Not simply the first: spreadsheets fill up the lines above a header with separators.
    """
    content, _ = read_text(file, form)
    head = head_of(content)
    best: tuple[int, str, list[str]] = (0, ",", [])
    for separator in SEPARATORS if form.separator is None else (form.separator,):
        rows = split_cells(head, separator)
        if not rows:
            continue
        width = Counter(len(row) for row in rows[1:] or rows).most_common(1)[0][0]
        wide = [row for row in rows if len(row) >= width - 1 and not any(map(NUMBER.match, row)) and any(row)]
        if wide and width > best[0]:
            best = (width, separator, max(wide, key=lambda row: sum(map(bool, row))))
    if best[0] < 2:
        raise InputError(f"{file}: line 1: found no header of two or more columns; a record must be CSV with a header")
    return best[1], best[2]


def _column(name: str, values: np.ndarray, written: str, text: float) -> Column:
    """What a column of numbers is, by its name, its unit and its size."""
    numbers = values[np.isfinite(values)]
    if not len(numbers) or text > _MOST:
        return Column(name, "text", np.nan, np.nan, None)
    low, high, unit = float(numbers.min()), float(numbers.max()), unit_of(written, name)
    rising = len(numbers) > 1 and bool(np.all(np.diff(numbers) > 0))
    if rising and _TIME.search(name) and unit is None:
        return Column(name, "time", low, high, None)
    if unit is None and (_FLUX.search(name) or _FLUX.search(written)):
        return Column(name, "flux", low, high, None)
    if unit is None and 200.0 < float(np.median(numbers)) < 350.0:
        unit = "K"
    plausible = {"K": (150.0, 450.0), "degF": (-150.0, 300.0)}.get(unit or "degC", (-100.0, 150.0))
    middle = np.quantile(numbers, [0.05, 0.95])
    kind = "temperature" if plausible[0] <= middle[0] and middle[1] <= plausible[1] else "number"
    return Column(name, kind, low, high, unit)


def _day_first(dates) -> bool | None:
    """Whether dates begin with the day, where one has a number past 12."""
    parts = dates.str.extract(DATE.pattern)
    first, second = parts[0].astype(int).max(), parts[2].astype(int).max()
    if (first > 12) == (second > 12):
        return None
    return bool(first > 12)
