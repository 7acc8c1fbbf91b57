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

from ._xla import prepare_xla
from .campaign import Pooled, campaign
from .case import Case, load, packaged
from .design import Design, design
from .discrepancy import Explanation, explain
from .estimate import Estimate, estimate, seconds_of_estimate
from .experiment import Experiment, Window, experiment, fit_profile, large_model, scales
from .exponential import Exponential
from .iso9869 import Average, average_method
from .learning import learn, learning_signals
from .lengths import Lengths, lengths
from .lom import Output, lom
from .mim import Learned, Signals, choose_order, learn_system, sweep_orders
from .places import Places, sensor_places
from .record import Record, read_record
from .reliability import Loads, Reliability, reliability
from .sampling import Sampling, sampling
from .sensitivity import autodiff, explicit
from .simulate import propagate, simulate, stable_substeps
from .statespace import StateSpace
from .sweeps import stack, sweep
from .thermal import Thermal
from .wall import InputError, Layer, Scales, Sensor, Wall
from .walls import Walls, estimate_walls

__version__ = _version("wallid")


def __getattr__(name: str):
    """`wallid.plot`, imported where it is first asked for: matplotlib takes its time."""
    if name == "plot":
        return _import_module(".plot", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = [
    "Average",
    "Case",
    "Design",
    "Estimate",
    "Experiment",
    "Explanation",
    "Exponential",
    "InputError",
    "Layer",
    "Learned",
    "Lengths",
    "Loads",
    "Output",
    "Places",
    "Pooled",
    "Record",
    "Reliability",
    "Sampling",
    "Scales",
    "Sensor",
    "Signals",
    "StateSpace",
    "Thermal",
    "Wall",
    "Walls",
    "Window",
    "autodiff",
    "average_method",
    "campaign",
    "choose_order",
    "design",
    "estimate",
    "estimate_walls",
    "experiment",
    "explain",
    "explicit",
    "fit_profile",
    "large_model",
    "learn",
    "learn_system",
    "learning_signals",
    "lengths",
    "load",
    "lom",
    "packaged",
    "prepare_xla",
    "propagate",
    "read_record",
    "reliability",
    "sampling",
    "scales",
    "seconds_of_estimate",
    "sensor_places",
    "simulate",
    "stable_substeps",
    "stack",
    "sweep",
    "sweep_orders",
]
