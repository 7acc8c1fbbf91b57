"""Figures of a prediction over the entire record: last week, residuals, measurement uncertainty, heat flux and load."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from ..estimation.prediction import HeatLoads, Prediction
from .house_style import BLUE, GREY, ORANGE, axes_or_new, line_style
from .legends import legend_above, legend_below, shortened, use_constrained_layout
from .time_axis import TimeAxis


def last_week(prediction: Prediction, sensor: int, *, ax: Axes | None = None) -> Axes:
    """Measured temperature of a sensor in the last seven days, and its predictions with prior and estimate.

    Args:
        sensor: its index.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    axis = TimeAxis(prediction.record_start)
    days = axis.at(prediction.days)
    week = days >= days[-1] - 7.0
    ax.plot(days[week], prediction.measured[week, sensor], ".", ms=3, color=GREY, label="measured")
    ax.plot(days[week], prediction.predicted_with_prior[week, sensor], "--", color=ORANGE, label="predicted with prior")
    ax.plot(days[week], prediction.predicted[week, sensor], color=BLUE, label="predicted with estimate")
    axis.apply(ax)
    ax.set(
        ylabel="temperature (°C)",
        title=f"{shortened(prediction.sensor_names[sensor])}: last week",
    )
    legend_above(ax)
    return ax


def residual_density(prediction: Prediction, sensor: int, *, ax: Axes | None = None) -> Axes:
    """Probability density of the residual of a sensor, with prior and estimate, and of the measurement uncertainty.

    Args:
        sensor: its index.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    pairs = (
        ("with prior", prediction.residual_with_prior[:, sensor], ORANGE),
        ("with estimate", prediction.residual[:, sensor], BLUE),
    )
    residual_densities(ax, pairs, prediction.sigma[:, sensor], "measurement uncertainty")
    ax.set(
        xlabel="measured minus predicted (K)",
        ylabel="density (1/K)",
        title=f"{shortened(prediction.sensor_names[sensor])}: residual",
    )
    legend_above(ax)
    return ax


def residual_densities(
    ax: Axes, residuals: Sequence[tuple[str, np.ndarray, str]], sigma: np.ndarray, name: str
) -> None:
    """Histograms of residuals, and the density of normal noise, averaged over the noise of all readings.

    Args:
        residuals: label, values and colour of each.
        sigma: standard deviation of the noise of each reading, in the unit of the residuals.
        name: label of the noise.
    """
    spread = max(np.nanpercentile(np.abs(values), 99.5) for _, values, _ in residuals)
    edge = 1.1 * max(spread, 3.0 * float(np.sqrt(np.mean(sigma**2))))
    bins = np.linspace(-edge, edge, 61)
    for label, values, colour in residuals:
        present = values[np.isfinite(values)]
        ax.hist(
            present, bins=list(bins), density=True, histtype="stepfilled", fc=(colour, 0.35), ec=colour, label=label
        )
    x = np.linspace(-edge, edge, 301)
    share, std = _binned_std(sigma)
    normal = np.exp(-0.5 * (x[:, None] / std) ** 2) / (std * np.sqrt(2 * np.pi))
    ax.plot(x, normal @ share, color=GREY, label=name)


def measurement_uncertainty(prediction: Prediction, *, ax: Axes | None = None) -> Axes:
    """Probability density of the standard uncertainty of the readings of each sensor.

    It combines the sensor noise and the position error, which acts through the temperature gradient.

    Args:
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    for s, name in enumerate(prediction.sensor_names):
        sigma = prediction.sigma[:, s]
        if np.ptp(sigma) < 1e-9:
            ax.axvline(sigma[0], **line_style(s), label=f"{shortened(name)} (constant)")
        else:
            ax.hist(sigma, bins=50, density=True, histtype="step", lw=1.4, label=shortened(name), **line_style(s))
    ax.set(xlabel="standard uncertainty (K)", ylabel="density (1/K)", title="Noise and position error combined")
    legend_below(ax)  # above, the vertical lines would strike it
    return ax


def inner_face_flux(prediction: Prediction, *, ax: Axes | None = None) -> Axes:
    """Heat flux through the inner face over the record, positive along +x.

    Args:
        prediction: with heat loads.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.

    Raises:
        ValueError: the prediction has no heat loads.
    """
    if prediction.loads is None:
        raise ValueError("prediction: it has no heat loads; state the conductivity (W/m/K) of the wall in the case")
    ax = axes_or_new(ax)
    use_constrained_layout(ax)
    axis = TimeAxis(prediction.record_start)
    ax.plot(axis.at(prediction.days), prediction.loads.flux, color=BLUE, lw=0.8)
    ax.axhline(0.0, color=GREY, lw=0.8)
    axis.apply(ax)
    ax.set(ylabel="heat flux, along +x (W/m²)", title="Heat flux through the inner face")
    return ax


def heat_load(loads: HeatLoads, *, ax: Axes | None = None) -> Axes:
    """Change of the heat through the inner face over the record, against the change of the diffusivity.

    Args:
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    use_constrained_layout(ax)
    ax.plot(100 * (loads.factors - 1.0), 100 * loads.relative_change, "o-", color=BLUE)
    ax.axhline(0.0, color=GREY, lw=0.8)
    ax.set(
        xlabel="change of the diffusivity (%)",
        ylabel="change of the heat load (%)",
        title=f"Heat load at k = {loads.conductivity:g} W/m/K",
    )
    return ax


def _binned_std(sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Share of the readings and mean standard deviation in 60 bins, instead of one density for each reading."""
    count, edges = np.histogram(sigma, bins=60)
    total, _ = np.histogram(sigma, bins=edges, weights=sigma)
    occupied = count > 0
    return count[occupied] / count.sum(), total[occupied] / count[occupied]
