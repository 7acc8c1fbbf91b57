"""What an effect is: a change of the wall's equation, its faces or its readings, zero at its neutral value.

The plain model is one homogeneous (or stated) wall between two measured faces. `Terms` holds everything
that may be missing from it, at its neutral value; an effect adds its own to these, and so effects compose
in any number and any order::

    gamma(T, x) dT/dt = d/dx (alpha s(t) kappa(T, x) dT/dx) - v dT/dx + sum_a s_a (T_a - T) + q(x, t)

with `gamma` and `kappa` relative to the wall's effective capacity and conductivity.
"""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Iterator
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..record import Record

__all__ = [
    "CONSTANT",
    "DERIVATIVE",
    "AbstractEffect",
    "Campaign",
    "Parameter",
    "Search",
    "Source",
    "Step",
    "Terms",
    "Wetting",
]


POWERS = 4
"""Coefficients of a cubic between two rows, in powers of s from 0 to 1."""
CONSTANT = np.eye(POWERS)[0]
"""Of a course that is 1 all the time."""
DERIVATIVE = np.diag(np.arange(1.0, POWERS), -1)
"""`c @ DERIVATIVE` are the coefficients of the derivative by s."""


class Campaign(eqx.Module):
    """What a wall was driven with over some rows, and where it was read.

    Between rows everything is a monotone cubic `sum_j c_j s^j`, s from 0 at a row to 1 at the next.

    Arguments:
        step: from row to row, s.
        faces: coefficients of the two face readings, degC.
        irradiance: W/m2. outdoor, indoor: air, degC. heating: 1 (0 to 1). Zeros where not logged.
        hour: of the day, h, at each row.
        start_profile: temperature at the first row, a straight line between the faces at each end, degC.
        reference: T0, the mean of all face and inner readings, degC.
        places: of the nodes, faces included, m.
        resistance: of each cell between nodes, over that of a metre of the wall's effective material, m.
        capacity: of each node's cell, over that of a metre, m.
        position: of the inner sensors as stated, m.
        length: of the wall, m.
    """

    step: Float[Array, ""]
    faces: Float[Array, "interval power face"]
    irradiance: Float[Array, "interval power"]
    outdoor: Float[Array, "interval power"]
    indoor: Float[Array, "interval power"]
    heating: Float[Array, "interval power"]
    hour: Float[Array, " interval"]
    start_profile: Float[Array, " face"]
    reference: Float[Array, ""]
    places: Float[Array, " node"]
    resistance: Float[Array, " cell"]
    capacity: Float[Array, " node"]
    position: Float[Array, " sensor"]
    length: Float[Array, ""]

    @property
    def intervals(self) -> int:
        """Rows less one."""
        return self.faces.shape[0]


class Step(NamedTuple):
    """A step of a logarithm, or a joint, at a place (m)."""

    size: Array
    place: Array


class Wetting(NamedTuple):
    """A diffusivity that jumps by a factor 1 + `jump` at `time` (s) and comes back with `time_constant` (s)."""

    jump: Array
    time_constant: Array
    time: Array


class Source(NamedTuple):
    """Heat: `rate` (K/s) times `shape` at the nodes (None: everywhere 1) times a course in time."""

    rate: Array
    place: Array | None
    course: Float[Array, "interval power"]


class Terms(eqx.Module):
    """Everything that effects change, at its neutral value; see the module for the equation.

    Arguments:
        faces: what the model takes for the two readings, degC.
        depth: how deep inside the wall each face's reading is, m.
        film: conductivity over film coefficient at each face, m.
        conductivity_steps, capacity_steps: log ratio right over left of a place.
        joints: resistance times conductivity at a place, m.
        conductivity_slope, capacity_slope: about T0, 1/K.
        latent: (area in K, temperature in degC) of bumps of the capacity.
        drift: of the diffusivity, 1/day. wettings: jumps of it.
        loss: to outdoor and indoor air, 1/s. velocity: m/s. sources: of heat.
        position: of each sensor beyond the stated one, m. lag: s. delay: of all inner rows, s.
        gain: 1. offset: K. rate: K/day.
    """

    faces: Float[Array, "interval power face"]
    depth: Float[Array, " face"]
    film: Float[Array, " face"]
    conductivity_steps: tuple[Step, ...]
    capacity_steps: tuple[Step, ...]
    joints: tuple[Step, ...]
    conductivity_slope: Float[Array, ""]
    capacity_slope: Float[Array, ""]
    latent: tuple[Step, ...]
    drift: Float[Array, ""]
    wettings: tuple[Wetting, ...]
    loss: Float[Array, " air"]
    velocity: Float[Array, ""]
    sources: tuple[Source, ...]
    position: Float[Array, " sensor"]
    lag: Float[Array, " sensor"]
    delay: Float[Array, ""]
    gain: Float[Array, " sensor"]
    offset: Float[Array, " sensor"]
    rate: Float[Array, " sensor"]

    @classmethod
    def plain(cls, campaign: Campaign) -> Terms:
        """The terms of a wall from which nothing is missing."""
        zero, two = jnp.zeros(()), jnp.zeros(2)
        each = jnp.zeros_like(campaign.position)
        return cls(
            faces=campaign.faces,
            depth=two,
            film=two,
            conductivity_steps=(),
            capacity_steps=(),
            joints=(),
            conductivity_slope=zero,
            capacity_slope=zero,
            latent=(),
            drift=zero,
            wettings=(),
            loss=two,
            velocity=zero,
            sources=(),
            position=each,
            lag=each,
            delay=zero,
            gain=each,
            offset=each,
            rate=each,
        )

    def add(self, **changes: Any) -> Terms:
        """These terms with something added to some: numbers are added up, tuples are joined."""
        return dataclasses.replace(self, **{name: getattr(self, name) + change for name, change in changes.items()})


@dataclasses.dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Arguments:
        name: as in result.json.
        unit: of `name`.
        scale: a typical size, by which the search is scaled.
        worth: the smallest size worth reporting; None for a parameter that only says where or when.
        least, most: bounds; None where there is none (or where it follows from the wall or the record).
    """

    name: str
    unit: str
    scale: float
    worth: float | None = None
    least: float | None = None
    most: float | None = None

    @property
    def is_size(self) -> bool:
        """Whether its neutral value 0 gives the plain model back."""
        return self.worth is not None


@dataclasses.dataclass(frozen=True)
class Search:
    """What bounds a search for places, times and temperatures.

    Arguments:
        length: of the wall, m.
        places: candidates for interfaces, m, between the outermost sensors.
        duration: of the record, s.
        rain: when rain events began, s since the first row; empty where no rain was logged.
        coldest, warmest: of all readings, degC.
    """

    length: float
    places: tuple[float, ...]
    duration: float
    rain: tuple[float, ...]
    coldest: float
    warmest: float


class AbstractEffect(eqx.Module):
    """An effect at its parameters' values; every parameter is a field of the same name.

    Class attributes: `name`, `parameters` (the first is the size, 0 where neutral), `linear` (whether the
    wall stays linear and its coefficients constant in time), `needs` (regressors).
    """

    name: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    linear: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = ()

    @property
    def target(self) -> str | int | None:
        """Which face, air or (as a number) inner sensor it is about; None for the wall as a whole."""
        return None

    @property
    def variant(self) -> str:
        """Which form of the effect, where it has several."""
        return ""

    @abc.abstractmethod
    def extend(self, terms: Terms, campaign: Campaign) -> Terms:
        """The terms with this effect in."""

    def required(self) -> tuple[str, ...]:
        """The regressors that a record needs for this effect."""
        return self.needs

    def scan(self, search: Search) -> Iterator[dict[str, float]]:
        """The grid of places, times or temperatures on which the screen looks for the effect."""
        del search
        yield {}

    def bounds(self, parameter: Parameter, search: Search) -> tuple[float, float]:
        """Between which values a parameter is searched."""
        del search
        infinity = float("inf")
        return (
            -infinity if parameter.least is None else parameter.least,
            infinity if parameter.most is None else parameter.most,
        )

    def at(self, values: dict[str, Any]) -> AbstractEffect:
        """The same effect at other values of its parameters."""
        return dataclasses.replace(self, **values)


def not_below(value: Array, least: float) -> Array:
    """The value, or the bound where it lies beyond; its slope at the bound is that from within."""
    return jnp.where(value >= least, value, least)


def number(value: float = 0.0) -> Any:
    """A field for a parameter: an array, so that a new value is not compiled anew."""
    return eqx.field(converter=lambda given: jnp.asarray(given, dtype=float), default=value)


def record_search(record: Record, positions: tuple[float, ...], length: float, count: int = 9) -> Search:
    """Where and when to look in this record.

    Interfaces are looked for between the outermost sensors; nearer to a face they are a film by another name. With
    a single sensor the middle half of the wall serves.
    """
    low, high = (min(positions), max(positions)) if len(positions) > 1 else (0.25 * length, 0.75 * length)
    margin = 0.04 * (high - low)
    places = [low + margin + (high - low - 2 * margin) * i / (count - 1) for i in range(count)]
    inner = record.sensors[~jnp.isnan(record.sensors)] if record.sensors.size else record.faces.ravel()
    return Search(
        length=length,
        places=tuple(float(place) for place in places),
        duration=record.duration,
        rain=rain_onsets(record),
        coldest=float(min(record.faces.min(), inner.min())),
        warmest=float(max(record.faces.max(), inner.max())),
    )


def rain_onsets(record: Record, most: int = 8, pause: float = 12 * 3600.0) -> tuple[float, ...]:
    """When the largest rain events began, s since the first row: rain after at least half a day without."""
    rain = record.regressors.get("rain")
    if rain is None:
        return ()
    wet = np.flatnonzero(np.nan_to_num(rain) > 0.05)
    if not len(wet):
        return ()
    time = record.time
    starts = np.concatenate([[True], np.diff(time[wet]) > pause])
    event = np.cumsum(starts) - 1
    amount = np.bincount(event, weights=rain[wet])
    onsets = time[wet[starts]]
    largest = np.sort(np.argsort(-amount)[:most])
    return tuple(float(onset) for onset in onsets[largest])
