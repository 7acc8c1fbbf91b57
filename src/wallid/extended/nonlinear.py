"""A wall whose coefficients depend on temperature or time, stepped through diffrax.

The solver is linearly implicit: two tridiagonal solves a step, of the coefficients at the step's beginning.
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

from ..effects import Campaign, Step, Terms, Wetting, latent_capacity
from .cells import Cells, coefficients, rate

_DAY = 86400.0
_LEAST_FACTOR = 0.05  # of a coefficient that depends on temperature or time, lest the equation lose its sense
_ONSET = 1800.0  # s, in which a wetting sets in
LONGEST_SUBSTEP = 1200.0
"""Of the linearly implicit solver, s."""


class NonlinearWall(eqx.Module):
    """The rate of a wall whose coefficients depend on temperature or time, as a diffrax vector field."""

    wall: Cells
    diffusivity: Array
    step: Array
    reference: Array
    conductivity_slope: Array
    capacity_slope: Array
    latent: tuple[Step, ...]
    drift: Array
    wettings: tuple[Wetting, ...]

    def inputs(self, t: Array) -> tuple[Array, Array]:
        """Inputs and their rates (per s) at a time."""
        course = self.wall.course
        interval = jnp.clip((t / self.step).astype(int), 0, course.shape[0] - 1)
        s = t / self.step - interval
        powers = jnp.arange(course.shape[1])
        here = course[interval]
        value = s**powers @ here
        slope = (powers[1:] * s ** powers[:-1]) @ here[1:]
        return value, slope / self.step

    def factor(self, t: Array) -> Array:
        """`s(t)`, by which the diffusivity differs from that of the first row."""
        factor = 1.0 + self.drift * t / _DAY
        for event in self.wettings:
            since = t - event.time
            onset = jnp.clip(0.5 + since / _ONSET, 0.0, 1.0)  # not at once, so that its time can be searched for
            decay = jnp.exp(-jnp.maximum(since, 0.0) / event.time_constant)
            factor = factor * (1.0 + event.jump * onset * decay)
        return jnp.maximum(factor, _LEAST_FACTOR)

    def factors(self, T: Array, q: Array) -> tuple[Array, Array]:
        """By which each cell's conductivity and each node's capacity differ at these temperatures."""
        everywhere = jnp.concatenate([q[:1], T, q[1:2]])
        middle = 0.5 * (everywhere[1:] + everywhere[:-1]) - self.reference
        conductivity = 1.0 + self.conductivity_slope * middle
        capacity = 1.0 + self.capacity_slope * (T - self.reference) + latent_capacity(self.latent, T)
        return jnp.maximum(conductivity, _LEAST_FACTOR), jnp.maximum(capacity, _LEAST_FACTOR)

    def coefficients(self, t: Array, T: Array, q: Array) -> tuple[Array, Array, Array]:
        """`lower, diagonal, upper` of the rate with the coefficients of this moment."""
        conductivity, capacity = self.factors(T, q)
        return coefficients(self.wall, self.diffusivity * self.factor(t) * conductivity, capacity)

    def __call__(self, t: Any, T: Array, args: Any) -> Array:
        """`dT/dt`."""
        q, _ = self.inputs(jnp.asarray(t))
        return rate(self.wall, self.coefficients(jnp.asarray(t), T, q), T, q)

    def reading(self, t: Any, T: Array, args: Any) -> tuple[Array, Array]:
        """Temperature and its rate at the sensors."""
        q, q_rate = self.inputs(jnp.asarray(t))
        warming = rate(self.wall, self.coefficients(jnp.asarray(t), T, q), T, q)
        return self.wall.state @ T + self.wall.face @ q[:2], self.wall.state @ warming + self.wall.face @ q_rate[:2]


def flow(wall: Cells, terms: Terms, campaign: Campaign, diffusivity: Array) -> NonlinearWall:
    """The rate of a wall with these terms."""
    return NonlinearWall(
        wall,
        diffusivity,
        campaign.step,
        campaign.reference,
        terms.conductivity_slope,
        terms.capacity_slope,
        terms.latent,
        terms.drift,
        terms.wettings,
    )


class LinearlyImplicit(diffrax.AbstractSolver):
    """Two linear solves a step, second order for any matrix `W` near the Jacobian, damping at infinity::

        (1 - g h W) k_1 = f(t, y) + g h f_t
        (1 - g h W) k_2 = f(t + h, y + h k_1) - 2 k_1 - g h f_t,      y_1 = y + h (3 k_1 + k_2) / 2

    with `g = 1 - 1/sqrt(2)`, `W` the tridiagonal rate with the coefficients of the step's beginning, and
    `f_t` what the faces' and sources' change makes.

    Source: ROS2 of Verwer, Spee, Blom and Hundsdorfer, SIAM J. Sci. Comput. 20 (1999), 1456.
    """

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
        start, end = jnp.asarray(t0), jnp.asarray(t1)
        h, gamma = end - start, 1.0 - 1.0 / math.sqrt(2.0)
        # just inside the step: at a row itself the courses may jump
        q0, q0_rate = field.inputs(start + 1e-6 * h)
        q1, _ = field.inputs(end - 1e-6 * h)
        lower, diagonal, upper = matrix = field.coefficients(start, y0, q0)

        def solve(right: Array) -> Array:
            below, beside, above = (jnp.asarray(-gamma * h * part) for part in (lower, diagonal, upper))
            # the first and last of these belong to the faces
            return jax.lax.linalg.tridiagonal_solve(
                below.at[0].set(0.0), 1.0 + beside, above.at[-1].set(0.0), right[:, None]
            )[:, 0]

        inward = jnp.zeros_like(y0).at[0].add(lower[0] * q0_rate[0]).at[-1].add(upper[-1] * q0_rate[1])
        drive = gamma * h * (inward + field.wall.other @ q0_rate[2:])
        k1 = solve(rate(field.wall, matrix, y0, q0) + drive)
        ahead = y0 + h * k1
        k2 = solve(rate(field.wall, field.coefficients(end, ahead, q1), ahead, q1) - 2.0 * k1 - drive)
        y1 = y0 + 0.5 * h * (3.0 * k1 + k2)
        return y1, None, {"y0": y0, "y1": y1}, None, diffrax.RESULTS.successful

    def func(self, terms, t0, y0, args):
        """The rate, for diffrax's own use."""
        return terms.vf(t0, y0, args)


def nonlinear_course(
    wall: Cells,
    terms: Terms,
    campaign: Campaign,
    diffusivity: Array,
    initial: Float[Array, " node"],
    *,
    substeps: int,
    solver: diffrax.AbstractSolver = LinearlyImplicit(),  # noqa: B008 (immutable)
    controller: diffrax.AbstractAdaptiveStepSizeController | None = None,
) -> tuple[Float[Array, "time sensor"], Float[Array, "time sensor"]]:
    """Temperature (degC) and its rate (K/s) at the sensors, at each row, through diffrax.

    Arguments:
        substeps: equal steps between two rows.
        solver, controller: another of diffrax's, for comparison; an adaptive controller takes no `substeps`.
    """
    field = flow(wall, terms, campaign, diffusivity)
    rows = campaign.intervals + 1
    if controller is None:
        fine = jnp.arange(campaign.intervals * substeps + 1) * (campaign.step / substeps)
        steps: diffrax.AbstractStepSizeController = diffrax.StepTo(ts=fine)
        save, most, stride = diffrax.SaveAt(t0=True, steps=True, fn=field.reading), fine.shape[0] - 1, substeps
    else:
        steps = controller
        save = diffrax.SaveAt(ts=jnp.arange(rows) * campaign.step, fn=field.reading)
        most, stride = 256 * rows, 1
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(field),
        solver,
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
    value, rate = solution.ys
    return value[::stride], rate[::stride]
