"""The Jacobian and the noise covariance of binned readings, sensor by sensor, from which the information follows.

Derivatives and face response come from `predicted_response`. Rows are averaged in bins as in the estimate.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy
from jaxtyping import Float

from ..case.case_definition import Case
from ..case.initial_profile import fit_profile, window_temperature_range
from ..case.time_window import Window
from ..case.wall_and_sensors import SIDES, Sensor
from ..inference.common_noise import wiener_filtered_noise
from ..inference.likelihood import LOG_CONDUCTIVITY, LOG_DIFFUSIVITY, PLATE_GAIN, PROFILE_MODE
from ..inference.noise_covariance import MAX_READINGS
from ..inference.nuisance_kinds import CommonNoise, FacePositions, SensorOffsets, SensorPositions
from ..inference.nuisance_parameters import CONDUCTIVITY_STD
from ..inference.parameters import kind_of
from ..inference.position_errors import face_position_flux_jacobian, face_position_jacobian
from ..models.flux_plates import flux_gain_std, flux_noise_std, fluxes_of, wall_conductance
from .predicted_response import PredictedResponse, response_to_sampled_faces

OWN_KINDS = (SensorOffsets.kind, SensorPositions.kind, PLATE_GAIN)
"""The kinds of parameters that belong to one sensor or plate alone."""


@dataclass(frozen=True, eq=False)
class Whitening:
    """The Cholesky factor of the readings' covariance, extended sensor by sensor.

    Args:
        cholesky: L with `R = L L'`, K, `(reading, reading)`.
        face_noise: effect of one standard deviation of each face's noise in each bin, K, `(reading, face and bin)`.
    """

    cholesky: np.ndarray
    face_noise: np.ndarray

    @staticmethod
    def empty(bins: int) -> Whitening:
        """The factor before the first sensor."""
        return Whitening(np.zeros((0, 0)), np.zeros((0, bins)))

    def whiten(self, columns: np.ndarray) -> np.ndarray:
        """`L^-1` times columns, `(reading, column)`."""
        return scipy.linalg.solve_triangular(self.cholesky, columns, lower=True)

    def with_sensor(self, face_noise: np.ndarray, variance: np.ndarray) -> Whitening:
        """The factor with the readings of one more sensor (block Cholesky update)."""
        L, cross = self.cholesky, self.face_noise @ face_noise.T
        lower = scipy.linalg.solve_triangular(L, cross, lower=True) if len(L) else L.reshape(0, len(face_noise))
        corner = np.linalg.cholesky(face_noise @ face_noise.T + np.diag(variance) - lower.T @ lower)
        extended = np.block([[L, np.zeros_like(lower)], [lower.T, corner]])
        return Whitening(extended, np.concatenate([self.face_noise, face_noise]))


@dataclass(frozen=True, eq=False)
class Contribution:
    """The binned readings of one sensor or plate in one window: derivatives and noise.

    Args:
        derivatives: by the name of the parameter (as in `inference.nuisance_parameters`), per prior standard deviation
            (of ln(alpha): per 1), K, each `(bin,)`.
        face_noise: effect of the faces' noise, K. variance: of its own noise, K2, `(bin,)`.
        present: the number of readings in each bin, as bytes: the key under which a whitening is cached.
    """

    derivatives: dict[str, np.ndarray]
    face_noise: np.ndarray
    variance: np.ndarray
    present: bytes


@dataclass(eq=False)
class WindowContributions:
    """The contributions of sensors and plates in several windows, at one diffusivity.

    Args:
        predicted: the predicted response in each window.
        starts: first rows of the windows. rows: of the record in each window.
        bin_rows: readings averaged in one bin.
        stride: rows of the predicted response between two readings, for faces and sensors alike.
        known_between_rows: whether the faces are known between the rows, because each row is the mean of finer ones.
        whitening_cache: whitenings already computed.
    """

    case: Case
    predicted: PredictedResponse
    starts: np.ndarray
    rows: int
    bin_rows: int = 1
    stride: int = 1
    known_between_rows: bool = False
    whitening_cache: dict[tuple, Whitening] = field(default_factory=dict)

    def __post_init__(self) -> None:
        response = self.predicted.face_response
        response = response if self.stride == 1 else response_to_sampled_faces(response, self.stride)
        rows = response.shape[1]
        self.bins = -(-rows // self.bin_rows)
        padded = np.pad(response, ((0, 0), (0, self.bins * self.bin_rows - rows), (0, 0)))
        step_response = np.cumsum(padded, axis=1).reshape(2, self.bins, self.bin_rows, -1).mean(axis=2)
        # response of a bin's mean to a face temperature that changes for one entire bin, as in NoiseShape
        self.bin_response = np.diff(step_response, axis=1, prepend=0.0)
        self.face_noise_cache: dict[int, np.ndarray] = {}
        self.common_noise_cache: dict[int, list[np.ndarray]] = {}
        self.profile_span_cache: dict[int, float | None] = {}
        self.has_plates = bool(fluxes_of(self.case))
        self.conductance = wall_conductance(self.case) if self.has_plates else 1.0

    @cached_property
    def face_std(self) -> np.ndarray:
        """Standard deviation of each face's mean over a bin, K: its noise, and its errors between rows as if white.

        With plates only the noise: what the faces do between rows is part of a noise that is estimated.
        """
        record = self.case.record
        variance = np.full(2, record.boundary_noise_std**2)
        if not self.has_plates and not self.known_between_rows:
            steps_per_row = max(1, (self.predicted.faces.shape[1] - 1) // (self.rows - 1))
            errors = record.face_errors_at(max(1, self.stride // steps_per_row)).autocovariance
            variance += errors[:, 0] + 2.0 * errors[:, 1:].sum(axis=1)
        return np.sqrt(np.maximum(variance, 0.0) / self.bin_rows)

    def face_noise(self, index: int) -> np.ndarray:
        """Effect of one standard deviation of the faces' white errors on an output, K, `(bin, face and bin)`."""
        if index not in self.face_noise_cache:
            parts = [scipy.linalg.toeplitz(face, np.zeros(self.bins)) for face in self.bin_response[:, :, index]]
            weighted = [std * part for std, part in zip(self.face_std, parts, strict=True)]
            self.face_noise_cache[index] = np.concatenate(weighted, axis=1)
        return self.face_noise_cache[index]

    def contribution(self, window: int, index: int, sensor: Sensor, present: np.ndarray | None = None) -> Contribution:
        """The contribution of a sensor at one output.

        Args:
            window: index of the window. index: of the output.
            present: rows with a reading, `(time,)`; None for all.
        """
        rows = slice(None, None, self.stride)
        sensitivity = self.predicted.sensitivity[window, rows, index]
        gradient = self.predicted.gradient[window, rows, index]
        derivatives = {LOG_DIFFUSIVITY: sensitivity}
        if (std := self.case.record.face_position_std) > 0:
            position, length = self.predicted.positions[index], self.case.wall.length
            moved = std * face_position_jacobian(sensitivity, gradient, position, length)
            derivatives |= _named(FacePositions.kind, SIDES, moved)
        derivatives |= self.common_face_noise(window) | self.initial_modes(window, index)
        if sensor.offset_std > 0:
            derivatives[f"{SensorOffsets.kind}[{sensor.name}]"] = np.full(len(sensitivity), sensor.offset_std)
        if sensor.position_std > 0:
            derivatives[f"{SensorPositions.kind}[{sensor.name}]"] = sensor.position_std * gradient
        return self._binned_contribution(index, derivatives, sensor.noise_std, present)

    def contributions_of_case(
        self, window: int, present: np.ndarray, flux_present: np.ndarray
    ) -> list[tuple[int, Contribution]]:
        """The contributions of the case's sensors and plates, each with the index of its output.

        Args:
            present: where a temperature is present, `(time, sensor)`.
            flux_present: where a flux is present and used, `(time, flux)`.
        """
        plates = enumerate(flux_present.T, start=len(self.predicted.positions))
        return [
            *((s, self.contribution(window, s, one, present[:, s])) for s, one in enumerate(self.case.sensors)),
            *((index, self.plate_contribution(window, index, used)) for index, used in plates),
        ]

    def plate_contribution(self, window: int, index: int, present: np.ndarray) -> Contribution:
        """The contribution of a plate of the case.

        Args:
            window: index of the window. index: of the output.
            present: rows whose reading is used, `(time,)`.
        """
        case, rows = self.case, slice(None, None, self.stride)
        sensitivity = self.predicted.sensitivity[window, rows, index]
        flux = self.predicted.temperature[window, rows, index]
        derivatives = {LOG_DIFFUSIVITY: sensitivity}
        if (std := case.record.face_position_std) > 0:
            moved = std * face_position_flux_jacobian(sensitivity, flux, case.wall.length)
            derivatives |= _named(FacePositions.kind, SIDES, moved)
        derivatives |= self.initial_modes(window, index) | {LOG_CONDUCTIVITY: CONDUCTIVITY_STD * flux}
        if (gain_std := flux_gain_std(case)) > 0:
            derivatives[f"{PLATE_GAIN}[{fluxes_of(case)[index - len(self.predicted.positions)]}]"] = gain_std * flux
        return self._binned_contribution(index, derivatives, flux_noise_std(case) / self.conductance, present)

    def _binned_contribution(
        self, index: int, derivatives: dict[str, np.ndarray], noise_std: float, present: np.ndarray | None
    ) -> Contribution:
        """A contribution from derivatives at each row, averaged in bins."""
        present = np.ones(len(derivatives[LOG_DIFFUSIVITY]), bool) if present is None else present
        values, count = self.binned(np.column_stack(list(derivatives.values())), present)
        filled = count > 0
        return Contribution(
            derivatives=dict(zip(derivatives, values[filled].T, strict=True)),
            face_noise=self.face_noise(index)[filled],
            variance=noise_std**2 / count[filled],
            present=count.tobytes(),
        )

    def binned(
        self, values: Float[np.ndarray, "time column"], present: np.ndarray
    ) -> tuple[Float[np.ndarray, "bin column"], Float[np.ndarray, " bin"]]:
        """The mean over the rows present in each bin (0 in an empty one), and their number."""
        count = self._bin_sums(present[:, None].astype(float))
        return self._bin_sums(values * present[:, None]) / np.maximum(count, 1.0), count[:, 0]

    def _bin_sums(self, values: np.ndarray) -> np.ndarray:
        missing = ((0, self.bins * self.bin_rows - len(values)), (0, 0))
        return np.pad(values, missing).reshape(self.bins, self.bin_rows, -1).sum(axis=1)

    def common_face_noise(self, window: int) -> dict[str, np.ndarray]:
        """One standard deviation of the faces' noise that all sensors of one logger may have in common, K."""
        std = self.case.record.boundary_noise_std
        if std == 0.0 or not self.case.sensors:
            return {}
        if window not in self.common_noise_cache:
            faces = self.predicted.faces[window, :: self.stride].T
            self.common_noise_cache[window] = [wiener_filtered_noise(face, std) for face in faces]
        return _named(CommonNoise.kind, SIDES, self.common_noise_cache[window])

    def initial_modes(self, window: int, index: int) -> dict[str, np.ndarray]:
        """One prior standard deviation of each initial-profile mode, K, `(time,)`; none for a known profile."""
        if window not in self.profile_span_cache:
            row = int(self.starts[window])
            known = fit_profile(self.case, row).eps_2 is None
            span = None if known else window_temperature_range(self.case, Window(row, self.rows))
            self.profile_span_cache[window] = span
        if (span := self.profile_span_cache[window]) is None:
            return {}
        modes = self.predicted.initial_modes[:, :: self.stride, index]
        numbers = range(1, len(modes) + 1)
        return _named(PROFILE_MODE, numbers, [span / k * mode for k, mode in zip(numbers, modes, strict=True)])

    def whitening(self, contributions: Sequence[tuple[int, Contribution]]) -> Whitening:
        """The whitening of several sensors; computed once for the same sensors with the same missing readings."""
        key = tuple((index, one.present) for index, one in contributions)
        if key not in self.whitening_cache:
            whitening = Whitening.empty(2 * self.bins)
            for _, one in contributions:
                whitening = whitening.with_sensor(one.face_noise, one.variance)
            self.whitening_cache[key] = whitening
        return self.whitening_cache[key]


def _named(kind: str, targets: Iterable[object], values: Iterable[np.ndarray]) -> dict[str, np.ndarray]:
    return {f"{kind}[{target}]": value for target, value in zip(targets, values, strict=True)}


def parameter_columns(contributions: Sequence[Contribution]) -> dict[tuple[int | None, str], int]:
    """The column of each parameter: ln(alpha) first, those common to all sensors, then those of each sensor.

    A parameter of one sensor or plate has the number of its contribution as a key beside its name, since a candidate
    sensor may be there twice.
    """
    common = [(None, name) for one in contributions for name in one.derivatives if kind_of(name) not in OWN_KINDS]
    own = [(k, name) for k, one in enumerate(contributions) for name in one.derivatives if kind_of(name) in OWN_KINDS]
    # ln(conductivity) after the others: temperatures do not depend on it
    ordered = sorted(dict.fromkeys(common), key=lambda key: key[1] == LOG_CONDUCTIVITY)
    return {key: column for column, key in enumerate([*ordered, *own])}


def whitened(contributions: Sequence[Contribution], whitening: Whitening) -> Float[np.ndarray, "reading param"]:
    """`L^-1 J`, with a column for each parameter (`parameter_columns`)."""
    columns = parameter_columns(contributions)
    J = np.zeros((sum(len(one.variance) for one in contributions), len(columns)))
    row = 0
    for k, one in enumerate(contributions):
        for name, values in one.derivatives.items():
            J[row : row + len(values), columns[k if kind_of(name) in OWN_KINDS else None, name]] = values
        row += len(one.variance)
    return whitening.whiten(J)


def rows_per_bin(readings: int) -> int:
    """The number of rows averaged in a bin so that the dense covariance stays small enough."""
    return max(1, math.ceil(readings / MAX_READINGS))
