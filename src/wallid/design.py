"""The optimal experiment design: which days of a record tell most about the diffusivity.

For the window of rows `W` and the readings' standard deviations `sigma`::

    I(W) = S_aa - S_ab (S_bb + diag(1/sigma_b^2))^-1 S_ba,      S_pq = sum_s sum_t dT/dp dT/dq / sigma_s^2

with `dT/dalpha = theta T_ref t_ref / L^2` and b the constant offsets of the sensors whose case states
an `offset_std` sigma_b: they are projected out, and with them what they make of the initial profile,
which is fitted through the readings. With one parameter the D-criterion `det F` is I.
The paper integrates over time where readings are what counts, and takes one sigma.

Source: Berger and Kadoch, Section 4.1; Ucinski, Optimal Measurement Methods (2004).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ._fields import one_of
from .case import Case
from .experiment import (
    Experiment,
    Window,
    dimensionless_profile,
    experiment,
    fit_profile,
    large_model,
    scales,
    window_rows,
)
from .record import Record
from .sensitivity import profile_response
from .simulate import Integrator, run_rows
from .statespace import StateSpace
from .wall import InputError

_HOPELESS = 1e3  # relative standard error

Sweep = Literal["map", "vmap"]
"""One window after the other (faster on a CPU), or all at once."""


@dataclass(frozen=True)
class Design:
    """The D-criterion of every candidate window.

    Arguments:
        rows: of each window.
        starts: first rows of the candidates.
        diffusivities: at which the criterion was taken, m2/s.
        information: expected information on alpha, (m2/s)^-2, `(diffusivity, window)`; its inverse
            square root is the standard error that the noise alone would leave.
        best: the window with the largest criterion at the first diffusivity.
        restart: theta starts at 0 in each window, as in the estimate; else cut from one run.
    """

    rows: int
    starts: np.ndarray = field(repr=False)
    diffusivities: tuple[float, ...]
    information: np.ndarray = field(repr=False)
    best: Window
    restart: bool
    step: float
    labels: tuple[str, str]

    @property
    def criterion(self) -> np.ndarray:
        """The D-criterion over its largest value, per diffusivity and window, 1."""
        largest = self.information.max(axis=1, keepdims=True)
        return self.information / np.where(largest > 0, largest, 1.0)

    @property
    def start_days(self) -> np.ndarray:
        """The candidates' starts in days after the record's."""
        return self.starts * self.step / 86400.0

    @property
    def expected_error(self) -> float:
        """The relative standard error that the sensors' noise alone leaves in the best window, 1."""
        most = float(self.information[0].max())
        return float(1.0 / np.sqrt(most) / self.diffusivities[0]) if most > 0 else np.inf

    @property
    def informative(self) -> bool:
        """Whether any window holds information at all; an estimate need not be tried where none does.

        The bar is low, since the prior diffusivity may be far off.
        """
        return self.expected_error < _HOPELESS

    def __str__(self) -> str:
        if not self.informative:
            return (
                f"no window of {self.rows} rows tells anything about the diffusivity: the faces stand still, "
                "or no inner sensor has a reading while they move"
            )
        near = int(np.sum(self.criterion[0] >= 0.98))
        return (
            f"best window  {self.labels[0]} to {self.labels[1]} ({self.rows} rows), of {len(self.starts)} candidates\n"
            f"criterion    at alpha = {self.diffusivities[0]:.3g} m2/s; {near} candidate(s) within 2 % of the largest\n"
            f"expected     a relative standard error of {self.expected_error:.2%} from the sensors' noise alone"
        )


def design(
    case: Case,
    *,
    window_days: float | None = None,
    diffusivities: Sequence[float] | None = None,
    every_rows: int | None = None,
    restart: bool = True,
    sweep: Sweep = "map",
    integrator: Integrator = "propagator",
    model: StateSpace | None = None,
) -> Design:
    """The best window of a case's record, by the large model at the prior diffusivity.

    Arguments:
        window_days: None for the case's choice.
        diffusivities: None for the prior alone; the best window is the first one's.
        every_rows: distance of the candidates' starts; None for one a day, or three where the record is
            hardly longer than the window.
        restart: theta from 0 and a profile fitted at each window's start, as the estimate sees it;
            False cuts one theta of the whole record, as the paper does (across a break of the record it
            goes along a straight line).
        sweep: how the windows are gone through; the same numbers.
        integrator: how the windows' rows are stepped through.
        model: a large model at hand, to spare building it.

    Raises:
        InputError: a window that the record does not hold, or an unknown sweep.
    """
    one_of("sweep", sweep, ("map", "vmap"))
    record = case.record
    days = case.choices.window_days if window_days is None else window_days
    rows = window_rows(case, days)
    if every_rows is not None and every_rows < 1:
        raise InputError(f"every_rows = {every_rows}; it must be at least 1")
    starts = candidate_starts(record, rows, every_rows)
    alphas = (case.wall.diffusivity_prior,) if diffusivities is None else tuple(diffusivities)
    system = large_model(case) if model is None else model
    scale = scales(case)
    data = experiment(case)
    fourier = jnp.asarray([scale.fourier(alpha) for alpha in alphas])
    if restart:
        profiles = start_profiles(case, starts)
        info = window_information(
            system, fourier, data, jnp.asarray(starts), profiles, rows=(rows,), sweep=sweep, integrator=integrator
        )[:, :, 0]
    else:
        info = cut_information(system, fourier, data, jnp.asarray(starts), rows=rows, integrator=integrator)
    per_alpha = scale.fourier(1.0) * scale.temperature
    information = np.asarray(info) * per_alpha**2
    best = int(np.argmax(information[0]))
    row = int(starts[best])
    return Design(
        rows=rows,
        starts=starts,
        diffusivities=alphas,
        information=information,
        best=Window(row, rows),
        restart=restart,
        step=record.step,
        labels=(str(record.stamp(row)), str(record.stamp(row + rows))),
    )


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


def candidate_starts(record: Record, rows: int, every: int | None) -> np.ndarray:
    """First rows of windows of `rows` rows inside a record, `every` rows (None: about a day) apart, none on a break."""
    spare = record.longest_part[1] - rows
    if every is None:
        every = min(max(1, round(86400.0 / record.step)), max(1, spare // 2))
    return np.concatenate([np.arange(first, first + part - rows + 1, every) for first, part in record.unbroken])


def _offset_columns(
    system: StateSpace, fo: Array, data: Experiment, per_offset: Array, rows: int, integrator: Integrator
) -> Float[Array, "time sensor offset"]:
    """What one kelvin of each estimated offset makes of the predicted readings, K."""
    places = np.asarray(data.offsets)

    def column(place: Array) -> Array:
        u = profile_response(system, fo, data.step, rows, -per_offset[:, place], integrator=integrator)
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


@eqx.filter_jit
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
) -> Float[Array, "case window length"]:
    """The information of each window on Fo (in u), theta restarted at each window's start.

    Arguments:
        starts: first rows of the windows.
        profiles: the initial profile at each start.
        rows: the windows' lengths; all come from one run of the longest. What would lie past the
            record's end holds no readings.
    """
    longest = max(rows)
    inputs_on = jnp.pad(data.inputs, ((0, longest), (0, 0)), mode="edge")
    weight_on = jnp.pad(data.weight, ((0, longest), (0, 0)))
    offset_std = data.offset_std[np.asarray(data.offsets, dtype=int)]

    def one(fo: Array, window: tuple[Array, StartProfiles]) -> Array:
        start, profile = window
        inputs = jax.lax.dynamic_slice_in_dim(inputs_on, start, longest)
        weight = jax.lax.dynamic_slice_in_dim(weight_on, start, longest)
        _, theta = run_rows(system, fo, data.step, inputs, profile.initial, sensitivity=True, integrator=integrator)
        assert theta is not None
        columns = None
        if data.offsets:
            columns = _offset_columns(system, fo, data, profile.per_offset, longest, integrator)
        return _information(theta, weight, columns, offset_std, rows)

    windows = (starts, profiles)
    if sweep == "vmap":
        return jax.vmap(lambda fo: jax.vmap(lambda window: one(fo, window))(windows))(fourier)
    return jax.lax.map(lambda fo: jax.lax.map(lambda window: one(fo, window), windows), fourier)


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
    whole = data.inputs.shape[0]
    offset_std = data.offset_std[np.asarray(data.offsets, dtype=int)]

    def at(fo: Array) -> Array:
        _, theta = run_rows(system, fo, data.step, data.inputs, data.initial, sensitivity=True, integrator=integrator)
        assert theta is not None
        columns = None
        if data.offsets:
            columns = _offset_columns(system, fo, data, data.profile_per_offset, whole, integrator)
        everything = (theta, data.weight, columns)

        def one(start: Array) -> Array:
            cut = jax.tree.map(lambda part: jax.lax.dynamic_slice_in_dim(part, start, rows), everything)
            return _information(cut[0], cut[1], cut[2], offset_std, (rows,))[0]

        return jax.lax.map(one, starts)

    return jax.lax.map(at, fourier)


@dataclass(frozen=True)
class Lengths:
    """The paper's compromise: what a longer window gives, and what its estimate costs.

    Arguments:
        days: the windows' lengths.
        criterion: the best window's information, over the longest's, 1.
        seconds: of one estimate.
    """

    days: np.ndarray
    criterion: np.ndarray
    seconds: np.ndarray

    def __str__(self) -> str:
        rows = zip(self.days, self.criterion, self.seconds, strict=True)
        lines = [f"  {d:6.2f} days   criterion {c:5.3f}   {1e3 * s:6.2f} ms" for d, c, s in rows]
        return "\n".join(["lengths      the best window of each, and what its estimate costs", *lines])


def lengths(
    case: Case,
    days: Sequence[float],
    cost: Callable[[Window], float],
    *,
    on_length: Callable[[float], None] = lambda days: None,
) -> Lengths:
    """The criterion of the best window of each length, and what its estimate costs.

    Arguments:
        cost: seconds of an estimate from a window, such as `seconds_of_estimate` measures.
        on_length: told of each length when it is done.
    """
    rows = tuple(window_rows(case, length) for length in days)
    starts = candidate_starts(case.record, min(rows), None)
    fourier = jnp.asarray([scales(case).fourier(case.wall.diffusivity_prior)])
    information = np.asarray(
        window_information(
            large_model(case), fourier, experiment(case), jnp.asarray(starts), start_profiles(case, starts), rows=rows
        )
    )[0]
    best, seconds = [], []
    for k, length in enumerate(days):
        whole = np.where(case.record.holds(starts, rows[k]), information[:, k], -np.inf)
        best.append(whole.max())
        seconds.append(cost(Window(int(starts[np.argmax(whole)]), rows[k])))
        on_length(length)
    return Lengths(np.asarray(days, float), np.array(best) / max(best), np.array(seconds))
