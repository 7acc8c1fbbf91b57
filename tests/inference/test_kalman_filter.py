"""The square-root filter and smoother: against dense Gaussian algebra, cuthbert and statsmodels."""

import hypothesis
import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy
from cuthbert.filtering import filter as cuthbert_filter
from cuthbert.gaussian import kalman
from cuthbert.smoothing import smoother as cuthbert_smoother
from numpy.testing import assert_allclose

from wallid.inference.kalman_filter import (
    LinearGaussianModel,
    covariance_root,
    forecast_states,
    kalman_filter,
    kalman_smoother,
    triangular_root,
)


def random_model(seed, states=4, outputs=2, rows=None, known=0):
    """A stable model; the last `known` states are constant and known exactly at the first row."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((states, states))
    A = 0.9 * A / np.abs(np.linalg.eigvals(A)).max()
    G, S = rng.standard_normal((states, 2)), rng.standard_normal((states, states))
    if known:
        A[-known:] = np.eye(states)[-known:]
        G[-known:], S[-known:] = 0.0, 0.0
    shape = (outputs, states) if rows is None else (rows, outputs, states)
    return LinearGaussianModel(
        A, G, rng.standard_normal(states), S, rng.standard_normal(shape), 0.1 + rng.random(outputs)
    )


def readings_of(model, rows, seed, missing=0.3):
    """Drawn from the model, some of them missing."""
    rng = np.random.default_rng([seed, 1])
    state = np.asarray(model.initial_mean) + np.asarray(model.initial_root) @ rng.standard_normal(
        model.initial_root.shape[1]
    )
    H, y = np.asarray(model.outputs_at_rows(rows)), []
    for t in range(rows):
        y.append(H[t] @ state + np.asarray(model.output_std) * rng.standard_normal(H.shape[1]))
        state = np.asarray(model.transition) @ state
        state = state + np.asarray(model.noise_root) @ rng.standard_normal(model.noise_root.shape[1])
    return np.array(y), rng.random((rows, H.shape[1])) >= missing


def dense(model, rows):
    """Mean and covariance of all states of all rows, by products of the whole matrices."""
    A, G, S = (np.asarray(part) for part in (model.transition, model.noise_root, model.initial_root))
    n = len(A)
    big = np.zeros((rows * n, S.shape[1] + (rows - 1) * G.shape[1]))
    big[:n, : S.shape[1]] = S
    mean = [np.asarray(model.initial_mean)]
    for t in range(1, rows):
        big[t * n : (t + 1) * n] = A @ big[(t - 1) * n : t * n]
        column = S.shape[1] + (t - 1) * G.shape[1]
        big[t * n : (t + 1) * n, column : column + G.shape[1]] += G
        mean.append(A @ mean[-1])
    H = scipy.linalg.block_diag(*np.asarray(model.outputs_at_rows(rows)))
    return np.concatenate(mean), big @ big.T, H


def conditional(model, y, present):
    """Log-likelihood of the readings, and mean and covariance of the states given them."""
    rows = len(y)
    mean, cov, H = dense(model, rows)
    kept = present.reshape(-1)
    H, values = H[kept], y.reshape(-1)[kept]
    R = H @ cov @ H.T + np.diag(np.tile(np.asarray(model.output_std) ** 2, rows)[kept])
    gain = np.linalg.solve(R, H @ cov).T
    difference = values - H @ mean
    log_det = np.linalg.slogdet(R)[1]
    log_likelihood = -0.5 * (difference @ np.linalg.solve(R, difference) + log_det + kept.sum() * np.log(2 * np.pi))
    return log_likelihood, mean + gain @ difference, cov - gain @ H @ cov


@hypothesis.settings(deadline=None, max_examples=15)
@hypothesis.given(
    seed=st.integers(0, 10**6),
    known=st.sampled_from([0, 1]),
    each=st.booleans(),
    missing=st.sampled_from([0.0, 0.4, 1.0]),
)
def test_filter_and_smoother_are_the_dense_gaussian(seed, known, each, missing):
    rows = 12
    model = random_model(seed, rows=rows if each else None, known=known)
    y, present = readings_of(model, rows, seed, missing)
    log_likelihood, mean, cov = conditional(model, y, present)
    filtered = kalman_filter(model, jnp.asarray(np.where(present, y, np.nan)), jnp.asarray(present))
    assert float(filtered.log_likelihood) == pytest.approx(log_likelihood, rel=1e-9, abs=1e-9)
    smoothed = kalman_smoother(model, filtered, jnp.asarray(y), jnp.asarray(present))
    scale = 1.0 + np.abs(mean).max()
    assert_allclose(smoothed.mean.reshape(-1), mean, atol=1e-8 * scale)
    for t in range(rows):
        block = slice(4 * t, 4 * t + 4)
        root = np.asarray(smoothed.root[t])
        assert_allclose(root @ root.T, cov[block, block], atol=1e-8 * (1.0 + np.abs(cov).max()))
    at_end = np.asarray(filtered.root[-1])
    assert_allclose(at_end @ at_end.T, cov[-4:, -4:], atol=1e-8 * (1.0 + np.abs(cov).max()))


def test_a_forecast_is_the_prediction_without_readings():
    rows, more = 10, 5
    model = random_model(3)
    y, present = readings_of(model, rows + more, 3)
    known = np.where(np.arange(rows + more) < rows, 1, 0).astype(bool)[:, None] & present
    through = kalman_filter(model, jnp.asarray(y), jnp.asarray(known))
    until = kalman_filter(model, jnp.asarray(y[:rows]), jnp.asarray(present[:rows]))
    after = forecast_states(model, until.mean[-1], until.root[-1], more)
    assert_allclose(after.mean, through.mean[rows:], atol=1e-12)
    for root, by_filter in zip(after.root, through.root[rows:], strict=True):
        assert_allclose(root @ root.T, by_filter @ by_filter.T, atol=1e-12)


def test_against_cuthbert():
    """Its model takes a step before the first reading, so ours begins one step later."""
    rows = 60
    before = random_model(7, states=5)
    noise = triangular_root(before.noise_root)
    one_step = (
        before.transition @ before.initial_mean,
        jnp.concatenate([before.transition @ before.initial_root, noise], 1),
    )
    model = LinearGaussianModel(before.transition, noise, *one_step, before.outputs, before.output_std)
    y, _ = readings_of(model, rows, 7, missing=0.0)
    values, zero = jnp.asarray(y), jnp.zeros(5)

    def dynamics(row):
        return model.transition, zero, noise

    def observation(row):
        return model.outputs, jnp.zeros(2), jnp.diag(model.output_std), values[row]

    theirs = kalman.build_filter(before.initial_mean, triangular_root(before.initial_root), dynamics, observation)
    by_cuthbert = cuthbert_filter(theirs, jnp.arange(rows), theirs.init_prepare())
    ours = kalman_filter(model, values, jnp.ones(y.shape, bool))
    assert float(ours.log_likelihood) == pytest.approx(float(by_cuthbert.log_normalizing_constant[-1]), rel=1e-10)
    assert_allclose(ours.mean, by_cuthbert.mean[1:], atol=1e-9)
    smoothed = kalman_smoother(model, ours, values, jnp.ones(y.shape, bool))
    backward = cuthbert_smoother(kalman.build_smoother(dynamics), by_cuthbert)
    assert_allclose(smoothed.mean, backward.mean[1:], atol=1e-8)
    for root, other in zip(smoothed.root, backward.chol_cov[1:], strict=True):
        assert_allclose(root @ root.T, other @ other.T, atol=1e-8)


def test_roots():
    rng = np.random.default_rng(0)
    A = rng.standard_normal((4, 7))
    L = np.asarray(triangular_root(jnp.asarray(A)))
    assert_allclose(L @ L.T, A @ A.T, atol=1e-12)
    assert not np.triu(L, 1).any()
    singular = A[:, :2] @ A[:, :2].T
    root = covariance_root(singular)
    assert root.shape == (4, 2)
    assert_allclose(root @ root.T, singular, atol=1e-12)


def test_the_likelihood_has_derivatives():
    """In forward and reverse mode, by a size of the noise, against finite differences."""
    model = random_model(5)
    y, present = readings_of(model, 20, 5)

    def log_likelihood(log_size):
        scaled = LinearGaussianModel(
            model.transition, model.noise_root * jnp.exp(log_size), model.initial_mean, model.initial_root,
            model.outputs, model.output_std,
        )  # fmt: skip
        return kalman_filter(scaled, jnp.asarray(y), jnp.asarray(present)).log_likelihood

    step = 1e-5
    by_difference = (log_likelihood(jnp.asarray(step)) - log_likelihood(jnp.asarray(-step))) / (2 * step)
    assert float(jax.jacfwd(log_likelihood)(jnp.asarray(0.0))) == pytest.approx(float(by_difference), rel=1e-6)
    assert float(jax.grad(log_likelihood)(jnp.asarray(0.0))) == pytest.approx(float(by_difference), rel=1e-6)


@hypothesis.given(st.integers(0, 10**6), st.floats(-5.0, 5.0))
@hypothesis.settings(max_examples=20, deadline=None)
def test_the_innovation_has_the_sign_of_the_reading_minus_its_prediction(seed, above):
    """Of one output it is that difference over its standard deviation."""
    model = random_model(seed, outputs=1)
    H, S = np.asarray(model.outputs)[0], np.asarray(model.initial_root)
    std = np.sqrt(H @ S @ S.T @ H + np.asarray(model.output_std)[0] ** 2)
    reading = np.array([[H @ np.asarray(model.initial_mean) + above * std]])
    found = kalman_filter(model, reading, np.ones((1, 1), bool))
    assert float(found.innovation[0, 0]) == pytest.approx(above, abs=1e-9)
