"""The wall with all effects of the library, as a compiled function of one parameter vector.

The vector holds ln(alpha / prior), the amplitudes of the sine modes of the initial profile, position errors and
offsets of the inner sensors, depths of the face sensors, and the parameters of every effect. At neutral values the
model is exactly the plain one, so one compilation serves all combinations of effects.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.arrays import on_device
from ..case.initial_profile import PROFILE_MODES
from ..case.wall_and_sensors import SIDES
from ..inference.noise_covariance import Bins
from .effects.base import AbstractEffect
from .effects.equation_terms import ForcingData, Terms
from .forward.first_order import BaseSolution, first_order_response, solve_base
from .forward.response import face_response, simulate_readings

_COLUMNS = 32  # columns of a Jacobian per call of the compiled function, computed one after the other
_CHUNK = 2  # directions of a linear wall computed together: more do not fit into the cache
# directions of a nonlinear wall computed together: more share each small step, fewer use more cores
_NONLINEAR_CHUNK = 10


class ModelWithEffects(eqx.Module):
    """The wall with all effects of the library, as a function of the parameter vector.

    Args:
        forcing: face temperatures, regressors and cells of the wall.
        effects: the effects of the library, in the order of the parameter vector.
        log_prior: ln of the prior diffusivity, alpha in m2/s.
        sensor_count: number of inner sensors.
        substeps: steps between two rows of the implicit solver and of the first-order response.
    """

    forcing: ForcingData
    effects: tuple[AbstractEffect, ...]
    log_prior: Float[Array, ""]
    sensor_count: int = eqx.field(static=True)
    substeps: int = eqx.field(static=True)

    def predict(self, theta: Float[Array, " param"], *, linear: bool) -> Float[Array, "time sensor"]:
        """The readings of the inner sensors, degC; `linear` leaves out the nonlinear effects."""
        terms = self.terms(theta, linear=linear)
        return simulate_readings(
            terms, self.forcing, self.diffusivity(theta), self.profile(theta), linear=linear, substeps=self.substeps
        )

    def base_solution(self, theta: Float[Array, " param"]) -> BaseSolution:
        """The solution of the linear part of the wall, about which the effects are linearised."""
        terms = self.terms(theta, linear=True)
        return solve_base(terms, self.forcing, self.diffusivity(theta), self.profile(theta), substeps=self.substeps)

    def first_order_response(
        self, base: BaseSolution, theta: Float[Array, " param"], direction: Float[Array, " param"]
    ) -> Float[Array, "time sensor"]:
        """The derivative of the readings by the size of an effect at its neutral value, K per unit.

        Args:
            base: the linear part of the wall.
            theta: the parameters of the base with the effect at its grid point.
            direction: unit vector of the size of the effect.
        """
        terms, change = jax.jvp(lambda t: self.terms(t, linear=False), (theta,), (direction,))
        return first_order_response(
            base, terms, change, self.forcing, self.diffusivity(theta), self.profile(theta), substeps=self.substeps
        )

    def diffusivity(self, theta: Float[Array, " param"]) -> Array:
        """Diffusivity alpha, m2/s."""
        return jnp.exp(self.log_prior + theta[0])

    def profile(self, theta: Float[Array, " param"]) -> Float[Array, " mode"]:
        """Amplitudes of the sine modes of the initial profile, K."""
        return theta[1 : 1 + PROFILE_MODES]

    def terms(self, theta: Float[Array, " param"], *, linear: bool) -> Terms:
        """The terms of the wall with every effect at its parameters."""
        first = 1 + PROFILE_MODES
        position, offset = (
            theta[first : first + self.sensor_count],
            theta[first + self.sensor_count : first + 2 * self.sensor_count],
        )
        used = first + 2 * self.sensor_count
        depth = theta[used : used + len(SIDES)]
        terms = Terms.plain(self.forcing).add(position=position, offset=offset, depth=depth)
        used += len(SIDES)
        for effect in self.effects:
            if effect.linear or not linear:
                values = {p.name: theta[used + i] for i, p in enumerate(effect.parameters)}
                terms = effect.at(values).apply(terms, self.forcing)
            used += len(effect.parameters)
        return terms


def first_order_columns(
    model: ModelWithEffects, bins: Bins, base: np.ndarray, theta: np.ndarray, direction: np.ndarray
) -> np.ndarray:
    """Derivatives of the binned predictions by the sizes of effects at their neutral values.

    Args:
        model: the wall with all effects.
        bins: the readings.
        base: parameters of the fit, `(param,)`; the derivatives are taken at its linear part.
        theta: the same with each effect at its grid point, `(column, param)`.
        direction: unit vector of each size, `(column, param)`.

    Returns:
        K per unit of the size, `(column, reading)`.
    """
    count = len(theta)
    theta, direction = (_padded(part, _COLUMNS) for part in (theta, direction))
    solution = _base_solution(model, on_device(base))
    columns = [
        _first_order(model, bins, solution, on_device(theta[part]), on_device(direction[part]))
        for part in (slice(k, k + _COLUMNS) for k in range(0, len(theta), _COLUMNS))
    ]
    return np.concatenate([np.asarray(part) for part in columns])[:count]


@eqx.filter_jit
def _base_solution(model: ModelWithEffects, theta: Float[Array, " param"]) -> BaseSolution:
    return model.base_solution(theta)


@eqx.filter_jit
def _first_order(
    model: ModelWithEffects,
    bins: Bins,
    base: BaseSolution,
    theta: Float[Array, "column param"],
    direction: Float[Array, "column param"],
) -> Float[Array, "column reading"]:
    def column(pair: tuple[Array, Array]) -> Array:
        nonzero = jnp.any(pair[1] != 0.0)
        return jax.lax.cond(
            nonzero, lambda: bins.mean(model.first_order_response(base, *pair)), lambda: jnp.zeros(bins.readings)
        )

    return jax.lax.map(column, (theta, direction))


@eqx.filter_jit
def predict(model: ModelWithEffects, theta: Float[Array, " param"], linear: bool) -> Float[Array, "time sensor"]:
    """The readings of the inner sensors, degC; `linear` leaves out the nonlinear effects."""
    return model.predict(theta, linear=linear)


def face_impulse_response(model: ModelWithEffects, theta: np.ndarray) -> np.ndarray:
    """The response of the inner readings to an error of 1 K in one reading of one face, `(face, row, sensor)`.

    Between rows the error is linear. Effects at the faces (such as a lag) apply to it.
    """
    return np.asarray(_impulses(model, on_device(theta)))


@eqx.filter_jit
def _impulses(model: ModelWithEffects, theta: Float[Array, " param"]) -> Float[Array, "face time sensor"]:
    forcing = model.forcing
    zeros = jnp.zeros_like(forcing.faces)

    def response(side: int) -> Array:
        # an error at the second row, which has a line before it; the first row is cut off below
        triangle = zeros.at[0, 1, side].set(1.0).at[1, 0, side].set(1.0).at[1, 1, side].set(-1.0)

        def terms(size: Array) -> Terms:
            disturbed = eqx.tree_at(lambda m: m.forcing.faces, model, forcing.faces + size * triangle)
            return disturbed.terms(theta, linear=True)

        plain, change = jax.jvp(terms, (jnp.zeros(()),), (jnp.ones(()),))
        return face_response(plain, change.faces, forcing, model.diffusivity(theta))

    both = jnp.stack([response(0), response(1)])
    return jnp.concatenate([both[:, 1:], both[:, -1:]], axis=1)


def linearise(
    model: ModelWithEffects, bins: Bins, theta: np.ndarray, directions: np.ndarray, *, linear: bool
) -> tuple[np.ndarray, np.ndarray]:
    """The predictions at the rows and the derivatives of their bin means along some directions.

    Args:
        model: the wall with all effects.
        bins: the readings.
        theta: parameters, `(param,)`.
        directions: `(direction, param)`; rows of zeros cost nothing.
        linear: whether to leave out the nonlinear effects. A linear wall is compiled again for each number of chunks
            of directions; the chunks of a nonlinear wall run in parallel threads.

    Returns:
        Predictions, degC, `(time, sensor)`, and derivatives, K per unit, `(direction, reading)`.
    """
    count = len(directions)
    if linear:
        value, slope = _linearise(model, bins, on_device(theta), on_device(_padded(directions, _CHUNK)))
        return np.asarray(value), np.asarray(slope)[:count]

    def derivatives(some: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, slope = _linearise_nonlinear(model, bins, on_device(theta), on_device(some))
        return np.asarray(value), np.asarray(slope)

    used = np.flatnonzero(directions.any(axis=1))
    padded = _padded(directions[used] if used.size else directions[:1], _NONLINEAR_CHUNK)
    chunks = np.split(padded, len(padded) // _NONLINEAR_CHUNK)
    shape = jax.tree.structure(model), *(leaf.shape for leaf in jax.tree.leaves((model, bins)))
    with ThreadPoolExecutor(
        os.cpu_count() if shape in _compiled_shapes else 1
    ) as pool:  # the first call compiles for all
        values, slopes = zip(*pool.map(derivatives, chunks), strict=True)
    _compiled_shapes.add(shape)
    slope = np.zeros((count, slopes[0].shape[1]))
    slope[used] = np.concatenate(slopes)[: used.size]
    return values[0], slope


_compiled_shapes: set[tuple[object, ...]] = set()


def _padded(rows: np.ndarray, chunk: int) -> np.ndarray:
    """The rows, padded with zeros to full chunks, so that another number of rows needs no new compilation."""
    return np.pad(rows, ((0, -len(rows) % chunk), (0, 0)))


@eqx.filter_jit
def _linearise(
    model: ModelWithEffects, bins: Bins, theta: Float[Array, " param"], directions: Float[Array, "direction param"]
) -> tuple[Float[Array, "time sensor"], Float[Array, "direction reading"]]:
    value, along = jax.linearize(lambda t: model.predict(t, linear=True), theta)

    def slopes(some: Array) -> Array:
        return jax.vmap(lambda direction: bins.mean(along(direction)))(some)

    def some_slopes(some: Array) -> Array:
        """Zeros, without computation, where every direction is zero."""
        return jax.lax.cond(jnp.any(some != 0.0), slopes, lambda some: jnp.zeros((some.shape[0], bins.readings)), some)

    chunks = directions.reshape(-1, _CHUNK, directions.shape[1])
    return value, jax.lax.map(some_slopes, chunks).reshape(directions.shape[0], bins.readings)


@eqx.filter_jit
def _linearise_nonlinear(
    model: ModelWithEffects, bins: Bins, theta: Float[Array, " param"], directions: Float[Array, "direction param"]
) -> tuple[Float[Array, "time sensor"], Float[Array, "direction reading"]]:
    def directional(direction: Array) -> tuple[Array, Array]:
        value, slope = jax.jvp(lambda t: model.predict(t, linear=False), (theta,), (direction,))
        return value, bins.mean(slope)

    return jax.vmap(directional, out_axes=(None, 0))(directions)
