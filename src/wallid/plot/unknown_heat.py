"""Figures of the heat that no known effect explains: its course, its mean day, its spectrum."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from ..estimation.unknown_heat import UnknownHeat
from ..inference.quantity import NORMAL_95
from .house_style import BLUE, GREY, axes_or_new
from .logged_record import interval_band
from .time_axis import TimeAxis

_CYCLES = 24.0, 12.0  # h
_PERIODS = 1.0, 2.0, 3.0, 6.0, 12.0, 24.0, 48.0, 96.0, 192.0  # h, of an axis
_SHOWN = 1e6  # largest power over the smallest that is shown


def heat_course(heat: UnknownHeat, *, ax: Axes | None = None) -> Axes:
    """The heat given all readings, with its 95 % band.

    Args:
        heat: the unknown heat.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax, axis = axes_or_new(ax), TimeAxis(heat.record_start)
    days = axis.at(heat.days)
    interval_band(ax, days, heat.course, NORMAL_95 * heat.std, BLUE, 0.25, "95 %")
    ax.plot(days, heat.course, color=BLUE, lw=1.0, label="heat given all readings")
    ax.axhline(0.0, color=GREY, lw=0.8)
    ax.set(ylabel=_label(heat), title="What no known effect explains, as heat")
    ax.legend(loc="best")
    axis.apply(ax)
    return ax


def heat_of_day(heat: UnknownHeat, *, ax: Axes | None = None) -> Axes:
    """The mean day of the heat.

    Args:
        heat: the unknown heat.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.

    Raises:
        ValueError: the window is shorter than two days.
    """
    hours, mean = heat.mean_day
    if not len(hours):
        raise ValueError("heat: a mean day needs at least two days")
    ax = axes_or_new(ax)
    ax.plot(np.append(hours, 24.0), np.append(mean, mean[0]), color=BLUE)
    ax.axhline(0.0, color=GREY, lw=0.8)
    ax.set(xlim=(0.0, 24.0), xlabel="hour of the day", ylabel=_label(heat), title="Its mean day")
    ax.set_xticks(range(0, 25, 4))
    return ax


def heat_spectrum(heat: UnknownHeat, *, ax: Axes | None = None) -> Axes:
    """The spectrum of the heat, beside that of a random process of its size and memory.

    Heat with a daily cycle stands out at 24 h, and at 12 h where it comes in a part of the day.

    Args:
        heat: the unknown heat.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    periods, power, of_process = heat.spectrum
    for period in _CYCLES:
        if periods[-1] < period < periods[0]:
            ax.axvline(period, color=GREY, lw=0.8, ls=":")
    ax.loglog(periods, of_process, color=GREY, ls="--", lw=1.0, label="process of its size and memory")
    ax.loglog(periods, power, color=BLUE, lw=1.2, label="heat given all readings")
    ax.set_ylim(bottom=power.max() / _SHOWN)
    ax.set_xticks(shown := [hours for hours in _PERIODS if periods[-1] <= hours <= periods[0]])
    ax.set_xticklabels([f"{hours:g}" for hours in shown])
    ax.minorticks_off()
    unit = "W²/m⁴ h" if heat.unit == "W/m2" else "K²/day² h"
    ax.set(xlabel="period (h)", ylabel=f"power ({unit})", title="Its spectrum")
    ax.legend(loc="lower right")
    return ax


def _label(heat: UnknownHeat) -> str:
    return "heat (W/m²)" if heat.unit == "W/m2" else "heat (K a day)"
