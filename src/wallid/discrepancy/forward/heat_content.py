"""How much heat a wall's nodes hold at a temperature.

A step that keeps the account in heat loses none where the capacity changes fast, as it does while water freezes.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..effects.equation_terms import Step
from ..effects.material import latent_capacity, latent_heat

LEAST_FACTOR = 0.05
"""Of a coefficient that depends on temperature or time, lest the equation lose its sense."""


class Heat(eqx.Module):
    """Capacity over the wall's own, `c(T) = max(1 + slope (T - T0), least) + sum of the bumps`, and its integral H.

    Heat is in K of the wall's own capacity.
    """

    reference: Array
    slope: Array
    latent: tuple[Step, ...]

    def capacity(self, T: Float[Array, " node"]) -> Float[Array, " node"]:
        """`c(T)`."""
        plain = jnp.maximum(1.0 + self.slope * (T - self.reference), LEAST_FACTOR)
        return plain + latent_capacity(self.latent, T)

    def content(self, T: Float[Array, " node"]) -> Float[Array, " node"]:
        """`H(T)`, the integral of c from the reference, K."""
        since = T - self.reference
        factor = 1.0 + self.slope * since
        short = jnp.minimum(factor - LEAST_FACTOR, 0.0)  # below the least factor the integral is a straight line
        bend = jnp.where(short < 0.0, 0.5 * short**2 / jnp.where(self.slope == 0.0, 1.0, self.slope), 0.0)
        return since + 0.5 * self.slope * since**2 - bend + latent_heat(self.latent, T)
