"""The effects that the plain model may miss; `equation_terms` states the equations that they change."""

from ...case.wall_and_sensors import SIDES
from .base import AbstractEffect, Parameter
from .catalogue import LIBRARY, library, untestable
from .equation_terms import ForcingData, Step, Terms, Wetting
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
    latent_capacity,
    latent_heat,
)
from .search_range import SearchRange, search_range_of_record
from .sensors import ClockShift, SensorDrift, SensorGain, SensorLag, SensorOffset, SensorPosition

__all__ = [
    "AIRS",
    "LIBRARY",
    "SIDES",
    "AbstractEffect",
    "AirFlow",
    "ClockShift",
    "ContactResistance",
    "DiffusivityDrift",
    "FaceDepth",
    "FaceLag",
    "FaceOffset",
    "ForcingData",
    "HeatedSource",
    "HourlySource",
    "LateralLoss",
    "LayeredCapacity",
    "LayeredConductivity",
    "Parameter",
    "PhaseChange",
    "PlacedHourlySource",
    "PlacedSource",
    "SearchRange",
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
    "search_range_of_record",
    "untestable",
]
