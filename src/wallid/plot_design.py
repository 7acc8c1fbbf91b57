"""Figures of a design: where a further sensor helps, and what other sampling steps would give."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from ._style import BLUE, GREY, ORANGE, RED, SENSORS
from .places import Places
from .sampling import Sampling


def sensor_places(ax: Axes, found: Places) -> None:
    """The standard error to expect with one more sensor at each place, for each diffusivity; the best place marked."""
    for a, (alpha, tint) in enumerate(zip(found.diffusivities, SENSORS, strict=False)):
        ax.plot(found.places, found.std[0, a], "o-", ms=3, color=tint, label=rf"one more, $\alpha$ = {alpha:.2g} m²/s")
        ax.axhline(found.std_before[a], color=tint, ls=":", lw=1.0, label="as it is" if a == 0 else None)
    for k, place in enumerate(found.there):
        ax.axvline(place, color=GREY, lw=0.8, ls="--", label="sensors there" if k == 0 else None)
    for k, place in enumerate(found.chosen):
        at = int(np.argmin(np.abs(found.places - place)))
        ax.plot([place], [found.std[k, 0, at]], "o", ms=9, mfc="none", color=RED, label="best" if k == 0 else None)
        ax.annotate(str(len(found.there) + k + 1), (place, found.std[k, 0, at]), (6, -8), textcoords="offset points")
    ax.set(
        xlabel="place of a further sensor (m from the left face)",
        ylabel="expected standard error",
        ylim=(0, None),
        title="Where a further sensor helps",
    )
    ax.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{100 * y:g}%"))
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=2)


def sampling(ax: Axes, found: Sampling) -> None:
    """The standard error to expect at each sampling step, and what straight lines between rows do."""
    ax.loglog(found.steps, found.std, "o-", color=BLUE, label="standard error")
    moved = np.abs(found.shift) > 1e-6
    ax.loglog(found.steps[moved], np.abs(found.shift[moved]), "s--", color=ORANGE, label="shift by straight lines")
    ax.axvline(found.own, color=GREY, lw=0.8, ls="--", label="the record's step")
    ax.set(xlabel="from row to row (s)", ylabel="of the diffusivity", title="What other sampling steps would give")
    ax.set_xticks(found.steps, [f"{step:g}" for step in found.steps])
    ax.xaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{100 * y:g}%"))
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=3)
