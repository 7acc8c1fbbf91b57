"""The search for a disturbance: its likelihood against the dense one, its priors against their statements."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import multivariate_normal

from wallid.inference.disturbance_covariance import DEPTHS_PER_DOUBLING
from wallid.inference.disturbance_search import (
    LARGEST_STD,
    SHORTEST_TIME,
    LikelihoodBesideNoise,
    RestrictedLikelihood,
    _prior_cost,
    _widths,
)

COUNT, MISSING = 40, 7


def problem(seed):
    """A residual, its Jacobian, covariances of noise and disturbance, and deviations from the priors."""
    rng = np.random.default_rng(seed)
    root, heat = rng.standard_normal((COUNT, COUNT)), np.cumsum(rng.standard_normal((COUNT, 12)), axis=0)
    noise, unit = root @ root.T / COUNT + np.eye(COUNT), heat @ heat.T
    present = rng.permutation(COUNT) >= MISSING
    return present, rng.standard_normal(COUNT), rng.standard_normal((COUNT, 3)), noise, unit, rng.standard_normal(3)


@given(st.integers(0, 10_000), st.lists(st.floats(0.01, 30.0), min_size=1, max_size=4))
def test_one_decomposition_serves_all_sizes(seed, sizes):
    present, residual, jacobian, noise, unit, deviation = problem(seed)
    likelihood = RestrictedLikelihood(present, residual, jacobian, deviation)
    points = LikelihoodBesideNoise(likelihood, noise).of_sizes(unit)(sizes)
    for size, one in zip(sizes, points, strict=True):
        other = likelihood.at(noise + size**2 * unit)
        assert one.cost == pytest.approx(other.cost, rel=1e-8, abs=1e-6)
        assert one.noise_size == pytest.approx(other.noise_size, rel=1e-6)
        np.testing.assert_allclose(one.shift, other.shift, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-6, atol=1e-10)


def test_differences_of_the_cost_are_those_of_the_marginal_likelihood():
    """The parameters with a prior integrated out; a parameter without one by a very wide prior."""
    present, residual, jacobian, noise, unit, deviation = problem(3)
    likelihood, wide = RestrictedLikelihood(present, residual, jacobian, deviation), 1e3
    # the residual is that at the estimates: the priors are about minus their deviations
    mean = jacobian[:, 1:] @ -deviation[1:]
    prior = wide**2 * np.outer(jacobian[:, 0], jacobian[:, 0]) + jacobian[:, 1:] @ jacobian[:, 1:].T

    def cost(size):
        point = LikelihoodBesideNoise(likelihood, noise).of_sizes(unit)([size])[0]
        covariance = point.noise_size * (noise + size**2 * unit) + prior
        kept = np.ix_(present, present)
        dense = -2.0 * multivariate_normal.logpdf(residual[present], mean[present], covariance[kept])
        return point.cost, dense + np.log(point.noise_size) ** 2

    (first, dense_first), (second, dense_second) = cost(0.3), cost(2.0)
    assert first - second == pytest.approx(dense_first - dense_second, abs=1e-3)


def test_the_parameters_are_those_of_the_dense_likelihood():
    """Estimates and covariance at the noise's best size, by plain linear algebra."""
    present, residual, jacobian, noise, unit, deviation = problem(5)
    points = LikelihoodBesideNoise(RestrictedLikelihood(present, residual, jacobian, deviation), noise)
    for size, point in zip((0.2, 1.5), points.of_sizes(unit)((0.2, 1.5)), strict=True):
        kept = np.ix_(present, present)
        inverse = np.linalg.inv(point.noise_size * (noise + size**2 * unit)[kept])
        precision = np.diag([0.0, 1.0, 1.0])
        covariance = np.linalg.inv(jacobian[present].T @ inverse @ jacobian[present] + precision)
        shift = covariance @ (jacobian[present].T @ inverse @ residual[present] - precision @ deviation)
        np.testing.assert_allclose(point.covariance, covariance, rtol=1e-8, atol=1e-12)
        np.testing.assert_allclose(point.shift, shift, rtol=1e-8, atol=1e-12)


def test_the_priors_are_as_stated():
    """95 % of the sizes below LARGEST_STD, 95 % of the time constants above SHORTEST_TIME; the cost is 0 at most."""

    def of_size(std):
        return np.exp(-0.5 * _prior_cost(std, 9.0 * SHORTEST_TIME))

    assert quad(of_size, 0, LARGEST_STD)[0] / quad(of_size, 0, 40 * LARGEST_STD)[0] == pytest.approx(0.95, abs=1e-6)

    def of_log_time(y):
        return np.exp(-0.5 * _prior_cost(0.0, np.exp(y)))

    ends = np.log(SHORTEST_TIME) + np.array([-6.0, 0.0, 40.0])
    shorter, longer = (quad(of_log_time, *pair, limit=200)[0] for pair in (ends[:2], ends[1:]))
    assert shorter / (shorter + longer) == pytest.approx(0.05, abs=1e-4)
    times = np.geomspace(60.0, 1e7, 400)
    assert min(_prior_cost(0.0, time) for time in times) == pytest.approx(0.0, abs=1e-3)


@given(st.sets(st.integers(0, 24), min_size=1))
def test_depths_weigh_by_what_they_stand_for(numbers):
    """A density that is the same for all depths has the same integral, however many depths are tried."""
    numbers = sorted(numbers)
    widths = _widths(numbers)
    assert list(widths) == numbers and min(widths.values()) > 0
    assert sum(widths.values()) == pytest.approx(numbers[-1] - numbers[0] + DEPTHS_PER_DOUBLING)
