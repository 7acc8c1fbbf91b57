"""What of a wall's equation, its faces and its readings effects change; all of it zero, or absent, in the plain model.

The plain model is one homogeneous (or stated) wall between two measured faces. `Terms` holds everything
that may be missing from it, at its neutral value; an effect adds its own to these, and so effects compose
in any number and any order::

    dT/dt = 1/gamma(T, x) d/dx (alpha s(t) kappa(T, x) dT/dx) - v dT/dx + sum_a s_a (T_a - T) + q(x, t)

with `gamma` and `kappa` relative to the wall's effective capacity and conductivity.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

POWERS = 4
"""Coefficients of a cubic between two rows, in powers of s from 0 to 1."""
CONSTANT = np.eye(POWERS)[0]
"""Of a course that is 1 all the time."""
DERIVATIVE = np.diag(np.arange(1.0, POWERS), -1)
"""`c @ DERIVATIVE` are the coefficients of the derivative by s."""


class ForcingData(eqx.Module):
    """What a wall was driven with over some rows, and where it was read.

    Between rows everything is a monotone cubic `sum_j c_j s^j`, s from 0 at a row to 1 at the next.

    Args:
        step: from row to row, s.
        faces: coefficients of the two face readings, degC.
        irradiance: W/m2. outdoor, indoor: air, degC. heating: 1 (0 to 1). Zeros where not logged.
        hour: of the day, h, at each row.
        start_profile: temperature at the first row, a straight line between the faces at each end, degC.
        reference: T0, the mean of all face and inner readings, degC.
        places: of the nodes, faces included, m.
        resistance: of each cell between nodes, over that of a metre of the wall's effective material, m.
        capacity: of each node's cell, over that of a metre, m.
        position: of the inner sensors as stated, m.
        length: of the wall, m.
    """

    step: Float[Array, ""]
    faces: Float[Array, "interval power face"]
    irradiance: Float[Array, "interval power"]
    outdoor: Float[Array, "interval power"]
    indoor: Float[Array, "interval power"]
    heating: Float[Array, "interval power"]
    hour: Float[Array, " interval"]
    start_profile: Float[Array, " face"]
    reference: Float[Array, ""]
    places: Float[Array, " node"]
    resistance: Float[Array, " cell"]
    capacity: Float[Array, " node"]
    position: Float[Array, " sensor"]
    length: Float[Array, ""]

    @property
    def intervals(self) -> int:
        """Rows less one."""
        return self.faces.shape[0]


class Step(NamedTuple):
    """A step of a logarithm, or a joint, at a place (m)."""

    size: Array
    place: Array


class Wetting(NamedTuple):
    """A diffusivity that jumps by a factor 1 + `jump` at `time` (s) and comes back with `time_constant` (s)."""

    jump: Array
    time_constant: Array
    time: Array


class Source(NamedTuple):
    """Heat: `rate` (K/s) times `shape` at the nodes (None: everywhere 1) times a course in time."""

    rate: Array
    place: Array | None
    course: Float[Array, "interval power"]


class Terms(eqx.Module):
    """Everything that effects change, at its neutral value; see the module for the equation.

    Args:
        faces: what the model takes for the two readings, degC.
        depth: how deep inside the wall each face's reading is, m.
        film: conductivity over film coefficient at each face, m.
        conductivity_steps, capacity_steps: log ratio right over left of a place.
        joints: resistance times conductivity at a place, m.
        conductivity_slope, capacity_slope: about T0, 1/K.
        latent: (area in K, temperature in degC) of bumps of the capacity.
        drift: of the diffusivity, 1/day. wettings: jumps of it.
        loss: to outdoor and indoor air, 1/s. velocity: m/s. sources: of heat.
        position: of each sensor beyond the stated one, m. lag: s. delay: of all inner rows, s.
        gain: 1. offset: K. rate: K/day.
    """

    faces: Float[Array, "interval power face"]
    depth: Float[Array, " face"]
    film: Float[Array, " face"]
    conductivity_steps: tuple[Step, ...]
    capacity_steps: tuple[Step, ...]
    joints: tuple[Step, ...]
    conductivity_slope: Float[Array, ""]
    capacity_slope: Float[Array, ""]
    latent: tuple[Step, ...]
    drift: Float[Array, ""]
    wettings: tuple[Wetting, ...]
    loss: Float[Array, " air"]
    velocity: Float[Array, ""]
    sources: tuple[Source, ...]
    position: Float[Array, " sensor"]
    lag: Float[Array, " sensor"]
    delay: Float[Array, ""]
    gain: Float[Array, " sensor"]
    offset: Float[Array, " sensor"]
    rate: Float[Array, " sensor"]

    @classmethod
    def plain(cls, campaign: ForcingData) -> Terms:
        """The terms of a wall from which nothing is missing."""
        zero, two = jnp.zeros(()), jnp.zeros(2)
        each = jnp.zeros_like(campaign.position)
        return cls(
            faces=campaign.faces,
            depth=two,
            film=two,
            conductivity_steps=(),
            capacity_steps=(),
            joints=(),
            conductivity_slope=zero,
            capacity_slope=zero,
            latent=(),
            drift=zero,
            wettings=(),
            loss=two,
            velocity=zero,
            sources=(),
            position=each,
            lag=each,
            delay=zero,
            gain=each,
            offset=each,
            rate=each,
        )

    def add(self, **changes: Any) -> Terms:
        """These terms with something added to some: numbers are added up, tuples are joined."""
        return dataclasses.replace(self, **{name: getattr(self, name) + change for name, change in changes.items()})
