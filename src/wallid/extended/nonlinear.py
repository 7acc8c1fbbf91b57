"""A wall whose coefficients depend on temperature or time, stepped through diffrax.

The solver is implicit in the heat that the nodes hold; what its steps solve is tridiagonal.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, ClassVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..effects import Campaign, Terms, Wetting
from .cells import Cells, coefficients, rate
from .heat import LEAST_FACTOR, Heat

_DAY = 86400.0
_CLOSE = 1e-9  # K, of the last of Newton's steps, which is the square of it off
_MOST_ROUNDS = 50
_ONSET = 1800.0  # s, in which a wetting sets in
LONGEST_SUBSTEP = 1200.0
"""Of the implicit solver, s."""


class NonlinearWall(eqx.Module):
    """The rate of a wall whose coefficients depend on temperature or time, as a diffrax vector field."""

    wall: Cells
    diffusivity: Array
    step: Array
    conductivity_slope: Array
    heat: Heat
    drift: Array
    wettings: tuple[Wetting, ...]

    def inputs(self, t: Array) -> tuple[Array, Array]:
        """Inputs and their rates (per s) at a time."""
        course = self.wall.course
        interval = jnp.clip((t / self.step).astype(int), 0, course.shape[0] - 1)
        s = t / self.step - interval
        value = slope = jnp.zeros(course.shape[2])
        for here in course[interval][::-1]:  # Horner
            value, slope = value * s + here, slope * s + value
        return value, slope / self.step

    def factor(self, t: Array) -> Array:
        """`s(t)`, by which the diffusivity differs from that of the first row."""
        factor = 1.0 + self.drift * t / _DAY
        for event in self.wettings:
            since = t - event.time
            onset = jnp.clip(0.5 + since / _ONSET, 0.0, 1.0)  # not at once, so that its time can be searched for
            decay = jnp.exp(-jnp.maximum(since, 0.0) / event.time_constant)
            factor = factor * (1.0 + event.jump * onset * decay)
        return jnp.maximum(factor, LEAST_FACTOR)

    def factors(self, T: Array, q: Array) -> tuple[Array, Array]:
        """By which each cell's conductivity and each node's capacity differ at these temperatures."""
        everywhere = jnp.concatenate([q[:1], T, q[1:2]])
        middle = 0.5 * (everywhere[1:] + everywhere[:-1]) - self.heat.reference
        conductivity = 1.0 + self.conductivity_slope * middle
        return jnp.maximum(conductivity, LEAST_FACTOR), self.heat.capacity(T)

    def coefficients(self, t: Array, T: Array, q: Array) -> tuple[Array, Array, Array]:
        """`lower, diagonal, upper` of the rate with the coefficients of this moment."""
        conductivity, capacity = self.factors(T, q)
        return coefficients(self.wall, self.diffusivity * self.factor(t) * conductivity, capacity)

    def __call__(self, t: Any, T: Array, args: Any) -> Array:
        """`dT/dt`."""
        q, _ = self.inputs(jnp.asarray(t))
        return rate(self.wall, self.coefficients(jnp.asarray(t), T, q), T, q)

    def reading(self, t: Array, T: Array) -> tuple[Array, Array]:
        """Temperature and its rate at the sensors."""
        q, q_rate = self.inputs(t)
        warming = rate(self.wall, self.coefficients(t, T, q), T, q)
        return self.wall.state @ T + self.wall.face @ q[:2], self.wall.state @ warming + self.wall.face @ q_rate[:2]


def flow(wall: Cells, terms: Terms, campaign: Campaign, diffusivity: Array) -> NonlinearWall:
    """The rate of a wall with these terms."""
    return NonlinearWall(
        wall,
        diffusivity,
        campaign.step,
        terms.conductivity_slope,
        Heat(campaign.reference, terms.capacity_slope, terms.latent),
        terms.drift,
        terms.wettings,
    )


class DiagonallyImplicit(diffrax.AbstractSolver):
    """Two implicit stages a step in the nodes' heat H, second order and damping at infinity::

        H(Y_1) = H(y_0) + g h f(t + g h, Y_1)
        H(Y_2) = H(y_0) + (1 - g) h f(t + g h, Y_1) + g h f(t + h, Y_2),      y_1 = Y_2

    with `g = 1 - 1/sqrt(2)` and f the rate of heat. No heat is lost where the capacity changes fast, as while water
    freezes. Each stage is solved by Newton's method; its tangents are one tridiagonal solve more.

    Arguments:
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
    capacity at its beginning would take.
    """
    (q, _), pace, heat = field.inputs(t), field.factor(t), field.heat

    def moving(state: tuple[Array, ...]) -> Array:
        _, moved, rounds = state
        return (moved > _CLOSE) & (rounds < _MOST_ROUNDS)

    def nearer(state: tuple[Array, ...]) -> tuple[Array, ...]:
        T, _, rounds = state
        conductivity, capacity = field.factors(T, q)
        matrix = coefficients(field.wall, field.diffusivity * pace * conductivity, capacity)
        here = heat.content(T)
        missing = span * rate(field.wall, matrix, T, q) - (here - held) / capacity
        ahead = _solve(-span * matrix[0], 1.0 - span * matrix[1], -span * matrix[2], missing)
        needed = jnp.abs(heat.content(T + ahead) - here)
        ahead = ahead * jnp.minimum(1.0, capacity * jnp.abs(ahead) / jnp.maximum(needed, 1e-300))
        return T + ahead, jnp.max(jnp.abs(ahead)), rounds + 1

    return jax.lax.while_loop(moving, nearer, (near, jnp.asarray(jnp.inf), jnp.zeros((), int)))[0]


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


def nonlinear_course(
    wall: Cells,
    terms: Terms,
    campaign: Campaign,
    diffusivity: Array,
    initial: Float[Array, " node"],
    *,
    substeps: int,
    solver: diffrax.AbstractSolver | None = None,
    controller: diffrax.AbstractAdaptiveStepSizeController | None = None,
) -> tuple[Float[Array, "time sensor"], Float[Array, "time sensor"]]:
    """Temperature (degC) and its rate (K/s) at the sensors, at each row, through diffrax.

    Arguments:
        substeps: of the implicit solver, equal steps between two rows.
        solver, controller: another of diffrax's and its steps, for comparison.
    """
    field = flow(wall, terms, campaign, diffusivity)
    times = jnp.arange(campaign.intervals + 1) * campaign.step
    if controller is None:
        steps: diffrax.AbstractStepSizeController = diffrax.StepTo(ts=times)
        save, most = diffrax.SaveAt(t0=True, steps=True), campaign.intervals
    else:
        steps, save, most = controller, diffrax.SaveAt(ts=times), 256 * len(times)
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(field),
        solver or DiagonallyImplicit(substeps),
        t0=0.0,
        t1=campaign.intervals * campaign.step,
        dt0=None,
        y0=initial,
        saveat=save,
        stepsize_controller=steps,
        adjoint=diffrax.ForwardMode(),
        max_steps=most,
        throw=False,
    )
    assert solution.ys is not None
    return jax.vmap(field.reading)(times, solution.ys)
