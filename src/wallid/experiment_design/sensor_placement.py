"""Where a further sensor would tell most.

    M(x) = M + Jt' Jt,      Jt = L_x^-1 (J_x - R_x R^-1 J),      L_x L_x' = R_xx - R_x R^-1 R_x'

A further sensor at x adds what its readings tell beyond those that are there, flux plates among them: the faces'
noise, offsets and position errors, its own too, are counted as the interval counts them. Several are found one after
the other (greedily).

Source: D. Ucinski, Optimal Measurement Methods for Distributed Parameter System Identification (2004).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from .._internal.errors import InputError
from ..case.case_definition import Case
from ..case.time_window import HasBest, Window, as_window, check_unbroken, whole
from ..case.wall_and_sensors import Sensor
from ..models.flux_plates import flux_readings
from .fisher_information import (
    Criterion,
    Of,
    Robust,
    alphas_of,
    check_words,
    criterion_of,
    fisher,
    kept,
    like,
    merit,
    std_of,
)
from .information_contributions import WindowContributions, rows_per_bin
from .predicted_response import ResponseModel
from .window_selection import criterion_words

_CANDIDATES = 19  # evenly between the faces
_MOST_ADDED = 6
_NEAR = 0.98
_ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")


@dataclass(frozen=True, eq=False)
class SensorPlacement:
    """What one further sensor at each candidate place would add, then the next, and so on.

    Args:
        places: the candidates, m from the left face.
        there: the sensors that there are, m. sensor: what a further one is like.
        diffusivities: at which it was looked, m2/s.
        before: the criterion with the sensors that there are, by diffusivity.
        after: with one more at each place, `(added, diffusivity, place)`.
        std_before, std: the relative standard error of the diffusivity that is expected, alike.
        chosen: the best place, then the best beside it, and so on, m.
        window: of the record, in which `labels` says when.
    """

    places: np.ndarray
    there: tuple[float, ...]
    sensor: Sensor
    diffusivities: tuple[float, ...]
    before: np.ndarray = field(repr=False)
    after: np.ndarray = field(repr=False)
    std_before: np.ndarray = field(repr=False)
    std: np.ndarray = field(repr=False)
    chosen: tuple[float, ...]
    window: Window
    labels: tuple[str, str]
    kind: Criterion
    of: Of
    robust: Robust

    @property
    def gain(self) -> np.ndarray:
        """The criterion with one more over that before it at the first diffusivity, `(added, place)`, 1."""
        at = [self.before[0], *(self.after[k, 0, self._index(k)] for k in range(len(self.chosen) - 1))]
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.after[:, 0] / np.array(at)[:, None]

    @property
    def best(self) -> float:
        """Where one further sensor tells most, m."""
        return self.chosen[0]

    def merit(self, added: int = 0) -> np.ndarray:
        """By which a place is chosen: its criterion over the best one's, 1."""
        return merit(self.after[added], self.robust)

    def _index(self, added: int) -> int:
        return int(np.argmin(np.abs(self.places - self.chosen[added])))

    def __str__(self) -> str:
        if not np.isfinite(self.std[0, 0]).any():
            return "sensors      no further sensor would tell anything here: the faces stand still"
        lines, before = [], self.std_before
        for k, place in enumerate(self.chosen):
            at = self._index(k)
            near = _spans(self.places, self.merit(k) >= _NEAR * self.merit(k).max())
            lines.append(
                f"{f'sensor {len(self.there) + k + 1}':<12} a {_ordinal(len(self.there) + k)} sensor helps most at "
                f"{place:.3g} m from the left face (as good within 2 %: {near}):"
            )
            after = self.std[k, :, at]
            lines.append(
                f"             the diffusivity's standard error goes from {before[0]:.2%} to {after[0]:.2%}"
                + (f" (at worst {before.max():.2%} to {after.max():.2%})" if self.robust != "no" else "")
            )
            before = after
        lines.append(
            f"criterion    {criterion_words(self.kind, self.of, self.robust, self.diffusivities)};\n"
            f"             in the window {self.labels[0]} to {self.labels[1]}, noise as stated"
        )
        lines += [
            f"  at {place:7.3g} m   standard error {std:8.2%}   criterion times {gain:6.3g}"
            for place, std, gain in zip(self.places, self.std[0, 0], self.gain[0], strict=True)
        ]
        return "\n".join(lines)


def _spans(places: np.ndarray, near: np.ndarray) -> str:
    """Runs of neighbouring places."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], near.astype(int), [0]])))
    runs = [places[a:b] for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return ", ".join(f"{run[0]:.3g}" if len(run) == 1 else f"{run[0]:.3g} to {run[-1]:.3g}" for run in runs) + " m"


def _ordinal(place: int) -> str:
    return _ORDINALS[place] if place < len(_ORDINALS) else f"{place + 1}th"


def place_sensors(
    case: Case,
    window: Window | HasBest | None = None,
    *,
    places: Sequence[float] | None = None,
    count: int = 1,
    criterion: Criterion = "D",
    of: Of = "diffusivity",
    robust: Robust = "no",
    diffusivities: Sequence[float] | None = None,
    noise_std: float | None = None,
    position_std: float | None = None,
    offset_std: float | None = None,
) -> SensorPlacement:
    """Where a further sensor would tell most of the diffusivity, given those that there are.

    Args:
        window: None for the whole record, or its longest unbroken part.
        places: candidates, m from the left face; None for 19 evenly between the faces.
        count: how many to add, one after the other.
        criterion, of: the information on the "diffusivity", for which D, A and E agree, on it and the "constants"
            (offsets and position errors), or on "all" that the estimate leaves free without the further sensor.
        robust: over the diffusivities: "no" takes the first, "expected" or "worst" all.
        diffusivities: m2/s; None for the prior, and with a robust choice a quarter to four times as much.
        noise_std, position_std, offset_std: of the further sensor, K, m, K; None for the median of those there are.

    Raises:
        InputError: no sensor to compare with, a place outside the wall, or an unknown choice.
    """
    check_words(criterion, of, robust)
    alphas = alphas_of(case, diffusivities, robust)
    if not case.sensors:
        raise InputError(f"{case.path}: no [[sensor]]: where a further one helps is asked beside at least one")
    if not 1 <= count <= _MOST_ADDED:
        raise InputError(f"count = {count}: 1 to {_MOST_ADDED} further sensors can be placed")
    window = whole(case) if window is None else as_window(window)
    check_unbroken(case, window)
    candidates = _candidates(case, places)
    sensor = like(case.sensors, noise_std=noise_std, position_std=position_std, offset_std=offset_std)
    there = [s.position for s in case.sensors]
    model = ResponseModel(case, [*there, *candidates])
    bin_rows = rows_per_bin(window.rows * (len(model.outputs) - len(candidates) + count))
    looks = []
    for alpha in alphas:
        courses = model.predict(np.array([window.row]), window.rows, alpha)
        looks.append(_Look(case, WindowContributions(case, courses, np.array([window.row]), window.rows, bin_rows), of))
    before = np.array([criterion_of(look.matrix, criterion, look.kept) for look in looks])
    after, std, chosen = [], [], []
    for _ in range(count):
        found = [[look.with_one(sensor, len(there) + c) for c in range(len(candidates))] for look in looks]
        after.append([[criterion_of(M, criterion, looks[0].kept) for M in row] for row in found])
        std.append([[std_of(M) for M in row] for row in found])
        best = int(np.argmax(merit(np.array(after[-1]), robust)))
        chosen.append(best)
        for look in looks:
            look.add(sensor, len(there) + best)
    stamp = case.record.stamp
    return SensorPlacement(
        places=candidates,
        there=tuple(there),
        sensor=sensor,
        diffusivities=alphas,
        before=before,
        after=np.array(after),
        std_before=np.array([look.std_before for look in looks]),
        std=np.array(std),
        chosen=tuple(float(candidates[c]) for c in chosen),
        window=window,
        labels=(str(stamp(window.row)), str(stamp(window.row + window.rows))),
        kind=criterion,
        of=of,
        robust=robust,
    )


class _Look:
    """The window at one diffusivity with the sensors that there are, and those added."""

    def __init__(self, case: Case, looking: WindowContributions, of: Of):
        window = Window(int(looking.starts[0]), looking.rows)
        present, read = (np.isfinite(x) for x in (case.record.sensors[window.part], flux_readings(case, window)))
        self.logged = np.asarray(present.any(axis=1))  # a further sensor has its readings when any of the others has
        self.looking = looking
        self.seen = looking.contributions_of_case(0, present, read)
        self.matrix = self._fisher(self.seen)
        self.kept = kept(of, [one for _, one in self.seen])
        self.std_before = std_of(self.matrix)

    def _fisher(self, seen) -> np.ndarray:
        return fisher([one for _, one in seen], self.looking.whitening(seen))

    def with_one(self, sensor: Sensor, place: int) -> np.ndarray:
        """M with one more sensor."""
        one = self.looking.contribution(0, place, sensor, self.logged)
        whitening = self.looking.whitening(self.seen).beside(one.through, one.variance)
        return fisher([*(seen for _, seen in self.seen), one], whitening)

    def add(self, sensor: Sensor, place: int) -> None:
        """Keep one more sensor."""
        self.seen = [*self.seen, (place, self.looking.contribution(0, place, sensor, self.logged))]


def _candidates(case: Case, places: Sequence[float] | None) -> np.ndarray:
    """The candidate places, in their order from the left."""
    length = case.wall.length
    if places is None:
        return length * np.arange(1, _CANDIDATES + 1) / (_CANDIDATES + 1)
    found = np.unique(np.asarray(places, float))
    if not len(found) or not np.all((found > 0) & (found < length)):
        raise InputError(f"places = {list(places)}; at least one is needed, each between 0 and {length:g} m")
    return found
