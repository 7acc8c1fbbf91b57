"""What faces do between rows: against simulated faces that are known every minute, and against direct integration."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import toeplitz
from scipy.signal import lfilter
from scipy.special import logit

from wallid.records import face_variation
from wallid.records.face_variation import (
    FAST_BENDING_STD,
    SLOW_BENDING_STD,
    WHITE,
    FaceErrors,
    NoiseMemory,
    cubic_errors,
    from_cubics_to_lines,
    of_means,
)

MINUTES = 60  # of a row


def face(rng, gust, days=20):
    """A face every minute, degC: a daily cycle, smooth weather with 8 and 2 hours, and gusts of 15 minutes."""
    count = days * 24 * MINUTES
    poles = np.exp(-1 / 60 / np.array([8.0, 2.0]))
    smooth = lfilter([1.0], np.poly(poles), rng.standard_normal(count + 3000))[3000:]
    memory = np.exp(-1 / 15)
    rough = lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], rng.standard_normal(count))
    return 8 + 3 * np.sin(2 * np.pi * np.arange(count) / 1440) + smooth / smooth.std() + gust * rough


def autocovariance(values, step, noise_std):
    """Of the errors of one face."""
    return cubic_errors(values[:, None], step, noise_std).autocovariance[0]


def mean_of_cubic(values):
    """Means over each row but the first and last two of the cubics with central slopes, by quadrature."""
    rows = np.arange(len(values), dtype=float)
    cubic = CubicHermiteSpline(rows, values, np.gradient(values))
    return np.array([quad(cubic, k - 0.5, k + 0.5, points=[k])[0] for k in rows[2:-2]])


@pytest.mark.parametrize("gust", [0.1, 0.3])
@pytest.mark.parametrize("step", [10, 30, 60])
def test_the_error_between_rows_is_predicted_from_the_rows_alone(gust, step):
    """The predicted size against the true one, which only the face every minute shows."""
    rng = np.random.default_rng([4, step, int(10 * gust)])
    fine = face(rng, gust)
    rows = fine[::step]
    weights = np.ones(step + 1)
    weights[[0, -1]] = 0.5
    means = np.convolve(fine, weights / step, mode="valid")[step // 2 :: step][1 : len(rows) - 3]
    error = mean_of_cubic(rows)[: len(means)] - means[: len(rows) - 4]
    predicted = autocovariance(rows + 0.02 * rng.standard_normal(len(rows)), 60.0 * step, 0.02)
    assert np.sqrt(predicted[0]) == pytest.approx(error.std(), rel=0.25)
    slow = of_means(predicted, 6)[0] / np.var(error[: len(error) // 6 * 6].reshape(-1, 6).mean(axis=1))
    assert 0.5 < slow < 2.0, "what a wall responds to most is slow"


def test_a_smooth_face_has_next_to_no_error_and_its_noise_is_none():
    rng = np.random.default_rng(5)
    rows = face(rng, 0.0)[::10] + 0.05 * rng.standard_normal(2880)
    assert np.sqrt(autocovariance(rows, 600.0, 0.05)[0]) < 0.01


def test_a_constant_face_and_few_rows_have_no_error():
    assert not autocovariance(np.full(300, 12.0), 3600.0, 0.1).any()
    assert not autocovariance(np.arange(10.0), 3600.0, 0.1).any()


def test_the_change_from_cubics_to_lines_is_that_of_their_integrals():
    values = np.random.default_rng(6).standard_normal(12)
    lines = (values[1:-3] + 6 * values[2:-2] + values[3:-1]) / 8  # half of each neighbouring line
    assert_allclose(from_cubics_to_lines(values)[2:-2], lines - mean_of_cubic(values), atol=1e-12)


def test_the_parts_of_a_face_bend_each_by_its_own_share():
    """Gusts without memory are in the fast part, weather in the slow part; together they are the whole change."""
    rng = np.random.default_rng(7)
    weather, gusts = face(rng, 0.0)[::MINUTES], 0.3 * rng.standard_normal(480)
    whole = np.stack([weather + gusts, weather], axis=1)
    slow, fast = cubic_errors(whole, 3600.0, 0.02).bendings(whole, 3600.0)
    together = slow / SLOW_BENDING_STD + fast / FAST_BENDING_STD
    assert_allclose(together, [from_cubics_to_lines(values) for values in whole.T], atol=1e-12)
    assert_allclose(slow[1] / SLOW_BENDING_STD, from_cubics_to_lines(weather), atol=0.02)
    of_gusts = from_cubics_to_lines(gusts)
    assert np.corrcoef(fast[0], of_gusts)[0, 1] > 0.95
    of_weather = SLOW_BENDING_STD * from_cubics_to_lines(weather)
    assert np.std(slow[0] - of_weather) < 0.3 * SLOW_BENDING_STD * np.std(of_gusts)


def test_faces_without_errors_do_not_bend():
    assert not FaceErrors.none().bendings(np.random.default_rng(8).standard_normal((50, 2)), 3600.0).any()


def test_slow_changes_bend_by_a_twelfth_of_their_second_difference():
    values = 0.5 * np.arange(30.0) ** 2
    assert_allclose(from_cubics_to_lines(values)[2:-2], 1 / 12, atol=1e-12)


@settings(deadline=None, max_examples=30)
@given(st.integers(1, 9), st.lists(st.floats(-1, 1), min_size=1, max_size=12))
def test_the_covariance_of_means_is_that_of_the_rows_averaged(rows, lags):
    autocovariance = np.array(lags)
    count = 6 * rows + len(lags)
    blocks = count // rows
    full = toeplitz(np.pad(autocovariance, (0, count - len(lags))))[: blocks * rows, : blocks * rows]
    mean = np.kron(np.eye(blocks), np.full((1, rows), 1 / rows))
    want = (mean @ full @ mean.T)[0]
    found = of_means(autocovariance, rows)
    width = min(len(found), blocks)
    assert_allclose(found[:width], want[:width], atol=1e-12)
    assert_allclose(want[width:], 0.0, atol=1e-12)


@pytest.mark.parametrize(("gust", "rho", "share"), [(0.0, 0.6, 0.8), (0.1, 0.6, 0.93), (0.1, 0.9, 0.95)])
def test_faces_are_filtered_for_noise_with_a_memory(gust, rho, share):
    """Against a face that is known: nearer to it than with white noise, and by as much as the filter says."""
    rng, noise = np.random.default_rng(int(10 * rho)), 0.1
    true = face(rng, gust, days=40)[::10]
    own = lfilter([noise * np.sqrt(1 - rho**2)], [1.0, -rho], rng.standard_normal(len(true) + 200))[200:]
    readings = (true + own)[:, None]

    def errors_left(memory):
        errors = cubic_errors(readings, 600.0, noise, memory)
        return errors, np.std(errors.filtered(readings, 600.0)[:, 0] - true)

    errors, left = errors_left(NoiseMemory(1.0, rho))
    assert left < share * errors_left(WHITE)[1]
    one_sign = errors.filtered_noise.autocovariance[0]
    of_white = np.concatenate([one_sign[:0:-1], one_sign])
    lags = np.abs(np.arange(len(of_white)) - len(of_white) // 2)
    assert np.sqrt(of_white @ rho**lags) == pytest.approx(left, rel=0.04)


@pytest.mark.parametrize(
    ("rows", "gusts", "memory"),
    [(300, 0.02, WHITE), (300, 0.4, WHITE), (2000, 0.1, WHITE), (2000, 0.1, NoiseMemory(0.7, 0.8))],
)
def test_the_fitted_spectrum_is_the_most_probable(rows, gusts, memory):
    """The posterior written anew, each alias summed: no step of a twentieth either way lowers -2 log of it."""
    rng, noise = np.random.default_rng(rows), 0.05
    slow = lfilter([0.05], np.poly([0.95, 0.95]), rng.standard_normal(rows))
    values = slow + lfilter([gusts], [1.0, -0.5], rng.standard_normal(rows)) + noise * rng.standard_normal(rows)
    theta, power, count = face_variation._periodogram(values)
    w = theta[:, None] + 2.0 * np.pi * np.arange(-3000, 3001)
    of_noise = 1 - memory.share * (
        1 - (1 - memory.correlation**2) / np.abs(1 - memory.correlation * np.exp(1j * theta)) ** 2
    )

    def cost(logs):
        a, smooth_rate, b, rough_rate = np.exp(logs[:4])
        spectrum = 4 * a * smooth_rate**3 / (smooth_rate**2 + w**2) ** 2 + 2 * b * rough_rate / (rough_rate**2 + w**2)
        density = spectrum.sum(axis=1) + noise**2 * of_noise / (1.0 + np.exp(-logs[4]))
        priors = [(logs[1] - np.log(0.15)) / 1.5, (logs[3] - np.log(1.5)) / 1.5, (logs[4] - 2.0) / 2.0]
        return count @ (np.log(density) + power / density) + np.sum(np.square(priors))

    *parts, own = face_variation._fit(theta, power, count, noise, memory.spectrum(theta))
    found = np.array([*np.log(parts), logit(own / noise**2)])
    for step in 0.05 * np.eye(5):
        assert min(cost(found + step), cost(found - step)) > cost(found) - 1e-3
