"""The readings of two faces without their noise, by a Wiener filter of each face's own spectrum.

They are the daily cycle and what the filter finds in the rest. With `f_d` the power of the readings (`face_spectrum`)
and `n` that of their noise, the filter and the error of what it finds have the spectra

    H = S / f_d,      E = H n,      S = f_d - n

The noise is as stated, or the largest that nowhere exceeds `f_d` where that is lower.

Gusts are in `S` only where the readings show them. With gusts that are not there noise passes for a change of the
face, and `H n` is too large where a flux is most sensitive to it.

`S` and `n` are estimated, so `H` is uncertain, in the directions of the posterior of their parameters:

    dH = (n dS - S dn) / f_d^2

Each of the largest is one error of the filtered face, with the same share in all rows.

Source: N. Wiener, Extrapolation, Interpolation and Smoothing of Stationary Time Series (1949), III.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .face_spectrum import (
    FOLDED,
    FREQUENCIES,
    LAGS,
    WHITE,
    NoiseMemory,
    around_row,
    autoregression_spectrum,
    has_spectrum,
    spectrum_with_evident_gusts,
    weighted,
    with_daily_cycle,
    without_daily_cycle,
)

_DIRECTIONS = 3  # of five: the others are a thirtieth of the variance


@dataclass(frozen=True, eq=False)
class FaceNoise:
    """The noise of the temperatures of two faces that drive a model.

    Args:
        autocovariance: where the noise of the readings is white and as stated, by lag in rows, K2; zero beyond.
        stated_std: of a reading, K.
        largest_power: the power of the readings at equal frequencies from 0 to 2 pi rad a row, K2, which noise cannot
            exceed; infinite without a limit.
    """

    autocovariance: Float[np.ndarray, "face lag"]
    stated_std: float
    largest_power: Float[np.ndarray, "face frequency"]

    @classmethod
    def white(cls, std: float) -> FaceNoise:
        """White noise of readings that drive the model as they are; `std` in K."""
        return cls(np.full((2, 1), std**2), std, np.full((2, 1), np.inf))

    def largest_size(self, white: float, autocorrelated: float, rho: float) -> Float[np.ndarray, " face"]:
        """The largest factor of noise with these variances, over the stated one, that the power of each face allows.

        `min_w P(w) / (s^2 (v_w + v_a AR(w)))`.
        """
        omega = 2.0 * np.pi * np.arange(self.largest_power.shape[1]) / self.largest_power.shape[1]
        power = self.stated_std**2 * (white + autocorrelated * autoregression_spectrum(rho, omega))
        return (self.largest_power / np.maximum(power, 1e-300)).min(axis=1)

    def limited(self, white: float, autocorrelated: float, rho: float) -> Float[np.ndarray, "face lag"]:
        """`autocovariance` times `largest_size`, where that is below 1, K2."""
        return np.minimum(self.largest_size(white, autocorrelated, rho), 1.0)[:, None] * self.autocovariance


@dataclass(frozen=True, eq=False)
class FaceFilter:
    """The filter that takes the noise out of the readings of two faces.

    Args:
        weights: of the readings around a row in the reading without its noise, `LAGS` before it to `LAGS` after it.
        noise: what is left in the readings without their noise.
        deviations: one posterior standard deviation of the weights in each direction.
    """

    weights: Float[np.ndarray, "face weight"]
    noise: FaceNoise
    deviations: Float[np.ndarray, "direction face weight"]

    def filtered(self, faces: Float[np.ndarray, "time face"], step: float) -> Float[np.ndarray, "time face"]:
        """The readings without their noise, degC.

        Args:
            faces: readings at uniform rows, degC.
            step: from row to row, s.
        """
        each = [with_daily_cycle(face, step, weights) for face, weights in zip(faces.T, self.weights, strict=True)]
        return np.stack(each, axis=1)

    def courses_of_deviations(
        self, faces: Float[np.ndarray, "time face"], step: float
    ) -> Float[np.ndarray, "direction face time"]:
        """One posterior standard deviation of the readings without their noise, in each direction, K.

        Args:
            faces: readings at uniform rows, degC.
            step: from row to row, s.
        """
        rest = [without_daily_cycle(face, step) for face in faces.T]
        courses = np.zeros((len(self.deviations), *faces.T.shape))
        for direction, side in np.ndindex(courses.shape[:2]):
            courses[direction, side] = weighted(rest[side], self.deviations[direction, side])
        return courses


def face_filter(
    faces: Float[np.ndarray, "time face"], step: float, noise_std: float, memory: NoiseMemory = WHITE
) -> FaceFilter:
    """The filter of the readings of two faces.

    Args:
        faces: readings at uniform rows, degC.
        step: from row to row, s.
        noise_std: of a reading, K.
        memory: of the noise.

    Returns:
        one that leaves the readings as they are, with their noise, where they are too few or constant.
    """
    each = (_filter_of_one(face, step, noise_std, memory) for face in faces.T)
    weights, left, power, deviations = (np.stack(part) for part in zip(*each, strict=True))
    return FaceFilter(weights, FaceNoise(left, noise_std, power), deviations.transpose(1, 0, 2))


def _filter_of_one(values: np.ndarray, step: float, noise_std: float, memory: NoiseMemory) -> tuple[np.ndarray, ...]:
    """Weights, autocovariance of the noise that is left, power and deviations of the weights of one face."""
    if not has_spectrum(values):
        own = around_row(np.ones(len(FREQUENCIES)))
        none = np.zeros((_DIRECTIONS, len(own)))
        return own, noise_std**2 * own[LAGS:-1], np.full(len(FREQUENCIES), np.inf), none
    spectrum = spectrum_with_evident_gusts(without_daily_cycle(values, step), noise_std, memory)
    total = spectrum.with_aliases(FOLDED).sum(axis=1) + spectrum.of_noise(FOLDED)
    shape, (of_signal, of_noise) = memory.spectrum(FOLDED), spectrum.deviations(FOLDED)
    largest_noise = float((total / shape).min())
    if largest_noise > spectrum.stated_noise:  # what is uncertain in the noise that was found is so in the face
        of_signal, of_noise = of_signal + of_noise, np.zeros_like(of_noise)
    noise = min(largest_noise, spectrum.stated_noise) * shape
    signal = total - noise
    changes = (noise * of_signal - signal * of_noise) / total**2
    # the directions in which the filtered readings change most
    _, sizes, principal = np.linalg.svd(changes * np.sqrt(total), full_matrices=False)
    largest = (sizes[:, None] * principal)[:_DIRECTIONS] / np.sqrt(total)
    response = signal / total
    return (
        around_row(response),
        noise_std**2 * np.fft.ifft(response).real[:LAGS],
        total,
        np.stack([around_row(change) for change in largest]),
    )
