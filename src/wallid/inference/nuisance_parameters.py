"""What is free beside the diffusivity in one window of a case: offsets, position errors, the initial profile.

None of it is noise: each is a constant with a prior, which the case states (`offset_std`, `position_std`,
`face_position_std`) or the record's span gives (the initial profile, whose polynomial goes through few readings).

Sensors on one logger share some of its noise. Where the faces hardly vary, the share that the inner sensors have in
common with them looks like heat that comes through at once, an endless diffusivity. What of a face's readings may be
noise (a Wiener filter by the noise as stated) is therefore let into the inner readings, with a free share.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import scipy

from .._internal.arrays import on_device
from ..case.case_definition import Case
from ..case.initial_profile import PROFILE_MODES, fit_profile, scales, window_span
from ..case.time_window import Window
from ..case.wall_and_sensors import SIDES
from ..models.flux_plates import flux_gain_std, fluxes_of
from ..models.plate_model import full_order_model_with_plates
from ..models.sensitivity_equations import run
from ..models.state_space import StateSpace
from ..models.wall_parameters import free_wall_parameters
from ..models.window_inputs import WindowData
from .likelihood import NuisanceModel
from .position_errors import face_position_response, sensor_position_response

CONDUCTIVITY_STD = 3.0  # of ln(conductivity): wide
_SMOOTHED = 9  # frequencies
_DIFFERENCE = 1e-3  # prior standard deviations: an error of a millionth, far over round-off


@dataclass(frozen=True)
class NuisanceParameters:
    """Which parameters are free, in their order: offsets, positions, the faces' places, common noise, modes.

    Args:
        offsets, positions: the sensors that have one, by place.
        depths: the faces whose sensor may sit elsewhere.
        common: the faces, whose noise the inner sensors may share.
        modes: how many.
        structure: what of the wall itself is free, after the faces' places (`structure`).
        fluxes: the faces ("left", "right") with a plate: ln(conductivity) and the plates' gains come last.
    """

    offsets: tuple[int, ...]
    positions: tuple[int, ...]
    common: tuple[int, ...]
    modes: int
    fluxes: tuple[str, ...] = ()
    structure: tuple[str, ...] = ()
    depths: tuple[int, ...] = ()

    @property
    def count(self) -> int:
        """Of all of them."""
        return self.conductivity + (1 + len(self.fluxes) if self.fluxes else 0)

    @property
    def conductivity(self) -> int:
        """The place of ln(conductivity), where there is a flux."""
        return self.linear + self.modes

    @property
    def constants(self) -> np.ndarray:
        """Among ln(alpha) and all of these, the constant errors of instruments: offsets, places, gains."""
        place = np.arange(1 + self.count)
        return ((place > 0) & (place <= self.errors)) | (place > self.conductivity + 1)

    @property
    def errors(self) -> int:
        """Of offsets and places."""
        return len(self.offsets) + len(self.positions) + len(self.depths)

    @property
    def of_positions(self) -> slice:
        """The sensors' places among all that is free."""
        return slice(len(self.offsets), len(self.offsets) + len(self.positions))

    @property
    def of_depths(self) -> slice:
        """Those of the faces' sensors."""
        return slice(self.of_positions.stop, self.errors)

    @property
    def of_structure(self) -> slice:
        """The parameters of the wall itself among all that is free."""
        return slice(self.errors, self.errors + len(self.structure))

    @property
    def linear(self) -> int:
        """Of all before the initial profile's modes."""
        return self.errors + len(self.structure) + len(self.common)


def nuisance_parameters_of(case: Case, window: Window) -> NuisanceParameters:
    """What a case leaves free: no mode where the initial profile was given."""
    known = fit_profile(case, window.row).eps_2 is None
    plates = fluxes_of(case)
    return NuisanceParameters(
        offsets=tuple(s for s, sensor in enumerate(case.sensors) if sensor.offset_std > 0),
        positions=tuple(s for s, sensor in enumerate(case.sensors) if sensor.position_std > 0),
        common=(0, 1) if case.record.boundary_noise_std > 0 and case.sensors else (),
        modes=0 if known else min(PROFILE_MODES, case.choices.nodes - 2),
        fluxes=plates,
        structure=free_wall_parameters(case),
        depths=(0, 1) if case.record.face_position_std > 0 else (),
    )


class InstrumentError(NamedTuple):
    """A constant error of an instrument, and what the case states of it.

    Args:
        kind: as an estimate has it. name: of the sensor or the face.
        of: whose it is, in words.
        std: of its prior, in `unit`.
    """

    kind: Literal["offsets", "positions", "face_positions"]
    name: str
    of: str
    std: float
    unit: str


def instrument_errors_of(case: Case, names: NuisanceParameters) -> list[InstrumentError]:
    """The offsets and places that are free, in their order."""
    offsets, sensors = ([case.sensors[s] for s in those] for those in (names.offsets, names.positions))
    std, faces = case.record.face_position_std, [SIDES[side] for side in names.depths]
    return [
        *(InstrumentError("offsets", sensor.name, sensor.name, sensor.offset_std, "K") for sensor in offsets),
        *(InstrumentError("positions", sensor.name, sensor.name, sensor.position_std, "m") for sensor in sensors),
        *(InstrumentError("face_positions", face, f"the {face} face's sensor", std, "m") for face in faces),
    ]


def linearise_nuisance(
    case: Case,
    window: Window,
    data: WindowData,
    names: NuisanceParameters,
    start: float,
    diffusivity: float,
    found: np.ndarray,
    large: StateSpace,
    conductivity: float = 1.0,
) -> NuisanceModel:
    """What is free as it acts about a diffusivity and the parameters found so far.

    Args:
        start, diffusivity: m2/s; ln(diffusivity/start) is where the positions are linear.
        found: parameters in prior standard deviations, about whose positions the model is made linear.
        large: the case's large model with all outputs, at the structure found so far.
        conductivity: W/m/K, about which that of a case with a flux is looked for.
    """
    columns, at, moved, moved_slope = _columns(case, window, data, names, diffusivity, found)
    modes = names.modes
    return NuisanceModel(
        columns=columns,
        at=at,
        moved=moved,
        moved_slope=moved_slope,
        log_alpha=math.log(diffusivity / start),
        rates=np.asarray(large.A)[::-1][:modes],
        shapes=np.asarray(large.C)[:, ::-1][:, :modes],
        mode_std=window_span(case, window) / np.arange(1, modes + 1),
        flux=np.full(len(names.fluxes), conductivity / case.wall.length * float(data.temperature)),
        gain_std=np.full(len(names.fluxes), flux_gain_std(case)),
        log_std=CONDUCTIVITY_STD,
    )


def _columns(
    case: Case,
    window: Window,
    data: WindowData,
    names: NuisanceParameters,
    diffusivity: float,
    found: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """All that is linear: columns, where they are, what that adds and its slope, as `Free` has them."""
    rows, channels = data.observed.shape
    sensors = channels - len(names.fluxes)
    columns, at = np.zeros((names.linear, rows, channels)), np.zeros(names.linear)
    moved, moved_slope = np.zeros((2, rows, channels))
    structure = at[names.of_structure] = found[names.of_structure]
    for k, s in enumerate(names.offsets):
        columns[k, :, s] = case.sensors[s].offset_std
    if names.positions:
        places = names.of_positions
        gradient, moved[:, :sensors], moved_slope[:, :sensors], at[places] = sensor_position_response(
            case, data, names.positions, diffusivity, found[places], structure
        )
        for k, s in enumerate(names.positions, start=places.start):
            columns[k, :, s] = case.sensors[s].position_std * gradient[:, s]
    if names.depths:
        columns[names.of_depths] = face_position_response(
            case, data, diffusivity, full_order_model_with_plates(case, structure, gradients=True)
        )
    for k in range(len(structure)):
        columns[names.errors + k] = _along(case, data, diffusivity, structure, k)
    faces = np.asarray(case.record.window(window.row, window.rows).faces)
    for k, side in enumerate(names.common, start=names.of_structure.stop):
        columns[k, :, :sensors] = noise_within(faces[:, side], case.record.boundary_noise_std)[:, None]
    return columns, at, moved, moved_slope


def noise_within(readings: np.ndarray, std: float) -> np.ndarray:
    """What of a face's readings may be white noise of this size, K: `min(1, std^2 / P)` of each frequency.

    `P` is the readings' own power, smoothed over neighbouring frequencies.
    """
    spectrum = np.asarray(scipy.fft.dct(readings - readings.mean(), type=2, norm="ortho"))
    power = scipy.ndimage.uniform_filter1d(spectrum**2, min(_SMOOTHED, len(readings)), mode="nearest")
    share = std**2 / np.maximum(power, std**2)
    return np.asarray(scipy.fft.idct(share * spectrum, type=2, norm="ortho"))


def _along(case: Case, data: WindowData, diffusivity: float, structure: np.ndarray, place: int) -> np.ndarray:
    """What one prior standard deviation more of a parameter of the wall makes of the outputs, K, by differences."""
    fourier, ends = on_device(scales(case).fourier(diffusivity)), []
    for step in (-_DIFFERENCE, _DIFFERENCE):
        values = structure.copy()
        values[place] += step
        ends.append(np.asarray(run(full_order_model_with_plates(case, values), fourier, data)[0]))
    return float(data.temperature) * (ends[1] - ends[0]) / (2 * _DIFFERENCE)
