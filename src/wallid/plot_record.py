"""Figures of a record: its faces and sensors, and what was done to them while they were read."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from ._style import DAYS, GREY, RED, YELLOW, colour
from .case import Case
from .experiment import Window

BLACK = "#000000"
_POINTS = 3000  # of a curve: more than a figure of this width shows


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


def record(ax: Axes, case: Case, window: Window | None = None) -> None:
    """The faces and sensors over the whole record, what was filled, masked or broken, and the window chosen."""
    logged, days = case.record, np.asarray(case.record.time) / 86400.0
    faces = np.where(logged.broken[:, None], np.nan, logged.faces)
    for side, name, tint in ((0, "left", GREY), (1, "right", RED)):
        place = "outside" if case.wall.outside == name else "inside"
        ax.plot(*thinned(days, faces[:, side]), color=tint, lw=0.8, label=f"{name} face ({place})")
    for s, sensor in enumerate(case.sensors):
        there = np.isfinite(logged.sensors[:, s])
        sparse = there.any() and _joined(there).mean() > 1.5 * there.mean()
        shown = there if sparse else slice(None)  # a missing value breaks the line
        ax.plot(
            *thinned(days[shown], logged.sensors[shown, s]),
            ls="none" if sparse else "-",
            marker="." if sparse else None,
            color=colour(s),
            lw=1.0,
            label=f"{sensor.name} at {100 * sensor.position:g} cm",
        )
    if window is not None:
        step = logged.step / 86400.0
        ax.axvspan(window.row * step, (window.row + window.rows - 1) * step, color=YELLOW, alpha=0.35, lw=0)
    _mark_filled(ax, case, days)
    _mark_breaks(ax, case, days, label="broken")
    ax.set(xlabel=DAYS, ylabel="temperature (°C)", title=f"Record {case.name}")
    legend_above(ax, ncols=3)


def legend_above(ax: Axes, *, ncols: int) -> None:
    """A legend over the curves, with room made for its rows."""
    rows = -(-len(ax.get_legend_handles_labels()[0]) // ncols)
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + (0.06 + 0.08 * rows) * (high - low))
    ax.legend(ncols=ncols, loc="upper left")


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
    """For each face and sensor when it has readings, when it was interpolated, and which readings were masked."""
    logged, days = case.record, np.asarray(case.record.time) / 86400.0
    std = np.zeros((logged.rows, 2)) if logged.fill_std is None else logged.fill_std
    step = logged.step / 86400.0
    names = ["left face", "right face", *logged.names]
    for k in range(len(names)):
        if k < 2:
            _stretches(ax, days, step, k, std[:, k] == 0, (GREY, RED)[k])
            _stretches(ax, days, step, k, (std[:, k] > 0) & np.isfinite(std[:, k]), YELLOW)
        else:
            _stretches(ax, days, step, k, _joined(np.isfinite(logged.sensors[:, k - 2])), colour(k - 2))
    for column, times in logged.cleaning.masked.items():
        rows = [k for k, name in enumerate((*logged.cleaning.faces, *logged.names)) if name == column]
        for k in rows:
            ax.plot(times / 86400.0, np.full(len(times), k), "|", ms=9, mew=0.8, color=BLACK)
    _mark_breaks(ax, case, days)
    ax.set_yticks(range(len(names)), names)
    ax.set(
        xlabel=DAYS,
        ylim=(len(names) - 0.5, -0.5),
        title="Readings (bars), interpolated (yellow), masked (black marks), record broken (grey band)",
    )
    ax.grid(axis="y", visible=False)


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


def _stretches(ax: Axes, days: np.ndarray, step: float, place: int, there: np.ndarray, tint: str) -> None:
    """A bar over each stretch of rows."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], there.astype(int), [0]])))
    bars = [(float(days[a]) - step / 2, float(b - a) * step) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    ax.broken_barh(bars, (place - 0.3, 0.6), color=tint, lw=0)
