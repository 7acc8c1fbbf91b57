"""The information of many windows, by the readings' own noise and offsets, or by all that the interval counts."""

from __future__ import annotations

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Array, Float, Int

from .._internal.arrays import on_device
from ..case.case_definition import Case
from ..case.initial_profile import dimensionless_profile, fit_profile, scales
from ..case.time_window import Window
from ..inference.nuisance_parameters import CONDUCTIVITY_STD
from ..models.batching import Sweep
from ..models.batching import sweep as over_items
from ..models.flux_plates import (
    conductance_of,
    flux_gain_std,
    flux_noise_std,
    flux_readings,
    fluxes_of,
    plates_beside,
    untold_rows,
)
from ..models.integration import Integrator
from ..models.sensitivity_equations import explicit, profile_response
from ..models.state_space import StateSpace
from ..models.window_inputs import WindowData, window_data
from .fisher_information import Criterion, Of, criterion_of, fisher, kept, std_of
from .information_contributions import WindowContributions, rows_per_bin
from .predicted_response import ResponseModel


def counts_all(case: Case, full: bool | None) -> bool:
    """Whether a design counts all that the interval counts: where nothing is said, with plates.

    A flux feels the faces' noise and the initial profile many times more than a sensor inside.
    """
    return bool(fluxes_of(case)) if full is None else full


def full_sizes(
    case: Case, starts: np.ndarray, rows: tuple[int, ...], alphas: Sequence[float], criterion: Criterion, of: Of
) -> tuple[np.ndarray, np.ndarray]:
    """The criterion, and the information on ln(alpha), with all that the interval counts.

    Args:
        rows: the windows' lengths; all come from one run of the longest.

    Returns:
        both `(diffusivity, window, length)`, 0 for a window that the record does not hold.
    """
    model, longest = ResponseModel(case, [sensor.position for sensor in case.sensors]), max(rows)
    sizes, on_log = np.zeros((2, len(alphas), len(starts), len(rows)))
    for a, alpha in enumerate(alphas):
        courses = model.predict(starts, longest, alpha)
        for k, length in enumerate(rows):
            bin_rows = rows_per_bin(length * len(model.outputs))
            looking = WindowContributions(case, courses.until(length), starts, length, bin_rows)
            for w in np.flatnonzero(case.record.holds(starts, length)):
                sizes[a, w, k], on_log[a, w, k] = _of_one(looking, int(w), criterion, of)
    return sizes, on_log


def _of_one(looking: WindowContributions, window: int, criterion: Criterion, of: Of) -> tuple[float, float]:
    """The criterion and the information on ln(alpha) of one window."""
    case = looking.case
    at = Window(int(looking.starts[window]), looking.rows)
    present, read = np.isfinite(case.record.sensors[at.part]), np.isfinite(flux_readings(case, at))
    if not present.any() and not read.any():
        return 0.0, 0.0
    seen = looking.contributions_of_case(window, present, read)
    matrix = fisher([one for _, one in seen], looking.whitening(seen))
    return criterion_of(matrix, criterion, kept(of, [one for _, one in seen])), std_of(matrix) ** -2.0


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
    return StartProfiles(on_device(np.stack(initial)), on_device(np.stack(per_offset)))


class Plates(eqx.Module):
    """What a design needs to know of flux plates; none where there is no gain.

    Args:
        gain_std: of each one's calibration, 1.
        untold: how many rows of a window of each length they do not tell of.
    """

    gain_std: Float[Array, " flux"] = eqx.field(converter=on_device)
    untold: tuple[int, ...] = eqx.field(static=True)

    @classmethod
    def of(cls, case: Case, rows: tuple[int, ...]) -> Plates:
        """A case's, in windows of these lengths."""
        gains = np.full(len(fluxes_of(case)), flux_gain_std(case))
        return cls(gains, tuple(untold_rows(case, length, case.record.step) for length in rows))

    def telling(self, weight: Array, untold: int) -> Array:
        """The readings' weights, `(time, output)`, without the first rows of the plates."""
        return weight.at[:untold, weight.shape[1] - self.gain_std.shape[0] :].set(0.0)


def watched(case: Case) -> WindowData:
    """The whole record with the plates after the sensors; a flux is taken over k / L, K."""
    data, faces = window_data(case), fluxes_of(case)
    if not faces:
        return data
    conductance = conductance_of(case)
    flux = np.stack([case.record.regressors[f"flux_{face}"] for face in faces], axis=1)
    return plates_beside(data, flux / conductance, flux_noise_std(case) / conductance)


def _slopes(
    system: StateSpace, fo: Array, data: WindowData, plates: Plates, integrator: Integrator
) -> tuple[Float[Array, "time output"], Float[Array, "time output constant"] | None]:
    """theta, and what one standard deviation of each constant makes of the readings, K (None: there is none).

    The constants are the estimated offsets, and with plates ln(conductivity) and each one's calibration.
    """
    u, theta = explicit(system, fo, data, integrator=integrator)
    columns = [_offset_columns(system, fo, data, integrator)] if data.offsets else []
    if count := plates.gain_std.shape[0]:
        flux = data.temperature * u.at[:, : u.shape[1] - count].set(0.0)
        gains = [
            std * flux * jax.nn.one_hot(u.shape[1] - count + p, u.shape[1]) for p, std in enumerate(plates.gain_std)
        ]
        columns.append(jnp.stack([CONDUCTIVITY_STD * flux, *gains], axis=-1))
    return theta, jnp.concatenate(columns, axis=-1) if columns else None


def _offset_columns(
    system: StateSpace, fo: Array, data: WindowData, integrator: Integrator
) -> Float[Array, "time output offset"]:
    """What one standard deviation of each estimated offset makes of the predicted readings, K."""
    places = np.asarray(data.offsets)

    def column(place: Array) -> Array:
        u = profile_response(system, fo, data, -data.profile_per_offset[:, place], integrator=integrator)
        return data.offset_std[place] * (data.temperature * u + jax.nn.one_hot(place, u.shape[1]))

    return jnp.moveaxis(jax.vmap(column)(jnp.asarray(places)), 0, -1)


def _information(
    theta: Array, weight: Array, columns: Array | None, rows: tuple[int, ...], plates: Plates
) -> Float[Array, " length"]:
    """The information of the first rows on Fo, the constants projected out."""
    found = []
    for length, untold in zip(rows, plates.untold, strict=True):
        used = plates.telling(weight[:length], untold)
        scaled = theta[:length] * used
        direct = jnp.sum(scaled**2)
        if columns is not None:
            weighted = columns[:length] * used[:, :, None]
            mixed = jnp.einsum("ts,tso->o", scaled, weighted)
            own = jnp.einsum("tso,tsp->op", weighted, weighted)
            direct = direct - mixed @ jnp.linalg.solve(own + jnp.eye(len(mixed)), mixed)
        found.append(direct)
    return jnp.stack(found)


def window_information(
    system: StateSpace,
    fourier: Float[Array, " case"],
    data: WindowData,
    starts: Int[Array, " window"],
    profiles: StartProfiles,
    plates: Plates,
    *,
    rows: tuple[int, ...],
    sweep: Sweep = "map",
    integrator: Integrator = "propagator",
    mesh: Mesh | None = None,
) -> Float[Array, "case window length"]:
    """The information of each window on Fo (in u), theta restarted at each window's start.

    Args:
        starts: first rows of the windows.
        system, data: with the plates after the sensors, as `watched` gives them.
        profiles: the initial profile at each start.
        rows: the windows' lengths; all come from one run of the longest. What would lie past the
            record's end holds no readings.
        sweep, mesh: how the windows are gone through, see `wallid.sweep`.
    """
    beyond = (0, max(rows))
    inputs = np.pad(np.asarray(data.inputs), (beyond, (0, 0)), mode="edge")
    weight = np.pad(np.asarray(data.weight), (beyond, (0, 0)))
    extended = eqx.tree_at(lambda d: (d.inputs, d.weight), data, (on_device(inputs), on_device(weight)))
    shared = (system, fourier, extended, plates, rows, sweep, integrator)
    return jnp.moveaxis(over_items(_of_window, (starts, profiles), *shared, way=sweep, mesh=mesh), 0, 1)


def _of_window(
    window: tuple[Array, StartProfiles],
    system: StateSpace,
    fourier: Array,
    extended: WindowData,
    plates: Plates,
    rows: tuple[int, ...],
    sweep: Sweep,
    integrator: Integrator,
) -> Float[Array, "case length"]:
    """The information of one window, at each diffusivity and for each length."""
    (start, profile), longest = window, max(rows)
    inputs, weight = (
        jax.lax.dynamic_slice_in_dim(course, start, longest) for course in (extended.inputs, extended.weight)
    )

    own = eqx.tree_at(
        lambda d: (d.inputs, d.initial, d.profile_per_offset), extended, (inputs, profile.initial, profile.per_offset)
    )

    def at(fo: Array) -> Array:
        theta, columns = _slopes(system, fo, own, plates, integrator)
        return _information(theta, weight, columns, rows, plates)

    return jax.vmap(at)(fourier) if sweep == "vmap" else jax.lax.map(at, fourier)


@eqx.filter_jit
def cut_information(
    system: StateSpace,
    fourier: Float[Array, " case"],
    data: WindowData,
    starts: Int[Array, " window"],
    plates: Plates,
    *,
    rows: int,
    integrator: Integrator = "propagator",
) -> Float[Array, "case window"]:
    """The information of each window on Fo (in u), cut from one run over the whole record.

    Plates tell of all rows but the record's first ones.
    """
    known = Plates(plates.gain_std, (0,))

    def at(fo: Array) -> Array:
        theta, columns = _slopes(system, fo, data, plates, integrator)
        everything = (theta, plates.telling(data.weight, plates.untold[0]), columns)

        def one(start: Array) -> Array:
            cut = jax.tree.map(lambda part: jax.lax.dynamic_slice_in_dim(part, start, rows), everything)
            return _information(cut[0], cut[1], cut[2], (rows,), known)[0]

        return jax.lax.map(one, starts)

    return jax.lax.map(at, fourier)
