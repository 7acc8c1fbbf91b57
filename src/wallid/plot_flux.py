"""Figures of heat flux plates: the interval of single readings, what the model leaves, and its density."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from ._legend import legend_above
from ._style import BLUE, DAYS, GREY, colour
from ._units import DAY
from .case import Case
from .estimated import Estimate
from .free import flux_noise_std
from .plot_record import thinned
from .quantity import NORMAL_95

_BINS = 61


def flux_interval(ax: Axes, case: Case, fit: Estimate, plate: int) -> None:
    """Shade where 95 of 100 readings of a plate would lie, by its noise and the conductivity's standard error."""
    days, predicted = _days(case, fit), fit.predicted[:, fit.sensors + plate]
    there = np.isfinite(fit.residual[:, fit.sensors + plate])
    half = reading_half_width(case, fit, plate)
    low, high = np.where(there, predicted - half, np.nan), np.where(there, predicted + half, np.nan)
    ax.fill_between(days, low, high, color=GREY, alpha=0.25, lw=0)


def reading_half_width(case: Case, fit: Estimate, plate: int) -> np.ndarray:
    """Half the width of each reading's 95 % interval about the prediction, W/m2.

    `1.96 sqrt(noise^2 + (flux std_k / k)^2)`, with k the conductivity.
    """
    assert fit.thermal is not None
    conductivity = fit.thermal.conductivity
    flux = fit.predicted[:, fit.sensors + plate]
    return NORMAL_95 * np.hypot(flux_noise_std(case), flux * conductivity.std / conductivity.value)


def flux_residual(ax: Axes, case: Case, fit: Estimate, plate: int) -> None:
    """Measured minus simulated flux of a plate over the estimate's window, and twice the stated noise."""
    residual = fit.residual[:, fit.sensors + plate]
    there = np.isfinite(residual)
    ax.plot(*thinned(_days(case, fit)[there], residual[there]), ".-", ms=3, lw=0.7, color=colour(plate))
    band = NORMAL_95 * flux_noise_std(case)
    ax.axhspan(-band, band, color=GREY, alpha=0.15, lw=0, label="noise, 95 %")
    ax.axhline(0.0, color=GREY, lw=0.8)
    ax.set(xlabel=DAYS, ylabel="residual (W/m²)", title="Measured minus simulated")
    legend_above(ax)


def flux_density(ax: Axes, case: Case, fit: Estimate, plate: int) -> None:
    """Density of a plate's residual beside that of the stated noise."""
    residual = fit.residual[:, fit.sensors + plate]
    residual, noise = residual[np.isfinite(residual)], flux_noise_std(case)
    edge = 1.1 * max(float(np.percentile(np.abs(residual), 99.5)), 3.0 * noise)
    bins = np.linspace(-edge, edge, _BINS)
    ax.hist(residual, bins=list(bins), density=True, histtype="stepfilled", alpha=0.35, color=BLUE, label="estimate")
    x = np.linspace(-edge, edge, 301)
    ax.plot(x, np.exp(-0.5 * (x / noise) ** 2) / (noise * np.sqrt(2 * np.pi)), color=GREY, label="noise")
    ax.set(xlabel="measured minus simulated (W/m²)", ylabel="density (m²/W)", title="Residual")
    ax.legend()


def _days(case: Case, fit: Estimate) -> np.ndarray:
    """When the rows of the estimate's window were logged, days since the record's start."""
    return np.asarray(case.record.time)[fit.window.row : fit.window.row + fit.window.rows] / DAY
