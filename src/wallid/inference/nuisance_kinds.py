"""The kinds of nuisance parameters of a window: each with its parameters and their linear effect on the readings.

They are not noise: each is a constant with a prior. The case states the prior (`offset_std`, `position_std`,
`face_position_std`), or it follows from the record. A new kind is one more entry of `NUISANCE_KINDS`, or of the
argument `kinds` of an estimate.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from .._internal.arrays import on_device
from ..case.case_definition import Case
from ..case.initial_profile import scales
from ..case.time_window import Window
from ..case.wall_and_sensors import SIDES
from ..models.flux_plates import fluxes_of, full_order_model_with_plates, initial_conductivity
from ..models.sensitivity_equations import simulate_window
from ..models.wall_parameters import free_wall_parameters, prior_std_of
from ..models.window_inputs import WindowData
from .common_noise import common_noise_of_face
from .likelihood import PLATE_GAIN
from .parameters import Parameter, Parameters, target_of
from .position_errors import face_position_response, sensor_position_response
from .sensor_heights import (
    COMPONENTS,
    HEIGHT_KIND,
    HeightComponents,
    candidate_heights,
    component_name,
    has_uncertain_height,
    height_deviations,
    principal_components,
)

CONTACT_RESISTANCE, CONTACT_STD = 0.005, 1.2  # m2 K/W, the prior median; and the standard deviation of its logarithm
_CONTACT_STEP = 0.05  # prior standard deviations
_DIFFERENCE_STEP = 1e-3  # prior standard deviations: a relative error of 1e-6, far above round-off


@dataclass(frozen=True, eq=False)
class Linearisation:
    """The point about which the readings are linear in the nuisance parameters.

    Args:
        case, window: the case and the window.
        data: of the window; its outputs are the sensors, then the plates.
        diffusivity: m2/s.
        parameters: with the estimates so far, in their own units.
    """

    case: Case
    window: Window
    data: WindowData
    diffusivity: float
    parameters: Parameters

    @cached_property
    def sensor_count(self) -> int:
        """The number of inner sensors."""
        return len(self.case.sensors)

    @cached_property
    def shape(self) -> tuple[int, int]:
        """The shape of the readings, `(time, channel)`."""
        rows, channels = self.data.observed.shape
        return rows, channels

    def in_prior_std(self, names: Sequence[str]) -> np.ndarray:
        """The estimates of some parameters so far, over their prior standard deviations."""
        return self.parameters.in_prior_std(names)

    @cached_property
    def wall(self) -> np.ndarray:
        """The estimates of the wall's own parameters so far, over their prior standard deviations."""
        return self.in_prior_std(self.parameters.of_kind(WallParameters.kind))

    @property
    def gains(self) -> np.ndarray:
        """The estimate of each plate's calibration error so far."""
        return np.asarray(self.parameters.vector(self.parameters.of_kind(PLATE_GAIN)))

    @cached_property
    def height_components(self) -> dict[int, HeightComponents]:
        """The components of what each sensor of unknown height reads, by its index."""
        found = {}
        for k, sensor in enumerate(self.case.sensors):
            if has_uncertain_height(self.case, sensor):
                deviations = height_deviations(self.case, self.data, self.diffusivity, sensor, self.wall)
                found[k] = principal_components(deviations, candidate_heights(self.case, sensor)[1])
        return found

    @cached_property
    def height_weights(self) -> dict[int, np.ndarray]:
        """The weights of each such sensor's heights at the estimates so far, by its index."""
        z = self.in_prior_std(self.parameters.of_kind(SensorHeights.kind)).reshape(-1, COMPONENTS)
        pairs = zip(self.height_components.items(), z, strict=True)
        return {k: found.weights_at(amplitudes) for (k, found), amplitudes in pairs}


class LinearEffect(NamedTuple):
    """The effect of some parameters on the readings, linear about a point.

    Args:
        columns: change of the readings for one prior standard deviation of each, K, `(param, time, channel)`.
        linearised_at: the point, in prior standard deviations, `(param,)`.
        change, change_slope: change of the readings at the point, K, and its derivative with respect to ln(alpha), for
            an effect that is not proportional to its parameters; `(time, channel)`.
    """

    columns: np.ndarray
    linearised_at: np.ndarray
    change: np.ndarray | float = 0.0
    change_slope: np.ndarray | float = 0.0


class NuisanceKind(ABC):
    """A kind of nuisance parameters: its parameters and their effect on the readings.

    Attributes:
        kind: the beginning of its parameters' names, such as "sensor_offset".
        source_of_variance: its name in `GLSFit.variance_shares`.
        is_instrument_error: whether it is a constant error of an instrument, the same in every window.
    """

    kind: str
    source_of_variance: str
    is_instrument_error: bool = False

    @abstractmethod
    def parameters(self, case: Case, window: Window) -> Iterable[Parameter]:
        """Its parameters in a window of a case, with their priors."""

    @abstractmethod
    def effect(self, names: Sequence[str], point: Linearisation) -> LinearEffect:
        """The effect on the readings of the parameters of these names."""


class SensorOffsets(NuisanceKind):
    """A constant offset of each sensor's readings, K."""

    kind, source_of_variance, is_instrument_error = "sensor_offset", "offsets", True

    def parameters(self, case: Case, window: Window) -> Iterable[Parameter]:
        """One parameter for each sensor."""
        return (Parameter(f"{self.kind}[{s.name}]", "K", prior_std=s.offset_std) for s in case.sensors)

    def effect(self, names: Sequence[str], point: Linearisation) -> LinearEffect:
        """The same constant in every reading of the sensor."""
        columns = np.zeros((len(names), *point.shape))
        for k, sensor in enumerate(point.case.sensors):
            columns[k, :, k] = sensor.offset_std
        return LinearEffect(columns, np.zeros(len(names)))


class SensorPositions(NuisanceKind):
    """The true position of each sensor minus the stated one, m."""

    kind, source_of_variance, is_instrument_error = "sensor_position", "positions", True

    def parameters(self, case: Case, window: Window) -> Iterable[Parameter]:
        """One parameter for each sensor."""
        return (Parameter(f"{self.kind}[{s.name}]", "m", prior_std=s.position_std) for s in case.sensors)

    def effect(self, names: Sequence[str], point: Linearisation) -> LinearEffect:
        """The temperature gradient at each position, and the change from the stated positions to the estimates."""
        columns, linearised_at = np.zeros((len(names), *point.shape)), np.zeros(len(names))
        uncertain = tuple(k for k, sensor in enumerate(point.case.sensors) if sensor.position_std > 0)
        if not uncertain:
            return LinearEffect(columns, linearised_at)
        change, slope = np.zeros((2, *point.shape))
        estimates = point.in_prior_std([names[k] for k in uncertain])
        gradient, change[:, : point.sensor_count], slope[:, : point.sensor_count], limited = sensor_position_response(
            point.case, point.data, uncertain, point.diffusivity, estimates, point.wall
        )
        linearised_at[list(uncertain)] = limited
        for k in uncertain:
            columns[k, :, k] = point.case.sensors[k].position_std * gradient[:, k]
        return LinearEffect(columns, linearised_at, change, slope)


class SensorHeights(NuisanceKind):
    """What each sensor of unknown height in a section reads, as amplitudes of principal components over the heights."""

    kind, source_of_variance = HEIGHT_KIND, "heights"

    def parameters(self, case: Case, window: Window) -> Iterable[Parameter]:
        """Some parameters for each such sensor."""
        return (
            Parameter(f"{self.kind}[{component_name(sensor, k + 1)}]", prior_std=1.0)
            for sensor in case.sensors
            if has_uncertain_height(case, sensor)
            for k in range(COMPONENTS)
        )

    def effect(self, names: Sequence[str], point: Linearisation) -> LinearEffect:
        """The components at the point's diffusivity, the mean over the heights, and the slope of both."""
        columns, z = np.zeros((len(names), *point.shape)), point.in_prior_std(names)
        change, slope = np.zeros((2, *point.shape))
        for number, (k, found) in enumerate(point.height_components.items()):
            own = slice(COMPONENTS * number, COMPONENTS * (number + 1))
            columns[own, :, k] = found.components
            change[:, k] = found.mean + z[own] @ found.components
            slope[:, k] = found.mean_slope + z[own] @ found.component_slopes
        return LinearEffect(columns, z, change, slope)


class FacePositions(NuisanceKind):
    """The position of each face's sensor, m to the right of the face."""

    kind, source_of_variance, is_instrument_error = "face_position", "faces' places", True

    def parameters(self, case: Case, window: Window) -> Iterable[Parameter]:
        """One parameter for each face."""
        std = case.record.face_position_std
        return (Parameter(f"{self.kind}[{face}]", "m", prior_std=std) for face in SIDES)

    def effect(self, names: Sequence[str], point: Linearisation) -> LinearEffect:
        """The effect by `position_errors.face_position_response`."""
        if point.case.record.face_position_std == 0.0:
            return LinearEffect(np.zeros((len(names), *point.shape)), np.zeros(len(names)))
        model = full_order_model_with_plates(point.case, point.wall, gradients=True)
        columns = face_position_response(point.case, point.data, point.diffusivity, model)
        return LinearEffect(columns, np.zeros(len(names)))


class WallParameters(NuisanceKind):
    """The wall's own parameters: logarithms of layer conductivities, of film lengths, of a section's materials."""

    kind, source_of_variance = "wall", "layers, films and materials"

    def parameters(self, case: Case, window: Window) -> Iterable[Parameter]:
        """The parameters that the options of the case name."""
        return (
            Parameter(f"{self.kind}[{name}]", prior_std=prior_std_of(case, name)) for name in free_wall_parameters(case)
        )

    def effect(self, names: Sequence[str], point: Linearisation) -> LinearEffect:
        """The effect by central differences of the full-order model."""
        fourier, kelvin = on_device(scales(point.case).fourier_number(point.diffusivity)), float(point.data.temperature)

        def response(wall: np.ndarray) -> np.ndarray:
            readings = np.array(simulate_window(full_order_model_with_plates(point.case, wall), fourier, point.data)[0])
            readings *= kelvin
            for k, weights in point.height_weights.items():
                sensor = point.case.sensors[k]
                own = height_deviations(point.case, point.data, point.diffusivity, sensor, wall)
                readings[:, k] += weights @ own.readings
            return readings

        columns = np.zeros((len(names), *point.shape))
        for k, step in enumerate(_DIFFERENCE_STEP * np.eye(len(names))):
            columns[k] = (response(point.wall + step) - response(point.wall - step)) / (2 * _DIFFERENCE_STEP)
        return LinearEffect(columns, point.wall)


class ContactResistances(NuisanceKind):
    """The resistance between each face that has a plate and the face's sensor: adhesive, paper, a skim of plaster.

    The parameter is `ln(r / r_0)`. Without it a plate that answers late is taken for a wall that conducts less.
    """

    kind, source_of_variance, is_instrument_error = "contact", "contact resistances", True

    def parameters(self, case: Case, window: Window) -> Iterable[Parameter]:
        """One parameter for each plate."""
        return (Parameter(f"{self.kind}[{face}]", prior_std=CONTACT_STD) for face in fluxes_of(case))

    def effect(self, names: Sequence[str], point: Linearisation) -> LinearEffect:
        """The full-order model with the resistances minus the one without, and central differences of it."""
        fourier = scales(point.case).fourier_number(point.diffusivity)
        kelvin, conductivity = float(point.data.temperature), initial_conductivity(point.case, point.window)

        def response(z: np.ndarray | None) -> np.ndarray:
            contacts = (0.0, 0.0) if z is None else contact_lengths(conductivity, names, CONTACT_STD * z)
            model = full_order_model_with_plates(point.case, point.wall, contacts=contacts)
            u, theta = simulate_window(model, on_device(fourier), point.data, sensitivity=True)
            return kelvin * np.stack([np.asarray(u), fourier * np.asarray(theta)])

        z = point.in_prior_std(names)
        change, slope = response(z) - response(None)
        steps = _CONTACT_STEP * np.eye(len(names))
        columns = [(response(z + step)[0] - response(z - step)[0]) / (2.0 * _CONTACT_STEP) for step in steps]
        return LinearEffect(np.stack(columns), z, change, slope)


class CommonNoise(NuisanceKind):
    """The share of each face's noise that all sensors of one logger have in common."""

    kind, source_of_variance = "common_noise", "common noise"

    def parameters(self, case: Case, window: Window) -> Iterable[Parameter]:
        """One parameter for each face; none without an inner sensor."""
        prior_std = float(case.record.boundary_noise_std > 0)
        return (Parameter(f"{self.kind}[{face}]", prior_std=prior_std) for face in SIDES if case.sensors)

    def effect(self, names: Sequence[str], point: Linearisation) -> LinearEffect:
        """The same noise in every inner sensor: the part of the face's readings that may be noise."""
        columns = np.zeros((len(names), *point.shape))
        record = point.case.record.window(point.window.row, point.window.rows)
        for k, name in enumerate(names):
            columns[k, :, : point.sensor_count] = common_noise_of_face(record, target_of(name))[:, None]
        return LinearEffect(columns, np.zeros(len(names)))


NUISANCE_KINDS: tuple[NuisanceKind, ...] = (
    SensorOffsets(),
    SensorPositions(),
    SensorHeights(),
    FacePositions(),
    WallParameters(),
    ContactResistances(),
    CommonNoise(),
)
"""The kinds of every estimate. The initial profile and the calibration of plates are parts of the model itself."""


def contact_lengths(
    conductivity: float, names: Sequence[str], values: Sequence[float] | np.ndarray
) -> tuple[float, float]:
    """The length of wall with each face's contact resistance, m; 0 without a plate.

    Args:
        conductivity: at which the prior median of the resistance is `CONTACT_RESISTANCE`, W/m/K.
        names: of the parameters. values: `ln(r / r_0)`.
    """
    median = CONTACT_RESISTANCE * conductivity
    lengths = {target_of(name): median * math.exp(float(value)) for name, value in zip(names, values, strict=True)}
    return lengths.get("left", 0.0), lengths.get("right", 0.0)
