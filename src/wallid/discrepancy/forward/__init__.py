"""The forward model of a wall with effects: from `Terms` to the readings of the inner sensors.

A wall with linear terms that are constant in time is solved exactly in its modes (`linear_wall.py`). Any other wall
(`nonlinear_wall.py`) is integrated by diffrax (`time_stepping.py`) with an implicit solver (`implicit_solver.py`).
Both use the same cells (`cells.py`) and sensors (`sensor_readings.py`). `first_order.py` gives the derivative of the
readings by any effect from one linear solution.
"""

from .cells import Cells, build_cells, initial_state
from .first_order import BaseSolution, first_order_response, solve_base
from .implicit_solver import DiagonallyImplicit
from .linear_wall import simulate_linear_wall
from .response import face_response, simulate_readings
from .sensor_readings import apply_sensor_effects
from .time_stepping import MAX_SUBSTEP, simulate_nonlinear_wall

__all__ = [
    "MAX_SUBSTEP",
    "BaseSolution",
    "Cells",
    "DiagonallyImplicit",
    "apply_sensor_effects",
    "build_cells",
    "face_response",
    "first_order_response",
    "initial_state",
    "simulate_linear_wall",
    "simulate_nonlinear_wall",
    "simulate_readings",
    "solve_base",
]
