"""How much the next record tells in other weather, against weighted least squares and simulated campaigns."""

import numpy as np
import pytest

from wallid.discrepancy.next_measurement.other_weather import (
    SAME_WEATHER,
    LeastSquaresInOtherWeather,
    blocks_of_days,
    weights_of_blocks,
)
from wallid.discrepancy.next_measurement.possible_truths import PossibleTruths
from wallid.discrepancy.next_measurement.separation import Explanation, FitWithoutNoise, separation

BLOCKS, READINGS = 12, 20  # readings of a block


def explanations(changes):
    """A true effect and a rival, which respond in part alike to the changes of weather of each block."""
    rng = np.random.default_rng(3)
    shapes = rng.standard_normal((3, READINGS))
    common, true, rival = (np.outer(changes, shape).ravel() for shape in shapes)
    made = (np.stack([common, one], axis=1) for one in (true, rival))
    return tuple(Explanation(("common", "own"), one[:, 1], one, np.zeros(2), np.full(2, np.inf)) for one in made)


def separated(changes, length=1.0):
    blocks = np.repeat(np.arange(len(changes)), READINGS)
    true, rival = (FitWithoutNoise(one, length, blocks) for one in explanations(changes))
    return separation(true, [rival], PossibleTruths((), np.zeros((1, 0))))


def in_present_weather(changes):
    true, rival = (FitWithoutNoise(one, 1.0, np.zeros(len(one.predicted), int)) for one in explanations(changes))
    return np.sum(rival.residual(true.explanation) ** 2)


def ratios(changes, length=1.0):
    """The excess in other weather over that in the present one."""
    return separated(changes, length).excess[:, 0] / (length * in_present_weather(changes))


def test_inner_products_are_those_of_weighted_least_squares():
    rng = np.random.default_rng(0)
    slopes, misfits = rng.standard_normal((70, 4)) * [1.0, 1e3, 1e-3, 1.0], rng.standard_normal((70, 3))
    slopes[20:, 2] = 0.0  # as the profile at the start, of which later days say nothing
    blocks = np.concatenate([np.repeat(np.arange(6), 10), np.full(10, SAME_WEATHER)])
    found = LeastSquaresInOtherWeather(slopes, blocks, 1.0).inner_products(misfits)
    for products, weights in zip(found, weights_of_blocks(6, 1.0), strict=True):
        root = np.sqrt(np.append(weights, 1.0)[blocks])[:, None]
        scaled = root * slopes / np.linalg.norm(slopes, axis=0)
        left = root * misfits - scaled @ np.linalg.lstsq(scaled, root * misfits, rcond=None)[0]
        assert products == pytest.approx(left.T @ left, rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("length", [1, 3])
def test_campaigns_differ_as_the_blocks_of_one_of_them_say(length):
    """The logarithm of the squared distance in the next campaign over that in the present one has the spread stated.

    A next campaign of three times the length has three times the blocks, each of other weather.
    """
    rng = np.random.default_rng(8)
    found, stated = [], []
    for _ in range(150):
        present, *following = np.exp(0.3 * rng.standard_normal((1 + length, BLOCKS)))
        after = np.mean([in_present_weather(one) for one in following])
        found.append(np.log(after / in_present_weather(present)))
        stated.append(np.log(ratios(present, length)).var(ddof=1))
    assert np.mean(np.square(found)) == pytest.approx(np.mean(stated), rel=0.35)
    assert abs(np.mean(found)) < 0.1


def test_what_each_block_says_alike_does_not_depend_on_the_weather():
    """An offset, say; two blocks of the same days have the same weather."""
    assert ratios(np.ones(BLOCKS)) == pytest.approx(1.0)
    assert weights_of_blocks(BLOCKS, 2.0).mean(axis=1) == pytest.approx(1.0)
    assert weights_of_blocks(0, 1.0).shape[1] == 0


def test_the_weather_of_a_longer_record_varies_less():
    """The present one stays one draw from the climate."""
    once, four = weights_of_blocks(BLOCKS, 1.0), weights_of_blocks(BLOCKS, 4.0)
    assert four - 1.0 == pytest.approx(np.sqrt(0.625) * (once - 1.0))


def test_blocks_are_days_of_every_instrument():
    blocks = blocks_of_days(2 * 28 * 24, 2, 28.0)
    assert np.array_equal(blocks, np.tile(np.repeat(np.arange(7), 4 * 24), 2))
    assert blocks_of_days(3 * 24, 1, 3.0).max() == 2
    assert np.all(blocks_of_days(2 * 24, 1, 2.0) == SAME_WEATHER)
