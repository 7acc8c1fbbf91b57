"""The wanted columns of a CSV file: its rows, their times, and columns that must be whole and uniform."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._internal.errors import InputError
from .._internal.validation import show
from .cell_values import as_numbers, temperatures
from .cleaning_log import Notes
from .file_format import Format
from .file_position import Place
from .logger_file import Sheet, read_sheet
from .stamp import STEP_TOLERANCE, Stamps, show_stamp
from .time_stamps import read_stamps

FEWEST_ROWS = 8


@dataclass(frozen=True, eq=False)
class Table:
    """The rows of a file that hold something.

    Args:
        sheet: the file.
        place: where the rows stand.
        cells: the wanted columns, a row each.
        stamps: the rows' times, in the file's order.
        dropped: lines that hold neither a time nor a number.
    """

    sheet: Sheet
    place: Place
    cells: Any
    stamps: Stamps
    dropped: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns against uniform time, whole.

    Args:
        time: s since the first row, (time,).
        values: each column, degC, (time,).
    """

    time: np.ndarray
    values: Mapping[str, np.ndarray]


def read_table(path: str | os.PathLike[str], time: str, columns: Iterable[str], form: Format) -> Table:
    """The rows of a file's columns, with their times.

    Raises:
        InputError: a file that cannot be read, a column that is missing, a time that is none, or too few rows.
    """
    sheet = read_sheet(path, [time, *columns], form)
    cells = sheet.cells.dropna(how="all")
    idle = _idle(cells, time)
    dropped = tuple(int(line) for line in cells.index[idle])
    cells = cells[~idle] if len(dropped) else cells
    if len(cells) < FEWEST_ROWS:
        raise InputError(f"{sheet.file}: found {len(cells)} rows below the header; at least {FEWEST_ROWS} are needed")
    place = Place(sheet.file, cells.index.to_numpy())
    return Table(sheet, place, cells, read_stamps(place, time, cells[time], form), dropped)


def _idle(cells: Any, time: str) -> np.ndarray:
    """Rows without a time and without a number: a logger's remarks, a header that stands again."""
    import pandas as pd

    times = cells[time]
    idle = times.isna().to_numpy(bool, copy=True)
    if times.dtype.kind not in "iuf":
        idle |= ~times.astype(str).str.match(r"\s*[+-]?\d").to_numpy(bool)
    if idle.any():
        others = cells[idle].drop(columns=time)
        numbers = others.apply(lambda one: pd.to_numeric(one.astype(str).str.replace(",", "."), errors="coerce"))
        idle[idle] = numbers.isna().all(axis=1).to_numpy(bool)
    return idle


def read_columns(path: str | os.PathLike[str], time: str, columns: Sequence[str]) -> Columns:
    """Temperatures in a CSV file that must be there in every row, at a uniform step.

    Raises:
        InputError: what is wrong with the file, with its line and column.
    """
    form = Format(clean=False)
    table = read_table(path, time, columns, form)
    _check_step(table.place, time, table.stamps)
    values = {}
    for name in dict.fromkeys(columns):
        cells = table.cells[name]
        found = as_numbers(table.place, name, cells, form, table.sheet.decimal)
        missing = np.isnan(found.values)
        if found.empty.any():
            row = int(found.empty.argmax())
            count = f"{found.empty.sum()} of {missing.size} are"
            table.place.refuse(name, row, f"the cell is empty ({count}); a value is needed in every row")
        if missing.any():
            row = int(missing.argmax())
            table.place.refuse(name, row, f"found {show(str(cells.iloc[row]))}; it must be a finite number")
        unit = table.sheet.units[name]
        notes = Notes(table.stamps.seconds)
        values[name] = temperatures(table.place, name, cells, form, table.sheet.decimal, notes, unit=None, written=unit)
        if notes.masked:
            row = int(np.isnan(values[name]).argmax())
            table.place.refuse(name, row, f"found {cells.iloc[row]:.6g}; temperatures must be in degC")
    return Columns(table.stamps.seconds - table.stamps.seconds[0], values)


def check_increasing(place: Place, column: str, stamps: Stamps) -> None:
    """Refuse times that do not increase."""
    steps = np.diff(stamps.seconds)
    if (steps <= 0).any():
        row = int((steps <= 0).argmax()) + 1
        place.refuse(
            column, row, f"{stamps.show(row)} follows {stamps.show(row - 1)}; times must increase from row to row"
        )


def _check_step(place: Place, column: str, stamps: Stamps) -> None:
    """Times must increase, all by one step."""
    check_increasing(place, column, stamps)
    steps = np.diff(stamps.seconds)
    usual = float(np.median(steps))
    odd = np.abs(steps - usual) > STEP_TOLERANCE * usual
    if odd.any():
        row = int(odd.argmax()) + 1
        before, after = (show_stamp(stamps.stamps[k], stamps.zone) for k in (row - 1, row))
        place.refuse(
            column,
            row,
            f"the step from {before} to {after} is {steps[row - 1]:g} s, the usual one {usual:g} s ({odd.sum()} steps "
            "differ); resample the signals to a uniform step",
        )
