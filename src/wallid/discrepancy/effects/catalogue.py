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
from .sensors import ClockShift, SensorDrift, SensorGain, SensorLag, SensorOffset, SensorPosition

_PER_SENSOR = (SensorPosition, SensorLag, SensorOffset, SensorGain, SensorDrift)
_PER_FACE = (FaceOffset, FaceLag, FaceDepth, SurfaceFilm, SolarGain)
_PER_WALL = (
    ClockShift,
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
LIBRARY: tuple[type[AbstractEffect], ...] = (*_PER_SENSOR, *_PER_FACE, LateralLoss, *_PER_WALL)
"""All classes of effects."""


def _all_effects(sensors: int) -> list[AbstractEffect]:
    """Every effect at every target, at its neutral value."""
    return [
        *(effect(sensor=sensor) for effect in _PER_SENSOR for sensor in range(sensors)),
        *(effect(side=side) for effect in _PER_FACE for side in SIDES),
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
    """The effects that need regressors which were not logged, with these regressors."""
    missing: dict[str, set[str]] = {}
    for effect in _all_effects(sensors):
        absent = set(effect.required_regressors()) - set(logged)
        if absent and effect.name != "heat_source":
            missing.setdefault(effect.name, set()).update(absent)
    return {name: tuple(sorted(absent)) for name, absent in missing.items()}


def unlogged(sensors: int, logged: Collection[str]) -> list[str]:
    """The regressors that would make further effects testable."""
    return sorted({name for needed in untestable(sensors, logged).values() for name in needed})
