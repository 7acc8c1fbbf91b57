"""The size and autocorrelation of the noise, estimated from a residual by the restricted Whittle likelihood.

With `z_k` the cosine coefficients of the residual of the binned readings, and `d_k = v S_k(share, rho) + V_k` their
variances under noise of total variance `v` (over the stated one), of which a share is autocorrelated, and under what
the faces do between rows, `V_k`, which is known from the faces::

    -2 log L = sum_k w_k (ln d_k + z_k^2 / (w_k d_k)) + (ln v)^2

The noise must neither absorb nor be inflated by what a parameter explains. So every direction in which a parameter (or
a candidate effect) changes the readings is projected out of `z`, and `w_k` is the share of a frequency that remains.
The last term is the prior: the stated noise may be wrong by a factor e.

Source: P. Whittle, Ark. Mat. 2 (1953), 423; D. A. Harville, J. Am. Stat. Assoc. 72 (1977), 320.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import scipy
from jaxtyping import Float

from ..records.face_spectrum import WHITE, NoiseMemory, autoregression_spectrum
from .noise_covariance import NoiseCovariance, NoiseShape, quantile_over_shapes

MIN_READINGS = 30
"""Readings beyond the number of parameters; from fewer the noise is not estimated but taken as stated."""
_MIN_SHARE = 0.3  # of a frequency that remains after the projection: with less it is not used
_RANK_TOLERANCE = 1e-4  # of the projected directions, relative to the largest singular value
_PRIOR_STD = 1.0  # of ln(total variance / stated variance)
_MAX_CORRELATION = 0.98  # from row to row
_SIGNIFICANT_MEMORY = 10.0  # of -2 log L, over white noise; two parameters reach it by chance in 1 of 150
_SCORING_STEPS = 20  # of the total variance
_SHARES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
_CORRELATIONS = (0.3, 0.5, 0.6, 0.7, 0.76, 0.82, 0.86, 0.89, 0.92, 0.95, 0.97)
_GRID = tuple(product(_SHARES, _CORRELATIONS))  # shapes of the noise


def estimate_noise(
    shape: NoiseShape, residual: np.ndarray, directions: np.ndarray, sensitivity: np.ndarray | None = None
) -> NoiseCovariance:
    """The noise covariance estimated from a residual, some directions projected out.

    Args:
        shape: of the noise covariance.
        residual: of the binned readings, K, 0 where missing.
        directions: derivatives of the readings by parameters or candidate effects, `(direction, reading)`.
        sensitivity: derivative by one parameter, the others projected out, `(reading,)`, for the ratios of its standard
            error over the shapes of the noise; None for none.

    Returns:
        the covariance with the estimated variances and autocorrelation.
    """
    if len(shape.gap_errors):
        directions = np.concatenate([directions, shape.largest_gap_errors])
    likelihood = _Whittle(shape, residual, directions)
    share, rho, sizes, costs, totals = 0.0, 0.8, (1.0, 0.0, 0.8), np.zeros(len(_GRID)), np.zeros(len(_GRID))
    for _ in range(2):
        likelihood.project_out(sizes)
        share, rho, costs, totals = likelihood.best_shape()
        total = float(np.exp(likelihood.cost(share, rho)[1]))
        sizes = (total * (1 - share), total * share, rho)
    # the uncertainty of the noise's power at low frequencies, where effects are searched for
    probability = _probability(costs)
    log_power = np.array([_log_low_frequency_power(*point, total) for point, total in zip(_GRID, totals, strict=True)])
    weight = float(likelihood.weight.sum())
    log_power_std = float(np.sqrt(probability @ (log_power - probability @ log_power) ** 2 + 2.0 / weight))
    noise = replace(shape.covariance_of(*sizes), log_power_std=log_power_std, degrees_of_freedom=weight)
    if sensitivity is None:
        return noise
    variance = np.array(
        [likelihood.log_variance(sensitivity, *point, total) for point, total in zip(_GRID, totals, strict=True)]
    )
    reference = likelihood.log_variance(sensitivity, share, rho, float(np.log(sum(sizes[:2]))))
    return replace(noise, shape_probability=probability, std_ratio=np.exp(0.5 * (variance - reference)))


def shape_of_fast_noise(shape: NoiseShape, residual: np.ndarray, slowest: float) -> NoiseMemory:
    """The shape of the noise at high frequencies, where no parameter or effect changes the readings much.

    Args:
        shape: of the noise covariance.
        residual: of the binned readings, K, 0 where missing.
        slowest: lowest frequency that is used, rad a bin.

    Returns:
        white noise where the likelihood does not tell the best shape from it.
    """
    offsets = np.repeat(np.eye(shape.sensor_count), shape.bin_count, axis=1)
    likelihood = _Whittle(shape, residual, offsets)
    likelihood.project_out((1.0, 0.0, 0.8), slowest)
    share, rho, _, _ = likelihood.best_shape()
    gain = likelihood.cost(0.0, 0.0)[0] - likelihood.cost(share, rho)[0]
    return NoiseMemory(share, rho) if gain > _SIGNIFICANT_MEMORY else WHITE


def expected_widening(sensitivity: Sequence[np.ndarray], directions: Sequence[np.ndarray], readings: int) -> float:
    """How much wider an interval is expected to be because the noise, which is white, is found out from the record.

    The likelihood of each share and correlation of autocorrelated noise is taken at the mean power of white noise, the
    same at all frequencies. The interval is then averaged over these shapes of the noise, as that of an estimate is.

    Args:
        sensitivity: derivative of each output's readings (or their means over bins) by one parameter, the others
            projected out, in standard deviations of the noise, `(bin,)`.
        directions: the same by each parameter, which are projected out of the residual, `(bin, param)`.
        readings: of each output, as many as the estimate uses.

    Returns:
        the width over that with known noise; 1 where the readings are too few to estimate it, or say nothing.
    """
    weight = np.ones((len(directions), readings))
    transformed = [_lowest_cosines(one, readings) for one in directions]
    columns = np.concatenate(transformed)
    basis = _orthonormal(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))
    for own, part in zip(weight, np.split(basis, np.cumsum([len(one) for one in transformed])[:-1]), strict=True):
        own[: len(part)] -= (part**2).sum(axis=1)
    weight = np.where(weight > _MIN_SHARE, weight, 0.0).sum(axis=0)
    if weight.sum() < MIN_READINGS:
        return 1.0
    power = np.zeros(readings)
    for one in sensitivity:
        used = _lowest_cosines(one, readings)
        power[: len(used)] += used**2
    if not power.any():
        return 1.0
    share, rho = np.array(_GRID).T[:, :, None]
    omega = np.pi * np.arange(readings) / readings
    density = 1.0 - share + share * autoregression_spectrum(rho, omega)  # (shape, frequency)
    log_total = np.log((1.0 / density) @ weight / weight.sum())
    costs = np.log(density) @ weight + weight.sum() * log_total + (log_total / _PRIOR_STD) ** 2
    ratio = np.sqrt(power.sum() / ((1.0 / density) @ power) * np.exp(log_total))
    quantile = quantile_over_shapes(_probability(costs), ratio, float(weight.sum()))
    return quantile / float(scipy.special.ndtri(0.975))


def _probability(costs: Float[np.ndarray, " shape"]) -> Float[np.ndarray, " shape"]:
    """The probability of each shape of the noise, from `-2 log L`."""
    likelihood = np.exp(-0.5 * (costs - costs.min()))
    return likelihood / likelihood.sum()


def _lowest_cosines(values: np.ndarray, count: int) -> np.ndarray:
    """The cosine coefficients of the lowest frequencies, at most so many, along the first axis."""
    return np.asarray(scipy.fft.dct(values, type=2, norm="ortho", axis=0))[:count]


def _orthonormal(columns: Float[np.ndarray, "value column"]) -> Float[np.ndarray, "value rank"]:
    """An orthonormal basis of the columns."""
    u, singular, _ = np.linalg.svd(columns, full_matrices=False)
    return u[:, singular > _RANK_TOLERANCE * singular[0]]


def projected_sensitivity(
    jacobian: Float[np.ndarray, "row param"], of_readings: Float[np.ndarray, "reading param"]
) -> Float[np.ndarray, " reading"]:
    """The readings' derivative with respect to the first parameter, the others projected out, K.

    Args:
        jacobian: of the whitened readings, then of the prior residuals.
        of_readings: of the readings themselves, K.
    """
    coefficients = np.linalg.lstsq(jacobian[:, 1:], jacobian[:, 0], rcond=None)[0]
    return of_readings[:, 0] - of_readings[:, 1:] @ coefficients


def _log_low_frequency_power(share: float, rho: float, log_total: float) -> float:
    """The logarithm of the noise's power at frequencies far below one per row."""
    return float(log_total + np.log(1.0 - share + share * (1.0 + rho) / (1.0 - rho)))


class _Whittle:
    """The Whittle likelihood of a residual, some directions projected out."""

    def __init__(self, shape: NoiseShape, residual: np.ndarray, directions: np.ndarray):
        self.shape = shape
        spectrum = np.fft.rfft(shape.binned_response, 2 * shape.bin_count, axis=1)[:, : shape.bin_count]
        gain = np.abs(spectrum) ** 2  # (face, frequency, sensor)
        white = shape.rows_per_bin * shape.binned_autocovariance(shape.face_noise.autocovariance)
        of_faces, between = (
            np.stack([self._cosine_variances(one) for one in each]) for each in (white, shape.binned_face_errors)
        )
        of_sensors = np.broadcast_to(shape.sensor_std**2, (1, *gain.shape[1:]))
        self.stated = np.concatenate([of_sensors, of_faces[:, :, None] * gain])  # (part, frequency, sensor)
        between_rows = np.einsum("fk,fks->ks", between, gain)
        self.spectra: dict[float, np.ndarray] = {}  # of autocorrelated noise, by rho
        present = shape.counts.T > 0  # (sensor, bin)
        self.has_readings = np.repeat(present.any(axis=1), shape.bin_count)
        self.present_share = present.mean(axis=1).clip(0.05)  # missing readings reduce the power at each frequency
        self.between_rows = (between_rows * self.present_share).T.reshape(-1)
        self.residual = self._transform(residual)
        X = self._transform(directions)
        self.directions = X / np.maximum(np.linalg.norm(X, axis=1, keepdims=True), 1e-300)

    def _transform(self, values: np.ndarray) -> np.ndarray:
        """Cosine coefficients, sensor by sensor."""
        shaped = values.reshape(*values.shape[:-1], self.shape.sensor_count, self.shape.bin_count)
        return np.asarray(scipy.fft.dct(shaped, type=2, norm="ortho", axis=-1)).reshape(*values.shape[:-1], -1)

    def _cosine_variances(self, cov: np.ndarray) -> np.ndarray:
        """The variance of each cosine coefficient of a process with this autocovariance by lag in bins."""
        omega = np.pi * np.arange(self.shape.bin_count) / self.shape.bin_count
        ends = edge_spectrum(cov, omega)
        return np.maximum(2 * dct_spectrum(cov, omega) - cov[0] - ends, 1e-12 * cov[0])

    def _parts(self, white: float, autocorrelated: float, rho: float) -> Float[np.ndarray, "part coefficient"]:
        """The variance of each cosine coefficient by the noise of the readings, and of each face without a limit."""
        if rho not in self.spectra:
            self.spectra[rho] = self._cosine_variances(self.shape.autocovariance(rho))
        flat = white / self.shape.rows_per_bin + autocorrelated * self.spectra[rho]
        parts = self.stated * (flat[:, None] * self.present_share)
        return parts.transpose(0, 2, 1).reshape(len(parts), -1)

    def density(self, white: float, autocorrelated: float, rho: float) -> np.ndarray:
        """The variance of each cosine coefficient of the noise, sensor by sensor, at these variances."""
        largest = np.append(np.inf, self.shape.face_noise.largest_size(white, autocorrelated, rho))
        return np.minimum(largest, 1.0) @ self._parts(white, autocorrelated, rho)

    def log_variance(self, sensitivity: np.ndarray, share: float, rho: float, log_total: float) -> float:
        """The logarithm of the variance of a parameter's estimate under noise of this shape and total."""
        power = self._transform(sensitivity) ** 2
        total = np.exp(log_total)
        density = self.density(total * (1.0 - share), total * share, rho) + self.between_rows
        return -float(np.log(np.sum(power / density)))

    def project_out(self, sizes: tuple[float, float, float], slowest: float = 0.0) -> None:
        """Project the directions out, by least squares under noise of these sizes.

        Frequencies below `slowest`, in rad a bin, are not used.
        """
        density = self.density(*sizes) + self.between_rows
        basis = _orthonormal((self.directions / np.sqrt(density)).T)
        whitened = self.residual / np.sqrt(density)
        projected = whitened - basis @ (basis.T @ whitened)
        remaining = 1.0 - (basis**2).sum(axis=1)
        bins = self.shape.bin_count
        fast = np.tile(np.pi * np.arange(bins) / bins >= slowest, self.shape.sensor_count)
        self.used = (remaining > _MIN_SHARE) & self.has_readings & fast
        self.weight = remaining[self.used]
        self.power = projected[self.used] ** 2 * density[self.used] / self.weight

    def best_shape(self) -> tuple[float, float, np.ndarray, np.ndarray]:
        """The share and correlation with the least cost; the costs and logarithms of the totals of all in `_GRID`."""
        costs, totals = np.array([self.cost(*point) for point in _GRID]).T
        minimum = scipy.optimize.minimize(
            lambda y: self.cost(*y)[0],
            np.array(_GRID[int(np.argmin(costs))]),
            method="Nelder-Mead",
            options={"xatol": 1e-3, "fatol": 1e-2, "maxfev": 120},
        )
        share, rho = (float(y) for y in minimum.x)
        return share, rho, costs, totals

    def cost(self, share: float, rho: float) -> tuple[float, float]:
        """`-2 log L` at the best total variance, and that variance's logarithm."""
        if not (0.0 <= share <= 1.0 and 0.0 <= rho <= _MAX_CORRELATION):
            return 1e12, 0.0
        parts, between = self._parts(1.0 - share, share, rho)[:, self.used], self.between_rows[self.used]
        largest = np.append(np.inf, self.shape.face_noise.largest_size(1.0 - share, share, rho))
        at_one = np.minimum(largest, 1.0) @ parts + between
        total = np.log(self.weight @ (self.power / at_one) / self.weight.sum())
        for _ in range(_SCORING_STEPS):
            sizes = np.minimum(np.exp(total), largest)
            density = sizes @ parts + between
            part = np.where(sizes < largest, sizes, 0.0) @ parts / density  # derivative of its logarithm
            score = self.weight @ (part * (self.power / density - 1.0)) - 2.0 * total / _PRIOR_STD**2
            step = score / (self.weight @ part**2 + 2.0 / _PRIOR_STD**2)
            total += np.clip(step, -1.0, 1.0)
            if abs(step) < 1e-3:
                break
        density = np.minimum(np.exp(total), largest) @ parts + between
        cost = self.weight @ (np.log(density) + self.power / density)
        return float(cost + (total / _PRIOR_STD) ** 2), float(total)


def dct_spectrum(cov: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """`sum_k cov_k cos(k omega)` at the frequencies of a cosine transform."""
    return np.fft.fft(cov, 2 * len(cov)).real[: len(omega)]


def edge_spectrum(cov: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """The reduction of the variance of each cosine coefficient by the two ends of the record.

    With `n` readings the coefficient at `a = pi k / n` has the variance
    `c_0 + 2 sum_l c_l ((1 - l/n) cos(a l) - sin(a l) / (n sin a))`, without the last term at k = 0.
    """
    count = len(cov)
    cosines = np.fft.fft(cov * np.arange(count), 2 * count)[: len(omega)].real
    sines = -np.fft.fft(cov, 2 * count)[: len(omega)].imag
    return 2.0 / count * (cosines + np.divide(sines, np.sin(omega), out=np.zeros(len(omega)), where=omega > 0))
