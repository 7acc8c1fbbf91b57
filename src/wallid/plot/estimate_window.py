"""Figures of an estimate's window: how it starts, how the iteration converges, what is left."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from ..case.case_definition import Case
from ..case.initial_profile import fit_profile
from ..case.time_window import Window
from ..estimation.result_objects import Estimate
from ..inference.quantity import NORMAL_95
from .house_style import BLUE, DAYS, GREEN, GREY, ORANGE, RED, colour, line, marked_line, marks
from .legends import legend_above, make_room, shortened
from .logged_record import shade, thinned

_STILL = 1e-3  # relative: a diffusivity that moves less is drawn as one that stands


def initial_profile(ax: Axes, case: Case, window: Window) -> None:
    """The initial profile of a window and the readings it is fitted through."""
    profile = fit_profile(case, window.row)
    x = np.linspace(0.0, 1.0, 101)
    places = [0.0, *(sensor.position for sensor in case.sensors), case.wall.length]
    left, right = case.record.faces[window.row]
    readings = [left, *case.record.sensors[window.row], right]
    ax.plot(
        x * case.wall.length, np.polynomial.polynomial.polyval(x, profile.coefficients), color=BLUE, label="profile"
    )
    ax.plot(places, readings, "o", color=RED, label="readings")
    fitted = "given" if profile.eps_2 is None else f"fit $\\epsilon_2$ = {profile.eps_2:.2g} K"
    ax.set(xlabel="x (m)", ylabel="temperature (°C)", title=f"Initial profile ({fitted})")
    legend_above(ax)


def convergence(value_ax: Axes, gamma_ax: Axes, fit: Estimate) -> None:
    """The diffusivity and the two stopping criteria at each step: of the paper's iteration, then of the rounds."""
    steps = np.arange(len(fit.history["diffusivity"]))
    value_ax.plot(steps, fit.history["diffusivity"], "o-", color=BLUE)
    value_ax.set(xlabel="Gauss-Newton step", ylabel="diffusivity (m²/s)", title="Convergence")
    value_ax.update_datalim([(0, fit.value * (1 + sign * _STILL)) for sign in (-1, 1)], updatex=False)
    value_ax.autoscale_view()
    value_ax.ticklabel_format(axis="y", useOffset=False)
    steps = steps[1:]
    for name, symbol, tint in (("gamma_1", r"$\gamma_1$ (cost)", ORANGE), ("gamma_2", r"$\gamma_2$ (value)", GREEN)):
        seen = fit.history[name][1:] > 0
        if seen.any():
            gamma_ax.semilogy(steps[seen], fit.history[name][1:][seen], "o-", color=tint, label=symbol)
    gamma_ax.set(xlabel="Gauss-Newton step", ylabel="relative change (-)", title="Stopping criteria")
    if fit.rounds and fit.iterations:
        value_ax.axvline(fit.iterations + 0.5, color=GREY, ls=":", lw=1.0, label="then the full covariance")
        gamma_ax.axvline(fit.iterations + 0.5, color=GREY, ls=":", lw=1.0)
        value_ax.legend(loc="lower right")
    legend_above(gamma_ax)
    for ax in (value_ax, gamma_ax):
        make_room(ax)
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))


def reading_interval(case: Case, fit: Estimate, theta: np.ndarray) -> np.ndarray:
    """Half the width of each reading's 95 % interval about the prediction, K, `(time, sensor)`.

    From the sensor's noise as stated and from the diffusivity's standard error, std:
    `1.96 sqrt(noise^2 + (theta std / value)^2)`.

    Args:
        theta: `dT/d(ln alpha)` over the estimate's window, K, as `wallid.estimate.theta_kelvin` gives it.
    """
    noise = np.array([sensor.noise_std for sensor in case.sensors])
    return NORMAL_95 * np.hypot(noise, np.asarray(theta) * fit.std / fit.value)


def measured_against_simulated(
    ax: Axes, case: Case, fit: Estimate, theta: np.ndarray | None = None, *, legend: bool = True
) -> None:
    """Readings and model over the estimate's window, with each reading's 95 % interval.

    Args:
        theta: see `reading_interval`; None leaves the interval out. legend: False where another panel's tells.
    """
    days = case.record.days[fit.window.part]
    part = case.record.window(fit.window.row, fit.window.rows)
    for s, sensor in enumerate(case.sensors):
        if theta is not None:
            shade(ax, days, fit.predicted[:, s], reading_interval(case, fit, theta)[:, s], colour(s), 0.25)
        ax.plot(*thinned(days, fit.predicted[:, s]), **line(s))
        ax.plot(*thinned(days, part.sensors[:, s]), ls="none", ms=3, mfc="none", mew=0.7, **marks(s))
        ax.plot([], [], ms=3, mfc="none", mew=0.7, **marked_line(s), label=shortened(sensor.name))
    ax.set(xlabel=DAYS, ylabel="temperature (°C)", title="Measured (marks) and simulated (lines)")
    if legend:
        legend_above(ax)
    make_room(ax)


def residual(ax: Axes, case: Case, fit: Estimate, theta: np.ndarray | None = None, *, legend: bool = True) -> None:
    """Measured minus simulated over the estimate's window, with each reading's 95 % interval.

    Args:
        theta: see `reading_interval`; None leaves the interval out. legend: False where another panel's tells.
    """
    days = case.record.days[fit.window.part]
    for s, sensor in enumerate(case.sensors):
        if theta is not None:
            half, alpha = reading_interval(case, fit, theta)[:, s], 0.24 / len(case.sensors)
            shade(ax, days, np.zeros(len(days)), half, GREY, alpha)
        there = np.isfinite(fit.residual[:, s])
        shown = thinned(days[there], fit.residual[there, s])
        ax.plot(*shown, ms=3, mfc="none", mew=0.7, lw=0.7, **marked_line(s), label=shortened(sensor.name))
    ax.axhline(0.0, color=GREY, lw=0.8)
    ax.set(xlabel=DAYS, ylabel="residual (K)", title="Measured minus simulated")
    if legend:
        legend_above(ax)
    make_room(ax)
