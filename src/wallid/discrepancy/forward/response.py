"""The readings that a campaign would give, with effects in; and their response to a face."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..effects.equation_terms import ForcingData, Terms
from .cells import cells, start
from .linear_wall import linear_course
from .sensor_readings import readings
from .time_stepping import stepped_course


def respond(
    terms: Terms,
    campaign: ForcingData,
    diffusivity: Array,
    profile: Float[Array, " mode"],
    *,
    linear: bool,
    substeps: int = 1,
) -> Float[Array, "time sensor"]:
    """The inner sensors' readings with everything in `terms`, degC.

    Args:
        diffusivity: m2/s; with layers or joints the wall's effective one.
        profile: amplitudes of the sine modes of the initial profile, K.
        linear: solve exactly in modes; False goes through diffrax.
        substeps: of the latter, between two rows.
    """
    wall = cells(terms, campaign)
    initial = start(wall, campaign, profile)
    if linear:
        value, rate = linear_course(wall, campaign, diffusivity, initial)
    else:
        value, rate = stepped_course(wall, terms, campaign, diffusivity, initial, substeps=substeps)
    return readings(terms, campaign, value, rate)


def face_response(
    terms: Terms, faces: Float[Array, "interval power face"], campaign: ForcingData, diffusivity: Array
) -> Float[Array, "time sensor"]:
    """What the readings of a linear wall make of a change of its faces, K."""
    wall = cells(terms, campaign)
    course = jnp.zeros_like(wall.course).at[:, :, :2].set(faces)
    still = jnp.zeros(wall.capacity.shape)
    driven = linear_course(eqx.tree_at(lambda w: w.course, wall, course), campaign, diffusivity, still)
    rest = tuple(jnp.zeros_like(part) for part in driven)
    return jax.jvp(lambda *course: readings(terms, campaign, *course), rest, driven)[1]
