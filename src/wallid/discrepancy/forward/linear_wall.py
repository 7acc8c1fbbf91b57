"""A linear wall in its modes, one exact step a row, for faces that are monotone cubics between rows::

    m' = lambda m + b u(t),     m_1 = e^z m_0 + h sum_j j! phi_{j+1}(z) b c_j,     z = h lambda

(`phi` of `exponential.py`, `u = sum_j c_j s^j`).
"""

from __future__ import annotations

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...models.exponential_solver import phi_functions
from ..effects.equation_terms import ForcingData
from .cells import Cells, at_rows, coefficients


class Modes(eqx.Module):
    """A linear wall in its modes: `m' = poles m + into f` for rates f at the nodes, `T = out m`."""

    poles: Float[Array, " mode"]
    into: Float[Array, "mode node"]
    out: Float[Array, "node mode"]
    inputs: Float[Array, "mode input"]

    def run(
        self,
        initial: Float[Array, " mode"],
        course: Float[Array, "interval power input"],
        inputs: Float[Array, "mode input"],
        step: Array,
    ) -> Float[Array, "time mode"]:
        """The modes at each row, driven by polynomials between rows that come in through `inputs`; exact.

        The inputs are few: weighted with the phi-functions first, they never spread over all modes and powers.
        """
        weights = self._weights(course.shape[1], step)[:, :, None] * inputs
        return self._stepped(initial, jnp.einsum("njq,jmq->nm", course, weights), step)

    def run_on_lines(self, rates: Float[Array, "point mode"], step: Array, *, parts: int) -> Float[Array, "time mode"]:
        """The modes at each row from rest, each driven by straight lines between points, `parts` to a row; exact."""
        first, rising = self._weights(2, step)
        driven = (rates[:-1] * (first - rising) + rates[1:] * rising).reshape(-1, parts, rates.shape[1])
        fade = jnp.exp(step * self.poles * jnp.arange(parts - 1, -1, -1)[:, None])
        return self._stepped(jnp.zeros_like(self.poles), jnp.sum(fade * driven, axis=1), parts * step)

    def _weights(self, powers: int, step: Array) -> Float[Array, "power mode"]:
        """`h j! phi_{j+1}(z)`: what a power of the time in a step adds to a mode."""
        phis = phi_functions(step * self.poles, most=powers)[1:]
        return step * jnp.stack([math.factorial(j) * phi for j, phi in enumerate(phis)])

    def _stepped(
        self, initial: Float[Array, " mode"], driven: Float[Array, "interval mode"], step: Array
    ) -> Float[Array, "time mode"]:
        E = jnp.exp(step * self.poles)

        def advance(m: Array, driven: Array) -> tuple[Array, Array]:
            m = E * m + driven
            return m, m

        _, later = jax.lax.scan(advance, initial, driven)
        return jnp.concatenate([initial[None], later])


def modes(wall: Cells, diffusivity: Array) -> Modes:
    """The modes of a linear wall.

    `D^-1 A D` is symmetric for `d_{i+1}/d_i = sqrt(lower_{i+1}/upper_i)`: air flow leaves the modes real.
    """
    lower, diagonal, upper = coefficients(wall, diffusivity)
    log_ratio = 0.5 * (jnp.log(lower[1:]) - jnp.log(upper[:-1]))
    scale = jnp.exp(jnp.concatenate([jnp.zeros(1), jnp.cumsum(log_ratio)]))
    beside = jnp.sqrt(lower[1:] * upper[:-1])
    poles, Q = jnp.linalg.eigh(jnp.diag(diagonal) + jnp.diag(beside, 1) + jnp.diag(beside, -1))
    into = Q.T / scale
    faces = jnp.zeros((lower.shape[0], 2)).at[0, 0].set(lower[0]).at[-1, 1].set(upper[-1])
    return Modes(poles, into, scale[:, None] * Q, into @ jnp.concatenate([faces, wall.other], axis=1))


def linear_course(
    wall: Cells, campaign: ForcingData, diffusivity: Array, initial: Float[Array, " node"]
) -> tuple[Float[Array, "time sensor"], Float[Array, "time sensor"]]:
    """Temperature (degC) and its rate (K/s) at the sensors, at each row, of a linear wall."""
    system = modes(wall, diffusivity)
    m = system.run(system.into @ initial, wall.course, system.inputs, campaign.step)
    q, q_rate = at_rows(wall.course, campaign.step)
    c = wall.state @ system.out
    value = m @ c.T + q[:, :2] @ wall.face.T
    rate = (m * system.poles + q @ system.inputs.T) @ c.T + q_rate[:, :2] @ wall.face.T
    return value, rate
