"""The large model with effects in: from `Terms` to the readings that a campaign would give.

A wall whose terms are linear and constant in time is solved exactly in its modes (`linear.py`); any other
(`nonlinear.py`) is stepped through diffrax (`stepped.py`) by a solver of its own (`implicit.py`). Both share the
wall's cells (`cells.py`) and its sensors (`sensors.py`). What any effect would change to first order is one linear
solve (`first_order.py`).
"""

from .cells import Cells, cells, start
from .first_order import Base, base_course, first_order
from .implicit_solver import DiagonallyImplicit
from .linear_wall import linear_course
from .response import face_response, respond
from .sensor_readings import readings
from .time_stepping import LONGEST_SUBSTEP, stepped_course

__all__ = [
    "LONGEST_SUBSTEP",
    "Base",
    "Cells",
    "DiagonallyImplicit",
    "base_course",
    "cells",
    "face_response",
    "first_order",
    "linear_course",
    "readings",
    "respond",
    "start",
    "stepped_course",
]
