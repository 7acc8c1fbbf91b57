"""The columns that a planned campaign should log.

A column is to be logged where an effect that needs it, at its typical size, would be seen in the record: without the
column something unnamed would remain. An effect that is only taken for another diffusivity would not be told from it
with the column either.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..._internal.units import DAY
from ...case.case_definition import Case
from ...case.time_window import Window
from ...case.wall_and_sensors import SIDES
from ...inference.likelihood import LOG_DIFFUSIVITY
from ...models.flux_plates import fluxes_of
from ..effect_fit import linearised_at
from ..effects.catalogue import unlogged
from ..problem import EffectParameters, diagnosis_problem
from ..selection.acceptance import FIRST_EFFECT_LEVEL
from ..selection.candidate_fits import CandidateFits
from ..selection.score_test import CandidateScores
from .unlogged_columns import typical_courses

_LONGEST = 14 * 24  # rows of the planned campaign that are looked at


def columns_to_log(case: Case, window: Window, logged: dict[str, np.ndarray]) -> dict[str, str]:
    """The columns that a campaign should log, each with the reason.

    Args:
        case: the planned campaign in a typical year, without noise.
        window: its rows.
        logged: known courses of columns in the typical year, such as the irradiance, `(time,)` each.
    """
    plates = [f"flux_{face}" for face in fluxes_of(case)]
    if not case.sensors and not plates:  # a diagnosis needs a temperature inside or a flux
        return {}
    columns = sorted({*unlogged(len(case.sensors), ()), "heating"})
    part = case.record.window(window.row, min(window.rows, _LONGEST))
    courses = typical_courses(part, SIDES.index(case.wall.outside))
    hours = window.row + np.arange(part.rows)
    courses |= {name: np.take(values, hours, mode="wrap") for name, values in logged.items()}
    fluxes = {name: part.regressors[name] for name in plates}
    record = replace(part, regressors={name: courses[name] for name in columns} | fluxes)
    choices = replace(case.choices, diagnose_days=None, window_days=part.rows * record.step / DAY)
    problem = diagnosis_problem(replace(case, record=record, choices=choices))
    noise = problem.noise_shape(problem.parameters).stated_covariance()
    scores = CandidateFits(problem).score_candidates(linearised_at(problem, (), problem.parameters, noise))
    reasons = {column: _reason(scores, column) for column in columns}
    return {column: reason for column, reason in reasons.items() if reason}


def _reason(scores: CandidateScores, column: str) -> str:
    """Why a column is to be logged; empty where it is not."""
    problem, threshold = scores.base.problem, scores.threshold(FIRST_EFFECT_LEVEL)
    worst, reason = 0.0, ""
    for effect in problem.library:
        if column not in effect.effect.required_regressors() or effect not in scores.by_effect:
            continue
        if effect.effect.target == problem.case.wall.inside:  # irradiance is that on the outer face
            continue
        seen, shift = _at_typical_size(scores, effect)
        label, size = problem.label(effect.effect), effect.effect.parameters[0]
        text = f"{label} of {size.scale:g} {size.unit}".strip()
        if seen > threshold and seen > worst:
            worst, reason = seen, f"{text} would be seen, and shift the diffusivity by {100 * np.expm1(shift):+.2g} %"
    return reason


def _at_typical_size(scores: CandidateScores, effect: EffectParameters) -> tuple[float, float]:
    """The expected gain of an effect of typical size, and the shift of ln(alpha) if it is left out."""
    own = scores.by_effect[effect]
    best = int(own[np.argmax(scores.norm[own])])
    size = effect.effect.parameters[0].scale
    index = scores.base.index(LOG_DIFFUSIVITY)
    return float((size * scores.norm[best]) ** 2), float(-size * scores.parameter_shifts[index, best])
