"""Figures of an experiment design: window, window length, sensor placement and sampling step."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from .._internal.number_formats import format_number
from .._internal.units import DAY
from ..experiment_design.sampling_step import SamplingComparison
from ..experiment_design.sensor_placement import SensorPlacement
from ..experiment_design.window_lengths import LengthComparison
from ..experiment_design.window_selection import Design
from .house_style import BLUE, GREY, ORANGE, RED, axes_or_new, curve_style, sensor_colour
from .legends import legend_above, legend_below
from .time_axis import TimeAxis


def criterion(design: Design, *, ax: Axes | None = None) -> Axes:
    """The design criterion against the start of the window, for each diffusivity, with the best window marked.

    Args:
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    axis = TimeAxis(design.record_start)
    starts = axis.at(design.start_days)
    for a, (alpha, values) in enumerate(zip(design.diffusivities, design.criterion, strict=True)):
        ax.plot(starts, values, ms=3, label=rf"$\alpha$ = {format_number(alpha, 2)} m²/s", **curve_style(a))
    if design.robust != "no":
        ax.plot(starts, design.relative_criterion, "-", lw=2.0, color=GREY, label=f"{design.robust} over α")
    best = design.best.row * design.step / DAY
    begin = f"day {best:g}" if design.record_start.stamp is None else str(design.labels[0])[:16].replace("T", " ")
    ax.plot([axis.at(best)], [1.0], "o", ms=9, mfc="none", color=RED, label=f"best window, from {begin}")
    length = design.rows * design.step / DAY
    ax.set(
        ylabel="relative criterion (-)",
        ylim=(0, 1.05),
        title=f"{design.criterion_name}-criterion of windows of {length:.3g} d",
    )
    axis.apply(ax)
    ax.set_xlabel(f"start of the window ({axis.label if design.record_start.stamp is None else 'date'})")
    legend_above(ax)
    return ax


def window_lengths(comparison: LengthComparison, *, ax: Axes | None = None) -> Axes:
    """The design criterion and, where known, the computing time of an estimate, against the length of the window.

    Args:
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    (left,) = ax.plot(comparison.days, comparison.criterion, "o-", color=BLUE, label="criterion")
    ax.set(xlabel="length of the window (days)", ylabel="relative criterion (-)", ylim=(0, 1.08))
    ax.set_title("Criterion and computing time by window length")
    timed = np.isfinite(comparison.seconds)
    if not timed.any():
        ax.set_title("Criterion by window length")
        legend_below(ax)
        return ax
    cost = ax.twinx()
    milliseconds = 1e3 * comparison.seconds[timed]
    (right,) = cost.plot(comparison.days[timed], milliseconds, "s--", color=ORANGE, label="computing time, median")
    cost.set(ylabel="computing time of an estimate (ms)", ylim=(0, 1.08 * cost.dataLim.y1))
    cost.grid(False)
    legend_below(ax, [left, right])
    return ax


def sensor_placement(placement: SensorPlacement, *, ax: Axes | None = None) -> Axes:
    """Expected standard error of the diffusivity with a further sensor at each candidate position.

    Dotted lines are the standard errors without it. The selected positions are marked and numbered.

    Args:
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    for a, alpha in enumerate(placement.diffusivities):
        label = rf"with a further sensor, $\alpha$ = {format_number(alpha, 2)} m²/s"
        ax.plot(placement.candidates, placement.std[0, a], ms=3, label=label, **curve_style(a))
        ax.axhline(
            placement.std_before[a], color=sensor_colour(a), ls=":", lw=1.0, label="without it" if a == 0 else None
        )
    for k, position in enumerate(placement.existing):
        ax.axvline(position, color=GREY, lw=0.8, ls="--", label="existing sensors" if k == 0 else None)
    for k, position in enumerate(placement.chosen):
        std = placement.std[k, 0, int(np.argmin(np.abs(placement.candidates - position)))]
        ax.plot([position], [std], "o", ms=9, mfc="none", color=RED, label="best position" if k == 0 else None)
        ax.annotate(str(len(placement.existing) + k + 1), (position, std), (6, -8), textcoords="offset points")
    ax.set(
        xlabel="position of a further sensor (m from the left face)",
        ylabel="standard error of the diffusivity (%)",
        ylim=(0, None),
        title="Placement of a further sensor",
    )
    ax.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{100 * y:g}"))
    legend_below(ax)
    return ax


def sampling_steps(comparison: SamplingComparison, *, ax: Axes | None = None) -> Axes:
    """Expected standard error and interpolation bias of the diffusivity, against the sampling step.

    The bias comes from linear interpolation of the boundary temperatures between rows.

    Args:
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    ax.loglog(comparison.steps, comparison.std, "o-", color=BLUE, label="standard error")
    biased = np.abs(comparison.interpolation_bias) > 1e-6
    ax.loglog(
        comparison.steps[biased],
        np.abs(comparison.interpolation_bias[biased]),
        "s--",
        color=ORANGE,
        label="bias by linear interpolation of the faces",
    )
    ax.axvline(comparison.record_step, color=GREY, lw=0.8, ls="--", label="step of the record")
    ax.set(xlabel="sampling step (s)", ylabel="error of the diffusivity (%)", title="Choice of the sampling step")
    ax.set_xticks(comparison.steps, [f"{step:g}" for step in comparison.steps])
    ax.xaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{100 * y:g}"))
    legend_below(ax)
    return ax
