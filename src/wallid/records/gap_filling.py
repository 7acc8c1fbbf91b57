"""Gaps in a face: short ones interpolated with their uncertainty, long ones where the record breaks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .uniform_grid import USUAL, Grid, Readings

_FEWEST_TRIALS = 20
_MOST_TRIALS = 2000
_EDGE = 1e-6  # of a step: round-off in times


@dataclass(frozen=True, eq=False)
class Face:
    """A face on the grid.

    Args:
        values: degC in every row: read, interpolated, or in a broken row a placeholder, (row,).
        between: rows between readings at the face's own usual step, which is longer than the grid's, (row,).
        filled: rows in a gap that is short enough, (row,).
        broken: rows in a longer gap, (row,).
        std: of the interpolation's error, K; 0 in rows that are read and infinite in broken ones, (row,).
        longest: the longest gap that was filled, s.
    """

    values: np.ndarray
    between: np.ndarray
    filled: np.ndarray
    broken: np.ndarray
    std: np.ndarray
    longest: float


def fill_face(grid: Grid, readings: Readings, longest_gap: float) -> Face:
    """A face's values in every row, between the first and the last reading.

    Args:
        longest_gap: that is interpolated, s.
    """
    at = grid.seconds
    there, apart = readings.around(at)
    edge = _EDGE * grid.step
    # a row hardly off the file's own is one of the face's readings
    usual = readings.usual(grid.step)
    gap = ~there & (apart > USUAL * usual)
    broken = gap & (apart > longest_gap + edge)
    filled = gap & ~broken
    has_reading = np.zeros(len(at), bool)
    rows = readings.rows[(readings.rows >= 0) & (readings.rows < len(at))]
    has_reading[rows] = True
    between = ~there & ~gap & ~has_reading & (usual > USUAL * grid.step)
    std = np.zeros(len(at))
    std[broken] = np.inf
    if filled.any() or between.any():
        std += _fill_std(grid, readings, filled, between, usual)
    longest = float(apart[filled].max(initial=0.0))
    return Face(readings.at(at), between, filled, broken, std, longest)


def _fill_std(grid: Grid, readings: Readings, filled: np.ndarray, between: np.ndarray, usual: float) -> np.ndarray:
    """The interpolation's standard error in each row, by gaps made as trials elsewhere in this record, K."""
    std = np.zeros(len(grid.seconds))
    k = np.clip(np.searchsorted(readings.seconds, grid.seconds), 1, len(readings.seconds) - 1)
    start, end = readings.seconds[k - 1], readings.seconds[k]
    apart = np.where(filled | between, end - start, 0.0)
    lengths = np.unique(np.round(apart[apart > 0] / usual).astype(int))
    for steps in lengths:
        rows = (np.round(apart / usual).astype(int) == steps) & (apart > 0)
        share = (grid.seconds[rows] - start[rows]) / (end[rows] - start[rows])
        if steps < 2:  # no finer readings to try it on: a second difference falls to a quarter at half the spacing
            std[rows] = np.interp(share, (0.0, 0.5, 1.0), (0.0, 0.25, 0.0)) * _trial(readings, 2, usual)[1]
            continue
        nodes = np.linspace(0.0, 1.0, steps + 1)
        std[rows] = np.interp(share, nodes, _trial(readings, int(steps), usual))
    return std


def _trial(readings: Readings, steps: int, usual: float) -> np.ndarray:
    """Root mean square error of a straight line over so many steps, at each of its readings, K, (steps + 1,).

    The hidden readings' own noise is in it. Where the record has too few whole stretches, the walk that its
    changes from reading to reading would make: `s^2 j (n - j) / n`.
    """
    seconds, values = readings.seconds, readings.values
    j = np.arange(steps + 1)
    starts = np.arange(len(values) - steps)
    whole = np.abs(seconds[starts + steps] - seconds[starts] - steps * usual) <= 0.5 * usual if len(starts) else starts
    starts = starts[whole]
    if len(starts) < _FEWEST_TRIALS:
        change = float(np.sqrt(np.mean(np.diff(values) ** 2))) if len(values) > 1 else 0.0
        return change * np.sqrt(j * (steps - j) / steps)
    starts = starts[:: max(1, len(starts) // _MOST_TRIALS)]
    stretch = values[starts[:, None] + j]
    line = stretch[:, :1] + (stretch[:, -1:] - stretch[:, :1]) * j / steps
    return np.sqrt(np.mean((stretch - line) ** 2, axis=0))
