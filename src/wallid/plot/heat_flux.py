"""Figures of heat flux plates: measured and simulated flux, residual, and density of the residual."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from ..case.case_definition import Case
from ..estimation.result_objects import Estimate
from ..inference.quantity import NORMAL_95
from ..models.flux_plates import flux_noise_std
from .house_style import BLUE, GREY, ORANGE, PURPLE, axes_or_new
from .legends import legend_above
from .logged_record import downsampled, interval_band
from .prediction import residual_densities
from .time_axis import TimeAxis


def flux_interval(case: Case, fit: Estimate, plate: int) -> np.ndarray:
    """Half width of the 95 % interval of each reading of a flux plate about its prediction.

    It contains the stated noise `sigma`, that of the faces included, and the standard error `std_k` of the conductivity
    `k`: `1.96 sqrt(sigma^2 + (q std_k / k)^2)`.

    Args:
        plate: its index.

    Returns:
        Half widths, W/m2, `(time,)`.
    """
    assert fit.thermal is not None
    conductivity = fit.thermal.conductivity
    flux = fit.predicted[:, fit.sensor_count + plate]
    return NORMAL_95 * np.hypot(_noise(case, fit, plate), flux * conductivity.std / conductivity.value)


def _noise(case: Case, fit: Estimate, plate: int) -> float:
    """Standard deviation of a plate's residual from the stated noise, that of the faces included, W/m2."""
    return fit.noise_rms[fit.sensor_count + plate] if fit.noise_rms else flux_noise_std(case)


def measured_flux(case: Case, fit: Estimate, plate: int, *, ax: Axes | None = None) -> Axes:
    """Measured and simulated flux of a plate over the window of an estimate, with 95 % intervals of the readings.

    Args:
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    assert fit.thermal is not None
    face = list(fit.thermal.plate_gains)[plate]
    axis, predicted = TimeAxis(case.record.start), fit.predicted[:, fit.sensor_count + plate]
    days = axis.at(case.record.days[fit.window.as_slice])
    present = np.isfinite(fit.residual[:, fit.sensor_count + plate])
    half = flux_interval(case, fit, plate)
    interval_band(ax, days[present], predicted[present], half[present], GREY, 0.25, "95 % of a reading")
    readings = case.record.regressors[f"flux_{face}"][fit.window.as_slice]
    # a thin dark line on wide bright dots, so that both are visible where they agree
    ax.plot(*downsampled(days, readings), "o", ms=3.5, mew=0, color=ORANGE, label="measured")
    ax.plot(*downsampled(days[present], predicted[present]), color=BLUE, lw=1.1, label="simulated")
    axis.apply(ax)
    ax.set(ylabel="heat flux (W/m²)", title=f"Flux at the {face} face, left to right positive")
    legend_above(ax)
    return ax


def flux_residual(case: Case, fit: Estimate, plate: int, *, ax: Axes | None = None) -> Axes:
    """Residual of the flux of a plate over the window of an estimate, with the 95 % band of the stated noise.

    The stated noise is that of the plate and, through the wall, of the faces.

    Args:
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    residual = fit.residual[:, fit.sensor_count + plate]
    present = np.isfinite(residual)
    axis = TimeAxis(case.record.start)
    days = axis.at(case.record.days[fit.window.as_slice])
    ax.plot(*downsampled(days[present], residual[present]), ".-", ms=3, lw=0.7, color=PURPLE)
    band = NORMAL_95 * _noise(case, fit, plate)
    ax.axhspan(-band, band, color=GREY, alpha=0.15, lw=0, label="stated noise, 95 %")
    ax.axhline(0.0, color=GREY, lw=0.8)
    axis.apply(ax)
    ax.set(ylabel="residual (W/m²)", title="Measured minus simulated")
    legend_above(ax)
    return ax


def flux_density(case: Case, fit: Estimate, plate: int, *, ax: Axes | None = None) -> Axes:
    """Probability density of the residual of a plate, and of the stated noise.

    Args:
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    residual = fit.residual[:, fit.sensor_count + plate]
    residual_densities(
        ax, (("residual", residual, PURPLE),), np.full(len(residual), _noise(case, fit, plate)), "stated noise"
    )
    ax.set(xlabel="measured minus simulated (W/m²)", ylabel="density (m²/W)", title="Density of the residual")
    legend_above(ax)
    return ax
