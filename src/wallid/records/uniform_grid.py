"""A uniform time grid for readings at arbitrary times, and the assignment of readings to its rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._internal.errors import InputError
from .file_format import FileFormat
from .file_position import FilePosition
from .row_times import STEP_TOLERANCE, RowTimes

_MAX_ROWS = 6_000_000
_MAX_GRID_ROWS_PER_ROW = 200  # more grid rows for each row of the file: a time is far from the others
_FEW_ROWS = 20_000
_ON_ROW = 0.01  # of the step: a reading closer to a row is taken to be on it
_STEADY = 0.5  # mean resultant length of a column's phases, above which the column has one phase
_ROUNDING = 0.02  # the largest relative difference from a round step
_ROUND = (1, 2, 3, 4, 5, 6, 10, 12, 15, 20, 30)
_ROUND_STEPS = np.array(
    [k for k in _ROUND] + [60 * k for k in _ROUND] + [3600 * k for k in (1, 2, 3, 4, 6, 8, 12, 24)], float
)
GAP_FACTOR = 1.5  # typical steps: two readings farther apart have a gap between them


@dataclass(frozen=True, eq=False)
class UniformGrid:
    """Rows at uniform times.

    Args:
        seconds: of the rows, with the origin of `RowTimes.seconds`, (row,).
        stamps: of the rows, in the file's format, (row,).
        step: s.
        as_read: whether the rows are those of the file.
    """

    seconds: np.ndarray
    stamps: np.ndarray
    step: float
    as_read: bool


@dataclass(frozen=True, eq=False)
class ColumnReadings:
    """The readings of a column, at most one for each row of the grid.

    Args:
        seconds: mean time of the readings closest to a row, (reading,).
        values: their mean value, (reading,).
        rows: index of this row, (reading,); outside the grid for readings before and after it.
        binned: number of readings that were averaged with another.
        snapped: number of readings taken to be on their row although they are some seconds away.
        farthest: the largest distance of a reading taken to be on its row, s.
    """

    seconds: np.ndarray
    values: np.ndarray
    rows: np.ndarray
    binned: int = 0
    snapped: int = 0
    farthest: float = 0.0

    def typical_step(self, grid_step: float) -> float:
        """The median step between the column's readings, at least the grid's, s."""
        return max(grid_step, float(np.median(np.diff(self.seconds)))) if len(self.seconds) > 1 else grid_step

    def spacing_around(self, seconds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """For each time, whether it is that of a reading, and the spacing of the two readings around it, s.

        The spacing is 0 at a reading, and infinite before the first and after the last.
        """
        k = np.searchsorted(self.seconds, seconds)
        at_reading = self.seconds[np.minimum(k, len(self.seconds) - 1)] == seconds
        inside = (k > 0) & (k < len(self.seconds))
        spacing = np.full(len(seconds), np.inf)
        spacing[inside] = self.seconds[k[inside]] - self.seconds[k[inside] - 1]
        return at_reading, np.where(at_reading, 0.0, spacing)

    def interpolate(self, seconds: np.ndarray) -> np.ndarray:
        """Linear interpolation between the readings."""
        return np.interp(seconds, self.seconds, self.values)


def choose_grid(
    location: FilePosition, time: str, times: RowTimes, faces: Sequence[np.ndarray], file_format: FileFormat
) -> UniformGrid:
    """Choose the rows of a record: those of the file where they are uniform.

    Args:
        location: of the rows in the file.
        time: the column of times, for messages.
        times: of the rows.
        faces: both face temperatures, NaN where missing, (time,); their typical step is that of the grid.
        file_format: its `step`, where set, is that of the grid.

    Raises:
        InputError: the grid would have far more rows than the file, or the faces have no common time.
    """
    seconds = times.seconds
    steps = np.diff(seconds)
    typical = float(np.median(steps))
    face_step = min(_typical_step(seconds[np.isfinite(face)], typical) for face in faces)
    wanted = face_step if file_format.step is None else file_format.step
    uniform = bool(np.all(np.abs(steps - typical) <= STEP_TOLERANCE * typical))
    if uniform and abs(wanted - typical) <= STEP_TOLERANCE * typical:
        return UniformGrid(seconds, times.stamps, float(np.median(np.diff(seconds - seconds[0]))), True)
    step = wanted if file_format.step is not None else _round_step(wanted)
    has_face = np.isfinite(faces[0]) | np.isfinite(faces[1])
    begin = max(float(seconds[np.isfinite(face)][0]) for face in faces)
    end = min(float(seconds[np.isfinite(face)][-1]) for face in faces)
    phase = _phase(seconds[has_face], step)
    first, last = (int(np.ceil((begin - phase) / step - _ON_ROW)), int(np.floor((end - phase) / step + _ON_ROW)))
    rows = last - first + 1
    if rows > min(_MAX_ROWS, max(_FEW_ROWS, _MAX_GRID_ROWS_PER_ROW * len(seconds))):
        row = int(steps.argmax()) + 1
        location.raise_at_cell(
            time,
            row,
            f"found {times.format(row)} after {times.format(row - 1)}; a grid of {step:g} s from the first time to the "
            f"last would have {rows} rows, but the file has {len(seconds)}; check this time and correct or delete it, "
            "or set a longer [record] step (s)",
        )
    if rows < 2:
        raise InputError(
            f"{location.file}: both faces have readings in only {max(rows, 0)} rows of {step:g} s; they must be logged "
            "at the same time"
        )
    row_seconds = phase + step * first + step * np.arange(rows)  # same rounding as in `assign_to_rows`
    if np.issubdtype(times.stamps.dtype, np.datetime64):
        stamps = times.stamps[0] + np.rint((row_seconds - seconds[0]) * 1e9).astype("timedelta64[ns]")
    else:
        stamps = times.stamps[0] + (row_seconds - seconds[0])
    return UniformGrid(row_seconds, stamps, step, False)


def assign_to_rows(grid: UniformGrid, seconds: np.ndarray, values: np.ndarray) -> ColumnReadings:
    """Assign a column's readings to their closest rows, and average those of the same row.

    Args:
        grid: rows.
        seconds: times of the column, (time,).
        values: of the column, NaN where missing, (time,).
    """
    present = np.isfinite(values)
    if grid.as_read:
        return ColumnReadings(seconds[present], values[present], np.flatnonzero(present))
    seconds, values = seconds[present], values[present]
    in_rows = (seconds - grid.seconds[0]) / grid.step
    closest = np.floor(in_rows - _mean_offset(in_rows) + 0.5).astype(int)
    starts = np.flatnonzero(np.concatenate([[True], np.diff(closest) > 0]))
    count = np.diff(np.append(starts, len(closest)))
    rows = closest[starts]
    row_seconds = grid.seconds[0] + grid.step * rows
    mean_time = np.where(count == 1, seconds[starts], np.add.reduceat(seconds, starts) / count)
    mean_value = np.where(count == 1, values[starts], np.add.reduceat(values, starts) / count)
    distance = np.abs(mean_time - row_seconds)
    on_row = distance <= _ON_ROW * grid.step
    return ColumnReadings(
        np.where(on_row, row_seconds, mean_time),
        mean_value,
        rows,
        binned=int(count[count > 1].sum()),
        snapped=int((on_row & (distance > STEP_TOLERANCE * grid.step)).sum()),
        farthest=float(distance[on_row].max(initial=0.0)),
    )


def _mean_offset(in_rows: np.ndarray) -> float:
    """A column's constant offset from the rows, in rows; 0 where it has none.

    Without it, jitter would decide the row of readings halfway between two rows.
    """
    mean = np.mean(np.exp(2j * np.pi * in_rows)) if len(in_rows) else 0.0
    return float(np.angle(mean) / (2 * np.pi)) if np.abs(mean) > _STEADY else 0.0


def _typical_step(seconds: np.ndarray, default: float) -> float:
    """The median step of a column's readings, s; the default where it has fewer than three."""
    return float(np.median(np.diff(seconds))) if len(seconds) > 2 else default


def _round_step(step: float) -> float:
    """The round step within 2 %, or else the step rounded to 1 ms, s."""
    nearest = float(_ROUND_STEPS[np.argmin(np.abs(np.log(_ROUND_STEPS / step)))])
    return nearest if abs(step / nearest - 1.0) <= _ROUNDING else max(round(step, 3), 1e-3)


def _phase(seconds: np.ndarray, step: float) -> float:
    """The offset of the times from multiples of the step, s: that of a third of them if equal, or the circular mean."""
    remainder = np.mod(seconds, step)
    phases, count = np.unique(np.round(remainder, 3), return_counts=True)
    if count.max() > len(seconds) / 3:
        return float(phases[count.argmax()])
    mean = np.angle(np.mean(np.exp(2j * np.pi * remainder / step))) * step / (2 * np.pi)
    return float(np.round(mean) if step >= 60.0 else mean)
