"""A solver for diffrax, implicit in the heat that a wall's nodes hold; what its steps solve is tridiagonal."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import ClassVar

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .cells import rate
from .nonlinear_wall import NonlinearWall

_CLOSE = 1e-9  # K, the last of Newton's steps
_MOST_ROUNDS = 50


class DiagonallyImplicit(diffrax.AbstractSolver):
    """Two implicit stages a step in the nodes' heat H, second order and damping at infinity::

        H(Y_1) = H(y_0) + g h f(t + g h, Y_1)
        H(Y_2) = H(y_0) + (1 - g) h f(t + g h, Y_1) + g h f(t + h, Y_2),      y_1 = Y_2

    with `g = 1 - 1/sqrt(2)` and f the rate of heat. No heat is lost where the capacity changes fast, as while water
    freezes. Each stage is solved by Newton's method; its tangents are one tridiagonal solve more.

    Args:
        parts: equal ones that a step is taken in.

    Source: R. Alexander, SIAM J. Numer. Anal. 14 (1977), 1006.
    """

    parts: int = 1

    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar[Callable[..., diffrax.LocalLinearInterpolation]] = diffrax.LocalLinearInterpolation

    def order(self, terms):
        """Two."""
        return 2

    def init(self, terms, t0, t1, y0, args):
        """Nothing is kept from step to step."""
        return

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        """One step from t0 to t1."""
        field: NonlinearWall = getattr(terms, "term", terms).vector_field
        start, h = jnp.asarray(t0), (jnp.asarray(t1) - jnp.asarray(t0)) / self.parts
        gamma = 1.0 - 1.0 / math.sqrt(2.0)

        def part(y: Array, begin: Array) -> tuple[Array, None]:
            held = field.heat.content(y)
            first = _stage(field, begin + gamma * h, gamma * h, held, y)
            heated = (field.heat.content(first) - held) / gamma
            # just inside the step: at a row itself the courses may jump
            return _stage(field, begin + (1.0 - 1e-6) * h, gamma * h, held + (1.0 - gamma) * heated, first), None

        y1, _ = jax.lax.scan(part, y0, start + h * jnp.arange(self.parts))
        return y1, None, {"y0": y0, "y1": y1}, None, diffrax.RESULTS.successful

    def func(self, terms, t0, y0, args):
        """The rate, for diffrax's own use."""
        return terms.vf(t0, y0, args)


@jax.custom_jvp
def _stage(field: NonlinearWall, t: Array, span: Array, held: Array, near: Array) -> Float[Array, " node"]:
    """The temperatures at which the nodes hold what they held and what comes in over a span at that time, degC.

    Newton's method from temperatures near them, with the coefficients' own bend left out of its matrix. Where a step
    would carry a node across a bump of the capacity, it is shortened as far as the heat on its way exceeds what the
    capacity at its beginning would take. NaN where it does not end.
    """
    (q, _), factor, heat = field.inputs(t), field.factor(t), field.heat

    def moving(state: tuple[Array, ...]) -> Array:
        _, moved, rounds = state
        return (moved > _CLOSE) & (rounds < _MOST_ROUNDS)

    def nearer(state: tuple[Array, ...]) -> tuple[Array, ...]:
        T, _, rounds = state
        matrix = field.coefficients(factor, T, q)
        here, capacity = heat.content(T), heat.capacity(T)
        missing = span * rate(field.wall, matrix, T, q) - (here - held) / capacity
        ahead = _solve(-span * matrix[0], 1.0 - span * matrix[1], -span * matrix[2], missing)
        needed = jnp.abs(heat.content(T + ahead) - here)
        ahead = ahead * jnp.minimum(1.0, capacity * jnp.abs(ahead) / jnp.maximum(needed, 1e-300))
        return T + ahead, jnp.max(jnp.abs(ahead)), rounds + 1

    T, moved, _ = jax.lax.while_loop(moving, nearer, (near, jnp.asarray(jnp.inf), jnp.zeros((), int)))
    return jnp.where(moved <= _CLOSE, T, jnp.nan)


@_stage.defjvp
def _stage_jvp(primals, tangents):
    """By the implicit function theorem."""
    field, t, span, held, near = primals
    T = _stage(field, t, span, held, near)

    def excess(field: NonlinearWall, t: Array, span: Array, held: Array) -> Array:
        return _excess(field, t, span, held, T)

    _, change = jax.jvp(excess, (field, t, span, held), tangents[:-1])
    return T, -_solve(*_tridiagonal(lambda T: _excess(field, t, span, held, T), T), change)


def _excess(field: NonlinearWall, t: Array, span: Array, held: Array, T: Array) -> Float[Array, " node"]:
    """By how much the nodes at temperatures T hold more than they held and what comes in over a span, K."""
    return field.heat.content(T) - held - span * field.heat.capacity(T) * field(t, T, None)


def _tridiagonal(f: Callable[[Array], Array], T: Float[Array, " node"]) -> tuple[Array, Array, Array]:
    """`lower, diagonal, upper` of the Jacobian of a function of neighbours alone: three directions give all of it."""
    third = jnp.arange(T.shape[0]) % 3 == jnp.arange(3)[:, None]
    slopes = jax.vmap(jax.linearize(f, T)[1])(third.astype(float))
    lower, diagonal, upper = (jnp.sum(jnp.roll(third, k, axis=0) * slopes, axis=0) for k in (-1, 0, 1))
    return lower, diagonal, upper


@jax.custom_batching.custom_vmap
def _solve(lower: Array, diagonal: Array, upper: Array, right: Float[Array, " node"]) -> Float[Array, " node"]:
    """`M x = right` for a tridiagonal M; the first of `lower` and the last of `upper` belong to the faces."""
    return jax.lax.linalg.tridiagonal_solve(*_inner(lower, diagonal, upper), right[:, None])[:, 0]


@_solve.def_vmap
def _solve_many(size, batched, *parts):
    """Right sides of one M share its elimination, which JAX's own rule would repeat for each."""
    *matrix, right = parts
    if batched == [False, False, False, True]:
        return jax.lax.linalg.tridiagonal_solve(*_inner(*matrix), right.T).T, True
    full = [
        part if some else jnp.broadcast_to(part, (size, *part.shape)) for part, some in zip(parts, batched, strict=True)
    ]
    return jax.lax.linalg.tridiagonal_solve(*_inner(*full[:3]), full[3][..., None])[..., 0], True


def _inner(lower: Array, diagonal: Array, upper: Array) -> tuple[Array, Array, Array]:
    inside = jnp.arange(diagonal.shape[-1]) > 0
    return lower * inside, diagonal, upper * inside[::-1]
