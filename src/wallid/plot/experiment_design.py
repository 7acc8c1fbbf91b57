"""Figures of a design: which days tell most, how many of them, where a further sensor helps, how often to read."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from .._internal.number_formats import number
from .._internal.units import DAY
from ..experiment_design.sampling_step import SamplingComparison
from ..experiment_design.sensor_placement import SensorPlacement
from ..experiment_design.window_lengths import LengthComparison
from ..experiment_design.window_selection import Design
from .house_style import BLUE, GREY, ORANGE, RED, colour, marked_line
from .legends import legend_above, legend_below


def criterion(ax: Axes, design: Design) -> None:
    """The criterion over start days, for each diffusivity, the best window marked."""
    for a, (alpha, values) in enumerate(zip(design.diffusivities, design.criterion, strict=True)):
        ax.plot(design.start_days, values, ms=3, label=rf"$\alpha$ = {number(alpha, 2)} m²/s", **marked_line(a))
    if design.robust != "no":
        ax.plot(design.start_days, design.merit, "-", lw=2.0, color=GREY, label=f"{design.robust}")
    best = design.best.row * design.step / DAY
    ax.plot([best], [1.0], "o", ms=9, mfc="none", color=RED, label=f"best, from day {best:g}")
    length = design.rows * design.step / DAY
    ax.set(
        xlabel=f"start of the window of {length:.3g} days (days)",
        ylabel=r"$\Psi / \Psi_{max}$ (-)",
        ylim=(0, 1.05),
        title=f"Which days tell most ({design.kind}-criterion)",
    )
    legend_above(ax)


def compromise(ax: Axes, lengths: LengthComparison) -> None:
    """The criterion against the window's length, with the estimate's cost beside it where it is known."""
    (left,) = ax.plot(lengths.days, lengths.criterion, "o-", color=BLUE, label="criterion")
    ax.set(xlabel="length of the window (days)", ylabel=r"$\Psi / \Psi_{longest}$ (-)", ylim=(0, 1.08))
    ax.set_title("What a longer window gives and costs")
    timed = np.isfinite(lengths.seconds)
    if not timed.any():
        ax.set_title("What a longer window gives")
        legend_below(ax)
        return
    cost = ax.twinx()
    (right,) = cost.plot(
        lengths.days[timed], 1e3 * lengths.seconds[timed], "s--", color=ORANGE, label="one estimate, median of many"
    )
    cost.set(ylabel="time of one estimate (ms)", ylim=(0, 1.08 * cost.dataLim.y1))
    cost.grid(False)
    legend_below(ax, [left, right])


def sensor_places(ax: Axes, found: SensorPlacement) -> None:
    """The standard error to expect with one more sensor at each place, for each diffusivity; the best place marked."""
    for a, alpha in enumerate(found.diffusivities):
        label = rf"one more, $\alpha$ = {number(alpha, 2)} m²/s"
        ax.plot(found.places, found.std[0, a], ms=3, label=label, **marked_line(a))
        ax.axhline(found.std_before[a], color=colour(a), ls=":", lw=1.0, label="as it is" if a == 0 else None)
    for k, place in enumerate(found.there):
        ax.axvline(place, color=GREY, lw=0.8, ls="--", label="sensors there" if k == 0 else None)
    for k, place in enumerate(found.chosen):
        at = int(np.argmin(np.abs(found.places - place)))
        ax.plot([place], [found.std[k, 0, at]], "o", ms=9, mfc="none", color=RED, label="best" if k == 0 else None)
        ax.annotate(str(len(found.there) + k + 1), (place, found.std[k, 0, at]), (6, -8), textcoords="offset points")
    ax.set(
        xlabel="place of a further sensor (m from the left face)",
        ylabel="standard error of the diffusivity (%)",
        ylim=(0, None),
        title="Where a further sensor helps",
    )
    ax.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{100 * y:g}"))
    legend_below(ax)


def sampling(ax: Axes, found: SamplingComparison) -> None:
    """The standard error to expect at each sampling step, and what straight lines between rows do."""
    ax.loglog(found.steps, found.std, "o-", color=BLUE, label="standard error")
    moved = np.abs(found.shift) > 1e-6
    ax.loglog(found.steps[moved], np.abs(found.shift[moved]), "s--", color=ORANGE, label="shift by straight lines")
    ax.axvline(found.own, color=GREY, lw=0.8, ls="--", label="the record's step")
    ax.set(
        xlabel="from row to row (s)",
        ylabel="error of the diffusivity (%)",
        title="What other sampling steps would give",
    )
    ax.set_xticks(found.steps, [f"{step:g}" for step in found.steps])
    ax.xaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{100 * y:g}"))
    legend_below(ax)
