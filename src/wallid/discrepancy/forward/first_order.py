"""The derivative of the readings by any effect, from one linear solution.

The change of the rate by an effect of size phi, at the temperatures of the linear wall, acts as a heat source. The
derivative theta of the temperatures solves the sensitivity system `theta' = A theta + df/dphi`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..effects.equation_terms import ForcingData, Terms
from .cells import Cells, build_cells, initial_state, inputs_at_rows
from .instrument_readings import apply_instrument_effects
from .linear_wall import Modes, modal_decomposition
from .nonlinear_wall import build_nonlinear_wall


class BaseSolution(NamedTuple):
    """The solution of a linear wall at equal parts of each interval between rows.

    Args:
        wall: the cells.
        system: the modes of the wall.
        modes: modal coordinates.
        step: duration of a part, s.
        temperatures: at all nodes, faces included, degC.
        flux: between the nodes over the volumetric heat capacity of the wall, K m/s.
        conduction_rate: rate of the nodes by conduction, K/s.
    """

    wall: Cells
    system: Modes
    modes: Float[Array, "part mode"]
    step: Array
    temperatures: Float[Array, "part all"]
    flux: Float[Array, "part cell"]
    conduction_rate: Float[Array, "part node"]


def first_order_response(
    base: BaseSolution,
    terms: Terms,
    change: Terms,
    forcing: ForcingData,
    diffusivity: Array,
    *,
    substeps: int,
) -> Float[Array, "time instrument"]:
    """The derivative of the readings of a linear wall by a change of its terms, K (W/m2 of a plate) per unit.

    Args:
        base: the solution of the linear wall.
        terms: its terms, with the effect at its neutral value.
        change: the derivative of the terms.
        forcing: face temperatures, regressors and nodes.
        diffusivity: m2/s.
        substeps: parts of each interval of `base`, between which the heat source is linear.
    """
    system = base.system
    cells, cells_change = jax.jvp(lambda some: build_cells(some, forcing), (terms,), (change,))

    def response_to_source() -> tuple[Array, Array]:
        """The response of the modes to the source inside the wall, and the source, at each row."""
        f = _source(base, cells_change, terms, change, forcing, diffusivity) @ system.to_modes.T
        return system.integrate_piecewise_linear(f, base.step, parts=substeps), f[::substeps]

    zeros = jnp.zeros((forcing.intervals + 1, system.poles.shape[0]))
    m, f = jax.lax.cond(_acts_inside(cells_change, change), response_to_source, lambda: (zeros, zeros))
    # the other inputs and the changes of the faces are cubics that may jump at a row
    inputs = jnp.concatenate([cells.inputs[..., 2:], cells_change.inputs], axis=-1)
    input_matrix = jnp.concatenate([system.to_modes @ cells_change.heat_input_matrix, system.input_matrix], axis=1)
    m = m + system.integrate(jnp.zeros_like(system.poles), inputs, input_matrix, forcing.step)
    rates = m * system.poles + f + inputs_at_rows(inputs, forcing.step)[0] @ input_matrix.T
    q, _ = inputs_at_rows(base.wall.inputs, forcing.step)
    modes = base.modes[::substeps]
    modes_rate = modes * system.poles + q @ system.input_matrix.T

    def observed(some: Terms, wall: Cells, modes: Array, modes_rate: Array) -> Array:
        weights = wall.state_to_readings @ system.to_nodes
        q, q_rate = inputs_at_rows(wall.inputs, forcing.step)
        value = modes @ weights.T + q[:, :2] @ wall.faces_to_readings.T
        return apply_instrument_effects(
            some, forcing, value, modes_rate @ weights.T + q_rate[:, :2] @ wall.faces_to_readings.T
        )

    return jax.jvp(observed, (terms, cells, modes, modes_rate), (change, cells_change, m, rates))[1]


def solve_base(
    terms: Terms, forcing: ForcingData, diffusivity: Array, profile: Float[Array, " mode"], *, substeps: int
) -> BaseSolution:
    """The solution of a linear wall, for `first_order_response`.

    Args:
        terms: the terms that effects change.
        forcing: face temperatures, regressors and nodes.
        diffusivity: m2/s.
        profile: amplitudes of the modes of the initial profile, K.
        substeps: parts of each interval between rows.
    """
    wall, step = build_cells(terms, forcing), forcing.step / substeps
    system, inputs = modal_decomposition(wall, diffusivity), _refine(wall.inputs, substeps)
    modes = system.integrate(system.to_modes @ initial_state(forcing, profile), inputs, system.input_matrix, step)
    q, _ = inputs_at_rows(inputs, step)
    T = jnp.concatenate([q[:, :1], modes @ system.to_nodes.T, q[:, 1:2]], axis=1)
    flux = diffusivity * jnp.diff(T, axis=1) / wall.resistance
    return BaseSolution(wall, system, modes, step, T, flux, jnp.diff(flux, axis=1) / wall.capacity)


def _acts_inside(cells_change: Cells, change: Terms) -> Array:
    """Whether a change affects the rate of the nodes, and not only faces, inputs or readings."""
    cells = cells_change.resistance, cells_change.capacity, cells_change.advection, cells_change.loss
    return _any_nonzero((cells, change.drift, change.wettings, _temperature_terms(change)))


def _temperature_terms(change: Terms) -> tuple[Any, ...]:
    return change.conductivity_slope, change.capacity_slope, change.latent


def _any_nonzero(tree: Any) -> Array:
    return jnp.any(jnp.stack([jnp.any(leaf != 0.0) for leaf in jax.tree.leaves(tree)]))


def _source(
    base: BaseSolution, cells_change: Cells, terms: Terms, change: Terms, forcing: ForcingData, diffusivity: Array
) -> Float[Array, "part node"]:
    """The change of the rate of the nodes at the temperatures of the base, K/s::

        f = d(F (s' + kappa' - R'/R)) / C - (dF/C) (gamma' + C'/C) - v' dT - s_a' T

    with the flux F of the base, cell resistances R and capacities C, the differences d between neighbours, and the
    changes (primes) of the diffusivity factor s, conductivity kappa, capacity gamma, R, C, air velocity v and loss s_a.
    """
    wall, T = base.wall, base.temperatures

    def diffusivity_factors(some: Terms) -> Array:
        nonlinear = build_nonlinear_wall(wall, some, forcing, diffusivity)
        return jax.vmap(nonlinear.diffusivity_factor)(jnp.arange(T.shape[0]) * base.step)

    def material_factors(some: Terms) -> tuple[Array, Array]:
        return jax.vmap(build_nonlinear_wall(wall, some, forcing, diffusivity).material_factors)(
            T[:, 1:-1], T[:, jnp.array([0, -1])]
        )

    conductance = (
        jax.jvp(diffusivity_factors, (terms,), (change,))[1][:, None] - cells_change.resistance / wall.resistance
    )
    capacity = cells_change.capacity / wall.capacity

    def conduction_change(conductance: Array, capacity: Array) -> Array:
        return jnp.diff(base.flux * conductance, axis=1) / wall.capacity - base.conduction_rate * capacity

    def temperature_dependent() -> Array:
        conductivity, heat_capacity = jax.jvp(material_factors, (terms,), (change,))[1]
        return conduction_change(conductance + conductivity, capacity + heat_capacity)

    depends = _any_nonzero(_temperature_terms(change))
    conduction = jax.lax.cond(depends, temperature_dependent, lambda: conduction_change(conductance, capacity))
    return conduction - cells_change.advection * (T[:, 2:] - T[:, :-2]) - cells_change.loss * T[:, 1:-1]


def _refine(inputs: Float[Array, "interval power input"], parts: int) -> Float[Array, "part power input"]:
    """The coefficients of the same polynomials on equal parts of each interval, with `s = (i + r)/parts`."""
    powers = inputs.shape[1]
    shift = np.zeros((parts, powers, powers))
    for i in range(parts):
        for j in range(powers):
            for k in range(j + 1):
                shift[i, k, j] = math.comb(j, k) * (i / parts) ** (j - k) / parts**k
    return jnp.einsum("ikj,njq->nikq", jnp.asarray(shift), inputs).reshape(-1, powers, inputs.shape[2])
