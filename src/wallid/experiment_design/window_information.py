"""The Fisher information of many windows on the diffusivity.

Either only the readings' own noise, the sensor offsets and the plates' calibration errors are counted, with all windows
in one sweep; or the full covariance of the estimate's interval, window by window.
"""

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
    append_flux_readings,
    flux_gain_std,
    flux_noise_std,
    flux_readings,
    fluxes_of,
    uninformative_rows,
    wall_conductance,
)
from ..models.integration import Integrator
from ..models.sensitivity_equations import explicit, profile_response
from ..models.state_space import StateSpace
from ..models.window_inputs import WindowData, window_data
from .fisher_information import (
    Criterion,
    ParametersOfInterest,
    criterion_of,
    indices_of_interest,
    information_matrix,
    relative_std,
)
from .information_contributions import Contribution, WindowContributions, rows_per_bin
from .predicted_response import ResponseModel


def uses_full_covariance(case: Case, full: bool | None) -> bool:
    """Whether a design uses the full covariance; by default (None) it does where the case has flux plates.

    A flux is many times more sensitive to face noise and to the initial profile than a temperature inside.
    """
    return bool(fluxes_of(case)) if full is None else full


def full_covariance_criterion(
    case: Case,
    starts: np.ndarray,
    rows: tuple[int, ...],
    alphas: Sequence[float],
    criterion: Criterion,
    of: ParametersOfInterest,
) -> tuple[np.ndarray, np.ndarray]:
    """The criterion and the information on ln(alpha) of each window, with the full covariance.

    Args:
        starts: first rows of the windows.
        rows: lengths of the windows; all come from one simulation of the longest.
        alphas: diffusivities, m2/s.

    Returns:
        both as `(diffusivity, window, length)`; 0 for a window that is not inside the record.
    """
    model, longest = ResponseModel(case, [sensor.position for sensor in case.sensors]), max(rows)
    values, log_information = np.zeros((2, len(alphas), len(starts), len(rows)))
    for a, alpha in enumerate(alphas):
        predicted = model.predict(starts, longest, alpha)
        for k, length in enumerate(rows):
            bin_rows = rows_per_bin(length * len(model.outputs))
            contributions = WindowContributions(case, predicted.first_rows(length), starts, length, bin_rows)
            for w in np.flatnonzero(case.record.contains_windows(starts, length)):
                values[a, w, k], log_information[a, w, k] = _window_criterion(contributions, int(w), criterion, of)
    return values, log_information


def _window_criterion(
    contributions: WindowContributions, window: int, criterion: Criterion, of: ParametersOfInterest
) -> tuple[float, float]:
    """The criterion and the information on ln(alpha) of one window."""
    matrix, each = information_of_window(contributions, window)
    if not each:
        return 0.0, 0.0
    return criterion_of(matrix, criterion, indices_of_interest(of, each)), relative_std(matrix) ** -2.0


def information_of_window(
    contributions: WindowContributions, window: int
) -> tuple[Float[np.ndarray, "param param"], list[Contribution]]:
    """The information matrix of one window, and what each sensor and plate with a reading contributes to it.

    Args:
        window: its index in `contributions.starts`.
    """
    case = contributions.case
    rows = Window(int(contributions.starts[window]), contributions.rows)
    present, flux_present = np.isfinite(case.record.sensors[rows.as_slice]), np.isfinite(flux_readings(case, rows))
    if not present.any() and not flux_present.any():
        return np.zeros((0, 0)), []
    indexed = contributions.contributions_of_case(window, present, flux_present)
    each = [one for _, one in indexed]
    return information_matrix(each, contributions.whitening(indexed)), each


class InitialProfiles(eqx.Module):
    """The dimensionless initial profile of each window, and its derivative by the offset of each sensor, 1/K."""

    initial: Float[Array, "window param"]
    per_offset: Float[Array, "window param sensor"]


def initial_profiles(case: Case, starts: np.ndarray) -> InitialProfiles:
    """The fitted initial profile at each start."""
    scale = scales(case)
    fitted = [fit_profile(case, int(row)) for row in starts]
    initial = [dimensionless_profile(profile.coefficients, scale) for profile in fitted]
    per_offset = [profile.coefficients_per_reading / scale.temperature for profile in fitted]
    return InitialProfiles(on_device(np.stack(initial)), on_device(np.stack(per_offset)))


class PlateSettings(eqx.Module):
    """The properties of the flux plates that the information depends on; empty without plates.

    Args:
        gain_std: prior standard deviation of each plate's calibration error, dimensionless.
        uninformative_rows: number of first rows of a window whose fluxes are not used, for each window length.
    """

    gain_std: Float[Array, " flux"] = eqx.field(converter=on_device)
    uninformative_rows: tuple[int, ...] = eqx.field(static=True)

    @classmethod
    def of_case(cls, case: Case, rows: tuple[int, ...]) -> PlateSettings:
        """The plates of a case, for windows of these lengths."""
        gains = np.full(len(fluxes_of(case)), flux_gain_std(case))
        return cls(gains, tuple(uninformative_rows(case, length, case.record.step) for length in rows))

    def informative_weights(self, weight: Array, uninformative_rows: int) -> Array:
        """The readings' weights, `(time, output)`, with 0 for the first rows of the plates."""
        return weight.at[:uninformative_rows, weight.shape[1] - self.gain_std.shape[0] :].set(0.0)


def record_with_plates(case: Case) -> WindowData:
    """The data of the entire record, the plates after the sensors; fluxes are divided by k / L, K."""
    data, faces = window_data(case), fluxes_of(case)
    if not faces:
        return data
    conductance = wall_conductance(case)
    flux = np.stack([case.record.regressors[f"flux_{face}"] for face in faces], axis=1)
    return append_flux_readings(data, flux / conductance, flux_noise_std(case) / conductance)


def _sensitivities(
    system: StateSpace, fo: Array, data: WindowData, plates: PlateSettings, integrator: Integrator
) -> tuple[Float[Array, "time output"], Float[Array, "time output constant"] | None]:
    """theta, and the readings' derivatives with respect to each nuisance constant, K per prior standard deviation.

    The constants are the estimated offsets, and with plates ln(conductivity) and each calibration error; None without
    any.
    """
    u, theta = explicit(system, fo, data, integrator=integrator)
    columns = [_offset_derivatives(system, fo, data, integrator)] if data.offsets else []
    if count := plates.gain_std.shape[0]:
        flux = data.temperature * u.at[:, : u.shape[1] - count].set(0.0)
        gains = [
            std * flux * jax.nn.one_hot(u.shape[1] - count + p, u.shape[1]) for p, std in enumerate(plates.gain_std)
        ]
        columns.append(jnp.stack([CONDUCTIVITY_STD * flux, *gains], axis=-1))
    return theta, jnp.concatenate(columns, axis=-1) if columns else None


def _offset_derivatives(
    system: StateSpace, fo: Array, data: WindowData, integrator: Integrator
) -> Float[Array, "time output offset"]:
    """The predicted readings' derivatives with respect to each estimated offset, K per prior standard deviation."""

    def column(sensor: Array) -> Array:
        u = profile_response(system, fo, data, -data.profile_per_offset[:, sensor], integrator=integrator)
        return data.offset_std[sensor] * (data.temperature * u + jax.nn.one_hot(sensor, u.shape[1]))

    return jnp.moveaxis(jax.vmap(column)(jnp.asarray(data.offsets)), 0, -1)


def _projected_information(
    theta: Array, weight: Array, columns: Array | None, rows: tuple[int, ...], plates: PlateSettings
) -> Float[Array, " length"]:
    """The information of the first rows on Fo, for each length, with the nuisance constants projected out."""
    information = []
    for length, skipped in zip(rows, plates.uninformative_rows, strict=True):
        used = plates.informative_weights(weight[:length], skipped)
        scaled = theta[:length] * used
        marginal = jnp.sum(scaled**2)
        if columns is not None:
            weighted = columns[:length] * used[:, :, None]
            cross = jnp.einsum("ts,tso->o", scaled, weighted)
            block = jnp.einsum("tso,tsp->op", weighted, weighted)
            marginal = marginal - cross @ jnp.linalg.solve(block + jnp.eye(len(cross)), cross)
        information.append(marginal)
    return jnp.stack(information)


def window_information(
    system: StateSpace,
    fourier: Float[Array, " case"],
    data: WindowData,
    starts: Int[Array, " window"],
    profiles: InitialProfiles,
    plates: PlateSettings,
    *,
    rows: tuple[int, ...],
    sweep: Sweep = "map",
    integrator: Integrator = "propagator",
    mesh: Mesh | None = None,
) -> Float[Array, "case window length"]:
    """The information of each window on Fo, with theta = 0 at each window's start.

    Args:
        system, data: outputs are the sensors, then the plates, as in `record_with_plates`.
        fourier: Fo of each diffusivity.
        starts: first rows of the windows.
        profiles: the initial profile at each start.
        plates: of windows with these lengths.
        rows: lengths of the windows; all come from one simulation of the longest. After the end of the record there
            are no readings.
        sweep, mesh: as in `wallid.models.sweep`.

    Returns:
        information per squared dimensionless temperature, `(diffusivity, window, length)`.
    """
    beyond = (0, max(rows))
    inputs = np.pad(np.asarray(data.inputs), (beyond, (0, 0)), mode="edge")
    inputs[data.inputs.shape[0] :, 2:] = 0.0  # constant faces have no slopes
    weight = np.pad(np.asarray(data.weight), (beyond, (0, 0)))
    extended = eqx.tree_at(lambda d: (d.inputs, d.weight), data, (on_device(inputs), on_device(weight)))
    shared = (system, fourier, extended, plates, rows, sweep, integrator)
    return jnp.moveaxis(over_items(_single_window_information, (starts, profiles), *shared, way=sweep, mesh=mesh), 0, 1)


def _single_window_information(
    window: tuple[Array, InitialProfiles],
    system: StateSpace,
    fourier: Array,
    extended: WindowData,
    plates: PlateSettings,
    rows: tuple[int, ...],
    sweep: Sweep,
    integrator: Integrator,
) -> Float[Array, "case length"]:
    """The information of one window, at each diffusivity and for each length."""
    (start, profile), longest = window, max(rows)
    inputs, weight = (
        jax.lax.dynamic_slice_in_dim(array, start, longest) for array in (extended.inputs, extended.weight)
    )
    data = eqx.tree_at(
        lambda d: (d.inputs, d.initial, d.profile_per_offset), extended, (inputs, profile.initial, profile.per_offset)
    )

    def at(fo: Array) -> Array:
        theta, columns = _sensitivities(system, fo, data, plates, integrator)
        return _projected_information(theta, weight, columns, rows, plates)

    return jax.vmap(at)(fourier) if sweep == "vmap" else jax.lax.map(at, fourier)


@eqx.filter_jit
def information_from_one_run(
    system: StateSpace,
    fourier: Float[Array, " case"],
    data: WindowData,
    starts: Int[Array, " window"],
    plates: PlateSettings,
    *,
    rows: int,
    integrator: Integrator = "propagator",
) -> Float[Array, "case window"]:
    """The information of each window on Fo, with theta cut from one simulation of the entire record.

    Fluxes are used in all rows except the first ones of the record. Returns `(diffusivity, window)`.
    """
    all_rows = PlateSettings(plates.gain_std, (0,))

    def at(fo: Array) -> Array:
        theta, columns = _sensitivities(system, fo, data, plates, integrator)
        record = (theta, plates.informative_weights(data.weight, plates.uninformative_rows[0]), columns)

        def one(start: Array) -> Array:
            window = jax.tree.map(lambda array: jax.lax.dynamic_slice_in_dim(array, start, rows), record)
            return _projected_information(window[0], window[1], window[2], (rows,), all_rows)[0]

        return jax.lax.map(one, starts)

    return jax.lax.map(at, fourier)
