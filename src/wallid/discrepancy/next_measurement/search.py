"""The search for what to measure next after a diagnosis."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

from ...records.weather_year import WeatherYear
from ..problem import EffectParameters
from ..result.findings import Findings
from .actions import EFFORTS, Action, ActionKind, Prescription, best_actions, best_of, not_probable_enough, score
from .added_instrument import records_with_instrument
from .candidate_records import CandidateRecord, LongerRecord, longer_records, records_with_sensor
from .changed_records import changed_records, swapped_records
from .confusable_sets import ConfusableSet, confusable_sets
from .informative_records import open_diffusivities
from .present_record import PresentRecord
from .refits import refits_without_noise, refitted_separations
from .unlogged_columns import unlogged_columns

_PROBABLE_ENOUGH = 0.9  # from which no longer record is tried
_REFITTED = 3  # actions whose probability is computed by refits; more where one that is not would be the best


def what_to_measure(
    findings: Findings, progress: Callable[[float], None], weather: WeatherYear | None = None
) -> tuple[Prescription, ...]:
    """What to measure next, for each question that a diagnosis leaves open.

    Effects that the record cannot distinguish, a record that does not determine the diffusivity, and effects that
    could not be tested because a column was not logged.

    Args:
        findings: of the diagnosis.
        progress: called with the completed share, 0 to 1.
        weather: of the typical year that the case states; None for none.
    """
    efforts = {**EFFORTS, **dict(findings.problem.case.choices.efforts)}
    if findings.verdict == "uninformative":
        return (_for_uninformative(findings, efforts, weather),)
    sets = list(confusable_sets(findings)) if findings.verdict == "confusable" else []
    parts = len(sets) + 1
    found = [
        _for_confusable(one, efforts, lambda share, k=k: progress((k + share) / parts), weather)
        for k, one in enumerate(sets)
    ]
    progress(len(sets) / parts)
    return (*found, *_for_unlogged(findings, efforts))


def _for_confusable(
    confusable: ConfusableSet,
    efforts: Mapping[str, float],
    progress: Callable[[float], None],
    weather: WeatherYear | None,
) -> Prescription:
    """The actions for one set: all by the derivatives, then the best by refits."""
    present = confusable.present
    repeat = LongerRecord(present, 1.0)
    refits_of_repeat = refits_without_noise(confusable, repeat)
    progress(0.3)
    tried = _tried(present, lambda record: confusable.probability(confusable.separations(record)), efforts, weather)
    ranked = _best_of_each_kind(tried)
    counts = itertools.count()

    def by_refits(k: int) -> float:
        """The probability of the k-th of the ranked records."""
        progress(1.0 - 0.6 * 0.8 ** next(counts))  # three or more
        record, _ = ranked[k]
        refits = refits_of_repeat if isinstance(record, LongerRecord) else refits_without_noise(confusable, record)
        return confusable.probability(refitted_separations(confusable, record, refits))

    actions = with_probability_by_refits([action for _, action in ranked], by_refits)
    now = confusable.probability(refitted_separations(confusable, repeat, refits_of_repeat))
    effects = confusable.distinct_effects
    labels = tuple(present.problem.label(one.effect) for one in effects)
    return _prescription(effects, labels, now, actions, _kinds(tried), _sensor_curve(tried))


def with_probability_by_refits(ranked: Sequence[Action], by_refits: Callable[[int], float]) -> list[Action]:
    """The actions with the probability by refits of the best three, and of any other that is then the best one.

    Args:
        ranked: with the probability by the derivatives, the best first.
        by_refits: the probability of one of them by its index.
    """
    actions, refitted = list(ranked), set[int]()
    while left := [k for k in range(len(actions)) if k not in refitted]:
        best = actions.index(best_of(actions))
        if best in refitted and len(refitted) >= _REFITTED:
            break
        k = left[0] if len(refitted) < _REFITTED else best
        actions[k] = replace(actions[k], probability=by_refits(k))
        refitted.add(k)
    return actions


def _for_uninformative(findings: Findings, efforts: Mapping[str, float], weather: WeatherYear | None) -> Prescription:
    """The actions after which the diffusivity would be determined."""
    unknown = open_diffusivities(findings)
    now = unknown.probability(LongerRecord(unknown.present, 1.0))
    tried = _tried(unknown.present, unknown.probability, efforts, weather)
    actions = [action for _, action in _best_of_each_kind(tried)]
    return _prescription((), (), now, actions, _kinds(tried), _sensor_curve(tried))


def _prescription(
    effects: tuple[EffectParameters, ...],
    labels: tuple[str, ...],
    now: float,
    actions: Sequence[Action],
    tried: tuple[ActionKind, ...],
    curve: tuple[tuple[float, float], ...] = (),
    column: str = "",
) -> Prescription:
    """What to measure for one question, from the best action of each kind; the rest as in `Prescription`."""
    helpful, refused = best_actions(actions, now), not_probable_enough(actions, now)
    return Prescription(effects, labels, now, helpful, tried, curve, column, refused)


def _for_unlogged(findings: Findings, efforts: Mapping[str, float]) -> Iterator[Prescription]:
    """For each column that was not logged: whether an effect that needs it would be named with it."""
    days = PresentRecord((findings.before,)).days
    for one in unlogged_columns(findings):
        action = Action("column", {"column": one.column}, days, efforts["column"], one.probability)
        labels = tuple(one.problem.label(effect.effect) for effect in one.effects)
        yield _prescription(one.effects, labels, 0.0, [action], ("column",), column=one.column)


_Tried = list[tuple[CandidateRecord, Action]]


def _tried(
    present: PresentRecord,
    probability: Callable[[CandidateRecord], float],
    efforts: Mapping[str, float],
    weather: WeatherYear | None,
) -> _Tried:
    """Every candidate with its action; of longer records none past the first that is probable enough."""
    tried: _Tried = []
    others = (*changed_records(present, weather), *swapped_records(present), *longer_records(present))
    instruments = (*records_with_sensor(present), *records_with_instrument(present))
    for record in (*instruments, *others):
        if tried and isinstance(tried[-1][0], LongerRecord) and tried[-1][1].probability >= _PROBABLE_ENOUGH:
            break
        days, effort = record.length * present.days, record.length * efforts[record.kind]
        tried.append((record, Action(record.kind, record.parameters(), days, effort, probability(record))))
    return tried


def _best_of_each_kind(tried: _Tried) -> _Tried:
    """The best candidate of each kind, the best kind first."""
    best: dict[str, tuple[CandidateRecord, Action]] = {}
    for record, action in tried:
        if action.kind not in best or score(action) > score(best[action.kind][1]):
            best[action.kind] = (record, action)
    return sorted(best.values(), key=lambda pair: -score(pair[1]))


def _kinds(tried: _Tried) -> tuple[ActionKind, ...]:
    return tuple(dict.fromkeys(action.kind for _, action in tried))


def _sensor_curve(tried: Sequence[tuple[CandidateRecord, Action]]) -> tuple[tuple[float, float], ...]:
    """Position and probability of each sensor that was tried."""
    return tuple((one.parameters["position"], one.probability) for _, one in tried if one.kind == "sensor")
