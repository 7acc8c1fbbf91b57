"""The temperature profile at a window's first row, fitted through the readings there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .case_definition import Case
from .scaling import Scales
from .time_window import Window


@dataclass(frozen=True)
class Profile:
    """An initial profile `T(x, 0) = sum_k a_k x*^k` fitted through the faces and sensors.

    Args:
        coefficients: a_k in degC.
        per_reading: how each sensor's reading moves them, `(param, sensor)`, 1.
        eps_2: root mean square of the fit, K; None where the profile was given.
    """

    coefficients: np.ndarray
    per_reading: np.ndarray
    eps_2: float | None


def scales(case: Case) -> Scales:
    """The reference values: a day, 20 K, and the faces' lowest whole degree."""
    return Scales.of(case.wall, temperature_min=float(np.floor(case.record.faces.min())))


def profile_degree(case: Case) -> int:
    """The degree of the initial profile's polynomial in this case's models."""
    given = [case.choices.initial_coefficients or (), *(signal.coefficients for signal in case.learning)]
    return max(case.choices.initial_profile, *(len(coefficients) - 1 for coefficients in given))


def fit_profile(case: Case, row: int) -> Profile:
    """The initial profile of a window that starts at `row`.

    A least-squares polynomial through the faces and the sensors that have a reading there, of the
    degree chosen or the highest that these points give. The case's given coefficients hold at the
    record's first row.
    """
    count = profile_degree(case) + 1
    given = case.choices.initial_coefficients
    if given is not None and row == 0:
        still = np.zeros((count, len(case.sensors)))
        return Profile(np.pad(np.asarray(given, float), (0, count - len(given))), still, None)
    record, length = case.record, case.wall.length
    places = np.array([0.0, 1.0, *(sensor.position / length for sensor in case.sensors)])
    readings = np.concatenate([record.faces[row], record.sensors[row]])
    there = np.isfinite(readings)
    degree = min(case.choices.initial_profile, int(there.sum()) - 1)
    basis = np.vander(places[there], degree + 1, increasing=True)
    per_reading = np.zeros((count, len(places)))
    per_reading[: degree + 1, there] = np.linalg.pinv(basis)
    coefficients = per_reading[:, there] @ readings[there]
    misfit = basis @ coefficients[: degree + 1] - readings[there]
    return Profile(coefficients, per_reading[:, 2:], float(np.sqrt(np.mean(misfit**2))))


def dimensionless_profile(coefficients: np.ndarray, scale: Scales) -> np.ndarray:
    """A profile's coefficients in u: the constant alone carries T_min."""
    shifted = np.array(coefficients, float)
    shifted[0] -= scale.temperature_min
    return shifted / scale.temperature


PROFILE_MODES = 8
_LEAST_SPAN = 1.0  # K, of the temperatures that the initial profile may lie between


def window_span(case: Case, window: Window) -> float:
    """From the coldest reading of a window to the warmest, K, at least `_LEAST_SPAN`."""
    part = case.record.window(window.row, window.rows)
    readings = np.concatenate([part.faces.ravel(), part.sensors.ravel()])
    return max(_LEAST_SPAN, float(np.nanmax(readings) - np.nanmin(readings)))
