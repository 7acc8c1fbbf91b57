"""The covariance of the residual of a correct model: the sensors' noise, and the faces' noise propagated by the wall.

    R = S C S' + sum_f G_f (C * N_f + V_f) G_f' + sum_g E_g E_g' + D,      C = v_w I + v_a AR(rho)

`S` holds the stated standard deviations of the inner sensors, and `G_f` the readings' response to a face. `N_f` is the
autocovariance of what white noise of a face's readings does to the temperature that drives the model: its variance, or,
beside a flux plate, the error of the filtered readings. `C * N_f` is its convolution with that of the noise. `V_f` is
the covariance of what a face does between its readings (`records.face_variation`), and `E_g` the effect of the
interpolation of a face over the gap g (`noise_of_record`). White noise and autocorrelated noise (a first-order
autoregression) have variances relative to the stated one. They are estimated together with `rho`
(`whittle_likelihood`). `D` is the part by a disturbance (`disturbance_covariance`), which takes the place of the
autocorrelated noise. Position errors and offsets are no noise: they are parameters with priors.

`R` is dense, so more than `MAX_READINGS` readings are replaced by means over bins of rows.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

from .._internal.arrays import on_device
from ..records.face_filter import FaceNoise
from ..records.face_variation import of_means

MAX_READINGS = 1500
"""Rows are averaged over bins until there are no more readings than this, because their covariance is dense."""


class BinnedReadings(eqx.Module):
    """Readings, and their means over bins of rows.

    They may be those of the first rows of a window: of longer arrays the first rows are used.

    Args:
        observed: readings at the rows, degC (W/m2 for a flux), 0 where missing.
        present: 1 where there is a reading, 0 where it is missing.
        rows_per_bin: number of rows in a bin.
    """

    observed: Float[Array, "time sensor"]
    present: Float[Array, "time sensor"]
    rows_per_bin: int = eqx.field(static=True)

    @property
    def readings(self) -> int:
        """The number of means: bins times sensors."""
        return -(-self.observed.shape[0] // self.rows_per_bin) * self.observed.shape[1]

    @property
    def nonempty(self) -> int:
        """The number of means that contain a reading."""
        return int((np.asarray(self.counts()) > 0).sum())

    @eqx.filter_jit
    def mean(self, values: Float[Array, "time sensor"]) -> Float[Array, " reading"]:
        """The mean of the readings present in each bin, sensor by sensor; 0 in an empty bin."""
        count = self._sum(self.present)
        total = self._sum(values[: self.present.shape[0]] * self.present)
        return (total / jnp.maximum(count, 1.0)).T.reshape(-1)

    @eqx.filter_jit
    def counts(self) -> Float[Array, "bin sensor"]:
        """The number of readings in each bin."""
        return self._sum(self.present)

    def in_bins_for(self, readings: int, spacing: int) -> BinnedReadings:
        """The same readings in bins as long as those of more readings: a whole number of present bins.

        Args:
            readings: rows times sensors.
            spacing: of the readings in rows.
        """
        factor = max(1, round(rows_in_a_bin(readings, spacing) / self.rows_per_bin))
        return BinnedReadings(self.observed, self.present, self.rows_per_bin * factor)

    def in_coarser_bins(self, finer: BinnedReadings) -> Callable[[np.ndarray], np.ndarray]:
        """The function from means over finer bins, `(*, reading)`, to means over these, weighted by the readings."""
        factor = self.rows_per_bin // finer.rows_per_bin
        counts = np.asarray(finer.counts()).T  # (sensor, bin)
        missing = -counts.shape[1] % factor

        def total(values: np.ndarray) -> np.ndarray:
            padded = np.pad(values, [(0, 0)] * (values.ndim - 1) + [(0, missing)])
            return padded.reshape(*values.shape[:-1], -1, factor).sum(axis=-1)

        def coarser(values: np.ndarray) -> np.ndarray:
            by_sensor = values.reshape(*values.shape[:-1], *counts.shape)
            means = total(by_sensor * counts) / np.maximum(total(counts), 1.0)
            return means.reshape(*values.shape[:-1], -1)

        return coarser

    def _sum(self, values: Array) -> Array:
        missing_rows = -values.shape[0] % self.rows_per_bin
        padded = jnp.pad(values, ((0, missing_rows), (0, 0)))
        return padded.reshape(-1, self.rows_per_bin, values.shape[1]).sum(axis=1)


def bin_readings(present: np.ndarray, observed: np.ndarray, *, plates: bool) -> tuple[BinnedReadings, int]:
    """The readings in bins, few enough for a dense covariance, and the spacing of the readings in rows.

    A slow temperature answers to the faces' means between its readings, so a record without plates may be thinned to
    the rows with readings. A flux answers mostly to the face in its own row.

    Args:
        present: whether there is a reading, `(time, sensor)`.
        observed: the readings, degC (W/m2 for a flux), `(time, sensor)`.
        plates: whether fluxes are among the readings.

    Returns:
        the bins; and the greatest common divisor of the distances between rows with readings, 1 with plates.
    """
    rows = np.flatnonzero(present.any(axis=1))
    spacing = math.gcd(*np.diff(rows).tolist()) if len(rows) > 1 and not plates else 1
    rows_per_bin = rows_in_a_bin(present.size, spacing)
    return BinnedReadings(on_device(observed), on_device(present.astype(float)), rows_per_bin), spacing


def rows_in_a_bin(readings: int, spacing: int) -> int:
    """The rows of a bin, so that there are at most `MAX_READINGS` means.

    Args:
        readings: rows times sensors.
        spacing: of the readings in rows.
    """
    return spacing * max(1, math.ceil(readings / spacing / MAX_READINGS))


def restricted_to_reading_rows(
    response: np.ndarray, bins: BinnedReadings, spacing: int, face_errors: np.ndarray
) -> tuple[np.ndarray, BinnedReadings, np.ndarray]:
    """The response to the faces, and the readings' bins, on the rows with readings only, `spacing` rows apart.

    The faces' noise of all rows between two readings enters as that of its mean. So do the errors of their cubics.
    """
    if spacing == 1:
        return response, bins, face_errors
    first = np.arange(0, response.shape[1], spacing)
    observed, present = (on_device(np.add.reduceat(rows, first)) for rows in (bins.observed, bins.present))
    thinned = BinnedReadings(observed, present, bins.rows_per_bin // spacing)
    response = np.add.reduceat(response, first, axis=1) / math.sqrt(spacing)
    return response, thinned, np.stack([spacing * of_means(errors, spacing) for errors in face_errors])


def covariance_of_filtered(
    response: Float[np.ndarray, "bin sensor"], autocovariance: Float[np.ndarray, " bin"]
) -> Float[np.ndarray, "reading reading"]:
    """The covariance of the sensors' responses to one stationary process, `G C G'`, sensor by sensor.

    `C` has the process's autocovariance `c` along its diagonals. The columns of `G_p` are the impulse response `g_p` of
    sensor p, each one bin later than the one before. So each diagonal of the covariance is a running sum::

        R_pq[i, j] = R_pq[i-1, j-1] + g_p[i] h_q[j] + h_p[i] g_q[j] - c_0 g_p[i] g_q[j],      h = G c

    Args:
        response: of each sensor to 1 at the first bin.
        autocovariance: of the process, by lag in bins.

    Source: T. Kailath, S. Kung and M. Morf, J. Math. Anal. Appl. 68 (1979), 395.
    """
    bins, sensors = response.shape
    g = response.T
    h = np.stack([np.convolve(one, autocovariance)[:bins] for one in g])
    half = np.multiply.outer(g, h - 0.5 * autocovariance[0] * g)
    R = half + half.transpose(2, 3, 0, 1)
    for i in range(1, bins):
        R[:, i, :, 1:] += R[:, i - 1, :, :-1]
    return R.reshape(sensors * bins, sensors * bins)


def whitening_of(covariance: Float[np.ndarray, "reading reading"]) -> Float[np.ndarray, "reading reading"]:
    """W, lower triangular, with `W' W` the inverse of a covariance.

    Raises:
        numpy.linalg.LinAlgError: the covariance is not positive definite.
    """
    inverse, _ = scipy.linalg.lapack.dtrtri(np.linalg.cholesky(covariance), lower=1)
    return inverse


def quantile_over_shapes(
    probability: Float[np.ndarray, " shape"], ratio: Float[np.ndarray, " shape"], freedom: float
) -> float:
    """97.5 % quantile of a parameter's error in standard errors, averaged over the shapes that the noise may have.

    The root q of `sum_i p_i F(q / ratio_i) = 0.975`, with F Student's distribution, or the normal one where the noise
    is as stated.

    Args:
        probability: of each shape. ratio: the parameter's standard error with it, over the one that is the unit.
        freedom: degrees of freedom of the noise's size; infinite where it is as stated.
    """
    distribution = partial(scipy.special.stdtr, freedom) if np.isfinite(freedom) else scipy.special.ndtr
    solution = scipy.optimize.root_scalar(
        lambda q: probability @ distribution(q / ratio) - 0.975,
        bracket=(0.0, 1e3 * ratio.max()),
        method="brentq",
    )
    return float(solution.root)


@dataclass(frozen=True, eq=False)
class NoiseCovariance:
    """The covariance of the binned readings at one size and autocorrelation of the noise.

    Args:
        white, autocorrelated: variances of the white and of the autocorrelated part, over the stated variance.
        correlation: of the autocorrelated part, from row to row.
        covariance: of the binned readings, K2.
        rms_of_outputs: root mean square of the noise alone at the rows of each output, in its unit; NaN without a
            reading.
        log_power_std: standard deviation of the logarithm of the noise's power at low frequencies.
        degrees_of_freedom: of the estimate of the noise; infinite where the noise is as stated.
        shape_probability, std_ratio: the probability of each other shape of the noise, and a parameter's standard error
            with that shape over the one with this shape.
        whitenings_of_parts: whitening matrices of subsets of the readings, computed once.
        disturbance: the part of the covariance by a disturbance, K2; None without one.
    """

    white: float
    autocorrelated: float
    correlation: float
    covariance: np.ndarray = field(repr=False)
    rms_of_outputs: np.ndarray = field(repr=False)
    log_power_std: float = 0.0
    degrees_of_freedom: float = np.inf
    shape_probability: np.ndarray = field(default_factory=lambda: np.ones(1), repr=False)
    std_ratio: np.ndarray = field(default_factory=lambda: np.ones(1), repr=False)
    whitenings_of_parts: dict[bytes, np.ndarray] = field(default_factory=dict, repr=False)
    disturbance: np.ndarray | None = field(default=None, repr=False)

    @cached_property
    def whitening(self) -> Float[np.ndarray, "reading reading"]:
        """W, lower triangular, with `W' W` the inverse of the covariance.

        Raises:
            numpy.linalg.LinAlgError: the covariance is not positive definite.
        """
        return whitening_of(self.covariance)

    @cached_property
    def quantile(self) -> float:
        """97.5 % quantile of a parameter's error in standard errors, averaged over the probable shapes of the noise."""
        return quantile_over_shapes(self.shape_probability, self.std_ratio, self.degrees_of_freedom)

    @property
    def variance_inflation(self) -> float:
        """Inflation of a parameter's variance for the uncertainty of the noise's shape."""
        return float(self.shape_probability @ self.std_ratio**2)

    def __str__(self) -> str:
        total = self.white + self.autocorrelated
        share, text = self.autocorrelated / total, f"noise {np.sqrt(total):.2f} times the stated"
        if share * self.correlation <= 0.05:
            return text
        return f"{text}, {100 * share:.0f} % of its variance with correlation {self.correlation:.2f} from row to row"


def variance_of_mean(rho: float, rows: int) -> float:
    """The variance of the mean over some rows of a first-order autoregression with variance 1."""
    i = np.arange(rows)
    return float((rho ** np.abs(i[:, None] - i)).mean())


class NoiseShape:
    """The covariance of the binned readings for any size of the noise, at one model.

    Args:
        response: response of the readings at the rows to 1 K more at one row of one face, `(face, row, sensor)`, with
            straight lines between rows.
        bins: the readings.
        sensor_std: stated standard deviation of each sensor's readings, K.
        face_noise: of the temperatures that drive the model; its autocovariance is N.
        face_errors: autocovariance of the errors of each face's cubics between its readings, K2, `(face, lag)`.
        gap_errors: effect of one standard deviation of each gap's interpolation on the binned readings, K,
            `(gap, reading)`.
    """

    def __init__(
        self,
        response: np.ndarray,
        bins: BinnedReadings,
        sensor_std: np.ndarray,
        face_noise: FaceNoise,
        face_errors: np.ndarray,
        gaps: np.ndarray | None = None,
    ):
        rows, sensors = response.shape[1:]
        self.response, self.bins, self.sensor_count = response, bins, sensors
        self.present, self.counts = np.asarray(bins.present), np.asarray(bins.counts())
        self.rows_per_bin = bins.rows_per_bin
        self.bin_count = -(-rows // bins.rows_per_bin)
        self.sensor_std, self.face_noise, self.face_errors = sensor_std, face_noise, face_errors
        self.binned_face_errors = self.binned_autocovariance(face_errors)
        self.gap_errors = np.zeros((0, sensors * self.bin_count)) if gaps is None else gaps
        padded = np.pad(self.response, ((0, 0), (0, self.bin_count * bins.rows_per_bin - rows), (0, 0)))
        # response of a bin's mean to a change of a face over a bin
        step_response = np.cumsum(padded, axis=1)
        ends = step_response.reshape(2, self.bin_count, bins.rows_per_bin, sensors).mean(axis=2)
        self.binned_response = np.diff(ends, axis=1, prepend=0.0)  # (face, bin, sensor)

    @property
    def has_reading(self) -> np.ndarray:
        """Mask of the means that contain a reading, `(reading,)`."""
        return self.counts.T.reshape(-1) > 0

    def autocovariance(self, rho: float) -> np.ndarray:
        """Autocovariance of the bins' means of a first-order autoregression with variance 1, by lag."""
        m, lags = self.rows_per_bin, np.arange(self.bin_count)
        i = np.arange(m)
        within = variance_of_mean(rho, m)
        between = np.outer(rho ** (m - 1 - i), rho**i).mean() * rho  # lag 1: rho^(m + i - j)
        return np.where(lags == 0, within, between * rho ** (m * (lags - 1.0).clip(0)))

    def covariance_of(
        self, white: float, autocorrelated: float, rho: float, disturbance: np.ndarray | None = None
    ) -> NoiseCovariance:
        """The covariance with these variances (over the stated one) and this autocorrelation from row to row.

        Args:
            disturbance: the readings' covariance by a disturbance, K2; None for none.
        """
        C = scipy.linalg.toeplitz(self._autocovariance_of_noise(white, autocorrelated, rho))
        n, counts = self.bin_count, self.counts
        R = self.faces_covariance(white, autocorrelated, rho)
        for s, std in enumerate(self.sensor_std):
            block = slice(s * n, (s + 1) * n)
            R[block, block] += std**2 * C
            # the mean of fewer readings has more white noise
            excess = white / np.maximum(counts[:, s], 1.0) - white / self.rows_per_bin
            R[block, block] += np.diag(std**2 * excess)
        R += self.gap_errors.T @ self.gap_errors
        if disturbance is not None:
            R += disturbance
        missing = ~self.has_reading
        R[missing] = R[:, missing] = 0.0
        R[missing, missing] = 1.0
        rms = self._rms_of_outputs(white, autocorrelated, rho)
        return NoiseCovariance(white, autocorrelated, rho, R, rms, disturbance=disturbance)

    def faces_covariance(self, white: float, autocorrelated: float, rho: float) -> Float[np.ndarray, "reading reading"]:
        """The part of the covariance by the faces' noise and what they do between their readings, K2; without gaps."""
        noise = self.binned_face_noise(white, autocorrelated, rho)
        parts = zip(self.binned_response, noise + self.binned_face_errors, strict=True)
        R = np.sum([covariance_of_filtered(*part) for part in parts], axis=0)
        missing = ~self.has_reading
        R[missing] = R[:, missing] = 0.0
        return R

    def binned_face_noise(self, white: float, autocorrelated: float, rho: float) -> Float[np.ndarray, "face bin"]:
        """Autocovariance of the bins' means of each face's noise with these variances, by lag, K2."""
        lags = (self.bin_count + 1) * self.rows_per_bin
        return self.binned_autocovariance(self._face_noise_at_rows(lags, white, autocorrelated, rho))

    def binned_autocovariance(self, autocovariance: Float[np.ndarray, "face lag"]) -> Float[np.ndarray, "face bin"]:
        """Autocovariance of the bins' means of a process at each face, from that by lag in rows; zero beyond it."""
        binned = np.zeros((len(autocovariance), self.bin_count))
        for own, one in zip(binned, autocovariance, strict=True):
            lags = of_means(one, self.rows_per_bin)[: self.bin_count]
            own[: len(lags)] = lags
        return binned

    def _face_noise_at_rows(
        self, lags: int, white: float, autocorrelated: float, rho: float
    ) -> Float[np.ndarray, "face lag"]:
        """Autocovariance of each face's noise with these variances, by lag in rows, K2."""
        own = self.face_noise.limited(white, autocorrelated, rho)
        reach = own.shape[1] - 1
        noise = autocorrelated * rho ** np.abs(np.arange(-reach, lags + reach))
        noise[reach] += white
        both_signs = np.concatenate([own[:, :0:-1], own], axis=1)
        return np.stack([np.convolve(noise, one, mode="valid") for one in both_signs])

    def _autocovariance_of_noise(self, white: float, autocorrelated: float, rho: float) -> np.ndarray:
        """Autocovariance of the bins' means of noise with these variances, by lag."""
        autocovariance = autocorrelated * self.autocovariance(rho)
        autocovariance[0] += white / self.rows_per_bin
        return autocovariance

    def covariance_like(self, noise: NoiseCovariance) -> NoiseCovariance:
        """The covariance with the variances, the autocorrelation and the disturbance of another one."""
        return self.covariance_of(noise.white, noise.autocorrelated, noise.correlation, noise.disturbance)

    def stated_covariance(self) -> NoiseCovariance:
        """The covariance with all noise white and as stated."""
        return self.covariance_of(1.0, 0.0, 0.8)

    def stated_rms_of_outputs(self) -> np.ndarray:
        """Root mean square of the stated noise at the rows of each output, in its unit, the faces' part included.

        NaN for an output without a reading.
        """
        return self._rms_of_outputs(1.0, 0.0, 0.0)

    def face_variance(self, white: float, autocorrelated: float, rho: float) -> Float[np.ndarray, " sensor"]:
        """Variance of each output at the rows by the errors of the faces, in its unit squared."""
        rows = self.response.shape[1]
        of_readings = 2.0 * self._face_noise_at_rows(rows, white, autocorrelated, rho)  # of both signs of the lag
        of_readings[:, 0] /= 2.0
        spectrum = np.fft.rfft(self.response, 2 * rows, axis=1)
        correlation = np.fft.irfft(np.abs(spectrum) ** 2, axis=1)[:, :rows]  # (face, lag, sensor)
        lags = min(rows, self.face_errors.shape[1])
        of_cubics = 2.0 * self.face_errors[:, :lags]
        of_cubics[:, 0] /= 2.0
        of_readings[:, :lags] += of_cubics
        return np.einsum("flk,fl->k", correlation, of_readings)

    def _rms_of_outputs(self, white: float, autocorrelated: float, rho: float) -> np.ndarray:
        """Root mean square of the noise at the rows of each output, the faces' part included; NaN without a reading."""
        readings = self.present.sum(axis=0)
        variance = self.sensor_std**2 * (white + autocorrelated) + self.face_variance(white, autocorrelated, rho)
        gaps = (np.sum(self.gap_errors**2, axis=0) * self.counts.T.reshape(-1)).reshape(self.sensor_count, -1)
        power = readings * variance + gaps.sum(axis=1)
        return np.sqrt(np.divide(power, readings, out=np.full(len(power), np.nan), where=readings > 0))

    @property
    def largest_gap_errors(self) -> np.ndarray:
        """The largest gap errors, at most a tenth of the number of readings; the noise is estimated without them."""
        size = np.linalg.norm(self.gap_errors, axis=1)
        count = max(1, int((self.counts > 0).sum()) // 10)
        return self.gap_errors[np.argsort(-size)[:count]]
