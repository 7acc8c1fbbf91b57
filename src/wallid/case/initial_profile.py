"""The initial temperature profile of a window, fitted to the readings of its first row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._internal.arrays import is_traced, numpy_for, powers
from .case_definition import Case
from .scaling import Scales
from .time_window import Window


@dataclass(frozen=True)
class InitialProfile:
    """An initial profile `T(x, 0) = sum_k a_k (x/L)^k` fitted to the faces and sensors.

    Args:
        coefficients: a_k, degC, (param,).
        coefficients_per_reading: derivative of the coefficients with respect to each sensor's reading, (param, sensor).
        eps_2: root mean square residual of the fit, K; None for a profile that the case states.
    """

    coefficients: np.ndarray
    coefficients_per_reading: np.ndarray
    eps_2: float | None


def scales(case: Case) -> Scales:
    """The reference values of a case: a day, 20 K, and the lowest face temperature rounded down to 1 K."""
    return Scales.of(case.wall, temperature_min=float(np.floor(case.record.faces.min())))


def profile_degree(case: Case) -> int:
    """The degree of the polynomial of the initial profile in the models of this case."""
    stated = [case.choices.initial_coefficients or (), *(signal.coefficients for signal in case.learning)]
    return max(case.choices.initial_profile, *(len(coefficients) - 1 for coefficients in stated))


def fit_profile(case: Case, row: int) -> InitialProfile:
    """The initial profile of a window that starts at `row`.

    It is the least-squares polynomial through the readings of the faces and sensors in this row. Its degree is
    `[choices] initial_profile`, or less where there are too few readings. Coefficients stated in the case apply to the
    first row of the record.
    """
    count = profile_degree(case) + 1
    stated = case.choices.initial_coefficients
    if stated is not None and row == 0:
        no_derivative = np.zeros((count, len(case.sensors)))
        return InitialProfile(np.pad(np.asarray(stated, float), (0, count - len(stated))), no_derivative, None)
    record, length = case.record, case.wall.length
    places = [sensor.position / length for sensor in case.sensors]
    xp = numpy_for(*places)
    positions = xp.array([0.0, 1.0, *places])
    readings = np.concatenate([record.faces[row], record.sensors[row]])
    present = np.isfinite(readings)
    degree = min(case.choices.initial_profile, int(present.sum()) - 1)
    basis = powers(positions[present], degree + 1)
    of_present = xp.pad(xp.linalg.pinv(basis), ((0, count - degree - 1), (0, 0)))
    coefficients = of_present @ readings[present]
    residual = basis @ coefficients[: degree + 1] - readings[present]
    eps_2 = xp.sqrt(xp.mean(residual**2))
    per_reading = of_present @ np.eye(len(positions))[present]
    return InitialProfile(coefficients, per_reading[:, 2:], eps_2 if is_traced(eps_2) else float(eps_2))


def dimensionless_profile(coefficients: np.ndarray, scale: Scales) -> np.ndarray:
    """The coefficients of a profile in dimensionless temperature u; T_min enters the constant only."""
    return (coefficients - scale.temperature_min * np.eye(len(coefficients))[0]) / scale.temperature


PROFILE_MODES = 8
"""How many sine modes of the initial profile are nuisance parameters."""
_MIN_RANGE = 1.0  # K


def profile_mode_count(case: Case) -> int:
    """The number of modes of the initial profile that are estimated."""
    return min(PROFILE_MODES, case.choices.nodes - 2)


def window_temperature_range(case: Case, window: Window) -> float:
    """The range of all readings in a window, K, at least `_MIN_RANGE`; it scales the prior of the initial profile."""
    part = case.record.window(window.row, window.rows)
    readings = np.concatenate([part.faces.ravel(), part.sensors.ravel()])
    return max(_MIN_RANGE, float(np.nanmax(readings) - np.nanmin(readings)))
