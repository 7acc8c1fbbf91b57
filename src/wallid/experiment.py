"""A window of a case in the form that models take: inputs, initial profile, readings, weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._arrays import on_device
from ._columns import FEWEST_ROWS
from ._units import DAY
from .case import Case
from .lom import Output, lom
from .loops import in_lanes
from .statespace import StateSpace
from .wall import SIDES, InputError, Scales

STILL = 1e-6  # K: a face that moves less did not move


@dataclass(frozen=True)
class Window:
    """Consecutive rows of a record.

    Arguments:
        row: the first.
        rows: how many.
    """

    row: int
    rows: int

    @property
    def part(self) -> slice:
        """These rows of the record's arrays."""
        return slice(self.row, self.row + self.rows)


@runtime_checkable
class HasBest(Protocol):
    """A design: what chose a window."""

    @property
    def best(self) -> Window:
        """The chosen window."""
        ...


def as_window(window: Window | HasBest) -> Window:
    """The window itself, or a design's best one."""
    return window if isinstance(window, Window) else window.best


class Experiment(eqx.Module):
    """What a model is driven with and compared to, over one window.

    Arguments:
        step: of the rows, in t_ref.
        inputs: dimensionless face temperatures (left, right).
        initial: dimensionless coefficients of the initial profile in x*.
        observed: sensors' readings in degC, 0 where missing.
        weight: per reading, one over its standard deviation in K; 0 where missing.
        offset_std: of each sensor's constant offset, K; 0 where none is estimated.
        profile_per_offset: how the initial profile, fitted through readings, moves with each sensor's
            offset, 1/K; zero for a profile that was given.
        temperature, temperature_min: T = temperature_min + temperature u.
        offsets: the sensors with an offset, by place.
    """

    step: Float[Array, ""] = eqx.field(converter=on_device)
    inputs: Float[Array, "time input *lane"] = eqx.field(converter=on_device)
    initial: Float[Array, " param"] = eqx.field(converter=on_device)
    observed: Float[Array, "time sensor *lane"] = eqx.field(converter=on_device)
    weight: Float[Array, "time sensor *lane"] = eqx.field(converter=on_device)
    offset_std: Float[Array, " sensor"] = eqx.field(converter=on_device)
    profile_per_offset: Float[Array, "param sensor"] = eqx.field(converter=on_device)
    temperature: Float[Array, ""] = eqx.field(converter=on_device)
    temperature_min: Float[Array, ""] = eqx.field(converter=on_device)
    offsets: tuple[int, ...] = eqx.field(static=True, default=())

    def celsius(self, u: Array) -> Array:
        """Dimensionless temperatures in degC."""
        return self.temperature_min + self.temperature * u

    @property
    def has_lanes(self) -> bool:
        """Whether its rows lie in lanes."""
        return self.inputs.ndim == 3

    def in_lanes(self) -> Experiment:
        """The same with the rows in lanes, `(step, column, lane)`; past the last row no reading has a weight."""
        rows = self.inputs, self.observed, self.weight
        return eqx.tree_at(
            lambda data: (data.inputs, data.observed, data.weight), self, [in_lanes(part) for part in rows]
        )

    def starting_from(self, initial: Float[Array, " param"]) -> Experiment:
        """The same window from another initial profile."""
        return eqx.tree_at(lambda data: data.initial, self, initial)

    @property
    def time(self) -> Float[Array, " time"]:
        """The rows' times in t_ref, from the window's start."""
        return self.step * jnp.arange(self.inputs.shape[0])


@dataclass(frozen=True)
class Profile:
    """An initial profile `T(x, 0) = sum_k a_k x*^k` fitted through the faces and sensors.

    Arguments:
        coefficients: a_k in degC.
        per_reading: how each sensor's reading moves them, `(param, sensor)`, 1.
        eps_2: root mean square of the fit, K; None where the profile was given.
    """

    coefficients: np.ndarray
    per_reading: np.ndarray
    eps_2: float | None


def scales(case: Case) -> Scales:
    """The reference values: a day, 20 K, and the faces' lowest whole degree."""
    return Scales.of(case.wall, temperature_min=float(np.floor(case.record.faces.min())))


def profile_degree(case: Case) -> int:
    """The degree of the initial profile's polynomial in this case's models."""
    given = [case.choices.initial_coefficients or (), *(signal.coefficients for signal in case.learning)]
    return max(case.choices.initial_profile, *(len(coefficients) - 1 for coefficients in given))


def whole(case: Case) -> Window:
    """The whole record, or the longest of its parts where it is broken."""
    return Window(*case.record.longest_part)


def diagnosed(case: Case) -> Window:
    """The rows that a diagnosis uses: `diagnose_days` from the beginning of the whole record (see `whole`)."""
    part, days = whole(case), case.choices.diagnose_days
    return part if days is None else Window(part.row, min(case.record.rows_per(days), part.rows))


def check_unbroken(case: Case, window: Window) -> None:
    """Refuse a window across a break of the record.

    Raises:
        InputError: one of its rows is broken.
    """
    record = case.record
    inside = window.row >= 0 and window.row + window.rows <= record.rows  # or else Record.window will say so
    if inside and not record.holds(window.row, window.rows):
        first = next(b for b in record.cleaning.breaks if b.row + b.rows > window.row)
        raise InputError(
            f"{record.file}: a window of {window.rows} rows from {record.stamp(window.row)} lies across a break of the "
            f"record ({first}); take another window, or state a longer [record] longest_gap (hours)"
        )


def window_rows(case: Case, days: float) -> int:
    """How many rows a window of so many days has; all of a record that holds one row more.

    Raises:
        InputError: more than the record holds without a break, or too few to tell anything.
    """
    rows, most = case.record.rows_per(days), whole(case).rows
    if not FEWEST_ROWS <= rows <= most:
        own = (
            "the record's own"
            if most == case.record.rows
            else (
                f"those of its longest unbroken part ({most * case.record.step / DAY:.4g} days; a longer [record] "
                "longest_gap breaks it less)"
            )
        )
        raise InputError(
            f"window_days = {days:g} makes {rows} rows of {case.record.step:g} s; it must make {FEWEST_ROWS} to "
            f"{most}, {own}"
        )
    return case.record.rows if case.record.rows - rows == 1 else rows


def fit_profile(case: Case, row: int) -> Profile:
    """The initial profile of a window that starts at `row`.

    A least-squares polynomial through the faces and the sensors that have a reading there, of the
    degree chosen or the highest that these points give. The case's given coefficients hold at the
    record's first row.
    """
    count = profile_degree(case) + 1
    given = case.choices.initial_coefficients
    if given is not None and row == 0:
        still = np.zeros((count, len(case.sensors)))
        return Profile(np.pad(np.asarray(given, float), (0, count - len(given))), still, None)
    record, length = case.record, case.wall.length
    places = np.array([0.0, 1.0, *(sensor.position / length for sensor in case.sensors)])
    readings = np.concatenate([record.faces[row], record.sensors[row]])
    there = np.isfinite(readings)
    degree = min(case.choices.initial_profile, int(there.sum()) - 1)
    basis = np.vander(places[there], degree + 1, increasing=True)
    per_reading = np.zeros((count, len(places)))
    per_reading[: degree + 1, there] = np.linalg.pinv(basis)
    coefficients = per_reading[:, there] @ readings[there]
    misfit = basis @ coefficients[: degree + 1] - readings[there]
    return Profile(coefficients, per_reading[:, 2:], float(np.sqrt(np.mean(misfit**2))))


def dimensionless_profile(coefficients: np.ndarray, scale: Scales) -> np.ndarray:
    """A profile's coefficients in u: the constant alone carries T_min."""
    shifted = np.array(coefficients, float)
    shifted[0] -= scale.temperature_min
    return shifted / scale.temperature


def experiment(case: Case, window: Window | None = None, *, weighted: bool = True) -> Experiment:
    """A window of a case (None: its whole record, straight lines across its breaks) for estimation.

    Arguments:
        weighted: each reading by its sensor's noise; False gives the paper's plain sum of squares (all
            readings by one noise, the sensors' root mean square).

    Raises:
        InputError: no inner sensor has a reading in the window, or the record breaks in it.
    """
    if window is None:
        window = Window(0, case.record.rows)
    else:
        check_unbroken(case, window)
    part = case.record.window(window.row, window.rows)
    scale = scales(case)
    noise = np.array([sensor.noise_std for sensor in case.sensors])
    if not weighted:
        noise = np.full_like(noise, np.sqrt(np.mean(noise**2)))
    profile = fit_profile(case, window.row)
    offset_std = np.array([sensor.offset_std for sensor in case.sensors])
    present = np.isfinite(part.sensors)
    if not present.any() and not (part.regressors.keys() & {"flux_left", "flux_right"}):
        raise InputError(
            f"{case.record.file}: no inner sensor has a reading from {part.stamp(0)} on, over {window.rows} rows; "
            "take another window"
        )
    return Experiment(
        step=part.step / scale.time,
        inputs=scale.dimensionless(part.faces),
        initial=dimensionless_profile(profile.coefficients, scale),
        observed=np.where(present, part.sensors, 0.0),
        weight=present / noise,
        offset_std=offset_std,
        profile_per_offset=profile.per_reading / scale.temperature,
        temperature=scale.temperature,
        temperature_min=scale.temperature_min,
        offsets=tuple(int(s) for s in np.flatnonzero(offset_std > 0)),
    )


def large_model(case: Case, extra: Sequence[Output] = ()) -> StateSpace:
    """The case's large model in its modes; outputs are the sensors, then `extra`.

    Raises:
        InputError: the case has no inner sensor, or fewer nodes than its layers need.
    """
    if not case.sensors and not extra:
        raise InputError(
            f"{case.path}: no [[sensor]]: this needs a temperature inside the wall; `wallid run`, `wallid design` and "
            "`wallid estimate` take a case with heat flux alone"
        )
    sensors = [Output(sensor.position, name=sensor.name) for sensor in case.sensors]
    degree = profile_degree(case)
    return lom(case.wall, [*sensors, *extra], nodes=case.choices.nodes, profile_degree=degree).modal()


def check_driven(model: StateSpace, case: Case, window: Window | None = None) -> None:
    """Refuse to drive a reduced model by a face that its learning never moved.

    Raises:
        InputError: such a face moves in this window, or does not meet the initial profile.
    """
    window = whole(case) if window is None else window
    faces = np.asarray(case.record.window(window.row, window.rows).faces)
    coefficients = fit_profile(case, window.row).coefficients
    ends = np.array([coefficients[0], coefficients.sum()])
    largest = np.max(np.abs(faces - ends), axis=0)
    for side, name in enumerate(SIDES):
        if not model.driven[side] and largest[side] > STILL:
            raise InputError(
                f"record: the {name} face moves by up to {largest[side]:.3g} K from the initial profile, and the "
                f"reduced model never learned what the {name} face does; add a learning signal in which it "
                'moves ([[learning.signal]]), or use [choices] model = "lom"'
            )
