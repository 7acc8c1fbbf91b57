"""How much the next record tells in other weather, against weighted least squares and simulated campaigns."""

import numpy as np
import pytest
import scipy

from wallid.discrepancy.next_measurement.other_weather import (
    SAME_WEATHER,
    LeastSquaresInOtherWeather,
    blocks_of_days,
    weights_of_blocks,
)
from wallid.discrepancy.next_measurement.separation import Explanation, FitWithoutNoise, Separation, separation

BLOCKS, READINGS = 12, 20  # readings of a block


def explanations(changes):
    """A true effect and a rival, which respond in part alike to the changes of weather of each block."""
    rng = np.random.default_rng(3)
    shapes = rng.standard_normal((3, READINGS))
    common, true, rival = (np.outer(changes, shape).ravel() for shape in shapes)
    made = (Explanation(one, np.stack([common, one], axis=1), np.zeros(2), np.full(2, np.inf)) for one in (true, rival))
    return tuple(made)


def separated(changes, length=1.0):
    blocks = np.repeat(np.arange(len(changes)), READINGS)
    true, rival = (FitWithoutNoise(one, length, blocks) for one in explanations(changes))
    return separation(true, [rival])


def test_squared_residuals_are_those_of_weighted_least_squares():
    rng = np.random.default_rng(0)
    slopes, misfit = rng.standard_normal((70, 4)) * [1.0, 1e3, 1e-3, 1.0], rng.standard_normal(70)
    slopes[20:, 2] = 0.0  # as the profile at the start, of which later days say nothing
    blocks = np.concatenate([np.repeat(np.arange(6), 10), np.full(10, SAME_WEATHER)])
    found = LeastSquaresInOtherWeather(slopes, blocks).squared_residuals(misfit)
    for squared, weights in zip(found, weights_of_blocks(6), strict=True):
        root = np.sqrt(np.append(weights, 1.0)[blocks])
        scaled = root[:, None] * slopes / np.linalg.norm(slopes, axis=0)
        left = root * misfit - scaled @ np.linalg.lstsq(scaled, root * misfit, rcond=None)[0]
        assert squared == pytest.approx(left @ left, rel=1e-6)


def test_campaigns_differ_as_the_blocks_of_one_of_them_say():
    """The logarithm of the squared distance in the next campaign over that in the present one has the spread stated."""
    rng = np.random.default_rng(8)
    found, stated = [], []
    for _ in range(150):
        present, following = np.exp(0.3 * rng.standard_normal((2, BLOCKS)))
        here = separated(present)
        found.append(np.log(separated(following).excess[0] / here.excess[0]))
        stated.append(np.log(here.weather[:, 0]).var(ddof=1))
    assert np.mean(np.square(found)) == pytest.approx(np.mean(stated), rel=0.35)
    assert abs(np.mean(found)) < 0.1


def test_what_each_block_says_alike_does_not_depend_on_the_weather():
    """An offset, say; two blocks of the same days have the same weather."""
    assert separated(np.ones(BLOCKS)).weather == pytest.approx(1.0)
    assert weights_of_blocks(BLOCKS).mean(axis=1) == pytest.approx(1.0)
    assert weights_of_blocks(0).shape[1] == 0


def test_the_weather_of_a_longer_record_varies_less():
    changes = np.exp(0.3 * np.random.default_rng(2).standard_normal(BLOCKS))
    once, four = separated(changes), separated(changes, 4.0)
    assert four.weather - 1.0 == pytest.approx(0.5 * (once.weather - 1.0), abs=0.02)


def test_probability_is_the_mean_over_the_weather():
    squared, criterion, weather = 60.0, 9.0, np.array([0.2, 0.6, 1.0, 2.2])
    one = Separation(np.array([squared]), np.array([[squared]]), np.zeros(1), weather[:, None])
    distance = np.sqrt(weather * squared)
    each = scipy.stats.norm.cdf((weather * squared - criterion) / (2.0 * distance))
    assert one.probability(np.array([criterion]), 0.0) == pytest.approx(each.mean(), abs=0.02)


def test_blocks_are_days_of_every_instrument():
    blocks = blocks_of_days(2 * 28 * 24, 2, 28.0)
    assert np.array_equal(blocks, np.tile(np.repeat(np.arange(7), 4 * 24), 2))
    assert blocks_of_days(3 * 24, 1, 3.0).max() == 2
    assert np.all(blocks_of_days(2 * 24, 1, 2.0) == SAME_WEATHER)
