"""The covariance of what a good model leaves: the sensors' noise and the faces', which goes through the wall.

    R = S C S' + sum_f s_f^2 G_f C G_f' + sum_g E_g E_g',      C = v_w I + v_a AR(rho)

`S` holds the stated standard deviations of the inner sensors, `s_f` that of a face, and `G_f` the readings'
response to a face reading. `E_g` is what the interpolation of a face over the gap g makes of them (`filled`). White
noise and noise that remembers (a first-order autoregression) have sizes relative to what was stated, which are
estimated together with `rho` (`whittle`). Errors of position and offsets are no noise: they are parameters with priors.

`R` is dense: readings beyond `MOST_READINGS` are put together in bins.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property, partial

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

from .._internal.arrays import on_device

MOST_READINGS = 1500
"""Rows are put together in bins until there are no more readings than this: their covariance is dense."""


class Bins(eqx.Module):
    """Readings put together over so many rows.

    Args:
        observed: degC (W/m2 for a flux), 0 where missing. present: 1 where there is a reading.
        rows: of a bin.
    """

    observed: Float[Array, "time sensor"]
    present: Float[Array, "time sensor"]
    rows: int = eqx.field(static=True)

    @property
    def readings(self) -> int:
        """How many means there are."""
        return -(-self.observed.shape[0] // self.rows) * self.observed.shape[1]

    @eqx.filter_jit
    def mean(self, values: Float[Array, "time sensor"]) -> Float[Array, " reading"]:
        """The mean of the rows present in each bin, sensor by sensor; 0 in an empty one."""
        count = self._sum(self.present)
        total = self._sum(values * self.present)
        return (total / jnp.maximum(count, 1.0)).T.reshape(-1)

    @eqx.filter_jit
    def counts(self) -> Float[Array, "bin sensor"]:
        """How many rows of each bin have a reading."""
        return self._sum(self.present)

    def _sum(self, values: Array) -> Array:
        short = -values.shape[0] % self.rows
        padded = jnp.pad(values, ((0, short), (0, 0)))
        return padded.reshape(-1, self.rows, values.shape[1]).sum(axis=1)


def bins_of(present: np.ndarray, observed: np.ndarray) -> tuple[Bins, int]:
    """Readings in bins, as many as a dense covariance holds; and how many rows the readings are apart."""
    rows = np.flatnonzero(present.any(axis=1))
    apart = math.gcd(*np.diff(rows).tolist()) if len(rows) > 1 else 1
    enough = math.ceil(present.size / apart / MOST_READINGS)
    return Bins(on_device(observed), on_device(present.astype(float)), apart * max(1, enough)), apart


def thinned(response: np.ndarray, bins: Bins, apart: int) -> tuple[np.ndarray, Bins]:
    """A face's response and the readings' bins on the rows that have readings, where these are `apart` rows apart.

    The faces' noise of all rows in between comes through: as much as that of their mean.
    """
    if apart == 1:
        return response, bins
    short = ((0, 0), (0, -response.shape[1] % apart), (0, 0))

    def together(values: np.ndarray) -> np.ndarray:
        padded = np.pad(values, short)
        return padded.reshape(len(values), -1, apart, values.shape[-1]).sum(axis=2)

    observed, present = together(np.stack([np.asarray(bins.observed), np.asarray(bins.present)]))
    return together(response) / math.sqrt(apart), Bins(
        on_device(observed), on_device(present), bins.rows // apart
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Noise:
    """The noise's size and memory, and what follows from it.

    Args:
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
    autocorrelated: float
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
        share = partial(scipy.special.stdtr, self.freedom) if np.isfinite(self.freedom) else scipy.special.ndtr
        top = 1e3 * self.ratio.max()
        found = scipy.optimize.root_scalar(
            lambda q: self.chance @ share(q / self.ratio) - 0.975, bracket=(0.0, top), method="brentq"
        )
        return float(found.root)

    @property
    def widening(self) -> float:
        """Of a parameter's variance, by how uncertain the noise's shape is."""
        return float(self.chance @ self.ratio**2)

    def __str__(self) -> str:
        total = np.sqrt(self.white + self.autocorrelated)
        memory = ""
        if self.autocorrelated * self.correlation > 0.05 * (self.white + self.autocorrelated):
            share = self.autocorrelated / (self.white + self.autocorrelated)
            memory = f", {100 * share:.0f} % of its variance with correlation {self.correlation:.2f} from row to row"
        return f"noise {total:.2f} times the stated{memory}"


class NoiseShape:
    """What the covariance needs from one model: its response to a face reading.

    Args:
        response: of the readings at the rows to 1 K more at one row of one face, `(face, row, sensor)`; between
            its rows an error of a reading is a straight line.
        bins: the readings.
        sensor_std: of each sensor's readings, as stated, K. face_std: of the faces', K.
        gaps: what one standard deviation of each gap's interpolation makes of the binned readings, K, `(gap, reading)`.
    """

    def __init__(
        self,
        response: np.ndarray,
        bins: Bins,
        sensor_std: np.ndarray,
        face_std: float,
        gaps: np.ndarray | None = None,
    ):
        rows, sensors = response.shape[1:]
        self.response, self.bins, self.sensors = response, bins, sensors
        self.present, self.counts = np.asarray(bins.present), np.asarray(bins.counts())
        self.rows_per_bin = bins.rows
        self.count = -(-rows // bins.rows)
        self.sensor_std, self.face_std = sensor_std, face_std
        self.gaps = np.zeros((0, sensors * self.count)) if gaps is None else gaps
        padded = np.pad(self.response, ((0, 0), (0, self.count * bins.rows - rows), (0, 0)))
        # of a bin's mean to a change of a face over a whole bin
        held = np.cumsum(padded, axis=1)
        ends = held.reshape(2, self.count, bins.rows, sensors).mean(axis=2)
        self.binned = np.diff(ends, axis=1, prepend=0.0)  # (face, bin, sensor)

    def autocovariance(self, rho: float) -> np.ndarray:
        """Of bins' means of a first-order autoregression with variance 1, by lag."""
        m, lags = self.rows_per_bin, np.arange(self.count)
        i = np.arange(m)
        within = (rho ** np.abs(i[:, None] - i)).mean()
        between = np.outer(rho ** (m - 1 - i), rho**i).mean() * rho  # lag 1: rho^(m + i - j)
        return np.where(lags == 0, within, between * rho ** (m * (lags - 1.0).clip(0)))

    def noise(self, white: float, lasting: float, rho: float) -> Noise:
        """The covariance at these sizes."""
        cov = lasting * self.autocovariance(rho)
        cov[0] += white / self.rows_per_bin
        C = scipy.linalg.toeplitz(cov)
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
        whiten = scipy.linalg.solve_triangular(lower, np.eye(len(R)), lower=True)
        return Noise(white, lasting, rho, whiten, R, self._floor(white, lasting, rho))

    def stated(self) -> Noise:
        """The covariance with all noise as stated, none of which remembers."""
        return self.noise(1.0, 0.0, 0.8)

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


def _lower_toeplitz(column: np.ndarray) -> np.ndarray:
    return scipy.linalg.toeplitz(column, np.zeros_like(column))
