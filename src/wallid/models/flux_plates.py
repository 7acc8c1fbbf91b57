"""Heat flux plates on the faces: their readings, their noise and calibration, their outputs of a model."""

from __future__ import annotations

import math

import equinox as eqx
import numpy as np

from .._internal.arrays import on_device
from ..case.case_definition import Case
from ..case.initial_profile import PROFILE_MODES
from ..case.time_window import Window, entire_record
from ..case.wall_and_sensors import SIDES
from .finite_volume_wall import Output
from .window_inputs import WindowData


def conductance_of(case: Case) -> float:
    """k / L by which a design takes fluxes, W/m2/K."""
    return first_conductivity(case, entire_record(case)) / case.wall.length


FLUX_NOISE_STD = 1.0  # W/m2
FLUX_GAIN_STD = 0.05  # as ISO 9869-1 expects of a calibrated plate
_FADED = 0.01  # of a wave of the initial profile that is gone


def fluxes_of(case: Case) -> tuple[str, ...]:
    """The faces with a flux plate."""
    return tuple(face for face in SIDES if f"flux_{face}" in case.record.regressors)


def flux_noise_std(case: Case) -> float:
    """Of each flux reading, W/m2; `FLUX_NOISE_STD` where the case does not state it."""
    stated = case.record.flux_noise_std
    return FLUX_NOISE_STD if stated is None else stated


def flux_gain_std(case: Case) -> float:
    """Of each plate's calibration, 1; `FLUX_GAIN_STD` where the case does not state it."""
    stated = case.record.flux_gain_std
    return FLUX_GAIN_STD if stated is None else stated


def first_conductivity(case: Case, window: Window) -> float:
    """Where to begin, W/m/K: what the case states, else mean fluxes over the mean drop of temperature, else 1."""
    if case.wall.effective_conductivity is not None:
        return case.wall.effective_conductivity
    part = case.record.window(window.row, window.rows)
    fluxes = [part.regressors[f"flux_{face}"] for face in fluxes_of(case)]
    drop = float(np.mean(part.faces[:, 0] - part.faces[:, 1]))
    read = np.concatenate([flux[np.isfinite(flux)] for flux in fluxes])
    found = float(read.mean()) / drop * case.wall.length if len(read) and abs(drop) > 1e-3 else 1.0
    return float(np.clip(found, 1e-3, 1e3)) if math.isfinite(found) and found > 0 else 1.0


def untold_rows(case: Case, rows: int, step: float) -> int:
    """How many rows of a window, `step` s apart, plates do not tell of: at least one, and no more than a tenth.

    Until the initial profile's waves that are shorter than its free modes have faded (at the prior diffusivity, to a
    hundredth): a face's flux feels them more than any sensor inside.
    """
    fade = math.log(1.0 / _FADED) * case.wall.length**2 / ((PROFILE_MODES + 1) * math.pi) ** 2
    return int(np.clip(np.ceil(fade / case.wall.diffusivity_prior / step), 1, max(1, rows // 10)))


def flux_readings(case: Case, window: Window) -> np.ndarray:
    """The plates' readings in a window, W/m2, NaN where there is none or it is not used, `(time, flux)`."""
    read = [case.record.regressors[f"flux_{face}"][window.as_slice] for face in fluxes_of(case)]
    flux = np.stack(read, axis=1) if read else np.zeros((window.rows, 0))
    untold = np.arange(window.rows) < untold_rows(case, window.rows, case.record.step)
    return np.where(untold[:, None], np.nan, flux)


def with_flux(case: Case, window: Window, data: WindowData) -> WindowData:
    """The experiment with the plates' readings after the sensors', W/m2, their first rows left out (`untold_rows`)."""
    plates = fluxes_of(case)
    if not plates or data.observed.shape[1] > len(case.sensors):  # none, or they are there
        return data
    return plates_beside(data, flux_readings(case, window), flux_noise_std(case))


def plates_beside(data: WindowData, flux: np.ndarray, noise_std: float) -> WindowData:
    """The experiment with fluxes after the sensors' readings, weighted by their noise; none where one is NaN."""
    there = np.isfinite(flux)
    observed = np.concatenate([np.asarray(data.observed), np.where(there, flux, 0.0)], axis=1)
    weight = np.concatenate([np.asarray(data.weight), there / noise_std], axis=1)
    return eqx.tree_at(lambda d: (d.observed, d.weight), data, (on_device(observed), on_device(weight)))


def plate_outputs(case: Case) -> list[Output]:
    """What a model gives out for the case's plates."""
    places = {"left": 0.0, "right": case.wall.length}
    return [Output(places[face], "flux", f"flux_{face}") for face in fluxes_of(case)]
