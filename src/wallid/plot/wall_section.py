"""The figure of the wall in section: layers, faces, and sensors with the standard deviation of their positions."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from .._internal.number_formats import format_number
from ..case.case_definition import Case
from ..case.wall_and_sensors import Wall
from ..models.flux_plates import fluxes_of
from .house_style import GREY, KEEP_COLOUR, ORANGE, axes_or_new, marker_style
from .legends import legend_below, shortened

_FILLS = ("#E1D7C9", "#D0D7DC", "#EAE4DA", "#C1CCCF", "#DCCEBF")  # of the layers, repeated
_THIN = 0.06  # share of the length: the number of a thinner layer is drawn beside it
_FONT_SIZE = 8  # points
_PLATE_THICKNESS = 0.02  # share of the length; a plate is too thin to be drawn to scale
_PLATE_ENDS = 0.25, 0.75  # share of the height
_LINES = 4  # lines for the names of sensors that are close together


def wall(case: Case, *, ax: Axes | None = None) -> Axes:
    """Draw the section of a wall with its sensors, to scale along x (cm from the left face).

    Args:
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    length = 100.0 * case.wall.length
    keys: list[Artist] = [*_layers(ax, case.wall)]
    for x, name in ((0.0, "left"), (length, "right")):
        exposure = "outside" if case.wall.outside == name else "inside"
        ax.axvline(x, color=GREY, lw=2.5)
        ax.text(x, 1.04, f"{name} face ({exposure})", ha=name, va="bottom", fontsize=_FONT_SIZE)
    _sensors(ax, case)
    keys += _plates(ax, case)
    if case.sensors:
        uncertain = any(sensor.position_std > 0 for sensor in case.sensors)
        text = "sensors, \N{PLUS-MINUS SIGN} 1 standard deviation of the position" if uncertain else "sensors"
        keys.append(Line2D([], [], ls="-" if uncertain else "none", marker="o", color=GREY, label=text))
    margin = 0.04 * length
    ax.set(xlim=(-margin, length + margin), ylim=(0, 1), yticks=[], xlabel="distance from the left face (cm)")
    ax.spines["left"].set_visible(False)
    ax.grid(visible=False)
    legend_below(ax, keys)
    return ax


def _layers(ax: Axes, wall: Wall) -> list[Patch]:
    """Draw the layers, numbered where there are several; their properties, for the legend."""
    if not wall.layers:
        prior = f"prior {format_number(wall.diffusivity_prior, 3)} m²/s"
        key = _key(_FILLS[0], wall.length, wall.conductivity, wall.heat_capacity, prior)
        ax.axvspan(0.0, 100 * wall.length, color=_FILLS[0], lw=0)
        return [key]
    keys, begin, line = [], 0.0, 0
    for count, layer in enumerate(wall.layers, start=1):
        fill, end = _FILLS[(count - 1) % len(_FILLS)], begin + layer.thickness
        ax.axvspan(100 * begin, 100 * end, color=fill, lw=0)
        diffusivity = f"{format_number(layer.conductivity / layer.heat_capacity, 3)} m²/s"
        key = _key(fill, layer.thickness, layer.conductivity, layer.heat_capacity, diffusivity)
        key.set_label(f"{count}: {key.get_label()}")
        keys.append(key)
        middle, thin = 0.5 * (begin + end), layer.thickness < _THIN * wall.length
        line = (line + 1) % _LINES if thin else 0
        inward = (14 if middle < 0.5 * wall.length else -14) if thin else 0
        ax.annotate(
            str(count),
            (100 * middle, 0.04 + 0.07 * line),
            (inward, 0),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=_FONT_SIZE,
            gid=KEEP_COLOUR,
            arrowprops={"arrowstyle": "-", "lw": 0.6, "shrinkA": 0, "shrinkB": 0, "gid": KEEP_COLOUR} if thin else None,
        )
        begin = end
    return keys


def _key(fill: str, thickness: float, conductivity: float | None, heat_capacity: float | None, last: str) -> Patch:
    """The legend entry of a layer, with its known properties."""
    known = [f"{100 * thickness:.4g} cm"]
    known += [] if conductivity is None else [f"{conductivity:.4g} W/m/K"]
    known += [] if heat_capacity is None else [f"{1e-6 * heat_capacity:.4g} MJ/m³/K"]
    return Patch(color=fill, label=", ".join([*known, last]))


def _plates(ax: Axes, case: Case) -> list[Patch]:
    """Draw the heat flux plates on the outer side of their faces; the key, for the legend."""
    length = 100.0 * case.wall.length
    thickness = _PLATE_THICKNESS * length
    for face in (faces := fluxes_of(case)):
        begin = -thickness if face == "left" else length
        low, high = _PLATE_ENDS
        style = {"facecolor": ORANGE, "edgecolor": "black", "lw": 0.6}
        ax.add_patch(Rectangle((begin, low), thickness, high - low, label=f"plate {face}", zorder=3, **style))
    plural = "s" if len(faces) > 1 else ""
    return [Patch(facecolor=ORANGE, edgecolor="black", lw=0.6, label=f"heat flux plate{plural}")] if faces else []


def _sensors(ax: Axes, case: Case) -> None:
    """Draw the sensors at their positions; a name that would overlap another is one line lower."""
    length, inches = 100.0 * case.wall.length, ax.get_window_extent().width / ax.figure.dpi
    letter = 0.62 * _FONT_SIZE / 72.0 / inches * length
    ends = np.full(_LINES, -np.inf)  # of the last name in each line, cm
    for s in sorted(range(len(case.sensors)), key=lambda s: case.sensors[s].position):
        sensor, name = case.sensors[s], shortened(case.sensors[s].name)
        x, width = 100.0 * sensor.position, letter * (len(name) + 3)
        to_left = x + width > length
        empty = np.flatnonzero(ends <= (x - width if to_left else x))
        line = int(empty[0]) if len(empty) else int(np.argmin(ends))
        ends[line] = x + (letter if to_left else width)
        y = 0.78 - 0.16 * line
        mark = ax.errorbar(x, y, xerr=100.0 * sensor.position_std, ls="none", capsize=3, ms=6, **marker_style(s))
        mark[0].set(markeredgecolor="black", markeredgewidth=0.6)
        for part in (mark[0], *mark[1], *mark[2]):
            part.set_gid(KEEP_COLOUR)
        ax.annotate(
            name,
            (x, y),
            (-6 if to_left else 6, 5),
            textcoords="offset points",
            ha="right" if to_left else "left",
            fontsize=_FONT_SIZE,
            gid=KEEP_COLOUR,
        )
