"""The forward model of a wall with effects: from `Terms` to the readings of the inner sensors.

A wall with linear terms that are constant in time is solved exactly in its modes (`linear_wall.py`). Any other wall
(`nonlinear_wall.py`) is integrated by diffrax (`time_stepping.py`) with an implicit solver (`implicit_solver.py`).
Both use the same cells (`cells.py`) and instruments (`instrument_readings.py`). `first_order.py` gives the derivative
of the readings by any effect from one linear solution.
"""
