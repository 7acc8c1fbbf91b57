"""The columns that were not logged: would an effect that needs one be named if it were logged?

The course of the column is a typical one: a half-sine of irradiance from 6 to 18 h under a sky that changes from day
to day, air that follows the faces, and for a plan heating in the morning and in the evening. With the score test of the
entire library against the model of the diagnosis (`score_test`) a size phi has the squared distance

    d^2 = phi^2 |z|^2            from this model, and
    d^2 = phi^2 |z|^2 (1 - c^2)  from a rival with the cosine c of both derivatives

The size is the typical one of the effect, with a factor of two either way.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ...case.wall_and_sensors import SIDES
from ...records.uniform_record import Record
from ..effect_fit import EffectFit, refit
from ..effects.catalogue import unlogged
from ..problem import DiagnosisProblem, EffectParameters, diagnosis_problem
from ..record_forcing import hours_of_day
from ..result.findings import Findings
from ..selection.acceptance import FIRST_EFFECT_LEVEL, FURTHER_EFFECT_LEVEL, RIVAL
from ..selection.candidate_fits import CandidateFits
from ..selection.score_test import CandidateScores
from ..selection.stepwise_selection import MAX_EFFECTS
from .separation import Separation, cosines

_FACTORS = np.geomspace(0.5, 2.0, 5)  # of the typical size
_CLEAREST_SKY = 600.0  # W/m2, irradiance on a wall at noon


@dataclass(frozen=True, eq=False)
class UnloggedColumn:
    """A column that an effect needs and the record does not have.

    Args:
        column: its key in `[record]`.
        effects: that need it, at each target.
        problem: with a typical course of every column that was not logged.
        probability: that an effect of typical size is named, without an alternative, where the column is logged.
    """

    column: str
    effects: tuple[EffectParameters, ...]
    problem: DiagnosisProblem
    probability: float


def unlogged_columns(findings: Findings) -> Iterator[UnloggedColumn]:
    """Each column that would make a further effect testable, with the chance that it would be named.

    None where the model has as many effects as can be named.
    """
    columns = unlogged(findings.problem.sensor_count, findings.problem.record.regressors)
    if not columns or len(findings.final.active) == MAX_EFFECTS:
        return
    scores = _scores_with(findings.final, columns)
    problem = scores.base.problem
    for column in columns:
        effects = tuple(one for one in problem.library if column in one.effect.required_regressors())
        chances = [_chance(scores, one) for one in effects if one in scores.by_effect]
        if chances:
            yield UnloggedColumn(column, effects, problem, float(np.mean(chances)))


def _scores_with(final: EffectFit, columns: list[str]) -> CandidateScores:
    """The score test of the library against the model of a diagnosis, with typical courses of some columns."""
    case, named = final.problem.case, {one.names for one in final.active}
    typical = typical_courses(case.record, SIDES.index(case.wall.outside))
    record = replace(case.record, regressors=dict(case.record.regressors) | {key: typical[key] for key in columns})
    problem = diagnosis_problem(replace(case, record=record))
    parameters = problem.parameters.with_known_values(final.parameters.to_dict())
    active = tuple(one for one in problem.library if one.names in named)
    return CandidateFits(problem).score_candidates(refit(problem, active, parameters, final.noise))


def _chance(scores: CandidateScores, effect: EffectParameters) -> float:
    """The probability that an effect of typical size is named, without an alternative."""
    own = scores.by_effect[effect]
    best = int(own[np.argmax(scores.norm[own])])
    rivals = np.array([k for k in range(len(scores.candidates)) if scores.effect(k) is not effect], int)
    cosine, squared = scores.cosine[best, rivals], (effect.effect.parameters[0].scale * scores.norm[best]) ** 2
    # the residuals u - c_j u_j behind the rivals, and u behind the model without it
    inner = scores.cosine[np.ix_(rivals, rivals)] * np.outer(cosine, cosine)
    inner = 1.0 - cosine[:, None] ** 2 - cosine[None, :] ** 2 + inner
    inner = np.block([[inner, (1.0 - cosine**2)[:, None]], [(1.0 - cosine**2)[None, :], np.ones((1, 1))]])
    excess = np.outer(_FACTORS**2, squared * np.append(1.0 - cosine**2, 1.0))
    penalties = np.append(np.zeros(len(rivals)), 1.0)  # the model without it has one parameter less
    level = FURTHER_EFFECT_LEVEL if scores.base.active else FIRST_EFFECT_LEVEL
    criteria = np.append(np.full(len(rivals), RIVAL), scores.threshold(level))
    return Separation(excess, cosines(inner), penalties).probability(criteria)


def typical_courses(record: Record, outside: int) -> dict[str, np.ndarray]:
    """A typical course of each column that a library effect needs, `(time,)` each.

    Args:
        record: whose times and faces they follow.
        outside: index of the outer face.
    """
    random, hour, day = np.random.default_rng(0), hours_of_day(record), (record.days).astype(int)
    clearness = random.uniform(0.1, 1.0, day[-1] + 1)[day]
    heating = ((hour >= 6) & (hour < 8)) | ((hour >= 17) & (hour < 22))
    return {
        "irradiance": _CLEAREST_SKY * clearness * np.maximum(np.sin(np.pi * (hour - 6.0) / 12.0), 0.0),
        "air_outdoor": _air(record.faces[:, outside], random),
        "air_indoor": _air(record.faces[:, 1 - outside], random),
        "heating": heating.astype(float),
    }


def _air(face: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Air that varies about a face by a kelvin or so, slowly."""
    wandering = np.cumsum(random.standard_normal(len(face)))
    wandering -= np.linspace(wandering[0], wandering[-1], len(face))
    return np.asarray(face + wandering / max(float(wandering.std()), 1e-9))
