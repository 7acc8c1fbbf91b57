"""A record whose faces are made to take other courses: shaded from the sun, or heated for some hours.

A heat flux P on a face of conductivity k and diffusivity alpha, which loses h per kelvin to the air, warms it after the
time t by

    Delta T = P / h (1 - exp(b^2) erfc(b)),      b = h sqrt(alpha t) / k

and after its end by the difference of two such courses. The wall is taken as thick, which it is for some hours.

Source: H. S. Carslaw, J. C. Jaeger, Conduction of Heat in Solids (1959), 2.7.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy
from jaxtyping import Float

from ...case.case_definition import Case
from ...case.time_window import diagnosis_window
from ...case.wall_and_sensors import SIDES
from ..problem import DiagnosisProblem
from ..record_forcing import forcing_of_window

HEATING_POWER, HEATING_HOURS = 100.0, 12.0
"""Heat flux on the inner face, W/m2, and its duration, h."""
SUN_ON_FACE = 0.01
"""Warming of a face by the sun, K m2/W: an absorptance of 0.25 over a film of 25 W/m2/K."""
_INDOOR_FILM = 8.0  # W/m2/K, convection and radiation
_CAPACITY = 1.6e6  # J/m3/K of masonry, where neither it nor the conductivity is stated


def shaded(problem: DiagnosisProblem) -> DiagnosisProblem:
    """The same record with the outer face, and the irradiance on it, in the shade during the second half."""
    record, side = problem.record, SIDES.index(problem.case.wall.outside)
    later = np.arange(record.rows) >= record.rows // 2
    sun = np.nan_to_num(record.regressors["irradiance"])
    faces = np.array(record.faces)
    faces[:, side] -= SUN_ON_FACE * np.where(later, sun, 0.0)
    return _with_faces(problem, faces, {"irradiance": np.where(later, 0.0, sun)})


def heated(problem: DiagnosisProblem, diffusivity: float) -> DiagnosisProblem:
    """The same record with the inner face heated once for some hours, from a third of the record on.

    Args:
        problem: of the record.
        diffusivity: m2/s.
    """
    record, wall = problem.record, problem.case.wall
    conductivity = wall.effective_conductivity or (wall.heat_capacity or _CAPACITY) * diffusivity
    since = record.time - record.time[record.rows // 3]
    warming = _warming(since, conductivity, diffusivity) - _warming(
        since - HEATING_HOURS * 3600.0, conductivity, diffusivity
    )
    faces = np.array(record.faces)
    faces[:, SIDES.index(wall.inside)] += warming
    return _with_faces(problem, faces, {})


def _warming(time: Float[np.ndarray, " time"], conductivity: float, diffusivity: float) -> Float[np.ndarray, " time"]:
    """The warming of a face since the start of its heating, K; 0 before it."""
    b = _INDOOR_FILM / conductivity * np.sqrt(diffusivity * np.maximum(time, 0.0))
    return np.asarray(HEATING_POWER / _INDOOR_FILM * (1.0 - scipy.special.erfcx(b)))


def _with_faces(problem: DiagnosisProblem, faces: np.ndarray, regressors: dict[str, np.ndarray]) -> DiagnosisProblem:
    """The problem with other face temperatures and regressors in the rows used."""
    window, whole = diagnosis_window(problem.case), problem.case.record
    rows = window.as_slice
    changed = {"faces": np.array(whole.faces)} | {key: np.array(whole.regressors[key]) for key in regressors}
    for key, values in ({"faces": faces} | regressors).items():
        changed[key][rows] = values
    new = changed.pop("faces")
    record = replace(whole, faces=new, regressors=dict(whole.regressors) | changed)
    case: Case = replace(problem.case, record=record)
    model = replace(problem.model, forcing=forcing_of_window(case, window))
    return replace(problem, case=case, record=record.window(window.row, window.rows), model=model)
