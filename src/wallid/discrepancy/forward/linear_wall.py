"""The exact solution of a linear wall in its modes, with inputs that are cubics between rows.

With one step of length h per row, `u = sum_j c_j s^j` and the phi-functions of `exponential_solver.py`::

    m' = lambda m + b u(t),     m_1 = e^z m_0 + h sum_j j! phi_{j+1}(z) b c_j,     z = h lambda
"""

from __future__ import annotations

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...models.state_space import symmetric_modes
from ..effects.equation_terms import ForcingData
from .cells import Cells, inputs_at_rows, rate_coefficients
from .phi_derivatives import phi_functions_by_identity
from .unchanged_arguments import without_idle_derivatives


class Modes(eqx.Module):
    """A linear wall in its modes: `m' = poles m + to_modes f` for heating rates f at the nodes, `T = to_nodes m`.

    Args:
        poles: eigenvalues, 1/s.
        to_modes: from nodes to modes.
        to_nodes: from modes to nodes.
        input_matrix: rates of the modes per unit of each input.
    """

    poles: Float[Array, " mode"]
    to_modes: Float[Array, "mode node"]
    to_nodes: Float[Array, "node mode"]
    input_matrix: Float[Array, "mode input"]

    def integrate(
        self,
        initial: Float[Array, " mode"],
        inputs: Float[Array, "interval power input"],
        input_matrix: Float[Array, "mode input"],
        step: Array,
    ) -> Float[Array, "time mode"]:
        """The modes at each row, driven by inputs that are polynomials between rows; exact.

        Args:
            initial: modes at the first row.
            inputs: coefficients of the inputs.
            input_matrix: rates of the modes per unit of each input.
            step: from row to row, s.
        """
        weights = self._weights(inputs.shape[1], step)
        return self._advance(initial, _driven(inputs, weights, input_matrix), step)

    def integrate_piecewise_linear(
        self, rates: Float[Array, "point mode"], step: Array, *, parts: int
    ) -> Float[Array, "time mode"]:
        """The modes at each row from zero, each driven by a piecewise linear rate; exact.

        Args:
            rates: rates of the modes at `parts` points per interval and at the last row.
            step: between these points, s.
            parts: number of points per interval.
        """
        first, rising = self._weights(2, step)
        driven = (rates[:-1] * (first - rising) + rates[1:] * rising).reshape(-1, parts, rates.shape[1])
        decay = jnp.exp(step * self.poles * jnp.arange(parts - 1, -1, -1)[:, None])
        return self._advance(jnp.zeros_like(self.poles), jnp.sum(decay * driven, axis=1), parts * step)

    def _weights(self, powers: int, step: Array) -> Float[Array, "power mode"]:
        """`h j! phi_{j+1}(z)`: the contribution of a power of time within a step to a mode."""
        phis = phi_functions_by_identity(step * self.poles, highest=powers)[1:]
        return step * jnp.stack([math.factorial(j) * phi for j, phi in enumerate(phis)])

    def _advance(
        self, initial: Float[Array, " mode"], driven: Float[Array, "interval mode"], step: Array
    ) -> Float[Array, "time mode"]:
        E = jnp.exp(step * self.poles)

        def advance(m: Array, driven: Array) -> tuple[Array, Array]:
            m = E * m + driven
            return m, m

        _, later = jax.lax.scan(advance, initial, driven)
        return jnp.concatenate([initial[None], later])


@without_idle_derivatives
def _driven(
    inputs: Float[Array, "interval power input"],
    weights: Float[Array, "power mode"],
    input_matrix: Float[Array, "mode input"],
) -> Float[Array, "interval mode"]:
    """What the inputs add to each mode in each interval."""
    # the weights are applied to the few inputs first, so that no array over modes and powers arises per interval
    return jnp.einsum("njq,jmq->nm", inputs, weights[:, :, None] * input_matrix)


@without_idle_derivatives
def modal_decomposition(wall: Cells, diffusivity: Array) -> Modes:
    """The modes of a linear wall.

    `D^-1 A D` is symmetric for `d_{i+1}/d_i = sqrt(lower_{i+1}/upper_i)`, so the modes are real with air flow too.

    Args:
        wall: the cells.
        diffusivity: m2/s.
    """
    lower, diagonal, upper = rate_coefficients(wall, diffusivity)
    log_ratio = 0.5 * (jnp.log(lower[1:]) - jnp.log(upper[:-1]))
    scale = jnp.exp(jnp.concatenate([jnp.zeros(1), jnp.cumsum(log_ratio)]))
    off_diagonal = jnp.sqrt(lower[1:] * upper[:-1])
    poles, Q = symmetric_modes(jnp.diag(diagonal) + jnp.diag(off_diagonal, 1) + jnp.diag(off_diagonal, -1))
    to_modes = Q.T / scale
    faces = jnp.zeros((lower.shape[0], 2)).at[0, 0].set(lower[0]).at[-1, 1].set(upper[-1])
    return Modes(
        poles, to_modes, scale[:, None] * Q, to_modes @ jnp.concatenate([faces, wall.heat_input_matrix], axis=1)
    )


def simulate_linear_wall(
    wall: Cells, forcing: ForcingData, diffusivity: Array, initial: Float[Array, " node"]
) -> tuple[Float[Array, "time instrument"], Float[Array, "time instrument"]]:
    """Temperature (degC) and its rate (K/s) at the sensors of a linear wall, then those of the fluxes at plates (K/m).

    Args:
        wall: the cells.
        forcing: with the step.
        diffusivity: m2/s.
        initial: state at the first row, degC.
    """
    system = modal_decomposition(wall, diffusivity)
    m, m_rate = _modes_and_rates(system, system.to_modes @ initial, wall.inputs, forcing.step)
    q, q_rate = inputs_at_rows(wall.inputs, forcing.step)
    C = wall.state_to_readings @ system.to_nodes
    value = m @ C.T + q[:, :2] @ wall.faces_to_readings.T
    rate = m_rate @ C.T + q_rate[:, :2] @ wall.faces_to_readings.T
    return value, rate


@without_idle_derivatives
def _modes_and_rates(
    system: Modes, initial: Float[Array, " mode"], inputs: Float[Array, "interval power input"], step: Array
) -> tuple[Float[Array, "time mode"], Float[Array, "time mode"]]:
    """The modes at each row and their rates, per s."""
    m = system.integrate(initial, inputs, system.input_matrix, step)
    q, _ = inputs_at_rows(inputs, step)
    return m, m * system.poles + q @ system.input_matrix.T
