"""What sensors and plates see in windows of a record: their readings' derivatives, and the covariance of their errors.

The derivatives and the response to the faces are those of `courses`, put together in bins as the estimate's readings
are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy
from jaxtyping import Float

from ..case.case_definition import Case
from ..case.initial_profile import fit_profile, window_span
from ..case.time_window import Window
from ..case.wall_and_sensors import Sensor
from ..inference.noise_covariance import MOST_READINGS
from ..inference.nuisance_parameters import CONDUCTIVITY_STD, noise_within
from ..inference.position_errors import face_position_flux_jacobian, face_position_jacobian
from ..models.flux_plates import conductance_of, flux_gain_std, flux_noise_std, fluxes_of
from .predicted_response import PredictedResponse, held


@dataclass(frozen=True, eq=False)
class Whitening:
    """The Cholesky factor of the readings' covariance, sensor after sensor.

    Args:
        root: L, `R = L L'`. through: what each reading makes of the faces' noise in each bin, K.
    """

    root: np.ndarray
    through: np.ndarray

    @staticmethod
    def none(bins: int) -> Whitening:
        """Before the first sensor."""
        return Whitening(np.zeros((0, 0)), np.zeros((0, bins)))

    def whiten(self, columns: np.ndarray) -> np.ndarray:
        """`L^-1` times columns of readings."""
        return scipy.linalg.solve_triangular(self.root, columns, lower=True)

    def beside(self, through: np.ndarray, variance: np.ndarray) -> Whitening:
        """With one more sensor's readings."""
        shared = self.through @ through.T
        mixed = scipy.linalg.solve_triangular(self.root, shared, lower=True) if len(self.root) else self.root
        mixed = mixed.reshape(len(self.root), len(through))
        corner = np.linalg.cholesky(through @ through.T + np.diag(variance) - mixed.T @ mixed)
        root = np.block([[self.root, np.zeros_like(mixed)], [mixed.T, corner]])
        return Whitening(root, np.concatenate([self.through, through]))


@dataclass(frozen=True, eq=False)
class Contribution:
    """One sensor's or plate's binned readings in one window: derivatives and noise.

    Args:
        shared: by ln(alpha), the faces' places, common noise, modes, and with plates ln(conductivity), K.
        own: by its offset and its position error, or by its calibration, K.
        through, variance: of the faces' noise and its own, where there is a reading. present: those bins.
    """

    shared: Float[np.ndarray, "bin shared"]
    own: Float[np.ndarray, "bin own"]
    through: np.ndarray
    variance: np.ndarray
    present: bytes


@dataclass(eq=False)
class WindowContributions:
    """Windows seen at one diffusivity, with what is kept from window to window.

    Args:
        rows: of the record in each window.
        stride: rows of the courses from one reading to the next, of faces and sensors alike.
    """

    case: Case
    courses: PredictedResponse
    starts: np.ndarray
    rows: int
    bin_rows: int = 1
    stride: int = 1
    kept: dict[tuple, Whitening] = field(default_factory=dict)

    def __post_init__(self) -> None:
        answer = self.courses.response if self.stride == 1 else held(self.courses.response, self.stride)
        rows = answer.shape[1]
        self.bins = -(-rows // self.bin_rows)
        padded = np.pad(answer, ((0, 0), (0, self.bins * self.bin_rows - rows), (0, 0)))
        ends = np.cumsum(padded, axis=1).reshape(2, self.bins, self.bin_rows, -1).mean(axis=2)
        # of a bin's mean to a change of a face over a whole bin, as in NoiseModel
        self.answer = np.diff(ends, axis=1, prepend=0.0)
        self.toeplitz: dict[int, np.ndarray] = {}
        self.plated = bool(fluxes_of(self.case))
        self.conductance = conductance_of(self.case) if self.plated else 1.0

    def through(self, place: int) -> np.ndarray:
        """What the readings at a place make of white noise of the faces, K, `(bin, face and bin)`."""
        if place not in self.toeplitz:
            std = self.case.record.boundary_noise_std / math.sqrt(self.bin_rows)
            parts = [std * scipy.linalg.toeplitz(face, np.zeros(self.bins)) for face in self.answer[:, :, place]]
            self.toeplitz[place] = np.concatenate(parts, axis=1)
        return self.toeplitz[place]

    def contribution(self, window: int, place: int, sensor: Sensor, present: np.ndarray | None = None) -> Contribution:
        """What a sensor at a place sees; without `present` it has a reading in every row."""
        courses, rows = self.courses, slice(None, None, self.stride)
        slope = courses.slope[window, rows, place]
        gradient = courses.gradient[window, rows, place]
        moved = self.moved(slope, gradient, place)
        shared = [slope, *moved, *self.common(window), *self.waves(window, place)]
        if self.plated:
            shared.append(np.zeros(len(slope)))  # a temperature tells nothing of the conductivity
        own = []
        if sensor.offset_std > 0:
            own.append(np.full(len(slope), sensor.offset_std))
        if sensor.position_std > 0:
            own.append(sensor.position_std * gradient)
        return self._seen(place, shared, own, sensor.noise_std, present)

    def contributions_of_case(
        self, window: int, present: np.ndarray, read: np.ndarray
    ) -> list[tuple[int, Contribution]]:
        """What the case's sensors and plates see, each with its place among the outputs.

        Args:
            present, read: where there is a temperature, `(time, sensor)`, and a flux that is used, `(time, flux)`.
        """
        sensors, first = self.case.sensors, len(self.courses.places)
        found = [(s, self.contribution(window, s, sensor, present[:, s])) for s, sensor in enumerate(sensors)]
        return found + [(place, self._plate(window, place, there)) for place, there in enumerate(read.T, start=first)]

    def _plate(self, window: int, place: int, present: np.ndarray) -> Contribution:
        case, rows = self.case, slice(None, None, self.stride)
        slope, flux = (course[window, rows, place] for course in (self.courses.slope, self.courses.temperature))
        std, gain_std = case.record.face_position_std, flux_gain_std(case)
        moved = std * face_position_flux_jacobian(slope, flux, case.wall.length) if std > 0 else []
        common = [np.zeros(len(slope)) for _ in self.common(window)]
        shared = [slope, *moved, *common, *self.waves(window, place), CONDUCTIVITY_STD * flux]
        own = [gain_std * flux] if gain_std > 0 else []
        return self._seen(place, shared, own, flux_noise_std(case) / self.conductance, present)

    def _seen(
        self,
        place: int,
        shared: Sequence[np.ndarray],
        own: Sequence[np.ndarray],
        noise_std: float,
        present: np.ndarray | None,
    ) -> Contribution:
        """Derivatives at the rows put together."""
        present = np.ones(len(shared[0]), bool) if present is None else present
        values, count = self.binned(np.column_stack([*shared, *own]), present)
        there = count > 0
        return Contribution(
            shared=values[there, : len(shared)],
            own=values[there, len(shared) :],
            through=self.through(place)[there],
            variance=noise_std**2 / count[there],
            present=count.tobytes(),
        )

    def moved(self, slope: np.ndarray, gradient: np.ndarray, place: int) -> np.ndarray:
        """What one standard deviation of the places of the faces' sensors makes of a place's readings, K."""
        std = self.case.record.face_position_std
        if std == 0.0:
            return np.zeros((0, len(slope)))
        return std * face_position_jacobian(slope, gradient, self.courses.places[place], self.case.wall.length)

    def binned(
        self, values: Float[np.ndarray, "time column"], present: np.ndarray
    ) -> tuple[Float[np.ndarray, "bin column"], Float[np.ndarray, " bin"]]:
        """The mean of the rows present in each bin, 0 in an empty one, and how many these are."""
        count = self._total(present[:, None].astype(float))
        return self._total(values * present[:, None]) / np.maximum(count, 1.0), count[:, 0]

    def _total(self, values: np.ndarray) -> np.ndarray:
        short = ((0, self.bins * self.bin_rows - len(values)), (0, 0))
        return np.pad(values, short).reshape(self.bins, self.bin_rows, -1).sum(axis=1)

    def common(self, window: int) -> list[np.ndarray]:
        """What of the faces' readings may be noise, which sensors of one logger may share, K."""
        std = self.case.record.boundary_noise_std
        if std == 0.0 or not self.case.sensors:
            return []
        return [noise_within(face, std) for face in self.courses.faces[window, :: self.stride].T]

    def waves(self, window: int, place: int) -> np.ndarray:
        """The initial profile's free modes, K; none where it was given."""
        row = int(self.starts[window])
        if fit_profile(self.case, row).eps_2 is None:
            return np.zeros((0, 0))
        span = window_span(self.case, Window(row, self.rows))
        waves = self.courses.waves[:, :: self.stride, place]
        return span / np.arange(1, len(waves) + 1)[:, None] * waves

    def whitening(self, keys: Sequence[tuple[int, Contribution]]) -> Whitening:
        """Of several sensors at places; the same sensors with the same rows missing are gone through once."""
        key = tuple((place, seen.present) for place, seen in keys)
        if key not in self.kept:
            found = Whitening.none(2 * self.bins)
            for _, seen in keys:
                found = found.beside(seen.through, seen.variance)
            self.kept[key] = found
        return self.kept[key]


def whitened(seen: Sequence[Contribution], whitening: Whitening) -> Float[np.ndarray, "reading param"]:
    """`L^-1 J` over ln(alpha), what all sensors share, then each sensor's own."""
    own = sum(one.own.shape[1] for one in seen)
    shared = seen[0].shared.shape[1]
    J = np.zeros((sum(len(one.shared) for one in seen), shared + own))
    row, column = 0, shared
    for one in seen:
        J[row : row + len(one.shared), :shared] = one.shared
        J[row : row + len(one.own), column : column + one.own.shape[1]] = one.own
        row, column = row + len(one.shared), column + one.own.shape[1]
    return whitening.whiten(J)


def rows_per_bin(readings: int) -> int:
    """How many rows are put together so that a dense covariance holds them."""
    return max(1, math.ceil(readings / MOST_READINGS))
