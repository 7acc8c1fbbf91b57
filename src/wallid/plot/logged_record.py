"""Figures of a record: the temperatures, and where readings are missing, interpolated or masked."""

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
from .house_style import FACE_COLOURS, GREY, ORANGE, YELLOW, axes_or_new, line_style, marker_style, sensor_colour
from .legends import as_drawn, legend_above, legend_below, shortened
from .time_axis import TimeAxis

BLACK = "#000000"
_CURVE_POINTS = 3000  # more are not visible in a figure of this width
_BAND_POINTS = 1000
_FEW_SENSORS = 8  # with up to so many, the legend also gives their positions
_SPIKE_MARGIN = 0.5  # of the range of the temperatures: spikes farther away are drawn at this distance
_NARROWEST = 0.004  # share of the record, about the width of a line: shorter events are drawn this wide, or by a marker


def downsampled(days: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A long curve reduced to the minimum and maximum of consecutive blocks, in time order; a short curve as it is."""
    if len(days) <= _CURVE_POINTS:
        return days, values
    size = -(-2 * len(days) // _CURVE_POINTS)
    in_blocks = len(days) // size * size
    blocks = np.where(np.isnan(values[:in_blocks]), np.inf, values[:in_blocks]).reshape(-1, size)
    low = blocks.argmin(axis=1)
    high = np.where(np.isinf(blocks), -np.inf, blocks).argmax(axis=1)
    picks = np.sort(np.stack([low, high], axis=1), axis=1) + size * np.arange(len(blocks))[:, None]
    rows = np.concatenate([picks.ravel(), np.arange(in_blocks, len(days))])
    return days[rows], values[rows]


def interval_band(
    ax: Axes,
    days: np.ndarray,
    middle: np.ndarray,
    half: np.ndarray,
    colour: str,
    alpha: float,
    label: str | None = None,
) -> None:
    """Draw the band `middle ± half` over time; of a long series, at every n-th row only."""
    rows = slice(None, None, max(1, len(days) // _BAND_POINTS))
    low, high = (middle - half)[rows], (middle + half)[rows]
    ax.fill_between(days[rows], low, high, color=colour, alpha=alpha, lw=0, label=label)


def record(case: Case, window: Window | None = None, *, spikes: bool = False, ax: Axes | None = None) -> Axes:
    """Temperatures of faces and sensors over the entire record, with interpolated rows and breaks.

    Args:
        window: shaded; None for none.
        spikes: whether the spikes that were removed while the record was read are marked. Those far from all other
            temperatures are marked nearer, by triangles, so that they do not set the scale.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    logged, axis = case.record, TimeAxis(case.record.start)
    days = axis.at(logged.days)
    faces = np.where(logged.broken[:, None], np.nan, logged.faces)
    for side, (name, colour) in enumerate(zip(SIDES, FACE_COLOURS, strict=True)):
        exposure = "outside" if case.wall.outside == name else "inside"
        ax.plot(*downsampled(days, faces[:, side]), color=colour, lw=0.8, label=f"{name} face ({exposure})")
    for s, sensor in enumerate(case.sensors):
        sparse = is_sparse(logged.sensors[:, s])
        rows = np.isfinite(logged.sensors[:, s]) if sparse else slice(None)  # a missing value breaks the line
        line = {**marker_style(s), "ls": "none", "ms": 3} if sparse else {**line_style(s), "lw": 1.0}
        position = f" at {100 * sensor.position:.3g} cm" if len(case.sensors) <= _FEW_SENSORS else ""
        label = f"{shortened(sensor.name)}{position}"
        ax.plot(*downsampled(days[rows], logged.sensors[rows, s]), **line, label=label)
    if window is not None:
        first, last = days[window.row], days[window.row + window.rows - 1]
        ax.axvspan(first, last, color=YELLOW, alpha=0.35, lw=0, label="window used")
    _mark_filled(ax, case, days)
    _mark_breaks(ax, case, days, label="break of the record")
    if spikes:
        _mark_spikes(ax, case, axis, np.concatenate([faces.ravel(), logged.sensors.ravel()]))
    ax.set(ylabel="temperature (°C)", title=f"Record {as_drawn(case.name)}")
    axis.apply(ax)
    legend_above(ax)
    return ax


def _mark_spikes(ax: Axes, case: Case, axis: TimeAxis, temperatures: np.ndarray) -> None:
    """Mark the removed spikes: a cross at their value, or a triangle that points to it where it is far away."""
    columns = (*case.record.cleaning.faces, *case.record.names)
    spikes = [found for name, found in case.record.cleaning.spikes.items() if name in columns]
    if not spikes:
        return
    seconds, values = np.concatenate(spikes).T
    low, high = np.nanmin(temperatures), np.nanmax(temperatures)
    margin = _SPIKE_MARGIN * max(high - low, 1.0)
    shown = np.clip(values, low - margin, high + margin)
    for marker, which, where in (
        ("x", shown == values, ""),
        ("^", values > shown, ", higher than shown"),
        ("v", values < shown, ", lower than shown"),
    ):
        if which.any():
            days = axis.at(seconds[which] / DAY)
            ax.plot(days, shown[which], marker, ms=5, color=BLACK, ls="none", label=f"spike removed{where}", zorder=4)


def _mark_filled(ax: Axes, case: Case, days: np.ndarray) -> None:
    """Mark the rows with an interpolated face temperature, with error bars of twice the standard error."""
    if (std := case.record.fill_std) is None:
        return
    label = "interpolated, ± 2 standard errors"
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
    """Shade the breaks of the record, where a face has no reading for too long."""
    for one in case.record.cleaning.breaks:
        ax.axvspan(days[one.row - 1], days[one.row + one.rows], color=GREY, alpha=0.2, lw=0, label=label)
        label = None


def data_availability(case: Case, *, ax: Axes | None = None) -> Axes:
    """When each face, sensor and further column has readings; which values were interpolated, masked or are missing.

    Args:
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    logged, axis = case.record, TimeAxis(case.record.start)
    days = axis.at(logged.days)
    std = np.zeros((logged.rows, 2)) if logged.fill_std is None else logged.fill_std
    names = ["left face", "right face", *(shortened(name) for name in (*logged.names, *logged.regressors))]
    columns_read = (logged.cleaning.regressors.get(key, key) for key in logged.regressors)
    columns = (*logged.cleaning.faces, *logged.names, *columns_read)
    others = [*logged.sensors.T, *logged.regressors.values()]
    keys: list[Artist] = [Patch(color=GREY, label="readings")]
    any_filled = any_lost = False
    for k, column in enumerate(columns):
        filled = (std[:, k] > 0) & ~logged.broken if k < 2 else np.zeros(logged.rows, bool)
        present = std[:, k] == 0 if k < 2 else _between_readings(np.isfinite(others[k - 2]))
        _bars(ax, days, _runs(present), k, _row_colour(k, len(logged.names)))
        _bars(ax, days, _runs(filled), k, ORANGE, _NARROWEST)
        gaps = _runs(~present & ~filled & ~logged.broken)
        short = _NARROWEST * (days[-1] - days[0])
        lost = [0.5 * (days[a] + days[b - 1]) for a, b in gaps if days[b - 1] - days[a] < short]
        lost += list(axis.at(logged.cleaning.masked.get(column, np.array([])) / DAY))
        ax.plot(lost, np.full(len(lost), k), "|", ms=11, mew=1.2, color=BLACK)
        any_filled, any_lost = any_filled or filled.any(), any_lost or bool(lost)
    _mark_breaks(ax, case, days)
    if any_filled:
        keys.append(Patch(color=ORANGE, label="interpolated"))
    if any_lost:
        keys.append(Line2D([], [], ls="none", marker="|", ms=9, color=BLACK, label="single reading missing or masked"))
    if logged.cleaning.breaks:
        keys.append(Patch(color=GREY, alpha=0.2, label="break of the record"))
    ax.set_yticks(range(len(names)), [name.replace("_", " ") if name in logged.regressors else name for name in names])
    ax.set(ylim=(len(names) - 0.5, -0.5), title="Available readings")
    axis.apply(ax)
    ax.grid(axis="y", visible=False)
    legend_below(ax, keys)
    return ax


def _row_colour(row: int, sensors: int) -> str:
    """Colour of a row of the available readings: faces, then sensors, then further columns in grey."""
    if row < 2:
        return FACE_COLOURS[row]
    return sensor_colour(row - 2) if row - 2 < sensors else GREY


def is_sparse(values: np.ndarray) -> bool:
    """Whether the readings of an instrument are so far apart that most of them have no reading in the next row."""
    present = np.isfinite(values)
    return bool(present.any() and _between_readings(present).mean() > 1.5 * present.mean())


def _between_readings(present: np.ndarray) -> np.ndarray:
    """Rows at or between readings that follow each other at the sensor's usual spacing."""
    rows = np.flatnonzero(present)
    if len(rows) < 2:
        return present
    spacing = int(np.median(np.diff(rows)))
    near = np.diff(rows) <= 1.5 * spacing
    change = np.zeros(len(present) + 1, int)
    np.add.at(change, rows[:-1][near], 1)
    np.add.at(change, rows[1:][near], -1)
    return (np.cumsum(change)[:-1] > 0) | present


def _runs(present: np.ndarray) -> list[tuple[int, int]]:
    """First row of each run of rows, and the row after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], present.astype(int), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _bars(
    ax: Axes, days: np.ndarray, runs: list[tuple[int, int]], ordinate: int, colour: str, narrowest: float = 0.0
) -> None:
    """Draw a bar over each run of rows, at least as wide as a share of the record."""
    step, least = float(days[1] - days[0]), narrowest * float(days[-1] - days[0])
    bars = []
    for first, end in runs:
        width = (end - first) * step
        middle = float(days[first]) + 0.5 * (width - step)
        wide = max(width, least)
        bars.append((middle - 0.5 * wide, wide))
    ax.broken_barh(bars, (ordinate - 0.3, 0.6), color=colour, lw=0)
