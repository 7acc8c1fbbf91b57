"""The derivative of the readings along any effect, by one linear solve.

What an effect adds to the rate at the plain wall's temperatures is a source of heat; its response is linear: the
paper's sensitivity system once more, `theta' = A theta + df/dphi`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..effects.equation_terms import ForcingData, Terms
from .cells import Cells, at_rows, cells, start
from .linear_wall import Modes, modes
from .nonlinear_wall import flow
from .sensor_readings import readings


class Base(NamedTuple):
    """A linear wall's course on equal parts of each interval between rows: what the effects act upon.

    Args:
        course: in modes. step: of a part, s.
        temperatures: at all nodes, faces included, degC.
        flux: between them, over the capacity of a metre of the wall, K m/s. conducted: what it makes of the nodes, K/s.
    """

    wall: Cells
    system: Modes
    course: Float[Array, "part mode"]
    step: Array
    temperatures: Float[Array, "part all"]
    flux: Float[Array, "part cell"]
    conducted: Float[Array, "part node"]


def first_order(
    base: Base,
    terms: Terms,
    change: Terms,
    campaign: ForcingData,
    diffusivity: Array,
    profile: Float[Array, " mode"],
    *,
    substeps: int,
) -> Float[Array, "time sensor"]:
    """The derivative of the readings along a change of the terms, at a linear wall.

    Args:
        base: the linear wall's course, on so many substeps.
        terms: its terms with the change at its neutral value, in its place.
        change: the terms' derivative along it.
        substeps: on whose straight lines the source lies between two rows.
    """
    system = base.system
    (here, _), (moved, initial) = jax.jvp(lambda some: _held(some, campaign, profile), (terms,), (change,))

    def heated() -> tuple[Array, Array]:
        """What a source inside the wall makes of the modes, and the source, at each row."""
        f = _source(base, moved, terms, change, campaign, diffusivity) @ system.into.T
        return system.run_on_lines(f, base.step, parts=substeps), f[::substeps]

    still = jnp.zeros((campaign.intervals + 1, system.poles.shape[0]))
    m, f = jax.lax.cond(_acts_inside(moved, change), heated, lambda: (still, still))
    # other inputs, and what changes the faces, are cubics that may jump at a row
    drive = jnp.concatenate([here.course[..., 2:], moved.course], axis=-1)
    inputs = jnp.concatenate([system.into @ moved.other, system.inputs], axis=1)
    m = m + system.run(system.into @ initial, drive, inputs, campaign.step)
    rates = m * system.poles + f + at_rows(drive, campaign.step)[0] @ inputs.T
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
    terms: Terms, campaign: ForcingData, diffusivity: Array, profile: Float[Array, " mode"], *, substeps: int
) -> Base:
    """The course of a linear wall, for `first_order`."""
    wall, step = cells(terms, campaign), campaign.step / substeps
    system, inputs = modes(wall, diffusivity), _finer(wall.course, substeps)
    course = system.run(system.into @ start(wall, campaign, profile), inputs, system.inputs, step)
    q, _ = at_rows(inputs, step)
    T = jnp.concatenate([q[:, :1], course @ system.out.T, q[:, 1:2]], axis=1)
    flux = diffusivity * jnp.diff(T, axis=1) / wall.resistance
    return Base(wall, system, course, step, T, flux, jnp.diff(flux, axis=1) / wall.capacity)


def _held(terms: Terms, campaign: ForcingData, profile: Array) -> tuple[Cells, Array]:
    """What does not depend on time, and the state at the first row."""
    wall = cells(terms, campaign)
    return wall, start(wall, campaign, profile)


def _acts_inside(moved: Cells, change: Terms) -> Array:
    """Whether a change reaches the wall's own rate, and not its faces, inputs or readings alone."""
    moving = moved.resistance, moved.capacity, moved.advection, moved.loss, change.drift, change.wettings
    return _any((moving, _of_temperature(change)))


def _of_temperature(change: Terms) -> tuple[Any, ...]:
    return change.conductivity_slope, change.capacity_slope, change.latent


def _any(tree: Any) -> Array:
    return jnp.any(jnp.stack([jnp.any(leaf != 0.0) for leaf in jax.tree.leaves(tree)]))


def _source(
    base: Base, moved: Cells, terms: Terms, change: Terms, campaign: ForcingData, diffusivity: Array
) -> Float[Array, "part node"]:
    """What a change of the cells and of their materials makes of the base's temperatures and faces, K/s::

        f = d(F (s + kappa - R/R_0)) / C - F_C (gamma + C'/C) - v' dT - s_a' T

    with F the base's flux, F_C = dF/C what it makes of the nodes, and the changes of the diffusivity's factor s, of
    conductivity kappa, resistance R, capacity gamma by temperature and C of a node, air flow v' and loss s_a'.
    """
    wall, T = base.wall, base.temperatures

    def factor(some: Terms) -> Array:
        field = flow(wall, some, campaign, diffusivity)
        return jax.vmap(field.factor)(jnp.arange(T.shape[0]) * base.step)

    def material(some: Terms) -> tuple[Array, Array]:
        return jax.vmap(flow(wall, some, campaign, diffusivity).factors)(T[:, 1:-1], T[:, jnp.array([0, -1])])

    conductance = jax.jvp(factor, (terms,), (change,))[1][:, None] - moved.resistance / wall.resistance
    capacity = moved.capacity / wall.capacity

    def conducted(conductance: Array, capacity: Array) -> Array:
        return jnp.diff(base.flux * conductance, axis=1) / wall.capacity - base.conducted * capacity

    def by_temperature() -> Array:
        more, heavier = jax.jvp(material, (terms,), (change,))[1]
        return conducted(conductance + more, capacity + heavier)

    moving = _any(_of_temperature(change))
    conduction = jax.lax.cond(moving, by_temperature, lambda: conducted(conductance, capacity))
    return conduction - moved.advection * (T[:, 2:] - T[:, :-2]) - moved.loss * T[:, 1:-1]


def _finer(course: Float[Array, "interval power input"], parts: int) -> Float[Array, "part power input"]:
    """The same polynomials on equal parts of each interval: `s = (i + r)/parts`."""
    powers = course.shape[1]
    shift = np.zeros((parts, powers, powers))
    for i in range(parts):
        for j in range(powers):
            for k in range(j + 1):
                shift[i, k, j] = math.comb(j, k) * (i / parts) ** (j - k) / parts**k
    return jnp.einsum("ikj,njq->nikq", jnp.asarray(shift), course).reshape(-1, powers, course.shape[2])
