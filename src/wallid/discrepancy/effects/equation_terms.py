"""The terms of the heat equation, of the boundary conditions and of the readings that effects change.

The plain model is a homogeneous (or stated) wall between two measured faces. `Terms` holds all terms that it may
miss, at their neutral values. Each effect adds to some of them, so effects combine in any number and order::

    dT/dt = 1/gamma(T, x) d/dx (alpha s(t) kappa(T, x) dT/dx) - v dT/dx + sum_a s_a (T_a - T) + q(x, t)

with gamma and kappa relative to the effective heat capacity and conductivity of the wall, the factor s(t) of the
diffusivity, the air velocity v, the loss coefficients s_a to the air temperatures T_a, and heat sources q in K/s.

The readings are those of the inner sensors, degC, and after them those of the heat flux plates, W/m2.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

POWERS = 4
"""Coefficients of a cubic between two rows, in powers of s from 0 to 1."""
CONSTANT = np.eye(POWERS)[0]
"""Coefficients of a signal that is 1 at all times."""
DERIVATIVE = np.diag(np.arange(1.0, POWERS), -1)
"""`c @ DERIVATIVE` are the coefficients of the derivative with respect to s."""


class ForcingData(eqx.Module):
    """The face temperatures and regressors of a record, the nodes of the wall and the stated sensor positions.

    Between rows each signal is a cubic `sum_j c_j s^j`, with s from 0 at a row to 1 at the next.

    Args:
        step: from row to row, s.
        faces: coefficients of the two face readings, degC.
        irradiance: coefficients of the irradiance, W/m2; zeros where not logged, as for the next three.
        outdoor: coefficients of the outdoor air temperature, degC.
        indoor: coefficients of the indoor air temperature, degC.
        heating: coefficients of the heating relative to its largest value, -.
        hour: hour of the day at each row but the last, h.
        initial: temperatures of the inner nodes at the first row, degC: the polynomial through the first readings.
        profile_modes: the slowest modes of the wall at the inner nodes, 1, each with a temperature of its own at the
            first row.
        common_noise: the part of each face's readings that may be noise, K, which all inner sensors may have too.
        reference: T0, the mean of all face and inner readings, degC.
        node_positions: positions of the nodes, faces included, m.
        resistance: of each cell between nodes times the effective conductivity of the wall, m.
        capacity: of the cell of each node over the effective volumetric capacity of the wall, m.
        layer_nodes: indices of the nodes at the edges of the wall's layers, both faces included.
        sensor_positions: stated positions of the inner sensors, m.
        length: length of the wall, m.
        plates: indices of the faces with a heat flux plate, 0 for the left one.
    """

    step: Float[Array, ""]
    faces: Float[Array, "interval power face"]
    irradiance: Float[Array, "interval power"]
    outdoor: Float[Array, "interval power"]
    indoor: Float[Array, "interval power"]
    heating: Float[Array, "interval power"]
    hour: Float[Array, " interval"]
    initial: Float[Array, " inner"]
    profile_modes: Float[Array, "inner mode"]
    common_noise: Float[Array, "time face"]
    reference: Float[Array, ""]
    node_positions: Float[Array, " node"]
    resistance: Float[Array, " cell"]
    capacity: Float[Array, " node"]
    layer_nodes: Int[Array, " edge"]
    sensor_positions: Float[Array, " sensor"]
    length: Float[Array, ""]
    plates: tuple[int, ...] = eqx.field(static=True, default=())

    @property
    def intervals(self) -> int:
        """Number of intervals between rows."""
        return self.faces.shape[0]


class Step(NamedTuple):
    """A step of ln(k) or ln(rho c), or a joint of some thickness (m), at a position (m)."""

    size: Array
    position: Array


class LatentHeat(NamedTuple):
    """A peak of the heat capacity with an area (K) at a temperature (degC)."""

    area: Array
    temperature: Array


class Wetting(NamedTuple):
    """A jump of the diffusivity by the factor `1 + jump` at `time` (s) that decays with `time_constant` (s)."""

    jump: Array
    time_constant: Array
    time: Array


class Source(NamedTuple):
    """A heat source: `rate` (K/s) times a signal, about a position (m; None for the entire wall)."""

    rate: Array
    position: Array | None
    signal: Float[Array, "interval power"]


class Terms(eqx.Module):
    """The terms that effects change; see the module for the equation.

    Args:
        faces: coefficients of the face temperatures that drive the model, degC.
        depth: depth of each face sensor inside the wall, m.
        film: conductivity over film coefficient at each face, m.
        conductivity_steps: steps of ln(k).
        capacity_steps: steps of ln(rho c).
        joints: thicknesses and positions of joints.
        conductivity_slope: relative change of k with temperature about T0, 1/K.
        capacity_slope: relative change of rho c with temperature about T0, 1/K.
        latent: phase changes.
        drift: relative change of the diffusivity, 1/day.
        wettings: jumps of the diffusivity.
        loss: loss coefficients to outdoor and indoor air, 1/s.
        velocity: air velocity, m/s.
        sources: heat sources.
        position: position error of each inner sensor, m.
        lag: time constant of each inner sensor, s.
        delay: delay of the clock of the inner sensors, s.
        gain: gain error of each inner sensor, -.
        offset: offset of each inner sensor, K.
        rate: drift of each inner sensor, K/day.
        conductivity: effective one of the wall, W/m/K, by which gradients become fluxes.
        plate_gain: calibration error of the plate at each face, -.
        plate_offset: offset of each plate, W/m2.
        plate_lag: time constant of each plate, s.
        plate_resistance: between each face's reading and the wall, m2 K/W: of a plate and its contact.
    """

    faces: Float[Array, "interval power face"]
    depth: Float[Array, " face"]
    film: Float[Array, " face"]
    conductivity_slope: Float[Array, ""]
    capacity_slope: Float[Array, ""]
    drift: Float[Array, ""]
    loss: Float[Array, " air"]
    velocity: Float[Array, ""]
    position: Float[Array, " sensor"]
    lag: Float[Array, " sensor"]
    delay: Float[Array, ""]
    gain: Float[Array, " sensor"]
    offset: Float[Array, " sensor"]
    rate: Float[Array, " sensor"]
    conductivity: Float[Array, ""]
    plate_gain: Float[Array, " face"]
    plate_offset: Float[Array, " face"]
    plate_lag: Float[Array, " face"]
    plate_resistance: Float[Array, " face"]
    conductivity_steps: tuple[Step, ...] = ()
    capacity_steps: tuple[Step, ...] = ()
    joints: tuple[Step, ...] = ()
    latent: tuple[LatentHeat, ...] = ()
    wettings: tuple[Wetting, ...] = ()
    sources: tuple[Source, ...] = ()

    @classmethod
    def plain(cls, forcing: ForcingData) -> Terms:
        """The terms of the plain model."""
        scalar, pair = jnp.zeros(()), jnp.zeros(2)
        per_sensor = jnp.zeros_like(forcing.sensor_positions)
        return cls(
            faces=forcing.faces,
            depth=pair,
            film=pair,
            conductivity_slope=scalar,
            capacity_slope=scalar,
            drift=scalar,
            loss=pair,
            velocity=scalar,
            position=per_sensor,
            lag=per_sensor,
            delay=scalar,
            gain=per_sensor,
            offset=per_sensor,
            rate=per_sensor,
            conductivity=jnp.ones(()),
            plate_gain=pair,
            plate_offset=pair,
            plate_lag=pair,
            plate_resistance=pair,
        )

    @property
    def film_lengths(self) -> Float[Array, " face"]:
        """The length of wall with the resistance between each face's reading and the wall, m: of films and plates."""
        return self.film + self.conductivity * self.plate_resistance

    def add(self, **changes: Any) -> Terms:
        """The terms with changes added: numbers are added, tuples are concatenated."""
        return dataclasses.replace(self, **{name: getattr(self, name) + change for name, change in changes.items()})
