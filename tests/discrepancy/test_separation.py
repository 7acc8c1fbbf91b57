"""The probability that a future record names the right explanation, against simulated fits of linear models."""

from dataclasses import replace

import numpy as np
import pytest
import scipy
from hypothesis import given
from hypothesis import strategies as st

from wallid.discrepancy.next_measurement.other_weather import SAME_WEATHER
from wallid.discrepancy.next_measurement.possible_truths import PossibleTruths
from wallid.discrepancy.next_measurement.separation import (
    Explanation,
    FitWithoutNoise,
    Growth,
    Separation,
    cosines,
    separation,
)

READINGS = 60
AS_FITTED = PossibleTruths((), np.zeros((1, 0)))


def explanations(seed=0, count=3):
    """Explanations with a nuisance parameter in common, whose own directions differ."""
    rng = np.random.default_rng(seed)
    common = rng.standard_normal(READINGS)
    made = []
    for _ in range(count):
        own = common + 0.6 * rng.standard_normal(READINGS)
        slopes, values, prior_std = np.stack([common, own], axis=1), np.array([0.0, 1.5]), np.array([0.5, np.inf])
        made.append(Explanation(("common", "own"), 1.5 * own, slopes, values, prior_std))
    return made


def with_place(explanation):
    """The same with one more parameter, such as a position."""
    slope = np.random.default_rng(9).standard_normal((READINGS, 1))
    return replace(
        explanation,
        names=(*explanation.names, "place"),
        jacobian=np.hstack([explanation.jacobian, slope]),
        values=np.append(explanation.values, 0.0),
        prior_std=np.append(explanation.prior_std, np.inf),
    )


def separated(true, rivals, length=1.0, truths=AS_FITTED):
    blocks = np.full(len(true.predicted), SAME_WEATHER)
    own, *others = (FitWithoutNoise(one, length, blocks) for one in (true, *rivals))
    return separation(own, others, truths)


def costs(readings, models, whitening):
    """The smallest cost of each model by SciPy, parameters with their priors."""
    found = []
    for one in models:
        precision = 1.0 / one.prior_std

        def residual(step, one=one, precision=precision):
            fitted = one.predicted + one.jacobian @ step
            return np.concatenate([whitening @ (readings - fitted), precision * (one.values + step)])

        found.append(2.0 * scipy.optimize.least_squares(residual, np.zeros(len(one.names)), method="lm").cost)
    return np.array(found)


def test_probability_is_that_of_simulated_records():
    """The second rival has one parameter more, which gains from the noise."""
    true, *rivals = explanations()
    rivals[1] = with_place(rivals[1])
    rng = np.random.default_rng(4)
    root = np.linalg.cholesky(scipy.linalg.toeplitz(0.5 ** np.arange(READINGS)))
    whitening = np.linalg.inv(root)
    stated = separated(true.whitened(whitening), [one.whitened(whitening) for one in rivals])
    excesses = []
    for _ in range(300):
        all_costs = costs(true.predicted + root @ rng.standard_normal(READINGS), [true, *rivals], whitening)
        excesses.append(all_costs[1:] - all_costs[0])
    excesses = np.array(excesses)
    length = 2.0 * np.sqrt(stated.excess[0])
    assert np.allclose(np.cov(excesses.T), stated.cosine * np.outer(length, length), rtol=0.3)
    assert stated.penalties == pytest.approx([0.0, -1.0], abs=0.05)
    assert excesses.mean(axis=0) == pytest.approx(stated.excess[0] + stated.penalties, abs=1.5)
    for criterion in np.quantile(excesses.min(axis=1), (0.2, 0.5, 0.8)):
        share = np.mean((excesses > criterion).all(axis=1))
        assert stated.probability(np.full(2, criterion)) == pytest.approx(share, abs=0.1)


def test_probability_against_one_rival_is_the_normal_integral():
    """Its mean over the sizes that the true effect may have."""
    squared, criterion = 30.0, 9.0
    sizes = np.linspace(0.6, 1.4, 8)
    one = Separation(squared * sizes[:, None] ** 2, np.ones((1, 1)), np.zeros(1))
    distance = sizes * np.sqrt(squared)
    each = scipy.stats.norm.cdf((distance**2 - criterion) / (2.0 * distance))
    assert one.probability(np.array([criterion])) == pytest.approx(each.mean(), abs=0.02)


def test_the_true_effect_may_have_another_size_and_another_place():
    """The excess in each draw, against fits by SciPy to the readings of the true effect with these values."""
    true, rival, _ = explanations()
    true = with_place(true)
    truths = PossibleTruths(("own", "place"), np.random.default_rng(2).standard_normal((5, 2)))
    stated = separated(true, [rival], truths=truths).excess.reshape(-1, 5)
    for k, (size, place) in enumerate(truths.draws):
        readings = true.predicted + true.jacobian @ [0.0, size, place]
        own, other = costs(readings, [true, rival], np.eye(READINGS))
        assert stated[:, k] == pytest.approx(other - own, rel=1e-6)


def test_what_is_equal_cannot_be_separated():
    true, _, _ = explanations()
    same = separated(true, [true])
    assert same.excess == pytest.approx(0.0, abs=1e-9)
    assert same.probability(np.array([9.0])) == 0.0
    assert separated(true, []).probability(np.zeros(0)) == 1.0


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
    grown = replace(true, growth=growth)
    copies = replace(
        true,
        predicted=np.concatenate([true.predicted + k * growth.predicted for k in range(3)]),
        jacobian=np.concatenate([true.jacobian + k * growth.jacobian for k in range(3)]),
    )
    thrice = rival.mapped(lambda readings: np.concatenate([readings] * 3, axis=-1))
    long = separated(copies, [thrice])
    assert separated(grown, [rival], 3.0).excess == pytest.approx(long.excess, rel=1e-9)
    plain = separated(true, [rival], 3.0)
    assert not np.allclose(plain.excess, long.excess)


def test_standard_error_is_that_of_least_squares():
    one = explanations()[0]
    precision = np.diag(1.0 / one.prior_std**2)
    covariance = np.linalg.inv(2.0 * one.jacobian.T @ one.jacobian + precision)
    assert one.std(1, 2.0) == pytest.approx(np.sqrt(covariance[1, 1]))


def test_a_direction_of_no_length_is_orthogonal_to_the_others():
    """That of a rival that explains as much."""
    found = cosines(np.array([[4.0, 3.0, 0.0], [3.0, 9.0, 0.0], [0.0, 0.0, 0.0]]))
    assert found == pytest.approx(np.array([[1.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 1.0]]))


def test_a_parameter_at_a_bound_is_left_out():
    one = replace(explanations()[0], growth=Growth(np.ones(READINGS), np.ones((READINGS, 2))))
    kept = one.without({one.names[0]})
    assert kept.names == ("own",) and kept.values == pytest.approx([1.5])
    assert kept.jacobian == pytest.approx(one.jacobian[:, 1:]) and kept.growth.jacobian.shape == (READINGS, 1)
