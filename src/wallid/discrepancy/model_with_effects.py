"""The wall with the whole library in, as one compiled function of one vector of parameters; readings in bins.

The vector holds ln(diffusivity / prior), amplitudes of the initial profile's sine modes, position errors and offsets
of the sensors, how deep the faces' sensors sit, and then the parameters of every effect of the library. At neutral
values the model is the plain one exactly, so one compilation serves every combination of effects.
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
from .forward.first_order import Base, base_course, first_order
from .forward.response import face_response, respond

_COLUMNS = 32  # of a look: one after the other, in one compiled function
_CHUNK = 2  # directions side by side of a linear wall: more would not fit the cache
# of a stepped wall, whose steps are many and small: the more share one, the better; yet two cores are at hand
_STEPPED_CHUNK = 10


class ModelWithEffects(eqx.Module):
    """The wall with the whole library in, as a function of the one vector of parameters."""

    forcing: ForcingData
    effects: tuple[AbstractEffect, ...]
    log_prior: Float[Array, ""]
    sensors: int = eqx.field(static=True)
    substeps: int = eqx.field(static=True)

    def predict(self, theta: Float[Array, " param"], *, linear: bool) -> Float[Array, "time sensor"]:
        """The inner sensors' readings, degC; `linear` leaves the effects out that are not."""
        terms = self.terms(theta, linear=linear)
        return respond(
            terms, self.forcing, self.diffusivity(theta), self.profile(theta), linear=linear, substeps=self.substeps
        )

    def base(self, theta: Float[Array, " param"]) -> Base:
        """The course of the linear part of the wall, beside which effects are looked for."""
        terms = self.terms(theta, linear=True)
        return base_course(terms, self.forcing, self.diffusivity(theta), self.profile(theta), substeps=self.substeps)

    def first_order(
        self, base: Base, theta: Float[Array, " param"], direction: Float[Array, " param"]
    ) -> Float[Array, "time sensor"]:
        """The derivative of the readings along an effect at its neutral size, beside the base's linear part, K.

        Args:
            theta: the base's with the effect at its place.
            direction: of the effect's size.
        """
        terms, change = jax.jvp(lambda t: self.terms(t, linear=False), (theta,), (direction,))
        return first_order(
            base, terms, change, self.forcing, self.diffusivity(theta), self.profile(theta), substeps=self.substeps
        )

    def diffusivity(self, theta: Float[Array, " param"]) -> Array:
        """m2/s."""
        return jnp.exp(self.log_prior + theta[0])

    def profile(self, theta: Float[Array, " param"]) -> Float[Array, " mode"]:
        """Amplitudes of the initial profile, K."""
        return theta[1 : 1 + PROFILE_MODES]

    def terms(self, theta: Float[Array, " param"], *, linear: bool) -> Terms:
        """The wall's terms with every effect at its parameters."""
        first = 1 + PROFILE_MODES
        position, offset = theta[first : first + self.sensors], theta[first + self.sensors : first + 2 * self.sensors]
        used = first + 2 * self.sensors
        depth = theta[used : used + len(SIDES)]
        terms = Terms.plain(self.forcing).add(position=position, offset=offset, depth=depth)
        used += len(SIDES)
        for effect in self.effects:
            if effect.linear or not linear:
                values = {p.name: theta[used + i] for i, p in enumerate(effect.parameters)}
                terms = effect.at(values).extend(terms, self.forcing)
            used += len(effect.parameters)
        return terms


def first_order_columns(
    model: ModelWithEffects, bins: Bins, base: np.ndarray, theta: np.ndarray, direction: np.ndarray
) -> np.ndarray:
    """Derivatives of the binned predictions along effects at their neutral sizes, beside a base's linear part.

    Args:
        theta: the base with each effect at its place, `(column, param)`.
        direction: of each effect's size, `(column, param)`.

    Returns:
        `(column, reading)`.
    """
    count = len(theta)
    theta, direction = (_whole(part, _COLUMNS) for part in (theta, direction))
    course = _base(model, on_device(base))
    columns = [
        _first_order(model, bins, course, on_device(theta[some]), on_device(direction[some]))
        for some in (slice(at, at + _COLUMNS) for at in range(0, len(theta), _COLUMNS))
    ]
    return np.concatenate([np.asarray(part) for part in columns])[:count]


@eqx.filter_jit
def _base(model: ModelWithEffects, theta: Float[Array, " param"]) -> Base:
    return model.base(theta)


@eqx.filter_jit
def _first_order(
    model: ModelWithEffects,
    bins: Bins,
    base: Base,
    theta: Float[Array, "column param"],
    direction: Float[Array, "column param"],
) -> Float[Array, "column reading"]:
    def column(pair: tuple[Array, Array]) -> Array:
        moving = jnp.any(pair[1] != 0.0)
        return jax.lax.cond(moving, lambda: bins.mean(model.first_order(base, *pair)), lambda: jnp.zeros(bins.readings))

    return jax.lax.map(column, (theta, direction))


@eqx.filter_jit
def predict(model: ModelWithEffects, theta: Float[Array, " param"], linear: bool) -> Float[Array, "time sensor"]:
    """The inner sensors' readings, degC."""
    return model.predict(theta, linear=linear)


def impulses(model: ModelWithEffects, theta: np.ndarray) -> np.ndarray:
    """What the inner readings make of 1 K more at one row of one face, `(face, row, sensor)`.

    Between its rows a reading's error is taken as a straight line. Effects at the faces (their lag) apply.
    """
    return np.asarray(_impulses(model, on_device(theta)))


@eqx.filter_jit
def _impulses(model: ModelWithEffects, theta: Float[Array, " param"]) -> Float[Array, "face time sensor"]:
    campaign = model.forcing
    still = jnp.zeros_like(campaign.faces)

    def response(side: int) -> Array:
        # the second row, so that the line up to it is there; what comes before is cut
        lines = still.at[0, 1, side].set(1.0).at[1, 0, side].set(1.0).at[1, 1, side].set(-1.0)

        def terms(size: Array) -> Terms:
            driven = eqx.tree_at(lambda m: m.campaign.faces, model, campaign.faces + size * lines)
            return driven.terms(theta, linear=True)

        whole, change = jax.jvp(terms, (jnp.zeros(()),), (jnp.ones(()),))
        return face_response(whole, change.faces, campaign, model.diffusivity(theta))

    both = jnp.stack([response(0), response(1)])
    return jnp.concatenate([both[:, 1:], both[:, -1:]], axis=1)


def linearise(
    model: ModelWithEffects, bins: Bins, theta: np.ndarray, directions: np.ndarray, *, linear: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Predictions at the rows, `(time, sensor)`, and their binned derivatives along directions, `(direction, reading)`.

    A linear wall is compiled anew for every number of chunks of directions; of any other, chunks go side by side.
    """
    count = len(directions)
    if linear:
        value, slope = _linearise(model, bins, on_device(theta), on_device(_whole(directions, _CHUNK)))
        return np.asarray(value), np.asarray(slope)[:count]

    def along(some: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, slope = _linearise_stepped(model, bins, on_device(theta), on_device(some))
        return np.asarray(value), np.asarray(slope)

    used = np.flatnonzero(directions.any(axis=1))
    whole = _whole(directions[used] if used.size else directions[:1], _STEPPED_CHUNK)
    chunks = np.split(whole, len(whole) // _STEPPED_CHUNK)
    shape = jax.tree.structure(model), *(leaf.shape for leaf in jax.tree.leaves((model, bins)))
    with ThreadPoolExecutor(os.cpu_count() if shape in _stepped_shapes else 1) as pool:  # one compiles it for all
        values, slopes = zip(*pool.map(along, chunks), strict=True)
    _stepped_shapes.add(shape)
    slope = np.zeros((count, slopes[0].shape[1]))
    slope[used] = np.concatenate(slopes)[: used.size]
    return values[0], slope


_stepped_shapes: set[tuple[object, ...]] = set()


def _whole(rows: np.ndarray, chunk: int) -> np.ndarray:
    """The rows, zeros after them up to whole chunks, so that nothing is compiled anew for another number of them."""
    return np.pad(rows, ((0, -len(rows) % chunk), (0, 0)))


@eqx.filter_jit
def _linearise(
    model: ModelWithEffects, bins: Bins, theta: Float[Array, " param"], directions: Float[Array, "direction param"]
) -> tuple[Float[Array, "time sensor"], Float[Array, "direction reading"]]:
    value, along = jax.linearize(lambda t: model.predict(t, linear=True), theta)

    def slopes(some: Array) -> Array:
        return jax.vmap(lambda direction: bins.mean(along(direction)))(some)

    def some_slopes(some: Array) -> Array:
        """Where every direction is 0 nothing is computed."""
        return jax.lax.cond(jnp.any(some != 0.0), slopes, lambda some: jnp.zeros((some.shape[0], bins.readings)), some)

    chunks = directions.reshape(-1, _CHUNK, directions.shape[1])
    return value, jax.lax.map(some_slopes, chunks).reshape(directions.shape[0], bins.readings)


@eqx.filter_jit
def _linearise_stepped(
    model: ModelWithEffects, bins: Bins, theta: Float[Array, " param"], directions: Float[Array, "direction param"]
) -> tuple[Float[Array, "time sensor"], Float[Array, "direction reading"]]:
    def one(direction: Array) -> tuple[Array, Array]:
        value, slope = jax.jvp(lambda t: model.predict(t, linear=False), (theta,), (direction,))
        return value, bins.mean(slope)

    return jax.vmap(one, out_axes=(None, 0))(directions)
