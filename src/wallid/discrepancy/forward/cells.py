"""The wall's cells with effects in: resistances, capacities, faces, readings and inputs.

What does not change in time, shared by the exact and the stepped solution.
"""

from __future__ import annotations

import math

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..effects.equation_terms import ForcingData, Step, Terms
from ..effects.heat_sources import SOURCE_WIDTH

_STENCIL = 4  # nodes of a reading


class Cells(eqx.Module):
    """The wall's cells with the terms that do not change in time.

    The state are the inner nodes. `q` are the inputs: the two face readings, outdoor and indoor air, then
    the sources.

    Args:
        places: of all nodes, m.
        resistance: between nodes, films included, m of the wall's effective material.
        capacity: of the inner nodes, m of it.
        advection: velocity over the distance of a node's neighbours, 1/s.
        loss: 1/s.
        other: the inputs after the faces, at the nodes, per second.
        state: readings from the state. face: readings from the two face readings.
        course: coefficients of all inputs between rows.
    """

    places: Float[Array, " all"]
    resistance: Float[Array, " cell"]
    capacity: Float[Array, " node"]
    advection: Float[Array, " node"]
    loss: Float[Array, ""]
    other: Float[Array, "node channel"]
    state: Float[Array, "sensor node"]
    face: Float[Array, "sensor face"]
    course: Float[Array, "interval power input"]


def cells(terms: Terms, campaign: ForcingData) -> Cells:
    """The wall's cells: resistances and capacities integrated over each, faces, readings and inputs.

    Resistances and capacities are scaled so that the wall's effective diffusivity `L^2 / (R C)` stays the
    one parameter whatever the layers and joints.
    """
    length = campaign.length - jnp.sum(terms.depth)
    shrink = length / campaign.length
    places = terms.depth[0] + shrink * campaign.places
    middles = 0.5 * (places[1:] + places[:-1])
    resistance = shrink * campaign.resistance
    for layer in terms.conductivity_steps:
        resistance = resistance * _stepped(places, Step(-layer.size, layer.place))
    for joint in terms.joints:
        resistance = resistance + joint.size * _hats(middles, joint.place)
    capacity = shrink * campaign.capacity
    bounds = jnp.concatenate([places[:1], middles, places[-1:]])
    for layer in terms.capacity_steps:
        capacity = capacity * _stepped(bounds, layer)
    whole = length / jnp.sum(resistance)
    resistance, film = whole * resistance, whole * terms.film  # a film's length is of the material itself, as a joint's
    capacity = capacity * (length / jnp.sum(capacity))

    # T_face = (1 - w) T_read + w T_first behind a film; the face's own half cell goes to the node next to it
    behind = film / (film + resistance[jnp.array([0, -1])])
    ends = jnp.array([0, -1])
    inner = capacity[1:-1].at[ends].add(behind * capacity[ends])
    readings = _readings(places, resistance, campaign.position + terms.position)
    state = readings[:, 1:-1].at[:, ends].add(behind * readings[:, ends])
    face = (1.0 - behind) * readings[:, ends]

    sources = [_profile(source.place, places, campaign.length) * source.rate for source in terms.sources]
    other = jnp.stack([jnp.broadcast_to(s, inner.shape) for s in (terms.loss[0], terms.loss[1], *sources)], axis=1)
    air = jnp.stack([campaign.outdoor, campaign.indoor], axis=-1)
    courses = [terms.faces, air, *(source.course[..., None] for source in terms.sources)]
    return Cells(
        places=places,
        resistance=resistance.at[ends].add(film),
        capacity=inner,
        advection=terms.velocity / (places[2:] - places[:-2]),
        loss=jnp.sum(terms.loss),
        other=other,
        state=state,
        face=face,
        course=jnp.concatenate(courses, axis=-1),
    )


def _stepped(edges: Array, step: Step) -> Array:
    """The mean over each cell of a factor `e^(-size/2)` left of a place and `e^(size/2)` right of it."""
    right = jnp.clip((edges[1:] - step.place) / jnp.diff(edges), 0.0, 1.0)
    return (1.0 - right) * jnp.exp(-0.5 * step.size) + right * jnp.exp(0.5 * step.size)


def _hats(points: Array, place: Array) -> Array:
    """Weights of points, with sum 1, whose centre is the place."""
    gaps = jnp.diff(points)
    rising = jnp.concatenate([jnp.ones(1), 1.0 - (points[1:] - place) / gaps])
    falling = jnp.concatenate([1.0 - (place - points[:-1]) / gaps, jnp.ones(1)])
    return jnp.clip(jnp.minimum(rising, falling), 0.0, 1.0)


def _profile(place: Array | None, places: Array, length: Array) -> Array:
    if place is None:
        return jnp.ones(places.shape[0] - 2)
    return jnp.exp(-0.5 * ((places[1:-1] - place) / (SOURCE_WIDTH * length)) ** 2)


def _readings(places: Array, resistance: Array, position: Array) -> Float[Array, "sensor all"]:
    """Weights of all nodes for each reading: cubic in the resistance passed, in which no joint makes a kink."""
    passed = jnp.concatenate([jnp.zeros(1), jnp.cumsum(resistance)])
    first = jnp.clip(jnp.searchsorted(places, position) - _STENCIL // 2, 0, places.shape[0] - _STENCIL)
    stencil = first[:, None] + jnp.arange(_STENCIL)
    nodes = passed[stencil]
    here = jnp.interp(position, places, passed)[:, None]
    weights = [
        math.prod((here[:, 0] - nodes[:, j]) / (nodes[:, i] - nodes[:, j]) for j in range(_STENCIL) if j != i)
        for i in range(_STENCIL)
    ]
    rows = jnp.zeros((position.shape[0], places.shape[0]))
    return rows.at[jnp.arange(position.shape[0])[:, None], stencil].set(jnp.stack(weights, axis=1))


def start(wall: Cells, campaign: ForcingData, profile: Float[Array, " mode"]) -> Float[Array, " node"]:
    """The state at the first row: a straight line between the faces and sine modes, degC."""
    ends = wall.places[jnp.array([0, -1])]
    xi = (wall.places[1:-1] - ends[0]) / (ends[1] - ends[0])
    modes = jnp.sin(jnp.pi * xi[:, None] * jnp.arange(1, profile.shape[0] + 1))
    line = campaign.start_profile
    return line[0] + (line[1] - line[0]) * xi + modes @ profile


def coefficients(wall: Cells, diffusivity: Array, capacity_factor: Array | float = 1.0) -> tuple[Array, Array, Array]:
    """`lower, diagonal, upper` of the wall's rate, over all inner nodes; the ends belong to the faces.

    Args:
        diffusivity: m2/s, of the wall or of each cell.
        capacity_factor: capacity of each node over the wall's own.
    """
    conductance, capacity = diffusivity / wall.resistance, wall.capacity * capacity_factor
    lower = conductance[:-1] / capacity + wall.advection
    upper = conductance[1:] / capacity - wall.advection
    return lower, -(conductance[:-1] + conductance[1:]) / capacity - wall.loss, upper


def rate(wall: Cells, matrix: tuple[Array, Array, Array], T: Array, q: Array) -> Array:
    """`dT/dt` at the inner nodes with these coefficients, K/s."""
    lower, diagonal, upper = matrix
    everywhere = jnp.concatenate([q[:1], T, q[1:2]])
    return lower * everywhere[:-2] + diagonal * T + upper * everywhere[2:] + wall.other @ q[2:]


def at_rows(course: Float[Array, "interval power input"], step: Array) -> tuple[Array, Array]:
    """Value and rate (per s) of the inputs at each row."""
    powers = jnp.arange(course.shape[1])[:, None]
    value = jnp.concatenate([course[:, 0], jnp.sum(course[-1:], axis=1)])
    rate = jnp.concatenate([course[:, 1], jnp.sum(powers * course[-1:], axis=1)]) / step
    return value, rate
