"""A wall of two capacities and three resistances with process noise, for our filter and for statsmodels.

With equal resistances R and capacities C, faces held over a step, and independent noise at both nodes::

    C dT_1/dt = (T_left - 2 T_1 + T_2) / R + noise,      C dT_2/dt = (T_1 - 2 T_2 + T_right) / R + noise

read at the first node.
"""

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from statsmodels.tsa.statespace.mlemodel import MLEModel

from wallid.inference.kalman_filter import LinearGaussianModel, kalman_filter

STEP = 0.5  # h
TRUE = np.log([1.5, 4.0, 0.3, 0.05])  # resistance, capacity, process noise and reading noise
START = np.log([1.0, 3.0, 0.5, 0.1])
FIRST = np.array([15.0, 10.0])  # mean of the first state, degC; its variance is 1 K2


def matrices(theta, numpy):
    """The exact step, the inputs' matrix and the noise's root, of two nodes between two faces with held inputs."""
    R, C, q, r = (numpy.exp(one) for one in theta)
    A = numpy.array([[-2.0, 1.0], [1.0, -2.0]]) / (R * C)
    B = numpy.array([[1.0, 0.0], [0.0, 1.0]]) / (R * C)
    expm = jax.scipy.linalg.expm if numpy is jnp else scipy.linalg.expm
    transition = expm(A * STEP)
    drive = numpy.linalg.solve(A, (transition - numpy.eye(2)) @ B)
    return transition, drive, q * np.sqrt(STEP) * numpy.eye(2), r


def simulated(rows):
    """Faces `(time, 2)` and readings `(time, 1)` of a record."""
    rng = np.random.default_rng(2)
    transition, drive, root, r = matrices(TRUE, np)
    faces = np.stack([20 + np.sin(np.arange(rows) * STEP / 4), 5 + 4 * np.sin(np.arange(rows) * STEP / 3.8)], axis=1)
    state, y = FIRST, []
    for t in range(rows):
        y.append(state[0] + r * rng.standard_normal())
        state = transition @ state + drive @ faces[t] + root @ rng.standard_normal(2)
    return faces, np.array(y)[:, None]


class StatsmodelsWall(MLEModel):
    """The wall for statsmodels."""

    start_params = START
    param_names = ("R", "C", "q", "r")

    def __init__(self, y, faces):
        super().__init__(y, k_states=2, k_posdef=2)
        self.faces = faces
        self["design"] = np.array([[1.0, 0.0]])
        self["selection"] = np.eye(2)
        self.ssm.initialize_known(FIRST, np.eye(2))

    def update(self, params, **kwargs):
        """The matrices at some parameters."""
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

    _, by_faces = jax.lax.scan(step, jnp.asarray(FIRST), faces)
    model = LinearGaussianModel(transition, root, jnp.zeros(2), jnp.eye(2), jnp.array([[1.0, 0.0]]), r[None])
    return kalman_filter(model, y - by_faces[:, :1], jnp.ones(y.shape, bool)).log_likelihood


def fitted(faces, y, gtol=1e-6):
    """A function without arguments that maximises our likelihood by BFGS with its own gradient."""
    with_gradient = jax.jit(jax.value_and_grad(lambda theta: -log_likelihood(theta, faces, y)))

    def fit():
        return scipy.optimize.minimize(
            lambda theta: [np.asarray(part) for part in with_gradient(jnp.asarray(theta))],
            START, jac=True, method="BFGS", options={"gtol": gtol},
        )  # fmt: skip

    return fit
