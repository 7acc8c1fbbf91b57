"""The exact step of a linear model, as a diffrax solver.

For inputs that are polynomials inside a step of length h, `q = sum_j c_j s^j` with s from 0 to 1:

    x_1 = e^z x_0 + sum_j h j! phi_{j+1}(z) g c_j,     z = h (Fo A + A0),     g = Fo B + B0

with `phi_1(z) = (e^z - 1)/z`, `phi_k+1(z) = (phi_k(z) - 1/k!)/z`. It is exact to round-off for every h and every mesh.

The inputs are given at the rows, in one of two ways:

- values, `(time, input)`: straight lines between rows;
- values, then their slopes (per unit of time), `(time, 2 input)`: cubics between rows (Hermite's).

Source: Hochbruck and Ostermann, Acta Numerica 19 (2010), Section 2.1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from .state_space import StateSpace

_SERIES_TERMS = 18  # 1/21! < 1e-19: for |z| < 1 the truncated terms are below round-off
_LINES = np.array([[1.0, -1.0], [0.0, 1.0]])  # powers of s in the share of the value at each end of a step
_CUBICS = np.array([[1.0, 0.0, -3.0, 2.0], [0.0, 0.0, 3.0, -2.0], [0.0, 1.0, -2.0, 1.0], [0.0, 0.0, -1.0, 1.0]])
"""Powers of s in the share of the value at each end of a step, then of the slope at each end (Hermite's cubics)."""
_MAX_SQUARINGS = 48  # expm gives NaN above it; 2^48 exceeds the norm of any practical mesh and step

State = tuple[Float[Array, "*rows node"], Float[Array, "*rows node"] | None]


def phi_functions(z: Float[Array, "*shape"], highest: int = 3) -> tuple[Float[Array, "*shape"], ...]:
    """`e^z, phi_1(z), ... phi_highest(z)` elementwise, accurate to round-off for every real z <= 0.

    For `|z| < 1` the series gives the highest function and the recurrence downward the others, without cancellation.
    For `|z| >= 1` the recurrence is used upward.

    Source: Hochbruck and Ostermann (2010), Section 2.1.
    """
    small = jnp.abs(z) < 1.0
    z_small = jnp.where(small, z, 0.0)
    series = jnp.zeros_like(z)
    for k in reversed(range(_SERIES_TERMS)):
        series = 1.0 / math.factorial(highest + k) + z_small * series
    downward = [series]
    for k in reversed(range(1, highest)):
        downward.insert(0, 1.0 / math.factorial(k) + z_small * downward[0])
    z_large = jnp.where(small, 1.0, z)
    upward = [jnp.expm1(z_large) / z_large]
    for k in range(1, highest):
        upward.append((upward[-1] - 1.0 / math.factorial(k)) / z_large)
    return jnp.exp(z), *(jnp.where(small, *pair) for pair in zip(downward, upward, strict=True))


class StepMap(eqx.Module):
    """One exact step: `x_1 = E x_0 + W0 q_0 + W1 q_1`, and its derivative by Fo.

    `theta_1 = E theta_0 + E_theta x_0 + V0 q_0 + V1 q_1`. For a diagonal model `E` and `E_theta` are vectors. `q_0` and
    `q_1` are the inputs at both ends: values, or values and slopes.
    """

    E: Array
    W0: Array
    W1: Array
    E_theta: Array | None = None
    V0: Array | None = None
    V1: Array | None = None

    def input_terms(self, q0: Float[Array, "*rows input"], q1: Float[Array, "*rows input"]) -> State:
        """`W0 q_0 + W1 q_1` and `V0 q_0 + V1 q_1`, for many steps at once."""
        x = thin_product(self.W0, q0) + thin_product(self.W1, q1)
        if self.V0 is None or self.V1 is None:
            return x, None
        return x, thin_product(self.V0, q0) + thin_product(self.V1, q1)

    def next_state(self, state: State, input_terms: State) -> State:
        """The state one step later; `input_terms` as the method of that name gives them."""
        x, theta = state
        # for one node the elementwise product is the matrix product
        step = jnp.matmul if self.E.ndim == 2 and self.E.shape[0] == self.E.shape[1] else jnp.multiply
        x1 = step(self.E, x) + input_terms[0]
        if theta is None or self.E_theta is None or input_terms[1] is None:
            return x1, None
        return x1, step(self.E, theta) + step(self.E_theta, x) + input_terms[1]

    def advance(self, state: State, q0: Float[Array, "*rows input"], q1: Float[Array, "*rows input"]) -> State:
        """The state one step later, with the inputs `q0` at the start and `q1` at the end of the step."""
        return self.next_state(state, self.input_terms(q0, q1))


def thin_product(matrix: Float[Array, "out few"], q: Float[Array, "*rows few"]) -> Float[Array, "*rows out"]:
    """`matrix q` for each row q, as a sum over the few columns: faster than a product of thin matrices."""
    return sum((q[..., k, None] * matrix[:, k] for k in range(1, matrix.shape[1])), q[..., :1] * matrix[:, 0])


def direct_term(system: StateSpace, step: StepMap) -> Float[Array, "output column"]:
    """`D` with a column for each column of the inputs: zeros for slopes."""
    return jnp.pad(system.D, ((0, 0), (0, step.W0.shape[1] - system.D.shape[1])))


def step_map(
    system: StateSpace, fourier: Float[Array, ""], step: Float[Array, ""], *, sensitivity: bool, cubic: bool = False
) -> StepMap:
    """The exact step of length `step` (in t_ref).

    For a diagonal model by the phi functions of its poles, for any other by a dense matrix exponential. Where the model
    has capacities, their square roots scale it first to a symmetric matrix, whose exponential is more accurate.

    Args:
        cubic: whether the inputs are values and slopes, for cubics inside the step; else values, for straight lines.
    """
    exact = _modal_step if system.is_diagonal else _dense_step
    return exact(system, fourier, step, sensitivity, _CUBICS if cubic else _LINES)


def _at_both_ends(of_powers: Sequence[Array], shapes: np.ndarray, h: Array) -> tuple[Array, Array]:
    """The effect of the inputs at the start and at the end of a step, from that of each power of s.

    Args:
        of_powers: one matrix for each power.
        shapes: `_LINES` or `_CUBICS`.
        h: length of the step, by which a slope is multiplied.
    """
    of_columns = [
        sum(share * matrix for share, matrix in zip(shape, of_powers, strict=True) if share) for shape in shapes
    ]
    scaled = [matrix if k < 2 else h * matrix for k, matrix in enumerate(of_columns)]
    start, end = (jnp.concatenate(scaled[k::2], axis=1) for k in (0, 1))
    return start, end


def _modal_step(system: StateSpace, fourier: Array, h: Array, sensitivity: bool, shapes: np.ndarray) -> StepMap:
    f, powers = system.A, shapes.shape[1]
    rate = fourier * f if system.A0 is None else fourier * f + system.A0
    g = fourier * system.B if system.B0 is None else fourier * system.B + system.B0
    E, *phis = (phi[:, None] for phi in phi_functions(h * rate, highest=powers + sensitivity))
    factorial = [math.factorial(j) for j in range(powers)]
    W0, W1 = _at_both_ends([h * factorial[j] * phis[j] * g for j in range(powers)], shapes, h)
    if not sensitivity:
        return StepMap(E[:, 0], W0, W1)
    # phi_k' = phi_k - k phi_{k+1}, and dz/dFo = h f
    dz = h * f[:, None]
    derivatives = [
        h * factorial[j] * ((phis[j] - (j + 1) * phis[j + 1]) * dz * g + phis[j] * system.B) for j in range(powers)
    ]
    V0, V1 = _at_both_ends(derivatives, shapes, h)
    return StepMap(E[:, 0], W0, W1, (dz * E)[:, 0], V0, V1)


def _dense_step(system: StateSpace, fourier: Array, h: Array, sensitivity: bool, shapes: np.ndarray) -> StepMap:
    """The exact step by a matrix exponential, with the powers of s of each input as further states.

    Source: Van Loan, IEEE Trans. Autom. Control 23 (1978), 395.
    """
    root = jnp.ones(system.order) if system.capacity is None else jnp.sqrt(system.capacity)

    def scaled(matrix: Array) -> Array:
        return root[:, None] * matrix / root

    (n, m), powers = system.B.shape, shapes.shape[1]
    A, B = scaled(system.A), root[:, None] * system.B
    rate = fourier * A if system.A0 is None else fourier * A + scaled(system.A0)
    g = fourier * B if system.B0 is None else fourier * B + root[:, None] * system.B0
    if sensitivity:
        rate = jnp.block([[rate, jnp.zeros((n, n))], [A, rate]])
        g = jnp.concatenate([g, B])
    states = rate.shape[0]
    augmented = jnp.zeros((states + powers * m, states + powers * m))
    augmented = augmented.at[:states, :states].set(h * rate)
    augmented = augmented.at[:states, states : states + m].set(h * g)
    augmented = augmented.at[states:-m, states + m :].set(jnp.eye((powers - 1) * m))
    full = jax.scipy.linalg.expm(augmented, max_squarings=_MAX_SQUARINGS)[:states]
    # the state of power j is s^j / j!
    of_powers = [math.factorial(j) * full[:, states + j * m : states + (j + 1) * m] for j in range(powers)]
    W0, W1 = _at_both_ends(of_powers, shapes, h)

    def unscaled(block: Array) -> Array:
        return block / root[:, None]

    E = unscaled(full[:n, :n]) * root
    if not sensitivity:
        return StepMap(E, unscaled(W0), unscaled(W1))
    E_theta = unscaled(full[n:, :n]) * root
    return StepMap(E, unscaled(W0[:n]), unscaled(W1[:n]), E_theta, unscaled(W0[n:]), unscaled(W1[n:]))


def input_path(
    time: Float[Array, " time"], inputs: Float[Array, "time column"], cubic: bool
) -> diffrax.LinearInterpolation | diffrax.CubicInterpolation:
    """The inputs as a function of time: straight lines between values, or cubics from values and slopes."""
    if not cubic:
        return diffrax.LinearInterpolation(time, inputs)
    h = jnp.diff(time)[:, None]
    value, slope = jnp.split(inputs, 2, axis=1)
    change, first, last = jnp.diff(value, axis=0) / h, slope[:-1], slope[1:]
    return diffrax.CubicInterpolation(
        time, ((first + last - 2 * change) / h**2, (3 * change - 2 * first - last) / h, first, value[:-1])
    )


class ModelVectorField(eqx.Module):
    """The rates of a model with its inputs, as a diffrax vector field.

    The state is `(x, x_theta)`; `x_theta` is None without the sensitivity.
    """

    system: StateSpace
    fourier: Float[Array, ""]
    inputs: diffrax.LinearInterpolation | diffrax.CubicInterpolation

    @property
    def cubic(self) -> bool:
        """Whether the inputs are cubics between rows; else straight lines."""
        return isinstance(self.inputs, diffrax.CubicInterpolation)

    def at_end_of_step(self, t: Any) -> Float[Array, " column"]:
        """The inputs for a `StepMap` at a time: values, and slopes if they are cubics."""
        value = self.inputs.evaluate(t)
        return jnp.concatenate([value, self.inputs.derivative(t)]) if self.cubic else value

    def __call__(self, t: Any, state: State, args: Any) -> State:
        """The rates of x and theta."""
        x, theta = state
        q = self.inputs.evaluate(t)
        x_rate = self.system.rate(x, q, self.fourier)
        if theta is None:
            return x_rate, None
        no_input = jnp.zeros_like(q)
        theta_rate = self.system.rate(theta, no_input, self.fourier)
        return x_rate, theta_rate + self.system.apply(x) + self.system.B @ q

    def output(self, t: Any, state: State, args: Any) -> tuple[Array, Array | None]:
        """`u = C x + D q` and `theta = C_theta x_theta`."""
        return outputs(self.system, state, self.inputs.evaluate(t))


def outputs(system: StateSpace, state: State, q: Float[Array, " input"]) -> tuple[Array, Array | None]:
    """`u = C x + D q` and `theta = C_theta x_theta`."""
    x, theta = state
    u = system.C @ x + system.D @ q
    if theta is None:
        return u, None
    return u, system.theta_outputs @ theta


class Exponential(diffrax.AbstractSolver):
    """The exact step for a `ModelVectorField`, as a diffrax solver.

    It is exact where the inputs are one polynomial inside each step, so every row must be the end of a step
    (`StepToRows`, or `diffrax.ClipStepSizeController`). The step map is computed again only where the length of the
    step changes. There is no error estimate, so an adaptive controller cannot be used.
    """

    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar[Callable[..., diffrax.LocalLinearInterpolation]] = diffrax.LocalLinearInterpolation

    def order(self, terms: PyTree) -> int | None:
        """None: the step has no truncation error."""
        return None

    def init(self, terms, t0, t1, y0, args):
        """The length of the first step and its map."""
        field = _vector_field_of(terms)
        h = jnp.asarray(t1 - t0)
        return h, step_map(field.system, field.fourier, h, sensitivity=y0[1] is not None, cubic=field.cubic)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        """One exact step from t0 to t1."""
        field = _vector_field_of(terms)
        length, previous = solver_state
        h = jnp.asarray(t1 - t0)
        # the times have round-off, so equal steps differ by that much
        same = jnp.abs(h - length) <= 8 * jnp.finfo(h).eps * jnp.maximum(jnp.abs(t1), h)
        step = jax.lax.cond(
            same,
            lambda: previous,
            lambda: step_map(field.system, field.fourier, h, sensitivity=y0[1] is not None, cubic=field.cubic),
        )
        y1 = step.advance(y0, field.at_end_of_step(t0), field.at_end_of_step(t1))
        state = (jnp.where(same, length, h), step)
        return y1, None, {"y0": y0, "y1": y1}, state, diffrax.RESULTS.successful

    def func(self, terms, t0, y0, args):
        """The rate, which diffrax needs for its own use."""
        return terms.vf(t0, y0, args)


def _vector_field_of(terms: PyTree) -> ModelVectorField:
    """The vector field of a term, which diffrax may wrap in a term for the direction of time."""
    return getattr(terms, "term", terms).vector_field
