"""The Jacobian and the noise covariance of binned readings, sensor by sensor, from which the information follows.

Derivatives and face response come from `predicted_response`. Rows are averaged in bins as in the estimate.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy
from jaxtyping import Float

from ..case.case_definition import Case
from ..case.initial_profile import fit_profile, window_temperature_range
from ..case.time_window import Window
from ..case.wall_and_sensors import Sensor
from ..inference.noise_covariance import MOST_READINGS
from ..inference.nuisance_parameters import CONDUCTIVITY_STD, wiener_filtered_noise
from ..inference.position_errors import face_position_flux_jacobian, face_position_jacobian
from ..models.flux_plates import conductance_of, flux_gain_std, flux_noise_std, fluxes_of
from .predicted_response import PredictedResponse, response_to_sampled_faces


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
        shared: derivatives with respect to ln(alpha), face sensor positions, common face noise, initial modes and,
            with plates, ln(conductivity); nuisance parameters per prior standard deviation, K, `(bin, shared)`.
        own: derivatives with respect to its offset and position error, or to its calibration error, K, `(bin, own)`.
        face_noise: effect of the faces' noise, K. variance: of its own noise, K2, `(bin,)`.
        present: the number of readings in each bin, as bytes: the key under which a whitening is cached.
    """

    shared: Float[np.ndarray, "bin shared"]
    own: Float[np.ndarray, "bin own"]
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
        whitening_cache: whitenings already computed.
    """

    case: Case
    predicted: PredictedResponse
    starts: np.ndarray
    rows: int
    bin_rows: int = 1
    stride: int = 1
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
        self.has_plates = bool(fluxes_of(self.case))
        self.conductance = conductance_of(self.case) if self.has_plates else 1.0

    def face_noise(self, index: int) -> np.ndarray:
        """Effect of one standard deviation of the faces' white noise on an output, K, `(bin, face and bin)`."""
        if index not in self.face_noise_cache:
            std = self.case.record.boundary_noise_std / math.sqrt(self.bin_rows)
            parts = [std * scipy.linalg.toeplitz(face, np.zeros(self.bins)) for face in self.bin_response[:, :, index]]
            self.face_noise_cache[index] = np.concatenate(parts, axis=1)
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
        face_positions = self.face_position_derivatives(sensitivity, gradient, index)
        shared = [sensitivity, *face_positions, *self.common_face_noise(window), *self.initial_modes(window, index)]
        if self.has_plates:
            shared.append(np.zeros(len(sensitivity)))  # temperatures do not depend on the conductivity
        own = []
        if sensor.offset_std > 0:
            own.append(np.full(len(sensitivity), sensor.offset_std))
        if sensor.position_std > 0:
            own.append(sensor.position_std * gradient)
        return self._binned_contribution(index, shared, own, sensor.noise_std, present)

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
            *((index, self._plate_contribution(window, index, used)) for index, used in plates),
        ]

    def _plate_contribution(self, window: int, index: int, present: np.ndarray) -> Contribution:
        case, rows = self.case, slice(None, None, self.stride)
        sensitivity = self.predicted.sensitivity[window, rows, index]
        flux = self.predicted.temperature[window, rows, index]
        std, gain_std = case.record.face_position_std, flux_gain_std(case)
        face_positions = std * face_position_flux_jacobian(sensitivity, flux, case.wall.length) if std > 0 else []
        common = [np.zeros(len(sensitivity)) for _ in self.common_face_noise(window)]
        shared = [sensitivity, *face_positions, *common, *self.initial_modes(window, index), CONDUCTIVITY_STD * flux]
        own = [gain_std * flux] if gain_std > 0 else []
        return self._binned_contribution(index, shared, own, flux_noise_std(case) / self.conductance, present)

    def _binned_contribution(
        self,
        index: int,
        shared: Sequence[np.ndarray],
        own: Sequence[np.ndarray],
        noise_std: float,
        present: np.ndarray | None,
    ) -> Contribution:
        """A contribution from derivatives at each row, averaged in bins."""
        present = np.ones(len(shared[0]), bool) if present is None else present
        values, count = self.binned(np.column_stack([*shared, *own]), present)
        filled = count > 0
        return Contribution(
            shared=values[filled, : len(shared)],
            own=values[filled, len(shared) :],
            face_noise=self.face_noise(index)[filled],
            variance=noise_std**2 / count[filled],
            present=count.tobytes(),
        )

    def face_position_derivatives(self, sensitivity: np.ndarray, gradient: np.ndarray, index: int) -> np.ndarray:
        """Effect of one standard deviation of each face sensor's position on an output, K, `(face, time)`."""
        std, position = self.case.record.face_position_std, self.predicted.positions[index]
        if std == 0.0:
            return np.zeros((0, len(sensitivity)))
        return std * face_position_jacobian(sensitivity, gradient, position, self.case.wall.length)

    def binned(
        self, values: Float[np.ndarray, "time column"], present: np.ndarray
    ) -> tuple[Float[np.ndarray, "bin column"], Float[np.ndarray, " bin"]]:
        """The mean over the rows present in each bin (0 in an empty one), and their number."""
        count = self._bin_sums(present[:, None].astype(float))
        return self._bin_sums(values * present[:, None]) / np.maximum(count, 1.0), count[:, 0]

    def _bin_sums(self, values: np.ndarray) -> np.ndarray:
        missing = ((0, self.bins * self.bin_rows - len(values)), (0, 0))
        return np.pad(values, missing).reshape(self.bins, self.bin_rows, -1).sum(axis=1)

    def common_face_noise(self, window: int) -> list[np.ndarray]:
        """One standard deviation of the faces' noise that all sensors of one logger may have in common, K."""
        std = self.case.record.boundary_noise_std
        if std == 0.0 or not self.case.sensors:
            return []
        return [wiener_filtered_noise(face, std) for face in self.predicted.faces[window, :: self.stride].T]

    def initial_modes(self, window: int, index: int) -> np.ndarray:
        """One prior standard deviation of each initial-profile mode, K, `(mode, time)`; none for a known profile."""
        row = int(self.starts[window])
        if fit_profile(self.case, row).eps_2 is None:
            return np.zeros((0, 0))
        span = window_temperature_range(self.case, Window(row, self.rows))
        modes = self.predicted.initial_modes[:, :: self.stride, index]
        return span / np.arange(1, len(modes) + 1)[:, None] * modes

    def whitening(self, contributions: Sequence[tuple[int, Contribution]]) -> Whitening:
        """The whitening of several sensors; computed once for the same sensors with the same missing readings."""
        key = tuple((index, one.present) for index, one in contributions)
        if key not in self.whitening_cache:
            whitening = Whitening.empty(2 * self.bins)
            for _, one in contributions:
                whitening = whitening.with_sensor(one.face_noise, one.variance)
            self.whitening_cache[key] = whitening
        return self.whitening_cache[key]


def whitened(contributions: Sequence[Contribution], whitening: Whitening) -> Float[np.ndarray, "reading param"]:
    """`L^-1 J` for ln(alpha), the nuisance parameters common to all sensors, then those of each sensor."""
    own = sum(one.own.shape[1] for one in contributions)
    shared = contributions[0].shared.shape[1]
    J = np.zeros((sum(len(one.shared) for one in contributions), shared + own))
    row, column = 0, shared
    for one in contributions:
        J[row : row + len(one.shared), :shared] = one.shared
        J[row : row + len(one.own), column : column + one.own.shape[1]] = one.own
        row, column = row + len(one.shared), column + one.own.shape[1]
    return whitening.whiten(J)


def rows_per_bin(readings: int) -> int:
    """The number of rows averaged in a bin so that the dense covariance stays small enough."""
    return max(1, math.ceil(readings / MOST_READINGS))
