"""What a record logged more often or more rarely would tell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._internal.errors import InputError
from ..case.case_definition import Case
from ..case.time_window import HasBest, Window, as_window, check_unbroken, whole
from ..inference.quantity import NORMAL_95
from ..models.flux_plates import untold_rows
from ..records.table_columns import FEWEST_ROWS
from .fisher_information import fisher, std_of
from .information_contributions import WindowContributions, rows_per_bin, whitened
from .predicted_response import ResponseModel


@dataclass(frozen=True, eq=False)
class SamplingComparison:
    """What the interval would be with faces and sensors logged more often or more rarely.

    Args:
        steps: s, from row to row. rows: how many the window has then.
        std: the relative standard error of the diffusivity that is expected, 1. spans: of the 95 % interval, its upper
            end over its lower.
        shift: what straight lines between rarer rows make of the diffusivity, relative; 0 for the record's own step and
            finer ones, for which the record does not tell what it left out.
        own: the record's step, s.
    """

    steps: np.ndarray
    rows: np.ndarray
    std: np.ndarray
    shift: np.ndarray
    own: float
    diffusivity: float
    labels: tuple[str, str]

    @property
    def spans(self) -> np.ndarray:
        """The 95 % interval's upper end over its lower, 1."""
        return np.exp(np.minimum(2 * NORMAL_95 * self.std, 700.0))

    def __str__(self) -> str:
        if not np.isfinite(self.std).any():
            return "sampling     no step would tell anything here: the faces stand still"
        lines = [
            f"sampling     {self.labels[0]} to {self.labels[1]} at alpha = {self.diffusivity:.3g} m2/s, noise as stated"
        ]
        for step, rows, std, shift in zip(self.steps, self.rows, self.std, self.shift, strict=True):
            mark = "  <- the record's" if abs(step - self.own) < 1e-6 * step else ""
            half = math.expm1(min(NORMAL_95 * std, 700.0))
            lines.append(
                f"  every {step:7.6g} s ({rows:6d} rows)   95 % interval: up to {half:+8.1%}   "
                f"faces straight between rows: {shift:+.1%}{mark}"
            )
        return "\n".join(lines)


def compare_sampling_steps(
    case: Case,
    window: Window | HasBest | None = None,
    *,
    factors: Sequence[float] = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0),
    diffusivity: float | None = None,
) -> SamplingComparison:
    """What the diffusivity's interval would be with a row more often or more rarely.

    Each reading keeps the noise that is stated; between rarer rows the faces are straight lines, whose error is told
    as a shift of the estimate. What happens between the record's own rows nobody knows: finer steps are taken along
    its straight lines.

    Args:
        window: None for the whole record, or its longest unbroken part. Sensors are taken to be logged with the faces.
        factors: of the record's step: whole numbers, or one over such. Those that leave fewer than six rows are left
            out.
        diffusivity: m2/s; None for the prior.

    Raises:
        InputError: no sensor, or a factor that is neither.
    """
    if not case.sensors:
        raise InputError(f"{case.path}: no [[sensor]]: the sampling is asked of temperatures inside the wall")
    window = whole(case) if window is None else as_window(window)
    check_unbroken(case, window)
    alpha = case.wall.diffusivity_prior if diffusivity is None else diffusivity
    refine, strides = _strides(factors)
    fine = (window.rows - 1) * refine + 1
    strides = strides[(fine - 1) // strides + 1 >= FEWEST_ROWS]
    if not len(strides):
        raise InputError(f"factors = {list(factors)}: each leaves fewer than {FEWEST_ROWS} of {window.rows} rows")
    model = ResponseModel(case, [sensor.position for sensor in case.sensors], refine)
    own = model.faces(window.row, window.rows)
    faces = np.stack([own, *(_straight(own, int(stride)) for stride in strides)])
    starts = np.full(len(faces), window.row)
    courses = model.predict(starts, window.rows, alpha, faces)
    rows, told = (fine - 1) // strides + 1, []
    for k, stride in enumerate(strides, start=1):
        bins = rows_per_bin(int(rows[k - 1]) * len(model.outputs))
        looking = WindowContributions(case, courses, starts, window.rows, bins, int(stride))
        told.append(_at_step(looking, k, case.record.step * int(stride) / refine))
    std, shift = np.array(told).T
    stamp = case.record.stamp
    return SamplingComparison(
        steps=case.record.step * strides / refine,
        rows=rows,
        std=std,
        shift=np.expm1(shift),
        own=case.record.step,
        diffusivity=alpha,
        labels=(str(stamp(window.row)), str(stamp(window.row + window.rows))),
    )


def _at_step(looking: WindowContributions, window: int, step: float) -> tuple[float, float]:
    """The relative standard error that rows so many seconds apart leave, and the shift of ln(alpha) by their lines."""
    case, courses = looking.case, looking.courses
    # what the readings are beside what the straight lines predict
    apart = (courses.temperature[0] - courses.temperature[window])[:: looking.stride]
    present = np.ones(apart.shape, bool)
    sensors = len(case.sensors)
    present[: untold_rows(case, len(apart), step), sensors:] = False
    keyed = looking.contributions_of_case(window, present[:, :sensors], present[:, sensors:])
    seen, whitening = [one for _, one in keyed], looking.whitening(keyed)
    matrix = fisher(seen, whitening)
    if (std := std_of(matrix)) == math.inf:
        return std, 0.0
    binned = [looking.binned(course[:, None], there) for course, there in zip(apart.T, present.T, strict=True)]
    white = whitening.whiten(np.concatenate([mean[count > 0] for mean, count in binned]))[:, 0]
    return std, float(np.linalg.solve(matrix, whitened(seen, whitening).T @ white)[0])


def _strides(factors: Sequence[float]) -> tuple[int, np.ndarray]:
    """How much finer the finest step is than the record's, and each step in rows of that.

    Raises:
        InputError: a factor that is neither a whole number nor one over such.
    """
    parts = [round(1.0 / factor) if 0.0 < factor < 1.0 else 1 for factor in factors]
    refine = math.lcm(*parts) if parts else 1
    strides = np.array([factor * refine for factor in factors])
    whole_ones = np.round(strides)
    if not len(strides) or np.any(np.abs(strides - whole_ones) > 1e-6 * np.abs(strides)) or whole_ones.min() < 1:
        raise InputError(f"factors = {list(factors)}: each must be a whole number (2, 4) or one over such (0.5, 0.25)")
    return refine, np.unique(whole_ones.astype(int))


def _straight(faces: np.ndarray, stride: int) -> np.ndarray:
    """Faces as they are when only every so many rows are read: straight lines between."""
    at = np.arange(len(faces))
    return np.stack([np.interp(at, at[::stride], course[::stride]) for course in faces.T], axis=1)
