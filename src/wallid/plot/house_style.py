"""The figures' house style: colours that every kind of colour vision tells apart, on white and on the dark page.

Each has a contrast of 3:1 or more with both grounds (WCAG 2.2, 1.4.11); a second sign, the line's or the marker's
kind, goes with each sensor's colour.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, PURPLE, SKY, RED, GREY = (
    "#0E6F8C",
    "#BF8613",
    "#11A660",
    "#A626BF",
    "#4089FF",
    "#CC3D33",
    "#5A5A5A",  # on the dark page a lighter one stands for it
)
YELLOW = "#F0E442"
"""Of bands only: as a line or a mark it would be too faint."""
SENSORS = (BLUE, ORANGE, GREEN, PURPLE, SKY)  # the faces are grey and red
_LINES = ("-", "--", "-.", ":", (0, (6, 1.5, 1, 1.5, 1, 1.5)))
_MARKERS = ("o", "^", "s", "v", "D")
FACES = (GREY, RED)
"""Of the left and the right face."""
KEEP = "keep-colour"
"""The gid of what keeps its colour on the dark page: text on a ground of its own."""

DAYS = "days since the record's start"

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
"""As matplotlib takes it: `plt.style.use(wallid.plot.STYLE)` for a whole notebook."""


def style() -> AbstractContextManager[Any]:
    """The house style for a while: `with wallid.plot.style(): ...`."""
    return mpl.rc_context(STYLE)  # pyright: ignore[reportArgumentType]


def figure(rows: int = 1, columns: int = 1, *, width: float = 7.2, height: float = 2.6) -> tuple[Figure, Any]:
    """An empty figure in the house style and its Axes, `height` inches a row."""
    with style():
        made = Figure(figsize=(width, height * rows))
        return made, made.subplots(rows, columns)


def colour(sensor: int) -> str:
    """The colour of a sensor's place."""
    return SENSORS[sensor % len(SENSORS)]


def line(sensor: int) -> dict[str, Any]:
    """A sensor's line, by colour and kind: 25 of them differ."""
    return {"color": colour(sensor), "linestyle": _LINES[_kind(sensor)]}


def marks(sensor: int) -> dict[str, Any]:
    """A sensor's marks, by colour and kind: 25 of them differ."""
    return {"color": colour(sensor), "marker": _MARKERS[_kind(sensor)]}


def marked_line(sensor: int) -> dict[str, Any]:
    """A sensor's line with its marks."""
    return line(sensor) | marks(sensor)


def _kind(sensor: int) -> int:
    """Neighbours differ in it, and so do sensors of one colour."""
    return (sensor + sensor // len(SENSORS)) % len(_LINES)


def ink_on(ground: Any) -> str:
    """Black or white, whichever stands out more from a colour (WCAG 2.2's contrast ratio)."""
    return "black" if contrast(ground, "black") > contrast(ground, "white") else "white"


def contrast(one: Any, other: Any) -> float:
    """The contrast of two colours, from 1 to 21.

    Source: Web Content Accessibility Guidelines 2.2 (2023), "contrast ratio".
    """
    dark, light = sorted(_luminance(tint) for tint in (one, other))
    return (light + 0.05) / (dark + 0.05)


def _luminance(tint: Any) -> float:
    """The relative luminance of an sRGB colour, 0 to 1."""
    rgb = np.array(to_rgb(tint))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])
