"""Every effect that the package knows, for a record with these sensors and regressors."""

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
_WHOLE = (
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
LIBRARY: tuple[type[AbstractEffect], ...] = (*_PER_SENSOR, *_PER_FACE, LateralLoss, *_WHOLE)
"""Every kind of effect."""


def _every(sensors: int) -> list[AbstractEffect]:
    """Every effect at every target, neutral."""
    found: list[AbstractEffect] = []
    found += [kind(sensor=sensor) for kind in _PER_SENSOR for sensor in range(sensors)]
    found += [kind(side=side) for kind in _PER_FACE for side in SIDES]
    found += [LateralLoss(air=air) for air in AIRS]
    found += [kind() for kind in _WHOLE]
    return found


def library(sensors: int, logged: Collection[str]) -> tuple[AbstractEffect, ...]:
    """The effects that a record can be searched for, neutral.

    Args:
        sensors: how many are inside the wall.
        logged: the record's regressors.
    """
    return tuple(effect for effect in _every(sensors) if set(effect.required()) <= set(logged))


def untestable(sensors: int, logged: Collection[str]) -> dict[str, tuple[str, ...]]:
    """The effects that need what was not logged: name -> the regressors missing."""
    missing: dict[str, set[str]] = {}
    for effect in _every(sensors):
        lacks = set(effect.required()) - set(logged)
        if lacks and effect.name != "heat_source":
            missing.setdefault(effect.name, set()).update(lacks)
    return {name: tuple(sorted(lacks)) for name, lacks in missing.items()}
