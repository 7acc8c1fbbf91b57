"""wallid: the thermal diffusivity of a wall from temperatures logged in and on it.

    case = wallid.load("saint_julien")
    window = wallid.design(case)          # the most informative days
    rom = wallid.learn(case, window)      # a reduced-order model for these days
    fit = wallid.estimate(case, window, rom)
    print(fit)

JAX must first be set to 64-bit floats: `jax.config.update("jax_enable_x64", True)`.
"""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from . import plot
    from ._internal.errors import InputError
    from .case import Case, Layer, PlannedCampaign, Sensor, Wall, Window, load, load_campaign
    from .discrepancy import Diagnosis, diagnose, plan
    from .estimation import (
        CampaignEstimate,
        Estimate,
        Forecast,
        Prediction,
        WallEstimates,
        campaign,
        estimate,
        estimate_walls,
        forecast,
        predict,
    )
    from .experiment_design import CampaignPlan, Design, SensorPlacement, design, place_sensors
    from .models import StateSpace, full_order_model, sensitivity, simulate
    from .records import Record, read_record
    from .reduction import LearnedModel, learn

    __version__: str

_NAMES = {
    "_internal.errors": ("InputError",),
    "case": ("PlannedCampaign", "Case", "Layer", "Sensor", "Wall", "Window", "load", "load_campaign"),
    "discrepancy": ("Diagnosis", "diagnose", "plan"),
    "estimation": (
        *("CampaignEstimate", "Estimate", "Forecast", "Prediction", "WallEstimates"),
        *("campaign", "estimate", "estimate_walls", "forecast", "predict"),
    ),
    "experiment_design": ("CampaignPlan", "Design", "SensorPlacement", "design", "place_sensors"),
    "models": ("StateSpace", "full_order_model", "sensitivity", "simulate"),
    "records": ("Record", "read_record"),
    "reduction": ("LearnedModel", "learn"),
}
"""The public names of each module; the same as in the imports above."""
_HOMES = {name: module for module, names in _NAMES.items() for name in names}
_PACKAGES = ("case", "discrepancy", "estimation", "experiment_design", "inference", "models", "plot", "records",
             "reduction", "report", "workflow")  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import a public name, or a package, at its first use.

    The import of JAX takes a second. Without it in this file, the command line owns the process from its start: an
    interruption in that second ends it in the same way as later.
    """
    if name in _PACKAGES:
        return _import_module(f".{name}", __name__)
    if name == "__version__":
        from importlib.metadata import version

        value = version("wallid")
    elif name in _HOMES:
        value = getattr(_import_module(f".{_HOMES[name]}", __name__), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES, *_PACKAGES, "__version__"})


__all__ = [
    "CampaignEstimate",
    "CampaignPlan",
    "Case",
    "Design",
    "Diagnosis",
    "Estimate",
    "Forecast",
    "InputError",
    "Layer",
    "LearnedModel",
    "PlannedCampaign",
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
    "forecast",
    "full_order_model",
    "learn",
    "load",
    "load_campaign",
    "place_sensors",
    "plan",
    "plot",
    "predict",
    "read_record",
    "sensitivity",
    "simulate",
]
