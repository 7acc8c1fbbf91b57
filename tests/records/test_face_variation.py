"""What faces do between rows: against simulated faces that are known every minute, and against direct integration."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import toeplitz
from simulated_faces import MINUTES, face

from wallid.records.face_variation import (
    FAST_BENDING_STD,
    SLOW_BENDING_STD,
    FaceErrors,
    cubic_errors,
    from_cubics_to_lines,
    of_means,
)


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
