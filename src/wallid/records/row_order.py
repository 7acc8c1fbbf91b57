"""Rows sorted by time, with one row for each time; an error where the clock was set back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .cleaning_log import CleaningStep
from .daylight_saving import check_daylight_saving
from .file_position import FilePosition
from .row_times import RowTimes

_NEAR = 0.5  # of the typical step: a row closer to its neighbours than this is not merely late


@dataclass(frozen=True, eq=False)
class SortedRows:
    """Rows with strictly increasing times.

    Args:
        location: of the rows in the file.
        times: of the rows.
        values: each column, NaN where missing, (time,).
    """

    location: FilePosition
    times: RowTimes
    values: dict[str, np.ndarray]


def sort_rows(
    location: FilePosition, time: str, times: RowTimes, values: Mapping[str, np.ndarray]
) -> tuple[SortedRows, list[CleaningStep]]:
    """Sort rows by time and merge rows of the same time.

    Args:
        location: of the rows in the file.
        time: the column of times, for messages.
        times: of the rows, in the file's order.
        values: each column, NaN where missing, (time,).

    Returns:
        The sorted rows, and the cleaning steps.

    Raises:
        InputError: the clock was set back, or probably changed for daylight saving.
    """
    cleaning_steps = []
    steps = np.diff(times.seconds)
    if np.sum(steps < 0) > np.sum(steps > 0):  # the newest row first
        cleaning_steps.append(CleaningStep("", "sorted", len(times.seconds), int(location.lines[0])))
        location, times = FilePosition(location.file, location.lines[::-1]), times[::-1]
        values = {name: column[::-1] for name, column in values.items()}
        steps = np.diff(times.seconds)
    if (steps > 0).any():
        same = np.all([_same(column) for column in values.values()], axis=0) if values else np.zeros(len(steps), bool)
        check_daylight_saving(location, time, times, same, float(np.median(steps[steps > 0])))
    lines = location.lines
    if (steps < 0).any():
        order = np.argsort(times.seconds, kind="stable")
        late = times.seconds < np.maximum.accumulate(times.seconds)
        for column in values.values():
            _check_late_rows(location, time, times, column, order, late)
        cleaning_steps.append(CleaningStep("", "sorted", int(late.sum()), int(lines[late.argmax()])))
        times, lines = times[order], lines[order]
        values = {name: column[order] for name, column in values.items()}
    first = np.concatenate([[True], np.diff(times.seconds) > 0])
    if not first.all():
        values, merging_steps = _merge_equal_times(lines, first, values)
        cleaning_steps += merging_steps
        times, lines = times[first], lines[first]
    return SortedRows(FilePosition(location.file, lines), times, dict(values)), cleaning_steps


def _same(values: np.ndarray) -> np.ndarray:
    """Whether each value equals the one before it, or either is missing."""
    return (values[1:] == values[:-1]) | np.isnan(values[1:]) | np.isnan(values[:-1])


def _check_late_rows(
    location: FilePosition, time: str, times: RowTimes, values: np.ndarray, order: np.ndarray, late: np.ndarray
) -> None:
    """Raise an error where late rows have times between, or equal to, those of earlier rows: the clock was set back."""
    rows = order[np.isfinite(values[order])]
    if len(rows) < 2 or not late[rows].any():
        return
    steps = np.diff(times.seconds[rows])
    if not (steps > 0).any():
        return
    typical = float(np.median(steps[steps > 0]))
    contradicts = (steps == 0) & (np.diff(values[rows]) != 0)
    near = (steps > 0) & (steps < _NEAR * typical)
    wrong = (contradicts | near) & (late[rows[1:]] | late[rows[:-1]])
    if not wrong.any():
        return
    pair = rows[int(wrong.argmax()) :][:2]
    row = int(pair.max() if late[pair.max()] else pair.min())
    timezone = ""
    if times.may_have_daylight_saving:
        timezone = ', or set the time zone of the clock ([record] timezone = "Europe/Berlin")'
    location.raise_at_cell(
        time,
        row,
        f"{times.format(row)} comes after {times.format(max(row - 1, 0))} in the file, and its readings fall between "
        f"those of line {location.lines[int(pair.min())]} and others; times must increase from row to row (the clock "
        f"was set back, perhaps at the end of daylight saving): correct the times before or after{timezone}",
    )


def _merge_equal_times(
    lines: np.ndarray, first: np.ndarray, values: Mapping[str, np.ndarray]
) -> tuple[dict[str, np.ndarray], list[CleaningStep]]:
    """The mean of each column over rows of the same time; `first` marks the first row of each time."""
    starts = np.flatnonzero(first)
    differs = np.zeros(len(starts), bool)
    merged = {}
    for name, column in values.items():
        present = np.isfinite(column)
        count = np.add.reduceat(present.astype(float), starts)
        low = np.minimum.reduceat(np.where(present, column, np.inf), starts)
        high = np.maximum.reduceat(np.where(present, column, -np.inf), starts)
        total = np.add.reduceat(np.where(present, column, 0.0), starts)
        with np.errstate(invalid="ignore"):
            merged[name] = np.where(count == 0, np.nan, np.where(low == high, low, total / np.maximum(count, 1.0)))
        differs |= high > low
    sizes = np.diff(np.append(starts, len(first)))
    steps = []
    for kind, mask in (("repeated", ~differs & (sizes > 1)), ("averaged", differs)):
        if mask.any():
            line = int(lines[starts[mask.argmax()] + 1])
            steps.append(CleaningStep("", kind, int((sizes[mask] - 1).sum()), line))
    return merged, steps
