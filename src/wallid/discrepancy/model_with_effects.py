"""The wall with all effects, as a compiled function of its parameters.

At neutral values of the effects the model is exactly the plain one, so one compilation serves all combinations of
effects. It serves all priors and bounds too, which are data.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.arrays import on_device
from .._internal.xla_options import filter_jit_shortly
from ..inference.likelihood import LOG_CONDUCTIVITY, LOG_DIFFUSIVITY, PLATE_GAIN, PROFILE_MODE
from ..inference.noise_covariance import BinnedReadings
from ..inference.nuisance_kinds import CommonNoise, FacePositions, SensorHeights, SensorOffsets, SensorPositions
from ..inference.parameters import Parameters
from .effects.base import AbstractEffect
from .effects.equation_terms import ForcingData, Terms
from .forward.first_order import BaseSolution, first_order_response, solve_base
from .forward.response import face_response, simulate_readings
from .heterogeneity.section_pattern import SectionPattern

DEPTH_SIGNS = np.array([1.0, -1.0])
"""The depth inside the wall of each face's sensor, for one metre to the right of the face."""
_MOST_OF_EFFECTS = 8  # parameters of effects that a fit may estimate without another compilation
_COLUMNS = 32  # columns of a Jacobian per call of the compiled function, computed one after the other
# directions of a nonlinear wall computed together: more share each small step, fewer use more cores
_NONLINEAR_CHUNK = 10


class ModelWithEffects(eqx.Module):
    """The wall with all effects, as a function of its parameters.

    Args:
        forcing: face temperatures, regressors and cells of the wall.
        effects: those that the record can be tested for, and those of columns that were not logged.
        log_prior: ln of the prior diffusivity, alpha in m2/s.
        reference_conductivity: of the parameter `log_conductivity`, W/m/K; of no effect without a plate.
        pattern: what a section of several materials changes; None for a wall in one dimension.
        sensors: names of the inner sensors.
        substeps: steps between two rows of the implicit solver and of the first-order response.
    """

    forcing: ForcingData
    effects: tuple[AbstractEffect, ...]
    log_prior: Float[Array, ""]
    reference_conductivity: Float[Array, ""]
    pattern: SectionPattern | None
    sensors: tuple[str, ...] = eqx.field(static=True)
    substeps: int = eqx.field(static=True)

    def predict(self, parameters: Parameters, *, linear: bool) -> Float[Array, "time instrument"]:
        """The readings of the sensors, degC, and plates, W/m2; `linear` leaves out the nonlinear effects."""
        terms, profile = self.terms(parameters, linear=linear), self.profile(parameters)
        diffusivity = self.diffusivity(parameters)
        readings = simulate_readings(terms, self.forcing, diffusivity, profile, linear=linear, substeps=self.substeps)
        if self.pattern is not None:
            readings = readings + self.change_by_pattern(parameters)
        if not self.sensors:
            return readings
        common = self.forcing.common_noise @ parameters.vector(parameters.of_kind(CommonNoise.kind))
        return readings.at[:, : len(self.sensors)].add(common[:, None])

    def change_by_pattern(self, parameters: Parameters) -> Float[Array, "time instrument"]:
        """What the section's pattern changes in the readings, K, and W/m2 of the plates."""
        assert self.pattern is not None
        amplitudes = parameters.vector(parameters.of_kind(SensorHeights.kind))
        change = self.pattern.change(jnp.log(self.diffusivity(parameters)), amplitudes)
        plates = change.shape[1] - len(self.sensors)
        scale = jnp.concatenate([jnp.ones(len(self.sensors)), jnp.full(plates, self.conductivity(parameters))])
        return change * scale

    def base_solution(self, parameters: Parameters) -> BaseSolution:
        """The solution of the linear part of the wall, about which the effects are linearised."""
        terms, profile = self.terms(parameters, linear=True), self.profile(parameters)
        return solve_base(terms, self.forcing, self.diffusivity(parameters), profile, substeps=self.substeps)

    def first_order_response(
        self, base: BaseSolution, parameters: Parameters, direction: Float[Array, " param"]
    ) -> Float[Array, "time instrument"]:
        """The derivative of the readings by the size of an effect at its neutral value, K (W/m2 of a plate) per unit.

        Args:
            base: the linear part of the wall.
            parameters: those of the base with the effect at its grid point.
            direction: 1 for the size of the effect, 0 for all other parameters.
        """
        terms, change = jax.jvp(
            lambda values: self.terms(parameters.with_values(values), linear=False), (parameters.values,), (direction,)
        )
        diffusivity = self.diffusivity(parameters)
        return first_order_response(base, terms, change, self.forcing, diffusivity, substeps=self.substeps)

    def diffusivity(self, parameters: Parameters) -> Array:
        """Diffusivity alpha, m2/s."""
        return jnp.exp(self.log_prior + parameters[LOG_DIFFUSIVITY])

    def conductivity(self, parameters: Parameters) -> Array:
        """Effective conductivity of the wall, W/m/K; the reference without a plate."""
        if LOG_CONDUCTIVITY not in parameters:
            return self.reference_conductivity
        return self.reference_conductivity * jnp.exp(parameters[LOG_CONDUCTIVITY])

    def profile(self, parameters: Parameters) -> Float[Array, " mode"]:
        """Amplitudes of the wall's slowest modes in the initial profile, K."""
        return parameters.vector(parameters.of_kind(PROFILE_MODE))

    def terms(self, parameters: Parameters, *, linear: bool) -> Terms:
        """The terms of the wall with every effect at its parameters."""
        position, offset, face_position = (
            parameters.vector(parameters.of_kind(kind.kind)) for kind in (SensorPositions, SensorOffsets, FacePositions)
        )
        terms = Terms.plain(self.forcing).add(position=position, offset=offset, depth=DEPTH_SIGNS * face_position)
        if self.forcing.plates:
            gain = parameters.vector(parameters.of_kind(PLATE_GAIN))
            terms = replace(
                terms,
                conductivity=self.conductivity(parameters),
                plate_gain=terms.plate_gain.at[jnp.array(self.forcing.plates)].set(gain),
            )
        for effect in self.effects:
            if effect.linear or not linear:
                names = zip(effect.parameters, effect.parameter_names(self.sensors), strict=True)
                terms = effect.at({own.name: parameters[name] for own, name in names}).apply(terms, self.forcing)
        return terms


def first_order_columns(
    model: ModelWithEffects,
    bins: BinnedReadings,
    base: Parameters,
    candidates: Sequence[tuple[str, Mapping[str, float]]],
) -> np.ndarray:
    """Derivatives of the binned predictions by the sizes of effects at their neutral values.

    Args:
        model: the wall with all effects.
        bins: the readings.
        base: parameters of the fit; the derivatives are taken at its linear part.
        candidates: the name of each size, and the values of the effect's other parameters by their names.

    Returns:
        K per unit of the size, `(candidate, reading)`.
    """
    values = np.repeat(np.asarray(base.values)[None], len(candidates), axis=0)
    for row, (_, at) in zip(values, candidates, strict=True):
        row[base.indices(at)] = list(at.values())
    directions, solution = _unit_vectors(base, [size for size, _ in candidates]), _base_solution(model, base)
    columns = [
        np.asarray(_first_order(model, bins, solution, base, on_device(at), on_device(direction)))
        for at, direction in zip(_chunks(values, _COLUMNS), _chunks(directions, _COLUMNS), strict=True)
    ]
    return np.concatenate(columns)[: len(candidates)]


@filter_jit_shortly
def _base_solution(model: ModelWithEffects, parameters: Parameters) -> BaseSolution:
    return model.base_solution(parameters)


@filter_jit_shortly
def _first_order(
    model: ModelWithEffects,
    bins: BinnedReadings,
    solution: BaseSolution,
    base: Parameters,
    values: Float[Array, "column param"],
    directions: Float[Array, "column param"],
) -> Float[Array, "column reading"]:
    def column(pair: tuple[Array, Array]) -> Array:
        at, direction = base.with_values(pair[0]), pair[1]
        return jax.lax.cond(
            jnp.any(direction != 0.0),
            lambda: bins.mean(model.first_order_response(solution, at, direction)),
            lambda: jnp.zeros(bins.readings),
        )

    return jax.lax.map(column, (values, directions))


@filter_jit_shortly
def predict(model: ModelWithEffects, parameters: Parameters, linear: bool) -> Float[Array, "time instrument"]:
    """The readings of the sensors, degC, and plates, W/m2; `linear` leaves out the nonlinear effects."""
    return model.predict(parameters, linear=linear)


def face_impulse_response(model: ModelWithEffects, parameters: Parameters) -> np.ndarray:
    """The response of the readings to an error of 1 K in one reading of one face, `(face, row, instrument)`.

    Between rows the error is linear. Effects at the faces (such as a lag) apply to it.
    """
    # an error at the second row, which has a line before it; the first row is cut off below
    triangles = np.zeros((2, *model.forcing.faces.shape))
    for side in (0, 1):
        triangles[side, 0, 1, side] = triangles[side, 1, 0, side] = 1.0
        triangles[side, 1, 1, side] = -1.0
    both = face_change_response(model, parameters, triangles)
    return np.concatenate([both[:, 1:], both[:, -1:]], axis=1)


def face_change_response(
    model: ModelWithEffects, parameters: Parameters, changes: Float[np.ndarray, "change interval power face"]
) -> np.ndarray:
    """The response of the readings to changes of the face temperatures, `(change, time, instrument)`.

    Args:
        changes: coefficients of the powers of s, from 0 at a row to 1 at the next, K.
    """
    pairs = _chunks(np.asarray(changes), 2)  # so that any number of changes shares one compilation
    responses = [np.asarray(_responses(model, parameters, on_device(pair))) for pair in pairs]
    return np.concatenate(responses)[: len(changes)]


@filter_jit_shortly
def _responses(
    model: ModelWithEffects, parameters: Parameters, changes: Float[Array, "change interval power face"]
) -> Float[Array, "change time instrument"]:
    return jax.lax.map(lambda change: _response(model, parameters, change), changes)


def _response(
    model: ModelWithEffects, parameters: Parameters, change: Float[Array, "interval power face"]
) -> Float[Array, "time instrument"]:
    forcing = model.forcing

    def terms(size: Array) -> Terms:
        disturbed = eqx.tree_at(lambda m: m.forcing.faces, model, forcing.faces + size * change)
        return disturbed.terms(parameters, linear=True)

    plain, changed = jax.jvp(terms, (jnp.zeros(()),), (jnp.ones(()),))
    return face_response(plain, changed.faces, forcing, model.diffusivity(parameters))


def linearise(
    model: ModelWithEffects, bins: BinnedReadings, parameters: Parameters, names: Sequence[str], *, linear: bool
) -> tuple[np.ndarray, np.ndarray]:
    """The predictions at the rows and the derivatives of their bin means by some parameters.

    Args:
        model: the wall with all effects.
        bins: the readings.
        parameters: the point.
        names: of the parameters of the derivatives.
        linear: whether to leave out the nonlinear effects. A linear wall is compiled once for up to eight parameters
            of effects; the chunks of a nonlinear wall run in parallel threads.

    Returns:
        Predictions, degC, `(time, sensor)`, and derivatives, K per unit, `(name, reading)`.
    """
    directions = _unit_vectors(parameters, names)
    if linear:
        most = sum(not name.startswith("effect.") for name in parameters.names) + _MOST_OF_EFFECTS
        directions = np.pad(directions, ((0, max(0, most - len(names))), (0, 0)))
        value, slope = _linearise(model, bins, parameters, on_device(directions))
        return np.asarray(value), np.asarray(slope)[: len(names)]

    def derivatives(some: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, slope = _linearise_nonlinear(model, bins, parameters, on_device(some))
        return np.asarray(value), np.asarray(slope)

    arguments = model, bins, parameters
    shape = jax.tree.structure(arguments), *(leaf.shape for leaf in jax.tree.leaves(arguments))
    # the first call compiles for all
    with ThreadPoolExecutor(os.cpu_count() if shape in _compiled_shapes else 1) as pool:
        values, slopes = zip(*pool.map(derivatives, _chunks(directions, _NONLINEAR_CHUNK)), strict=True)
    _compiled_shapes.add(shape)
    return values[0], np.concatenate(slopes)[: len(names)]


_compiled_shapes: set[tuple[object, ...]] = set()


def _chunks(rows: np.ndarray, size: int) -> list[np.ndarray]:
    """The rows in chunks, the last padded with zeros, so that another number of rows needs no new compilation."""
    padded = np.pad(rows, ((0, -len(rows) % size), *((0, 0),) * (rows.ndim - 1)))
    return np.split(padded, len(padded) // size)


def _unit_vectors(parameters: Parameters, names: Sequence[str]) -> np.ndarray:
    """One row for each name: 1 for this parameter, 0 for the others."""
    return np.eye(len(parameters))[parameters.indices(names)]


def _function_of_values(
    model: ModelWithEffects, parameters: Parameters, *, linear: bool
) -> Callable[[Float[Array, " param"]], Float[Array, "time instrument"]]:
    """The prediction as a function of the values of all parameters, to differentiate it."""
    return lambda values: model.predict(parameters.with_values(values), linear=linear)


@filter_jit_shortly
def _linearise(
    model: ModelWithEffects, bins: BinnedReadings, parameters: Parameters, directions: Float[Array, "direction param"]
) -> tuple[Float[Array, "time instrument"], Float[Array, "direction reading"]]:
    value, along = jax.linearize(_function_of_values(model, parameters, linear=True), parameters.values)

    def slope(direction: Array) -> Array:
        """Zeros, without computation, for the zeros behind the last direction."""
        nonzero = jnp.any(direction != 0.0)
        return jax.lax.cond(nonzero, lambda: bins.mean(along(direction)), lambda: jnp.zeros(bins.readings))

    return value, jax.lax.map(slope, directions)


@filter_jit_shortly
def _linearise_nonlinear(
    model: ModelWithEffects, bins: BinnedReadings, parameters: Parameters, directions: Float[Array, "direction param"]
) -> tuple[Float[Array, "time instrument"], Float[Array, "direction reading"]]:
    def directional(direction: Array) -> tuple[Array, Array]:
        predict_at = _function_of_values(model, parameters, linear=False)
        value, slope = jax.jvp(predict_at, (parameters.values,), (direction,))
        return value, bins.mean(slope)

    return jax.vmap(directional, out_axes=(None, 0))(directions)
