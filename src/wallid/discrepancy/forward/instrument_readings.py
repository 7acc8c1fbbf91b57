"""The readings of sensors, plates and logger from the temperatures and fluxes: clock, lag, gain, offset, drift."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._internal.units import DAY
from ..effects.equation_terms import ForcingData, Terms
from .cells import inputs_at_rows
from .nonlinear_wall import conductivity_factor, diffusivity_factor
from .phi_derivatives import phi_functions_by_identity


def apply_instrument_effects(
    terms: Terms, forcing: ForcingData, value: Float[Array, "time instrument"], rate: Float[Array, "time instrument"]
) -> Float[Array, "time instrument"]:
    """The readings of the inner sensors, degC, and of the plates, W/m2.

    Args:
        terms: with the terms of the instruments.
        forcing: with the step, T0 and the plates.
        value: temperatures at the sensors, degC, then fluxes at the plates over the conductivity, K/m.
        rate: their time derivatives, per s; those of the fluxes are not used.
    """
    sensors = forcing.sensor_positions.shape[0]
    temperatures = apply_sensor_effects(terms, forcing, value[:, :sensors], rate[:, :sensors])
    fluxes = apply_plate_effects(terms, forcing, value[:, sensors:])
    return jnp.concatenate([temperatures, fluxes], axis=1)


def apply_plate_effects(
    terms: Terms, forcing: ForcingData, value: Float[Array, "time plate"]
) -> Float[Array, "time plate"]:
    """The readings of the plates, W/m2, `(time, plate)`.

    With the flux `q = k s(t) kappa(T_face) value`, and y the lagged one (`lag y' + y = q`)::

        reading = (1 + gain) y + offset

    Between rows q is the cubic with the slopes of its central differences: where the course of a face bends, at a row,
    the slope of the flux has no limit.

    Args:
        terms: with the conductivity k and the terms of the plates.
        forcing: with the step, T0 and the plates.
        value: fluxes over the conductivity, K/m, positive along +x.
    """
    plates = jnp.array(forcing.plates, dtype=int)
    if not forcing.plates:
        return value
    faces = inputs_at_rows(terms.faces, forcing.step)[0][:, plates] - forcing.reference
    t = jnp.arange(value.shape[0]) * forcing.step
    factor = conductivity_factor(terms.conductivity_slope, faces)
    factor = terms.conductivity * factor * diffusivity_factor(terms.drift, terms.wettings, t)[:, None]
    flux = factor * value
    y = _lagged(flux, jnp.asarray(jnp.gradient(flux, axis=0)) / forcing.step, terms.plate_lag[plates], forcing.step)
    return (1.0 + terms.plate_gain[plates]) * y + terms.plate_offset[plates]


def apply_sensor_effects(
    terms: Terms, forcing: ForcingData, value: Float[Array, "time sensor"], rate: Float[Array, "time sensor"]
) -> Float[Array, "time sensor"]:
    """The readings of the inner sensors, degC, `(time, sensor)`.

    With the temperature T delayed by the clock, and y the lagged one (`lag y' + y = T`)::

        reading = y + gain (y - T0) + offset + rate t

    Args:
        terms: with the terms of the sensors.
        forcing: with the step and T0.
        value: temperatures at the sensors, degC.
        rate: their time derivatives, K/s.
    """
    value, rate = _delayed(value, rate, terms.delay, forcing.step)
    value = _lagged(value, rate, terms.lag, forcing.step)
    days = jnp.arange(value.shape[0])[:, None] * (forcing.step / DAY)
    return value + terms.gain * (value - forcing.reference) + terms.offset + terms.rate * days


def _hermite(value: Array, rate: Array, step: Array) -> Float[Array, "interval power sensor"]:
    """Coefficients of the cubic Hermite interpolation between rows, in powers of s."""
    low, high = value[:-1], value[1:]
    slope_low, slope_high = step * rate[:-1], step * rate[1:]
    return jnp.stack(
        [low, slope_low, 3 * (high - low) - 2 * slope_low - slope_high, 2 * (low - high) + slope_low + slope_high],
        axis=1,
    )


def _delayed(value: Array, rate: Array, delay: Array, step: Array) -> tuple[Array, Array]:
    """`T(t - delay)` and its rate from the cubics, with linear extrapolation beyond the record."""
    cubics = _hermite(value, rate, step)
    row = jnp.arange(value.shape[0]) - delay / step
    interval = jnp.clip(jnp.floor(row).astype(int), 0, cubics.shape[0] - 1)
    s = row - interval
    inside = jnp.where(s < 0.0, 0.0, jnp.where(s > 1.0, 1.0, s))  # `clip` would halve the derivative at both ends
    c0, c1, c2, c3 = (cubics[interval, j] for j in range(4))
    x = inside[:, None]
    slope = c1 + x * (2 * c2 + x * 3 * c3)
    return c0 + x * (c1 + x * (c2 + x * c3)) + slope * (s - inside)[:, None], slope / step


def _lagged(value: Array, rate: Array, lag: Array, step: Array) -> Array:
    """`lag y' + y = T` with T the cubics, exactly: with `s = lag/h`, `psi_j = int_0^1 e^(-(1-x)/s) x^j dx / s`::

    y_1 = e^(-1/s) y_0 + sum_j psi_j c_j,      psi_0 = 1 - e^(-1/s),      psi_j = 1 - j s psi_{j-1}

    At lag 0 y is exactly T. For lags longer than a step psi_j is computed from the phi-functions, because the recursion
    would lose digits.
    """
    cubics = _hermite(value, rate, step)
    s = lag / step
    short_lag = s < 1.0
    safe = jnp.where(s > 1e-3, s, 1.0)
    decay = jnp.where(s > 1e-3, jnp.exp(-1.0 / safe), 0.0)
    psi = [1.0 - decay]
    for j in range(1, 4):
        psi.append(1.0 - j * jnp.where(short_lag, s, 0.0) * psi[-1])
    inverse = 1.0 / jnp.where(short_lag, 1.0, s)
    _, *phis = phi_functions_by_identity(-inverse, highest=4)
    weights = [
        jnp.where(short_lag, recursive, inverse * math.factorial(j) * phi)
        for j, (recursive, phi) in enumerate(zip(psi, phis, strict=True))
    ]
    drive = sum((cubics[:, j] * weight for j, weight in enumerate(weights)), jnp.zeros(()))

    def advance(y: Array, driven: Array) -> tuple[Array, Array]:
        y = decay * y + driven
        return y, y

    _, later = jax.lax.scan(advance, value[0], drive)
    return jnp.concatenate([value[:1], later])
