"""Filled gaps in a face, in the covariance: against errors drawn by NumPy that go through an analytic slab."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.accuracy import interval
from benchmarks.reference.analytic_slab import temperatures
from numpy.testing import assert_allclose

import wallid
from wallid.inference.likelihood import face_response
from wallid.inference.noise_covariance import BinnedReadings, NoiseShape, restricted_to_reading_rows
from wallid.inference.noise_of_record import gap_errors
from wallid.records.face_filter import FaceNoise

ROWS, PLACES, RATE = (
    interval.ROWS,
    np.array(interval.PLACES) / interval.LENGTH,
    interval.DIFFUSIVITY / interval.LENGTH**2,
)
SENSOR, FACE = 0.02, 0.03


def through(error):
    """What an error of the faces makes of the readings, `(time, sensor)`; from rest before the first row."""
    return temperatures(np.concatenate([np.zeros((1, 2)), error]), interval.STEP, PLACES, RATE)[1:]


def bow(first, rows, size):
    j = np.arange(1, rows + 1)
    course = np.zeros(ROWS)
    course[first : first + rows] = size * np.sqrt(j * (rows + 1 - j)) / (rows + 1) * 2
    return course


@pytest.fixture(scope="module")
def fill():
    """Two gaps at the left, one at the right, over the same rows as one of them."""
    fill = np.stack([bow(10, 6, 0.3) + bow(40, 9, 0.5), bow(12, 5, 0.4)], axis=1)
    return np.where(fill > 0, np.hypot(fill, FACE), 0.0)


@pytest.fixture(scope="module")
def response():
    case = interval.case_of(interval.KINDS["white"], np.full((ROWS, 2), 15.0), np.full((ROWS, 3), 15.0))
    fourier = wallid.case.scales(case).fourier_number(interval.DIFFUSIVITY)
    system = wallid.full_order_model(case)
    return np.array(face_response(system, jnp.asarray(fourier), jnp.asarray(interval.STEP / 86400), ROWS))


def model_of(response, fill, present, bin_rows=1, apart=1):
    bins = BinnedReadings(jnp.zeros((ROWS, 3)), jnp.asarray(present, dtype=float), bin_rows)
    gaps = gap_errors(fill, FACE, response, bins)
    response, bins, errors = restricted_to_reading_rows(response, bins, apart, np.zeros((2, 1)))
    return NoiseShape(response, bins, np.full(3, SENSOR), FaceNoise.white(FACE), errors, gaps=gaps)


def test_each_gap_is_one_error_that_goes_through_the_wall(response, fill):
    found = gap_errors(fill, FACE, response, BinnedReadings(jnp.zeros((ROWS, 3)), jnp.ones((ROWS, 3)), 1))
    assert found.shape == (3, 3 * ROWS)
    bows = (bow(10, 6, 0.3), 0), (bow(40, 9, 0.5), 0), (bow(12, 5, 0.4), 1)
    for gap, (course, side) in zip(found, bows, strict=True):
        want = through(np.stack([course, np.zeros(ROWS)] if side == 0 else [np.zeros(ROWS), course], axis=1))
        assert_allclose(gap.reshape(3, ROWS).T, want, atol=2e-3 * np.abs(want).max())
    assert gap_errors(None, FACE, response, BinnedReadings(jnp.zeros((ROWS, 3)), jnp.ones((ROWS, 3)), 1)).shape == (
        0,
        3 * ROWS,
    )


def draws(fill, count, rng):
    """Readings' errors: noise of sensors and faces, and one error for each gap."""
    bows = [(bow(10, 6, 0.3), 0), (bow(40, 9, 0.5), 0), (bow(12, 5, 0.4), 1)]
    found = np.empty((count, ROWS, 3))
    for k in range(count):
        error = FACE * rng.standard_normal((ROWS, 2))
        for course, side in bows:
            error[:, side] += course * rng.standard_normal()
        found[k] = through(error) + SENSOR * rng.standard_normal((ROWS, 3))
    return found


def test_the_covariance_is_that_of_drawn_gaps(response, fill):
    """Of 800 draws a variance has a relative error of sqrt(2/800) = 5 %; k = 4."""
    rng = np.random.default_rng(4)
    sample, some = draws(fill, 800, rng), rng.uniform(size=(ROWS, 3)) > 0.2
    every = np.ones((ROWS, 3), bool)
    second = every & (np.arange(ROWS) % 2 == 0)[:, None]
    for present, rows, apart in ((every, 1, 1), (some, 1, 1), (every, 3, 1), (second, 2, 2)):
        model = model_of(response, fill, present, rows, apart)
        bins = BinnedReadings(jnp.zeros((ROWS, 3)), jnp.asarray(present, dtype=float), rows)
        binned = np.stack([np.asarray(bins.mean(jnp.asarray(one))) for one in sample])
        noise = model.covariance_of(1.0, 0.0, 0.5)
        there = model.counts.T.reshape(-1) > 0
        along = model.gap_errors[:, there] / np.linalg.norm(model.gap_errors[:, there], axis=1)[:, None]
        want = np.einsum("gi,ij,gj->g", along, noise.covariance[np.ix_(there, there)], along)
        assert_allclose(((binned[:, there] @ along.T) ** 2).mean(axis=0), want, rtol=4 * np.sqrt(2 / 800))
        white = (binned @ noise.whitening.T)[:, there]
        tolerance = 4 * np.sqrt(2 / white.size) + (0.03 if rows > 1 else 0.0)  # the faces' noise is spread over a bin
        assert_allclose((white**2).mean(), 1.0, atol=tolerance)
        without = NoiseShape(
            model.response, model.bins, model.sensor_std, model.face_noise, model.face_errors
        ).covariance_of(1.0, 0.0, 0.5)
        assert ((binned @ without.whitening.T)[:, there] ** 2).mean() > 1.2, "a covariance that forgets them"
        if rows == 1:
            size = np.sqrt((sample**2)[:, present].mean())
            readings = present.sum(axis=0)
            rms = np.sqrt(np.sum(readings * noise.rms_of_outputs**2) / readings.sum())
            assert rms == pytest.approx(size, rel=0.05)


def test_a_walk_over_a_gap_is_no_larger_than_its_bow(response):
    """A Brownian bridge is not one error but many: taken for one, its variance is at most overstated."""
    rng, rows, at = np.random.default_rng(6), 8, 20
    walks = rng.standard_normal((600, rows + 1)).cumsum(axis=1) * 0.1
    j = np.arange(1, rows + 1)
    bridges = walks[:, :-1] - walks[:, -1:] * j / (rows + 1)
    std = 0.1 * np.sqrt(j * (rows + 1 - j) / (rows + 1))
    fill = np.zeros((ROWS, 2))
    fill[at : at + rows, 0] = std
    gap = gap_errors(fill, 0.0, response, BinnedReadings(jnp.zeros((ROWS, 3)), jnp.ones((ROWS, 3)), 1))[0].reshape(
        3, ROWS
    )
    made = np.zeros((600, ROWS, 3))
    for k, bridge in enumerate(bridges):
        error = np.zeros((ROWS, 2))
        error[at : at + rows, 0] = bridge
        made[k] = through(error)
    where = np.argmax(np.abs(gap), axis=1)
    for s, row in enumerate(where):
        ratio = gap[s, row] ** 2 / made[:, row, s].var()
        assert 0.85 < ratio < 2.0


def test_a_filled_gap_does_not_pull_the_estimate():
    """The interpolation is off by 1.5 of its standard errors: an interval that forgets it is far from the truth."""
    errors = interval.KINDS["white"]
    _, measured, readings = interval.draw(errors, 11)
    fill = np.stack([np.zeros(ROWS), bow(20, 20, 1.5)], axis=1)
    measured = measured + 1.5 * fill
    case = interval.case_of(errors, measured, readings)
    case = replace(case, choices=replace(case.choices, noise="stated"))
    filled = replace(case, record=replace(case.record, fill_std=fill))
    forgot, counted = (wallid.estimate(one, None, wallid.full_order_model(one)) for one in (case, filled))
    off = np.log(np.array([forgot.value, counted.value]) / interval.DIFFUSIVITY)
    assert abs(off[1]) < 4 * counted.std / counted.value < 0.1
    assert abs(off[0]) > 4 * abs(off[1]) and forgot.reduced_chi_square > 3 > counted.reduced_chi_square
