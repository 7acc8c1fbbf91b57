"""A record whose faces take other courses: shaded from the sun, heated for some hours, or in another season.

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
from ...experiment_design.campaign_plan.typical_case import (
    campaign_irradiance,
    conductivity_of,
    indoor_temperature,
    typical_case,
)
from ...models.flux_plates import fluxes_of
from ...records.uniform_record import Record
from ...records.weather_year import HOURS, WeatherYear
from ..problem import DiagnosisProblem
from ..record_forcing import forcing_of_window, hours_of_day

HEATING_POWER, HEATING_HOURS = 100.0, 12.0
"""Heat flux on the inner face, W/m2, and its duration, h."""
SUN_ON_FACE = 0.01
"""Warming of a face by the sun, K m2/W: an absorptance of 0.25 over a film of 25 W/m2/K."""
_INDOOR_FILM = 8.0  # W/m2/K, convection and radiation


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
    conductivity = conductivity_of(wall, diffusivity)
    since = record.time - heating_start(record)
    warming = _warming(since, conductivity, diffusivity) - _warming(
        since - HEATING_HOURS * 3600.0, conductivity, diffusivity
    )
    faces = np.array(record.faces)
    faces[:, SIDES.index(wall.inside)] += warming
    return _with_faces(problem, faces, {})


def heating_start(record: Record) -> float:
    """When the heating of a heated record begins, s since its first row: after a third of it."""
    return float(record.time[record.rows // 3])


def in_season(problem: DiagnosisProblem, weather: WeatherYear, start: int, diffusivity: float) -> DiagnosisProblem:
    """A record of the same rows in another season of a typical year, in which the plain wall has some diffusivity.

    Its first row is at the same hour of the day as that of the present record.

    Args:
        problem: of the present record, whose case has `[plan]`.
        weather: of the typical year.
        start: the hour at which its first day begins.
        diffusivity: m2/s.
    """
    case, record = problem.case, problem.record
    campaign = case.planned_campaign
    positions = [sensor.position for sensor in case.sensors]
    typical = typical_case(campaign, weather, diffusivity, positions, fluxes_of(case))
    hours = start + hours_of_day(record)[0] + record.time / 3600.0

    def at_rows(values: np.ndarray) -> np.ndarray:
        """Of means over the hours of the year, which is periodic."""
        year = np.concatenate([values[:HOURS], values[:1]])
        return np.asarray(scipy.interpolate.CubicSpline(0.5 + np.arange(HOURS + 1), year, bc_type="periodic")(hours))

    courses = {
        "irradiance": campaign_irradiance(campaign, weather),
        "air_outdoor": weather.air,
        "air_indoor": indoor_temperature(campaign, weather),
    }
    logged = {name: at_rows(values) for name, values in courses.items() if name in record.regressors}
    return _with_faces(problem, at_rows(typical.record.faces), logged, at_rows(typical.record.sensors))


def _warming(time: Float[np.ndarray, " time"], conductivity: float, diffusivity: float) -> Float[np.ndarray, " time"]:
    """The warming of a face since the start of its heating, K; 0 before it."""
    b = _INDOOR_FILM / conductivity * np.sqrt(diffusivity * np.maximum(time, 0.0))
    return np.asarray(HEATING_POWER / _INDOOR_FILM * (1.0 - scipy.special.erfcx(b)))


def _with_faces(
    problem: DiagnosisProblem,
    faces: np.ndarray,
    regressors: dict[str, np.ndarray],
    sensors: np.ndarray | None = None,
) -> DiagnosisProblem:
    """The problem with other face temperatures, regressors and (for the initial profile) readings in the rows used."""
    window, whole = diagnosis_window(problem.case), problem.case.record
    changed = {key: np.array(whole.regressors[key]) for key in regressors}
    for key, values in regressors.items():
        changed[key][window.as_slice] = values
    new_faces, new_sensors = np.array(whole.faces), np.array(whole.sensors)
    new_faces[window.as_slice] = faces
    if sensors is not None:
        new_sensors[window.as_slice] = np.where(np.isfinite(whole.sensors[window.as_slice]), sensors, np.nan)
    record = replace(whole, faces=new_faces, sensors=new_sensors, regressors=dict(whole.regressors) | changed)
    case: Case = replace(problem.case, record=record)
    model = replace(problem.model, forcing=forcing_of_window(case, window))
    return replace(problem, case=case, record=record.window(window.row, window.rows), model=model)
