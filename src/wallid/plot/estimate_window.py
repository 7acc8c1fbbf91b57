"""Figures of an estimate: initial profile, convergence, simulated temperatures and residual."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from ..case.case_definition import Case
from ..case.initial_profile import fit_profile
from ..case.time_window import Window
from ..estimation.result_objects import Estimate
from ..inference.quantity import NORMAL_95
from .house_style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    RED,
    axes_or_new,
    curve_style,
    line_style,
    marker_style,
    new_axes,
    sensor_colour,
)
from .legends import legend_above, legend_below, shortened, use_constrained_layout
from .logged_record import downsampled, interval_band
from .time_axis import TimeAxis

_SMALLEST_RANGE = 1e-3  # relative half height of the ordinate: rounding errors are not magnified


def initial_profile(case: Case, window: Window, *, ax: Axes | None = None) -> Axes:
    """The initial profile of a window, and the readings to which it is fitted.

    Args:
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    profile = fit_profile(case, window.row)
    x = np.linspace(0.0, 1.0, 101)
    positions = [0.0, *(sensor.position for sensor in case.sensors), case.wall.length]
    left, right = case.record.faces[window.row]
    readings = [left, *case.record.sensors[window.row], right]
    ax.plot(
        x * case.wall.length, np.polynomial.polynomial.polyval(x, profile.coefficients), color=BLUE, label="profile"
    )
    ax.plot(positions, readings, "o", color=RED, label="readings")
    fitted = "prescribed" if profile.eps_2 is None else f"residual {profile.eps_2:.2g} K rms"
    ax.set(xlabel="x (m)", ylabel="temperature (°C)", title=f"Initial profile ({fitted})")
    legend_above(ax)
    return ax


def convergence(fit: Estimate, *, axes: Sequence[Axes] | None = None) -> tuple[Axes, Axes]:
    """The diffusivity and the two stopping criteria at each Gauss-Newton step, in two panels.

    The steps of the weighted least-squares fit come first, then those of the generalised least-squares (GLS) fit.

    Args:
        axes: two, for the diffusivity and for the stopping criteria; None for a new figure.

    Returns:
        The two Axes.

    Raises:
        ValueError: `axes` are not two.
    """
    if axes is not None and len(axes) != 2:
        raise ValueError(f"axes: {len(axes)} were given; two are needed, for the diffusivity and the stopping criteria")
    value_ax, gamma_ax = new_axes(2, width=9.0) if axes is None else axes
    steps = np.arange(len(fit.history["diffusivity"]))
    value_ax.plot(steps, fit.history["diffusivity"], "o-", color=BLUE)
    value_ax.set(xlabel="Gauss-Newton step", ylabel="diffusivity (m²/s)", title="Convergence")
    value_ax.update_datalim([(0, fit.value * (1 + sign * _SMALLEST_RANGE)) for sign in (-1, 1)], updatex=False)
    value_ax.autoscale_view()
    value_ax.ticklabel_format(axis="y", useOffset=False)
    steps = steps[1:]
    for name, symbol, colour in (
        ("gamma_1", r"$\gamma_1$, of the cost", ORANGE),
        ("gamma_2", r"$\gamma_2$, of the diffusivity", GREEN),
    ):
        positive = fit.history[name][1:] > 0
        if positive.any():
            gamma_ax.semilogy(steps[positive], fit.history[name][1:][positive], "o-", color=colour, label=symbol)
    gamma_ax.set(xlabel="Gauss-Newton step", ylabel="relative change (-)", title="Stopping criteria")
    if fit.rounds and fit.iterations:
        value_ax.axvline(fit.iterations + 0.5, color=GREY, ls=":", lw=1.0, label="start of the GLS fit")
        gamma_ax.axvline(fit.iterations + 0.5, color=GREY, ls=":", lw=1.0)
        legend_below(value_ax)  # above, the vertical line would strike it
    legend_below(gamma_ax)
    for ax in (value_ax, gamma_ax):
        use_constrained_layout(ax)
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    return value_ax, gamma_ax


def reading_interval(case: Case, fit: Estimate, sensitivity: np.ndarray) -> np.ndarray:
    """Half width of the 95 % interval of each reading about its prediction.

    It contains the stated sensor noise `sigma` and the standard error `std` of the diffusivity `alpha`:
    `1.96 sqrt(sigma^2 + (std / alpha)^2 (dT/d(ln alpha))^2)`.

    Args:
        sensitivity: `dT/d(ln alpha)` over the window of the estimate, K, `(time, sensor)`.

    Returns:
        Half widths, K, `(time, sensor)`.
    """
    noise = np.array([sensor.noise_std for sensor in case.sensors])
    return NORMAL_95 * np.hypot(noise, np.asarray(sensitivity) * fit.std / fit.value)


def measured_against_simulated(
    case: Case, fit: Estimate, sensitivity: np.ndarray | None = None, *, legend: bool = True, ax: Axes | None = None
) -> Axes:
    """Measured and simulated temperatures over the window of an estimate, with 95 % intervals of the readings.

    Args:
        sensitivity: as for `reading_interval`; None for no interval.
        legend: False where the panel shares the legend of another.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    axis = TimeAxis(case.record.start)
    days = axis.at(case.record.days[fit.window.as_slice])
    record = case.record.window(fit.window.row, fit.window.rows)
    for s, sensor in enumerate(case.sensors):
        if sensitivity is not None:
            interval_band(
                ax, days, fit.predicted[:, s], reading_interval(case, fit, sensitivity)[:, s], sensor_colour(s), 0.25
            )
        ax.plot(*downsampled(days, fit.predicted[:, s]), **line_style(s))
        ax.plot(*downsampled(days, record.sensors[:, s]), ls="none", ms=3, mfc="none", mew=0.7, **marker_style(s))
        ax.plot([], [], ms=3, mfc="none", mew=0.7, **curve_style(s), label=shortened(sensor.name))
    ax.set(ylabel="temperature (°C)", title="Measured (markers) and simulated (lines)")
    axis.apply(ax)
    if legend:
        legend_above(ax)
    use_constrained_layout(ax)
    return ax


def residual(
    case: Case, fit: Estimate, sensitivity: np.ndarray | None = None, *, legend: bool = True, ax: Axes | None = None
) -> Axes:
    """Measured minus simulated temperatures over the window of an estimate, with 95 % intervals of the readings.

    Args:
        sensitivity: as for `reading_interval`; None for no interval.
        legend: False where the panel shares the legend of another.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    axis = TimeAxis(case.record.start)
    days = axis.at(case.record.days[fit.window.as_slice])
    for s, sensor in enumerate(case.sensors):
        if sensitivity is not None:
            half, alpha = reading_interval(case, fit, sensitivity)[:, s], 0.24 / len(case.sensors)
            interval_band(ax, days, np.zeros(len(days)), half, GREY, alpha)
        present = np.isfinite(fit.residual[:, s])
        curve = downsampled(days[present], fit.residual[present, s])
        ax.plot(*curve, ms=3, mfc="none", mew=0.7, lw=0.7, **curve_style(s), label=shortened(sensor.name))
    ax.axhline(0.0, color=GREY, lw=0.8)
    ax.set(ylabel="residual (K)", title="Measured minus simulated")
    axis.apply(ax)
    if legend:
        legend_above(ax)
    use_constrained_layout(ax)
    return ax
