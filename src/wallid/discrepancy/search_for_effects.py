"""Locate, rank, extend, compare: repeated until nothing more is worth adding."""

from __future__ import annotations

from collections.abc import Callable

from ..case.case_definition import Case
from .cross_validation import cross_validate
from .findings import Diagnosis
from .problem import compile_together, diagnosis_problem
from .residual_tests import test_residual
from .stepwise_selection import Selection

Progress = Callable[[str, float], None]


def diagnose(case: Case, *, progress: Progress = lambda stage, share: None) -> Diagnosis:
    """What the plain model misses in a case's record: which effect, how large, how much of the gap it closes.

    Args:
        progress: told the stage now beginning, and the share of the work done before it.

    Returns:
        One record from which every table and figure derives.

    Raises:
        InputError: a case without an inner sensor, or without a reading.
        RuntimeError: 64-bit floats are switched off.
    """
    progress("diagnose: compiling the models", 0.0)
    search = Selection(diagnosis_problem(case))
    compile_together(search.study)
    progress("diagnose: the plain model", 0.35)
    plain = search.plain()
    progress("diagnose: rank every effect and pair", 0.5)
    first = search.screen(plain)
    chosen = search.first(plain, first, lambda share: progress("diagnose: extend and fit again", 0.55 + 0.15 * share))
    best = search.further(chosen, lambda share: progress("diagnose: what is left to add", 0.7 + 0.15 * share))
    progress("diagnose: rivals", 0.85)
    effects, wanting = search.named(best), search.wanting(best)
    progress("diagnose: compare on days held out", 0.9)
    if best.active:  # both under the noise that the better model shows
        plain = search.plain_beside(best)
    gap = cross_validate(plain, best)
    left, after = test_residual(plain), test_residual(best)
    progress("done", 1.0)
    return Diagnosis(
        study=search.study,
        before=plain,
        after=best,
        effects=effects,
        screen=first,
        trials=tuple(search.trials),
        gap=gap,
        left_before=left,
        left_after=after,
        wanting=wanting,
        rivals=tuple(search.rivals),
    )
