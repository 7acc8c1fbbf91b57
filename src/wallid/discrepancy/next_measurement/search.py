"""The search for what to measure next after a diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

from ..findings import Findings
from .actions import EFFORTS, Action, Prescription, best_actions, score
from .candidate_records import (
    CandidateRecord,
    HeatedRecord,
    LongerRecord,
    ShadedRecord,
    records_with_sensor,
)
from .confusable_sets import ConfusableSet, confusable_sets

_LENGTHS = (1.5, 2.0, 3.0, 4.0, 6.0)  # of the record, in lengths of the present one
_LONG_ENOUGH = 0.9  # the probability from which no longer record is tried
_LONGEST = 366.0  # days
_REFITTED = 3  # candidates whose probability is computed by refits


def prescribe(
    findings: Findings, progress: Callable[[float], None], efforts: Mapping[str, float] = EFFORTS
) -> tuple[Prescription, ...]:
    """What to measure next, for each set of effects that a record cannot distinguish.

    Args:
        findings: of the diagnosis.
        progress: called with the completed share, 0 to 1.
        efforts: of each kind of action, relative to that of logging one more column.
    """
    sets = list(confusable_sets(findings))
    return tuple(
        _for_confusable(one, efforts, lambda share, k=k: progress((k + share) / len(sets)))
        for k, one in enumerate(sets)
    )


def _for_confusable(
    confusable: ConfusableSet, efforts: Mapping[str, float], progress: Callable[[float], None]
) -> Prescription:
    """The actions for one set: all by the derivatives, then the best by refits."""
    now = LongerRecord(confusable, 1.0)
    with_sensor = list(records_with_sensor(confusable))
    progress(0.3)
    candidates = _best_of_each_kind([*with_sensor, *_other_candidates(confusable)], confusable, efforts)
    actions = []
    for count, (candidate, action) in enumerate(candidates):
        if count < _REFITTED:
            progress(0.4 + 0.6 * count / _REFITTED)
            action = action.with_probability(confusable.probability(candidate.refitted_separations))
        actions.append(action)
    probability_now = confusable.probability(now.refitted_separations)
    return Prescription(
        separate=confusable.effects,
        labels=tuple(confusable.problem.label(one.effect) for one in confusable.effects),
        now=probability_now,
        actions=best_actions(actions, probability_now),
        tried=tuple(dict.fromkeys(candidate.kind for candidate, _ in candidates)),
        curve=tuple((one.added.sensor.position, confusable.probability(one.separations)) for one in with_sensor),
    )


def _other_candidates(confusable: ConfusableSet) -> Iterator[CandidateRecord]:
    """The candidates beside those with a sensor."""
    yield HeatedRecord(confusable)
    if "irradiance" in confusable.problem.record.regressors:
        yield ShadedRecord(confusable)
    for length in _LENGTHS:
        longer = LongerRecord(confusable, length)
        if longer.days > _LONGEST:
            break
        yield longer
        if confusable.probability(longer.separations) >= _LONG_ENOUGH:
            break


def _best_of_each_kind(
    candidates: Sequence[CandidateRecord], confusable: ConfusableSet, efforts: Mapping[str, float]
) -> list[tuple[CandidateRecord, Action]]:
    """The best candidate of each kind with its action, the best kind first."""
    best: dict[str, tuple[CandidateRecord, Action]] = {}
    for candidate in candidates:
        length = candidate.days / LongerRecord(confusable, 1.0).days
        action = Action(
            candidate.kind,
            candidate.parameters(),
            candidate.days,
            efforts[candidate.kind] * length,
            confusable.probability(candidate.separations),
        )
        if candidate.kind not in best or score(action) > score(best[candidate.kind][1]):
            best[candidate.kind] = (candidate, action)
    return sorted(best.values(), key=lambda pair: -score(pair[1]))
