"""Detection of the columns of a logger's file and of their kinds."""

from __future__ import annotations

import os
import re
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from .._internal.errors import InputError
from .cell_values import CellColumn, parse_numbers, stated_unit
from .column_roles import stated_use
from .file_format import SEPARATORS, FileFormat
from .file_position import FilePosition
from .logger_file import NUMBER, decode_file, first_lines, read_raw_table, split_cells
from .time_parsing import DATE

_TIME = re.compile(
    r"time|date|zeit|datum|heure|fecha|stamp|hour|sec|tiempo|hora\b|tempo\b|\bora\b|\bdata\b|tijd|^t$|^s$",
    re.IGNORECASE,
)
_ISO = re.compile(r"\d{4}-?\d{2}-?\d{2}")
_MAJORITY = 0.5  # of a column's cells


@dataclass(frozen=True)
class DetectedColumn:
    """A column of a file.

    Args:
        name: as in the header.
        kind: "time", "temperature", "flux", "irradiance", "number" or "text".
        use: what the name says of a column that is no temperature, as from `column_roles.stated_use`.
        low, high: minimum and maximum of its numbers; NaN where it has none.
        unit: of a temperature, stated in the file or concluded from the values; None where unknown.
    """

    name: str
    kind: str
    low: float
    high: float
    unit: str | None
    use: str | None = None

    def __str__(self) -> str:
        value_range = (
            "" if np.isnan(self.low) else f", {self.low:g} to {self.high:g}{f' {self.unit}' if self.unit else ''}"
        )
        return f"{self.name} ({self.kind}{value_range})"


@dataclass(frozen=True)
class DetectedColumns:
    """The detected columns of a file.

    Args:
        columns: in the file's order.
        day_first: whether dates that are not ISO 8601 begin with the day; None where no date has a number above 12.
        ambiguous: whether there are such dates and `day_first` is None.
    """

    columns: tuple[DetectedColumn, ...]
    day_first: bool | None
    ambiguous: bool

    def of_kind(self, *kinds: str) -> list[DetectedColumn]:
        """The columns of some kinds."""
        return [column for column in self.columns if column.kind in kinds]

    def __getitem__(self, name: str) -> DetectedColumn:
        """A column by its name."""
        return next(column for column in self.columns if column.name == name)


def detect_columns(path: str | os.PathLike[str], file_format: FileFormat, time: str | None = None) -> DetectedColumns:
    """Detect the columns of a file and their kinds.

    Args:
        path: of the file.
        file_format: what is known of its format.
        time: the column of times, where the user has stated it.

    Raises:
        InputError: the file is not a table, or no column of times was found.
    """
    file = str(path)
    separator, names = _detect_header(file, file_format)
    unique = [name for name, count in Counter(names).items() if name and count == 1]
    raw = read_raw_table(file, unique, replace(file_format, separator=separator))
    cells = raw.cells.dropna(how="all")
    location = FilePosition(file, cells.index.to_numpy())
    columns, dates = [], None
    for name in unique:
        texts = cells[name].dropna().astype(str).str.strip()
        with_date = texts[texts.str.match(DATE.pattern)]
        if len(with_date) > _MAJORITY * len(texts) > 0:
            columns.append(DetectedColumn(name, "time", np.nan, np.nan, None))
            dates = with_date if dates is None else dates
        elif len(texts) and texts.str.match(_ISO.pattern).mean() > _MAJORITY and cells[name].dtype.kind not in "iuf":
            columns.append(DetectedColumn(name, "time", np.nan, np.nan, None))
        else:
            column = CellColumn(name, cells[name], location, raw.decimal, raw.units[name])
            parsed = parse_numbers(column, file_format)
            columns.append(_classify(name, parsed.values, column.unit_row, float(parsed.text.mean())))
    if time is None and not any(column.kind == "time" for column in columns):
        names = ", ".join(map(str, columns))
        raise InputError(f"{file}: no column of times; found {names}; set it with --time")
    day_first = None if dates is None else _day_first(dates)
    return DetectedColumns(tuple(columns), day_first, dates is not None and day_first is None)


def _detect_header(file: str, file_format: FileFormat) -> tuple[str, list[str]]:
    """Detect the separator, which gives most columns, and the header: the line with most names and without a number.

    The first line is not always the header: spreadsheets fill the lines above it with separators.
    """
    content, _ = decode_file(file, file_format)
    head = first_lines(content)
    best: tuple[int, str, list[str]] = (0, ",", [])
    for separator in SEPARATORS if file_format.separator is None else (file_format.separator,):
        rows = split_cells(head, separator)
        if not rows:
            continue
        width = Counter(len(row) for row in rows[1:] or rows).most_common(1)[0][0]
        wide = [row for row in rows if len(row) >= width - 1 and not any(map(NUMBER.match, row)) and any(row)]
        if wide and width > best[0]:
            best = (width, separator, max(wide, key=lambda row: sum(map(bool, row))))
    if best[0] < 2:
        raise InputError(
            f"{file}: line 1: found no header of two or more columns; a record must be a CSV file with a header"
        )
    return best[1], best[2]


def _classify(name: str, values: np.ndarray, unit_row: str, text_fraction: float) -> DetectedColumn:
    """The kind of a column, from its name, its unit and its values."""
    numbers = values[np.isfinite(values)]
    if not len(numbers) or text_fraction > _MAJORITY:
        return DetectedColumn(name, "text", np.nan, np.nan, None)
    low, high, unit = float(numbers.min()), float(numbers.max()), stated_unit(unit_row, name)
    rising = len(numbers) > 1 and bool(np.all(np.diff(numbers) > 0))
    if rising and _TIME.search(name) and unit is None:
        return DetectedColumn(name, "time", low, high, None)
    use = None if unit is not None else stated_use(name, unit_row)
    if use is not None:
        kind = use if use in ("flux", "irradiance") else "number"
        return DetectedColumn(name, kind, low, high, None, use)
    if unit is None and 200.0 < float(np.median(numbers)) < 350.0:
        unit = "K"
    plausible = {"K": (150.0, 450.0), "degF": (-150.0, 300.0)}.get(unit or "degC", (-100.0, 150.0))
    central = np.quantile(numbers, [0.05, 0.95])
    kind = "temperature" if plausible[0] <= central[0] and central[1] <= plausible[1] else "number"
    return DetectedColumn(name, kind, low, high, unit)


def _day_first(dates) -> bool | None:
    """Whether dates begin with the day; None where no date has a number above 12 that shows it."""
    parts = dates.str.extract(DATE.pattern)
    first, second = parts[0].astype(int).max(), parts[2].astype(int).max()
    if (first > 12) == (second > 12):
        return None
    return bool(first > 12)
