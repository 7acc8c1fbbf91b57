"""Rows in the order of their times, each time once: what is harmless is mended, the rest refused."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .cleaning_log import Noted, Notes
from .daylight_saving import check_daylight
from .file_position import Place
from .stamp import Stamps

_NEAR = 0.5  # of the usual step: a row that comes nearer to its neighbours than that was not just late


def in_order(
    place: Place, column: str, stamps: Stamps, values: Mapping[str, np.ndarray], notes: Notes
) -> tuple[Place, Stamps, dict[str, np.ndarray]]:
    """Rows whose times increase, from rows in the file's order.

    Args:
        column: of the times, for messages.
        values: each column, NaN where missing, (time,).

    Raises:
        InputError: a clock that went back, or jumped as for daylight saving.
    """
    rows = np.arange(len(stamps.seconds))
    steps = np.diff(stamps.seconds)
    if np.sum(steps < 0) > np.sum(steps > 0):  # the newest first
        rows = rows[::-1]
        notes.note(Noted("", "sorted", len(rows), int(place.lines[0])))
    now = stamps[rows]
    lines = place.lines[rows]
    values = {name: column_values[rows] for name, column_values in values.items()}
    there = Place(place.file, lines)
    steps = np.diff(now.seconds)
    if (steps > 0).any():
        same = np.all([_same(one) for one in values.values()], axis=0) if values else np.zeros(len(steps), bool)
        check_daylight(there, column, now, same, float(np.median(steps[steps > 0])))
    if (steps < 0).any():
        order = np.argsort(now.seconds, kind="stable")
        late = now.seconds < np.maximum.accumulate(now.seconds)
        for one in values.values():
            _check_late(there, column, now, one, order, late)
        notes.note(Noted("", "sorted", int(late.sum()), int(lines[late.argmax()])))
        now, lines = now[order], lines[order]
        values = {name: one[order] for name, one in values.items()}
    first = np.concatenate([[True], np.diff(now.seconds) > 0])
    if not first.all():
        values = _merge(lines, first, values, notes)
        now, lines = now[first], lines[first]
    return Place(place.file, lines), now, dict(values)


def _same(values: np.ndarray) -> np.ndarray:
    """Whether each value is the one before it, or either is missing."""
    return (values[1:] == values[:-1]) | np.isnan(values[1:]) | np.isnan(values[:-1])


def _check_late(
    place: Place, column: str, stamps: Stamps, values: np.ndarray, order: np.ndarray, late: np.ndarray
) -> None:
    """Refuse rows that fall between or onto rows read before them: their clock was set back."""
    rows = order[np.isfinite(values[order])]
    if len(rows) < 2 or not late[rows].any():
        return
    steps = np.diff(stamps.seconds[rows])
    if not (steps > 0).any():
        return
    usual = float(np.median(steps[steps > 0]))
    onto = (steps == 0) & (np.diff(values[rows]) != 0)
    near = (steps > 0) & (steps < _NEAR * usual)
    wrong = (onto | near) & (late[rows[1:]] | late[rows[:-1]])
    if not wrong.any():
        return
    pair = rows[int(wrong.argmax()) :][:2]
    row = int(pair.max() if late[pair.max()] else pair.min())
    clock = ', or state whose clock it is ([record] timezone = "Europe/Berlin")' if stamps.may_jump else ""
    place.refuse(
        column,
        row,
        f"{stamps.show(row)} comes after {stamps.show(max(row - 1, 0))} in the file, and its readings fall among "
        f"those of line {place.lines[int(pair.min())]} and others; times must increase from row to row (the clock was "
        f"set back, or the end of daylight saving): correct the times of one part{clock}",
    )


def _merge(
    lines: np.ndarray, first: np.ndarray, values: Mapping[str, np.ndarray], notes: Notes
) -> dict[str, np.ndarray]:
    """One row for each time: the mean of those that stand there."""
    starts = np.flatnonzero(first)
    differ = np.zeros(len(starts), bool)
    merged = {}
    for name, one in values.items():
        there = np.isfinite(one)
        count = np.add.reduceat(there.astype(float), starts)
        low = np.minimum.reduceat(np.where(there, one, np.inf), starts)
        high = np.maximum.reduceat(np.where(there, one, -np.inf), starts)
        total = np.add.reduceat(np.where(there, one, 0.0), starts)
        with np.errstate(invalid="ignore"):
            merged[name] = np.where(count == 0, np.nan, np.where(low == high, low, total / np.maximum(count, 1.0)))
        differ |= high > low
    sizes = np.diff(np.append(starts, len(first)))
    for kind, which in (("repeated", ~differ & (sizes > 1)), ("averaged", differ)):
        if which.any():
            line = int(lines[starts[which.argmax()] + 1])
            notes.note(Noted("", kind, int((sizes[which] - 1).sum()), line))
    return merged
