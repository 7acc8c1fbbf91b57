"""The wall in section: its layers to scale across, its faces, its sensors with the uncertainty of their places."""

from __future__ import annotations

from matplotlib.axes import Axes

from ._style import GREY, colour
from .case import Case

_FILLS = ("#C9B79C", "#A9B7C0", "#D8CDBB", "#8FA3A8", "#BFA68A")  # of layers, in turn
_CROWDED = 0.11  # of the length: sensors nearer than this to the last one's label go a line lower


def wall(ax: Axes, case: Case) -> None:
    """The section of a case's wall with its sensors; x in cm from the left face."""
    length = 100.0 * case.wall.length
    begin = 0.0
    layers = [(100.0 * layer.thickness, f"{layer.conductivity:g} W/m/K") for layer in case.wall.layers]
    for count, (width, label) in enumerate(layers or [(length, "")]):
        ax.axvspan(begin, begin + width, ymin=0.0, ymax=1.0, color=_FILLS[count % len(_FILLS)], alpha=0.55, lw=0)
        ax.text(begin + width / 2, 0.04, label, ha="center", va="bottom", fontsize=8)
        begin += width
    for x, name in ((0.0, "left"), (length, "right")):
        place = "outside" if case.wall.outside == name else "inside"
        ax.axvline(x, color=GREY, lw=2.5)
        ax.text(x, 1.04, f"{name} face ({place})", ha=name, va="bottom", fontsize=8)
    line, last = 0, -length
    for s in sorted(range(len(case.sensors)), key=lambda s: case.sensors[s].position):
        sensor = case.sensors[s]
        x = 100.0 * sensor.position
        line = (line + 1) % 4 if x - last < _CROWDED * length else 0
        last = x
        y = 0.82 - 0.18 * line
        ax.errorbar(x, y, xerr=100.0 * sensor.position_std, fmt="o", color=colour(s), capsize=3, ms=6)
        ax.annotate(f"{sensor.name}", (x, y), (6, 5), textcoords="offset points", fontsize=8)
    margin = 0.04 * length
    ax.set(xlim=(-margin, length + margin), ylim=(0, 1), yticks=[], xlabel="distance from the left face (cm)")
    ax.spines["left"].set_visible(False)
    ax.grid(visible=False)
