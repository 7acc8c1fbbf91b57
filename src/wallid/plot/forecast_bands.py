"""Figures of a forecast: each output with its band, and the errors of earlier predictions."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from ..estimation.forecast_result import Forecast
from ..inference.quantity import NORMAL_95
from .house_style import BLUE, GREY, ORANGE, axes_or_new, sensor_colour
from .legends import legend_below, use_constrained_layout
from .logged_record import interval_band
from .time_axis import TimeAxis

_DAYS_BEFORE = 2.0  # of readings that are shown before the forecast


def forecast_band(forecast: Forecast, output: int, *, ax: Axes | None = None) -> Axes:
    """One output of a forecast: its mean with a 95 % band, and the readings before and after its start.

    Args:
        forecast: the forecast.
        output: index of the sensor or plate.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax, axis, record = axes_or_new(ax), TimeAxis(forecast.record_start), forecast.case.record
    days = axis.at(record.days[forecast.window.as_slice])
    shown = slice(max(0, forecast.first - record.rows_in_days(_DAYS_BEFORE)), None)
    measured, after = forecast.measured[:, output], days[forecast.first :]
    half = NORMAL_95 * forecast.std[:, output]
    interval_band(ax, after, forecast.mean[:, output], half, BLUE, 0.25, "95 % of a reading")
    ax.plot(after, forecast.mean[:, output], color=BLUE, label="forecast")
    ax.plot(days[shown], measured[shown], ".", ms=3, color=GREY, label="measured")
    ax.axvline(days[forecast.first], color=ORANGE, ls="--", lw=1.0, label="start of the forecast")
    unit = "heat flux (W/m²)" if forecast.units[output] == "W/m2" else "temperature (°C)"
    ax.set(ylabel=unit, title=forecast.names[output])
    axis.apply(ax)
    legend_below(ax)
    use_constrained_layout(ax)
    return ax


def errors_ahead(forecast: Forecast, *, ax: Axes | None = None) -> Axes:
    """The share of earlier readings that lay in their 95 % band, some hours ahead, of each output.

    Args:
        forecast: the forecast.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.

    Raises:
        ValueError: the readings before the forecast are too few for the shortest horizon.
    """
    ax = axes_or_new(ax)
    if not forecast.step_errors:
        raise ValueError("forecast: no predictions of earlier readings; take more days before the forecast")
    at = np.arange(len(forecast.step_errors))
    width = 0.8 / len(forecast.names)
    for k, name in enumerate(forecast.names):
        shares = [100.0 * one.coverage[k] for one in forecast.step_errors]
        ax.bar(at + (k + 0.5) * width - 0.4, shares, 0.9 * width, color=sensor_colour(k), label=name)
    ax.axhline(95.0, color=GREY, ls="--", lw=1.0, label="95 %")
    labels = [f"{one.hours:g} h" for one in forecast.step_errors]
    ax.set(ylim=(0.0, 100.0), ylabel="readings in their 95 % band (%)", xlabel="ahead", title="Earlier predictions")
    ax.set_xticks(at, labels)
    legend_below(ax)
    use_constrained_layout(ax)
    return ax
