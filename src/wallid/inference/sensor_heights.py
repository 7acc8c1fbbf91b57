"""What a sensor reads whose height in a section is not known.

A sensor at x reads `T(x, y)` at a height y with the weight `w(y)`: the same for all heights where none is stated, else
a normal density about the stated one. In the estimate the spread over y is linear,

    T(x, y) = mean + sum_k z_k c_k,      z_k ~ N(0, 1)

with the principal components c_k of `T(x, y)` over y. `sensor_places` uses afterwards that the readings lie on a curve
in these components, and not anywhere.
"""

from __future__ import annotations

import numpy as np
import scipy

from .._internal.arrays import on_device
from ..case.case_definition import Case
from ..case.initial_profile import scales
from ..case.wall_and_sensors import Sensor
from ..models.finite_volume_wall import Output
from ..models.sensitivity_equations import simulate_window
from ..models.wall_parameters import model_at
from ..models.window_inputs import WindowData

COMPONENTS = 3
"""Principal components for each sensor; the fourth is below a hundredth of the first in rubble."""
HEIGHT_KIND = "sensor_height"
"""Beginning of the names of their amplitudes."""
_HEIGHTS = 64  # candidates


def has_uncertain_height(case: Case, sensor: Sensor) -> bool:
    """Whether a sensor's height is not known exactly."""
    return case.section is not None and (sensor.height is None or sensor.height_std > 0.0)


def candidate_heights(case: Case, sensor: Sensor) -> tuple[np.ndarray, np.ndarray]:
    """Heights that a sensor may have, m, and their weights, of sum 1."""
    assert case.section is not None
    heights = case.section.height * (np.arange(_HEIGHTS) + 0.5) / _HEIGHTS
    if sensor.height is None:
        return heights, np.full(_HEIGHTS, 1.0 / _HEIGHTS)
    weights = scipy.stats.norm.pdf(heights, sensor.height, max(sensor.height_std, case.section.height / _HEIGHTS))
    return heights, weights / weights.sum()


def height_deviations(case: Case, data: WindowData, diffusivity: float, sensor: Sensor) -> np.ndarray:
    """What a sensor reads at its candidate heights minus what the model has for it, K, `(height, time)`."""
    heights, _ = candidate_heights(case, sensor)
    outputs = [Output(sensor.position, height=float(height)) for height in heights]
    system = model_at(case, (), np.zeros(0), [*outputs, Output(sensor.position, height=sensor.height)])
    u = np.asarray(simulate_window(system, on_device(scales(case).fourier_number(diffusivity)), data)[0])
    return float(data.temperature) * (u[:, :-1] - u[:, -1:]).T


def principal_components(deviations: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The mean of deviations, `(time,)`, and their components, each for one standard deviation, `(component, time)`."""
    mean = weights @ deviations
    _, sizes, shapes = np.linalg.svd(np.sqrt(weights)[:, None] * (deviations - mean), full_matrices=False)
    return mean, sizes[:COMPONENTS, None] * shapes[:COMPONENTS]
