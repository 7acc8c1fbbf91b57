"""Figures of a section in two dimensions: its materials with the sensors, and its temperatures with the heat flux."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap, to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ..case.section.section_definition import Section
from ..case.wall_and_sensors import Sensor
from ..estimation.one_dimension import CostOfOneDimension
from ..inference.quantity import NORMAL_95
from ..models.section.full_order_section import SectionModel
from ..models.section.steady_section import heat_flux
from .house_style import GREY, KEEP_COLOUR, axes_or_new, marker_style
from .legends import legend_below, shortened, use_constrained_layout

_FILLS = ("#C9BBA4", "#EFE9DD", "#B4C0C6", "#DCCEBF", "#9FAFA4")  # of materials without a colour, repeated
_ARROWS = 14  # along the longer side
_LEVELS = 12  # isotherms
_FONT_SIZE = 8  # points


def materials(section: Section, sensors: Sequence[Sensor] = (), *, ax: Axes | None = None) -> Axes:
    """Draw the materials of a section with its sensors, to scale (cm).

    Args:
        section: the section.
        sensors: a sensor without a height is a dashed line at its distance from the left face.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    colours = [one.color or _FILLS[k % len(_FILLS)] for k, one in enumerate(section.materials)]
    ax.pcolormesh(
        100 * section.x_lines, 100 * section.y_lines, section.cells,
        cmap=ListedColormap([to_rgb(colour) for colour in colours]), vmin=-0.5, vmax=len(colours) - 0.5,
        rasterized=True,
    )  # fmt: skip
    keys: list[Artist] = [
        Patch(
            facecolor=colour, edgecolor=GREY, lw=0.5,
            label=f"{one.name}: {one.conductivity:.3g} W/m/K, {1e-6 * one.heat_capacity:.3g} MJ/m³/K",
        )
        for one, colour in zip(section.materials, colours, strict=True)
    ]  # fmt: skip
    keys += _draw_sensors(ax, section, sensors)
    _to_scale(ax, section)
    legend_below(ax, keys)
    use_constrained_layout(ax)
    return ax


def section_temperatures(
    model: SectionModel,
    field: np.ndarray,
    sensors: Sequence[Sensor] = (),
    *,
    conductivity: np.ndarray | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw the temperatures of a section, with isotherms and the heat flux as arrows.

    Args:
        model: of the section.
        field: temperature of the nodes, degC, `(y, x)`.
        sensors: to mark.
        conductivity: of the materials, W/m/K; None for the stated ones.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax, mesh, section = axes_or_new(ax), model.mesh, model.section
    x, y = 100 * mesh.x, 100 * mesh.y
    shown = ax.pcolormesh(x, y, field, cmap="RdYlBu_r", shading="gouraud", rasterized=True)
    if np.ptp(field) > 0.0:
        lines = ax.contour(x, y, field, levels=_LEVELS, colors="black", linewidths=0.5)
        ax.clabel(lines, fontsize=_FONT_SIZE - 2, fmt="%.3g")
    ax.add_collection(LineCollection(_joints(section), colors=GREY, linewidths=0.5))
    _draw_flux(ax, model, *heat_flux(model, field, conductivity))
    ax.figure.colorbar(shown, ax=ax, label="temperature (°C)", shrink=0.8)
    keys = _draw_sensors(ax, section, sensors)
    _to_scale(ax, section)
    legend_below(
        ax, [*keys, Line2D([], [], ls="none", marker=r"$\rightarrow$", ms=12, color="black", label="heat flux")]
    )
    return ax


def height_bias(cost: CostOfOneDimension, *, ax: Axes | None = None) -> Axes:
    """Draw the error of the diffusivity that each sensor causes in one dimension, by its height.

    Args:
        cost: of one dimension.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax, half = axes_or_new(ax), 100 * NORMAL_95 * cost.log_std
    ax.axvspan(-half, half, color=GREY, alpha=0.25, lw=0, label="95 % interval stated in one dimension")
    for number, (name, one) in enumerate(cost.sensors.items()):
        style = marker_style(number)
        ax.plot(
            100 * np.expm1(one.bias), 100 * one.heights, ls="-" if len(one.heights) > 1 else "none", ms=4,
            label=shortened(name), **style,
        )  # fmt: skip
    ax.set(xlabel="error of the diffusivity (%)", ylabel="height of the sensor (cm)")
    legend_below(ax)
    return ax


def _joints(section: Section) -> list[np.ndarray]:
    """The ends of the pieces of all joints, cm."""
    x, y, cells = 100 * section.x_lines, 100 * section.y_lines, section.cells
    upright = [np.array([(x[i + 1], y[j]), (x[i + 1], y[j + 1])]) for j, i in np.argwhere(np.diff(cells, axis=1) != 0)]
    level = [np.array([(x[i], y[j + 1]), (x[i + 1], y[j + 1])]) for j, i in np.argwhere(np.diff(cells, axis=0) != 0)]
    return upright + level


def _draw_flux(ax: Axes, model: SectionModel, along_x: np.ndarray, along_y: np.ndarray) -> None:
    """Arrows of the heat flux at even places."""
    mesh, section = model.mesh, model.section
    spacing = max(section.length, section.height) / _ARROWS
    xs, ys = (
        np.linspace(0.0, size, max(2, round(size / spacing)) + 1)[:-1] + 0.5 * size / max(2, round(size / spacing))
        for size in (section.length, section.height)
    )
    columns, rows = np.searchsorted(mesh.x, xs) - 1, np.searchsorted(mesh.y, ys) - 1
    at = np.ix_(rows, columns)
    ax.quiver(100 * xs, 100 * ys, along_x[at], along_y[at], color="black", pivot="mid", width=0.003)


def _draw_sensors(ax: Axes, section: Section, sensors: Sequence[Sensor]) -> list[Artist]:
    """Mark the sensors; the keys, for the legend."""
    keys: list[Artist] = []
    for number, sensor in enumerate(sensors):
        style, name = marker_style(number), shortened(sensor.name)
        x = 100 * sensor.position
        if sensor.height is None:
            ax.axvline(x, ls="--", lw=1.2, color=style["color"], gid=KEEP_COLOUR)
            keys.append(Line2D([], [], ls="--", lw=1.2, color=style["color"], label=f"{name} (height not known)"))
            continue
        y = 100 * sensor.height
        ax.errorbar(x, y, xerr=100 * sensor.position_std, yerr=100 * sensor.height_std, ls="none", ms=6,
                    markeredgecolor="black", markeredgewidth=0.6, capsize=2, **style)  # fmt: skip
        inward = -6 if sensor.position > 0.7 * section.length else 6
        ax.annotate(name, (x, y), (inward, 4), textcoords="offset points", fontsize=_FONT_SIZE,
                    ha="right" if inward < 0 else "left")  # fmt: skip
    return keys


def _to_scale(ax: Axes, section: Section) -> None:
    """The same scale along x and y, and the axes' labels."""
    ax.set(
        xlim=(0.0, 100 * section.length), ylim=(0.0, 100 * section.height), aspect="equal",
        xlabel="distance from the left face (cm)", ylabel="height (cm)",
    )  # fmt: skip
    ax.grid(visible=False)
