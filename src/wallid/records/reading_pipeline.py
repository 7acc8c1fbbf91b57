"""The steps from a logger's file to the arrays of a record: reading, sorting, screening, resampling, gap filling."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .._internal.errors import InputError
from .cell_values import read_numbers, read_temperatures
from .cleaning_log import CleaningLog, CleaningStep, RecordBreak
from .file_format import FileFormat
from .gap_filling import FilledFace, interpolate_face
from .outlier_screening import find_spikes, find_stuck_readings
from .row_order import SortedRows, sort_rows
from .row_times import format_time
from .table_columns import MIN_ROWS, TimedTable, read_timed_table
from .uniform_grid import GAP_FACTOR, ColumnReadings, UniformGrid, assign_to_rows, choose_grid

if TYPE_CHECKING:
    from pandas import DataFrame

_AIR = ("air_outdoor", "air_indoor")
PLATES = ("flux_left", "flux_right")
"""The regressors whose columns are readings of the wall, as those of the sensors are."""
_PLAIN_CSV = (",", ".", "utf-8", 1, 0)
_SEPARATOR_NAMES = {"\t": "tab", ";": "semicolon", ",": "comma", "|": "bar"}
_DECIMAL_NAMES = {".": "point", ",": "comma"}


def read_record_arrays(
    path: str | os.PathLike[str] | DataFrame,
    time: str,
    faces: tuple[str, str],
    sensors: Sequence[str],
    regressors: Mapping[str, str],
    file_format: FileFormat,
    units: Mapping[str, str],
) -> dict[str, Any]:
    """Read a record's arrays from a file or DataFrame.

    Args:
        path: of the file, or a DataFrame.
        time: the column of times.
        faces, sensors: columns of temperatures.
        regressors: a column for each key.
        file_format: of the file.
        units: of columns whose unit differs from the format's.

    Returns:
        The fields of `Record` that the file determines.

    Raises:
        InputError: the file is invalid; the message gives line and column.
    """
    temperatures = (*faces, *sensors)
    table = read_timed_table(path, time, [*temperatures, *regressors.values()], file_format)
    steps = [CleaningStep("", "dropped", len(table.dropped), table.dropped[0])] if table.dropped else []
    air = [regressors[key] for key in _AIR if key in regressors]
    values, reading_steps = _read_values(table, (*temperatures, *air), [*regressors.values()], file_format, units)
    rows, sorting_steps = sort_rows(table.location, time, table.times, values)
    steps += reading_steps + sorting_steps
    if file_format.clean:
        for name in temperatures:
            rows.values[name], screening_steps = _screen(rows, name)
            steps += screening_steps
    for name in temperatures:
        _check_enough_readings(rows, name, steps, is_face=name in faces)
    grid = choose_grid(rows.location, time, rows.times, [rows.values[name] for name in faces], file_format)
    return _resample(grid, rows, table, faces, sensors, regressors, file_format, steps)


def _read_values(
    table: TimedTable, temperatures: Sequence[str], others: Sequence[str], file_format: FileFormat, units: Mapping
) -> tuple[dict[str, np.ndarray], list[CleaningStep]]:
    """All columns as numbers, temperatures in degC."""
    values, steps = {}, []
    for name in dict.fromkeys((*temperatures, *others)):
        column, unit = table.column(name), units.get(name, file_format.unit)
        is_temperature = name in temperatures
        read = (
            read_temperatures(column, file_format, unit=unit) if is_temperature else read_numbers(column, file_format)
        )
        values[name], column_steps = read
        steps += column_steps
    return values, steps


def _format_in_words(table: TimedTable, file_format: FileFormat) -> str:
    """The format of a file in words; empty for plain CSV."""
    raw, parts = table.raw, []
    if (raw.separator, raw.decimal, raw.encoding, raw.header_line, raw.unit_rows) != _PLAIN_CSV:
        separator, decimal = _SEPARATOR_NAMES[raw.separator], _DECIMAL_NAMES[raw.decimal]
        parts.append(f"{raw.encoding.upper()}, columns separated by {separator}, decimal {decimal}")
        if raw.header_line > 1:
            parts.append(f"header in line {raw.header_line}")
        if raw.unit_rows:
            parts.append(f"{raw.unit_rows} line(s) of units below it")
    if file_format.timezone is not None:
        parts.append(f"times in the time zone {file_format.timezone}")
    return "; ".join(parts)


def _screen(rows: SortedRows, name: str) -> tuple[np.ndarray, list[CleaningStep]]:
    """A column with spikes and stuck readings masked."""
    values, steps = rows.values[name], []
    for kind, find_outliers in (("spike", find_spikes), ("stuck", lambda seconds, values: find_stuck_readings(values))):
        present = np.flatnonzero(np.isfinite(values))
        masked = np.zeros(len(values), bool)
        masked[present[find_outliers(rows.times.seconds[present], values[present])]] = True
        if masked.any():
            example = f"{values[masked.argmax()]:.6g}"
            step = CleaningStep.masking(name, kind, rows.location.lines, masked, example)
            steps.append(replace(step, masked_values=values[masked]))
            values = np.where(masked, np.nan, values)
    return values, steps


def _check_enough_readings(rows: SortedRows, name: str, steps: Sequence[CleaningStep], *, is_face: bool) -> None:
    """Raise an error where too few readings of a column remain."""
    count = int(np.isfinite(rows.values[name]).sum())
    if count < (MIN_ROWS if is_face else 1):
        changes = ", ".join(str(step) for step in steps if step.column == name)
        rows.location.raise_for_column(
            name,
            f"{count} readings remain{f' ({changes})' if changes else ''}; "
            + (f"a face needs at least {MIN_ROWS}" if is_face else "remove this sensor from the case"),
        )


def _resample(
    grid: UniformGrid,
    rows: SortedRows,
    table: TimedTable,
    faces: tuple[str, str],
    sensors: Sequence[str],
    regressors: Mapping[str, str],
    file_format: FileFormat,
    steps: list[CleaningStep],
) -> dict[str, Any]:
    """All columns on the grid, from the first to the last row with both faces."""
    longest_gap = file_format.longest_gap_seconds(grid.step)
    readings = {name: assign_to_rows(grid, rows.times.seconds, values) for name, values in rows.values.items()}
    filled = [interpolate_face(grid, readings[name], longest_gap) for name in faces]
    part = _rows_with_both_faces(grid, [readings[name] for name in faces], filled)
    count = part.stop - part.start
    if count < MIN_ROWS:
        raise InputError(
            f"{rows.location.file}: {count} rows of {grid.step:g} s have both faces; at least {MIN_ROWS} are needed"
        )
    steps = list(steps)
    plates = [regressors[key] for key in PLATES if key in regressors]
    if not grid.as_read:
        for name in dict.fromkeys((*faces, *sensors, *plates)):
            steps += _assignment_steps(name, readings[name])
    read = {}
    for name in dict.fromkeys((*sensors, *plates)):
        read[name], reading_steps = _readings_on_grid(grid, rows, name, readings[name], longest_gap)
        steps += reading_steps
    others = {
        key: _regressor_on_grid(grid, readings[name], longest_gap)
        for key, name in regressors.items()
        if key not in PLATES
    }
    if count < len(grid.seconds):
        steps.append(CleaningStep("", "trimmed", len(grid.seconds) - count))
    for name, face in zip(faces, filled, strict=True):
        steps += _filling_steps(name, face, part)
    std = np.stack([face.std[part] for face in filled], axis=1)
    seconds = grid.seconds[part]
    return dict(
        time=seconds - seconds[0] if grid.as_read else grid.step * np.arange(count),
        stamps=grid.stamps[part],
        zone=rows.times.zone,
        timezone=file_format.timezone,
        faces=np.stack([face.values[part] for face in filled], axis=1),
        sensors=np.array([read[name][part] for name in sensors]).reshape(len(sensors), count).T,
        regressors={key: (read[name] if key in PLATES else others[key])[part] for key, name in regressors.items()},
        fill_std=std if std.any() else None,
        cleaning=CleaningLog(
            _format_in_words(table, file_format),
            tuple(steps),
            _breaks(grid, faces, filled, part, rows.times.zone),
            faces,
            dict(regressors),
            _masked_times(table, steps, float(seconds[0])),
            _spikes(table, steps, float(seconds[0])),
        ),
    )


def _masked_times(table: TimedTable, steps: Sequence[CleaningStep], origin: float) -> dict[str, np.ndarray]:
    """For each column the times of its masked values, s since `origin`, sorted."""
    lines: dict[str, list[np.ndarray]] = {}
    for step in steps:
        if step.masked_lines is not None:
            lines.setdefault(step.column, []).append(step.masked_lines)
    return {
        column: np.sort(table.times.seconds[np.searchsorted(table.location.lines, np.concatenate(masked))]) - origin
        for column, masked in lines.items()
    }


def _spikes(table: TimedTable, steps: Sequence[CleaningStep], origin: float) -> dict[str, np.ndarray]:
    """For each column with spikes their times, s since `origin`, and values."""
    spikes = {}
    for step in steps:
        if step.kind == "spike" and step.masked_lines is not None and step.masked_values is not None:
            times = table.times.seconds[np.searchsorted(table.location.lines, step.masked_lines)] - origin
            spikes[step.column] = np.column_stack([times, step.masked_values])
    return spikes


def _rows_with_both_faces(grid: UniformGrid, readings: Sequence[ColumnReadings], faces: Sequence[FilledFace]) -> slice:
    """The rows from the first to the last in which both faces are known."""
    begin = max(face.seconds[0] for face in readings)
    end = min(face.seconds[-1] for face in readings)
    known = (grid.seconds >= begin) & (grid.seconds <= end) & ~faces[0].broken & ~faces[1].broken
    rows = np.flatnonzero(known)
    return slice(int(rows[0]), int(rows[-1]) + 1) if len(rows) else slice(0, 0)


def _readings_on_grid(
    grid: UniformGrid, rows: SortedRows, name: str, readings: ColumnReadings, longest_gap: float
) -> tuple[np.ndarray, list[CleaningStep]]:
    """A sensor's or a plate's values: each reading is interpolated to the time of its row, all other rows are NaN."""
    values, steps = np.full(len(grid.seconds), np.nan), []
    if grid.as_read:
        values[readings.rows] = readings.values
        return values, steps
    inside = (readings.rows >= 0) & (readings.rows < len(grid.seconds))
    row_seconds = grid.seconds[readings.rows[inside]]
    at_reading, spacing = readings.spacing_around(row_seconds)
    near = at_reading | (spacing <= max(longest_gap, GAP_FACTOR * grid.step) * (1 + 1e-9))
    values[readings.rows[inside][near]] = readings.interpolate(row_seconds[near])
    moved = near & ~at_reading
    if moved.any():
        farthest = float(np.abs(readings.seconds[inside] - row_seconds)[moved].max())
        steps.append(CleaningStep(name, "carried", int(moved.sum()), None, f"{farthest:.4g} s"))
    if not near.all():
        closest = np.searchsorted(rows.times.seconds, readings.seconds[inside][~near])
        lines = rows.location.lines[np.clip(closest, 0, len(rows.times.seconds) - 1)]
        steps.append(CleaningStep(name, "stranded", int((~near).sum()), int(lines[0]), masked_lines=np.unique(lines)))
    return values, steps


def _regressor_on_grid(grid: UniformGrid, readings: ColumnReadings, longest_gap: float) -> np.ndarray:
    """A regressor interpolated in every row with close readings before and after it; NaN elsewhere."""
    values = np.full(len(grid.seconds), np.nan)
    if grid.as_read:
        values[readings.rows] = readings.values
    elif len(readings.seconds):
        _, spacing = readings.spacing_around(grid.seconds)
        near = spacing <= max(longest_gap, GAP_FACTOR * readings.typical_step(grid.step))
        values[near] = readings.interpolate(grid.seconds[near])
    return values


def _assignment_steps(name: str, readings: ColumnReadings) -> list[CleaningStep]:
    steps = [CleaningStep(name, "binned", readings.binned)] if readings.binned else []
    if readings.snapped:
        steps.append(CleaningStep(name, "snapped", readings.snapped, None, f"{readings.farthest:.3g} s"))
    return steps


def _filling_steps(name: str, face: FilledFace, part: slice) -> list[CleaningStep]:
    steps, filled = [], face.filled[part]
    if filled.any():
        gaps = int(np.sum(np.diff(np.concatenate([[0], filled.astype(int)])) > 0))
        text = f"{gaps} gap{'s' if gaps > 1 else ''} of up to {face.longest_gap / 3600:.3g} h"
        steps.append(CleaningStep(name, "filled", int(filled.sum()), None, text))
    if face.between[part].any():
        steps.append(CleaningStep(name, "between", int(face.between[part].sum())))
    return steps


def _breaks(
    grid: UniformGrid, names: Sequence[str], faces: Sequence[FilledFace], part: slice, zone: str | None
) -> tuple[RecordBreak, ...]:
    """The gaps that are too long for interpolation."""
    broken = np.stack([face.broken[part] for face in faces], axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], broken.any(axis=1).astype(int), [0]])))
    stamps: Any = grid.stamps[part]
    breaks = []
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        columns = tuple(name for side, name in enumerate(names) if broken[start:stop, side].any())
        before, after = (format_time(stamps[row], zone) for row in (start - 1, stop))
        hours = (stop - start + 1) * grid.step / 3600
        breaks.append(RecordBreak(int(start), int(stop - start), before, after, float(hours), columns))
    return tuple(breaks)
