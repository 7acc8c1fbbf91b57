"""The finite-volume cells of a wall with effects: resistances, capacities, inputs and weights of the readings."""

from __future__ import annotations

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...models.finite_volume_wall import lagrange_weights
from ..effects.equation_terms import ForcingData, Step, Terms
from ..effects.heat_sources import SOURCE_WIDTH

_STENCIL = 4  # nodes from which a reading is interpolated


class Cells(eqx.Module):
    """The cells of a wall, with the terms that are constant in time.

    The state x holds the temperatures of the inner nodes. The inputs q are the two face readings, outdoor and indoor
    air temperature, and the signals of the heat sources. With the tridiagonal matrix A of conduction, advection and
    loss, and readings y::

        dx/dt = A x + B_faces q_faces + heat_input_matrix q_other
        y     = state_to_readings x + faces_to_readings q_faces

    Args:
        positions: of all nodes, faces included, m.
        resistance: between nodes, surface films included, times the effective conductivity of the wall, m.
        capacity: of the inner nodes over the effective volumetric capacity of the wall, m.
        advection: velocity over the distance between the neighbours of a node, 1/s.
        loss: sum of the loss coefficients, 1/s.
        heat_input_matrix: rate of the nodes per unit of the inputs after the faces, 1/s or K/s.
        state_to_readings: weights of the inner nodes for each reading: of the temperature at an inner sensor, and of
            the heat flux over the effective conductivity at a plate, K/m, positive along +x.
        faces_to_readings: weights of the two face readings for each reading.
        inputs: coefficients of all inputs between rows.
    """

    positions: Float[Array, " all"]
    resistance: Float[Array, " cell"]
    capacity: Float[Array, " node"]
    advection: Float[Array, " node"]
    loss: Float[Array, ""]
    heat_input_matrix: Float[Array, "node channel"]
    state_to_readings: Float[Array, "instrument node"]
    faces_to_readings: Float[Array, "instrument face"]
    inputs: Float[Array, "interval power input"]


def build_cells(terms: Terms, forcing: ForcingData) -> Cells:
    """The cells of a wall with effects: resistances and capacities integrated over each cell, inputs and readings.

    Resistances and capacities are scaled so that the diffusivity is the effective one of the wall,
    `alpha = L^2 / (R C)`, for any layers and joints.

    Args:
        terms: the terms that effects change.
        forcing: face temperatures, regressors and nodes.
    """
    length = forcing.length - jnp.sum(terms.depth)
    scale = length / forcing.length
    positions = terms.depth[0] + scale * forcing.node_positions
    midpoints = 0.5 * (positions[1:] + positions[:-1])
    resistance = scale * forcing.resistance
    for layer in terms.conductivity_steps:
        resistance = resistance * _cell_means_of_step(positions, Step(-layer.size, layer.position))
    for joint in terms.joints:
        resistance = resistance + joint.size * _joint_weights(midpoints, joint.position)
    capacity = scale * forcing.capacity
    bounds = jnp.concatenate([positions[:1], midpoints, positions[-1:]])
    for layer in terms.capacity_steps:
        capacity = capacity * _cell_means_of_step(bounds, layer)
    factor = length / jnp.sum(resistance)
    # the length of a film is that of the material, as the thickness of a joint
    resistance, film = factor * resistance, factor * terms.film_lengths
    capacity = capacity * (length / jnp.sum(capacity))

    # behind a film T_face = (1 - w) T_read + w T_first; the half cell of the face is added to the node next to it
    weight = film / (film + resistance[jnp.array([0, -1])])
    ends = jnp.array([0, -1])
    inner = capacity[1:-1].at[ends].add(weight * capacity[ends])
    rows = _reading_weights(positions, resistance, forcing.layer_nodes, forcing.sensor_positions + terms.position)
    state = rows[:, 1:-1].at[:, ends].add(weight * rows[:, ends])
    face = (1.0 - weight) * rows[:, ends]
    if forcing.plates:
        # of the material between each face's sensor and the surface, on which the plate is
        buried = terms.depth * resistance[ends] / jnp.diff(positions)[ends]
        fluxes = _flux_weights(resistance, film, buried)[jnp.array(forcing.plates, dtype=int)]
        state, face = jnp.concatenate([state, fluxes[:, 1:-1]]), jnp.concatenate([face, fluxes[:, ends]])

    sources = [_source_profile(source.position, positions, forcing.length) * source.rate for source in terms.sources]
    rates = jnp.stack([jnp.broadcast_to(s, inner.shape) for s in (terms.loss[0], terms.loss[1], *sources)], axis=1)
    air = jnp.stack([forcing.outdoor, forcing.indoor], axis=-1)
    signals = [terms.faces, air, *(source.signal[..., None] for source in terms.sources)]
    return Cells(
        positions=positions,
        resistance=resistance.at[ends].add(film),
        capacity=inner,
        advection=terms.velocity / (positions[2:] - positions[:-2]),
        loss=jnp.sum(terms.loss),
        heat_input_matrix=rates,
        state_to_readings=state,
        faces_to_readings=face,
        inputs=jnp.concatenate(signals, axis=-1),
    )


def _cell_means_of_step(edges: Array, step: Step) -> Array:
    """Mean over each cell of a factor that is `e^(-size/2)` left of a position and `e^(size/2)` right of it."""
    right = jnp.clip((edges[1:] - step.position) / jnp.diff(edges), 0.0, 1.0)
    return (1.0 - right) * jnp.exp(-0.5 * step.size) + right * jnp.exp(0.5 * step.size)


def _joint_weights(points: Array, position: Array) -> Array:
    """Weights of points, with sum 1 and centre at a position."""
    gaps = jnp.diff(points)
    rising = jnp.concatenate([jnp.ones(1), 1.0 - (points[1:] - position) / gaps])
    falling = jnp.concatenate([1.0 - (position - points[:-1]) / gaps, jnp.ones(1)])
    return jnp.clip(jnp.minimum(rising, falling), 0.0, 1.0)


def _source_profile(position: Array | None, positions: Array, length: Array) -> Array:
    if position is None:
        return jnp.ones(positions.shape[0] - 2)
    return jnp.exp(-0.5 * ((positions[1:-1] - position) / (SOURCE_WIDTH * length)) ** 2)


def _reading_weights(
    positions: Array, resistance: Array, layer_nodes: Array, position: Array
) -> Float[Array, "sensor all"]:
    """Weights of all nodes for each reading: cubic in the cumulative resistance, in which joints cause no kink.

    The nodes of a reading are in one layer of the stated wall, because the curvature jumps between layers.
    """
    cumulative = jnp.concatenate([jnp.zeros(1), jnp.cumsum(resistance)])
    layers = layer_nodes.shape[0] - 1
    layer = jnp.clip(jnp.searchsorted(positions[layer_nodes], position) - 1, 0, layers - 1)
    first = jnp.searchsorted(positions, position) - _STENCIL // 2
    first = jnp.clip(first, layer_nodes[layer], layer_nodes[layer + 1] + 1 - _STENCIL)
    stencil = first[:, None] + jnp.arange(_STENCIL)
    nodes = cumulative[stencil]
    at_sensor = jnp.interp(position, positions, cumulative)
    # the factor of weight i for every other node j, and 1 for i itself
    itself = np.eye(_STENCIL, dtype=bool)
    distances = jnp.where(itself, 1.0, nodes[:, :, None] - nodes[:, None, :])
    factors = jnp.where(itself, 1.0, (at_sensor[:, None] - nodes)[:, None, :] / distances)
    weights = math.prod(factors[:, :, j] for j in range(_STENCIL))
    rows = jnp.zeros((position.shape[0], positions.shape[0]))
    return rows.at[jnp.arange(position.shape[0])[:, None], stencil].set(weights)


def _flux_weights(
    resistance: Float[Array, " cell"], film: Float[Array, " face"], buried: Float[Array, " face"]
) -> Float[Array, "face all"]:
    """Weights of the face readings and the inner nodes for the flux at each surface, over the conductivity, along +x.

    With the slope `D = s_0 T_face + sum_i s_i T_i` of the cubic in the cumulative resistance, and `T_face = T_read +
    film D` behind a film, `D = (s_0 T_read + sum_i s_i T_i) / (1 - s_0 film)`. Before a face's sensor that is inside
    the wall the cubic is continued.

    Args:
        resistance: of the cells. film: of each face. buried: between each surface and the face's sensor; all in m.
    """
    cumulative = jnp.concatenate([jnp.zeros(1), jnp.cumsum(resistance)])
    from_right = cumulative[-1] - cumulative[::-1]
    pairs = zip((cumulative, from_right), buried, strict=True)
    slopes = jnp.stack([lagrange_weights(one[:_STENCIL], -before, 1) for one, before in pairs])
    slopes = slopes / (1.0 - slopes[:, :1] * film[:, None])
    left, right = jnp.pad(slopes, ((0, 0), (0, cumulative.shape[0] - _STENCIL)))
    return jnp.stack([-left, right[::-1]])


def initial_state(forcing: ForcingData, profile: Float[Array, " mode"]) -> Float[Array, " inner"]:
    """The state at the first row, degC: the polynomial through the first readings plus the slowest modes of the wall.

    Args:
        forcing: with the polynomial and the modes at the inner nodes.
        profile: amplitudes of the modes, K.
    """
    return forcing.initial + forcing.profile_modes @ profile


def rate_coefficients(
    wall: Cells, diffusivity: Array, capacity_factor: Array | float = 1.0
) -> tuple[Array, Array, Array]:
    """`lower, diagonal, upper` of the tridiagonal matrix A, 1/s; the first of `lower` and the last of `upper` multiply
    the face temperatures.

    Args:
        wall: the cells.
        diffusivity: m2/s, of the wall or of each cell.
        capacity_factor: capacity of each node over its value in `wall`.
    """
    conductance, capacity = diffusivity / wall.resistance, wall.capacity * capacity_factor
    lower = conductance[:-1] / capacity + wall.advection
    upper = conductance[1:] / capacity - wall.advection
    return lower, -(conductance[:-1] + conductance[1:]) / capacity - wall.loss, upper


def temperature_rate(wall: Cells, matrix: tuple[Array, Array, Array], T: Array, q: Array) -> Array:
    """`dT/dt` at the inner nodes, K/s, with the matrix from `rate_coefficients`, temperatures T and inputs q."""
    lower, diagonal, upper = matrix
    all_nodes = jnp.concatenate([q[:1], T, q[1:2]])
    return lower * all_nodes[:-2] + diagonal * T + upper * all_nodes[2:] + wall.heat_input_matrix @ q[2:]


def inputs_at_rows(inputs: Float[Array, "interval power input"], step: Array) -> tuple[Array, Array]:
    """Values and time derivatives (per s) of the inputs at each row."""
    powers = jnp.arange(inputs.shape[1])[:, None]
    value = jnp.concatenate([inputs[:, 0], jnp.sum(inputs[-1:], axis=1)])
    rate = jnp.concatenate([inputs[:, 1], jnp.sum(powers * inputs[-1:], axis=1)]) / step
    return value, rate
