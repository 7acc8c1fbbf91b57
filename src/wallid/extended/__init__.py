"""The large model with effects in: from `Terms` to the readings that a campaign would give.

A wall whose terms are linear and constant in time is solved exactly in its modes (`linear.py`), any other
through diffrax (`nonlinear.py`); both share the wall's cells (`cells.py`) and its sensors (`sensors.py`). What any
effect would change to first order is one linear solve (`first_order.py`).
"""

from .cells import Cells, cells, start
from .first_order import Base, base_course, first_order
from .linear import linear_course
from .nonlinear import LONGEST_SUBSTEP, DiagonallyImplicit, nonlinear_course
from .respond import face_response, respond
from .sensors import readings

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
    "nonlinear_course",
    "readings",
    "respond",
    "start",
]
