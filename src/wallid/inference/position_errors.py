"""The effect of position errors on the readings: of inner sensors, and of the faces' sensors.

Let the left face's sensor be `d_0` to the right of x = 0, and the right face's `d_L` to the right of x = L. The wall
between them is `L + d_L - d_0` long, and an inner sensor is at `(x - d_0) / (L + d_L - d_0)` of it, so its readings
change by

    dT/d(d_0) = -(1 - x/L) dT/dx + (2/L) dT/d(ln alpha),      dT/d(d_L) = -(x/L) dT/dx - (2/L) dT/d(ln alpha)

A flux, which is proportional to k over that length, changes by `(2/L) dq/d(ln alpha) + q/L` and its opposite.
"""

from __future__ import annotations

import numpy as np

from .._internal.arrays import on_device
from ..case.case_definition import Case
from ..case.initial_profile import scales
from ..models.sensitivity_equations import explicit
from ..models.state_space import StateSpace
from ..models.wall_parameters import free_wall_parameters, model_at
from ..models.window_inputs import WindowData, sensor_outputs

_MIN_DISTANCE = 1e-3  # of the length: from a sensor's estimated position to a face


def sensor_position_response(
    case: Case, data: WindowData, indices: tuple[int, ...], diffusivity: float, errors: np.ndarray, wall: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The effect of estimated position errors of inner sensors, by the full-order model.

    Args:
        data: of the window.
        indices: of the sensors with an uncertain position.
        diffusivity: m2/s.
        errors: their estimated position errors so far, in prior standard deviations, `(index,)`.
        wall: estimates of the wall's own parameters, in prior standard deviations.

    Returns:
        the temperature gradient at the estimated positions, K/m; the change of the readings from the stated to the
        estimated positions, K; its derivative with respect to ln(alpha), K; and `errors`, limited so that the sensors
        are inside the wall. The first three are `(time, sensor)`.
    """
    length, stated = case.wall.length, np.array([sensor.position for sensor in case.sensors])
    std = np.array([case.sensors[s].position_std for s in indices])
    positions = stated.copy()
    positions[list(indices)] += std * errors
    positions = np.clip(positions, _MIN_DISTANCE * length, (1 - _MIN_DISTANCE) * length)
    outputs = [*sensor_outputs(case), *sensor_outputs(case, positions=positions.tolist())]
    outputs += sensor_outputs(case, "gradient", positions.tolist())
    system = model_at(case, free_wall_parameters(case), wall, outputs)
    fourier = scales(case).fourier_number(diffusivity)
    u, theta = explicit(system, on_device(fourier), data)
    kelvin, sensors = float(data.temperature), len(stated)
    u, theta = kelvin * np.asarray(u), kelvin * fourier * np.asarray(theta)
    limited = (positions - stated)[list(indices)] / std
    at_stated, at_estimated, gradient = np.split(u, [sensors, 2 * sensors], axis=1)
    slope_at_stated, slope_at_estimated = theta[:, :sensors], theta[:, sensors : 2 * sensors]
    return gradient / length, at_estimated - at_stated, slope_at_estimated - slope_at_stated, limited


def face_position_jacobian(slope: np.ndarray, gradient: np.ndarray, x: np.ndarray, length: float) -> np.ndarray:
    """Derivative of inner readings with respect to the position of the left and of the right face's sensor, K/m.

    Args:
        slope: dT/d(ln alpha), K, `(time, sensor)`.
        gradient: dT/dx, K/m, `(time, sensor)`.
        x: the sensors' positions, m, `(sensor,)`.
        length: of the wall, m.

    Returns:
        one array of the readings' shape for each face.
    """
    length_effect = 2.0 / length * slope
    return np.stack([length_effect - (1.0 - x / length) * gradient, -length_effect - x / length * gradient])


def face_position_flux_jacobian(slope: np.ndarray, flux: np.ndarray, length: float) -> np.ndarray:
    """The same derivative of fluxes over conductivity / length, K/m.

    Args:
        slope: d(q L / k)/d(ln alpha), K, `(time, flux)`.
        flux: q L / k, K, `(time, flux)`.
        length: of the wall, m.
    """
    left = 2.0 / length * slope + flux / length
    return np.stack([left, -left])


def face_position_response(case: Case, data: WindowData, diffusivity: float, model: StateSpace) -> np.ndarray:
    """The effect of one prior standard deviation of the position of each face's sensor on the outputs, K.

    Args:
        data: of the window.
        diffusivity: m2/s.
        model: full-order model whose outputs are the sensors, the plates, and last the gradients at the sensors.

    Returns:
        `(face, time, channel)`.
    """
    length, positions = case.wall.length, np.array([sensor.position for sensor in case.sensors])
    sensors, kelvin, fourier = len(positions), float(data.temperature), scales(case).fourier_number(diffusivity)
    u, theta = (kelvin * np.asarray(one) for one in explicit(model, on_device(fourier), data))
    channels = u.shape[1] - sensors
    slope, gradient = fourier * theta[:, :channels], u[:, channels:] / length
    of_fluxes = face_position_flux_jacobian(slope[:, sensors:], u[:, sensors:channels], length)
    of_sensors = face_position_jacobian(slope[:, :sensors], gradient, positions, length)
    return case.record.face_position_std * np.concatenate([of_sensors, of_fluxes], axis=2)
