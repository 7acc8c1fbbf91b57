"""The heat content of the nodes of a wall as a function of temperature.

A time step formulated in heat content conserves energy where the capacity changes fast, as during freezing.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..effects.equation_terms import LatentHeat
from ..effects.material import latent_capacity, latent_heat

MIN_FACTOR = 0.05
"""Smallest value of a coefficient that depends on temperature or time; keeps the equation parabolic."""


class HeatContent(eqx.Module):
    """The relative heat capacity and its integral, the heat content H in K::

        c(T) = max(1 + slope (T - T0), MIN_FACTOR) + latent_capacity(T),      H(T) = int_T0^T c dT + constant

    Args:
        reference: T0, degC.
        slope: 1/K.
        latent: phase changes.
    """

    reference: Array
    slope: Array
    latent: tuple[LatentHeat, ...]

    def capacity(self, T: Float[Array, " node"]) -> Float[Array, " node"]:
        """`c(T)`, dimensionless."""
        sensible = jnp.maximum(1.0 + self.slope * (T - self.reference), MIN_FACTOR)
        return sensible + latent_capacity(self.latent, T)

    def content(self, T: Float[Array, " node"]) -> Float[Array, " node"]:
        """`H(T)`, K."""
        difference = T - self.reference
        factor = 1.0 + self.slope * difference
        below = jnp.minimum(factor - MIN_FACTOR, 0.0)  # where c is at MIN_FACTOR the integral is linear
        correction = jnp.where(below < 0.0, 0.5 * below**2 / jnp.where(self.slope == 0.0, 1.0, self.slope), 0.0)
        return difference + 0.5 * self.slope * difference**2 - correction + latent_heat(self.latent, T)
