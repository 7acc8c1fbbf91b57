"""What the sensors and their logger make of the temperatures at their places: clock, lag, gain, offset, drift."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._internal.units import DAY
from ...models.exponential_solver import phi_functions
from ..effects.equation_terms import ForcingData, Terms


def readings(
    terms: Terms, campaign: ForcingData, value: Float[Array, "time sensor"], rate: Float[Array, "time sensor"]
) -> Float[Array, "time sensor"]:
    """What the sensors and their logger make of the temperatures at their places, degC."""
    value, rate = _delayed(value, rate, terms.delay, campaign.step)
    value = _lagged(value, rate, terms.lag, campaign.step)
    days = jnp.arange(value.shape[0])[:, None] * (campaign.step / DAY)
    return value + terms.gain * (value - campaign.reference) + terms.offset + terms.rate * days


def _hermite(value: Array, rate: Array, step: Array) -> Float[Array, "interval power sensor"]:
    """Cubics through values and rates at the rows, in powers of s."""
    low, high = value[:-1], value[1:]
    out, into = step * rate[:-1], step * rate[1:]
    return jnp.stack([low, out, 3 * (high - low) - 2 * out - into, 2 * (low - high) + out + into], axis=1)


def _delayed(value: Array, rate: Array, delay: Array, step: Array) -> tuple[Array, Array]:
    """`T(t - delay)` and its rate, from the cubics; beyond the record on straight lines."""
    cubics = _hermite(value, rate, step)
    place = jnp.arange(value.shape[0]) - delay / step
    interval = jnp.clip(jnp.floor(place).astype(int), 0, cubics.shape[0] - 1)
    s = place - interval
    inside = jnp.where(s < 0.0, 0.0, jnp.where(s > 1.0, 1.0, s))  # not `clip`, whose slope is halved at its ends
    c0, c1, c2, c3 = (cubics[interval, j] for j in range(4))
    x = inside[:, None]
    slope = c1 + x * (2 * c2 + x * 3 * c3)
    return c0 + x * (c1 + x * (c2 + x * c3)) + slope * (s - inside)[:, None], slope / step


def _lagged(value: Array, rate: Array, lag: Array, step: Array) -> Array:
    """`lag y' + y = T` with T the cubics, exactly: with `s = lag/h`, `psi_j = int_0^1 e^(-(1-x)/s) x^j dx / s`::

    y_1 = e^(-1/s) y_0 + sum_j psi_j c_j,      psi_0 = 1 - e^(-1/s),      psi_j = 1 - j s psi_{j-1}

    and at lag 0 exactly T. For lags longer than a step from the phi-functions, which lose no digits there.
    """
    cubics = _hermite(value, rate, step)
    s = lag / step
    quick = s < 1.0
    safe = jnp.where(s > 1e-3, s, 1.0)
    keep = jnp.where(s > 1e-3, jnp.exp(-1.0 / safe), 0.0)
    short = [1.0 - keep]
    for j in range(1, 4):
        short.append(1.0 - j * jnp.where(quick, s, 0.0) * short[-1])
    pace = 1.0 / jnp.where(quick, 1.0, s)
    _, *phis = phi_functions(-pace, most=4)
    weights = [
        jnp.where(quick, near, pace * math.factorial(j) * phi)
        for j, (near, phi) in enumerate(zip(short, phis, strict=True))
    ]
    drive = sum((cubics[:, j] * weight for j, weight in enumerate(weights)), jnp.zeros(()))

    def follow(y: Array, driven: Array) -> tuple[Array, Array]:
        y = keep * y + driven
        return y, y

    _, later = jax.lax.scan(follow, value[0], drive)
    return jnp.concatenate([value[:1], later])
