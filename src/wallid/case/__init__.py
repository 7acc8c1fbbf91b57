"""A case: the wall, its sensors, the record and the options; read from TOML or made in Python."""

from .case_definition import Case, LearningSignal
from .case_file import load, load_campaign, load_section, packaged
from .initial_profile import fit_profile, scales
from .options import Choices
from .planned_campaign import PlannedCampaign
from .record_check import check
from .scaling import Scales
from .time_window import Window
from .wall_and_sensors import Layer, Sensor, Wall

__all__ = [
    "Case",
    "Choices",
    "Layer",
    "LearningSignal",
    "PlannedCampaign",
    "Scales",
    "Sensor",
    "Wall",
    "Window",
    "check",
    "fit_profile",
    "load",
    "load_campaign",
    "load_section",
    "packaged",
    "scales",
]
