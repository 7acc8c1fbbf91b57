"""The rate of a wall whose coefficients depend on temperature or time."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..._internal.units import DAY
from ..effects.equation_terms import ForcingData, Terms, Wetting
from .cells import Cells, coefficients, rate
from .heat_content import LEAST_FACTOR, Heat

_ONSET = 1800.0  # s, in which a wetting sets in


class NonlinearWall(eqx.Module):
    """The rate of a wall whose coefficients depend on temperature or time, as a diffrax vector field."""

    wall: Cells
    diffusivity: Array
    step: Array
    conductivity_slope: Array
    heat: Heat
    drift: Array
    wettings: tuple[Wetting, ...]

    def inputs(self, t: Array) -> tuple[Array, Array]:
        """Inputs and their rates (per s) at a time."""
        course = self.wall.course
        interval = jnp.clip((t / self.step).astype(int), 0, course.shape[0] - 1)
        s = t / self.step - interval
        value = slope = jnp.zeros(course.shape[2])
        for here in course[interval][::-1]:  # Horner
            value, slope = value * s + here, slope * s + value
        return value, slope / self.step

    def factor(self, t: Array) -> Array:
        """`s(t)`, by which the diffusivity differs from that of the first row."""
        factor = 1.0 + self.drift * t / DAY
        for event in self.wettings:
            since = t - event.time
            onset = jnp.clip(0.5 + since / _ONSET, 0.0, 1.0)  # not at once, so that its time can be searched for
            decay = jnp.exp(-jnp.maximum(since, 0.0) / event.time_constant)
            factor = factor * (1.0 + event.jump * onset * decay)
        return jnp.maximum(factor, LEAST_FACTOR)

    def factors(self, T: Array, q: Array) -> tuple[Array, Array]:
        """By which each cell's conductivity and each node's capacity differ at these temperatures."""
        everywhere = jnp.concatenate([q[:1], T, q[1:2]])
        middle = 0.5 * (everywhere[1:] + everywhere[:-1]) - self.heat.reference
        conductivity = 1.0 + self.conductivity_slope * middle
        return jnp.maximum(conductivity, LEAST_FACTOR), self.heat.capacity(T)

    def coefficients(self, factor: Array, T: Array, q: Array) -> tuple[Array, Array, Array]:
        """`lower, diagonal, upper` of the rate at these temperatures, with the diffusivity's factor of the moment."""
        conductivity, capacity = self.factors(T, q)
        return coefficients(self.wall, self.diffusivity * factor * conductivity, capacity)

    def __call__(self, t: Any, T: Array, args: Any) -> Array:
        """`dT/dt`."""
        t = jnp.asarray(t)
        q, _ = self.inputs(t)
        return rate(self.wall, self.coefficients(self.factor(t), T, q), T, q)

    def reading(self, t: Array, T: Array) -> tuple[Array, Array]:
        """Temperature and its rate at the sensors."""
        q, q_rate = self.inputs(t)
        warming = self(t, T, None)
        return self.wall.state @ T + self.wall.face @ q[:2], self.wall.state @ warming + self.wall.face @ q_rate[:2]


def flow(wall: Cells, terms: Terms, campaign: ForcingData, diffusivity: Array) -> NonlinearWall:
    """The rate of a wall with these terms."""
    return NonlinearWall(
        wall,
        diffusivity,
        campaign.step,
        terms.conductivity_slope,
        Heat(campaign.reference, terms.capacity_slope, terms.latent),
        terms.drift,
        terms.wettings,
    )
