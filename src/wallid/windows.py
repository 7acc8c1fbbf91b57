"""The information of many windows, by the readings' own noise and offsets, or by all that the interval counts."""

from __future__ import annotations

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Array, Float, Int

from .case import Case
from .courses import Model
from .experiment import Experiment, dimensionless_profile, fit_profile, scales
from .information import Criterion, Looking, Of, fisher, kept, rows_per_bin, std_of, told
from .sensitivity import explicit, profile_response
from .simulate import Integrator
from .statespace import StateSpace
from .sweeps import Sweep
from .sweeps import sweep as over_items


def full_sizes(
    case: Case, starts: np.ndarray, rows: tuple[int, ...], alphas: Sequence[float], criterion: Criterion, of: Of
) -> tuple[np.ndarray, np.ndarray]:
    """The criterion, and the information on ln(alpha), with all that the interval counts.

    Arguments:
        rows: the windows' lengths; all come from one run of the longest.

    Returns:
        both `(diffusivity, window, length)`, 0 for a window that the record does not hold.
    """
    model, longest = Model(case, [sensor.position for sensor in case.sensors]), max(rows)
    sizes, on_log = np.zeros((2, len(alphas), len(starts), len(rows)))
    for a, alpha in enumerate(alphas):
        courses = model.courses(starts, longest, alpha)
        for k, length in enumerate(rows):
            bin_rows = rows_per_bin(length * len(case.sensors))
            looking = Looking(case, courses.until(length), starts, length, bin_rows)
            for w in np.flatnonzero(case.record.holds(starts, length)):
                sizes[a, w, k], on_log[a, w, k] = _of_one(looking, int(w), criterion, of)
    return sizes, on_log


def _of_one(looking: Looking, window: int, criterion: Criterion, of: Of) -> tuple[float, float]:
    """The criterion and the information on ln(alpha) of one window."""
    start, sensors = int(looking.starts[window]), looking.case.sensors
    present = np.isfinite(looking.case.record.sensors[start : start + looking.rows])
    seen = [looking.seen(window, s, sensor, present[:, s]) for s, sensor in enumerate(sensors)]
    if not present.any():
        return 0.0, 0.0
    matrix = fisher(seen, looking.whitening(list(enumerate(seen))))
    return told(matrix, criterion, kept(of, seen)), std_of(matrix) ** -2.0


class StartProfiles(eqx.Module):
    """The initial profile of each window, and how it moves with each sensor's offset (1/K)."""

    initial: Float[Array, "window param"]
    per_offset: Float[Array, "window param sensor"]


def start_profiles(case: Case, starts: np.ndarray) -> StartProfiles:
    """The fitted initial profile at each start, dimensionless."""
    scale = scales(case)
    fitted = [fit_profile(case, int(row)) for row in starts]
    initial = [dimensionless_profile(profile.coefficients, scale) for profile in fitted]
    per_offset = [profile.per_reading / scale.temperature for profile in fitted]
    return StartProfiles(jnp.asarray(np.stack(initial)), jnp.asarray(np.stack(per_offset)))


def _slopes(
    system: StateSpace, fo: Array, data: Experiment, integrator: Integrator
) -> tuple[Float[Array, "time sensor"], Float[Array, "time sensor offset"] | None]:
    """theta, and what each estimated offset makes of the readings (None: there is none)."""
    _, theta = explicit(system, fo, data, integrator=integrator)
    return theta, _offset_columns(system, fo, data, integrator) if data.offsets else None


def _offset_columns(
    system: StateSpace, fo: Array, data: Experiment, integrator: Integrator
) -> Float[Array, "time sensor offset"]:
    """What one kelvin of each estimated offset makes of the predicted readings, K."""
    places, rows = np.asarray(data.offsets), data.inputs.shape[0]

    def column(place: Array) -> Array:
        u = profile_response(system, fo, data.step, rows, -data.profile_per_offset[:, place], integrator=integrator)
        return data.temperature * u + jax.nn.one_hot(place, u.shape[1])

    return jnp.moveaxis(jax.vmap(column)(jnp.asarray(places)), 0, -1)


def _information(
    theta: Array, weight: Array, columns: Array | None, offset_std: Array, rows: tuple[int, ...]
) -> Float[Array, " length"]:
    """Information on Fo (in u) of the first so many rows each, offsets projected out."""
    ends = np.asarray(rows) - 1
    scaled = theta * weight
    direct = jnp.cumsum(jnp.sum(scaled**2, axis=1))[ends]
    if columns is None:
        return direct
    weighted = columns * weight[:, :, None]
    mixed = jnp.cumsum(jnp.einsum("ts,tso->to", scaled, weighted), axis=0)[ends]
    own = jnp.cumsum(jnp.einsum("tso,tsp->top", weighted, weighted), axis=0)[ends]
    prior = jnp.diag(1.0 / offset_std**2)
    return direct - jnp.sum(mixed * jnp.linalg.solve(own + prior, mixed[..., None])[..., 0], axis=-1)


def window_information(
    system: StateSpace,
    fourier: Float[Array, " case"],
    data: Experiment,
    starts: Int[Array, " window"],
    profiles: StartProfiles,
    *,
    rows: tuple[int, ...],
    sweep: Sweep = "map",
    integrator: Integrator = "propagator",
    mesh: Mesh | None = None,
) -> Float[Array, "case window length"]:
    """The information of each window on Fo (in u), theta restarted at each window's start.

    Arguments:
        starts: first rows of the windows.
        profiles: the initial profile at each start.
        rows: the windows' lengths; all come from one run of the longest. What would lie past the
            record's end holds no readings.
        sweep, mesh: how the windows are gone through, see `wallid.sweep`.
    """
    beyond = (0, max(rows))
    inputs = np.pad(np.asarray(data.inputs), (beyond, (0, 0)), mode="edge")
    weight = np.pad(np.asarray(data.weight), (beyond, (0, 0)))
    extended = eqx.tree_at(lambda d: (d.inputs, d.weight), data, (jnp.asarray(inputs), jnp.asarray(weight)))
    shared = (system, fourier, extended, rows, sweep, integrator)
    return jnp.moveaxis(over_items(_of_window, (starts, profiles), *shared, way=sweep, mesh=mesh), 0, 1)


def _of_window(
    window: tuple[Array, StartProfiles],
    system: StateSpace,
    fourier: Array,
    extended: Experiment,
    rows: tuple[int, ...],
    sweep: Sweep,
    integrator: Integrator,
) -> Float[Array, "case length"]:
    """The information of one window, at each diffusivity and for each length."""
    (start, profile), longest = window, max(rows)
    inputs, weight = (
        jax.lax.dynamic_slice_in_dim(course, start, longest) for course in (extended.inputs, extended.weight)
    )
    offset_std = extended.offset_std[np.asarray(extended.offsets, dtype=int)]

    own = eqx.tree_at(
        lambda d: (d.inputs, d.initial, d.profile_per_offset), extended, (inputs, profile.initial, profile.per_offset)
    )

    def at(fo: Array) -> Array:
        theta, columns = _slopes(system, fo, own, integrator)
        return _information(theta, weight, columns, offset_std, rows)

    return jax.vmap(at)(fourier) if sweep == "vmap" else jax.lax.map(at, fourier)


@eqx.filter_jit
def cut_information(
    system: StateSpace,
    fourier: Float[Array, " case"],
    data: Experiment,
    starts: Int[Array, " window"],
    *,
    rows: int,
    integrator: Integrator = "propagator",
) -> Float[Array, "case window"]:
    """The information of each window on Fo (in u), cut from one run over the whole record."""
    offset_std = data.offset_std[np.asarray(data.offsets, dtype=int)]

    def at(fo: Array) -> Array:
        theta, columns = _slopes(system, fo, data, integrator)
        everything = (theta, data.weight, columns)

        def one(start: Array) -> Array:
            cut = jax.tree.map(lambda part: jax.lax.dynamic_slice_in_dim(part, start, rows), everything)
            return _information(cut[0], cut[1], cut[2], offset_std, (rows,))[0]

        return jax.lax.map(one, starts)

    return jax.lax.map(at, fourier)
