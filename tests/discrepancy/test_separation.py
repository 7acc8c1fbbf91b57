"""The probability that a future record names the right explanation, against simulated fits of linear models."""

import numpy as np
import pytest
import scipy
from hypothesis import given
from hypothesis import strategies as st

from wallid.discrepancy.next_measurement.other_weather import SAME_WEATHER
from wallid.discrepancy.next_measurement.separation import (
    Explanation,
    FitWithoutNoise,
    Growth,
    Separation,
    separation,
)

READINGS = 60


def explanations(seed=0, count=3):
    """Explanations with a nuisance parameter in common, whose own directions differ."""
    rng = np.random.default_rng(seed)
    common = rng.standard_normal(READINGS)
    made = []
    for _ in range(count):
        own = common + 0.6 * rng.standard_normal(READINGS)
        made.append(
            Explanation(1.5 * own, np.stack([common, own], axis=1), np.array([0.0, 1.5]), np.array([0.5, np.inf]))
        )
    return made


def separated(true, rivals, length=1.0):
    blocks = np.full(len(true.predicted), SAME_WEATHER)
    own, *others = (FitWithoutNoise(one, length, blocks) for one in (true, *rivals))
    return separation(own, others)


def costs(readings, models, whitening):
    """The smallest cost of each model by SciPy, parameters with their priors."""
    found = []
    for one in models:
        precision = 1.0 / one.prior_std

        def residual(step, one=one, precision=precision):
            fitted = one.predicted + one.jacobian @ step
            return np.concatenate([whitening @ (readings - fitted), precision * (one.values + step)])

        found.append(2.0 * scipy.optimize.least_squares(residual, np.zeros(2), method="lm").cost)
    return np.array(found)


def test_probability_is_that_of_simulated_records():
    true, *rivals = explanations()
    rng = np.random.default_rng(4)
    root = np.linalg.cholesky(scipy.linalg.toeplitz(0.5 ** np.arange(READINGS)))
    whitening = np.linalg.inv(root)
    stated = separated(true.whitened(whitening), [one.whitened(whitening) for one in rivals])
    excesses = []
    for _ in range(300):
        all_costs = costs(true.predicted + root @ rng.standard_normal(READINGS), [true, *rivals], whitening)
        excesses.append(all_costs[1:] - all_costs[0])
    excesses = np.array(excesses)
    assert np.allclose(np.cov(excesses.T), 4.0 * stated.inner, rtol=0.3)
    for criterion in np.quantile(excesses.min(axis=1), (0.2, 0.5, 0.8)):
        share = np.mean((excesses > criterion).all(axis=1))
        assert stated.probability(np.full(2, criterion), 0.0) == pytest.approx(share, abs=0.1)


def test_probability_against_one_rival_is_the_normal_integral():
    squared, criterion, spread = 30.0, 9.0, 0.2
    one = Separation(np.array([squared]), np.array([[squared]]), np.zeros(1), np.ones((1, 1)))
    distance = np.sqrt(squared)
    certain = scipy.stats.norm.cdf((squared - criterion) / (2.0 * distance))
    assert one.probability(np.array([criterion]), 0.0) == pytest.approx(certain, abs=0.02)

    def at(size):
        inside = scipy.stats.norm.cdf((size**2 * squared - criterion) / (2.0 * size * distance))
        return inside * scipy.stats.norm.pdf(size, 1.0, spread)

    mean = scipy.integrate.quad(at, 1e-3, 2.5)[0]
    assert one.probability(np.array([criterion]), spread) == pytest.approx(mean, abs=0.02)


def test_what_is_equal_cannot_be_separated():
    true, _, _ = explanations()
    same = separated(true, [true])
    assert same.excess == pytest.approx([0.0], abs=1e-9)
    assert same.probability(np.array([9.0]), 0.3) == 0.0
    assert separated(true, []).probability(np.zeros(0), 0.3) == 1.0


@given(st.integers(0, 30), st.floats(1.0, 5.0))
def test_a_longer_record_separates_more(seed, length):
    true, *rivals = explanations(seed)
    once, longer = (separated(true, rivals, many) for many in (1.0, length))
    assert np.all(longer.excess >= once.excess - 1e-8)
    assert np.all(longer.excess <= length * once.excess * (1 + 1e-9) + 1e-8 + 10.0 * (length - 1))


def test_whole_lengths_are_copies_of_the_record():
    """Three lengths are one record of three times the readings, in which a drift has gone on growing."""
    true, rival, _ = explanations()
    growth = Growth(np.full(READINGS, 0.3), np.stack([np.zeros(READINGS), np.full(READINGS, 0.2)], axis=1))
    grown = Explanation(true.predicted, true.jacobian, true.values, true.prior_std, 0.0, growth)
    copies = Explanation(
        np.concatenate([true.predicted + k * growth.predicted for k in range(3)]),
        np.concatenate([true.jacobian + k * growth.jacobian for k in range(3)]),
        true.values,
        true.prior_std,
    )
    thrice = Explanation(np.tile(rival.predicted, 3), np.tile(rival.jacobian, (3, 1)), rival.values, rival.prior_std)
    long = separated(copies, [thrice])
    assert separated(grown, [rival], 3.0).excess == pytest.approx(long.excess, rel=1e-9)
    plain = separated(true, [rival], 3.0)
    assert not np.allclose(plain.excess, long.excess)


def test_standard_error_is_that_of_least_squares():
    one = explanations()[0]
    precision = np.diag(1.0 / one.prior_std**2)
    covariance = np.linalg.inv(2.0 * one.jacobian.T @ one.jacobian + precision)
    assert one.std(1, 2.0) == pytest.approx(np.sqrt(covariance[1, 1]))


def test_other_distances_of_a_rival_without_an_expected_excess_are_finite():
    """A rival that would fall behind by nothing, or even be better, has a finite covariance of the excess."""
    inner = np.diag([4.0, 0.0, 9.0])
    one = Separation(np.array([0.0, -2.0, 9.0]), inner, np.zeros(3), np.ones((1, 3)))
    moved = one.with_excess(np.array([4e12, 1e9, 36.0]), one.weather)
    assert np.isfinite(moved.inner).all() and moved.inner[2, 2] == pytest.approx(36.0)
    assert moved.inner[0, 0] == pytest.approx(4e12) and moved.inner[1, 1] == 0.0
    assert 0.0 <= moved.probability(np.full(3, 9.0), 0.1) <= 1.0
