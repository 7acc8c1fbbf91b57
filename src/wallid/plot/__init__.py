"""Figures, each drawn on Axes that the caller gives, in one style.

Each is complete by itself: with its units, its legend or colour bar, and the room they need. Panels that
share a legend are drawn with `legend=False` and take `shared_legend`. Nothing here shows a window; `style()`
is the house style as a matplotlib context, `STYLE` as `plt.style.use` takes it.
"""

from __future__ import annotations

from .estimate_window import convergence, initial_profile, measured_against_simulated, reading_interval, residual
from .experiment_design import compromise, criterion, sampling, sensor_places
from .heat_flux import flux_density, flux_interval, flux_residual, measured_flux
from .house_style import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SENSORS, SKY, STYLE, YELLOW, colour, figure, style
from .legends import shared_legend
from .logged_record import coverage, record
from .missing_effects import confusability, ranked_gains, size_by_window, waterfall, week_residuals, week_temperatures
from .model import flux_theta, orders, theta
from .prediction import density, flux, last_week, loads, uncertainty
from .residuals import (
    colour_limit,
    cumulative_periodogram,
    hourly_residual,
    residual_map,
    shared_colour_bar,
    smooth_remainder,
)
from .wall_section import wall
from .windows import forest, resistance_forest

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
    "flux_density",
    "flux_interval",
    "flux_residual",
    "flux_theta",
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
    "resistance_forest",
    "sampling",
    "sensor_places",
    "shared_colour_bar",
    "shared_legend",
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
