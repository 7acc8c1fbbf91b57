"""Figures, each drawn on Axes that the caller gives, in one style.

Colours are Okabe and Ito's, told apart by every kind of colour vision. Nothing here shows a
window; `style()` is the house style as a matplotlib context, `STYLE` as `plt.style.use` takes it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from ._style import BLUE, DAYS, GREEN, GREY, ORANGE, PURPLE, RED, SENSORS, SKY, STYLE, YELLOW, colour, figure, style
from .case import Case
from .design import Design
from .estimate import NORMAL_95, Estimate
from .experiment import Window, fit_profile
from .lengths import Lengths
from .mim import Learned
from .plot_campaign import forest
from .plot_design import sampling, sensor_places
from .plot_discrepancy import (
    confusability,
    ranked_gains,
    size_by_window,
    waterfall,
    week_residuals,
    week_temperatures,
)
from .plot_record import coverage, legend_above, record, thinned
from .plot_remainder import (
    colour_limit,
    cumulative_periodogram,
    hourly_residual,
    residual_map,
    smooth_remainder,
)
from .plot_wall import wall
from .reliability import Loads, Reliability

_BAND_POINTS = 1000


def theta(ax: Axes, case: Case, days: np.ndarray, sensitivity: np.ndarray) -> None:
    """The sensitivity dT/d ln(alpha) at each sensor."""
    for s, sensor in enumerate(case.sensors):
        ax.plot(*thinned(days, sensitivity[:, s]), color=colour(s), lw=0.8, label=sensor.name)
    ax.set(
        xlabel=DAYS,
        ylabel=r"$\partial T / \partial \ln \alpha$ (K)",
        title="Sensitivity to the diffusivity",
    )
    legend_above(ax, ncols=6)


def criterion(ax: Axes, design: Design) -> None:
    """The criterion over start days, for each diffusivity, the best window marked."""
    for alpha, values, tint in zip(design.diffusivities, design.criterion, SENSORS, strict=False):
        ax.plot(design.start_days, values, ".-", color=tint, ms=4, label=rf"$\alpha$ = {alpha:.2g} m²/s")
    if design.robust != "no":
        ax.plot(design.start_days, design.merit, "-", lw=2.0, color=GREY, label=f"{design.robust}")
    best = design.best.row * design.step / 86400.0
    ax.plot([best], [1.0], "o", ms=9, mfc="none", color=RED, label=f"best, from day {best:g}")
    length = design.rows * design.step / 86400.0
    ax.set(
        xlabel=f"start of the window of {length:.3g} days (days)",
        ylabel=r"$\Psi / \Psi_{max}$",
        ylim=(0, 1.3),
        title=f"Which days tell most ({design.kind}-criterion)",
    )
    ax.legend(ncols=2 if len(ax.lines) < 4 else 4, loc="upper right")


def compromise(ax: Axes, lengths: Lengths) -> None:
    """The criterion against the window's length, with the estimate's cost beside it."""
    (left,) = ax.plot(lengths.days, lengths.criterion, "o-", color=BLUE, label="criterion")
    ax.set(xlabel="length of the window (days)", ylabel=r"$\Psi / \Psi_{longest}$", ylim=(0, 1.08))
    ax.set_title("What a longer window gives and costs")
    cost = ax.twinx()
    (right,) = cost.plot(lengths.days, 1e3 * lengths.seconds, "s--", color=ORANGE, label="one estimate")
    cost.set(ylabel="time of one estimate (ms)", ylim=(0, None))
    cost.grid(False)
    ax.legend(handles=[left, right], loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)  # beside the title


def orders(ax: Axes, learned: Sequence[Learned]) -> None:
    """Errors of the reduced model over its learning signals, against its order."""
    order = [one.system.order for one in learned]
    names = ((r"$u$", BLUE), (r"$\theta$", ORANGE))
    for k, (name, tint) in enumerate(names):
        ax.semilogy(order, [one.eps_inf[k] for one in learned], "o-", color=tint, label=rf"$\epsilon_\infty$ {name}")
        ax.semilogy(order, [one.eps_2[k] for one in learned], "s--", color=tint, ms=4, label=rf"$\epsilon_2$ {name}")
    ax.set(xlabel="order of the reduced model", ylabel="error (dimensionless)", title="Error against order")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.legend(ncols=2)


def convergence(value_ax: Axes, gamma_ax: Axes, fit: Estimate) -> None:
    """The diffusivity and the two stopping criteria at each step: of the paper's iteration, then of the rounds."""
    steps = np.arange(len(fit.history["diffusivity"]))
    value_ax.plot(steps, fit.history["diffusivity"], "o-", color=BLUE)
    value_ax.set(xlabel="Gauss-Newton step", ylabel="diffusivity (m²/s)", title="Convergence")
    steps = steps[1:]
    for name, symbol, tint in (("gamma_1", r"$\gamma_1$ (cost)", ORANGE), ("gamma_2", r"$\gamma_2$ (value)", GREEN)):
        seen = fit.history[name][1:] > 0
        if seen.any():
            gamma_ax.semilogy(steps[seen], fit.history[name][1:][seen], "o-", color=tint, label=symbol)
    gamma_ax.set(xlabel="Gauss-Newton step", ylabel="relative change", title="Stopping criteria")
    if fit.rounds and fit.iterations:
        value_ax.axvline(fit.iterations + 0.5, color=GREY, ls=":", lw=1.0, label="then the full covariance")
        gamma_ax.axvline(fit.iterations + 0.5, color=GREY, ls=":", lw=1.0)
        value_ax.legend(loc="lower right")
    gamma_ax.legend()
    for ax in (value_ax, gamma_ax):
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))


def reading_interval(case: Case, fit: Estimate, theta: np.ndarray) -> np.ndarray:
    """Half the width of each reading's 95 % interval about the prediction, K, `(time, sensor)`.

    From the sensor's noise as stated and from the diffusivity's standard error: `1.96 sqrt(noise^2 + (theta std)^2)`.

    Arguments:
        theta: `dT/d(ln alpha)` over the estimate's window, K, as `wallid.estimate.theta_kelvin` gives it.
    """
    noise = np.array([sensor.noise_std for sensor in case.sensors])
    return NORMAL_95 * np.hypot(noise, np.asarray(theta) * fit.std / fit.value)


def measured_against_simulated(ax: Axes, case: Case, fit: Estimate, theta: np.ndarray | None = None) -> None:
    """Readings and model over the estimate's window, with each reading's 95 % interval.

    Arguments:
        theta: see `reading_interval`; None leaves the interval out.
    """
    days = _window_days(case, fit.window)
    part = case.record.window(fit.window.row, fit.window.rows)
    for s, sensor in enumerate(case.sensors):
        if theta is not None:
            _band(ax, days, fit.predicted[:, s], reading_interval(case, fit, theta)[:, s], colour(s), 0.25)
        ax.plot(*thinned(days, part.sensors[:, s]), ".", ms=4, color=colour(s), alpha=0.6)
        ax.plot(*thinned(days, fit.predicted[:, s]), color=colour(s), label=sensor.name)
    ax.set(xlabel=DAYS, ylabel="temperature (°C)", title="Measured (dots) and simulated")
    legend_above(ax, ncols=5)


def measured_flux(ax: Axes, case: Case, fit: Estimate, plate: int) -> None:
    """A plate's readings and the model's flux over the estimate's window."""
    assert fit.thermal is not None
    face = list(fit.thermal.gains)[plate]
    days = _window_days(case, fit.window)
    part = case.record.window(fit.window.row, fit.window.rows)
    ax.plot(days, part.regressors[f"flux_{face}"], ".", ms=3, color=colour(plate), alpha=0.6, label="measured")
    there = np.isfinite(fit.residual[:, fit.sensors + plate])
    ax.plot(days[there], fit.predicted[there, fit.sensors + plate], color=GREY, label="simulated")
    ax.set(xlabel=DAYS, ylabel="heat flux (W/m²)", title=f"Flux at the {face} face, positive to the right")
    legend_above(ax, ncols=2)


def residual(ax: Axes, case: Case, fit: Estimate, theta: np.ndarray | None = None) -> None:
    """Measured minus simulated over the estimate's window, with each reading's 95 % interval.

    Arguments:
        theta: see `reading_interval`; None leaves the interval out.
    """
    days = _window_days(case, fit.window)
    for s, sensor in enumerate(case.sensors):
        if theta is not None:
            _band(ax, days, np.zeros(len(days)), reading_interval(case, fit, theta)[:, s], GREY, 0.08)
        there = np.isfinite(fit.residual[:, s])
        shown = thinned(days[there], fit.residual[there, s])
        ax.plot(*shown, ".-", ms=3, lw=0.7, color=colour(s), label=sensor.name)
    ax.axhline(0.0, color=GREY, lw=0.8)
    ax.set(xlabel=DAYS, ylabel="residual (K)", title="Measured minus simulated")
    legend_above(ax, ncols=5)


def _band(ax: Axes, days: np.ndarray, middle: np.ndarray, half: np.ndarray, tint: str, alpha: float) -> None:
    """An interval about a course, of a long window every some rows."""
    some = slice(None, None, max(1, len(days) // _BAND_POINTS))
    low, high = (middle - half)[some], (middle + half)[some]
    ax.fill_between(days[some], low, high, color=tint, alpha=alpha, lw=0)


def _window_days(case: Case, window: Window) -> np.ndarray:
    return np.asarray(case.record.time)[window.row : window.row + window.rows] / 86400.0


def last_week(ax: Axes, reliability: Reliability, sensor: int) -> None:
    """Measured, and predicted with prior and estimate, over the record's last seven days."""
    days = reliability.days
    late = days >= days[-1] - 7.0
    ax.plot(days[late], reliability.measured[late, sensor], ".", ms=3, color=GREY, label="measured")
    ax.plot(days[late], reliability.prior[late, sensor], "--", color=ORANGE, label="prior")
    ax.plot(days[late], reliability.predicted[late, sensor], color=BLUE, label="estimate")
    ax.set(
        xlabel=DAYS,
        ylabel="temperature (°C)",
        title=f"{reliability.names[sensor]}: last week",
    )
    ax.legend()


def density(ax: Axes, reliability: Reliability, sensor: int) -> None:
    """Residual densities with prior and estimate beside that of the measurement's uncertainty."""
    pairs = (
        ("prior", reliability.residual_prior[:, sensor], ORANGE),
        ("estimate", reliability.residual[:, sensor], BLUE),
    )
    sigma = reliability.sigma[:, sensor]
    spread = max(np.nanpercentile(np.abs(values), 99.5) for _, values, _ in pairs)
    edge = 1.1 * max(spread, 3.0 * float(np.sqrt(np.mean(sigma**2))))
    bins = np.linspace(-edge, edge, 61)
    for name, values, tint in pairs:
        kept = values[np.isfinite(values)]
        ax.hist(kept, bins=list(bins), density=True, histtype="stepfilled", alpha=0.35, color=tint, label=name)
    x = np.linspace(-edge, edge, 301)
    share, middle = _histogram(sigma)
    normal = np.exp(-0.5 * (x[:, None] / middle) ** 2) / (middle * np.sqrt(2 * np.pi))
    ax.plot(x, normal @ share, color=GREY, label="measurement")
    ax.set(
        xlabel="measured minus predicted (K)", ylabel="density (1/K)", title=f"{reliability.names[sensor]}: residual"
    )
    ax.legend()


def _histogram(sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shares and middles of some 60 bins: a record's rows are too many for a density of each."""
    count, edges = np.histogram(sigma, bins=60)
    filled = count > 0
    return count[filled] / count.sum(), (0.5 * (edges[1:] + edges[:-1]))[filled]


def uncertainty(ax: Axes, reliability: Reliability) -> None:
    """The density of each sensor's combined uncertainty (noise, and position through the gradient)."""
    for s, name in enumerate(reliability.names):
        sigma = reliability.sigma[:, s]
        if np.ptp(sigma) < 1e-9:
            ax.axvline(sigma[0], color=colour(s), label=f"{name} (constant)")
        else:
            ax.hist(sigma, bins=50, density=True, histtype="step", lw=1.4, color=colour(s), label=name)
    ax.set(xlabel=r"$\sigma$ (K)", ylabel="density (1/K)", title="Measurement and position uncertainty")
    ax.legend()


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
    ax.legend()


def flux(ax: Axes, days: np.ndarray, loads: Loads) -> None:
    """The heat flux through the inner face over the record."""
    ax.plot(days, loads.flux, color=BLUE, lw=0.8)
    ax.axhline(0.0, color=GREY, lw=0.8)
    ax.set(xlabel=DAYS, ylabel="j, along +x (W/m²)", title="Heat flux through the inner face")


def loads(ax: Axes, loads: Loads) -> None:
    """How the load over the record moves with the diffusivity."""
    ax.plot(100 * (loads.factors - 1.0), 100 * loads.change, "o-", color=BLUE)
    ax.axhline(0.0, color=GREY, lw=0.8)
    ax.set(
        xlabel="change of the diffusivity (%)",
        ylabel="change of the load E (%)",
        title=f"Load E at k = {loads.conductivity:g} W/m/K",
    )


__all__ = [
    "BLUE",
    "GREEN",
    "GREY",
    "ORANGE",
    "PURPLE",
    "RED",
    "SENSORS",
    "SKY",
    "STYLE",
    "YELLOW",
    "colour",
    "colour_limit",
    "compromise",
    "confusability",
    "convergence",
    "coverage",
    "criterion",
    "cumulative_periodogram",
    "density",
    "figure",
    "flux",
    "forest",
    "hourly_residual",
    "initial_profile",
    "last_week",
    "loads",
    "measured_against_simulated",
    "measured_flux",
    "orders",
    "ranked_gains",
    "reading_interval",
    "record",
    "residual",
    "residual_map",
    "sampling",
    "sensor_places",
    "size_by_window",
    "smooth_remainder",
    "style",
    "theta",
    "uncertainty",
    "wall",
    "waterfall",
    "week_residuals",
    "week_temperatures",
]
