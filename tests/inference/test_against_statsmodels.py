"""Two capacities and three resistances with process noise: the likelihood and its maximum against statsmodels."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy
from numpy.testing import assert_allclose
from statsmodels.tsa.statespace.mlemodel import MLEModel

from wallid.inference.kalman_filter import LinearGaussianModel, kalman_filter

STEP, ROWS = 0.5, 400  # h
TRUE = np.log([1.5, 4.0, 0.3, 0.05])  # resistance, capacity, process noise and reading noise


def matrices(theta, numpy):
    """The exact step, the inputs' matrix and the noise's root, of two nodes between two faces with held inputs."""
    R, C, q, r = (numpy.exp(one) for one in theta)
    A = numpy.array([[-2.0, 1.0], [1.0, -2.0]]) / (R * C)
    B = numpy.array([[1.0, 0.0], [0.0, 1.0]]) / (R * C)
    expm = jax.scipy.linalg.expm if numpy is jnp else scipy.linalg.expm
    transition = expm(A * STEP)
    drive = numpy.linalg.solve(A, (transition - numpy.eye(2)) @ B)
    return transition, drive, q * np.sqrt(STEP) * numpy.eye(2), r


def simulated():
    rng = np.random.default_rng(2)
    transition, drive, root, r = matrices(TRUE, np)
    faces = np.stack([20 + np.sin(np.arange(ROWS) * STEP / 4), 5 + 4 * np.sin(np.arange(ROWS) * STEP / 3.8)], axis=1)
    state, y = np.array([15.0, 10.0]), []
    for t in range(ROWS):
        y.append(state[0] + r * rng.standard_normal())
        state = transition @ state + drive @ faces[t] + root @ rng.standard_normal(2)
    return faces, np.array(y)[:, None]


class Wall(MLEModel):
    """The same model for statsmodels."""

    start_params = np.log([1.0, 3.0, 0.5, 0.1])
    param_names = ("R", "C", "q", "r")

    def __init__(self, y, faces):
        super().__init__(y, k_states=2, k_posdef=2)
        self.faces = faces
        self["design"] = np.array([[1.0, 0.0]])
        self["selection"] = np.eye(2)
        self.ssm.initialize_known(np.array([15.0, 10.0]), np.eye(2))

    def update(self, params, **kwargs):
        params = super().update(params, **kwargs)
        transition, drive, root, r = matrices(params, np)
        self["transition"] = transition
        self["state_cov"] = root @ root.T
        self["obs_cov"] = np.array([[r**2]])
        self["state_intercept"] = drive @ self.faces.T


def log_likelihood(theta, faces, y):
    """By our filter, on the readings minus what the faces alone cause."""
    transition, drive, root, r = matrices(theta, jnp)

    def step(state, inputs):
        return transition @ state + drive @ inputs, state

    _, by_faces = jax.lax.scan(step, jnp.array([15.0, 10.0]), faces)
    model = LinearGaussianModel(transition, root, jnp.zeros(2), jnp.eye(2), jnp.array([[1.0, 0.0]]), r[None])
    return kalman_filter(model, y - by_faces[:, :1], jnp.ones(y.shape, bool)).log_likelihood


def test_likelihood_and_estimate_of_a_wall_of_two_nodes():
    faces, y = simulated()
    theirs = Wall(y, faces)
    value = jax.jit(log_likelihood)
    for theta in (TRUE, np.asarray(theirs.start_params)):
        assert float(value(jnp.asarray(theta), faces, y)) == pytest.approx(theirs.loglike(theta), rel=1e-6)
    fit = theirs.fit(disp=False, maxiter=500, method="bfgs", gtol=1e-8)
    with_gradient = jax.jit(jax.value_and_grad(lambda theta: -log_likelihood(theta, faces, y)))
    ours = scipy.optimize.minimize(
        lambda theta: [np.asarray(part) for part in with_gradient(jnp.asarray(theta))],
        np.asarray(theirs.start_params), jac=True, method="BFGS", options={"gtol": 1e-6},
    )  # fmt: skip
    assert -ours.fun == pytest.approx(fit.llf, rel=1e-6)
    assert_allclose(ours.x, fit.params, atol=1e-4)
