"""The readings that a campaign would give, with effects in; and their derivatives to first order."""

from __future__ import annotations

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..effects import Campaign, Terms
from .cells import at_rows, cells, start
from .linear import linear_course, modes
from .nonlinear import flow, nonlinear_course
from .sensors import readings


def respond(
    terms: Terms,
    campaign: Campaign,
    diffusivity: Array,
    profile: Float[Array, " mode"],
    *,
    linear: bool,
    substeps: int = 1,
) -> Float[Array, "time sensor"]:
    """The inner sensors' readings with everything in `terms`, degC.

    Arguments:
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
        value, rate = nonlinear_course(wall, terms, campaign, diffusivity, initial, substeps=substeps)
    return readings(terms, campaign, value, rate)


def first_order(
    terms: Terms,
    change: Terms,
    campaign: Campaign,
    diffusivity: Array,
    profile: Float[Array, " mode"],
    *,
    substeps: int,
) -> Float[Array, "time sensor"]:
    """The derivative of the readings along a change that makes the wall nonlinear, at a linear wall.

    What the change adds to the rate at the linear wall's temperatures is a source of heat; its response is
    linear: the paper's sensitivity system once more, `theta' = A theta + df/dphi`.

    Arguments:
        terms: with the change at its neutral value.
        change: the terms' derivative along it.
        substeps: on whose straight lines the source lies between two rows.
    """
    wall = cells(terms, campaign)
    fine = eqx.tree_at(lambda w: w.course, wall, _finer(wall.course, substeps))
    step = campaign.step / substeps
    system = modes(wall, diffusivity)
    initial = system.into @ start(wall, campaign, profile)
    T = system.run(initial, fine.course @ system.inputs.T, step) @ system.out.T
    q, _ = at_rows(fine.course, step)
    t = jnp.arange(T.shape[0]) * step

    def rate(some: Terms, t: Array, T: Array, q: Array) -> Array:
        field = flow(wall, some, campaign, diffusivity)
        return field.rate(field.coefficients(t, T, q), T, q)

    def source(t: Array, T: Array, q: Array) -> Array:
        return jax.jvp(lambda some: rate(some, t, T, q), (terms,), (change,))[1]

    f = jax.vmap(source)(t, T, q) @ system.into.T
    lines = jnp.stack([f[:-1], jnp.diff(f, axis=0)], axis=1)
    m = system.run(jnp.zeros_like(initial), lines, step)
    c = wall.state @ system.out
    value, slope = (m @ c.T)[::substeps], ((m * system.poles + f) @ c.T)[::substeps]
    still = jnp.zeros_like(value)
    return jax.jvp(lambda *course: readings(terms, campaign, *course), (still, still), (value, slope))[1]


def face_response(
    terms: Terms, faces: Float[Array, "interval power face"], campaign: Campaign, diffusivity: Array
) -> Float[Array, "time sensor"]:
    """What the readings of a linear wall make of a change of its faces, K."""
    wall = cells(terms, campaign)
    course = jnp.zeros_like(wall.course).at[:, :, :2].set(faces)
    still = jnp.zeros(wall.capacity.shape)
    driven = linear_course(eqx.tree_at(lambda w: w.course, wall, course), campaign, diffusivity, still)
    rest = tuple(jnp.zeros_like(part) for part in driven)
    return jax.jvp(lambda *course: readings(terms, campaign, *course), rest, driven)[1]


def _finer(course: Float[Array, "interval power input"], parts: int) -> Float[Array, "part power input"]:
    """The same polynomials on equal parts of each interval: `s = (i + r)/parts`."""
    powers = course.shape[1]
    shift = np.zeros((parts, powers, powers))
    for i in range(parts):
        for j in range(powers):
            for k in range(j + 1):
                shift[i, k, j] = math.comb(j, k) * (i / parts) ** (j - k) / parts**k
    return jnp.einsum("ikj,njq->nikq", jnp.asarray(shift), course).reshape(-1, powers, course.shape[2])
