"""The derivative of the readings along any effect, by one linear solve.

What an effect adds to the rate at the plain wall's temperatures is a source of heat; its response is linear: the
paper's sensitivity system once more, `theta' = A theta + df/dphi`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..effects import Campaign, Terms
from .cells import Cells, at_rows, cells, coefficients, rate, start
from .linear import Modes, modes
from .nonlinear import flow
from .sensors import readings


class Base(NamedTuple):
    """A linear wall's course on equal parts of each interval between rows: what the effects act upon."""

    wall: Cells
    system: Modes
    course: Float[Array, "part mode"]
    step: Array
    faces: Float[Array, "part input"]

    @property
    def temperatures(self) -> Float[Array, "part node"]:
        """At the nodes, degC."""
        return self.course @ self.system.out.T


def first_order(
    base: Base,
    terms: Terms,
    change: Terms,
    campaign: Campaign,
    diffusivity: Array,
    profile: Float[Array, " mode"],
    *,
    substeps: int,
) -> Float[Array, "time sensor"]:
    """The derivative of the readings along a change of the terms, at a linear wall.

    Arguments:
        base: the linear wall's course, on so many substeps.
        terms: its terms with the change at its neutral value, in its place.
        change: the terms' derivative along it.
        substeps: on whose straight lines the source lies between two rows.
    """
    system = base.system
    (here, _), (moved, initial) = jax.jvp(lambda some: _held(some, campaign, profile), (terms,), (change,))
    f = _source(base, moved, terms, change, campaign, diffusivity) @ system.into.T
    lines = jnp.stack([f[:-1], jnp.diff(f, axis=0)], axis=1)
    m = system.run_in_modes(system.into @ initial, lines, base.step)[::substeps]
    # other inputs, and what changes the faces, are cubics that may jump at a row
    drive = jnp.concatenate([here.course[..., 2:], moved.course], axis=-1)
    inputs = jnp.concatenate([system.into @ moved.other, system.inputs], axis=1)
    m = m + system.run(jnp.zeros_like(initial), drive, inputs, campaign.step)
    rates = m * system.poles + f[::substeps] + at_rows(drive, campaign.step)[0] @ inputs.T
    q, _ = at_rows(base.wall.course, campaign.step)
    course = base.course[::substeps]
    warming = course * system.poles + q @ system.inputs.T

    def observed(some: Terms, course: Array, warming: Array) -> Array:
        wall = cells(some, campaign)
        state = wall.state @ system.out
        q, q_rate = at_rows(wall.course, campaign.step)
        value = course @ state.T + q[:, :2] @ wall.face.T
        return readings(some, campaign, value, warming @ state.T + q_rate[:, :2] @ wall.face.T)

    return jax.jvp(observed, (terms, course, warming), (change, m, rates))[1]


def base_course(
    terms: Terms, campaign: Campaign, diffusivity: Array, profile: Float[Array, " mode"], *, substeps: int
) -> Base:
    """The course of a linear wall, for `first_order`."""
    wall, step = cells(terms, campaign), campaign.step / substeps
    system, inputs = modes(wall, diffusivity), _finer(wall.course, substeps)
    course = system.run(system.into @ start(wall, campaign, profile), inputs, system.inputs, step)
    q, _ = at_rows(inputs, step)
    return Base(wall, system, course, step, q.at[:, 2:].set(0.0))


def _held(terms: Terms, campaign: Campaign, profile: Array) -> tuple[Cells, Array]:
    """What does not depend on time, and the state at the first row."""
    wall = cells(terms, campaign)
    return wall, start(wall, campaign, profile)


def _source(
    base: Base, moved: Cells, terms: Terms, change: Terms, campaign: Campaign, diffusivity: Array
) -> Float[Array, "part node"]:
    """What a change of the cells and of their materials makes of the base's temperatures and faces, K/s."""
    T = base.temperatures
    t = jnp.arange(T.shape[0]) * base.step

    def rates(wall: Cells, factor: Array, conductivity: Array, capacity: Array) -> Array:
        matrix = jax.vmap(coefficients, (None, 0, 0))(wall, diffusivity * factor[:, None] * conductivity, capacity)
        return jax.vmap(rate, (None, 0, 0, 0))(wall, matrix, T, base.faces)

    def material(some: Terms) -> tuple[Array, Array, Array]:
        """What depends on time and temperature: of the diffusivity, of conductivity and capacity."""
        field = flow(base.wall, some, campaign, diffusivity)
        return jax.vmap(field.factor)(t), *jax.vmap(field.factors)(T, base.faces)

    # linearised at the base, so that `vmap` over changes shares all but products with the change
    neutral = jnp.ones_like(t), jnp.ones((len(t), base.wall.resistance.shape[0])), jnp.ones_like(T)
    _, along = jax.linearize(rates, base.wall, *neutral)
    return along(moved, *jax.jvp(material, (terms,), (change,))[1])


def _finer(course: Float[Array, "interval power input"], parts: int) -> Float[Array, "part power input"]:
    """The same polynomials on equal parts of each interval: `s = (i + r)/parts`."""
    powers = course.shape[1]
    shift = np.zeros((parts, powers, powers))
    for i in range(parts):
        for j in range(powers):
            for k in range(j + 1):
                shift[i, k, j] = math.comb(j, k) * (i / parts) ** (j - k) / parts**k
    return jnp.einsum("ikj,njq->nikq", jnp.asarray(shift), course).reshape(-1, powers, course.shape[2])
