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
from ._internal.xla_options import prepare_xla
from .case.case_definition import Case
from .case.case_file import load, packaged
from .case.initial_profile import fit_profile, scales
from .case.scaling import Scales
from .case.time_window import Window
from .case.wall_and_sensors import Layer, Sensor, Wall
from .discrepancy.findings import Explanation
from .discrepancy.search_for_effects import explain
from .estimation.diffusivity import estimate, seconds_of_estimate
from .estimation.heat_flux import Thermal
from .estimation.iso_9869 import Average, average_method
from .estimation.many_walls import Walls, estimate_walls
from .estimation.many_windows import Pooled, campaign
from .estimation.prediction import Loads, Reliability, reliability
from .estimation.result_objects import Estimate
from .experiment_design.sampling_step import Sampling, sampling
from .experiment_design.sensor_placement import Places, sensor_places
from .experiment_design.window_lengths import Lengths, lengths
from .experiment_design.window_selection import Design, design
from .models.batching import stack, sweep
from .models.exponential_solver import Exponential
from .models.finite_volume_wall import Output, lom
from .models.integration import propagate, simulate, stable_substeps
from .models.sensitivity_equations import autodiff, explicit
from .models.state_space import StateSpace
from .models.window_inputs import Experiment, experiment, large_model
from .records.uniform_record import Record, read_record
from .reduction.modal_identification import Learned, choose_order, learn_system, sweep_orders
from .reduction.training_signals import learn, learning_signals
from .reduction.variable_projection import Signals

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
