"""The covariance of what a good model leaves: the sensors' noise and the faces', which goes through the wall.

    R = S C S' + sum_f s_f^2 G_f C G_f' + sum_g E_g E_g',      C = v_w I + v_a AR(rho)

`S` holds the stated standard deviations of the inner sensors, `s_f` that of a face, and `G_f` the readings'
response to a face reading. `E_g` is what the interpolation of a face over the gap g makes of them: one error, which
goes along the whole gap. White noise and noise that remembers (a first-order autoregression) have sizes that are
estimated, relative to what was stated, together with `rho`. Errors of position and offsets are no noise: they
are parameters with priors.

The sizes must neither eat what a parameter explains nor be inflated by it: they maximise Whittle's likelihood of
the residual's cosine transform with every direction that a parameter (or an effect that is looked for) could move the
readings in taken out: a restricted likelihood, each frequency weighted by the share that they leave.

Source: P. Whittle, Ark. Mat. 2 (1953), 423; D. A. Harville, J. Am. Stat. Assoc. 72 (1977), 320.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.fft import dct
from scipy.linalg import solve_triangular, toeplitz
from scipy.special import ndtr, stdtr

_LEAST_SHARE = 0.3  # a frequency of which the directions taken out leave less says nothing about noise
_RANK = 1e-4  # of the directions taken out, relative to the largest after whitening
_SPREAD = 1.0  # of ln(total variance / stated): how far the stated noise may be off
_MOST_GAPS = 300  # each is a direction in a dense covariance
_LONGEST = 0.98  # autocorrelation from row to row
_SHARES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
_CORRELATIONS = (0.3, 0.5, 0.6, 0.7, 0.76, 0.82, 0.86, 0.89, 0.92, 0.95, 0.97)

MOST_READINGS = 1500
"""Rows are put together in bins until there are no more readings than this: their covariance is dense."""


class Bins(eqx.Module):
    """Readings put together over so many rows.

    Arguments:
        observed: degC (W/m2 for a flux), 0 where missing. present: 1 where there is a reading.
        rows: of a bin.
    """

    observed: Float[Array, "time sensor"]
    present: Float[Array, "time sensor"]
    rows: int = eqx.field(static=True)

    def mean(self, values: Float[Array, "time sensor"]) -> Float[Array, " reading"]:
        """The mean of the rows present in each bin, sensor by sensor; 0 in an empty one."""
        count = self._sum(self.present)
        total = self._sum(values * self.present)
        return (total / jnp.maximum(count, 1.0)).T.reshape(-1)

    def counts(self) -> Float[Array, "bin sensor"]:
        """How many rows of each bin have a reading."""
        return self._sum(self.present)

    def _sum(self, values: Array) -> Array:
        short = -values.shape[0] % self.rows
        padded = jnp.pad(values, ((0, short), (0, 0)))
        return padded.reshape(-1, self.rows, values.shape[1]).sum(axis=1)


@dataclass(frozen=True, eq=False)
class Noise:
    """The noise's size and memory, and what follows from it.

    Arguments:
        white, lasting: variances over the stated ones, of the white and of the autocorrelated part.
        correlation: of the latter, from row to row.
        whiten: W, lower triangular, with `W' W` the inverse covariance of the binned readings.
        spread: standard deviation of ln(the power of slow noise), by which the screen allows for its estimate.
        floor: what noise alone would leave at the rows, root mean square, K.
        freedom: how many readings the size was estimated from; infinite where it was not.
        chance, ratio: how likely other shapes of the noise are, and a parameter's standard error with each over
            that with this one.
        parts: whitenings of some of the readings, made once.
    """

    white: float
    lasting: float
    correlation: float
    whiten: np.ndarray = field(repr=False)
    covariance: np.ndarray = field(repr=False)
    floor: float
    spread: float = 0.0
    freedom: float = np.inf
    chance: np.ndarray = field(default_factory=lambda: np.ones(1), repr=False)
    ratio: np.ndarray = field(default_factory=lambda: np.ones(1), repr=False)
    parts: dict[bytes, np.ndarray] = field(default_factory=dict, repr=False)

    @cached_property
    def quantile(self) -> float:
        """97.5 % quantile of a parameter's error in its standard errors, over all shapes that are likely.

        `sum_i p_i T((q / ratio_i) with `freedom` degrees) = 0.975`: Student's, and the normal one where nothing
        was estimated.
        """
        from scipy.optimize import brentq  # a quarter of a second, and the import of this package would pay it

        share = partial(stdtr, self.freedom) if np.isfinite(self.freedom) else ndtr
        top = 1e3 * self.ratio.max()
        found = brentq(lambda q: self.chance @ share(q / self.ratio) - 0.975, 0.0, top, full_output=True)[1]
        return float(found.root)

    @property
    def widening(self) -> float:
        """Of a parameter's variance, by how uncertain the noise's shape is."""
        return float(self.chance @ self.ratio**2)

    def __str__(self) -> str:
        total = np.sqrt(self.white + self.lasting)
        memory = ""
        if self.lasting * self.correlation > 0.05 * (self.white + self.lasting):
            share = self.lasting / (self.white + self.lasting)
            memory = f", {100 * share:.0f} % of its variance with correlation {self.correlation:.2f} from row to row"
        return f"noise {total:.2f} times the stated{memory}"


class NoiseModel:
    """What the covariance needs from one model: its response to a face reading.

    Arguments:
        response: of the readings at the rows to 1 K more at one row of one face, `(face, row, sensor)`; between
            its rows an error of a reading is a straight line.
        bins: the readings.
        sensor_std: of each sensor's readings, as stated, K. face_std: of the faces', K.
        gaps: what one standard deviation of each gap's interpolation makes of the binned readings, K, `(gap, reading)`.
        edges: whether the likelihood of noise that remembers counts that a record has two ends, which take some
            of its slow power. The search for effects does not: its bars were set without.
    """

    def __init__(
        self,
        response: np.ndarray,
        bins: Bins,
        sensor_std: np.ndarray,
        face_std: float,
        *,
        gaps: np.ndarray | None = None,
        edges: bool = True,
    ):
        rows, sensors = response.shape[1:]
        self.response, self.bins, self.sensors = response, bins, sensors
        self.present, self.counts = np.asarray(bins.present), np.asarray(bins.counts())
        self.rows_per_bin = bins.rows
        self.count = -(-rows // bins.rows)
        self.sensor_std, self.face_std, self.edges = sensor_std, face_std, edges
        self.gaps = np.zeros((0, sensors * self.count)) if gaps is None else gaps
        padded = np.pad(self.response, ((0, 0), (0, self.count * bins.rows - rows), (0, 0)))
        # of a bin's mean to a change of a face over a whole bin
        held = np.cumsum(padded, axis=1)
        ends = held.reshape(2, self.count, bins.rows, sensors).mean(axis=2)
        self.binned = np.diff(ends, axis=1, prepend=0.0)  # (face, bin, sensor)
        spectrum = np.fft.rfft(self.binned, 2 * self.count, axis=1)[:, : self.count]
        self.gain = (np.abs(spectrum) ** 2).sum(axis=0)  # (frequency, sensor)
        self._spectra: dict[float, np.ndarray] = {}

    def autocovariance(self, rho: float) -> np.ndarray:
        """Of bins' means of a first-order autoregression with variance 1, by lag."""
        m, lags = self.rows_per_bin, np.arange(self.count)
        i = np.arange(m)
        within = (rho ** np.abs(i[:, None] - i)).mean()
        between = np.outer(rho ** (m - 1 - i), rho**i).mean() * rho  # lag 1: rho^(m + i - j)
        return np.where(lags == 0, within, between * rho ** (m * (lags - 1.0).clip(0)))

    def density(self, white: float, lasting: float, rho: float) -> np.ndarray:
        """Variance of each cosine coefficient, `(frequency, sensor)`."""
        if rho not in self._spectra:
            cov = self.autocovariance(rho)
            omega = np.pi * np.arange(self.count) / self.count
            ends = edge_spectrum(cov, omega) if self.edges else 0.0
            self._spectra[rho] = np.maximum(2 * dct_spectrum(cov, omega) - cov[0] - ends, 1e-12)
        flat = white / self.rows_per_bin + lasting * self._spectra[rho]
        return flat[:, None] * (self.sensor_std**2 + self.face_std**2 * self.gain)

    def noise(self, white: float, lasting: float, rho: float) -> Noise:
        """The covariance at these sizes."""
        cov = lasting * self.autocovariance(rho)
        cov[0] += white / self.rows_per_bin
        C = toeplitz(cov)
        n, sensors, present = self.count, self.sensors, self.counts
        R = np.zeros((sensors * n, sensors * n))
        G = [np.concatenate([_lower_toeplitz(self.binned[face, :, s]) for s in range(sensors)]) for face in (0, 1)]
        for part in G:
            R += self.face_std**2 * (part @ C) @ part.T
        for s, std in enumerate(self.sensor_std):
            block = slice(s * n, (s + 1) * n)
            R[block, block] += std**2 * C
            fewer = white / np.maximum(present[:, s], 1.0) - white / self.rows_per_bin
            R[np.arange(s * n, (s + 1) * n), np.arange(s * n, (s + 1) * n)] += std**2 * fewer
        R += self.gaps.T @ self.gaps
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
        filled = (np.sum(self.gaps**2, axis=0) * self.counts.T.reshape(-1)).sum()
        return float(np.sqrt(((self.present * variance).sum() + filled) / self.present.sum()))

    @property
    def largest_gaps(self) -> np.ndarray:
        """The gaps that matter most, no more of them than a tenth of the readings: they are no part of the noise."""
        size = np.linalg.norm(self.gaps, axis=1)
        most = max(1, int((self.counts > 0).sum()) // 10)
        return self.gaps[np.argsort(-size)[:most]]


def _runs(there: np.ndarray) -> list[tuple[int, int]]:
    """First row and the row after the last of each run."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], there.astype(int), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def filled_gaps(
    fill_std: np.ndarray | None, face_std: float, response: np.ndarray, bins: Bins
) -> Float[np.ndarray, "gap reading"]:
    """What each gap's interpolation makes of the binned readings, one standard deviation of it, K.

    Of very many gaps only the largest.

    Arguments:
        fill_std: of the interpolated faces in each row, K, 0 where a face was read; None for none.
        face_std: of a face reading, K, which the covariance holds in every row already.
        response: of the readings at the rows to 1 K more at one row of one face, `(face, row, sensor)`.
    """
    present = np.asarray(bins.present)
    rows, sensors = present.shape
    found = []
    excess = np.zeros((rows, 2)) if fill_std is None else np.sqrt(np.maximum(fill_std**2 - face_std**2, 0.0))
    excess[~np.isfinite(excess)] = 0.0
    short = ((0, -rows % bins.rows), (0, 0))

    def total(values: np.ndarray) -> np.ndarray:
        return np.pad(values, short).reshape(-1, bins.rows, sensors).sum(axis=1)

    count = np.maximum(total(present), 1.0)
    gaps = [(side, first, end) for side in (0, 1) for first, end in _runs(excess[:, side] > 0)]
    gaps.sort(key=lambda gap: -float(excess[gap[1] : gap[2], gap[0]].sum()))
    for side, first, end in sorted(gaps[:_MOST_GAPS]):
        answer = np.zeros((rows, sensors))
        for row in range(first, end):
            answer[row:] += excess[row, side] * response[side, : rows - row]
        found.append((total(answer * present) / count).T.reshape(-1))
    return np.stack(found) if found else np.zeros((0, count.size))


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


def _lower_toeplitz(column: np.ndarray) -> np.ndarray:
    return toeplitz(column, np.zeros_like(column))


def estimate_noise(
    model: NoiseModel, residual: np.ndarray, directions: np.ndarray, along: np.ndarray | None = None
) -> Noise:
    """The noise that a residual shows beside these directions.

    Arguments:
        residual: of the binned readings, K, 0 where missing.
        directions: what an effect or a free parameter would add, `(direction, reading)`.
        along: a parameter's direction with the others taken out, `(reading,)`, for the ratios of its standard
            error; None for none.
    """
    if len(model.gaps):
        directions = np.concatenate([directions, model.largest_gaps])
    from scipy.optimize import minimize

    likelihood = _Whittle(model, residual, directions)
    grid = [(lasting, rho) for lasting in _SHARES for rho in _CORRELATIONS]
    lasting, rho, sizes, costs, totals = 0.0, 0.8, (1.0, 0.0, 0.8), np.zeros(len(grid)), np.zeros(len(grid))
    for _ in range(2):
        likelihood.take_out(sizes)
        costs, totals = np.array([likelihood.cost(*point) for point in grid]).T
        found = minimize(
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

    def __init__(self, model: NoiseModel, residual: np.ndarray, directions: np.ndarray):
        self.model = model
        present = model.counts.T > 0  # (sensor, bin)
        self.share = present.mean(axis=1).clip(0.05)  # a sensor often missing shows less noise at each frequency
        self.residual = self._transform(residual)
        X = self._transform(directions)
        self.directions = X / np.maximum(np.linalg.norm(X, axis=1, keepdims=True), 1e-300)

    def _transform(self, values: np.ndarray) -> np.ndarray:
        """Cosine coefficients, sensor by sensor."""
        shaped = values.reshape(*values.shape[:-1], self.model.sensors, self.model.count)
        return np.asarray(dct(shaped, type=2, norm="ortho", axis=-1)).reshape(*values.shape[:-1], -1)

    def _density(self, white: float, lasting: float, rho: float) -> np.ndarray:
        return (self.model.density(white, lasting, rho) * self.share).T.reshape(-1)

    def log_variance(self, along: np.ndarray, lasting: float, rho: float) -> float:
        """The logarithm of the variance of a parameter's estimate under noise of this shape, for a total of 1."""
        power = self._transform(along) ** 2
        return -float(np.log(np.sum(power / self._density(1.0 - lasting, lasting, rho))))

    def take_out(self, sizes: tuple[float, float, float]) -> None:
        """Take the directions out, by least squares under noise of these sizes."""
        density = self._density(*sizes)
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
        shape = self._density(1.0 - lasting, lasting, rho)[self.use]
        count = self.weight.sum()
        total = np.log(self.weight @ (self.power / shape) / count)
        total *= 1.0 - 1.0 / (1.0 + 0.5 * count * _SPREAD**2)
        least = self.weight @ (np.log(shape) + total + self.power / shape * np.exp(-total))
        return float(least + (total / _SPREAD) ** 2), float(total)
