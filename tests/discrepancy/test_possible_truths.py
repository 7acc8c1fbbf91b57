"""What a true effect may be, against the posterior by numerical integration and against bounds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import norm

from wallid.discrepancy.next_measurement.possible_truths import (
    normal_draws,
    open_shares,
    possible_changes,
    shortened,
)


def changes_of(size, std, place=0.1, place_std=0.01):
    """Of an effect whose size and position, 0 to 0.4 m, are estimated independently."""
    covariance, bounds = np.diag([std**2, place_std**2]), np.array([[-np.inf, 0.0], [np.inf, 0.4]])
    return possible_changes(np.array([size, place]), covariance, std, *bounds)


@pytest.mark.parametrize("size", [2.0, -2.0])
def test_a_size_is_as_likely_in_each_decade_before_the_record(size):
    """The mean of the posterior with the prior 1 / size, by numerical integration."""
    std = 0.3

    def integral(power):
        return quad(lambda s: s ** (power - 1) * norm.pdf(s, abs(size), std), 0.2, 4.0)[0]

    changes = changes_of(size, std)
    assert abs(size + changes[:, 0].mean()) == pytest.approx(integral(1) / integral(0), abs=0.01)
    assert changes[:, 1].mean() == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("std", "expected"), [(0.02, None), (1e3, 1.0)])
def test_the_share_of_a_range_that_is_left_open(std, expected):
    """The mean likelihood over the range, over the highest one, by numerical integration; one that says nothing."""
    lower, upper, best = 0.1, 0.5, 0.27
    if expected is None:
        likelihood = quad(lambda place: np.exp(-0.5 * ((place - best) / std) ** 2), lower, upper, points=[best])[0]
        expected = likelihood / (upper - lower)
    assert open_shares(*np.array([[std], [lower], [upper]])) == pytest.approx([expected], rel=1e-6)


def test_draws_have_the_covariance():
    covariance = np.array([[4.0, 1.5e-3], [1.5e-3, 1e-6]])
    draws = normal_draws(covariance)
    assert draws.mean(axis=0) == pytest.approx(np.zeros(2), abs=1e-12)
    assert np.cov(draws.T, bias=True) == pytest.approx(covariance, rel=1e-9)


@given(st.floats(-5.0, 5.0).filter(lambda size: abs(size) > 0.01), st.floats(0.1, 3.0), st.floats(0.0, 0.4))
def test_no_draw_leaves_the_search_range_or_changes_the_sign(size, ratio, place):
    changes = changes_of(size, ratio * abs(size), place, place_std=0.3)
    sizes, places = size + changes[:, 0], place + changes[:, 1]
    assert np.all(sizes * np.sign(size) >= -1e-12)
    assert np.all(places >= -1e-12) and np.all(places <= 0.4 + 1e-12)


def test_a_draw_ends_at_the_bound_in_its_direction():
    draws = np.array([[1.0, 4.0], [-1.0, 0.5], [0.0, 0.0]])
    found = shortened(draws, np.array([-0.5, -1.0]), np.array([3.0, 2.0]))
    assert found == pytest.approx(np.array([[0.5, 2.0], [-0.5, 0.25], [0.0, 0.0]]))
