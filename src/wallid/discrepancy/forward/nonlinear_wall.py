"""The heat equation of a wall whose coefficients depend on temperature or time."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..._internal.units import DAY
from ..effects.equation_terms import ForcingData, Terms, Wetting
from .cells import Cells, rate_coefficients, temperature_rate
from .heat_content import MIN_FACTOR, HeatContent

_ONSET = 1800.0  # s, duration of the onset of a wetting


class NonlinearWall(eqx.Module):
    """A wall whose coefficients depend on temperature or time, as a diffrax vector field::

        gamma(T) dT/dt = d/dx (alpha s(t) kappa(T) dT/dx) + gamma(T) (- v dT/dx + sum_a s_a (T_a - T) + q)

    Args:
        wall: the cells.
        diffusivity: alpha at the first row, m2/s.
        step: from row to row, s.
        conductivity_slope: kappa = 1 + conductivity_slope (T - T0), 1/K.
        heat: the heat capacity gamma and its integral.
        drift: of s(t), 1/day.
        wettings: jumps of s(t).
    """

    wall: Cells
    diffusivity: Array
    step: Array
    conductivity_slope: Array
    heat: HeatContent
    drift: Array
    wettings: tuple[Wetting, ...]

    def inputs(self, t: Array) -> tuple[Array, Array]:
        """Inputs and their time derivatives (per s) at a time."""
        inputs = self.wall.inputs
        interval = jnp.clip((t / self.step).astype(int), 0, inputs.shape[0] - 1)
        s = t / self.step - interval
        value = slope = jnp.zeros(inputs.shape[2])
        for coefficient in inputs[interval][::-1]:  # Horner
            value, slope = value * s + coefficient, slope * s + value
        return value, slope / self.step

    def diffusivity_factor(self, t: Array) -> Array:
        """The factor s(t) of alpha."""
        return diffusivity_factor(self.drift, self.wettings, t)

    def material_factors(self, T: Array, q: Array) -> tuple[Array, Array]:
        """The factors kappa of each cell and gamma of each node at these temperatures."""
        all_nodes = jnp.concatenate([q[:1], T, q[1:2]])
        middle = 0.5 * (all_nodes[1:] + all_nodes[:-1]) - self.heat.reference
        return conductivity_factor(self.conductivity_slope, middle), self.heat.capacity(T)

    def coefficients(self, factor: Array, T: Array, q: Array) -> tuple[Array, Array, Array]:
        """`lower, diagonal, upper` of the rate at these temperatures, with the factor s(t) of the diffusivity."""
        conductivity, capacity = self.material_factors(T, q)
        return rate_coefficients(self.wall, self.diffusivity * factor * conductivity, capacity)

    def __call__(self, t: Any, T: Array, args: Any) -> Array:
        """`dT/dt` at the inner nodes, K/s."""
        t = jnp.asarray(t)
        q, _ = self.inputs(t)
        return temperature_rate(self.wall, self.coefficients(self.diffusivity_factor(t), T, q), T, q)

    def observed(self, t: Array, T: Array) -> tuple[Array, Array]:
        """Temperature (degC) and its rate (K/s) at the sensors, and the same of the fluxes at plates (K/m)."""
        q, q_rate = self.inputs(t)
        node_rate = self(t, T, None)
        return self.wall.state_to_readings @ T + self.wall.faces_to_readings @ q[
            :2
        ], self.wall.state_to_readings @ node_rate + self.wall.faces_to_readings @ q_rate[:2]


def diffusivity_factor(drift: Array, wettings: tuple[Wetting, ...], t: Array) -> Array:
    """`s(t) = (1 + drift t) prod(1 + jump exp(-(t - time)/time_constant))`, the factor of alpha.

    Args:
        drift: 1/day.
        wettings: jumps of s(t).
        t: times since the first row, s.
    """
    factor = 1.0 + drift * t / DAY
    for event in wettings:
        elapsed = t - event.time
        # gradual, so that the response is differentiable by its time
        onset = jnp.clip(0.5 + elapsed / _ONSET, 0.0, 1.0)
        decay = jnp.exp(-jnp.maximum(elapsed, 0.0) / event.time_constant)
        factor = factor * (1.0 + event.jump * onset * decay)
    return jnp.maximum(factor, MIN_FACTOR)


def conductivity_factor(slope: Array, temperature: Array) -> Array:
    """`kappa = 1 + slope (T - T0)` at some temperatures T - T0, K; slope in 1/K."""
    return jnp.maximum(1.0 + slope * temperature, MIN_FACTOR)


def build_nonlinear_wall(wall: Cells, terms: Terms, forcing: ForcingData, diffusivity: Array) -> NonlinearWall:
    """The vector field of a wall with some terms.

    Args:
        wall: the cells.
        terms: the terms that depend on temperature or time.
        forcing: with the step and T0.
        diffusivity: m2/s.
    """
    return NonlinearWall(
        wall,
        diffusivity,
        forcing.step,
        terms.conductivity_slope,
        HeatContent(forcing.reference, terms.capacity_slope, terms.latent),
        terms.drift,
        terms.wettings,
    )
