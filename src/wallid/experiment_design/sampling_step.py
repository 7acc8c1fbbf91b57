"""The expected uncertainty of the diffusivity for other sampling steps of the record."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy

from .._internal.errors import InputError
from .._internal.result_object import ResultObject
from ..case.case_definition import Case
from ..case.time_window import HasBestWindow, Window, as_window, check_unbroken, entire_record
from ..inference.physical_bounds import HIGHEST, LOWEST
from ..inference.quantity import NORMAL_95
from ..models.flux_plates import uninformative_rows
from ..records.table_columns import MIN_ROWS
from .fisher_information import information_matrix, relative_std
from .information_contributions import WindowContributions, rows_per_bin, whitened
from .predicted_response import ResponseModel

if TYPE_CHECKING:
    from pandas import DataFrame

_LARGEST_LOG_RATIO = math.log(HIGHEST / LOWEST)  # no interval of a diffusivity is wider


@dataclass(frozen=True, eq=False)
class SamplingComparison(ResultObject):
    """The expected interval of the diffusivity for each sampling step of faces and sensors.

    Args:
        steps: sampling steps, s, `(step,)`. rows: number of rows of the window at each step.
        std: expected relative standard error of the diffusivity, dimensionless.
        interpolation_bias: relative bias of the diffusivity from interpolation of the face temperatures between rows;
            0 for the record's step and finer ones, where the true temperatures between rows are unknown.
        record_step: the record's step, s.
        diffusivity: at which all was computed, m2/s.
        labels: first and last time stamp of the window.
    """

    steps: np.ndarray
    rows: np.ndarray
    std: np.ndarray
    interpolation_bias: np.ndarray
    record_step: float
    diffusivity: float
    labels: tuple[str, str]

    @property
    def interval_ratio(self) -> np.ndarray:
        """Upper end of the expected 95 % interval divided by its lower end."""
        return np.exp(np.minimum(2 * NORMAL_95 * self.std, _LARGEST_LOG_RATIO))

    def to_frame(self) -> DataFrame:
        """One row for each step: `rows`, `std`, `interval_ratio` and `interpolation_bias`; the index is the step, s."""
        import pandas as pd

        names = ("rows", "std", "interval_ratio", "interpolation_bias")
        columns = {name: getattr(self, name) for name in names}
        return pd.DataFrame(columns, index=pd.Index(self.steps, name="step (s)"))

    def _html_title(self) -> str:
        return f"Sampling steps in {self.labels[0]} to {self.labels[1]}: relative standard error of the diffusivity"

    def __str__(self) -> str:
        if not np.isfinite(self.std).any():
            return "sampling     no sampling step is informative: the face temperatures are constant"
        lines = [
            f"sampling     {self.labels[0]} to {self.labels[1]} at alpha = {self.diffusivity:.3g} m2/s, noise as stated"
        ]
        for step, rows, std, bias in zip(self.steps, self.rows, self.std, self.interpolation_bias, strict=True):
            mark = "  <- the record's" if abs(step - self.record_step) < 1e-6 * step else ""
            half = math.expm1(min(NORMAL_95 * std, _LARGEST_LOG_RATIO))
            lines.append(
                f"  every {step:7.6g} s ({rows:6d} rows)   95 % interval: up to {half:+8.1%}   "
                f"bias by interpolated faces: {bias:+.1%}{mark}"
            )
        return "\n".join(lines)


def compare_sampling_steps(
    case: Case,
    window: Window | HasBestWindow | None = None,
    *,
    factors: Sequence[float] = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0),
    diffusivity: float | None = None,
) -> SamplingComparison:
    """The expected interval of the diffusivity for finer and coarser sampling steps.

    Each reading has the stated noise. With a coarser step the face temperatures are cubics between its fewer rows; the
    bias that this causes is given too. Between two rows of the record itself the true face temperatures are
    unknown, so for finer steps they are taken as cubics.

    Args:
        window: rows of the record; None for the whole record, or its longest unbroken part. All sensors are assumed to
            be logged together with the faces.
        factors: sampling steps relative to the record's: integers or their reciprocals. Steps that leave too few rows
            are omitted.
        diffusivity: m2/s; None for the prior.

    Returns:
        rows, expected standard error and bias for each step.

    Raises:
        InputError: the case has no sensor, or a factor is neither an integer nor the reciprocal of one.
    """
    if not case.sensors:
        raise InputError(f"{case.path}: no [[sensor]]: sampling steps are compared for temperatures inside the wall")
    window = entire_record(case) if window is None else as_window(window)
    check_unbroken(case, window)
    alpha = case.wall.diffusivity_prior if diffusivity is None else diffusivity
    refine, strides = _strides(factors)
    fine = (window.rows - 1) * refine + 1
    strides = strides[(fine - 1) // strides + 1 >= MIN_ROWS]
    if not len(strides):
        raise InputError(f"factors = {list(factors)}: each leaves fewer than {MIN_ROWS} of {window.rows} rows")
    model = ResponseModel(case, [sensor.position for sensor in case.sensors], refine)
    faces = model.faces(window.row, window.rows)
    fine_step = case.record.step / refine
    faces = [faces, *(_interpolated_faces(faces[0], int(stride), fine_step) for stride in strides)]
    starts = np.full(len(faces), window.row)
    predicted = model.predict(starts, window.rows, alpha, faces)
    rows, results = (fine - 1) // strides + 1, []
    for k, stride in enumerate(strides, start=1):
        bin_rows = rows_per_bin(int(rows[k - 1]) * len(model.outputs))
        contributions = WindowContributions(case, predicted, starts, window.rows, bin_rows, int(stride))
        results.append(_std_and_bias(contributions, k, case.record.step * int(stride) / refine))
    std, log_bias = np.array(results).T
    stamp = case.record.stamp
    return SamplingComparison(
        steps=case.record.step * strides / refine,
        rows=rows,
        std=std,
        interpolation_bias=np.expm1(log_bias),
        record_step=case.record.step,
        diffusivity=alpha,
        labels=(str(stamp(window.row)), str(stamp(window.row + window.rows))),
    )


def _std_and_bias(contributions: WindowContributions, window: int, step: float) -> tuple[float, float]:
    """The relative standard error at a sampling step, s, and the bias of ln(alpha) by interpolated faces."""
    case, temperature = contributions.case, contributions.predicted.temperature
    # readings under the true faces minus the prediction under interpolated ones
    residual = (temperature[0] - temperature[window])[:: contributions.stride]
    present = np.ones(residual.shape, bool)
    sensors = len(case.sensors)
    present[: uninformative_rows(case, len(residual), step), sensors:] = False
    indexed = contributions.contributions_of_case(window, present[:, :sensors], present[:, sensors:])
    each, whitening = [one for _, one in indexed], contributions.whitening(indexed)
    matrix = information_matrix(each, whitening)
    if (std := relative_std(matrix)) == math.inf:
        return std, 0.0
    binned = [contributions.binned(one[:, None], used) for one, used in zip(residual.T, present.T, strict=True)]
    white = whitening.whiten(np.concatenate([mean[count > 0] for mean, count in binned]))[:, 0]
    return std, float(np.linalg.solve(matrix, whitened(each, whitening).T @ white)[0])


def _strides(factors: Sequence[float]) -> tuple[int, np.ndarray]:
    """The refinement of the record's step by the finest one, and each step as a multiple of the finest.

    Raises:
        InputError: a factor is neither an integer nor the reciprocal of one.
    """
    parts = [round(1.0 / factor) if 0.0 < factor < 1.0 else 1 for factor in factors]
    refine = math.lcm(*parts) if parts else 1
    strides = np.array([factor * refine for factor in factors])
    rounded = np.round(strides)
    if not len(strides) or np.any(np.abs(strides - rounded) > 1e-6 * np.abs(strides)) or rounded.min() < 1:
        raise InputError(f"factors = {list(factors)}: each must be an integer (2, 4) or the reciprocal of one (0.5)")
    return refine, np.unique(rounded.astype(int))


def _interpolated_faces(faces: np.ndarray, stride: int, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Face temperatures read every `stride` rows and interpolated by cubics between, and their slopes, K/s."""
    read = np.arange(0, len(faces), stride)
    rows = np.arange(len(faces)).clip(max=read[-1])
    cubics = scipy.interpolate.PchipInterpolator(read, faces[read])
    return cubics(rows), cubics.derivative()(rows) / step
