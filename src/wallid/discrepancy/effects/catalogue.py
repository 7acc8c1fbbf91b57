"""The library of effects."""

from __future__ import annotations

from collections.abc import Collection

from ...case.wall_and_sensors import SIDES
from .base import AbstractEffect
from .faces import FaceDepth, FaceLag, FaceOffset, SolarGain, SurfaceFilm
from .heat_sources import (
    AIRS,
    AirFlow,
    HeatedSource,
    HourlySource,
    LateralLoss,
    PlacedHourlySource,
    PlacedSource,
    UniformSource,
)
from .material import (
    ContactResistance,
    DiffusivityDrift,
    LayeredCapacity,
    LayeredConductivity,
    PhaseChange,
    TemperatureDependentCapacity,
    TemperatureDependentConductivity,
    WettingByRain,
)
from .plates import OnePlate, PlateGain, PlateLag, PlateOffset, PlateResistance
from .sensors import ClockShift, SensorDrift, SensorGain, SensorLag, SensorOffset, SensorPosition

_PER_SENSOR = (SensorPosition, SensorLag, SensorOffset, SensorGain, SensorDrift)
_PER_FACE = (FaceOffset, FaceLag, FaceDepth, SurfaceFilm, SolarGain)
_PER_PLATE = (PlateGain, PlateOffset, PlateLag, PlateResistance)
_PER_WALL = (
    LayeredConductivity,
    LayeredCapacity,
    ContactResistance,
    UniformSource,
    PlacedSource,
    HourlySource,
    PlacedHourlySource,
    HeatedSource,
    AirFlow,
    TemperatureDependentConductivity,
    TemperatureDependentCapacity,
    PhaseChange,
    DiffusivityDrift,
    WettingByRain,
)
LIBRARY: tuple[type[AbstractEffect], ...] = (*_PER_SENSOR, *_PER_FACE, *_PER_PLATE, LateralLoss, ClockShift, *_PER_WALL)
"""All classes of effects."""


def _all_effects(sensors: int) -> list[AbstractEffect]:
    """Every effect at every target, at its neutral value."""
    return [
        *(effect(sensor=sensor) for effect in _PER_SENSOR for sensor in range(sensors)),
        *((ClockShift(),) if sensors else ()),
        *(effect(side=side) for effect in (*_PER_FACE, *_PER_PLATE) for side in SIDES),
        *(LateralLoss(air=air) for air in AIRS),
        *(effect() for effect in _PER_WALL),
    ]


def library(sensors: int, logged: Collection[str]) -> tuple[AbstractEffect, ...]:
    """The effects that a record can be tested for, at their neutral values.

    Args:
        sensors: number of inner sensors.
        logged: names of the regressors in the record.
    """
    return tuple(effect for effect in _all_effects(sensors) if set(effect.required_regressors()) <= set(logged))


def untestable(sensors: int, logged: Collection[str]) -> dict[str, tuple[str, ...]]:
    """The effects that need regressors which were not logged, with these regressors.

    The error of a plate that is not there is none of them.
    """
    missing: dict[str, set[str]] = {}
    for effect in _all_effects(sensors):
        absent = set(effect.required_regressors()) - set(logged)
        has_instrument = not isinstance(effect, OnePlate) or effect.column in logged
        if absent and has_instrument and effect.name != "heat_source":
            missing.setdefault(effect.name, set()).update(absent)
    return {name: tuple(sorted(absent)) for name, absent in missing.items()}


def unlogged(sensors: int, logged: Collection[str]) -> list[str]:
    """The columns that would make further effects testable, but for plates."""
    needed = {name for columns in untestable(sensors, logged).values() for name in columns}
    return sorted(name for name in needed if not name.startswith("flux_"))
