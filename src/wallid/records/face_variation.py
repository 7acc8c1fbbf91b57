"""What a face does between two rows, which no reading shows: the errors of the cubics through its readings.

A wall responds to the mean of its face over the time of a row. The mean of a cubic through the readings is right for a
smooth face, that of straight lines for a face that changes at random. Readings do not show which of the two a face is.
So each face has an error that is the same share in all rows: of the change from cubics to straight lines. It has a
share for the slow part of the face (weather, the day) and another for the fast part (gusts). Of gusts that are shorter
than a row, the mean over a row contains next to nothing of the reading, while a cubic through the reading does. On 36
measured faces that were thinned out (London, Tampere, ice in Nepal) the root mean square of one share for both was 0.7.

A second error varies from row to row. With the spectrum `S` of the face (`face_spectrum`) the mean of the cubic over a
row is in error by a stationary process with the spectrum

    E(theta) = sum_j S(theta + 2 pi j) (sinc_j - H(theta))^2,      sinc_j = sin(w / 2) / (w / 2)

`H` is the weight that the mean of a cubic over a row gives to the readings around it. The slow part is the daily cycle
and the smooth process as its Wiener filter finds it in the readings:

    W(theta) = sum_j S_smooth(theta + 2 pi j) / f_d(theta)

Faces that are filtered (`face_filter`), beside flux plates, have the errors of their filter instead.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from jaxtyping import Float

from .face_filter import FaceFilter
from .face_spectrum import (
    ALIASES,
    FOLDED,
    FREQUENCIES,
    LAGS,
    WHITE,
    NoiseMemory,
    around_row,
    fitted_spectrum,
    has_spectrum,
    with_daily_cycle,
    without_daily_cycle,
)

SLOW_BENDING_STD = 0.7
"""Standard deviation of the course of a face's slow part, from the cubics (0) towards straight lines (1)."""
FAST_BENDING_STD = 3.0
"""The same of the fast part: gusts of a quarter of a row need about 4, gusts that no two instants share 9."""
# the mean of a cubic over the row about its reading: weights of the reading, and of those one and two rows beside it
_MEAN_OF_CUBIC = (161.0 / 192.0, 18.0 / 192.0, -2.5 / 192.0)


@dataclass(frozen=True, eq=False)
class FaceErrors:
    """The errors of the cubics through two faces, as means over a row, besides the noise of the readings.

    Args:
        autocovariance: of the error that varies from row to row, by lag in rows, K2; zero beyond.
        slow_weights: of the readings around a row in its slow part, `LAGS` before it to `LAGS` after it.
        bending_std: standard deviation of the share of the slow and of the fast part.
        filter: of faces that are filtered.
    """

    autocovariance: Float[np.ndarray, "face lag"]
    slow_weights: Float[np.ndarray, "face weight"]
    bending_std: tuple[float, float] = (SLOW_BENDING_STD, FAST_BENDING_STD)
    filter: FaceFilter | None = None

    @classmethod
    def none(cls) -> FaceErrors:
        """No errors: faces that are known between their rows, or whose errors are left out or part of another noise."""
        return cls(np.zeros((2, 1)), np.zeros((2, 1)), (0.0, 0.0))

    @classmethod
    def of_filter(cls, face_filter: FaceFilter) -> FaceErrors:
        """Of faces that are filtered: what is uncertain in the filter alone."""
        return replace(cls.none(), filter=face_filter)

    def bent_courses(
        self, faces: Float[np.ndarray, "time face"], filtered: Float[np.ndarray, "time face"], step: float
    ) -> Float[np.ndarray, "part face interval power"]:
        """One standard deviation of the change of each face between its rows by how its slow and fast parts bend.

        Args:
            faces: readings at uniform rows, degC.
            filtered: the same without their noise; the sum of the slow and the fast part.
            step: from row to row, s.

        Returns:
            coefficients of the powers of s, from 0 at a row to 1 at the next, K.
        """
        slow = np.stack(
            [with_daily_cycle(face, step, weights) for face, weights in zip(faces.T, self.slow_weights, strict=True)]
        )
        courses = (slow, filtered.T - slow)
        return np.stack(
            [
                np.stack([std * _line_minus_cubic(face) for face in part])
                for std, part in zip(self.bending_std, courses, strict=True)
            ]
        )

    def shared_errors(self, faces: Float[np.ndarray, "time face"], step: float) -> Float[np.ndarray, "error face time"]:
        """One standard deviation of each error of a face's means over the rows that has one share in all rows, K.

        How the faces bend, or what is uncertain in their filter.

        Args:
            faces: readings at uniform rows, degC.
            step: from row to row, s.
        """
        if self.filter is not None:
            return self.filter.courses_of_deviations(faces, step)
        return self.bendings(faces, step)

    def bendings(self, faces: Float[np.ndarray, "time face"], step: float) -> Float[np.ndarray, "part face time"]:
        """One standard deviation of the change of each face's mean over a row by how its slow and fast parts bend, K.

        Args:
            faces: readings at uniform rows, degC.
            step: from row to row, s.
        """
        changes = np.zeros((2, *faces.T.shape))
        if any(self.bending_std):
            for side, (face, weights) in enumerate(zip(faces.T, self.slow_weights, strict=True)):
                slow = with_daily_cycle(face, step, weights)
                for part, std, values in zip((0, 1), self.bending_std, (slow, face - slow), strict=True):
                    changes[part, side] = std * from_cubics_to_lines(values)
        return changes


def cubic_errors(
    faces: Float[np.ndarray, "time face"], step: float, noise_std: float, memory: NoiseMemory = WHITE
) -> FaceErrors:
    """The errors of the cubics through the readings of two faces.

    Args:
        faces: readings at uniform rows, degC.
        step: from row to row, s.
        noise_std: of a reading, K. The errors are those without this noise.
        memory: of the noise.

    Returns:
        no error that varies from row to row, and no fast part, where the readings are too few or constant.
    """
    each = (_errors_of_one(face, step, noise_std, memory) for face in faces.T)
    autocovariance, slow = (np.stack(part) for part in zip(*each, strict=True))
    return FaceErrors(autocovariance, slow)


def _errors_of_one(values: np.ndarray, step: float, noise_std: float, memory: NoiseMemory) -> tuple[np.ndarray, ...]:
    """Autocovariance of the error and weights of the slow part of one face."""
    if not has_spectrum(values):
        return np.zeros(LAGS), around_row(np.ones(len(FREQUENCIES)))
    spectrum = fitted_spectrum(without_daily_cycle(values, step), noise_std, memory)
    power = spectrum.with_aliases(FOLDED)
    total = power.sum(axis=1) + spectrum.of_noise(FOLDED)
    return np.fft.ifft(_error_spectrum(power)).real[:LAGS], around_row(spectrum.slow(FOLDED) / total)


def _error_spectrum(power: np.ndarray) -> np.ndarray:
    """Spectrum of the error of a row's mean, K2; `power` of the face with its aliases, `(frequency, alias)`."""
    w = FOLDED[:, None] + 2.0 * np.pi * ALIASES
    own, beside, next_one = _MEAN_OF_CUBIC
    weight = own + 2.0 * beside * np.cos(FOLDED) + 2.0 * next_one * np.cos(2.0 * FOLDED)
    return (power * (np.sinc(w / (2.0 * np.pi)) - weight[:, None]) ** 2).sum(axis=1)


def from_cubics_to_lines(values: Float[np.ndarray, " time"]) -> np.ndarray:
    """Change of the mean over each row, K, from cubics through a face's readings to straight lines.

    It is a twelfth of the readings' second difference for slow changes. A logger that stores means over the time of a
    row, instead of temperatures at one instant, has minus half of it.
    """
    own, beside, next_one = _MEAN_OF_CUBIC
    weights = np.array([-next_one, 0.125 - beside, 0.75 - own, 0.125 - beside, -next_one])
    if len(values) < len(weights):
        return np.zeros(len(values))
    inside = np.convolve(values, weights, mode="valid")
    return np.concatenate([np.zeros(2), inside, np.zeros(2)])


def _line_minus_cubic(values: np.ndarray) -> Float[np.ndarray, "interval power"]:
    """Coefficients in s of the straight line minus the monotone cubic in each interval between rows.

    Also where the course is a cubic spline: of a fast part a spline is so far from the line that the share, 3, would
    bend the face by more than gusts do, and hide the lag or the resistance of a plate.
    """
    rows = np.arange(len(values))
    cubic = scipy.interpolate.PchipInterpolator(rows, values).c[::-1].T
    line = np.zeros_like(cubic)
    line[:, 0], line[:, 1] = values[:-1], np.diff(values)
    return line - cubic


def of_means(autocovariance: Float[np.ndarray, " lag"], rows: int) -> np.ndarray:
    """Autocovariance of the means over blocks of rows, by lag in blocks; as many lags as are not zero.

    Args:
        autocovariance: by lag in rows; zero beyond.
        rows: in a block.
    """
    if rows == 1:
        return autocovariance
    blocks = (len(autocovariance) + rows - 1) // rows + 1
    triangle = (rows - np.abs(np.arange(1 - rows, rows))) / rows**2
    lags = np.abs(rows * np.arange(blocks)[:, None] + np.arange(1 - rows, rows))
    padded = np.append(autocovariance, 0.0)
    return padded[np.minimum(lags, len(autocovariance))] @ triangle
