"""Figures of the whole record against the prediction: its last week, residuals, uncertainty, flux and loads."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from ..estimation.prediction import Loads, Prediction
from .house_style import BLUE, DAYS, GREY, ORANGE, line
from .legends import legend_above, make_room, shortened


def last_week(ax: Axes, reliability: Prediction, sensor: int) -> None:
    """Measured, and predicted with prior and estimate, over the record's last seven days."""
    days = reliability.days
    late = days >= days[-1] - 7.0
    ax.plot(days[late], reliability.measured[late, sensor], ".", ms=3, color=GREY, label="measured")
    ax.plot(days[late], reliability.prior[late, sensor], "--", color=ORANGE, label="prior")
    ax.plot(days[late], reliability.predicted[late, sensor], color=BLUE, label="estimate")
    ax.set(
        xlabel=DAYS,
        ylabel="temperature (°C)",
        title=f"{shortened(reliability.names[sensor])}: last week",
    )
    legend_above(ax)


def density(ax: Axes, reliability: Prediction, sensor: int) -> None:
    """Residual densities with prior and estimate beside that of the measurement's uncertainty."""
    pairs = (
        ("prior", reliability.residual_prior[:, sensor], ORANGE),
        ("estimate", reliability.residual[:, sensor], BLUE),
    )
    densities(ax, pairs, reliability.sigma[:, sensor], "measurement")
    ax.set(
        xlabel="measured minus predicted (K)",
        ylabel="density (1/K)",
        title=f"{shortened(reliability.names[sensor])}: residual",
    )
    legend_above(ax)


def densities(ax: Axes, residuals: Sequence[tuple[str, np.ndarray, str]], sigma: np.ndarray, name: str) -> None:
    """Histograms of residuals beside the density of normal noise, a share of the readings at each of its sizes.

    Args:
        residuals: (label, values, colour) of each.
        sigma: standard deviation of the noise of each reading.
        name: of the noise.
    """
    spread = max(np.nanpercentile(np.abs(values), 99.5) for _, values, _ in residuals)
    edge = 1.1 * max(spread, 3.0 * float(np.sqrt(np.mean(sigma**2))))
    bins = np.linspace(-edge, edge, 61)
    for label, values, tint in residuals:
        kept = values[np.isfinite(values)]
        ax.hist(kept, bins=list(bins), density=True, histtype="stepfilled", fc=(tint, 0.35), ec=tint, label=label)
    x = np.linspace(-edge, edge, 301)
    share, size = _sizes(sigma)
    normal = np.exp(-0.5 * (x[:, None] / size) ** 2) / (size * np.sqrt(2 * np.pi))
    ax.plot(x, normal @ share, color=GREY, label=name)


def uncertainty(ax: Axes, reliability: Prediction) -> None:
    """The density of each sensor's combined uncertainty (noise, and position through the gradient)."""
    for s, name in enumerate(reliability.names):
        sigma = reliability.sigma[:, s]
        if np.ptp(sigma) < 1e-9:
            ax.axvline(sigma[0], **line(s), label=f"{shortened(name)} (constant)")
        else:
            ax.hist(sigma, bins=50, density=True, histtype="step", lw=1.4, label=shortened(name), **line(s))
    ax.set(xlabel=r"$\sigma$ (K)", ylabel="density (1/K)", title="Measurement and position uncertainty")
    legend_above(ax)


def flux(ax: Axes, days: np.ndarray, loads: Loads) -> None:
    """The heat flux through the inner face over the record."""
    make_room(ax)
    ax.plot(days, loads.flux, color=BLUE, lw=0.8)
    ax.axhline(0.0, color=GREY, lw=0.8)
    ax.set(xlabel=DAYS, ylabel="j, along +x (W/m²)", title="Heat flux through the inner face")


def loads(ax: Axes, loads: Loads) -> None:
    """How the load over the record moves with the diffusivity."""
    make_room(ax)
    ax.plot(100 * (loads.factors - 1.0), 100 * loads.change, "o-", color=BLUE)
    ax.axhline(0.0, color=GREY, lw=0.8)
    ax.set(
        xlabel="change of the diffusivity (%)",
        ylabel="change of the load E (%)",
        title=f"Load E at k = {loads.conductivity:g} W/m/K",
    )


def _sizes(sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shares and means of some 60 bins: a record's rows are too many for a density of each."""
    count, edges = np.histogram(sigma, bins=60)
    total, _ = np.histogram(sigma, bins=edges, weights=sigma)
    filled = count > 0
    return count[filled] / count.sum(), total[filled] / count[filled]
