"""The noise's covariance against its definition, and its size found in residuals drawn by NumPy."""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.reference import simulator_with_effects as truth
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.linalg import toeplitz
from studies import SPEC, parameters_at, prepare

from wallid.discrepancy.model_with_effects import BinnedReadings, predict
from wallid.inference.noise_covariance import NoiseCovariance, NoiseShape, covariance_of_filtered
from wallid.inference.whittle_likelihood import estimate_noise, expected_widening, projected_sensitivity
from wallid.records.face_filter import FaceNoise

HOURLY = replace(
    SPEC, step=3600.0, days=12.0, positions=(0.04, 0.13), noise_std=0.05, boundary_noise_std=0.08, noise_seed=3
)


@pytest.fixture(scope="module")
def hourly(tmp_path_factory):
    study, _ = prepare(tmp_path_factory.mktemp("hourly"), HOURLY)
    parameters = parameters_at(study, HOURLY.diffusivity)
    return study, parameters, study.noise_shape(parameters)


def binned(study, rows, present=None):
    """The same study with its readings put together, or some of them missing."""
    here = np.asarray(study.bins.present) if present is None else present
    return replace(study, bins=BinnedReadings(study.bins.observed * here, jnp.asarray(here, dtype=float), rows))


def dense(model, white, lasting, rho):
    """The covariance of the rows, sensor by sensor: every sensor's own noise, each face's errors through the wall."""
    rows, sensors = model.response.shape[1:]
    C = lasting * rho ** np.abs(np.subtract.outer(np.arange(rows), np.arange(rows))) + white * np.eye(rows)
    R = np.kron(np.diag(np.square([0.05] * sensors)), C)
    for face in (0, 1):
        H = np.concatenate([np.tril(toeplitz(model.response[face, :, s])) for s in range(sensors)])
        between = np.pad(model.face_errors[face], (0, rows - model.face_errors.shape[1]))
        R += H @ (0.08**2 * C + toeplitz(between)) @ H.T
    return R + bending(model)


def bending(model):
    """What is not known of how the faces bend between rows: fully correlated errors."""
    return model.gap_errors.T @ model.gap_errors


def between(model, face, rng):
    """A draw of a face's errors between rows, K, by its Cholesky factor."""
    rows = model.response.shape[1]
    lags = np.pad(model.face_errors[face], (0, rows - model.face_errors.shape[1]))
    return np.linalg.cholesky(toeplitz(lags) + 1e-10 * np.eye(rows)) @ rng.standard_normal(rows)


def means(present, rows):
    """The matrix of the bins' means over the rows present, sensor by sensor; zero where there is none."""
    total, sensors = present.shape
    count = -(-total // rows)
    M = np.zeros((sensors * count, sensors * total))
    for s in range(sensors):
        for row in range(total):
            M[s * count + row // rows, s * total + row] = present[row, s]
    return M / np.maximum(M.sum(axis=1, keepdims=True), 1.0)


def test_an_error_of_a_face_answers_as_a_change_of_its_reading(hourly):
    """A straight line up to a row and down from it, added to the faces' courses anywhere, is the response moved."""
    study, parameters, model = hourly
    for face, row in ((0, 40), (1, 7)):
        faces = np.zeros(study.model.forcing.faces.shape)
        faces[row - 1, 1, face] = 1.0
        faces[row, :2, face] = 1.0, -1.0
        moved = eqx.tree_at(lambda m: m.forcing.faces, study.model, study.model.forcing.faces + faces)
        change = np.asarray(predict(moved, parameters, True) - predict(study.model, parameters, True))
        assert np.abs(change[:row]).max() < 1e-9
        assert_allclose(change[row:], model.response[face, : len(change) - row], rtol=0, atol=1e-9)
    # a lasting kelvin at both faces is a kelvin everywhere in the end
    assert_allclose(model.response.sum(axis=(0, 1)), 1.0, rtol=1e-6)


@given(st.integers(1, 30), st.integers(1, 4), st.floats(0.0, 0.99), st.integers(0, 2**32 - 1))
def test_filtered_noise_has_the_covariance_of_the_dense_product(bins, sensors, rho, seed):
    rng = np.random.default_rng(seed)
    response, lags = rng.standard_normal((bins, sensors)), 2.3 * rho ** np.arange(bins)
    G = np.concatenate([np.tril(toeplitz(column)) for column in response.T])
    want = G @ toeplitz(lags) @ G.T
    assert_allclose(covariance_of_filtered(response, lags), want, rtol=0, atol=1e-12 * np.abs(want).max())


@given(st.integers(1, 3), st.floats(0.0, 2.0), st.floats(0.0, 2.0), st.floats(0.0, 0.99), st.integers(0, 2**32 - 1))
def test_filtered_noise_of_a_face_keeps_the_shape_of_its_noise(rows_per_bin, white, autocorrelated, rho, seed):
    """A moving average of noise with a memory, against the product of its matrices."""
    rows, rng = 24, np.random.default_rng(seed)
    weights = rng.standard_normal((2, 4))
    face_noise = np.stack([np.correlate(one, one, "full")[3:] for one in weights])
    bins = BinnedReadings(jnp.zeros((rows, 1)), jnp.ones((rows, 1)), rows_per_bin)
    free = FaceNoise(face_noise, 1.0, np.full((2, 1), np.inf))
    shape = NoiseShape(np.zeros((2, rows, 1)), bins, np.ones(1), free, np.zeros((2, 1)))
    noise = autocorrelated * toeplitz(rho ** np.arange(rows + 3)) + white * np.eye(rows + 3)
    binning = np.kron(np.eye(rows // rows_per_bin), np.full((1, rows_per_bin), 1.0 / rows_per_bin))
    for one, found in zip(weights, shape.binned_face_noise(white, autocorrelated, rho), strict=True):
        average = toeplitz(np.r_[one[0], np.zeros(rows - 1)], np.r_[one, np.zeros(rows - 1)])
        want = binning @ average @ noise @ average.T @ binning.T
        assert_allclose(found, want[0], rtol=0, atol=1e-12 * (1.0 + want[0, 0]))


def test_noise_of_a_face_is_limited_by_the_power_of_its_readings():
    """White noise of 0.1 K is limited by the smallest power, noise with a memory hardly, as it is small there too."""
    omega = 2.0 * np.pi * np.arange(64) / 64
    power = 0.01 * (1.0 - 0.8**2) / np.abs(1.0 - 0.8 * np.exp(1j * omega)) ** 2
    noise = FaceNoise(np.full((2, 1), 0.01), 0.1, np.stack([power, np.full(64, 1.0)]))
    assert_allclose(noise.largest_size(1.0, 0.0, 0.5), [(1.0 - 0.8) / (1.0 + 0.8), 100.0])
    assert_allclose(noise.largest_size(0.0, 1.0, 0.8), [1.0, 100.0 / 9.0])
    assert_allclose(noise.limited(0.0, 2.0, 0.8), [[0.005], [0.01]])
    assert_allclose(FaceNoise.white(0.2).limited(3.0, 4.0, 0.9), 0.04)
    assert_allclose(FaceNoise.white(0.0).limited(1.0, 0.0, 0.9), 0.0)


def test_the_covariance_is_that_of_its_definition(hourly):
    *_, model = hourly
    sizes = (0.7, 0.5, 0.85)
    found = model.covariance_of(*sizes)
    want = dense(model, *sizes)
    assert_allclose(found.covariance, want, rtol=0, atol=1e-12 * want.max())
    assert_allclose(found.whitening @ want @ found.whitening.T, np.eye(len(want)), rtol=0, atol=1e-9)
    rms = np.sqrt(np.mean(found.rms_of_outputs**2))
    assert_allclose(rms, np.sqrt(np.diag(want).mean()), rtol=0.02, err_msg="but for the first rows")


def test_the_covariance_is_that_of_drawn_noise(hourly):
    """NumPy's draws through `lfilter` and a convolution; sqrt(2/1500) is the error of a variance from so many."""
    *_, model = hourly
    rng = np.random.RandomState(1)
    rows, sensors = model.response.shape[1:]
    draws = 1500
    sample = np.zeros((draws, sensors * rows))
    for k in range(draws):
        face = [0.08 * truth.noise_course("mixed", rows, rng) + between(model, f, rng) for f in (0, 1)]
        bend = rng.standard_normal(len(model.gap_errors)) @ model.gap_errors
        for s in range(sensors):
            own = 0.05 * truth.noise_course("mixed", rows, rng)
            through = sum(np.convolve(face[f], model.response[f, :, s])[:rows] for f in (0, 1))
            sample[k, s * rows : (s + 1) * rows] = own + through + bend[s * rows : (s + 1) * rows]
    found = model.covariance_of(0.5, 0.5, 0.9)
    white = sample @ found.whitening.T
    assert_allclose((white**2).mean(), 1.0, atol=4 * np.sqrt(2 / sample.size))
    # slow directions, in which errors of the memory would show
    slow = np.array([np.cos(np.pi * k * (np.arange(sensors * rows) + 0.5) / (sensors * rows)) for k in range(8)])
    share = ((sample @ slow.T) ** 2).mean(axis=0) / np.einsum("ki,ij,kj->k", slow, found.covariance, slow)
    assert_allclose(share, 1.0, atol=4 * np.sqrt(2 / draws))


def test_bins_have_the_covariance_of_means(hourly):
    """The faces' noise inside a bin is spread over it: the own noise is exact, the faces' within some percent."""
    study, parameters, model = hourly
    rows = 4
    together = binned(study, rows).noise_shape(parameters)
    sizes = (0.3, 0.8, 0.9)
    M = means(np.asarray(study.bins.present), rows)
    want = M @ dense(model, *sizes) @ M.T
    found = together.covariance_of(*sizes)
    assert np.linalg.norm(found.covariance - want) < 0.05 * np.linalg.norm(want)
    ratio = np.diag(found.covariance) / np.diag(want)
    assert np.all(np.abs(ratio[5:] - 1) < 0.1)
    # of the rows, whatever the bins, but for the errors that are fully correlated
    correlated = [np.sum(one.gap_errors**2, axis=0).mean() for one in (together, model)]
    rms = [np.mean(one.covariance_of(*sizes).rms_of_outputs ** 2) for one in (together, model)]
    rms = np.subtract(rms, correlated)
    assert_allclose(rms[0], rms[1], rtol=1e-6)


@pytest.mark.parametrize("rows", [1, 2, 5])
@pytest.mark.parametrize("rho", [0.0, 0.6, 0.95])
def test_the_autocovariance_of_means_of_an_autoregression(rows, rho):
    together = object.__new__(NoiseShape)
    together.rows_per_bin, together.bin_count = rows, 9
    C = rho ** np.abs(np.subtract.outer(np.arange(9 * rows), np.arange(9 * rows)))
    M = np.kron(np.eye(9), np.full((1, rows), 1 / rows))
    assert_allclose(together.autocovariance(rho), (M @ C @ M.T)[0], rtol=1e-12, atol=1e-15)


def test_missing_readings_neither_count_nor_tell(hourly):
    study, parameters, model = hourly
    rng = np.random.RandomState(5)
    present = (rng.uniform(size=study.bins.present.shape) > 0.3).astype(float)
    present[20:28, 0] = 0.0
    found = binned(study, 1, present).noise_shape(parameters).covariance_of(0.7, 0.5, 0.8)
    there, want = present.T.reshape(-1) > 0, dense(model, 0.7, 0.5, 0.8)
    assert_allclose(found.covariance[np.ix_(there, there)], want[np.ix_(there, there)], atol=1e-12 * want.max())
    assert_allclose(found.covariance[~there], np.eye(len(there))[~there])
    assert_allclose(found.whitening @ found.covariance @ found.whitening.T, np.eye(len(there)), atol=1e-9)
    # a bin with fewer rows has more of the sensor's white noise; what of the faces' comes through is a whole bin's
    M = means(present, 4)
    some = binned(study, 4, present).noise_shape(parameters).covariance_of(0.7, 0.5, 0.8)
    gone = M.sum(axis=1) == 0
    assert gone.sum() >= 2
    assert_allclose(some.covariance[gone], np.eye(len(M))[gone])
    ratio = np.diag(some.covariance)[~gone] / np.diag(M @ want @ M.T)[~gone]
    assert np.all(np.abs(ratio - 1) < 0.4) and abs(ratio.mean() - 1) < 0.15


def drawn(model, kind, size, rng):
    """A residual of the rows: noise of the sensors and of the faces through the wall, `size` times as stated."""
    rows, sensors = model.response.shape[1:]
    face = [0.08 * truth.noise_course(kind, rows, rng) for _ in (0, 1)]
    found = []
    for s in range(sensors):
        through = sum(np.convolve(face[f], model.response[f, :, s])[:rows] for f in (0, 1))
        found.append(0.05 * truth.noise_course(kind, rows, rng) + through)
    return size * np.concatenate(found)


def waves(model, count):
    """Directions as effects have them: slow courses of the readings, K."""
    rows, sensors = model.response.shape[1:]
    t = (np.arange(rows) + 0.5) / rows
    shapes = [np.cos(np.pi * k * t) for k in range(count // 2)] + [np.sin(24 * np.pi * t), np.cos(24 * np.pi * t)]
    return np.array([np.kron(np.eye(sensors)[s], shape) for shape in shapes for s in range(sensors)])


# Of n readings a standard deviation is found with a relative error of 1/sqrt(2 n), 3 % of 576; memory costs as many
# readings as (1 + rho^2)/(1 - rho^2): 9.5 times as many at 0.9, more with the slow directions out. Four draws halve it;
# k = 4.
@pytest.mark.parametrize(
    ("kind", "size", "share", "rho", "spread"),
    [("white", 1.0, 0.0, None, 0.015), ("white", 1.5, 0.0, None, 0.015), ("ar06", 1.0, 1.0, 0.6, 0.022),
     ("ar09", 0.8, 1.0, 0.9, 0.06), ("mixed", 1.0, 0.5, 0.9, 0.035)],
)  # fmt: skip
def test_size_share_and_memory_are_found(hourly, kind, size, share, rho, spread):
    *_, model = hourly
    rng = np.random.RandomState(11)
    directions = waves(model, 6)
    found = [estimate_noise(model, drawn(model, kind, size, rng), directions) for _ in range(4)]
    total = np.array([noise.white + noise.autocorrelated for noise in found])
    assert_allclose(np.sqrt(total.mean()), size, rtol=4 * spread)
    lasting = np.mean([noise.autocorrelated for noise in found]) / total.mean()
    if kind == "white":
        # what is taken for memory is small, or has none
        assert np.mean([noise.autocorrelated * noise.correlation for noise in found]) < 0.15 * size**2
        return
    assert_allclose(lasting, share, atol=0.35 if kind == "mixed" else 0.3)
    assert_allclose(np.mean([n.correlation * n.autocorrelated for n in found]) / size**2, share * rho, atol=0.15)


def test_an_effect_along_a_known_direction_does_not_pass_for_noise(hourly):
    """A hundred times the noise, along two of the directions: the estimate is the same."""
    *_, model = hourly
    residual = drawn(model, "white", 1.0, np.random.RandomState(2))
    directions = waves(model, 6)
    quiet = estimate_noise(model, residual, directions)
    loud = estimate_noise(model, residual + 5.0 * directions[2] - 3.0 * directions[-1], directions)
    assert_allclose(loud.white + loud.autocorrelated, quiet.white + quiet.autocorrelated, rtol=0.01)
    blind = estimate_noise(model, residual + 5.0 * directions[2], directions[-1:])
    assert blind.white + blind.autocorrelated > 3.0, "otherwise it is noise"


@pytest.mark.parametrize(("readings", "outputs"), [(96, 1), (240, 1), (96, 2)])
def test_the_expected_widening_is_that_of_drawn_noise(readings, outputs):
    """White noise whose shape and size are estimated: the median width over that with known noise, of 25 draws."""
    bins = BinnedReadings(jnp.zeros((readings, outputs)), jnp.ones((readings, outputs)), 1)
    model = NoiseShape(np.zeros((2, readings, outputs)), bins, np.ones(outputs), FaceNoise.white(0.0), np.zeros((2, 1)))
    days = np.arange(readings) / 48.0
    slow = np.stack([np.sin(2 * np.pi * days) + 0.3 * days, np.ones(readings), days, np.exp(-3 * days)], axis=1)
    jacobian = np.concatenate([slow * factor for factor in (1.0, 0.5)[:outputs]])
    sensitivity = projected_sensitivity(jacobian, jacobian)
    expected = expected_widening(np.split(sensitivity, outputs), np.split(jacobian, outputs), readings)
    rng, widths = np.random.default_rng(5), []
    for _ in range(25):
        noise = estimate_noise(model, rng.standard_normal(readings * outputs), jacobian.T, sensitivity)
        std = 1.0 / np.linalg.norm(noise.whitening @ sensitivity)
        widths.append(noise.quantile / 1.96 * std * np.linalg.norm(sensitivity))
    assert 1.0 < expected < 2.0
    assert np.median(widths) == pytest.approx(expected, rel=0.08)  # the median of 25 scatters by 3 %
    assert expected_widening(np.split(sensitivity, outputs), np.split(jacobian, outputs), 8) == 1.0
    assert expected_widening(np.split(0 * sensitivity, outputs), np.split(jacobian, outputs), readings) == 1.0


def test_the_noise_says_what_it_is():
    nothing = np.zeros((1, 1))
    assert str(NoiseCovariance(0.25, 0.0, 0.3, nothing, np.array([0.1]))) == "noise 0.50 times the stated"
    lasting = str(NoiseCovariance(0.5, 0.5, 0.9, nothing, np.array([0.1])))
    assert "1.00 times" in lasting and "50 %" in lasting and "0.90" in lasting
