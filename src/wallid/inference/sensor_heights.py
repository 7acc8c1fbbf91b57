"""What a sensor reads whose height in a section is not known.

A sensor at x reads `T(x, y)` at a height y with the weight `w(y)`: the same for all heights where none is stated, else
a normal density about the stated one. In the estimate the spread over y is linear,

    T(x, y) = mean + sum_k z_k c_k,      z_k ~ N(0, 1)

with the principal components c_k of `T(x, y)` over y. `sensor_places` uses afterwards that the readings lie on a curve
in these components, and not anywhere.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._internal.arrays import on_device
from ..case.case_definition import Case
from ..case.initial_profile import scales
from ..case.time_window import Window
from ..case.wall_and_sensors import Sensor
from ..models.finite_volume_wall import Output
from ..models.sensitivity_equations import explicit
from ..models.wall_parameters import free_wall_parameters, model_at
from ..models.window_inputs import WindowData, full_order_model, window_data

COMPONENTS = 3
"""Principal components for each sensor; the fourth is below a hundredth of the first in rubble."""
HEIGHT_KIND = "sensor_height"
"""Beginning of the names of their amplitudes."""
_SPREAD = 4.0  # standard deviations about a stated height
_STEPS = 33  # heights within them


def has_uncertain_height(case: Case, sensor: Sensor) -> bool:
    """Whether a sensor's height is not known exactly."""
    return case.section is not None and (sensor.height is None or sensor.height_std > 0.0)


def component_name(sensor: Sensor, number: int | str) -> str:
    """The target in the name of the parameter of one of a sensor's components."""
    return f"{sensor.name}, component {number}"


def candidate_heights(case: Case, sensor: Sensor) -> tuple[np.ndarray, np.ndarray]:
    """Heights that a sensor may have, m, and their weights, of sum 1."""
    assert case.section is not None
    if sensor.height is None:
        heights, lengths = case.section.heights_at(sensor.position)
        return heights, lengths / case.section.height
    z = np.linspace(-_SPREAD, _SPREAD, _STEPS)
    heights = sensor.height + sensor.height_std * z
    inside = (heights >= 0.0) & (heights <= case.section.height)
    weights = np.exp(-0.5 * z[inside] ** 2)
    return heights[inside], weights / weights.sum()


class Deviations(NamedTuple):
    """What a sensor reads at its candidate heights minus what the model has for it.

    Args:
        readings: K, `(height, time)`. slopes: their derivatives with respect to ln(alpha), K.
    """

    readings: np.ndarray
    slopes: np.ndarray


def height_deviations(case: Case, data: WindowData, diffusivity: float, sensor: Sensor, wall: np.ndarray) -> Deviations:
    """The deviations of a sensor at its candidate heights.

    Args:
        data: of the window.
        diffusivity: m2/s.
        sensor: whose height is not known.
        wall: values of the case's free wall parameters, in prior standard deviations.
    """
    heights, _ = candidate_heights(case, sensor)
    outputs = [Output(sensor.position, height=float(height)) for height in heights]
    system = model_at(case, free_wall_parameters(case), wall, [*outputs, Output(sensor.position, height=sensor.height)])
    fourier = scales(case).fourier_number(diffusivity)
    u, theta = explicit(system, on_device(fourier), data)
    kelvin = float(data.temperature)
    return Deviations(
        *(factor * (part[:, :-1] - part[:, -1:]).T for factor, part in (
            (kelvin, np.asarray(u)), (kelvin * fourier, np.asarray(theta)),
        ))
    )  # fmt: skip


def heights_in_section(case: Case, sensor: Sensor) -> tuple[np.ndarray, np.ndarray]:
    """The heights that a sensor may have, m, and their weights: the stated one alone where it is known exactly."""
    if has_uncertain_height(case, sensor):
        return candidate_heights(case, sensor)
    return np.array([sensor.height]), np.ones(1)


def section_minus_homogeneous(case: Case, window: Window, diffusivity: float) -> list[Deviations]:
    """What each sensor reads at its heights in the section minus the reading in the equivalent homogeneous wall.

    Args:
        case: with a section. window: the rows.
        diffusivity: m2/s, of the equivalent wall.
    """
    if not case.sensors:
        return []
    data, fourier = window_data(case, window), scales(case).fourier_number(diffusivity)
    heights = [heights_in_section(case, sensor)[0] for sensor in case.sensors]
    outputs = [
        Output(sensor.position, height=float(height))
        for sensor, own in zip(case.sensors, heights, strict=True)
        for height in own
    ]
    systems = model_at(case, (), np.zeros(0), outputs), full_order_model(case.in_one_dimension())
    kelvin = float(data.temperature)
    (u, theta), (u_1, theta_1) = (map(np.asarray, explicit(system, on_device(fourier), data)) for system in systems)
    ends = np.cumsum([len(own) for own in heights])[:-1]
    return [
        Deviations(kelvin * (own - plain[:, None]).T, kelvin * fourier * (slope - plain_slope[:, None]).T)
        for own, plain, slope, plain_slope in zip(
            np.split(u, ends, axis=1), u_1.T, np.split(theta, ends, axis=1), theta_1.T, strict=True
        )
    ]


class HeightComponents(NamedTuple):
    """The mean of deviations over the heights, and their principal components; the same of their slopes.

    Args:
        mean, mean_slope: K, `(time,)`.
        components, component_slopes: K for one standard deviation, `(component, time)`.
        weights: of the heights at amplitudes of zero, `(height,)`; by them the components are sums over the heights:
        component_weights: `(component, height)`.
    """

    mean: np.ndarray
    mean_slope: np.ndarray
    components: np.ndarray
    component_slopes: np.ndarray
    weights: np.ndarray
    component_weights: np.ndarray

    def weights_at(self, amplitudes: np.ndarray) -> np.ndarray:
        """The weights of the heights whose sum of readings has these amplitudes, of sum 1, `(height,)`."""
        return self.weights + amplitudes @ self.component_weights


def principal_components(deviations: Deviations, weights: np.ndarray) -> HeightComponents:
    """The principal components of deviations with these weights of the heights."""
    means = [weights @ part for part in deviations]
    root = np.sqrt(weights)[:, None]
    centred = [root * (part - mean) for part, mean in zip(deviations, means, strict=True)]
    directions, _, _ = np.linalg.svd(centred[0], full_matrices=False)
    directions = directions[:, :COMPONENTS]
    largest = np.argmax(np.abs(directions), axis=0)
    directions = directions * np.sign(directions[largest, np.arange(directions.shape[1])])  # the same sign each time
    components, slopes = (_padded(directions.T @ part) for part in centred)
    of_heights = directions.T * root[:, 0]
    of_heights = of_heights - of_heights.sum(axis=1, keepdims=True) * weights  # of the deviations from their mean
    return HeightComponents(means[0], means[1], components, slopes, weights, _padded(of_heights))


def _padded(components: np.ndarray) -> np.ndarray:
    """`COMPONENTS` components, the missing ones zero: few heights have fewer."""
    return np.pad(components, ((0, COMPONENTS - len(components)), (0, 0)))
