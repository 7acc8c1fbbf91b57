"""The power of a face's temperature at each frequency: a daily cycle, a smooth process, gusts and the readings' noise.

The temperature of a face is a daily cycle and a Gaussian process with two parts: a smooth one (Matern 3/2) and a rough
one (Matern 1/2: gusts, clouds, a heater that switches). Their sizes and rates come from the power of the face's own
readings at high frequencies (Whittle likelihood):

    f_d(theta) = sum_j S(theta + 2 pi j) + n(theta),      S = 4 a^2 l^3 / (l^2 + w^2)^2 + 2 b^2 m / (m^2 + w^2)

`n` is the noise of the readings: white, or with the memory that a fit has found (`NoiseMemory`), and at most as large
as stated. Frequencies are in rad a row.

Source: P. Whittle, Ark. Mat. 2 (1953), 423; A. M. Yaglom, Correlation Theory of Stationary and Related Random Functions
(1987), 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from jaxtyping import Float

from .._internal.units import DAY

FREQUENCIES = 2.0 * np.pi * np.arange(256) / 256
"""The equal frequencies of a spectrum from 0 to 2 pi, rad a row."""
FOLDED = np.maximum(np.minimum(FREQUENCIES, 2.0 * np.pi - FREQUENCIES), 1e-6)
"""Each of them as the one below pi that looks the same at the rows; never 0."""
LAGS = 24
"""Rows, beyond which what a filter leaves is uncorrelated, and its weights are zero."""
ALIASES = np.arange(-12, 13)
"""Multiples of the sampling frequency."""
_FEWEST_ROWS = 24
_HARMONICS = 4  # of the day
_FIRST_FREQUENCY = 3  # of the transform: lower ones hold the trend
_MOST_FREQUENCIES = 60  # means of neighbouring ones
_TAPER_BANDWIDTH = 1.9  # frequencies that a Hann taper makes dependent
# priors of ln(l) and ln(m) in rad a row, and of the logit of the share of the stated noise
_PRIOR_MEAN, _PRIOR_STD = np.array([np.log(0.15), np.log(1.5), 2.0]), np.array([1.5, 1.5, 2.0])
_WITH_PRIOR = [1, 3, 4]  # of the five parameters
_REACH = 70.0  # of the logarithms from their first values: a part that is absent has no minimum
_SMALLEST_NOISE = 1e-4  # K, so that constant and rounded readings have a finite likelihood
_ABSENT = 1e-30  # K2, the variance of gusts that are left out
_GUSTS = 8.0  # the gain of ln(likelihood) from which on gusts are evident: none of 1,200 smooth faces had it
_RIDGE = 1e-9  # of the information, where two parameters act nearly alike


@dataclass(frozen=True)
class NoiseMemory:
    """The shape of a reading's noise: white noise and a first-order autoregression.

    Args:
        share: of its variance that is autocorrelated.
        correlation: of that part, from row to row.
    """

    share: float
    correlation: float

    def spectrum(self, omega: np.ndarray) -> np.ndarray:
        """Power at each frequency over the variance; `omega` in rad a row."""
        return 1.0 - self.share + self.share * autoregression_spectrum(self.correlation, omega)


WHITE = NoiseMemory(0.0, 0.0)
"""Noise without a memory."""


@dataclass(frozen=True, eq=False)
class FaceSpectrum:
    """The fitted spectrum of a face's readings without their daily cycle.

    Args:
        smooth, smooth_rate: variance of the smooth part, K2, and its rate, rad a row.
        rough, rough_rate: the same of the gusts.
        noise: variance of the readings' noise as found, K2.
        stated_noise: as stated, K2.
        memory: of the noise.
        cost: what the fit minimises: minus ln(likelihood), and the square of each deviation from a prior.
        frequencies, counts: of the power that was fitted: rad a row, and the number of independent values of each.
    """

    smooth: float
    smooth_rate: float
    rough: float
    rough_rate: float
    noise: float
    stated_noise: float
    memory: NoiseMemory
    cost: float
    frequencies: Float[np.ndarray, " value"]
    counts: Float[np.ndarray, " value"]

    def with_aliases(self, theta: Float[np.ndarray, " frequency"]) -> Float[np.ndarray, "frequency alias"]:
        """Power of both parts at each frequency and its aliases, K2; the outermost hold the rest of the gusts."""
        return _parts(theta, self.smooth, self.smooth_rate, self.rough, self.rough_rate)

    def slow(self, theta: Float[np.ndarray, " frequency"]) -> Float[np.ndarray, " frequency"]:
        """Power of the smooth part at the rows, K2."""
        return _parts(theta, self.smooth, self.smooth_rate, 0.0, self.rough_rate).sum(axis=1)

    def of_noise(self, theta: Float[np.ndarray, " frequency"]) -> Float[np.ndarray, " frequency"]:
        """Power of the noise, K2."""
        return self.noise * self.memory.spectrum(theta)

    def deviations(
        self, theta: Float[np.ndarray, " frequency"]
    ) -> tuple[Float[np.ndarray, "direction frequency"], Float[np.ndarray, "direction frequency"]]:
        """One posterior standard deviation of the powers of both parts, and of the noise, in each direction, K2.

        The posterior is normal, with the expected information of the Whittle likelihood

            I = sum_j c_j s_j s_j' / f_d(theta_j)^2 + prior,      s = d f_d / d psi,      c_j independent values

        The parameters psi are the variances, the logarithms of the rates and the logit of the noise's share of the
        stated one: of a part that is absent the variance is uncertain, not its logarithm.
        """
        of_parts, of_noise = self._slopes(self.frequencies)
        density = self.with_aliases(self.frequencies).sum(axis=1) + self.of_noise(self.frequencies)
        relative = (of_parts + of_noise) / density
        information = (relative * self.counts) @ relative.T
        information[_WITH_PRIOR, _WITH_PRIOR] += 2.0 / _PRIOR_STD**2
        unit = 1.0 / np.sqrt(np.diag(information))
        scaled = information * np.outer(unit, unit) + _RIDGE * np.eye(len(unit))
        root = scipy.linalg.solve_triangular(scipy.linalg.cholesky(scaled, lower=True), np.diag(unit), lower=True)
        of_parts, of_noise = self._slopes(theta)
        return root @ of_parts, root @ of_noise

    def _slopes(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the powers of both parts, and of the noise, by the parameters, `(param, frequency)`."""
        by_smooth, by_smooth_rate = _sampled_smooth_power(theta, 1.0, self.smooth_rate)
        by_rough, by_rough_rate = _sampled_rough_power(theta, 1.0, self.rough_rate)
        none = np.zeros_like(theta)
        by_share = (1.0 - self.noise / self.stated_noise) * self.of_noise(theta)
        return (
            np.stack([by_smooth, self.smooth * by_smooth_rate, by_rough, self.rough * by_rough_rate, none]),
            np.stack([none, none, none, none, by_share]),
        )


def has_spectrum(values: Float[np.ndarray, " time"]) -> bool:
    """Whether a face's readings are enough for a spectrum, and not constant."""
    return len(values) >= _FEWEST_ROWS and bool(np.ptp(values) > 0.0)


def fitted_spectrum(
    values: Float[np.ndarray, " time"], noise_std: float, memory: NoiseMemory, gusts: bool = True
) -> FaceSpectrum:
    """The spectrum of a face's readings without their daily cycle, at the largest posterior.

    Args:
        values: K.
        noise_std: of a reading, K.
        memory: of the noise.
        gusts: whether there is a rough part.
    """
    theta, power, counts = _periodogram(values)
    of_noise, stated = memory.spectrum(theta), max(noise_std, _SMALLEST_NOISE) ** 2
    variance = float(power.max()) * 0.1 + stated

    def cost(y: np.ndarray) -> tuple[float, np.ndarray]:
        """The cost, and its gradient."""
        smooth, smooth_rate, rough, rough_rate = np.exp(y[:4])
        share = scipy.special.expit(y[4])
        of_smooth, by_smooth_rate = _sampled_smooth_power(theta, smooth, smooth_rate)
        of_rough, by_rough_rate = _sampled_rough_power(theta, rough, rough_rate)
        density = of_smooth + of_rough + stated * share * of_noise
        by_share = stated * share * (1.0 - share) * of_noise
        slopes = np.stack([of_smooth, by_smooth_rate, of_rough, by_rough_rate, by_share])
        priors = (y[_WITH_PRIOR] - _PRIOR_MEAN) / _PRIOR_STD
        gradient = slopes @ (counts * (1.0 - power / density) / density)
        gradient[_WITH_PRIOR] += 2.0 * priors / _PRIOR_STD
        return float(counts @ (np.log(density) + power / density) + priors @ priors), gradient

    if gusts:
        starts = [(_PRIOR_MEAN[0], part * variance, np.log(rate)) for part in (1e-1, 1e-3) for rate in (0.3, 1.5)]
    else:  # their rate is that of its prior
        starts = [(np.log(rate), _ABSENT, _PRIOR_MEAN[1]) for rate in (0.05, 0.3)]
    of_gusts = _REACH if gusts else 0.0
    fits = []
    for smooth_rate, rough, rough_rate in starts:
        first = [np.log(variance), smooth_rate, np.log(rough), rough_rate, _PRIOR_MEAN[2]]
        reaches = (_REACH, _REACH, of_gusts, of_gusts, _REACH)
        bounds = [(one - reach, one + reach) for one, reach in zip(first, reaches, strict=True)]
        fits.append(scipy.optimize.minimize(cost, first, jac=True, method="L-BFGS-B", bounds=bounds))
    best = min(fits, key=lambda fit: fit.fun)
    smooth, smooth_rate, rough, rough_rate = map(float, np.exp(best.x[:4]))
    return FaceSpectrum(
        smooth, smooth_rate, rough, rough_rate, stated * float(scipy.special.expit(best.x[4])), stated, memory,
        float(best.fun), theta, counts,
    )  # fmt: skip


def spectrum_with_evident_gusts(
    values: Float[np.ndarray, " time"], noise_std: float, memory: NoiseMemory
) -> FaceSpectrum:
    """The same, without a rough part that the readings do not show.

    Gusts of the size of the noise can hardly be told from it. Where they are taken from readings that happen to be
    restless, noise passes for a change of the face.
    """
    with_gusts, without = (fitted_spectrum(values, noise_std, memory, gusts) for gusts in (True, False))
    return with_gusts if without.cost - with_gusts.cost > _GUSTS else without


def without_daily_cycle(values: np.ndarray, step: float) -> np.ndarray:
    """A face's temperatures without a parabola and the lowest harmonics of the day."""
    rows = np.arange(len(values))
    turn = 2.0 * np.pi * rows * step / DAY
    columns = [np.linspace(-1.0, 1.0, len(values)) ** power for power in range(3)]
    if len(values) * step >= 2.0 * DAY:
        harmonics = [k for k in range(1, _HARMONICS + 1) if k * step / DAY < 0.25]
        columns += [wave(k * turn) for k in harmonics for wave in (np.cos, np.sin)]
    design = np.stack(columns, axis=1)
    return values - design @ np.linalg.lstsq(design, values, rcond=None)[0]


def _periodogram(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frequencies in rad a row, mean power of each, and the number of independent values in the mean."""
    taper = np.hanning(len(values) + 2)[1:-1]
    power = np.abs(np.fft.rfft(taper * values))[_FIRST_FREQUENCY:] ** 2 / np.sum(taper**2)
    theta = 2.0 * np.pi * (_FIRST_FREQUENCY + np.arange(len(power))) / len(values)
    edges = np.unique(np.round(np.geomspace(1, len(power), _MOST_FREQUENCIES)).astype(int)) - 1
    count = np.diff(np.append(edges, len(power)))
    mean_theta, mean_power = (np.add.reduceat(column, edges) / count for column in (theta, power))
    return mean_theta, mean_power, count / _TAPER_BANDWIDTH


def _parts(theta: np.ndarray, smooth: float, smooth_rate: float, rough: float, rough_rate: float) -> np.ndarray:
    """Power at each frequency and its aliases, `(frequency, alias)`; the outermost hold the rest of the rough part."""
    w = theta[:, None] + 2.0 * np.pi * ALIASES
    rough_power = 2.0 * rough * rough_rate / (rough_rate**2 + w**2)
    total, _ = _sampled_rough_power(theta, rough, rough_rate)
    rough_power[:, [0, -1]] += 0.5 * (total - rough_power.sum(axis=1))[:, None]
    return _smooth_power(w**2, smooth, smooth_rate) + rough_power


def _smooth_power(squared_frequency: np.ndarray, variance: float, rate: float) -> np.ndarray:
    """Power of the smooth part."""
    return 4.0 * variance * rate**3 / (rate**2 + squared_frequency) ** 2


def _sampled_smooth_power(theta: np.ndarray, variance: float, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Power of the smooth part at the rows, all aliases together, and its derivative by the logarithm of the rate."""
    squares = (theta[:, None] + 2.0 * np.pi * ALIASES) ** 2
    of_alias = _smooth_power(squares, variance, rate)
    power = of_alias.sum(axis=1)
    return power, 3.0 * power - 4.0 * (of_alias / (1.0 + squares / rate**2)).sum(axis=1)


def autoregression_spectrum(rho: float | np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Power of a first-order autoregression with variance 1, over that of white noise; `omega` in rad a row."""
    return (1.0 - rho**2) / (1.0 - 2.0 * rho * np.cos(omega) + rho**2)


def _sampled_rough_power(theta: np.ndarray, variance: float, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Power of the rough part at the rows, all aliases together, and its derivative by the logarithm of the rate."""
    memory = np.exp(-rate)
    numerator, denominator = 1.0 - memory**2, 1.0 - 2.0 * memory * np.cos(theta) + memory**2
    by_memory = (-2.0 * memory * denominator + 2.0 * numerator * (np.cos(theta) - memory)) / denominator**2
    return variance * numerator / denominator, -rate * memory * variance * by_memory


def around_row(response: Float[np.ndarray, " frequency"]) -> Float[np.ndarray, " weight"]:
    """The weights of the readings around a row that have this response at `FREQUENCIES`."""
    weights = np.fft.ifft(response).real
    return np.concatenate([weights[-LAGS:], weights[: LAGS + 1]])


def weighted(values: Float[np.ndarray, " time"], weights: Float[np.ndarray, " weight"]) -> Float[np.ndarray, " time"]:
    """The weighted sums of the values around each row."""
    padded = np.pad(values, len(weights) // 2, mode="reflect", reflect_type="odd")
    return np.convolve(padded, weights, mode="valid")


def with_daily_cycle(values: Float[np.ndarray, " time"], step: float, weights: np.ndarray) -> np.ndarray:
    """The daily cycle of a face's readings, and the weighted sums of the rest around each row, degC.

    Args:
        values: degC.
        step: from row to row, s.
        weights: of the readings around a row.
    """
    rest = without_daily_cycle(values, step)
    return values - rest + weighted(rest, weights)
