"""The spectrum of a face: against its posterior written anew, and against spectra that are known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import approx_fprime
from scipy.signal import lfilter

from wallid.records import face_spectrum
from wallid.records.face_spectrum import WHITE, NoiseMemory, fitted_spectrum, spectrum_with_evident_gusts

NOISE = 0.05


def readings(rows, gusts, seed):
    """Weather without a daily cycle, gusts and noise, K."""
    rng = np.random.default_rng(seed)
    slow = lfilter([0.05], np.poly([0.95, 0.95]), rng.standard_normal(rows))
    return slow + lfilter([gusts], [1.0, -0.5], rng.standard_normal(rows)) + NOISE * rng.standard_normal(rows)


def density(parameters, w, of_noise):
    """Written anew, each alias of `w` summed; parameters are logarithms, and the logit of the noise's share."""
    a, smooth_rate, b, rough_rate = np.exp(parameters[:4])
    spectrum = 4 * a * smooth_rate**3 / (smooth_rate**2 + w**2) ** 2 + 2 * b * rough_rate / (rough_rate**2 + w**2)
    return spectrum.sum(axis=1) + NOISE**2 * of_noise / (1.0 + np.exp(-parameters[4]))


def found_by(spectrum):
    """The parameters of `density`."""
    share = spectrum.noise / NOISE**2
    sizes = [spectrum.smooth, spectrum.smooth_rate, spectrum.rough, spectrum.rough_rate, share / (1.0 - share)]
    return np.log(sizes)


def of_memory(memory, theta):
    """The power of noise with a memory, over its variance."""
    autoregression = (1 - memory.correlation**2) / np.abs(1 - memory.correlation * np.exp(1j * theta)) ** 2
    return 1 - memory.share * (1 - autoregression)


@pytest.mark.parametrize(
    ("rows", "gusts", "memory"),
    [(300, 0.02, WHITE), (300, 0.4, WHITE), (2000, 0.1, WHITE), (2000, 0.1, NoiseMemory(0.7, 0.8))],
)
@pytest.mark.parametrize("with_gusts", [True, False])
def test_the_fitted_spectrum_is_the_most_probable(rows, gusts, memory, with_gusts):
    """No step of a twentieth either way lowers -2 log of the posterior."""
    values = readings(rows, gusts, rows)
    theta, power, count = face_spectrum._periodogram(values)
    w = theta[:, None] + 2.0 * np.pi * np.arange(-3000, 3001)
    of_noise = of_memory(memory, theta)

    def cost(parameters):
        own = density(parameters, w, of_noise)
        a, b, c = parameters[[1, 3, 4]] - [np.log(0.15), np.log(1.5), 2.0]
        return count @ (np.log(own) + power / own) + (a / 1.5) ** 2 + (b / 1.5) ** 2 + (c / 2.0) ** 2

    spectrum = fitted_spectrum(values, NOISE, memory, with_gusts)
    found = found_by(spectrum)
    for step in 0.05 * np.eye(5)[[0, 1, 2, 3, 4] if with_gusts else [0, 1, 4]]:
        assert min(cost(found + step), cost(found - step)) > cost(found) - 1e-3
    assert spectrum.cost == pytest.approx(cost(found), abs=0.05)


def test_gusts_are_in_the_spectrum_where_the_readings_show_them():
    for seed in range(20):
        assert spectrum_with_evident_gusts(readings(300, 0.0, [1, seed]), NOISE, WHITE).rough < 1e-20
        assert spectrum_with_evident_gusts(readings(300, 0.2, [1, seed]), NOISE, WHITE).rough > 0.01


def test_the_deviations_are_those_of_the_posterior():
    """The covariance of the density by the information with numerical derivatives, in the parameters' logarithms."""
    spectrum = fitted_spectrum(readings(600, 0.1, 3), NOISE, WHITE)
    theta, counts = spectrum.frequencies, spectrum.counts
    w = theta[:, None] + 2.0 * np.pi * np.arange(-300, 301)
    slopes = approx_fprime(found_by(spectrum), lambda p: density(p, w, np.ones(len(theta))), 1e-6)
    own = density(found_by(spectrum), w, np.ones(len(theta)))
    information = (slopes.T * counts / own**2) @ slopes
    information[[1, 3, 4], [1, 3, 4]] += 2.0 / np.array([1.5, 1.5, 2.0]) ** 2
    want = slopes @ np.linalg.inv(information) @ slopes.T
    of_parts, of_noise = spectrum.deviations(theta)
    changes = of_parts + of_noise
    assert_allclose(np.sqrt(np.diag(changes.T @ changes)), np.sqrt(np.diag(want)), rtol=2e-3)
    apart = of_noise.T @ of_noise
    assert_allclose(apart, apart[0, 0] * np.ones_like(apart), rtol=1e-6, err_msg="the noise is white")


def test_gusts_that_are_absent_may_be_there_all_the_same():
    """The variance of gusts is uncertain where none are found, and less so with more rows."""
    short, long = (fitted_spectrum(readings(rows, 0.0, 4), NOISE, WHITE, gusts=False) for rows in (300, 3000))
    middle = np.array([1.5])
    uncertain = [np.linalg.norm(one.deviations(middle)[0]) / NOISE**2 for one in (short, long)]
    assert 0.02 < uncertain[1] < 0.6 * uncertain[0] < 0.3
