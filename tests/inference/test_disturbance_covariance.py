"""The covariance of means over bins by a disturbance, against the covariance of all rows made row by row."""

import hypothesis.strategies as st
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from numpy.testing import assert_allclose
from scipy.linalg import solve_discrete_lyapunov

from wallid.inference.disturbance_covariance import binned_covariance
from wallid.models.disturbance import GaussianStep

STATES, OUTPUTS = 4, 2


def drawn_step(rng, slowest):
    """A stable step whose slowest mode decays by this factor a row, and whose first state differs from later ones."""
    modes = np.linalg.qr(rng.standard_normal((STATES, STATES)))[0] + 0.1 * rng.standard_normal((STATES, STATES))
    transition = modes @ np.diag([slowest, *rng.uniform(0.0, slowest, STATES - 1)]) @ np.linalg.inv(modes)
    noise, initial = (root @ root.T for root in rng.standard_normal((2, STATES, STATES)))
    parts = {
        "transition": transition,
        "W0": np.zeros((STATES, 1)),
        "W1": np.zeros((STATES, 1)),
        "noise": noise,
        "initial": 0.1 * initial,
        "stationary": solve_discrete_lyapunov(transition, noise),
        "C": rng.standard_normal((OUTPUTS, STATES)),
        "D": np.zeros((OUTPUTS, 1)),
    }
    return GaussianStep(**{name: jnp.asarray(part) for name, part in parts.items()})


def covariance_of_rows(step, rows):
    """`Cov(x_i, x_j) = Phi^(i-j) P_j` with `P_(j+1) = Phi P_j Phi' + Q`, as the outputs show it."""
    transition, noise, now, C = (np.asarray(part) for part in (step.transition, step.noise, step.initial, step.C))
    found = np.zeros((rows, OUTPUTS, rows, OUTPUTS))
    for first in range(rows):
        later = now
        for second in range(first, rows):
            found[second, :, first] = C @ later @ C.T
            found[first, :, second] = found[second, :, first].T
            later = transition @ later
        now = transition @ now @ transition.T + noise
    return found


@settings(max_examples=20)
@given(st.integers(0, 1000), st.sampled_from([0.3, 0.9, 0.99]), st.integers(1, 6), st.integers(1, 5))
def test_means_over_bins_have_the_covariance_of_their_rows(seed, slowest, bins, rows_per_bin):
    step = drawn_step(np.random.default_rng(seed), slowest)
    rows = covariance_of_rows(step, bins * rows_per_bin)
    shape = (bins, rows_per_bin, OUTPUTS)
    want = rows.reshape(shape + shape).mean(axis=(1, 4)).transpose(1, 0, 3, 2)
    assert_allclose(binned_covariance(step, bins, rows_per_bin), want, rtol=0, atol=1e-9 * np.abs(want).max())
