"""The filter of the faces' noise: against faces that are known, and against a spectrum that is known exactly."""

import numpy as np
import pytest
from benchmarks.reference.analytic_slab import weather
from numpy.testing import assert_allclose
from scipy.signal import lfilter
from simulated_faces import face

from wallid.records.face_filter import FaceFilter, face_filter
from wallid.records.face_spectrum import FREQUENCIES, WHITE, NoiseMemory

QUARTERS, NOISE = 288, 0.06  # three days of rows every quarter of an hour; K


@pytest.mark.parametrize(("gust", "rho", "share"), [(0.0, 0.6, 0.8), (0.1, 0.6, 0.93), (0.1, 0.9, 0.95)])
def test_faces_are_filtered_for_noise_with_a_memory(gust, rho, share):
    """Against a face that is known: nearer to it than with white noise, and by as much as the filter says."""
    rng, noise = np.random.default_rng(int(10 * rho)), 0.1
    true = face(rng, gust, days=40)[::10]
    own = lfilter([noise * np.sqrt(1 - rho**2)], [1.0, -rho], rng.standard_normal(len(true) + 200))[200:]
    readings = (true + own)[:, None]

    def errors_left(memory):
        own = face_filter(readings, 600.0, noise, memory)
        return own, np.std(own.filtered(readings, 600.0)[:, 0] - true)

    found, left = errors_left(NoiseMemory(1.0, rho))
    assert left < share * errors_left(WHITE)[1]
    one_sign = found.noise.autocovariance[0]
    of_white = np.concatenate([one_sign[:0:-1], one_sign])
    lags = np.abs(np.arange(len(of_white)) - len(of_white) // 2)
    assert np.sqrt(of_white @ rho**lags) == pytest.approx(left, rel=0.04)


def of_weather(theta):
    """The power at rows every quarter of an hour of weather with 8 and 2 hours and a variance of 1, every minute."""
    poles = np.exp(-1 / 60 / np.array([8.0, 2.0]))
    first, second = poles
    gain = (1 - first**2) * (1 - second**2) * (1 - first * second) / (1 + first * second)
    fine = (theta[:, None] + 2 * np.pi * np.arange(15)) / 15
    return (gain / np.abs((1 - first * np.exp(-1j * fine)) * (1 - second * np.exp(-1j * fine))) ** 2).mean(axis=1)


@pytest.fixture(scope="module")
def found_and_true():
    """The responses of the filters of 40 records of faces without gusts, their deviations, and the true responses."""
    theta = np.minimum(FREQUENCIES, 2 * np.pi - FREQUENCIES)[: len(FREQUENCIES) // 2 + 1]
    signal = of_weather(theta)[:, None] * [0.16, 1.0]

    def response(weights):
        lags = np.arange(weights.shape[-1]) - weights.shape[-1] // 2
        return (weights @ np.cos(np.outer(lags, theta))).swapaxes(-1, -2)

    found, stds = [], []
    for seed in range(40):
        rng = np.random.default_rng([9, seed])
        fine = weather(14_401 + 15 * (QUARTERS - 1), 60.0, rng, hours=(8.0, 2.0))
        faces = fine[14_400::15] + NOISE * rng.standard_normal((QUARTERS, 2))
        own = face_filter(faces, 900.0, NOISE)
        found.append(response(own.weights))
        stds.append(np.sqrt((response(own.deviations) ** 2).sum(axis=0)))
    return np.array(found), np.array(stds), signal / (signal + NOISE**2)


def test_noise_does_not_pass_for_gusts(found_and_true):
    """Where a face changes less than its noise, the filter is right in the mean."""
    found, _, true = found_and_true
    bias = found.mean(axis=0) - true
    assert np.abs(bias).max() < 0.05
    assert np.abs(bias[64:]).max() < 0.02, "the upper half of the frequencies"


def test_the_deviations_are_the_errors_of_the_filter(found_and_true):
    """Where the filter decides, its errors are as large as it says, over records."""
    found, stds, true = found_and_true
    decides = (true > 0.2) & (true < 0.9)
    z = ((found - true) / stds)[:, decides]
    assert 0.7 < np.sqrt(np.mean(z**2)) < 1.3


def test_the_courses_are_those_of_filters_with_other_weights():
    rng = np.random.default_rng(12)
    faces = weather(QUARTERS, 900.0, rng, hours=(8.0, 2.0)) + NOISE * rng.standard_normal((QUARTERS, 2))
    own = face_filter(faces, 900.0, NOISE)
    for course, change in zip(own.courses_of_deviations(faces, 900.0), own.deviations, strict=True):
        changed = FaceFilter(own.weights + change, own.noise, own.deviations)
        assert_allclose(course.T, changed.filtered(faces, 900.0) - own.filtered(faces, 900.0), atol=1e-12)
    sizes = np.sqrt(np.mean(own.courses_of_deviations(faces, 900.0) ** 2, axis=2))
    assert np.all(sizes[0] > sizes[1]) and np.all(sizes[1] > sizes[2]), "the largest first"
    assert np.all(sizes[0] < 0.3 * NOISE)


def test_without_a_spectrum_the_readings_stay():
    """Constant faces, few rows: nothing is filtered, nothing is uncertain, and the noise is all there."""
    for faces in (np.full((300, 2), 12.0), np.random.default_rng(3).standard_normal((10, 2))):
        own = face_filter(faces, 3600.0, 0.1)
        assert_allclose(own.filtered(faces, 3600.0), faces, atol=1e-12)
        assert not own.courses_of_deviations(faces, 3600.0).any()
        assert_allclose(own.noise.limited(1.0, 0.0, 0.0)[:, 0], 0.01)
