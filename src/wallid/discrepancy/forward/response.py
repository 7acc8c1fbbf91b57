"""The readings of the instruments in a wall with effects, and their response to the faces."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..effects.equation_terms import ForcingData, Terms
from .cells import build_cells, initial_state
from .instrument_readings import apply_instrument_effects
from .linear_wall import simulate_linear_wall
from .time_stepping import simulate_nonlinear_wall


def simulate_readings(
    terms: Terms,
    forcing: ForcingData,
    diffusivity: Array,
    profile: Float[Array, " mode"],
    *,
    linear: bool,
    substeps: int = 1,
) -> Float[Array, "time instrument"]:
    """The readings of the inner sensors, degC, and the plates, W/m2, of a wall with effects.

    Args:
        terms: the terms that effects change.
        forcing: face temperatures, regressors and nodes.
        diffusivity: m2/s; with layers or joints the effective one of the wall.
        profile: amplitudes of the modes of the initial profile, K.
        linear: True for the exact solution in modes; False for integration by diffrax.
        substeps: steps of the integration between two rows.
    """
    wall = build_cells(terms, forcing)
    initial = initial_state(forcing, profile)
    if linear:
        value, rate = simulate_linear_wall(wall, forcing, diffusivity, initial)
    else:
        value, rate = simulate_nonlinear_wall(wall, terms, forcing, diffusivity, initial, substeps=substeps)
    return apply_instrument_effects(terms, forcing, value, rate)


def face_response(
    terms: Terms, faces: Float[Array, "interval power face"], forcing: ForcingData, diffusivity: Array
) -> Float[Array, "time instrument"]:
    """The change of the readings of a linear wall by a change of its face temperatures, K (W/m2 of a plate).

    Args:
        terms: the terms that effects change.
        faces: coefficients of the change of the two face temperatures, K.
        forcing: with the step and the nodes.
        diffusivity: m2/s.
    """
    wall = build_cells(terms, forcing)
    inputs = jnp.zeros_like(wall.inputs).at[:, :, :2].set(faces)
    zeros = jnp.zeros(wall.capacity.shape)
    response = simulate_linear_wall(eqx.tree_at(lambda w: w.inputs, wall, inputs), forcing, diffusivity, zeros)
    zero = tuple(jnp.zeros_like(part) for part in response)
    return jax.jvp(lambda *temperatures: apply_instrument_effects(terms, forcing, *temperatures), zero, response)[1]
