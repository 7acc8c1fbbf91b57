"""Readings at whatever times on one uniform grid: its step and phase, and what each column has on its rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._internal.errors import InputError
from .file_format import Format
from .file_position import Place
from .stamp import STEP_TOLERANCE, Stamps, show_stamp

MOST_ROWS = 6_000_000
_MOST_PER_ROW = 200  # rows of the grid for each of the file's: past it, one time stands far from the others
_FEW_ROWS = 20_000
_SNAP = 0.01  # of the step: nearer than that to a row, a reading stands on it
_STEADY = 0.5  # resultant of a column's phases, from which on it has one
_NICE = 0.02  # how far the usual step may be from a round one
_ROUND = (1, 2, 3, 4, 5, 6, 10, 12, 15, 20, 30)
_ROUND_STEPS = np.array(
    [k for k in _ROUND] + [60 * k for k in _ROUND] + [3600 * k for k in (1, 2, 3, 4, 6, 8, 12, 24)], float
)
USUAL = 1.5  # usual steps: readings farther apart have a gap between them


@dataclass(frozen=True, eq=False)
class Grid:
    """Uniform rows.

    Args:
        seconds: of the rows, on the stamps' scale, (row,).
        stamps: of the rows, as in the file, (row,).
        step: s.
        as_read: whether the rows are the file's own.
    """

    seconds: np.ndarray
    stamps: np.ndarray
    step: float
    as_read: bool


@dataclass(frozen=True, eq=False)
class Readings:
    """A column's readings, one for a row of the grid at most.

    Args:
        seconds, values: mean time and value of the readings nearest to each row that has any, (reading,).
        rows: these rows, (reading,).
        binned: how many readings were averaged with another.
        snapped: how many were taken to be on their row, though some seconds off; `farthest`: s.
    """

    seconds: np.ndarray
    values: np.ndarray
    rows: np.ndarray
    binned: int = 0
    snapped: int = 0
    farthest: float = 0.0

    def usual(self, step: float) -> float:
        """The column's usual step, no less than the grid's, s."""
        return max(step, float(np.median(np.diff(self.seconds)))) if len(self.seconds) > 1 else step

    def around(self, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """For each moment, whether a reading stands there, and how far apart the readings around it are, s."""
        k = np.searchsorted(self.seconds, at)
        there = self.seconds[np.minimum(k, len(self.seconds) - 1)] == at
        inside = (k > 0) & (k < len(self.seconds))
        apart = np.full(len(at), np.inf)
        apart[inside] = self.seconds[k[inside]] - self.seconds[k[inside] - 1]
        return there, np.where(there, 0.0, apart)

    def at(self, seconds: np.ndarray) -> np.ndarray:
        """The straight lines between the readings, at some moments."""
        return np.interp(seconds, self.seconds, self.values)


def make_grid(place: Place, column: str, stamps: Stamps, faces: Sequence[np.ndarray], form: Format) -> Grid:
    """The rows that the readings go onto: the file's own where they are uniform.

    Args:
        column: of the times, for messages.
        faces: values of both, NaN where missing; their usual step becomes the grid's.

    Raises:
        InputError: a grid of far more rows than the file has.
    """
    seconds = stamps.seconds
    steps = np.diff(seconds)
    usual = float(np.median(steps))
    own = min(_usual_step(seconds[np.isfinite(face)], usual) for face in faces)
    wanted = own if form.step is None else form.step
    uniform = bool(np.all(np.abs(steps - usual) <= STEP_TOLERANCE * usual))
    if uniform and abs(wanted - usual) <= STEP_TOLERANCE * usual:
        return Grid(seconds, stamps.stamps, float(np.median(np.diff(seconds - seconds[0]))), True)
    step = wanted if form.step is not None else _round(wanted)
    read = np.isfinite(faces[0]) | np.isfinite(faces[1])
    begin = max(float(seconds[np.isfinite(face)][0]) for face in faces)
    end = min(float(seconds[np.isfinite(face)][-1]) for face in faces)
    phase = _phase(seconds[read], step)
    first, last = (int(np.ceil((begin - phase) / step - _SNAP)), int(np.floor((end - phase) / step + _SNAP)))
    rows = last - first + 1
    if rows > min(MOST_ROWS, max(_FEW_ROWS, _MOST_PER_ROW * len(seconds))):
        _refuse_size(place, column, stamps, steps, rows, step)
    if rows < 2:
        raise InputError(
            f"{place.file}: the faces have readings together over {max(rows, 0)} rows of {step:g} s only; both must be "
            "logged at the same time"
        )
    at = phase + step * first + step * np.arange(rows)  # as `on_grid` has them, to the last bit
    if np.issubdtype(stamps.stamps.dtype, np.datetime64):
        moments = stamps.stamps[0] + np.rint((at - seconds[0]) * 1e9).astype("timedelta64[ns]")
    else:
        moments = stamps.stamps[0] + (at - seconds[0])
    return Grid(at, moments, step, False)


def on_grid(grid: Grid, seconds: np.ndarray, values: np.ndarray) -> Readings:
    """A column's readings, gathered at the nearest rows of a grid; those beyond its ends remain as neighbours.

    Args:
        seconds, values: of the column, NaN where missing, (time,).
    """
    there = np.isfinite(values)
    if grid.as_read:
        return Readings(seconds[there], values[there], np.flatnonzero(there))
    seconds, values = seconds[there], values[there]
    places = (seconds - grid.seconds[0]) / grid.step
    nearest = np.floor(places - _shift(places) + 0.5).astype(int)
    starts = np.flatnonzero(np.concatenate([[True], np.diff(nearest) > 0]))
    count = np.diff(np.append(starts, len(nearest)))
    rows = nearest[starts]
    at = grid.seconds[0] + grid.step * rows
    mean = np.where(count == 1, seconds[starts], np.add.reduceat(seconds, starts) / count)
    value = np.where(count == 1, values[starts], np.add.reduceat(values, starts) / count)
    off = np.abs(mean - at)
    snap = off <= _SNAP * grid.step
    moved = snap & (off > STEP_TOLERANCE * grid.step)
    return Readings(
        np.where(snap, at, mean),
        value,
        rows,
        int(count[count > 1].sum()),
        int(moved.sum()),
        float(off[snap].max(initial=0.0)),
    )


def _shift(places: np.ndarray) -> float:
    """How far a column is logged off the rows as a rule, in rows: halfway between two, jitter must not decide."""
    mean = np.mean(np.exp(2j * np.pi * places)) if len(places) else 0.0
    return float(np.angle(mean) / (2 * np.pi)) if np.abs(mean) > _STEADY else 0.0


def _usual_step(seconds: np.ndarray, usual: float) -> float:
    """The usual step of a column's own readings; of the rows where it has hardly any, s."""
    return float(np.median(np.diff(seconds))) if len(seconds) > 2 else usual


def _round(step: float) -> float:
    """The round step within 2 %, or else the step itself to the millisecond, s."""
    nearest = float(_ROUND_STEPS[np.argmin(np.abs(np.log(_ROUND_STEPS / step)))])
    return nearest if abs(step / nearest - 1.0) <= _NICE else max(round(step, 3), 1e-3)


def _phase(seconds: np.ndarray, step: float) -> float:
    """Where in the step most rows lie, s: what a third of them share exactly, or their circular mean."""
    remainder = np.mod(seconds, step)
    shared, count = np.unique(np.round(remainder, 3), return_counts=True)
    if count.max() > len(seconds) / 3:
        return float(shared[count.argmax()])
    mean = np.angle(np.mean(np.exp(2j * np.pi * remainder / step))) * step / (2 * np.pi)
    return float(np.round(mean) if step >= 60.0 else mean)


def _refuse_size(place: Place, column: str, stamps: Stamps, steps: np.ndarray, rows: int, step: float) -> None:
    """Name the longest gap of a record whose grid would be mostly empty."""
    row = int(steps.argmax()) + 1
    before, after = (show_stamp(stamps.stamps[k], stamps.zone) for k in (row - 1, row))
    place.refuse(
        column,
        row,
        f"found {after} after {before}, and rows of {step:g} s from the first time to the last would be {rows}, for "
        f"{len(stamps.seconds)} in the file; is this time wrong? Correct or delete it, or state a longer "
        "[record] step (s)",
    )
