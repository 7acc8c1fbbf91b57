"""Heat flux plates on the faces: their readings, their noise and calibration, their outputs of a model."""

from __future__ import annotations

import math

import equinox as eqx
import numpy as np
from jaxtyping import Float

from .._internal.arrays import on_device
from ..case.case_definition import Case
from ..case.initial_profile import PROFILE_MODES, scales
from ..case.time_window import Window, entire_record
from ..case.wall_and_sensors import SIDES
from ..records.face_filter import FaceNoise
from ..records.face_variation import FaceErrors
from ..records.uniform_record import spline_slopes
from .finite_volume_wall import HeatProfile, Output
from .state_space import StateSpace
from .wall_parameters import free_wall_parameters, model_at
from .window_inputs import WindowData, boundary_inputs, full_order_model, sensor_outputs

FLUX_NOISE_STD = 1.0  # W/m2
FLUX_GAIN_STD = 0.05  # as ISO 9869-1 expects of a calibrated plate
_DECAYED = 0.01  # of a mode's initial amplitude


def fluxes_of(case: Case) -> tuple[str, ...]:
    """The faces with a flux plate."""
    return tuple(face for face in SIDES if f"flux_{face}" in case.record.regressors)


def flux_noise_std(case: Case) -> float:
    """Standard deviation of each flux reading, W/m2; `FLUX_NOISE_STD` where the case does not state it."""
    stated = case.record.flux_noise_std
    return FLUX_NOISE_STD if stated is None else stated


def flux_gain_std(case: Case) -> float:
    """Standard deviation of each plate's relative calibration error; `FLUX_GAIN_STD` where it is not stated."""
    stated = case.record.flux_gain_std
    return FLUX_GAIN_STD if stated is None else stated


def initial_conductivity(case: Case, window: Window) -> float:
    """A first value, W/m/K: as stated, else mean flux times length over the mean temperature difference, else 1."""
    if case.wall.effective_conductivity is not None:
        return case.wall.effective_conductivity
    part = case.record.window(window.row, window.rows)
    fluxes = [part.regressors[f"flux_{face}"] for face in fluxes_of(case)]
    drop = float(np.mean(part.faces[:, 0] - part.faces[:, 1]))
    read = np.concatenate([flux[np.isfinite(flux)] for flux in fluxes])
    found = float(read.mean()) / drop * case.wall.length if len(read) and abs(drop) > 1e-3 else 1.0
    return float(np.clip(found, 1e-3, 1e3)) if math.isfinite(found) and found > 0 else 1.0


def wall_conductance(case: Case) -> float:
    """k / L, by which a design scales fluxes, W/m2/K."""
    return initial_conductivity(case, entire_record(case)) / case.wall.length


def uninformative_rows(case: Case, rows: int, step: float) -> int:
    """The number of rows at a window's start whose fluxes are not used: at least one, at most a tenth.

    The flux at a face is sensitive to modes of the initial profile that are faster than the estimated ones. These rows
    last until such modes have decayed to a hundredth at the prior diffusivity. `step` is in s.
    """
    decay_time = math.log(1.0 / _DECAYED) * case.wall.length**2 / ((PROFILE_MODES + 1) * math.pi) ** 2
    return int(np.clip(np.ceil(decay_time / case.wall.diffusivity_prior / step), 1, max(1, rows // 10)))


def flux_readings(case: Case, window: Window) -> np.ndarray:
    """The plates' readings in a window, W/m2, NaN where missing or not used, `(time, flux)`."""
    readings = [case.record.regressors[f"flux_{face}"][window.as_slice] for face in fluxes_of(case)]
    flux = np.stack(readings, axis=1) if readings else np.zeros((window.rows, 0))
    unused = np.arange(window.rows) < uninformative_rows(case, window.rows, case.record.step)
    return np.where(unused[:, None], np.nan, flux)


def with_flux(case: Case, window: Window, data: WindowData) -> WindowData:
    """The window's data with the plates' readings after the sensors', W/m2, without the uninformative first rows."""
    plates = fluxes_of(case)
    if not plates or data.observed.shape[1] > len(case.sensors):  # no plates, or they are included already
        return data
    return append_flux_readings(data, flux_readings(case, window), flux_noise_std(case))


def faces_of_model(case: Case) -> tuple[Float[np.ndarray, "time face"], Float[np.ndarray, "time face"]]:
    """The faces' temperatures that drive the model, degC, and their slopes at the rows, K/s.

    They are the readings, with plates the readings without their noise. Fast noise of a face would be a large flux.
    Fitted with it, the wall's capacity is too small, as a slope is that is fitted with a noisy abscissa.
    Between the rows they are then cubic splines: a plate responds to the course just before its row.

    Source: W. A. Fuller, Measurement Error Models (1987), 1.1.
    """
    record = case.record
    if not fluxes_of(case):
        return record.faces, record.face_slopes
    faces = record.face_filter.filtered(record.faces, record.step)
    return faces, spline_slopes(faces, record.step)


def face_noise_of_model(case: Case) -> tuple[FaceNoise, FaceErrors]:
    """The noise of the temperatures that drive the model, and what they do between rows.

    With plates the noise is that of the filter's error, and what is uncertain in the filter takes the place of what the
    faces do between rows.
    """
    record = case.record
    if fluxes_of(case):
        return record.face_filter.noise, FaceErrors.of_filter(record.face_filter)
    return FaceNoise.white(record.boundary_noise_std), record.face_errors


def with_filtered_faces(case: Case, window: Window, data: WindowData) -> WindowData:
    """The window's data with the faces of `faces_of_model`."""
    if not fluxes_of(case):
        return data
    inputs = boundary_inputs(scales(case), *faces_of_model(case))[window.as_slice]
    return eqx.tree_at(lambda d: d.inputs, data, on_device(inputs))


def append_flux_readings(data: WindowData, flux: np.ndarray, noise_std: float) -> WindowData:
    """The window's data with fluxes after the sensors' readings, weighted by their noise; NaN is a missing reading."""
    present = np.isfinite(flux)
    observed = np.concatenate([np.asarray(data.observed), np.where(present, flux, 0.0)], axis=1)
    weight = np.concatenate([np.asarray(data.weight), present / noise_std], axis=1)
    return eqx.tree_at(lambda d: (d.observed, d.weight), data, (on_device(observed), on_device(weight)))


def plate_outputs(case: Case) -> list[Output]:
    """The model outputs for the case's plates."""
    positions = {"left": 0.0, "right": case.wall.length}
    return [Output(positions[face], "flux", f"flux_{face}") for face in fluxes_of(case)]


def full_order_model_with_plates(
    case: Case,
    wall_parameters: np.ndarray | None = None,
    *,
    gradients: bool = False,
    contacts: tuple[float, float] = (0.0, 0.0),
    heat: tuple[HeatProfile, ...] = (),
) -> StateSpace:
    """The full-order model of a case whose outputs are the sensors, then the flux plates.

    Args:
        case: the case.
        wall_parameters: values of the case's free wall parameters, in prior standard deviations; None for zeros.
        gradients: whether the temperature gradients at the sensors follow as further outputs.
        contacts: length of wall with the resistance between each face and its sensor, m.
        heat: profiles of heat, as inputs after the boundary temperatures.

    Returns:
        a state space with a diagonal A.
    """
    extra = [*plate_outputs(case), *(sensor_outputs(case, "gradient") if gradients else ())]
    names = free_wall_parameters(case)
    if not names and not any(contacts):
        return full_order_model(case, extra, heat=heat)
    values = np.zeros(len(names)) if wall_parameters is None else wall_parameters
    return model_at(case, names, values, [*sensor_outputs(case), *extra], contacts=contacts, heat=heat)
