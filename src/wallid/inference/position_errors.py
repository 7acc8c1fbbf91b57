"""What it does to the readings that sensors do not sit where they should: those in the wall, and those of the faces.

Where the left face's sensor sits `d_0` to the right of x = 0, and the right face's `d_L` to the right of x = L, the
wall between them is `L + d_L - d_0` long and an inner sensor at `(x - d_0) / (L + d_L - d_0)` of it, so that its
readings move by

    dT/d(d_0) = -(1 - x/L) dT/dx + (2/L) dT/d(ln alpha),      dT/d(d_L) = -(x/L) dT/dx - (2/L) dT/d(ln alpha)

A flux, which is k over that length, moves by `(2/L) dq/d(ln alpha) + q/L` and its opposite.
"""

from __future__ import annotations

import numpy as np

from .._internal.arrays import on_device
from ..case.case_definition import Case
from ..case.initial_profile import scales
from ..models.finite_volume_wall import Output
from ..models.sensitivity_equations import explicit
from ..models.state_space import StateSpace
from ..models.wall_parameters import free_wall_parameters, model_at
from ..models.window_inputs import WindowData

_EDGE = 1e-3  # of the length: a sensor that moves stays that far inside


def sensor_position_response(
    case: Case, data: WindowData, positions: tuple[int, ...], diffusivity: float, at: np.ndarray, structure: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Gradient where the sensors are thought to be, K/m; what being there adds, K; its slope by ln(alpha); and `at`.

    All by the large model, as a reduced one knows only the places that it learned.
    """
    length, stated = case.wall.length, np.array([sensor.position for sensor in case.sensors])
    std = np.array([case.sensors[s].position_std for s in positions])
    places = stated.copy()
    places[list(positions)] += std * at
    places = np.clip(places, _EDGE * length, (1 - _EDGE) * length)
    outputs = [Output(x) for x in (*stated, *places)] + [Output(x, "gradient") for x in places]
    system = model_at(case, free_wall_parameters(case), structure, outputs)
    fourier = scales(case).fourier_number(diffusivity)
    u, theta = explicit(system, on_device(fourier), data)
    kelvin, sensors = float(data.temperature), len(stated)
    u, theta = kelvin * np.asarray(u), kelvin * fourier * np.asarray(theta)
    here, there, slope = slice(0, sensors), slice(sensors, 2 * sensors), slice(2 * sensors, None)
    reached = (places - stated)[list(positions)] / std
    return u[:, slope] / length, u[:, there] - u[:, here], theta[:, there] - theta[:, here], reached


def face_position_jacobian(slope: np.ndarray, gradient: np.ndarray, x: np.ndarray, length: float) -> np.ndarray:
    """What 1 m to the right of the sensor of the left and of the right face makes of inner readings, K/m.

    Args:
        slope: dT/d(ln alpha), K. gradient: dT/dx, K/m, at the sensors' places x, m.

    Returns:
        for both faces, of the readings' shape each.
    """
    stretched = 2.0 / length * slope
    return np.stack([stretched - (1.0 - x / length) * gradient, -stretched - x / length * gradient])


def face_position_flux_jacobian(slope: np.ndarray, flux: np.ndarray, length: float) -> np.ndarray:
    """The same of fluxes, over conductivity / length: K/m.

    Args:
        slope: d(q L / k)/d(ln alpha), K. flux: q L / k, K.
    """
    further = 2.0 / length * slope + flux / length
    return np.stack([further, -further])


def face_position_response(case: Case, data: WindowData, diffusivity: float, large: StateSpace) -> np.ndarray:
    """What one prior standard deviation to the right of each face's sensor adds to the outputs, K.

    Args:
        large: its outputs are the sensors, the plates, and last the gradients at the sensors.
    """
    length, places = case.wall.length, np.array([sensor.position for sensor in case.sensors])
    sensors, kelvin, fourier = len(places), float(data.temperature), scales(case).fourier_number(diffusivity)
    u, theta = (kelvin * np.asarray(one) for one in explicit(large, on_device(fourier), data))
    channels = u.shape[1] - sensors
    slope, gradient = fourier * theta[:, :channels], u[:, channels:] / length
    through = face_position_flux_jacobian(slope[:, sensors:], u[:, sensors:channels], length)
    inside = face_position_jacobian(slope[:, :sensors], gradient, places, length)
    return case.record.face_position_std * np.concatenate([inside, through], axis=2)
