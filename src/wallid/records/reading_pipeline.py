"""From a logger's file to a record's rows: reading, order, screening, the grid, gaps; all of it noted."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._internal.errors import InputError
from .cell_values import readings, temperatures
from .cleaning_log import Break, Cleaning, Noted, Notes
from .file_format import Format
from .file_position import Place
from .gap_filling import Face, fill_face
from .outlier_screening import spikes, stuck
from .row_order import in_order
from .stamp import Stamps, show_stamp
from .table_columns import FEWEST_ROWS, Table, read_table
from .uniform_grid import USUAL, Grid, Readings, make_grid, on_grid

AIR = ("air_outdoor", "air_indoor")
_PLAIN = (",", ".", "utf-8", 1, 0)


@dataclass(frozen=True, eq=False)
class Parts:
    """What a record is made of; see `Record`."""

    time: np.ndarray
    stamps: np.ndarray
    zone: str | None
    faces: np.ndarray
    sensors: np.ndarray
    regressors: dict[str, np.ndarray]
    fill_std: np.ndarray | None
    cleaning: Cleaning


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows in order, each time once."""

    place: Place
    column: str
    stamps: Stamps
    values: dict[str, np.ndarray]


def read_parts(
    path: str | os.PathLike[str],
    time: str,
    faces: tuple[str, str],
    sensors: Sequence[str],
    regressors: Mapping[str, str],
    form: Format,
    units: Mapping[str, str],
) -> Parts:
    """A record's rows from a file.

    Args:
        faces, sensors: columns of temperatures.
        regressors: a column for each key.
        units: of columns that are not in the format's.

    Raises:
        InputError: what is wrong with the file, with its line and column.
    """
    inner = (*faces, *sensors)
    table = read_table(path, time, [*inner, *regressors.values()], form)
    notes = Notes(table.stamps.seconds)
    if table.dropped:
        notes.note(Noted("", "dropped", len(table.dropped), table.dropped[0]))
    air = [regressors[key] for key in AIR if key in regressors]
    values = _values(table, (*inner, *air), regressors.values(), form, units, notes)
    place, stamps, values = in_order(table.place, time, table.stamps, values, notes)
    rows = _Rows(place, time, stamps, values)
    notes.seconds = stamps.seconds
    if form.clean:
        for name in inner:
            _screen(rows, name, notes)
    for name in inner:
        _check_enough(rows, name, notes, face=name in faces)
    grid = make_grid(place, time, stamps, [values[name] for name in faces], form)
    return _onto(grid, rows, faces, sensors, regressors, form, notes, _written(table, form))


def _values(
    table: Table, degrees: Sequence[str], others, form: Format, units: Mapping[str, str], notes: Notes
) -> dict[str, np.ndarray]:
    """Every column as numbers, temperatures in degC."""
    place, decimal, found = table.place, table.sheet.decimal, {}
    for name in dict.fromkeys(degrees):
        found[name] = temperatures(
            place,
            name,
            table.cells[name],
            form,
            decimal,
            notes,
            unit=units.get(name, form.unit),
            written=table.sheet.units[name],
        )
    for name in others:
        if name not in found:
            found[name] = readings(place, name, table.cells[name], form, decimal, notes)
    return found


def _written(table: Table, form: Format) -> str:
    """How a file that is not plain CSV is written, in words."""
    sheet, words = table.sheet, []
    if (sheet.separator, sheet.decimal, sheet.encoding, sheet.header_line, sheet.unit_rows) != _PLAIN:
        name = {"\t": "tab", ";": "semicolon", ",": "comma", "|": "bar"}[sheet.separator]
        words.append(f"{sheet.encoding.upper()}, columns separated by {name}, decimal {_MARKS[sheet.decimal]}")
        if sheet.header_line > 1:
            words.append(f"header in line {sheet.header_line}")
        if sheet.unit_rows:
            words.append(f"{sheet.unit_rows} line(s) of units under it")
    if form.timezone is not None:
        words.append(f"times by the clock of {form.timezone}")
    return "; ".join(words)


_MARKS = {".": "point", ",": "comma"}


def _screen(rows: _Rows, name: str, notes: Notes) -> None:
    """Mask a column's spikes and stuck readings."""
    values = rows.values[name]
    for kind, look in (("spike", lambda t, v: spikes(t, v)), ("stuck", lambda t, v: stuck(v))):
        there = np.flatnonzero(np.isfinite(values))
        which = np.zeros(len(values), bool)
        which[there[look(rows.stamps.seconds[there], values[there])]] = True
        if which.any():
            row = int(which.argmax())
            noted = Noted(name, kind, int(which.sum()), int(rows.place.lines[row]), f"{values[row]:.6g}")
            notes.note(noted, which)
            values = np.where(which, np.nan, values)
    rows.values[name] = values


def _check_enough(rows: _Rows, name: str, notes: Notes, *, face: bool) -> None:
    """Refuse a column of which next to nothing is left."""
    left = int(np.isfinite(rows.values[name]).sum())
    if left < (FEWEST_ROWS if face else 1):
        done = ", ".join(str(one) for one in notes.noted if one.column == name)
        rows.place.refuse_column(
            name,
            f"{left} readings are left{f' ({done})' if done else ''}; "
            + (f"a face needs at least {FEWEST_ROWS}" if face else "leave this sensor out of the case"),
        )


def _onto(
    grid: Grid,
    rows: _Rows,
    faces: tuple[str, str],
    sensors: Sequence[str],
    regressors: Mapping[str, str],
    form: Format,
    notes: Notes,
    written: str,
) -> Parts:
    """Every column on the grid, cut to where both faces have readings."""
    seconds, bound = rows.stamps.seconds, form.gap_seconds(grid.step)
    gathered = {name: on_grid(grid, seconds, values) for name, values in rows.values.items()}
    found = [fill_face(grid, gathered[name], bound) for name in faces]
    keep = _both(grid, [gathered[name] for name in faces], found)
    if keep.stop - keep.start < FEWEST_ROWS:
        raise InputError(
            f"{rows.place.file}: {keep.stop - keep.start} rows of {grid.step:g} s have both faces; at least "
            f"{FEWEST_ROWS} are needed"
        )
    if not grid.as_read:
        for name in (*faces, *sensors):
            _note_moves(name, gathered[name], notes)
    near = max(bound, USUAL * grid.step)
    inner = [_on_rows(grid, name, gathered[name], near, notes, rows) for name in sensors]
    if (cut := len(grid.seconds) - (keep.stop - keep.start)) > 0:
        notes.note(Noted("", "trimmed", cut))
    for name, face in zip(faces, found, strict=True):
        _note_fills(name, face, keep, grid.step, notes)
    std = np.stack([face.std[keep] for face in found], axis=1)
    breaks = _breaks(grid, faces, found, keep, rows)
    at = grid.seconds[keep]
    return Parts(
        time=at - at[0] if grid.as_read else grid.step * np.arange(len(at)),
        stamps=grid.stamps[keep],
        zone=rows.stamps.zone,
        faces=np.stack([face.values[keep] for face in found], axis=1),
        sensors=np.stack([one[keep] for one in inner], axis=1) if inner else np.empty((len(at), 0)),
        regressors={key: _regressor(grid, gathered[name], bound)[keep] for key, name in regressors.items()},
        fill_std=std if std.any() else None,
        cleaning=notes.cleaning(written, breaks, faces, float(at[0])),
    )


def _both(grid: Grid, readings: Sequence[Readings], faces: Sequence[Face]) -> slice:
    """From the first row in which both faces are known to the last."""
    begin = max(one.seconds[0] for one in readings)
    end = min(one.seconds[-1] for one in readings)
    known = (grid.seconds >= begin) & (grid.seconds <= end) & ~faces[0].broken & ~faces[1].broken
    rows = np.flatnonzero(known)
    return slice(int(rows[0]), int(rows[-1]) + 1) if len(rows) else slice(0, 0)


def _on_rows(grid: Grid, name: str, found: Readings, bound: float, notes: Notes, rows: _Rows) -> np.ndarray:
    """An inner sensor's readings, each carried to its nearest row along the line to its neighbour; else NaN."""
    values = np.full(len(grid.seconds), np.nan)
    inside = (found.rows >= 0) & (found.rows < len(grid.seconds))
    if grid.as_read:
        values[found.rows] = found.values
        return values
    at = grid.seconds[found.rows[inside]]
    there, apart = found.around(at)
    near = there | (apart <= bound * (1 + 1e-9))
    moved = near & ~there
    values[found.rows[inside][near]] = found.at(at[near])
    if moved.any():
        farthest = float(np.abs(found.seconds[inside] - at)[moved].max())
        notes.note(Noted(name, "carried", int(moved.sum()), None, f"{farthest:.4g} s"))
    if (lost := ~near).any():
        when = found.seconds[inside][lost]
        nearest = np.clip(np.searchsorted(notes.seconds, when), 0, len(notes.seconds) - 1)
        which = np.zeros(len(notes.seconds), bool)
        which[nearest] = True
        notes.note(Noted(name, "stranded", int(lost.sum()), int(rows.place.lines[nearest[0]])), which)
    return values


def _regressor(grid: Grid, found: Readings, bound: float) -> np.ndarray:
    """A regressor in every row that has readings near enough on both sides; else NaN."""
    values = np.full(len(grid.seconds), np.nan)
    if grid.as_read:
        values[found.rows] = found.values
    elif len(found.seconds):
        _, apart = found.around(grid.seconds)
        near = apart <= max(bound, 1.5 * found.usual(grid.step))
        values[near] = found.at(grid.seconds[near])
    return values


def _note_moves(name: str, found: Readings, notes: Notes) -> None:
    if found.binned:
        notes.note(Noted(name, "binned", found.binned))
    if found.snapped:
        notes.note(Noted(name, "snapped", found.snapped, None, f"{found.farthest:.3g} s"))


def _note_fills(name: str, face: Face, keep: slice, step: float, notes: Notes) -> None:
    filled = face.filled[keep]
    if filled.any():
        gaps = int(np.sum(np.diff(np.concatenate([[0], filled.astype(int)])) > 0))
        words = f"{gaps} gap{'s' if gaps > 1 else ''} of up to {face.longest / 3600:.3g} h"
        notes.note(Noted(name, "filled", int(filled.sum()), None, words))
    if (between := int(face.between[keep].sum())) > 0:
        notes.note(Noted(name, "between", between))


def _breaks(grid: Grid, names: Sequence[str], faces: Sequence[Face], keep: slice, rows: _Rows) -> tuple[Break, ...]:
    """The stretches in which a face has no reading for too long."""
    broken = np.stack([face.broken[keep] for face in faces], axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], broken.any(axis=1).astype(int), [0]])))
    stamps: Any = grid.stamps[keep]
    zone, found = rows.stamps.zone, []
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        columns = tuple(name for side, name in enumerate(names) if broken[start:stop, side].any())
        before, after = (show_stamp(moment, zone) for moment in (stamps[start - 1], stamps[stop]))
        hours = (stop - start + 1) * grid.step / 3600
        found.append(Break(int(start), int(stop - start), before, after, float(hours), columns))
    return tuple(found)
