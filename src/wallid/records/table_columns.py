"""Selected columns of a CSV file with the times of their rows."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .._internal.errors import InputError
from .._internal.validation import format_value
from .cell_values import CellColumn, parse_numbers, read_temperatures
from .dataframe_table import raw_table_from_dataframe
from .file_format import FileFormat
from .file_position import FilePosition
from .logger_file import RawTable, read_raw_table
from .row_times import STEP_TOLERANCE, RowTimes
from .time_parsing import parse_times

if TYPE_CHECKING:
    from pandas import DataFrame

MIN_ROWS = 8


@dataclass(frozen=True, eq=False)
class TimedTable:
    """The rows of a file that hold data, with their times.

    Args:
        raw: the cells of the file.
        location: of the rows in the file.
        cells: the requested columns as a data frame, (time,) rows.
        times: of the rows, in the file's order.
        dropped: lines that have neither a time nor a number.
    """

    raw: RawTable
    location: FilePosition
    cells: Any
    times: RowTimes
    dropped: tuple[int, ...]

    def column(self, name: str) -> CellColumn:
        """A column by its name."""
        return CellColumn(name, self.cells[name], self.location, self.raw.decimal, self.raw.units[name])


@dataclass(frozen=True, eq=False)
class UniformTable:
    """Columns without missing values at uniform times.

    Args:
        time: s since the first row, (time,).
        values: each column, degC, (time,).
    """

    time: np.ndarray
    values: Mapping[str, np.ndarray]


def read_timed_table(
    path: str | os.PathLike[str] | DataFrame, time: str, columns: Iterable[str], file_format: FileFormat
) -> TimedTable:
    """Read columns of a file or DataFrame and the times of their rows.

    Args:
        path: of the file, or a DataFrame.
        time: the column of times.
        columns: the other columns.
        file_format: of the file.

    Raises:
        InputError: the file cannot be read, a column is missing, a time is invalid, or there are too few rows.
    """
    wanted = [time, *columns]
    if isinstance(path, (str, os.PathLike)):
        raw = read_raw_table(path, wanted, file_format)
    else:
        raw = raw_table_from_dataframe(path, wanted)
    cells = raw.cells.dropna(how="all")
    without_data = _rows_without_data(cells, time)
    dropped = tuple(int(line) for line in cells.index[without_data])
    cells = cells[~without_data] if len(dropped) else cells
    if len(cells) < MIN_ROWS:
        raise InputError(f"{raw.file}: found {len(cells)} rows below the header; at least {MIN_ROWS} are needed")
    location = FilePosition(raw.file, cells.index.to_numpy())
    return TimedTable(raw, location, cells, parse_times(location, time, cells[time], file_format), dropped)


def _rows_without_data(cells: Any, time: str) -> np.ndarray:
    """Which rows have neither a time nor a number, such as comments and repeated headers."""
    import pandas as pd

    times = cells[time]
    without_data = times.isna().to_numpy(bool, copy=True)
    if times.dtype.kind not in "iuf":
        without_data |= ~times.astype(str).str.match(r"\s*[+-]?\d").to_numpy(bool)
    if without_data.any():
        others = cells[without_data].drop(columns=time)
        numbers = others.apply(lambda column: pd.to_numeric(column.astype(str).str.replace(",", "."), errors="coerce"))
        without_data[without_data] = numbers.isna().all(axis=1).to_numpy(bool)
    return without_data


def read_uniform_table(path: str | os.PathLike[str], time: str, columns: Sequence[str]) -> UniformTable:
    """Read columns of temperatures that have a value in every row, at a uniform step.

    Args:
        path: of the CSV file.
        time: the column of times.
        columns: of temperatures, degC.

    Raises:
        InputError: the file is invalid; the message gives line and column.
    """
    file_format = FileFormat(clean=False)
    table = read_timed_table(path, time, columns, file_format)
    location = table.location
    _check_step(location, time, table.times)
    values = {}
    for name in dict.fromkeys(columns):
        column = table.column(name)
        parsed = parse_numbers(column, file_format)
        missing = np.isnan(parsed.values)
        if parsed.empty.any():
            row = int(parsed.empty.argmax())
            count = f"{parsed.empty.sum()} of {missing.size} are"
            location.raise_at_cell(name, row, f"the cell is empty ({count}); a value is needed in every row")
        if missing.any():
            row = int(missing.argmax())
            location.raise_at_cell(
                name, row, f"found {format_value(str(column.cells.iloc[row]))}; it must be a finite number"
            )
        values[name], _ = read_temperatures(column, file_format, unit=None)
        impossible = np.isnan(values[name])
        if impossible.any():
            row = int(impossible.argmax())
            location.raise_at_cell(name, row, f"found {column.cells.iloc[row]:.6g}; temperatures must be in degC")
    return UniformTable(table.times.seconds - table.times.seconds[0], values)


def _check_step(location: FilePosition, column: str, times: RowTimes) -> None:
    """Raise an error unless the times increase by a uniform step."""
    steps = np.diff(times.seconds)
    if (steps <= 0).any():
        row = int((steps <= 0).argmax()) + 1
        location.raise_at_cell(
            column, row, f"{times.format(row)} follows {times.format(row - 1)}; times must increase from row to row"
        )
    typical = float(np.median(steps))
    differs = np.abs(steps - typical) > STEP_TOLERANCE * typical
    if differs.any():
        row = int(differs.argmax()) + 1
        location.raise_at_cell(
            column,
            row,
            f"the step from {times.format(row - 1)} to {times.format(row)} is {steps[row - 1]:g} s, the usual one "
            f"{typical:g} s ({differs.sum()} steps differ); resample the signals to a uniform step",
        )
