"""The most informative positions of additional sensors.

    M(x) = M + Jt' Jt,      Jt = L_x^-1 (J_x - R_x R^-1 J),      L_x L_x' = R_xx - R_x R^-1 R_x'

An additional sensor at x adds the information of its readings that the existing sensors and flux plates do not give.
Face noise, offsets and position errors, including those of the new sensor, are counted as in the interval of the
estimate. Several sensors are placed one after the other (greedy search).

Source: D. Ucinski, Optimal Measurement Methods for Distributed Parameter System Identification (2004).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from .._internal.blas_threads import one_blas_thread
from .._internal.errors import InputError
from .._internal.html import html_table
from .._internal.progress import Progress, shown_progress
from .._internal.result_object import ResultObject, plain_value
from ..case.case_definition import Case
from ..case.time_window import HasBestWindow, Window, as_window, check_unbroken, entire_record
from ..case.wall_and_sensors import Sensor
from ..models.flux_plates import flux_readings
from .fisher_information import (
    Criterion,
    ParametersOfInterest,
    Robust,
    check_choices,
    criterion_of,
    design_diffusivities,
    indices_of_interest,
    information_matrix,
    relative_criterion,
    relative_std,
    typical_sensor,
)
from .information_contributions import WindowContributions, rows_per_bin
from .predicted_response import ResponseModel
from .window_selection import criterion_text

if TYPE_CHECKING:
    from pandas import DataFrame

_CANDIDATE_COUNT = 19  # evenly spaced between the faces
_MAX_ADDED = 6
_NEARLY_BEST = 0.98  # relative criterion of positions that are reported as equally good
_ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")


@dataclass(frozen=True, eq=False)
class SensorPlacement(ResultObject):
    """The expected effect of one additional sensor at each candidate position, then of a second one, and so on.

    Args:
        candidates: candidate positions, m from the left face, `(candidate,)`.
        existing: positions of the existing sensors, m.
        sensor: the assumed additional sensor, with its standard deviations.
        diffusivities: at which the criterion was evaluated, m2/s.
        criterion_before: the criterion with the existing sensors, `(diffusivity,)`.
        criterion_after: with one more sensor at each candidate, `(added, diffusivity, candidate)`.
        std_before, std: expected relative standard error of the diffusivity, shapes as the criterion's.
        chosen: the best position, then the best one given the first, and so on, m.
        window: rows of the record; `labels`: their first and last time stamp.
        criterion_name, of, robust: as given to `place_sensors`.
    """

    candidates: np.ndarray
    existing: tuple[float, ...]
    sensor: Sensor
    diffusivities: tuple[float, ...]
    criterion_before: np.ndarray = field(repr=False)
    criterion_after: np.ndarray = field(repr=False)
    std_before: np.ndarray = field(repr=False)
    std: np.ndarray = field(repr=False)
    chosen: tuple[float, ...]
    window: Window
    labels: tuple[str, str]
    criterion_name: Criterion
    of: ParametersOfInterest
    robust: Robust

    @property
    def criterion_gain(self) -> np.ndarray:
        """Ratio of the criterion with one more sensor to that before it, first diffusivity, `(added, candidate)`."""
        after = self.criterion_after[:, 0]
        before = [
            self.criterion_before[0],
            *(row[self._index(x)] for row, x in zip(after, self.chosen[:-1], strict=False)),
        ]
        with np.errstate(divide="ignore", invalid="ignore"):
            return after / np.array(before)[:, None]

    @property
    def best(self) -> float:
        """The best position of one additional sensor, m from the left face."""
        return self.chosen[0]

    def relative_criterion(self, added: int = 0) -> np.ndarray:
        """The criterion of each candidate divided by that of the best one, dimensionless, `(candidate,)`."""
        return relative_criterion(self.criterion_after[added], self.robust)

    def _index(self, position: float) -> int:
        return int(np.argmin(np.abs(self.candidates - position)))

    def summary(self) -> str:
        """The best positions with the expected standard errors, as text."""
        if not np.isfinite(self.std[0, 0]).any():
            return "sensors      no additional sensor would be informative: the face temperatures are constant"
        lines, before = [], self.std_before
        for k, position in enumerate(self.chosen):
            relative, count = self.relative_criterion(k), len(self.existing) + k
            lines.append(
                f"{f'sensor {count + 1}':<12} a {_ordinal(count)} sensor helps most at {position:.3g} m from the left "
                f"face (as good within 2 %: {_ranges(self.candidates, relative >= _NEARLY_BEST * relative.max())}):"
            )
            after = self.std[k, :, self._index(position)]
            lines.append(
                f"             the standard error of the diffusivity goes from {before[0]:.2%} to {after[0]:.2%}"
                + (f" (at worst {before.max():.2%} to {after.max():.2%})" if self.robust != "no" else "")
            )
            before = after
        lines.append(
            f"criterion    {criterion_text(self.criterion_name, self.of, self.robust, self.diffusivities)};\n"
            f"             in the window {self.labels[0]} to {self.labels[1]}, noise as stated"
        )
        lines += [
            f"  at {position:7.3g} m   standard error {std:8.2%}   criterion times {gain:6.3g}"
            for position, std, gain in zip(self.candidates, self.std[0, 0], self.criterion_gain[0], strict=True)
        ]
        return "\n".join(lines)

    __str__ = summary

    def to_dict(self) -> dict[str, Any]:
        """The result as plain numbers, lists and strings, without the arrays over candidates and diffusivities."""
        stds = [float(self.std[k, 0, self._index(position)]) for k, position in enumerate(self.chosen)]
        entries = {
            "positions": list(self.chosen),
            "relative_std": stds,
            "relative_std_before": float(self.std_before[0]),
            "criterion": self.criterion_name,
            "of": self.of,
            "robust": self.robust,
            "diffusivities": list(self.diffusivities),
            "start": self.labels[0],
            "end": self.labels[1],
        }
        return plain_value(entries)

    def to_frame(self) -> DataFrame:
        """One row for each added sensor and candidate position.

        Columns: `added` (1 for the first sensor), `position` (m), `relative_std` of the diffusivity,
        `relative_criterion`, `criterion_gain` and `chosen`; at the first diffusivity.
        """
        import pandas as pd

        frames = [
            pd.DataFrame(
                {
                    "added": k + 1,
                    "position": self.candidates,
                    "relative_std": self.std[k, 0],
                    "relative_criterion": self.relative_criterion(k),
                    "criterion_gain": self.criterion_gain[k],
                    "chosen": self.candidates == position,
                }
            )
            for k, position in enumerate(self.chosen)
        ]
        return pd.concat(frames, ignore_index=True)

    def _repr_html_(self) -> str:
        stds = self.to_dict()["relative_std"]
        rows = [
            (f"position {k}", f"{x:.3g}", f"relative standard error {std:.2%}", "m")
            for k, (x, std) in enumerate(zip(self.chosen, stds, strict=True), start=1)
        ]
        return html_table("Additional sensors", rows)


def _ranges(positions: np.ndarray, selected: np.ndarray) -> str:
    """The ranges of neighbouring selected positions, as text."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], selected.astype(int), [0]])))
    runs = [positions[a:b] for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return ", ".join(f"{run[0]:.3g}" if len(run) == 1 else f"{run[0]:.3g} to {run[-1]:.3g}" for run in runs) + " m"


def _ordinal(index: int) -> str:
    return _ORDINALS[index] if index < len(_ORDINALS) else f"{index + 1}th"


@one_blas_thread
def place_sensors(
    case: Case,
    window: Window | HasBestWindow | None = None,
    *,
    candidates: Sequence[float] | None = None,
    count: int = 1,
    criterion: Criterion = "D",
    of: ParametersOfInterest = "diffusivity",
    robust: Robust = "no",
    diffusivities: Sequence[float] | None = None,
    noise_std: float | None = None,
    position_std: float | None = None,
    offset_std: float | None = None,
    progress: Progress | None = None,
) -> SensorPlacement:
    """The positions where additional sensors add most information on the diffusivity, given the existing sensors.

    Args:
        window: rows of the record; None for the whole record, or its longest unbroken part.
        candidates: candidate positions, m from the left face; None for 19 evenly spaced ones.
        count: number of sensors to add, one after the other.
        criterion: "D", "A" or "E".
        of: the parameters of the criterion: the "diffusivity" alone (D, A and E agree), with the "constants" (offsets
            and position errors), or "all" parameters of the estimate without the additional sensor.
        robust: "no" takes the first diffusivity, "expected" the mean over all, "worst" the worst of all.
        diffusivities: m2/s; None for the prior, and for a robust design a quarter to four times the prior.
        noise_std, position_std, offset_std: of the additional sensor, K, m, K; None for the median over the existing
            sensors.
        progress: called as `progress(text, share)` with the step that begins and the completed share, 0 to 1;
            None for a bar in a notebook, and nothing elsewhere.

    Returns:
        the criterion and the expected standard error at each candidate, and the chosen positions.

    Raises:
        InputError: the case has no sensor, a candidate is outside the wall, or an option is unknown.

    Source: D. Ucinski, Optimal Measurement Methods for Distributed Parameter System Identification (2004).
    """
    check_choices(criterion, of, robust)
    alphas = design_diffusivities(case, diffusivities, robust)
    if not case.sensors:
        raise InputError(f"{case.path}: no [[sensor]]: an additional sensor is placed given at least one existing one")
    if not 1 <= count <= _MAX_ADDED:
        raise InputError(f"count = {count}: 1 to {_MAX_ADDED} additional sensors can be placed")
    window = entire_record(case) if window is None else as_window(window)
    check_unbroken(case, window)
    positions = _candidate_positions(case, candidates)
    sensor = typical_sensor(case.sensors, noise_std=noise_std, position_std=position_std, offset_std=offset_std)
    existing = [s.position for s in case.sensors]
    model = ResponseModel(case, [*existing, *positions])
    bin_rows = rows_per_bin(window.rows * (len(model.outputs) - len(positions) + count))
    states: list[_PlacementState] = []
    after, std, chosen = [], [], []
    with shown_progress(progress) as report:
        report(f"sensors: the response at {len(positions)} positions", 0.0)
        for alpha in alphas:
            predicted = model.predict(np.array([window.row]), window.rows, alpha)
            contributions = WindowContributions(case, predicted, np.array([window.row]), window.rows, bin_rows)
            states.append(_PlacementState(case, contributions, of))
        before = np.array([criterion_of(state.matrix, criterion, state.indices) for state in states])
        for k in range(count):
            report(f"sensors: {k + 1} of {count}", 0.3 + 0.7 * k / count)
            matrices = [
                [state.information_with(sensor, len(existing) + c) for c in range(len(positions))] for state in states
            ]
            after.append([[criterion_of(M, criterion, states[0].indices) for M in row] for row in matrices])
            std.append([[relative_std(M) for M in row] for row in matrices])
            best = int(np.argmax(relative_criterion(np.array(after[-1]), robust)))
            chosen.append(best)
            for state in states:
                state.add(sensor, len(existing) + best)
    stamp = case.record.stamp
    return SensorPlacement(
        candidates=positions,
        existing=tuple(existing),
        sensor=sensor,
        diffusivities=alphas,
        criterion_before=before,
        criterion_after=np.array(after),
        std_before=np.array([state.std_before for state in states]),
        std=np.array(std),
        chosen=tuple(float(positions[c]) for c in chosen),
        window=window,
        labels=(str(stamp(window.row)), str(stamp(window.row + window.rows))),
        criterion_name=criterion,
        of=of,
        robust=robust,
    )


class _PlacementState:
    """The information at one diffusivity from the existing sensors and those added so far."""

    def __init__(self, case: Case, window: WindowContributions, of: ParametersOfInterest):
        rows = Window(int(window.starts[0]), window.rows)
        present, flux_present = (
            np.isfinite(x) for x in (case.record.sensors[rows.as_slice], flux_readings(case, rows))
        )
        self.row_present = np.asarray(present.any(axis=1))  # the rows in which an additional sensor has a reading
        self.window = window
        self.contributions = window.contributions_of_case(0, present, flux_present)
        contributions = [one for _, one in self.contributions]
        self.matrix = information_matrix(contributions, window.whitening(self.contributions))
        self.indices = indices_of_interest(of, contributions)
        self.std_before = relative_std(self.matrix)

    def information_with(self, sensor: Sensor, index: int) -> np.ndarray:
        """M with one more sensor."""
        added = self.window.contribution(0, index, sensor, self.row_present)
        whitening = self.window.whitening(self.contributions).with_sensor(added.face_noise, added.variance)
        return information_matrix([*(one for _, one in self.contributions), added], whitening)

    def add(self, sensor: Sensor, index: int) -> None:
        """Count one more sensor among the existing ones."""
        added = self.window.contribution(0, index, sensor, self.row_present)
        self.contributions = [*self.contributions, (index, added)]


def _candidate_positions(case: Case, candidates: Sequence[float] | None) -> np.ndarray:
    """The candidate positions from left to right, m."""
    length = case.wall.length
    if candidates is None:
        return length * np.arange(1, _CANDIDATE_COUNT + 1) / (_CANDIDATE_COUNT + 1)
    positions = np.unique(np.asarray(candidates, float))
    if not len(positions) or not np.all((positions > 0) & (positions < length)):
        raise InputError(f"candidates = {list(candidates)}; at least one is needed, each between 0 and {length:g} m")
    return positions
