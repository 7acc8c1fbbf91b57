"""wallid: the thermal diffusivity of a wall from temperatures logged in and on it.

    case = wallid.load("saint_julien")
    window = wallid.design(case)          # the most informative days
    rom = wallid.learn(case, window)      # a reduced-order model for these days
    fit = wallid.estimate(case, window, rom)
    print(fit)

JAX must first be set to 64-bit floats: `jax.config.update("jax_enable_x64", True)`.
"""

from importlib import import_module as _import_module
from importlib.metadata import version as _version
from typing import TYPE_CHECKING

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

if TYPE_CHECKING:
    from . import plot

__version__ = _version("wallid")


def __getattr__(name: str):
    """Import `wallid.plot` at its first use, because the import of matplotlib is slow."""
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
