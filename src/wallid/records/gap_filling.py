"""Gaps in face temperatures: short gaps are interpolated with a standard error, long gaps break the record."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .uniform_grid import GAP_FACTOR, ColumnReadings, UniformGrid

_MIN_TRIALS = 20
_MAX_TRIALS = 2000
_ROUND_OFF = 1e-6  # of a step, in times


@dataclass(frozen=True, eq=False)
class FilledFace:
    """A face temperature in every row of the grid.

    Args:
        values: degC: read, interpolated, or in a broken row a placeholder, (row,).
        between: rows between two readings at the face's own typical step, which is longer than the grid's, (row,).
        filled: rows in a gap that is short enough for interpolation, (row,).
        broken: rows in a longer gap, (row,).
        std: standard error of the interpolation, K; 0 in rows with a reading and infinite in broken rows, (row,).
        longest_gap: the longest gap that was filled, s.
    """

    values: np.ndarray
    between: np.ndarray
    filled: np.ndarray
    broken: np.ndarray
    std: np.ndarray
    longest_gap: float


def interpolate_face(grid: UniformGrid, readings: ColumnReadings, longest_gap: float) -> FilledFace:
    """Interpolate a face linearly in every row between its first and last reading.

    Args:
        grid: rows.
        readings: of the face.
        longest_gap: the longest gap that is filled, s.
    """
    at_reading, spacing = readings.spacing_around(grid.seconds)
    # a row that is close to a row of the file has a reading, although it may not be exactly at its time
    typical_step = readings.typical_step(grid.step)
    gap = ~at_reading & (spacing > GAP_FACTOR * typical_step)
    broken = gap & (spacing > longest_gap + _ROUND_OFF * grid.step)
    filled = gap & ~broken
    has_reading = np.zeros(len(grid.seconds), bool)
    has_reading[readings.rows[(readings.rows >= 0) & (readings.rows < len(grid.seconds))]] = True
    between = ~at_reading & ~gap & ~has_reading & (typical_step > GAP_FACTOR * grid.step)
    std = np.where(broken, np.inf, 0.0)
    if filled.any() or between.any():
        std += _interpolation_std(grid, readings, filled | between, typical_step)
    longest_filled = float(spacing[filled].max(initial=0.0))
    return FilledFace(readings.interpolate(grid.seconds), between, filled, broken, std, longest_filled)


def _interpolation_std(
    grid: UniformGrid, readings: ColumnReadings, interpolated: np.ndarray, typical_step: float
) -> np.ndarray:
    """The standard error of linear interpolation in each row, from artificial gaps elsewhere in this record, K."""
    std = np.zeros(len(grid.seconds))
    k = np.clip(np.searchsorted(readings.seconds, grid.seconds), 1, len(readings.seconds) - 1)
    start, end = readings.seconds[k - 1], readings.seconds[k]
    spacing = np.where(interpolated, end - start, 0.0)
    gap_steps = np.round(spacing / typical_step).astype(int)
    for steps in np.unique(gap_steps[spacing > 0]):
        rows = (gap_steps == steps) & (spacing > 0)
        fraction = (grid.seconds[rows] - start[rows]) / (end[rows] - start[rows])
        if steps < 2:
            # no finer readings for a trial: the error at mid-interval is a quarter of that over two steps
            error = _trial_error(readings, 2, typical_step)[1]
            std[rows] = np.interp(fraction, (0.0, 0.5, 1.0), (0.0, 0.25, 0.0)) * error
        else:
            points = np.linspace(0.0, 1.0, steps + 1)
            std[rows] = np.interp(fraction, points, _trial_error(readings, int(steps), typical_step))
    return std


def _trial_error(readings: ColumnReadings, steps: int, typical_step: float) -> np.ndarray:
    """Root mean square error of linear interpolation over `steps` steps, at each reading, K, (steps + 1,).

    The noise of the hidden readings is included. Where the record has too few intervals without a gap, the error is
    that of a random walk with the record's changes from reading to reading: `s^2 j (n - j) / n`.
    """
    seconds, values = readings.seconds, readings.values
    j = np.arange(steps + 1)
    starts = np.arange(len(values) - steps)
    if len(starts):
        duration = seconds[starts + steps] - seconds[starts]
        starts = starts[np.abs(duration - steps * typical_step) <= 0.5 * typical_step]
    if len(starts) < _MIN_TRIALS:
        change = float(np.sqrt(np.mean(np.diff(values) ** 2))) if len(values) > 1 else 0.0
        return change * np.sqrt(j * (steps - j) / steps)
    starts = starts[:: max(1, len(starts) // _MAX_TRIALS)]
    trial = values[starts[:, None] + j]
    line = trial[:, :1] + (trial[:, -1:] - trial[:, :1]) * j / steps
    return np.sqrt(np.mean((trial - line) ** 2, axis=0))
