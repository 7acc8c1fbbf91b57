"""What a face does between two rows, which no reading shows: the errors of the cubics through its readings.

A wall responds to the mean of its face over the time of a row. The mean of a cubic through the readings is right for a
smooth face, that of straight lines for a face that changes at random. Readings do not show which of the two a face is.
So each face has an error that is the same share in all rows: of the change from cubics to straight lines. It has a
share for the slow part of the face (weather, the day) and another for the fast part (gusts). Of gusts that are shorter
than a row, the mean over a row contains next to nothing of the reading, while a cubic through the reading does. On 36
measured faces that were thinned out (London, Tampere, ice in Nepal) the root mean square of one share for both was 0.7.

A second error varies from row to row. The temperature of a face is a daily cycle and a Gaussian process with two parts:
a smooth one (Matern 3/2) and a rough one (Matern 1/2: gusts, clouds, a heater that switches). Their sizes and rates
come from the power of the face's own readings at high frequencies (Whittle likelihood):

    f_d(theta) = sum_j S(theta + 2 pi j) + s^2,      S = 4 a^2 l^3 / (l^2 + w^2)^2 + 2 b^2 m / (m^2 + w^2)

The mean of the cubic over a row is in error by a stationary process with the spectrum

    E(theta) = sum_j S(theta + 2 pi j) (sinc_j - H(theta))^2,      sinc_j = sin(w / 2) / (w / 2)

`H` is the weight that the mean of a cubic over a row gives to the readings around it. Frequencies are in rad a row.
The slow part is the daily cycle and the smooth process as its Wiener filter finds it in the readings:

    W(theta) = sum_j S_smooth(theta + 2 pi j) / f_d(theta)

The readings without their noise are the daily cycle and what the Wiener filter finds in the rest, `H = 1 - n / f_d`.
The noise `n` is the stated `s^2`, or the smallest value of `f_d` where that is lower. They are in error by a stationary
process with the spectrum `H n`. Where the noise is found to be autocorrelated, its spectrum takes the place of `n`, in
`H` if the sensors inside the wall show it (`NoiseMemory`). Its size is then at most that at which it nowhere exceeds
`f_d`.

Source: P. Whittle, Ark. Mat. 2 (1953), 423; A. M. Yaglom, Correlation Theory of Stationary and Related Random Functions
(1987), 1.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy
from jaxtyping import Float

from .._internal.units import DAY

SLOW_BENDING_STD = 0.7
"""Standard deviation of the course of a face's slow part, from the cubics (0) towards straight lines (1)."""
FAST_BENDING_STD = 3.0
"""The same of the fast part: gusts of a quarter of a row need about 4, gusts that no two instants share 9."""
_ALIASES = np.arange(-12, 13)  # multiples of the sampling frequency
_HARMONICS = 4  # of the day
_FIRST_FREQUENCY = 3  # of the transform: lower ones hold the trend
_MOST_FREQUENCIES = 60  # means of neighbouring ones
_TAPER_BANDWIDTH = 1.9  # frequencies that a Hann taper makes dependent
_LAGS = 24  # rows, beyond which the errors are uncorrelated
_FEWEST_ROWS = 24
_GRID = 2.0 * np.pi * np.arange(256) / 256
# priors of ln(l) and ln(m) in rad a row, and of the logit of the share of the stated noise
_PRIOR_MEAN, _PRIOR_STD = np.array([np.log(0.15), np.log(1.5), 2.0]), np.array([1.5, 1.5, 2.0])
_REACH = 70.0  # of the logarithms from their first values: a part that is absent has no minimum
_SMALLEST_NOISE = 1e-4  # K, so that constant and rounded readings have a finite likelihood
# the mean of a cubic over the row about its reading: weights of the reading, and of those one and two rows beside it
_MEAN_OF_CUBIC = (161.0 / 192.0, 18.0 / 192.0, -2.5 / 192.0)


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
class FaceErrors:
    """The errors of the cubics through the readings of two faces, as means over a row.

    Args:
        autocovariance: of the error that varies from row to row, by lag in rows, K2; zero beyond.
        slow_weights: of the readings around a row in its slow part, `_LAGS` before it to `_LAGS` after it.
        bending_std: standard deviation of the share of the slow and of the fast part.
        filter_weights: of the readings around a row in the reading without its noise.
        filtered_noise: the noise that is left in the readings without their noise.
    """

    autocovariance: Float[np.ndarray, "face lag"]
    slow_weights: Float[np.ndarray, "face weight"]
    bending_std: tuple[float, float] = (SLOW_BENDING_STD, FAST_BENDING_STD)
    filter_weights: Float[np.ndarray, "face weight"] = field(default_factory=lambda: np.ones((2, 1)))
    filtered_noise: FaceNoise = field(default_factory=lambda: FaceNoise.white(0.0))

    @classmethod
    def none(cls) -> FaceErrors:
        """No errors: faces that are known between their rows, or whose errors are left out or part of another noise."""
        return cls(np.zeros((2, 1)), np.zeros((2, 1)), (0.0, 0.0))

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
            [_slow_part(face, step, weights) for face, weights in zip(faces.T, self.slow_weights, strict=True)]
        )
        courses = (slow, filtered.T - slow)
        return np.stack(
            [
                np.stack([std * _line_minus_cubic(face) for face in part])
                for std, part in zip(self.bending_std, courses, strict=True)
            ]
        )

    def filtered(self, faces: Float[np.ndarray, "time face"], step: float) -> Float[np.ndarray, "time face"]:
        """The readings without their noise, degC.

        Args:
            faces: readings at uniform rows, degC.
            step: from row to row, s.
        """
        each = [_slow_part(face, step, weights) for face, weights in zip(faces.T, self.filter_weights, strict=True)]
        return np.stack(each, axis=1)

    def bendings(self, faces: Float[np.ndarray, "time face"], step: float) -> Float[np.ndarray, "part face time"]:
        """One standard deviation of the change of each face's mean over a row by how its slow and fast parts bend, K.

        Args:
            faces: readings at uniform rows, degC.
            step: from row to row, s.
        """
        changes = np.zeros((2, *faces.T.shape))
        if any(self.bending_std):
            for side, (face, weights) in enumerate(zip(faces.T, self.slow_weights, strict=True)):
                slow = _slow_part(face, step, weights)
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
    autocovariance, slow, weights, filtered, power = (
        np.stack(part)
        for part in zip(*(_errors_of_one(face, step, noise_std, memory) for face in faces.T), strict=True)
    )
    noise = FaceNoise(filtered, noise_std, power)
    return FaceErrors(autocovariance, slow, filter_weights=weights, filtered_noise=noise)


def _errors_of_one(values: np.ndarray, step: float, noise_std: float, memory: NoiseMemory) -> tuple[np.ndarray, ...]:
    """Autocovariance, slow and filter weights, autocovariance of the noise left, and power of a face's readings."""
    if len(values) < _FEWEST_ROWS or np.ptp(values) == 0.0:
        own = np.eye(2 * _LAGS + 1)[_LAGS]
        return np.zeros(_LAGS), own, own, noise_std**2 * own[_LAGS:-1], np.full(len(_GRID), np.inf)
    theta, power, count = _periodogram(_without_daily_cycle(values, step))
    smooth, smooth_rate, rough, rough_rate, noise = _fit(theta, power, count, noise_std, memory.spectrum(theta))
    theta = np.maximum(np.minimum(_GRID, 2.0 * np.pi - _GRID), 1e-6)
    spectrum = _error_spectrum(theta, smooth, smooth_rate, rough, rough_rate)
    slow = _parts(theta, smooth, smooth_rate, 0.0, rough_rate).sum(axis=1)
    of_noise = memory.spectrum(theta)
    total = _parts(theta, smooth, smooth_rate, rough, rough_rate).sum(axis=1) + noise * of_noise
    size = min(max(noise_std, _SMALLEST_NOISE) ** 2, float((total / of_noise).min()))
    response = 1.0 - size * of_noise / total
    return (
        np.fft.ifft(spectrum).real[:_LAGS],
        _around_row(slow / total),
        _around_row(response),
        noise_std**2 * np.fft.ifft(response).real[:_LAGS],
        total,
    )


def _around_row(response: np.ndarray) -> np.ndarray:
    """The weights of the readings around a row that have this frequency response."""
    weights = np.fft.ifft(response).real
    return np.concatenate([weights[-_LAGS:], weights[: _LAGS + 1]])


def _slow_part(values: np.ndarray, step: float, weights: np.ndarray) -> np.ndarray:
    """The daily cycle and the smooth process in a face's readings, degC."""
    rest = _without_daily_cycle(values, step)
    padded = np.pad(rest, len(weights) // 2, mode="reflect", reflect_type="odd")
    return values - rest + np.convolve(padded, weights, mode="valid")


def _without_daily_cycle(values: np.ndarray, step: float) -> np.ndarray:
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
    w = theta[:, None] + 2.0 * np.pi * _ALIASES
    rough_power = 2.0 * rough * rough_rate / (rough_rate**2 + w**2)
    total, _ = _sampled_rough_power(theta, rough, rough_rate)
    rough_power[:, [0, -1]] += 0.5 * (total - rough_power.sum(axis=1))[:, None]
    return _smooth_power(w**2, smooth, smooth_rate) + rough_power


def _smooth_power(squared_frequency: np.ndarray, variance: float, rate: float) -> np.ndarray:
    """Power of the smooth part."""
    return 4.0 * variance * rate**3 / (rate**2 + squared_frequency) ** 2


def autoregression_spectrum(rho: float | np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Power of a first-order autoregression with variance 1, over that of white noise; `omega` in rad a row."""
    return (1.0 - rho**2) / (1.0 - 2.0 * rho * np.cos(omega) + rho**2)


def _sampled_rough_power(theta: np.ndarray, variance: float, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Power of the rough part at the rows, all aliases together, and its derivative by the logarithm of the rate."""
    memory = np.exp(-rate)
    numerator, denominator = 1.0 - memory**2, 1.0 - 2.0 * memory * np.cos(theta) + memory**2
    by_memory = (-2.0 * memory * denominator + 2.0 * numerator * (np.cos(theta) - memory)) / denominator**2
    return variance * numerator / denominator, -rate * memory * variance * by_memory


def _fit(theta: np.ndarray, power: np.ndarray, count: np.ndarray, noise_std: float, of_noise: np.ndarray) -> np.ndarray:
    """Variance and rate of the smooth part, then of the rough part, and the noise's variance (Whittle likelihood).

    `of_noise` is the power of the noise at each frequency, over its variance.
    """
    noise = max(noise_std, _SMALLEST_NOISE) ** 2
    variance = float(power.max()) * 0.1 + noise
    squares = (theta[:, None] + 2.0 * np.pi * _ALIASES) ** 2

    def cost(y: np.ndarray) -> tuple[float, np.ndarray]:
        """The cost, and its gradient."""
        smooth, smooth_rate, rough, rough_rate = np.exp(y[:4])
        share = scipy.special.expit(y[4])
        of_alias = _smooth_power(squares, smooth, smooth_rate)
        of_smooth = of_alias.sum(axis=1)
        by_smooth_rate = 3.0 * of_smooth - 4.0 * (of_alias / (1.0 + squares / smooth_rate**2)).sum(axis=1)
        of_rough, by_rough_rate = _sampled_rough_power(theta, rough, rough_rate)
        density = of_smooth + of_rough + noise * share * of_noise
        by_share = noise * share * (1.0 - share) * of_noise
        slopes = np.stack([of_smooth, by_smooth_rate, of_rough, by_rough_rate, by_share])
        priors = (y[[1, 3, 4]] - _PRIOR_MEAN) / _PRIOR_STD
        gradient = slopes @ (count * (1.0 - power / density) / density)
        gradient[[1, 3, 4]] += 2.0 * priors / _PRIOR_STD
        return float(count @ (np.log(density) + power / density) + priors @ priors), gradient

    fits = []
    for rough in (1e-1, 1e-3):
        for rate in (0.3, 1.5):
            first = [np.log(variance), _PRIOR_MEAN[0], np.log(rough * variance), np.log(rate), _PRIOR_MEAN[2]]
            bounds = [(one - _REACH, one + _REACH) for one in first]
            fits.append(scipy.optimize.minimize(cost, first, jac=True, method="L-BFGS-B", bounds=bounds))
    best = min(fits, key=lambda fit: fit.fun).x
    return np.append(np.exp(best[:4]), noise * scipy.special.expit(best[4]))


def _error_spectrum(theta: np.ndarray, *parts: float) -> np.ndarray:
    """Spectrum of the error of a row's mean, K2."""
    w = theta[:, None] + 2.0 * np.pi * _ALIASES
    own, beside, next_one = _MEAN_OF_CUBIC
    weight = own + 2.0 * beside * np.cos(theta) + 2.0 * next_one * np.cos(2.0 * theta)
    return (_parts(theta, *parts) * (np.sinc(w / (2.0 * np.pi)) - weight[:, None]) ** 2).sum(axis=1)


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
