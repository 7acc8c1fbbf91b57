"""The covariance of what a good model leaves: the sensors' noise and the faces', which goes through the wall.

    R = S C S' + sum_f s_f^2 G_f C G_f',      C = v_w I + v_a AR(rho)

`S` holds the stated standard deviations of the inner sensors, `s_f` that of a face, and `G_f` the readings'
response to a face reading. White noise and noise that remembers (a first-order autoregression) have sizes that are
estimated, relative to what was stated, together with `rho`. Errors of position and offsets are no noise: they
are parameters with priors.

The estimate must neither eat the effect that is looked for nor be inflated by it: it maximises Whittle's
likelihood of the residual's cosine transform with every direction of the library, and of the free parameters, taken
out (a restricted likelihood, each frequency weighted by the share that they leave).

Source: P. Whittle, Ark. Mat. 2 (1953), 423; D. A. Harville, J. Am. Stat. Assoc. 72 (1977), 320.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.fft import dct
from scipy.linalg import solve_triangular, toeplitz
from scipy.optimize import minimize

from .study import Study, impulses

_LEAST_SHARE = 0.3  # a frequency of which the directions taken out leave less says nothing about noise
_RANK = 1e-4  # of the directions taken out, relative to the largest after whitening
_SPREAD = 1.0  # of ln(total variance / stated): how far the stated noise may be off
_LONGEST = 0.98  # autocorrelation from row to row


@dataclass(frozen=True)
class Noise:
    """The noise's size and memory, and what follows from it.

    Arguments:
        white, lasting: variances over the stated ones, of the white and of the autocorrelated part.
        correlation: of the latter, from row to row.
        whiten: W, lower triangular, with `W' W` the inverse covariance of the binned readings.
        floor: what noise alone would leave at the rows, root mean square, K.
        parts: whitenings of some of the readings, made once.
    """

    white: float
    lasting: float
    correlation: float
    whiten: np.ndarray = field(repr=False)
    covariance: np.ndarray = field(repr=False)
    floor: float
    parts: dict[bytes, np.ndarray] = field(default_factory=dict, repr=False)

    def __str__(self) -> str:
        total = np.sqrt(self.white + self.lasting)
        memory = ""
        if self.lasting > 0.05 * (self.white + self.lasting):
            share = self.lasting / (self.white + self.lasting)
            memory = f", {100 * share:.0f} % of its variance with correlation {self.correlation:.2f} from row to row"
        return f"noise {total:.2f} times the stated{memory}"


class NoiseModel:
    """What the covariance needs from one model: its response to a face reading."""

    def __init__(self, study: Study, theta: np.ndarray):
        self.study = study
        rows, bins, sensors = study.record.rows, study.bins, study.sensors
        self.rows_per_bin = bins.rows
        self.count = -(-rows // bins.rows)
        self.sensor_std = np.array([sensor.noise_std for sensor in study.case.sensors])
        self.face_std = study.record.boundary_noise_std
        self.response = impulses(study, theta)  # (face, row, sensor)
        padded = np.pad(self.response, ((0, 0), (0, self.count * bins.rows - rows), (0, 0)))
        # of a bin's mean to a change of a face over a whole bin
        held = np.cumsum(padded, axis=1)
        ends = held.reshape(2, self.count, bins.rows, sensors).mean(axis=2)
        self.binned = np.diff(ends, axis=1, prepend=0.0)  # (face, bin, sensor)
        spectrum = np.fft.rfft(self.binned, 2 * self.count, axis=1)[:, : self.count]
        self.gain = (np.abs(spectrum) ** 2).sum(axis=0)  # (frequency, sensor)

    def autocovariance(self, rho: float) -> np.ndarray:
        """Of bins' means of a first-order autoregression with variance 1, by lag."""
        m, lags = self.rows_per_bin, np.arange(self.count)
        i = np.arange(m)
        within = (rho ** np.abs(i[:, None] - i)).mean()
        between = np.outer(rho ** (m - 1 - i), rho**i).mean() * rho  # lag 1: rho^(m + i - j)
        return np.where(lags == 0, within, between * rho ** (m * (lags - 1.0).clip(0)))

    def density(self, white: float, lasting: float, rho: float) -> np.ndarray:
        """Variance of each cosine coefficient, `(frequency, sensor)`."""
        cov = self.autocovariance(rho)
        omega = np.pi * np.arange(self.count) / self.count
        ar = np.maximum(2 * dct_spectrum(cov, omega) - cov[0], 1e-12)
        flat = white / self.rows_per_bin + lasting * ar
        return flat[:, None] * (self.sensor_std**2 + self.face_std**2 * self.gain)

    def noise(self, white: float, lasting: float, rho: float) -> Noise:
        """The covariance at these sizes."""
        cov = lasting * self.autocovariance(rho)
        cov[0] += white / self.rows_per_bin
        C = toeplitz(cov)
        n, sensors = self.count, self.study.sensors
        present = np.asarray(self.study.bins.counts())  # (bin, sensor)
        R = np.zeros((sensors * n, sensors * n))
        G = [np.concatenate([_lower_toeplitz(self.binned[face, :, s]) for s in range(sensors)]) for face in (0, 1)]
        for part in G:
            R += self.face_std**2 * (part @ C) @ part.T
        for s, std in enumerate(self.sensor_std):
            block = slice(s * n, (s + 1) * n)
            R[block, block] += std**2 * C
            fewer = white / np.maximum(present[:, s], 1.0) - white / self.rows_per_bin
            R[np.arange(s * n, (s + 1) * n), np.arange(s * n, (s + 1) * n)] += std**2 * fewer
        missing = np.flatnonzero(present.T.reshape(-1) == 0)
        R[missing] = 0.0
        R[:, missing] = 0.0
        R[missing, missing] = 1.0
        lower = np.linalg.cholesky(R)
        whiten = solve_triangular(lower, np.eye(len(R)), lower=True)
        return Noise(white, lasting, rho, whiten, R, self._floor(white, lasting, rho))

    def _floor(self, white: float, lasting: float, rho: float) -> float:
        """Root mean square of the noise at the rows, the faces' part included."""
        h = self.response  # (face, row, sensor)
        rows = h.shape[1]
        lags = np.arange(rows)
        memory = lasting * rho**lags
        spectrum = np.fft.rfft(h, 2 * rows, axis=1)
        correlation = np.fft.irfft(np.abs(spectrum) ** 2, axis=1)[:, :rows]  # (face, lag, sensor)
        through = correlation[:, 0] * (white + lasting) + 2 * np.einsum("flk,l->fk", correlation[:, 1:], memory[1:])
        variance = self.sensor_std**2 * (white + lasting) + self.face_std**2 * through.sum(axis=0)
        present = np.asarray(self.study.bins.present)
        return float(np.sqrt((present * variance).sum() / present.sum()))


def dct_spectrum(cov: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """`sum_k cov_k cos(k omega)` at the frequencies of a cosine transform."""
    count = len(cov)
    extended = np.concatenate([cov, np.zeros(count)])
    return np.fft.fft(extended).real[: len(omega)]


def _lower_toeplitz(column: np.ndarray) -> np.ndarray:
    return toeplitz(column, np.zeros_like(column))


def estimate_noise(model: NoiseModel, residual: np.ndarray, directions: np.ndarray) -> Noise:
    """The noise that a residual shows beside these directions.

    Arguments:
        residual: of the binned readings, K, 0 where missing.
        directions: what an effect or a free parameter would add, `(direction, reading)`.
    """
    sensors, n = model.study.sensors, model.count
    present = np.asarray(model.study.bins.counts()).T > 0  # (sensor, bin)

    def transform(values: np.ndarray) -> np.ndarray:
        shaped = values.reshape(*values.shape[:-1], sensors, n)
        return dct(shaped, type=2, norm="ortho", axis=-1).reshape(*values.shape[:-1], -1)

    r = transform(residual)
    X = transform(directions)
    X = X / np.maximum(np.linalg.norm(X, axis=1, keepdims=True), 1e-300)
    share = present.mean(axis=1).clip(0.05)  # a sensor that is often missing shows less noise at each frequency
    sizes = (1.0, 0.0, 0.8)
    for _ in range(2):
        density = (model.density(*sizes) * share).T.reshape(-1)
        u, size, _ = np.linalg.svd((X / np.sqrt(density)).T, full_matrices=False)
        basis = u[:, size > _RANK * size[0]]
        white = r / np.sqrt(density)
        left = white - basis @ (basis.T @ white)
        remaining = 1.0 - (basis**2).sum(axis=1)
        use = remaining > _LEAST_SHARE
        power = left[use] ** 2 * density[use] / remaining[use]
        weight = remaining[use]

        def cost(y: np.ndarray) -> float:
            if y[0] > 8 or y[0] < -8 or not 0.0 <= y[1] <= 1.0 or not 0.0 <= y[2] <= _LONGEST:
                return 1e12
            total = np.exp(y[0])
            here = (model.density(total * (1 - y[1]), total * y[1], y[2]) * share).T.reshape(-1)[use]  # noqa: B023
            return float(np.sum(weight * (np.log(here) + power / here))) + (y[0] / _SPREAD) ** 2  # noqa: B023

        starts = [(0.0, 0.02, 0.8), (0.0, 0.5, 0.9), (0.0, 0.9, 0.6), (0.0, 0.9, 0.9)]
        tries = [
            minimize(cost, start, method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-2, "maxfev": 250})
            for start in starts
        ]
        best = min(tries, key=lambda found: found.fun)
        total, lasting, rho = float(np.exp(best.x[0])), float(best.x[1]), float(best.x[2])
        sizes = (total * (1 - lasting), total * lasting, rho)
    return model.noise(*sizes)
