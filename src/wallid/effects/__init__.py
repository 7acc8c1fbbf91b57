"""The effects that may be missing from the plain model; see `base.py` for how they compose."""

from .base import AbstractEffect, Campaign, Parameter, Search, Step, Terms, Wetting, record_search
from .boundary import FaceDepth, FaceLag, FaceOffset, SolarGain, SurfaceFilm
from .library import LIBRARY, library, untestable
from .material import (
    ContactResistance,
    DiffusivityDrift,
    LayeredCapacity,
    LayeredConductivity,
    PhaseChange,
    TemperatureDependentCapacity,
    TemperatureDependentConductivity,
    WettingByRain,
    latent_capacity,
)
from .sensor import ClockShift, SensorDrift, SensorGain, SensorLag, SensorOffset, SensorPosition
from .source import (
    AirFlow,
    HeatedSource,
    HourlySource,
    LateralLoss,
    PlacedHourlySource,
    PlacedSource,
    UniformSource,
)

__all__ = [
    "LIBRARY",
    "AbstractEffect",
    "AirFlow",
    "Campaign",
    "ClockShift",
    "ContactResistance",
    "DiffusivityDrift",
    "FaceDepth",
    "FaceLag",
    "FaceOffset",
    "HeatedSource",
    "HourlySource",
    "LateralLoss",
    "LayeredCapacity",
    "LayeredConductivity",
    "Parameter",
    "PhaseChange",
    "PlacedHourlySource",
    "PlacedSource",
    "Search",
    "SensorDrift",
    "SensorGain",
    "SensorLag",
    "SensorOffset",
    "SensorPosition",
    "SolarGain",
    "Step",
    "SurfaceFilm",
    "TemperatureDependentCapacity",
    "TemperatureDependentConductivity",
    "Terms",
    "UniformSource",
    "Wetting",
    "WettingByRain",
    "latent_capacity",
    "library",
    "record_search",
    "untestable",
]
