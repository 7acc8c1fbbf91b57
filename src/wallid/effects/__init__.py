"""The effects that may be missing from the plain model; see `terms` for how they compose."""

from .base import AbstractEffect, Parameter
from .boundary import SIDES, FaceDepth, FaceLag, FaceOffset, SolarGain, SurfaceFilm
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
    latent_heat,
)
from .search import Search, record_search
from .sensor import ClockShift, SensorDrift, SensorGain, SensorLag, SensorOffset, SensorPosition
from .source import (
    AIRS,
    AirFlow,
    HeatedSource,
    HourlySource,
    LateralLoss,
    PlacedHourlySource,
    PlacedSource,
    UniformSource,
)
from .terms import Campaign, Step, Terms, Wetting

__all__ = [
    "AIRS",
    "LIBRARY",
    "SIDES",
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
    "latent_heat",
    "library",
    "record_search",
    "untestable",
]
