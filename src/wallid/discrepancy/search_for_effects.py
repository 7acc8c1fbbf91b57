"""The search for the effects that the plain model misses in a record."""

from __future__ import annotations

from collections.abc import Callable

from ..case.case_definition import Case
from .candidate_fits import CandidateFits
from .compilation import compile_together
from .cross_validation import cross_validate
from .diagnosis_result import Diagnosis
from .problem import diagnosis_problem
from .stepwise_selection import StepwiseSelection

Progress = Callable[[str, float], None]


def diagnose(case: Case, *, progress: Progress = lambda stage, share: None) -> Diagnosis:
    """Find the physical effects that the plain model misses in the record of a case.

    The plain model is fitted, every effect of the library is ranked by a score test, the best candidates are added
    and fitted (stepwise selection), and both models are compared on days held out.

    Args:
        case: the case; its window is the entire record, or `[choices] diagnose_days`.
        progress: called with the name of the stage that begins and the share of the work done, 0 to 1.

    Returns:
        The verdict, the named effects with their sizes, and the diffusivity with them in the model.

    Raises:
        InputError: the case has no inner sensor, or no inner sensor has a reading.
        RuntimeError: 64-bit floats are switched off.

    Example:
        >>> diagnosis = wallid.diagnose(wallid.load("case.toml"))
        >>> print(diagnosis.verdict, diagnosis.sentence)
    """
    progress("diagnose: compiling the models", 0.0)
    problem = diagnosis_problem(case)
    compile_together(problem)
    fits = CandidateFits(problem)
    selection = StepwiseSelection(fits)
    progress("diagnose: fitting the plain model", 0.35)
    plain = fits.fit_plain_model()
    progress("diagnose: ranking all effects and pairs", 0.5)
    plain_estimate, scores = fits.plain_estimate(plain), fits.score_candidates(plain)
    chosen = selection.select_first(
        plain, scores, lambda share: progress("diagnose: fitting the best candidates", 0.55 + 0.15 * share)
    )
    best = selection.select_further(chosen, lambda share: progress("diagnose: stepwise selection", 0.7 + 0.15 * share))
    progress("diagnose: comparing rival effects", 0.85)
    effects, p_value_of_one_more = selection.named_effects(best), selection.p_value_of_one_more(best)
    progress("diagnose: cross-validation", 0.9)
    if best.active:  # both with the noise of the final model
        plain = fits.plain_model_with_noise_of(best)
    diagnosis = Diagnosis(
        problem=problem,
        plain=plain_estimate,
        before=plain,
        after=best,
        effects=effects,
        scores=scores,
        trials=tuple(fits.trials),
        gap=cross_validate(plain, best),
        residual_tests_before=fits.residual_tests(plain),
        residual_tests_after=fits.residual_tests(best),
        p_value_of_one_more=p_value_of_one_more,
        rivals=tuple(selection.rivals),
    )
    progress("done", 1.0)
    return diagnosis
