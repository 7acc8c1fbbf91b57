"""The paper's compromise: what a longer window gives, and what its estimate costs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .._internal.arrays import on_device
from ..case.case_definition import Case
from ..case.initial_profile import scales
from ..case.time_window import Window, whole, window_rows
from ..models.flux_plates import plate_outputs
from ..models.window_inputs import full_order_model
from ..records.table_columns import FEWEST_ROWS
from .fisher_information import Criterion, Of, Robust, alphas_of, check_words, merit
from .window_information import Plates, counts_all, full_sizes, start_profiles, watched, window_information
from .window_selection import candidate_starts

_DAYS = (1.0, 2.0, 3.0, 5.0, 10.0)
_MOST_ROWS = 20_000  # past this, one length costs seconds


def days_within(case: Case) -> tuple[float, ...]:
    """Lengths to compare that fit into half the record at least once, days; none of a very long record."""
    if case.record.rows > _MOST_ROWS:
        return ()
    rows = {days: case.record.rows_per(days) for days in _DAYS}
    return tuple(days for days in _DAYS if FEWEST_ROWS <= rows[days] <= whole(case).rows // 2)


@dataclass(frozen=True)
class LengthComparison:
    """The paper's compromise: what a longer window gives, and what its estimate costs.

    Args:
        days: the windows' lengths.
        criterion: the best window's information, over the longest's, 1.
        seconds: of one estimate; NaN where it was not asked for.
    """

    days: np.ndarray
    criterion: np.ndarray
    seconds: np.ndarray

    def __str__(self) -> str:
        lines = []
        for days, criterion, seconds in zip(self.days, self.criterion, self.seconds, strict=True):
            cost = "" if np.isnan(seconds) else f"   {1e3 * seconds:6.2f} ms"
            lines.append(f"  {days:6.2f} days   criterion {criterion:5.3f}{cost}")
        costs = ", and what its estimate costs" if np.isfinite(self.seconds).any() else ""
        return "\n".join([f"lengths      the best window of each{costs}", *lines])


def compare_lengths(
    case: Case,
    days: Sequence[float],
    cost: Callable[[Window], float] | None = None,
    *,
    full: bool | None = None,
    criterion: Criterion = "D",
    of: Of = "diffusivity",
    robust: Robust = "no",
    diffusivities: Sequence[float] | None = None,
    on_length: Callable[[float], None] = lambda days: None,
) -> LengthComparison:
    """The criterion of the best window of each length, and what its estimate costs.

    Args:
        cost: seconds of an estimate from a window, such as `seconds_of_estimate` measures; asked for the shortest, the
            middle and the longest, which each compile an estimate of their own; None for no cost.
        full, criterion, of, robust, diffusivities: as in `design`.
        on_length: told of each length when it is done.
    """
    check_words(criterion, of, robust)
    rows = tuple(window_rows(case, length) for length in days)
    starts = candidate_starts(case.record, min(rows), None)
    alphas = alphas_of(case, diffusivities, robust)
    if counts_all(case, full):
        information = full_sizes(case, starts, rows, alphas, criterion, of)[0]
    else:
        fourier = on_device(scales(case).fourier(np.asarray(alphas)))
        profiles, system = start_profiles(case, starts), full_order_model(case, plate_outputs(case))
        data, plates = watched(case), Plates.of(case, rows)
        found = window_information(system, fourier, data, on_device(starts), profiles, plates, rows=rows)
        information = np.asarray(found) * np.square(np.asarray(fourier))[:, None, None]
    best, seconds = [], np.full(len(days), np.nan)
    asked = {0, len(days) // 2, len(days) - 1}
    for k, length in enumerate(days):
        there = np.flatnonzero(case.record.holds(starts, rows[k]))
        sizes = information[:, there, k]
        at = int(np.argmax(merit(sizes, robust)))
        best.append(sizes[:, at])
        if cost is not None and k in asked:
            seconds[k] = cost(Window(int(starts[there[at]]), rows[k]))
        on_length(length)
    return LengthComparison(np.asarray(days, float), merit(np.array(best).T, robust), seconds)
