"""The style of all figures: colours, lines and markers that remain distinct under colour vision deficiency.

Each colour has a contrast of at least 3:1 with the white page (WCAG 2.2, success criterion 1.4.11). On the dark page
it is replaced by that of `DARK`, with at least 4.5:1: thin lines and small dots are seen worse on dark than on light.
Each sensor also has its own kind of line and marker.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, PURPLE, SKY, RED, GREY = (
    "#0E6F8C",
    "#BF8613",
    "#11A660",
    "#A626BF",
    "#4089FF",
    "#CC3D33",
    "#5A5A5A",
)
DARK = {
    BLUE: "#138EB4",
    ORANGE: "#F3B119",
    GREEN: "#3AE278",
    PURPLE: "#DF24FF",
    SKY: "#9FCEFD",
    RED: "#F24F33",
    GREY: "#A9B0B6",
}
"""The colour that replaces each on a dark page."""
YELLOW = "#F0E442"
"""For bands only: the contrast of a yellow line or marker would be too low."""
SENSOR_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY)  # grey and red are the colours of the faces
_LINES = ("-", "--", "-.", ":", (0, (6, 1.5, 1, 1.5, 1, 1.5)))
_MARKERS = ("o", "^", "s", "v", "D")
FACE_COLOURS = (GREY, RED)
"""Colours of the left and the right face."""
KEEP_COLOUR = "keep-colour"
"""The gid of artists that keep their colour on the dark page, such as text on a coloured background."""

STYLE = {
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "lines.linewidth": 1.3,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "figure.constrained_layout.use": True,
    "savefig.dpi": 150,
}
"""matplotlib settings of the style; `plt.style.use(wallid.plot.STYLE)` sets them for a whole notebook."""


def style() -> AbstractContextManager[Any]:
    """A context in which matplotlib has the style of wallid's figures: `with wallid.plot.style(): ...`."""
    return mpl.rc_context(STYLE)  # pyright: ignore[reportArgumentType]


def figure(
    rows: int = 1, columns: int = 1, *, width: float = 7.2, height: float | Sequence[float] = 2.6
) -> tuple[Figure, Any]:
    """An empty figure in the style of wallid, and its Axes.

    Args:
        rows, columns: number of panels.
        width: of the figure, inches.
        height: of each row of panels, inches; one for all, or one for each.

    Returns:
        The figure, and its Axes as `Figure.subplots` gives them.
    """
    heights = [float(height)] * rows if isinstance(height, int | float) else list(height)
    with style():
        empty = Figure(figsize=(width, sum(heights)))
        return empty, empty.subplots(rows, columns, height_ratios=heights)


def axes_or_new(ax: Axes | None, *, height: float = 3.2) -> Axes:
    """The given Axes; or those of a new pyplot figure in the style of wallid, which notebooks show.

    Args:
        ax: None for a new figure.
        height: of the new figure, inches.
    """
    return new_axes(1, height=height)[0] if ax is None else ax


def new_axes(columns: int, *, width: float = 7.2, height: float = 3.2) -> tuple[Axes, ...]:
    """The Axes of a new pyplot figure in the style of wallid, side by side.

    Args:
        columns: number of panels.
        width, height: of the figure, inches.
    """
    import matplotlib.pyplot as plt  # late: the commands draw without pyplot

    with style():
        return tuple(plt.subplots(1, columns, figsize=(width, height), squeeze=False)[1][0])


def sensor_colour(sensor: int) -> str:
    """The colour of a sensor, by its index."""
    return SENSOR_COLOURS[sensor % len(SENSOR_COLOURS)]


def line_style(sensor: int) -> dict[str, Any]:
    """Colour and line style of a sensor, by its index; 25 combinations differ."""
    return {"color": sensor_colour(sensor), "linestyle": _LINES[_style_index(sensor)]}


def marker_style(sensor: int) -> dict[str, Any]:
    """Colour and marker of a sensor, by its index; 25 combinations differ."""
    return {"color": sensor_colour(sensor), "marker": _MARKERS[_style_index(sensor)]}


def curve_style(sensor: int) -> dict[str, Any]:
    """Colour, line style and marker of a sensor, by its index."""
    return line_style(sensor) | marker_style(sensor)


def _style_index(sensor: int) -> int:
    """Index of the line style and marker: different for neighbouring sensors and for sensors of the same colour."""
    return (sensor + sensor // len(SENSOR_COLOURS)) % len(_LINES)


def text_colour_on(background: Any) -> str:
    """Black or white, whichever has the higher contrast ratio (WCAG 2.2) with a background colour."""
    return "black" if contrast(background, "black") > contrast(background, "white") else "white"


def contrast(one: Any, other: Any) -> float:
    """The contrast ratio of two colours, from 1 to 21: `(L_1 + 0.05) / (L_2 + 0.05)`, `L` relative luminance.

    Source: Web Content Accessibility Guidelines 2.2 (2023), "contrast ratio".
    """
    dark, light = sorted(_luminance(colour) for colour in (one, other))
    return (light + 0.05) / (dark + 0.05)


def _luminance(colour: Any) -> float:
    """Relative luminance of an sRGB colour, 0 to 1."""
    rgb = np.array(to_rgb(colour))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])
