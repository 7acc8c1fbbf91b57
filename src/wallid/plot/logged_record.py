"""Figures of a record: its faces and sensors, and what was done to them while they were read."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from .._internal.units import DAY
from ..case.case_definition import Case
from ..case.time_window import Window
from ..case.wall_and_sensors import SIDES
from .house_style import DAYS, FACES, GREY, ORANGE, YELLOW, colour, line, marks
from .legends import legend_above, legend_below, shortened

BLACK = "#000000"
_POINTS = 3000  # of a curve: more than a figure of this width shows
_BAND_POINTS = 1000  # of an interval about one
_FEW = 8  # sensors, whose places the legend of the record has room for
_NARROWEST = 0.004  # of the record, about a line's width: what is shorter is drawn as wide as this, or by a mark


def thinned(days: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A long curve by the lowest and the highest of each stretch, in their order; a short one as it is."""
    if len(days) <= _POINTS:
        return days, values
    size = -(-2 * len(days) // _POINTS)
    whole = len(days) // size * size
    blocks = np.where(np.isnan(values[:whole]), np.inf, values[:whole]).reshape(-1, size)
    low = blocks.argmin(axis=1)
    high = np.where(np.isinf(blocks), -np.inf, blocks).argmax(axis=1)
    picks = np.sort(np.stack([low, high], axis=1), axis=1) + size * np.arange(len(blocks))[:, None]
    rows = np.concatenate([picks.ravel(), np.arange(whole, len(days))])
    return days[rows], values[rows]


def shade(ax: Axes, days: np.ndarray, middle: np.ndarray, half: np.ndarray, tint: str, alpha: float) -> None:
    """An interval about a course, of a long one every some rows."""
    some = slice(None, None, max(1, len(days) // _BAND_POINTS))
    low, high = (middle - half)[some], (middle + half)[some]
    ax.fill_between(days[some], low, high, color=tint, alpha=alpha, lw=0)


def record(ax: Axes, case: Case, window: Window | None = None) -> None:
    """The faces and sensors over the whole record, what was filled, masked or broken, and the window chosen."""
    logged, days = case.record, case.record.days
    faces = np.where(logged.broken[:, None], np.nan, logged.faces)
    for side, (name, tint) in enumerate(zip(SIDES, FACES, strict=True)):
        place = "outside" if case.wall.outside == name else "inside"
        ax.plot(*thinned(days, faces[:, side]), color=tint, lw=0.8, label=f"{name} face ({place})")
    for s, sensor in enumerate(case.sensors):
        there = np.isfinite(logged.sensors[:, s])
        sparse = there.any() and _joined(there).mean() > 1.5 * there.mean()
        shown = there if sparse else slice(None)  # a missing value breaks the line
        drawn = {**marks(s), "ls": "none", "ms": 3} if sparse else {**line(s), "lw": 1.0}
        place = f" at {100 * sensor.position:.3g} cm" if len(case.sensors) <= _FEW else ""
        label = f"{shortened(sensor.name)}{place}"
        ax.plot(*thinned(days[shown], logged.sensors[shown, s]), **drawn, label=label)
    if window is not None:
        first, last = days[window.row], days[window.row + window.rows - 1]
        ax.axvspan(first, last, color=YELLOW, alpha=0.35, lw=0, label="window used")
    _mark_filled(ax, case, days)
    _mark_breaks(ax, case, days, label="broken")
    ax.set(xlabel=DAYS, ylabel="temperature (°C)", title=f"Record {case.name}")
    legend_above(ax)


def _mark_filled(ax: Axes, case: Case, days: np.ndarray) -> None:
    """The rows in which a face was interpolated, with twice their standard error."""
    if (std := case.record.fill_std) is None:
        return
    label = "interpolated, ± 2 std"
    for side in (0, 1):
        filled = (std[:, side] > 0) & ~case.record.broken
        if filled.any():
            values = case.record.faces[filled, side]
            ax.errorbar(
                days[filled],
                values,
                2 * std[filled, side],
                fmt=".",
                ms=3,
                lw=0.8,
                color=BLACK,
                label=label,
                zorder=3,
            )
            label = None


def _mark_breaks(ax: Axes, case: Case, days: np.ndarray, label: str | None = None) -> None:
    """Grey bands where a face is missing for too long."""
    for one in case.record.cleaning.breaks:
        ax.axvspan(days[one.row - 1], days[one.row + one.rows], color=GREY, alpha=0.2, lw=0, label=label)
        label = None


def coverage(ax: Axes, case: Case) -> None:
    """For each face and sensor when it has readings, when it was interpolated, and which readings are missing."""
    logged, days = case.record, case.record.days
    std = np.zeros((logged.rows, 2)) if logged.fill_std is None else logged.fill_std
    names = ["left face", "right face", *(shortened(name) for name in logged.names)]
    columns = (*logged.cleaning.faces, *logged.names)
    keys: list[Artist] = [Patch(color=GREY, label="readings")]
    shown = set()
    for k, column in enumerate(columns):
        filled = (std[:, k] > 0) & ~logged.broken if k < 2 else np.zeros(logged.rows, bool)
        there = std[:, k] == 0 if k < 2 else _joined(np.isfinite(logged.sensors[:, k - 2]))
        _bars(ax, days, _stretches(there), k, FACES[k] if k < 2 else colour(k - 2))
        _bars(ax, days, _stretches(filled), k, ORANGE, _NARROWEST)
        gaps = _stretches(~there & ~filled & ~logged.broken)
        lost = [0.5 * (days[a] + days[b - 1]) for a, b in gaps if days[b - 1] - days[a] < _NARROWEST * days[-1]]
        lost += list(logged.cleaning.masked.get(column, np.array([])) / DAY)
        ax.plot(lost, np.full(len(lost), k), "|", ms=11, mew=1.2, color=BLACK)
        shown |= {"interpolated"} if filled.any() else set()
        shown |= {"missing"} if lost else set()
    _mark_breaks(ax, case, days)
    if "interpolated" in shown:
        keys.append(Patch(color=ORANGE, label="interpolated"))
    if "missing" in shown:
        keys.append(Line2D([], [], ls="none", marker="|", ms=9, color=BLACK, label="single readings missing or masked"))
    if logged.cleaning.breaks:
        keys.append(Patch(color=GREY, alpha=0.2, label="record broken"))
    ax.set_yticks(range(len(names)), names)
    ax.set(xlabel=DAYS, ylim=(len(names) - 0.5, -0.5), title="When each has readings")
    ax.grid(axis="y", visible=False)
    legend_below(ax, keys)


def _joined(there: np.ndarray) -> np.ndarray:
    """Where a sensor has readings at its own usual spacing."""
    rows = np.flatnonzero(there)
    if len(rows) < 2:
        return there
    spacing = int(np.median(np.diff(rows)))
    near = np.diff(rows) <= 1.5 * spacing
    change = np.zeros(len(there) + 1, int)
    np.add.at(change, rows[:-1][near], 1)
    np.add.at(change, rows[1:][near], -1)
    return (np.cumsum(change)[:-1] > 0) | there


def _stretches(there: np.ndarray) -> list[tuple[int, int]]:
    """Where each run of rows begins, and the row after its end."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], there.astype(int), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _bars(
    ax: Axes, days: np.ndarray, runs: list[tuple[int, int]], place: int, tint: str, narrowest: float = 0.0
) -> None:
    """A bar over each run of rows, no narrower than so much of the record."""
    step, least = float(days[1] - days[0]), narrowest * float(days[-1] - days[0])
    bars = []
    for first, end in runs:
        width = (end - first) * step
        middle = float(days[first]) + 0.5 * (width - step)
        wide = max(width, least)
        bars.append((middle - 0.5 * wide, wide))
    ax.broken_barh(bars, (place - 0.3, 0.6), color=tint, lw=0)
