"""The wall as a linear state space: built by finite volumes, integrated in time, differentiated."""

from .._internal.xla_options import prepare_xla
from .batching import stack, sweep
from .exponential_solver import Exponential
from .finite_volume_wall import Output, finite_volume_model, layer_cells
from .integration import propagate, simulate, stable_substeps
from .sensitivity_equations import autodiff, explicit, sensitivity
from .state_space import StateSpace
from .window_inputs import WindowData, full_order_model, window_data

__all__ = [
    "Exponential",
    "Output",
    "StateSpace",
    "WindowData",
    "autodiff",
    "explicit",
    "finite_volume_model",
    "full_order_model",
    "layer_cells",
    "prepare_xla",
    "propagate",
    "sensitivity",
    "simulate",
    "stable_substeps",
    "stack",
    "sweep",
    "window_data",
]
