"""A square-root Kalman filter and a two-filter smoother for a linear Gaussian model on uniform rows.

    s_0 ~ N(m_0, S_0 S_0'),      s_{t+1} = Phi s_t + G w_t,      y_t = H_t s_t + R v_t,      w, v ~ N(0, 1)

Covariances are carried as triangular roots, found by QR of stacked roots, so they stay symmetric and positive. The
backward filter carries the information of the later readings, `Lambda = U U'`, which needs no inverse of a covariance:
states that are known exactly, or that two others determine, are allowed. The smoothed states are

    m = m_p + S (1 + S' Lambda S)^-1 S' (xi - Lambda m_p),      P = S (1 + S' Lambda S)^-1 S'

with `m_p` and `S` as predicted from the earlier readings, and `xi` the backward filter's information vector.

Source: T. Kailath, A. H. Sayed, B. Hassibi, Linear Estimation (2000), 12; D. C. Fraser, J. E. Potter, IEEE Trans.
Autom. Control 14 (1969), 387; J. Durbin, S. J. Koopman, Time Series Analysis by State Space Methods (2012), 4.
"""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import solve_triangular
from jaxtyping import Array, Bool, Float

from .._internal.arrays import on_device


class LinearGaussianModel(eqx.Module):
    """A linear Gaussian model on uniform rows.

    Args:
        transition: Phi, `(state, state)`.
        noise_root: G, of what a step adds, `(state, noise)`.
        initial_mean: m_0, `(state,)`.
        initial_root: S_0, `(state, root)`.
        outputs: H, `(output, state)`, or one for each row, `(time, output, state)`.
        output_std: standard deviations of the readings' white noise, the diagonal of R, `(output,)`, above 0.
    """

    transition: Float[Array, "state state"] = eqx.field(converter=on_device)
    noise_root: Float[Array, "state noise"] = eqx.field(converter=on_device)
    initial_mean: Float[Array, " state"] = eqx.field(converter=on_device)
    initial_root: Float[Array, "state root"] = eqx.field(converter=on_device)
    outputs: Float[Array, "*time output state"] = eqx.field(converter=on_device)
    output_std: Float[Array, " output"] = eqx.field(converter=on_device)

    def outputs_at_rows(self, rows: int) -> Float[Array, "time output state"]:
        """H for each row."""
        return self.outputs if self.outputs.ndim == 3 else jnp.broadcast_to(self.outputs, (rows, *self.outputs.shape))

    def first_rows(self, rows: int) -> LinearGaussianModel:
        """The same model with the outputs of the first rows."""
        return self if self.outputs.ndim == 2 else eqx.tree_at(lambda m: m.outputs, self, self.outputs[:rows])


class Filtered(NamedTuple):
    """The states given the readings up to each row.

    Args:
        log_likelihood: of all readings.
        predicted_mean, predicted_root: of the states given the rows before, `(time, state)` and `(time, state, state)`.
        mean, root: of the states given the rows up to this one.
        innovation: reading minus its prediction from the rows before, over the root of its covariance, 0 where missing,
            `(time, output)`.
    """

    log_likelihood: Float[Array, ""]
    predicted_mean: Float[Array, "time state"]
    predicted_root: Float[Array, "time state state"]
    mean: Float[Array, "time state"]
    root: Float[Array, "time state state"]
    innovation: Float[Array, "time output"]


class Smoothed(NamedTuple):
    """The states given all readings: mean, `(time, state)`, and root of the covariance, `(time, state, state)`."""

    mean: Float[Array, "time state"]
    root: Float[Array, "time state state"]


def triangular_root(stacked: Float[Array, "state root"]) -> Float[Array, "state state"]:
    """The lower triangular `L` with `L L' = A A'` and no negative diagonal."""
    states, columns = stacked.shape
    if columns < states:
        stacked = jnp.pad(stacked, ((0, 0), (0, states - columns)))
    root = jnp.linalg.qr(stacked.T, mode="r").T
    return root * jnp.where(jnp.diag(root) < 0.0, -1.0, 1.0)


def covariance_root(covariance: Float[np.ndarray, "state state"]) -> Float[np.ndarray, "state root"]:
    """A root of a covariance that may be singular; directions below round-off are left out."""
    values, vectors = np.linalg.eigh(covariance)
    kept = values > len(values) * np.finfo(float).eps * max(values[-1], 0.0)
    return vectors[:, kept] * np.sqrt(values[kept])


@eqx.filter_jit
def kalman_filter(
    model: LinearGaussianModel, readings: Float[Array, "time output"], present: Bool[Array, "time output"]
) -> Filtered:
    """The states given the readings up to each row, and the log-likelihood.

        -2 log L = sum (e_t' e_t + 2 ln det S_t + n_t ln(2 pi)),      e_t = S_t^-1 (y_t - H_t m_t)

    Args:
        model: of the states and the readings.
        readings: y.
        present: whether there is a reading; the others are left out.
    """
    state = model.initial_mean, triangular_root(model.initial_root)
    rows = model.outputs_at_rows(len(readings)), readings, present

    def step(predicted: tuple[Array, Array], row: tuple[Array, Array, Array]) -> tuple[tuple, tuple]:
        mean, root, innovation, log_det = _update(model, predicted, row)
        after = model.transition @ mean, _predicted_root(model, root)
        return after, (*predicted, mean, root, innovation, log_det)

    _, (predicted_mean, predicted_root, mean, root, innovation, log_det) = jax.lax.scan(step, state, rows)
    cost = jnp.sum(innovation**2) + 2.0 * jnp.sum(log_det) + jnp.sum(present) * jnp.log(2.0 * jnp.pi)
    return Filtered(-0.5 * cost, predicted_mean, predicted_root, mean, root, innovation)


def _update(
    model: LinearGaussianModel, predicted: tuple[Array, Array], row: tuple[Array, Array, Array]
) -> tuple[Array, Array, Array, Array]:
    """Mean and root after the readings of a row, the innovation, and the logarithm of its root's determinant."""
    (mean, root), (H, y, present) = predicted, row
    count, states = H.shape
    # a missing reading is one of nothing, with a noise of 1
    H, y = jnp.where(present[:, None], H, 0.0), jnp.where(present, y, 0.0)
    noise = jnp.where(present, model.output_std, 1.0)
    stacked = jnp.block([[jnp.diag(noise), H @ root], [jnp.zeros((states, count)), root]])
    after = triangular_root(stacked)
    of_readings, gain, after_root = after[:count, :count], after[count:, :count], after[count:, count:]
    innovation = solve_triangular(of_readings, y - H @ mean, lower=True)
    log_det = jnp.sum(jnp.log(jnp.diag(of_readings)))
    return mean + gain @ innovation, after_root, innovation, log_det


def _predicted_root(model: LinearGaussianModel, root: Float[Array, "state state"]) -> Float[Array, "state state"]:
    return triangular_root(jnp.concatenate([model.transition @ root, model.noise_root], axis=1))


@eqx.filter_jit
def kalman_smoother(
    model: LinearGaussianModel,
    filtered: Filtered,
    readings: Float[Array, "time output"],
    present: Bool[Array, "time output"],
) -> Smoothed:
    """The states given all readings.

    Args:
        model, readings, present: as for the filter.
        filtered: of the filter on the same readings.
    """
    states = len(model.initial_mean)
    weights = jnp.where(present, 1.0 / model.output_std, 0.0)
    rows = model.outputs_at_rows(len(readings)), readings, weights
    nothing = jnp.zeros(states), jnp.zeros((states, states))

    def step(later: tuple[Array, Array], row: tuple) -> tuple[tuple, tuple]:
        (xi, U), ((H, y, weight), mean, root) = later, row
        scaled = (weight[:, None] * H).T
        U = triangular_root(jnp.concatenate([scaled, U], axis=1))
        xi = scaled @ jnp.where(weight > 0, weight * y, 0.0) + xi
        # (1 + S' Lambda S)^-1 = T^-T T^-1
        T = triangular_root(jnp.concatenate([jnp.eye(states), root.T @ U], axis=1))
        smoothed_root = solve_triangular(T, root.T, lower=True).T
        smoothed = mean + smoothed_root @ (smoothed_root.T @ (xi - U @ (U.T @ mean)))
        # the information about the state one row earlier: (Lambda^-1 + Q)^-1 = U T^-T T^-1 U', T T' = 1 + U' Q U
        spread = U.T @ model.noise_root
        T = triangular_root(jnp.concatenate([jnp.eye(states), spread], axis=1))
        reduced = solve_triangular(T, U.T, lower=True).T
        xi = xi - reduced @ solve_triangular(T, spread @ (model.noise_root.T @ xi), lower=True)
        return (model.transition.T @ xi, model.transition.T @ reduced), (smoothed, smoothed_root)

    by_row = (rows, filtered.predicted_mean, filtered.predicted_root)
    _, (mean, root) = jax.lax.scan(step, nothing, by_row, reverse=True)
    return Smoothed(mean, root)


@eqx.filter_jit
def forecast_states(
    model: LinearGaussianModel, mean: Float[Array, " state"], root: Float[Array, "state state"], rows: int
) -> Smoothed:
    """The states at the rows after one at which they are known, without further readings.

    Args:
        model: of the states.
        mean, root: at the last row with readings.
        rows: how many rows follow.
    """

    def step(state: tuple[Array, Array], _: None) -> tuple[tuple, tuple]:
        after = model.transition @ state[0], _predicted_root(model, state[1])
        return after, after

    _, (means, roots) = jax.lax.scan(step, (mean, root), None, length=rows)
    return Smoothed(means, roots)
