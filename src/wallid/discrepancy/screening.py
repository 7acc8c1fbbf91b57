"""A short test whether the plain model explains a record: the first step of a diagnosis, without its search."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .._internal.blas_threads import one_blas_thread
from .._internal.number_formats import p_value_text, value_and_std
from .._internal.result_object import ResultObject, plain_value
from ..case.case_definition import Case
from .compilation import compile_together
from .effect_fit import EffectFit
from .problem import diagnosis_problem
from .selection.acceptance import RESIDUAL_TEST_LEVEL
from .selection.candidate_fits import CandidateFits, plain_model_of
from .selection.score_test import CandidateScores

SCREENING_LEVEL = 0.005
"""Significance level of the score test of the entire library. On 160 records with nothing missing, 1.5 % were below."""


@dataclass(frozen=True)
class Screening(ResultObject):
    """Whether the plain model explains the entire record.

    Args:
        score_p_value: of the score test of the largest expected gain in the library, family-wise.
        residual_p_value: of the omnibus tests of the residual.
        candidate: label of the effect with the largest expected gain; empty where there is none.
        expected_gain: its expected drop of `-2 log L`.
        size, size_std, unit: its expected size, with the standard deviation.
        shift: expected relative change of the diffusivity with this effect in the model.
    """

    score_p_value: float
    residual_p_value: float
    candidate: str
    expected_gain: float
    size: float
    size_std: float
    unit: str
    shift: float

    @property
    def missing(self) -> str:
        """What the record shows to be missing, in one sentence; empty where it shows nothing."""
        if self.score_p_value < SCREENING_LEVEL:
            size = value_and_std(self.size, self.size_std, self.unit)
            return (
                f"the entire record shows that an effect is missing from the model; the most likely of the known ones "
                f"is {self.candidate}, {size} (the diffusivity would change by {self.shift:+.0%})"
            )
        if self.residual_p_value < RESIDUAL_TEST_LEVEL:
            return (
                "the entire record shows that an effect is missing from the model; none of the known ones alone is "
                f"likely (a test of all that is left, without a named effect: p = {self.residual_p_value:.1g})"
            )
        return ""

    def __str__(self) -> str:
        tests = (
            f"score test {p_value_text(self.score_p_value, 1e-3)}, omnibus test {p_value_text(self.residual_p_value)}"
        )
        return f"missing      {self.missing or 'the entire record shows no missing effect'} ({tests})"

    def to_dict(self) -> dict[str, Any]:
        """The entries of result.json."""
        entries = {
            "missing": bool(self.missing),
            "score_p_value": self.score_p_value,
            "residual_p_value": self.residual_p_value,
            "candidate": self.candidate or None,
            "expected_gain": self.expected_gain,
            "size": {"value": self.size, "std": self.size_std, "unit": self.unit},
            "change_of_diffusivity": self.shift,
        }
        return plain_value(entries)

    def _html_title(self) -> str:
        return self.missing or "The entire record shows no missing effect"


@one_blas_thread
def screen(case: Case) -> Screening:
    """Test whether the plain model explains the entire record of a case.

    The plain model is fitted to the entire record. The residual is then tested against every effect of the library
    (score test), and against slow and daily variations that depend on no effect (omnibus tests). `diagnose` begins
    with the same tests, and goes on to the search for the effect.

    Args:
        case: the case; its window is the entire record, or `[choices] diagnose_days`.

    Raises:
        InputError: no inner sensor and no plate has a reading.
        RuntimeError: 64-bit floats are switched off.
    """
    problem = diagnosis_problem(case)
    compile_together(problem)
    fits, plain = plain_model_of(problem)
    return screening_of(fits, plain, fits.score_candidates(plain))


def screening_of(fits: CandidateFits, plain: EffectFit, scores: CandidateScores) -> Screening:
    """The screening of a record whose plain model is fitted.

    Args:
        fits: of the record.
        plain: the fit of the plain model.
        scores: the score test of the entire library against it.
    """
    problem, tests = fits.problem, fits.residual_tests(plain)
    if not len(scores.candidates):
        return Screening(1.0, tests.p_value, "", 0.0, 0.0, 0.0, "", 0.0)
    best = int(np.argmax(scores.weighted_gain))
    effect = scores.effect(best).effect
    return Screening(
        score_p_value=scores.p_value(float(scores.weighted_gain[best])),
        residual_p_value=tests.p_value,
        candidate=problem.label(effect),
        expected_gain=float(scores.gain[best]),
        size=float(scores.size[best]),
        size_std=float(1.0 / scores.norm[best]),
        unit=effect.parameters[0].unit,
        shift=float(np.expm1(scores.shift[best])),
    )
