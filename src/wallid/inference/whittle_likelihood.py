"""The noise's size and memory from what a model leaves: Whittle's likelihood, restricted.

With `z_k` the cosine coefficients of what is left of the binned readings, and `v S_k(share, rho)` their variances under
noise of total variance `v` (over the stated one), of which a share remembers::

    -2 log L = sum_k w_k (ln(v S_k) + z_k^2 / (w_k v S_k)) + (ln v)^2

The sizes must neither eat what a parameter explains nor be inflated by it: every direction that a parameter (or an
effect that is looked for) could move the readings in is taken out of `z`, and `w_k` is the share of a frequency that
this leaves. The last term is the prior: the stated noise may be off by a factor e.

Source: P. Whittle, Ark. Mat. 2 (1953), 423; D. A. Harville, J. Am. Stat. Assoc. 72 (1977), 320.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from .noise_covariance import Noise, NoiseShape

_LEAST_SHARE = 0.3  # a frequency of which the directions taken out leave less says nothing about noise
_RANK = 1e-4  # of the directions taken out, relative to the largest after whitening
_SPREAD = 1.0  # of ln(total variance / stated): how far the stated noise may be off
_LONGEST = 0.98  # autocorrelation from row to row
_SHARES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
_CORRELATIONS = (0.3, 0.5, 0.6, 0.7, 0.76, 0.82, 0.86, 0.89, 0.92, 0.95, 0.97)


def estimate_noise(
    model: NoiseShape,
    residual: np.ndarray,
    directions: np.ndarray,
    along: np.ndarray | None = None,
    *,
    edges: bool = True,
) -> Noise:
    """The noise that a residual shows beside these directions.

    Args:
        residual: of the binned readings, K, 0 where missing.
        directions: what an effect or a free parameter would add, `(direction, reading)`.
        along: a parameter's direction with the others taken out, `(reading,)`, for the ratios of its standard
            error; None for none.
        edges: whether the variance of noise that remembers counts that a record has two ends, which take some of its
            slow power.
    """
    if len(model.gaps):
        directions = np.concatenate([directions, model.largest_gaps])
    likelihood = _Whittle(model, residual, directions, edges)
    grid = [(lasting, rho) for lasting in _SHARES for rho in _CORRELATIONS]
    lasting, rho, sizes, costs, totals = 0.0, 0.8, (1.0, 0.0, 0.8), np.zeros(len(grid)), np.zeros(len(grid))
    for _ in range(2):
        likelihood.take_out(sizes)
        costs, totals = np.array([likelihood.cost(*point) for point in grid]).T
        found = scipy.optimize.minimize(
            lambda y: likelihood.cost(*y)[0],
            np.array(grid[int(np.argmin(costs))]),
            method="Nelder-Mead",
            options={"xatol": 1e-3, "fatol": 1e-2, "maxfev": 120},
        )
        lasting, rho = (float(y) for y in found.x)
        total = float(np.exp(likelihood.cost(lasting, rho)[1]))
        sizes = (total * (1 - lasting), total * lasting, rho)
    # how well the record tells the power of slow noise, in which effects are looked for
    chance = np.exp(-0.5 * (costs - costs.min()))
    chance /= chance.sum()
    slow = np.array([_slow(*point, total) for point, total in zip(grid, totals, strict=True)])
    spread = float(np.sqrt(chance @ (slow - chance @ slow) ** 2 + 2.0 / likelihood.weight.sum()))
    noise = replace(model.noise(*sizes), spread=spread, freedom=float(likelihood.weight.sum()))
    if along is None:
        return noise
    variance = np.array([likelihood.log_variance(along, *point) for point in grid]) + totals
    found = likelihood.log_variance(along, lasting, rho) + np.log(sum(sizes[:2]))
    return replace(noise, chance=chance, ratio=np.exp(0.5 * (variance - found)))


def _slow(lasting: float, rho: float, log_total: float) -> float:
    """The logarithm of the noise's power at frequencies well under one a row."""
    return float(log_total + np.log(1.0 - lasting + lasting * (1.0 + rho) / (1.0 - rho)))


class _Whittle:
    """Whittle's likelihood of a residual beside some directions."""

    def __init__(self, model: NoiseShape, residual: np.ndarray, directions: np.ndarray, edges: bool):
        self.model, self.edges = model, edges
        spectrum = np.fft.rfft(model.binned, 2 * model.count, axis=1)[:, : model.count]
        through = (np.abs(spectrum) ** 2).sum(axis=0)  # (frequency, sensor)
        self.stated = model.sensor_std**2 + model.face_std**2 * through
        self.spectra: dict[float, np.ndarray] = {}  # of noise that remembers, by rho
        present = model.counts.T > 0  # (sensor, bin)
        self.presence = present.mean(axis=1).clip(0.05)  # a sensor often missing shows less noise at each frequency
        self.residual = self._transform(residual)
        X = self._transform(directions)
        self.directions = X / np.maximum(np.linalg.norm(X, axis=1, keepdims=True), 1e-300)

    def _transform(self, values: np.ndarray) -> np.ndarray:
        """Cosine coefficients, sensor by sensor."""
        shaped = values.reshape(*values.shape[:-1], self.model.sensors, self.model.count)
        return np.asarray(scipy.fft.dct(shaped, type=2, norm="ortho", axis=-1)).reshape(*values.shape[:-1], -1)

    def density(self, white: float, lasting: float, rho: float) -> np.ndarray:
        """The variance of each cosine coefficient, sensor by sensor."""
        if rho not in self.spectra:
            cov = self.model.autocovariance(rho)
            omega = np.pi * np.arange(self.model.count) / self.model.count
            ends = edge_spectrum(cov, omega) if self.edges else 0.0
            self.spectra[rho] = np.maximum(2 * dct_spectrum(cov, omega) - cov[0] - ends, 1e-12)
        flat = white / self.model.rows_per_bin + lasting * self.spectra[rho]
        return (flat[:, None] * self.stated * self.presence).T.reshape(-1)

    def log_variance(self, along: np.ndarray, lasting: float, rho: float) -> float:
        """The logarithm of the variance of a parameter's estimate under noise of this shape, for a total of 1."""
        power = self._transform(along) ** 2
        return -float(np.log(np.sum(power / self.density(1.0 - lasting, lasting, rho))))

    def take_out(self, sizes: tuple[float, float, float]) -> None:
        """Take the directions out, by least squares under noise of these sizes."""
        density = self.density(*sizes)
        u, size, _ = np.linalg.svd((self.directions / np.sqrt(density)).T, full_matrices=False)
        basis = u[:, size > _RANK * size[0]]
        white = self.residual / np.sqrt(density)
        left = white - basis @ (basis.T @ white)
        remaining = 1.0 - (basis**2).sum(axis=1)
        self.use = remaining > _LEAST_SHARE
        self.weight = remaining[self.use]
        self.power = left[self.use] ** 2 * density[self.use] / self.weight

    def cost(self, lasting: float, rho: float) -> tuple[float, float]:
        """`-2 log L` at the best total variance, and that variance's logarithm."""
        if not (0.0 <= lasting <= 1.0 and 0.0 <= rho <= _LONGEST):
            return 1e12, 0.0
        shape = self.density(1.0 - lasting, lasting, rho)[self.use]
        count = self.weight.sum()
        total = np.log(self.weight @ (self.power / shape) / count)
        total *= 1.0 - 1.0 / (1.0 + 0.5 * count * _SPREAD**2)
        least = self.weight @ (np.log(shape) + total + self.power / shape * np.exp(-total))
        return float(least + (total / _SPREAD) ** 2), float(total)


def dct_spectrum(cov: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """`sum_k cov_k cos(k omega)` at the frequencies of a cosine transform."""
    count = len(cov)
    extended = np.concatenate([cov, np.zeros(count)])
    return np.fft.fft(extended).real[: len(omega)]


def edge_spectrum(cov: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """What a record's two ends take from the variance of each cosine coefficient.

    With `n` readings the coefficient at `a = pi k / n` has the variance
    `c_0 + 2 sum_l c_l ((1 - l/n) cos(a l) - sin(a l) / (n sin a))`, without the last term at k = 0.
    """
    count = len(cov)
    lag = np.arange(count)
    spectrum = np.fft.fft(np.concatenate([cov * lag, np.zeros(count)]))[: len(omega)].real
    sines = -np.fft.fft(np.concatenate([cov, np.zeros(count)]))[: len(omega)].imag
    return 2.0 / count * (spectrum + np.divide(sines, np.sin(omega), out=np.zeros(len(omega)), where=omega > 0))
