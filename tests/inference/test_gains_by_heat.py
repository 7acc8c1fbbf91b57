"""What a disturbance tells about two plates' gains: against the derivative of the dense likelihood, and on a slab."""

import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.accuracy.disturbance import (
    CAPACITY,
    CONDUCTIVITY,
    DIFFUSIVITY,
    FACE_STD,
    FINE,
    FLUX_STD,
    LENGTH,
    STEP,
    slab_case,
)
from benchmarks.reference.analytic_slab import fluxes, heated, random_process, weather
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

import wallid
from wallid.inference.gains_by_heat import gains_by_heat
from wallid.inference.noise_covariance import BinnedReadings, NoiseCovariance, NoiseShape
from wallid.records.face_filter import FaceNoise

BINS = 9


def shape_of(present, rows_per_bin=1):
    """A covariance's shape with readings where `present`, `(time, output)`."""
    rows, outputs = present.shape
    bins = BinnedReadings(jnp.zeros(present.shape), jnp.asarray(present.astype(float)), rows_per_bin)
    return NoiseShape(np.zeros((2, rows, outputs)), bins, np.ones(outputs), FaceNoise.white(0.0), np.zeros((2, 1)))


def noise_with(disturbance, covariance):
    return NoiseCovariance(1.0, 0.0, 0.0, covariance, np.ones(2), disturbance=disturbance)


@given(st.integers(0, 10_000), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.integers(0, 1))
def test_the_effect_is_the_derivative_of_the_likelihood(seed, left, right, sensors):
    """Along the difference of the gains, by central differences of scipy's density; some readings are missing."""
    rng = np.random.default_rng(seed)
    count, outputs, gains = (sensors + 2) * BINS, sensors + 2, np.array([left, right])
    root, flux = rng.standard_normal((count, 5)), rng.standard_normal(count)
    present = rng.random(count) > 0.2
    kept = np.ix_(present, present)
    readings = rng.standard_normal(count) * 2.0

    def of(gains):
        scale = np.repeat(np.concatenate([np.ones(sensors), 1.0 + gains]), BINS)
        return scale * flux, np.outer(scale, scale) * (root @ root.T)

    def log_likelihood(gains):
        mean, by_heat = of(gains)
        return multivariate_normal.logpdf(readings[present], mean[present], (by_heat + np.eye(count))[kept])

    mean, by_heat = of(gains)
    residual, covariance = np.where(present, readings - mean, 0.0), np.eye(count)
    covariance[kept] += by_heat[kept]
    shape, std = shape_of(present.reshape(outputs, BINS).T), np.array([0.02, 0.03])
    columns, prior_mean = gains_by_heat(noise_with(by_heat, covariance), shape, residual, gains, std, BINS)
    effect = np.zeros((2, outputs, BINS))
    effect[:, sensors:] = columns.transpose(0, 2, 1)
    of_plates = np.zeros((2, outputs, BINS))
    of_plates[0, -2], of_plates[1, -1] = flux.reshape(outputs, BINS)[-2:]
    slope = (effect + of_plates).reshape(2, -1) * present
    score = slope @ np.linalg.solve(covariance, residual) + prior_mean / std

    step = 1e-5 * np.array([1.0, -1.0])
    by_differences = (log_likelihood(gains + step) - log_likelihood(gains - step)) / 2e-5
    assert score[0] - score[1] == pytest.approx(by_differences, rel=1e-5, abs=1e-5)


def test_a_mean_over_a_bin_stands_for_all_its_rows():
    rng = np.random.default_rng(0)
    root, rows = rng.standard_normal((2 * BINS, 2 * BINS)), 3 * BINS - 1  # the last bin is not full
    noise, shape = noise_with(root @ root.T, np.eye(2 * BINS)), shape_of(np.full((rows, 2), True), 3)
    found = gains_by_heat(noise, shape, rng.standard_normal(2 * BINS), np.zeros(2), np.ones(2), rows)
    assert found.columns.shape == (2, rows, 2)
    np.testing.assert_array_equal(found.columns[:, 0], found.columns[:, 2])
    assert np.all(found.columns[:, 2] != found.columns[:, 3])


def test_heat_shows_that_plates_disagree():
    """Plates of +4 and -4 %, stated as 3 %: heat of 15 W/m2 shows their difference, where the weather shows little."""
    rng, stride, before, rows = np.random.default_rng(5), round(STEP["plates"] / FINE), 5 * 1440, 288
    count, rate, profile = before + (rows - 1) * stride + 1, DIFFUSIVITY / LENGTH**2, np.ones(3001)
    faces = 0.2 * weather(count, FINE, rng, hours=(8.0, 2.0))
    heat = 3.0 / 86400.0 * random_process(count, FINE, 3.0, rng)
    more = heated(heat, FINE, profile, rate, np.array([0.5]))[1]
    through = CONDUCTIVITY / LENGTH * (fluxes(faces, FINE, rate) + more)[before::stride]
    read = np.array([1.04, 0.96]) * through + FLUX_STD * rng.standard_normal(through.shape)
    noisy = faces[before::stride] + FACE_STD * rng.standard_normal((rows, 2))
    case = slab_case(STEP["plates"], noisy, None, read, initial_profile=1, model="lom", gain_std=0.03)
    fit = wallid.estimate(case)
    assert fit.disturbance is not None and fit.thermal is not None
    gains = fit.thermal.plate_gains
    assert gains["left"][0] - gains["right"][0] == pytest.approx(0.08, abs=0.01)
    low, high = fit.interval_95
    assert low < DIFFUSIVITY < high
    low, high = fit.thermal.areal_heat_capacity.interval_95
    assert low < CAPACITY * LENGTH < high
