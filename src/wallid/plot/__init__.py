"""Figures of cases, designs, estimates and diagnoses, each drawn on matplotlib Axes.

Each function takes the Axes as the keyword `ax` and returns them. Without `ax` it draws on a new figure in the style of
wallid, which a notebook shows: `plot.record(case)`. `convergence` has two panels: it takes and returns `axes`, a pair.

Each figure has units on its axes, and a legend or a colour bar. Time axes have dates, or days since the start of the
record where the times of its file are seconds. Panels that share a legend are drawn with `legend=False`;
`shared_legend` then adds one legend to the figure. No function opens a window. `style()` is the style of the figures as
a matplotlib context, `STYLE` the same as a dictionary for `plt.style.use`.
"""

from __future__ import annotations

from .average_method import average_resistance
from .campaign_plan import interval_by_accuracy, interval_by_days, interval_by_start
from .estimate_window import convergence, initial_profile, measured_against_simulated, reading_interval, residual
from .experiment_design import criterion, sampling_steps, sensor_placement, window_lengths
from .forecast_bands import errors_ahead, forecast_band
from .heat_flux import flux_density, flux_interval, flux_residual, measured_flux
from .house_style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    RED,
    SENSOR_COLOURS,
    SKY,
    STYLE,
    YELLOW,
    figure,
    sensor_colour,
    style,
)
from .legends import shared_legend
from .logged_record import data_availability, record
from .material_section import height_bias, materials, section_temperatures
from .missing_effects import (
    cosine_similarity,
    ranked_gains,
    size_by_window,
    waterfall,
    week_readings,
    week_residuals,
)
from .model import error_by_order, flux_sensitivity, sensitivity
from .next_measurement import action_probabilities, sensor_probability
from .prediction import heat_load, inner_face_flux, last_week, measurement_uncertainty, residual_density
from .regressors import regressor_quantities, regressors
from .residuals import (
    colour_limit,
    cumulative_periodogram,
    hourly_residual,
    residual_map,
    residual_scale,
    shared_colour_bar,
    smooth_residual,
)
from .unknown_heat import heat_course, heat_of_day, heat_spectrum
from .wall_section import wall
from .windows import forest, resistance_forest

__all__ = [
    "BLUE",
    "GREEN",
    "GREY",
    "ORANGE",
    "PURPLE",
    "RED",
    "SENSOR_COLOURS",
    "SKY",
    "STYLE",
    "YELLOW",
    "action_probabilities",
    "average_resistance",
    "colour_limit",
    "convergence",
    "cosine_similarity",
    "criterion",
    "cumulative_periodogram",
    "data_availability",
    "error_by_order",
    "errors_ahead",
    "figure",
    "flux_density",
    "flux_interval",
    "flux_residual",
    "flux_sensitivity",
    "forecast_band",
    "forest",
    "heat_course",
    "heat_load",
    "heat_of_day",
    "heat_spectrum",
    "height_bias",
    "hourly_residual",
    "initial_profile",
    "inner_face_flux",
    "interval_by_accuracy",
    "interval_by_days",
    "interval_by_start",
    "last_week",
    "materials",
    "measured_against_simulated",
    "measured_flux",
    "measurement_uncertainty",
    "ranked_gains",
    "reading_interval",
    "record",
    "regressor_quantities",
    "regressors",
    "residual",
    "residual_density",
    "residual_map",
    "residual_scale",
    "resistance_forest",
    "sampling_steps",
    "section_temperatures",
    "sensitivity",
    "sensor_colour",
    "sensor_placement",
    "sensor_probability",
    "shared_colour_bar",
    "shared_legend",
    "size_by_window",
    "smooth_residual",
    "style",
    "wall",
    "waterfall",
    "week_readings",
    "week_residuals",
    "window_lengths",
]
