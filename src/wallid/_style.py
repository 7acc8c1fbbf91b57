"""The figures' house style: Okabe and Ito's colours, told apart by every kind of colour vision."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, PURPLE, SKY, RED, YELLOW, GREY = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#CC79A7",
    "#56B4E9",
    "#D55E00",
    "#F0E442",
    "#5A5A5A",
)
SENSORS = (BLUE, ORANGE, GREEN, PURPLE, SKY, RED)

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
