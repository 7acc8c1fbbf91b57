"""Figures of heat flux plates: measured and simulated, what the model leaves, and its density."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from ..case.case_definition import Case
from ..estimation.result_objects import Estimate
from ..inference.quantity import NORMAL_95
from ..models.flux_plates import flux_noise_std
from .house_style import BLUE, DAYS, GREY, ORANGE, colour
from .legends import legend_above
from .logged_record import shade, thinned
from .prediction import densities


def flux_interval(case: Case, fit: Estimate, plate: int) -> np.ndarray:
    """Half the width of each of a plate's 95 % intervals about the prediction, W/m2, `(time,)`.

    From the plate's noise as stated and from the standard error of the conductivity k:
    `1.96 sqrt(noise^2 + (flux std_k / k)^2)`.
    """
    assert fit.thermal is not None
    conductivity = fit.thermal.conductivity
    flux = fit.predicted[:, fit.sensors + plate]
    return NORMAL_95 * np.hypot(flux_noise_std(case), flux * conductivity.std / conductivity.value)


def measured_flux(ax: Axes, case: Case, fit: Estimate, plate: int) -> None:
    """A plate's readings and the model's flux over the estimate's window, with each reading's 95 % interval."""
    assert fit.thermal is not None
    face = list(fit.thermal.gains)[plate]
    days, predicted = case.record.days[fit.window.part], fit.predicted[:, fit.sensors + plate]
    there = np.isfinite(fit.residual[:, fit.sensors + plate])
    half = np.where(there, flux_interval(case, fit, plate), np.nan)
    shade(ax, days, predicted, half, GREY, 0.25)
    # wide, and under the readings: both can be seen where they agree
    ax.plot(*thinned(days[there], predicted[there]), color=GREY, lw=2.4, label="simulated")
    readings = case.record.regressors[f"flux_{face}"][fit.window.part]
    ax.plot(*thinned(days, readings), ".", ms=2.5, color=ORANGE, label="measured")
    ax.set(xlabel=DAYS, ylabel="heat flux (W/m²)", title=f"Flux at the {face} face, positive to the right")
    legend_above(ax)


def flux_residual(ax: Axes, case: Case, fit: Estimate, plate: int) -> None:
    """Measured minus simulated flux of a plate over the estimate's window, and twice the stated noise."""
    residual = fit.residual[:, fit.sensors + plate]
    there = np.isfinite(residual)
    days = case.record.days[fit.window.part]
    ax.plot(*thinned(days[there], residual[there]), ".-", ms=3, lw=0.7, color=colour(plate))
    band = NORMAL_95 * flux_noise_std(case)
    ax.axhspan(-band, band, color=GREY, alpha=0.15, lw=0, label="noise, 95 %")
    ax.axhline(0.0, color=GREY, lw=0.8)
    ax.set(xlabel=DAYS, ylabel="residual (W/m²)", title="Measured minus simulated")
    legend_above(ax)


def flux_density(ax: Axes, case: Case, fit: Estimate, plate: int) -> None:
    """Density of a plate's residual beside that of the stated noise."""
    residual = fit.residual[:, fit.sensors + plate]
    densities(ax, (("estimate", residual, BLUE),), np.full(len(residual), flux_noise_std(case)), "noise")
    ax.set(xlabel="measured minus simulated (W/m²)", ylabel="density (m²/W)", title="Residual")
    legend_above(ax)
