"""wallid: the thermal diffusivity of a wall from temperatures logged in and on it.

    case = wallid.load("saint_julien")
    window = wallid.design(case)          # the days that tell most
    rom = wallid.learn(case, window)      # a reduced model for those days
    fit = wallid.estimate(case, window, rom)
    print(fit)

Switch 64-bit floats on first: `jax.config.update("jax_enable_x64", True)`.
"""

from importlib import import_module as _import_module
from importlib.metadata import version as _version

from ._internal.errors import InputError
from .case import Case, Layer, Sensor, Wall, Window, load
from .discrepancy import Diagnosis, diagnose
from .estimation import (
    CampaignEstimate,
    Estimate,
    Prediction,
    WallEstimates,
    campaign,
    estimate,
    estimate_walls,
    predict,
)
from .experiment_design import Design, SensorPlacement, design, place_sensors
from .models import StateSpace, full_order_model, sensitivity, simulate
from .records import Record, read_record
from .reduction import LearnedModel, learn

__version__ = _version("wallid")


def __getattr__(name: str):
    """`wallid.plot`, imported where it is first asked for: matplotlib takes its time."""
    if name == "plot":
        return _import_module(".plot", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = [
    "CampaignEstimate",
    "Case",
    "Design",
    "Diagnosis",
    "Estimate",
    "InputError",
    "Layer",
    "LearnedModel",
    "Prediction",
    "Record",
    "Sensor",
    "SensorPlacement",
    "StateSpace",
    "Wall",
    "WallEstimates",
    "Window",
    "campaign",
    "design",
    "diagnose",
    "estimate",
    "estimate_walls",
    "full_order_model",
    "learn",
    "load",
    "place_sensors",
    "plot",
    "predict",
    "read_record",
    "sensitivity",
    "simulate",
]
