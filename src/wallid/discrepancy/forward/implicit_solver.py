"""An implicit solver for diffrax in the heat content of the nodes; each Newton step is a tridiagonal solve."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import ClassVar

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .cells import temperature_rate
from .nonlinear_wall import NonlinearWall

_NEWTON_TOLERANCE = 1e-9  # K
_MAX_NEWTON_STEPS = 50


class DiagonallyImplicit(diffrax.AbstractSolver):
    """Two implicit stages per step in the heat content H of the nodes, second order and L-stable::

        H(Y_1) = H(y_0) + g h f(t + g h, Y_1)
        H(Y_2) = H(y_0) + (1 - g) h f(t + g h, Y_1) + g h f(t + h, Y_2),      y_1 = Y_2

    with `g = 1 - 1/sqrt(2)` and f the rate of heat content. The scheme conserves heat where the capacity changes
    fast, as during freezing. Each stage is solved by Newton's method, its tangents by one more tridiagonal solve.

    Args:
        parts: number of equal parts of a step.

    Source: R. Alexander, SIAM J. Numer. Anal. 14 (1977), 1006.
    """

    parts: int = 1

    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar[Callable[..., diffrax.LocalLinearInterpolation]] = diffrax.LocalLinearInterpolation

    def order(self, terms):
        """Order 2."""
        return 2

    def init(self, terms, t0, t1, y0, args):
        """No state is carried from step to step."""
        return

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        """One step from t0 to t1."""
        field: NonlinearWall = getattr(terms, "term", terms).vector_field
        start, h = jnp.asarray(t0), (jnp.asarray(t1) - jnp.asarray(t0)) / self.parts
        gamma = 1.0 - 1.0 / math.sqrt(2.0)

        def one_part(y: Array, begin: Array) -> tuple[Array, None]:
            content = field.heat.content(y)
            first = _stage(field, begin + gamma * h, gamma * h, content, y)
            increase = (field.heat.content(first) - content) / gamma
            # just before the end of the step, because the inputs may jump at a row
            return _stage(field, begin + (1.0 - 1e-6) * h, gamma * h, content + (1.0 - gamma) * increase, first), None

        y1, _ = jax.lax.scan(one_part, y0, start + h * jnp.arange(self.parts))
        return y1, None, {"y0": y0, "y1": y1}, None, diffrax.RESULTS.successful

    def func(self, terms, t0, y0, args):
        """The vector field, for use by diffrax."""
        return terms.vf(t0, y0, args)


@jax.custom_jvp
def _stage(field: NonlinearWall, t: Array, span: Array, content: Array, guess: Array) -> Float[Array, " node"]:
    """The temperatures T of one implicit stage, degC: `H(T) = content + span * dH/dt(t, T)`.

    Newton's method from the temperatures `guess`, without the derivatives of the coefficients in its matrix. A step
    across a peak of the capacity is shortened by the ratio of the heat at the initial capacity to that of the step.
    NaN where it does not converge.
    """
    (q, _), factor, heat = field.inputs(t), field.diffusivity_factor(t), field.heat

    def not_converged(state: tuple[Array, ...]) -> Array:
        _, change, count = state
        return (change > _NEWTON_TOLERANCE) & (count < _MAX_NEWTON_STEPS)

    def newton_step(state: tuple[Array, ...]) -> tuple[Array, ...]:
        T, _, count = state
        matrix = field.coefficients(factor, T, q)
        now, capacity = heat.content(T), heat.capacity(T)
        residual = span * temperature_rate(field.wall, matrix, T, q) - (now - content) / capacity
        change = _solve(-span * matrix[0], 1.0 - span * matrix[1], -span * matrix[2], residual)
        needed = jnp.abs(heat.content(T + change) - now)
        change = change * jnp.minimum(1.0, capacity * jnp.abs(change) / jnp.maximum(needed, 1e-300))
        return T + change, jnp.max(jnp.abs(change)), count + 1

    T, change, _ = jax.lax.while_loop(not_converged, newton_step, (guess, jnp.asarray(jnp.inf), jnp.zeros((), int)))
    return jnp.where(change <= _NEWTON_TOLERANCE, T, jnp.nan)


@_stage.defjvp
def _stage_jvp(primals, tangents):
    """By the implicit function theorem."""
    field, t, span, content, guess = primals
    T = _stage(field, t, span, content, guess)

    def excess(field: NonlinearWall, t: Array, span: Array, content: Array) -> Array:
        return _excess(field, t, span, content, T)

    _, change = jax.jvp(excess, (field, t, span, content), tangents[:-1])
    return T, -_solve(*_tridiagonal(lambda T: _excess(field, t, span, content, T), T), change)


def _excess(field: NonlinearWall, t: Array, span: Array, content: Array, T: Array) -> Float[Array, " node"]:
    """The residual of a stage, K: `H(T) - content - span * dH/dt(t, T)`."""
    return field.heat.content(T) - content - span * field.heat.capacity(T) * field(t, T, None)


def _tridiagonal(f: Callable[[Array], Array], T: Float[Array, " node"]) -> tuple[Array, Array, Array]:
    """`lower, diagonal, upper` of a tridiagonal Jacobian, from derivatives along three directions."""
    third = jnp.arange(T.shape[0]) % 3 == jnp.arange(3)[:, None]
    slopes = jax.vmap(jax.linearize(f, T)[1])(third.astype(float))
    lower, diagonal, upper = (jnp.sum(jnp.roll(third, k, axis=0) * slopes, axis=0) for k in (-1, 0, 1))
    return lower, diagonal, upper


@jax.custom_batching.custom_vmap
def _solve(lower: Array, diagonal: Array, upper: Array, right: Float[Array, " node"]) -> Float[Array, " node"]:
    """Solve `M x = right` with tridiagonal M; the first of `lower` and the last of `upper` are ignored."""
    return jax.lax.linalg.tridiagonal_solve(*_without_face_entries(lower, diagonal, upper), right[:, None])[:, 0]


@_solve.def_vmap
def _solve_many(size, batched, *parts):
    """Right-hand sides of the same M share one elimination; the rule of JAX would repeat it for each."""
    *matrix, right = parts
    if batched == [False, False, False, True]:
        return jax.lax.linalg.tridiagonal_solve(*_without_face_entries(*matrix), right.T).T, True
    full = [
        part if is_batched else jnp.broadcast_to(part, (size, *part.shape))
        for part, is_batched in zip(parts, batched, strict=True)
    ]
    return jax.lax.linalg.tridiagonal_solve(*_without_face_entries(*full[:3]), full[3][..., None])[..., 0], True


def _without_face_entries(lower: Array, diagonal: Array, upper: Array) -> tuple[Array, Array, Array]:
    interior = jnp.arange(diagonal.shape[-1]) > 0
    return lower * interior, diagonal, upper * interior[::-1]
