"""Figures of a planned campaign: the expected interval against days, first day and accuracy."""

from __future__ import annotations

import datetime

import matplotlib.dates as mdates
import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from .._internal.number_formats import counted
from ..experiment_design.campaign_plan.expected_intervals import half_width
from ..experiment_design.campaign_plan.plan_result import CampaignPlan
from .house_style import BLUE, GREY, ORANGE, axes_or_new, sensor_colour
from .legends import legend_below, use_constrained_layout

_LABEL = "half width of the 95 % interval"
_UNITS = {"position_std": (1e3, "position error, one standard deviation (mm)"), "offset_std": (1.0, "offset (K)")}


def _widths(errors: np.ndarray) -> np.ndarray:
    """Relative half widths in percent of standard errors; NaN where nothing is determined."""
    widths = np.array([100.0 * half_width(float(error)) for error in np.ravel(errors)]).reshape(np.shape(errors))
    return np.where(np.isfinite(widths) & (widths < 1e3), widths, np.nan)


def _percent_axis(ax: Axes) -> None:
    """Plain percentages at a few ticks of a logarithmic axis."""
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_major_formatter("{x:g} %")
    ax.yaxis.set_minor_formatter(NullFormatter())


def interval_by_days(plan: CampaignPlan, *, ax: Axes | None = None) -> Axes:
    """Expected half width of the interval of the diffusivity against the days, for each number of sensors.

    Each length is from its best first day on. The band is over the diffusivities that the wall may have.

    Args:
        plan: the planned campaign.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax, plates = axes_or_new(ax), len(plan.plates)
    for k, curve in enumerate(plan.curves):
        name = counted(curve.sensors, "sensor")
        name += f" and {counted(plates, 'plate')}" if plates else ""
        widths = _widths(curve.errors)
        ax.plot(curve.days, _widths(curve.median), "o-", ms=3.5, color=sensor_colour(k), label=name)
        ax.fill_between(curve.days, widths.min(axis=1), widths.max(axis=1), color=sensor_colour(k), alpha=0.15, lw=0)
    ax.axvline(plan.days, color=GREY, ls="--", label=f"planned: {plan.days:g} days")
    for k, (face, days) in enumerate(plan.average_method_days.items()):
        if days is not None:
            ax.axvline(days, color=ORANGE, ls=(":", "-.")[k], label=f"ISO 9869-1, {face} plate: {days:g} days")
    ax.set(xscale="log", yscale="log", xlabel="days", ylabel=_LABEL, title="How many days")
    ax.xaxis.set_major_formatter("{x:g}")
    _percent_axis(ax)
    legend_below(ax)
    use_constrained_layout(ax)
    return ax


def interval_by_start(plan: CampaignPlan, *, ax: Axes | None = None) -> Axes:
    """Expected half width of the interval of the diffusivity against the first day of the year.

    The line is the median over the diffusivities that the wall may have and over the weather of the days around, the
    band is over the diffusivities.

    Args:
        plan: the planned campaign.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    first = datetime.date(2023, 1, 1)
    dates = [mdates.date2num(first + datetime.timedelta(days=day - 1)) for day in plan.season.days]
    widths = _widths(plan.season.errors)
    ax.plot(dates, _widths(plan.season.median), "o-", ms=3.5, color=BLUE, label="median over diffusivities and weather")
    ax.fill_between(dates, widths.min(axis=1), widths.max(axis=1), color=BLUE, alpha=0.15, lw=0)
    planned = float(mdates.date2num(first + datetime.timedelta(days=plan.start - 1)))
    ax.axvline(planned, color=GREY, ls="--", label="planned")
    ax.xaxis.set_major_locator(mdates.MonthLocator())
    ax.xaxis.set_major_formatter(mdates.DateFormatter("%b"))
    ax.set(yscale="log", xlabel=f"first of {plan.days:g} days", ylabel=_LABEL, title="When")
    _percent_axis(ax)
    legend_below(ax)
    use_constrained_layout(ax)
    return ax


def interval_by_accuracy(plan: CampaignPlan, name: str, *, ax: Axes | None = None) -> Axes:
    """Expected half width of the interval of the diffusivity against the accuracy of the sensors.

    Args:
        plan: the planned campaign.
        name: "position_std" or "offset_std".
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    (tolerance,) = [one for one in plan.tolerances if one.name == name]
    factor, label = _UNITS[name]
    ax.plot(factor * np.array(tolerance.values), _widths(tolerance.errors), "o-", ms=3.5, color=BLUE)
    ax.axvline(factor * tolerance.allowed, color=GREY, ls="--", label="accurate enough")
    ax.set(xscale="log", xlabel=label, ylabel=_LABEL, title="How accurate")
    ax.set_ylim(0.0, 1.15 * float(np.nanmax(_widths(tolerance.errors), initial=0.0)) or 1.0)
    ax.xaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_major_formatter("{x:.2g} %")
    legend_below(ax)
    use_constrained_layout(ax)
    return ax
