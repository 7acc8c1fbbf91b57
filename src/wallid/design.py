"""The optimal experiment design: which days of a record tell most about the diffusivity.

For the window of rows `W` and the readings' standard deviations `sigma`::

    I(W) = sum_s [ sum_t (dT/dalpha)^2 / sigma_s^2  -  (sum_t dT/dalpha / sigma_s^2)^2 / (n_s/sigma_s^2 + 1/sigma_b^2) ]

with `dT/dalpha = theta T_ref t_ref / L^2`; the second term projects out a sensor's constant offset
where the case states its `offset_std` sigma_b. With one parameter the D-criterion `det F` is I.
The paper integrates over time where readings are what counts, and takes one sigma.

Source: Berger and Kadoch, Section 4.1; Ucinski, Optimal Measurement Methods (2004), 2.3.
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
from .simulate import propagate
from .statespace import StateSpace

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
    model: StateSpace | None = None,
) -> Design:
    """The best window of a case's record, by the large model at the prior diffusivity.

    Arguments:
        window_days: None for the case's choice.
        diffusivities: None for the prior alone; the best window is the first one's.
        every_rows: distance of the candidates' starts; None for one a day (all where the record has
            fewer than two days to spare).
        restart: theta from 0 and a profile fitted at each window's start, as the estimate sees it;
            False cuts one theta of the whole record, as the paper does.
        sweep: how the windows are gone through; the same numbers.
        model: a large model at hand, to spare building it.

    Raises:
        InputError: an unknown sweep.
    """
    one_of("sweep", sweep, ("map", "vmap"))
    record = case.record
    days = case.choices.window_days if window_days is None else window_days
    rows = window_rows(case, days)
    starts = candidate_starts(record.rows, rows, every_rows or max(1, round(86400.0 / record.step)))
    alphas = (case.wall.diffusivity_prior,) if diffusivities is None else tuple(diffusivities)
    system = large_model(case) if model is None else model
    scale = scales(case)
    data = experiment(case)
    fourier = jnp.asarray([scale.fourier(alpha) for alpha in alphas])
    if restart:
        profiles = start_profiles(case, starts)
        info = window_information(system, fourier, data, jnp.asarray(starts), profiles, rows=(rows,), sweep=sweep)[
            :, :, 0
        ]
    else:
        info = cut_information(system, fourier, data, jnp.asarray(starts), rows=rows)
    per_alpha = scale.fourier(1.0) * scale.temperature
    information = np.asarray(info) * per_alpha**2
    best = int(np.argmax(information[0]))
    row = int(starts[best])
    return Design(
        rows=rows,
        starts=starts,
        diffusivities=alphas,
        information=information,
        best=Window(row, rows, 1.0),
        restart=restart,
        step=record.step,
        labels=(str(record.stamp(row)), str(record.stamp(row + rows))),
    )


def start_profiles(case: Case, starts: np.ndarray) -> Float[Array, "window param"]:
    """The dimensionless initial profile of each window."""
    scale = scales(case)
    fitted = [dimensionless_profile(fit_profile(case, int(row)).coefficients, scale) for row in starts]
    return jnp.asarray(np.stack(fitted))


def candidate_starts(record_rows: int, rows: int, every: int) -> np.ndarray:
    """First rows of windows of `rows` rows inside a record, `every` rows apart."""
    spare = record_rows - rows
    return np.arange(0, spare + 1, min(every, max(1, spare // 2)))


def _information(theta: Array, weight: Array, offset_std: Array) -> Float[Array, " time"]:
    """Information on Fo (in u) of the readings up to each row, constant offsets projected out."""
    scaled = theta * weight
    direct = jnp.cumsum(scaled**2, axis=0)
    precision = jnp.where(offset_std > 0, 1.0 / jnp.where(offset_std > 0, offset_std, 1.0) ** 2, jnp.inf)
    shared = jnp.cumsum(scaled * weight, axis=0) ** 2 / (jnp.cumsum(weight**2, axis=0) + precision)
    return jnp.sum(direct - shared, axis=1)


@eqx.filter_jit
def window_information(
    system: StateSpace,
    fourier: Float[Array, " case"],
    data: Experiment,
    starts: Int[Array, " window"],
    profiles: Float[Array, "window param"],
    *,
    rows: tuple[int, ...],
    sweep: Sweep = "map",
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

    def one(fo: Array, start: Array, profile: Array) -> Array:
        inputs = jax.lax.dynamic_slice_in_dim(inputs_on, start, longest)
        weight = jax.lax.dynamic_slice_in_dim(weight_on, start, longest)
        _, theta = propagate(system, fo, data.step, inputs, profile, sensitivity=True)
        assert theta is not None
        return _information(theta, weight, data.offset_std)[np.asarray(rows) - 1]

    if sweep == "vmap":
        windows = jax.vmap(one, in_axes=(None, 0, 0))
        return jax.vmap(windows, in_axes=(0, None, None))(fourier, starts, profiles)
    return jax.lax.map(lambda fo: jax.lax.map(lambda window: one(fo, *window), (starts, profiles)), fourier)


@eqx.filter_jit
def cut_information(
    system: StateSpace,
    fourier: Float[Array, " case"],
    data: Experiment,
    starts: Int[Array, " window"],
    *,
    rows: int,
) -> Float[Array, "case window"]:
    """The information of each window on Fo (in u), cut from one run over the whole record."""

    def at(fo: Array) -> Array:
        _, theta = propagate(system, fo, data.step, data.inputs, data.initial, sensitivity=True)
        assert theta is not None

        def one(start: Array) -> Array:
            cut = jax.lax.dynamic_slice_in_dim(theta, start, rows)
            weight = jax.lax.dynamic_slice_in_dim(data.weight, start, rows)
            return _information(cut, weight, data.offset_std)[-1]

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
        return "\n".join(f"{d:6.2f} days  criterion {c:.3f}  estimate {1e3 * s:.2f} ms" for d, c, s in rows)


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
    every = max(1, round(86400.0 / case.record.step))
    starts = candidate_starts(case.record.rows, min(rows), every)
    fourier = jnp.asarray([scales(case).fourier(case.wall.diffusivity_prior)])
    information = np.asarray(
        window_information(
            large_model(case), fourier, experiment(case), jnp.asarray(starts), start_profiles(case, starts), rows=rows
        )
    )[0]
    best, seconds = [], []
    for k, length in enumerate(days):
        whole = np.where(starts + rows[k] <= case.record.rows, information[:, k], -np.inf)
        best.append(whole.max())
        seconds.append(cost(Window(int(starts[np.argmax(whole)]), rows[k])))
        on_length(length)
    return Lengths(np.asarray(days, float), np.array(best) / max(best), np.array(seconds))
