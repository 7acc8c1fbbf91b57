"""A forecast of the readings: mean and standard deviation of each sensor and plate, row by row.

The wall is estimated from the readings before a time. A Kalman filter carries what they say of the disturbance, of the
noise that has a memory, and of every parameter to that time, and from there on without readings:

    y_t ~ N(M_t + H_t m_t, H_t P_t H_t' + r),      s_{t+1} = Phi s_t + G w_t

with `M_t` the fit's prediction for the faces, and `r` the variance of a reading's white noise. The faces are those of
the record, or go on as a day before from their last reading (persistence). The error of persistence is that which it
would have had on the earlier days, through the wall.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Float

from .._internal.errors import InputError
from .._internal.html import html_table
from .._internal.number_formats import value_and_std
from .._internal.progress import Progress, shown_progress
from .._internal.result_object import ResultObject, plain_value
from .._internal.units import DAY
from .._internal.validation import one_of
from ..case.case_definition import Case
from ..case.time_window import Window, check_unbroken
from ..inference.disturbance_search import Disturbance
from ..inference.filter_model import FilterModel, filter_model
from ..inference.generalised_least_squares import fit_generalised_least_squares
from ..inference.gls_fit import GLSFit
from ..inference.kalman_filter import forecast_states
from ..inference.quantity import NORMAL_95
from ..models.flux_plates import fluxes_of, full_order_model_with_plates
from ..models.window_inputs import window_data
from ..records.row_times import RecordStart
from ..records.uniform_record import Record

if TYPE_CHECKING:
    from pandas import DataFrame

TRAINING_DAYS = 7.0
"""Days before the forecast from which the wall is estimated."""
HORIZONS = (1.0, 6.0, 24.0)
"""Hours ahead, at which predictions of the readings already taken are tested."""
_FEWEST_ROWS = 24  # to estimate from


@dataclass(frozen=True)
class StepErrors(ResultObject):
    """How well readings are predicted some hours ahead, from all the readings up to then.

    Args:
        hours: ahead.
        rms: root mean square of reading minus prediction, of each output, K or W/m2; NaN without one.
        coverage: share of the readings in their 95 % band, of each output.
        count: of the predictions.
    """

    hours: float
    rms: tuple[float, ...]
    coverage: tuple[float, ...]
    count: int


@dataclass(frozen=True, eq=False)
class Forecast(ResultObject):
    """The readings after a time, with their standard deviations.

    Args:
        case: with the record, which may have been lengthened.
        window: rows of the estimate, then those of the forecast.
        first: the first row of the forecast, within the window.
        names: of the outputs: the sensors, then `flux_left` and `flux_right`.
        mean, std: of the readings, degC, K and W/m2, `(time, output)`; the noise of a reading is part of `std`.
        measured: readings of the whole window, NaN where there is none, `(time, output)`.
        faces: "record" or "persistence".
        disturbance: found in the readings before; None where there is none.
        step_errors: how well the readings before were predicted, for some hours ahead.
    """

    case: Case = field(repr=False)
    window: Window
    first: int
    names: tuple[str, ...]
    mean: np.ndarray = field(repr=False)
    std: np.ndarray = field(repr=False)
    measured: np.ndarray = field(repr=False)
    faces: str
    disturbance: Disturbance | None
    step_errors: tuple[StepErrors, ...]

    @property
    def hours(self) -> float:
        """Length of the forecast, h."""
        return len(self.mean) * self.case.record.step / 3600.0

    @property
    def units(self) -> tuple[str, ...]:
        """degC or W/m2, of each output."""
        return tuple("W/m2" if name.startswith("flux_") else "degC" for name in self.names)

    @property
    def start(self) -> str | float:
        """Time of the first row of the forecast."""
        return self.case.record.stamp(self.window.row + self.first)

    @property
    def record_start(self) -> RecordStart:
        """When the record begins."""
        return self.case.record.start

    @property
    def inside(self) -> tuple[float, ...]:
        """The share of each output's readings after the start that lie in their 95 % band; NaN without readings."""
        measured = self.measured[self.first :]
        within = np.abs(measured - self.mean) <= NORMAL_95 * self.std
        counts = np.isfinite(measured).sum(axis=0)
        return tuple(float(w.sum() / c) if c else math.nan for w, c in zip(within.T, counts, strict=True))

    def last(self, output: int) -> str:
        """The last value of an output with its standard deviation, as text."""
        return value_and_std(float(self.mean[-1, output]), float(self.std[-1, output]), self.units[output])

    def to_dict(self) -> dict[str, Any]:
        """The entries of result.json; the rows are in `forecast.csv`."""
        entries = {
            "start": self.start,
            "hours": self.hours,
            "faces": self.faces,
            "training_days": self.first * self.case.record.step / DAY,
            "outputs": {
                name: {
                    "unit": unit,
                    "last": {"value": float(self.mean[-1, k]), "std": float(self.std[-1, k])},
                    "inside_95": self.inside[k],
                }
                for k, (name, unit) in enumerate(zip(self.names, self.units, strict=True))
            },
            "step_errors": [
                {"hours": one.hours, "rms": list(one.rms), "coverage_95": list(one.coverage), "count": one.count}
                for one in self.step_errors
            ],
        }
        return plain_value(entries)

    def to_frame(self) -> DataFrame:
        """One row for each time: each output's mean, and its standard deviation as `NAME_std`."""
        import pandas as pd

        columns: dict[str, np.ndarray] = {}
        for k, name in enumerate(self.names):
            columns |= {name: self.mean[:, k], f"{name}_std": self.std[:, k]}
        rows = self.window.row + self.first + np.arange(len(self.mean))
        seconds = np.asarray(self.case.record.time)[rows]
        return pd.DataFrame(columns, index=self.record_start.index_after(seconds).rename("time"))

    def to_csv(self) -> str:
        """`forecast.csv`: `time` as in the record, then each output's mean and `NAME_std`."""
        stamps = [self.case.record.stamp(self.window.row + self.first + k) for k in range(len(self.mean))]
        frame = self.to_frame()
        frame.index = frame.index.__class__(stamps, name="time") if isinstance(stamps[0], float) else stamps
        return frame.rename_axis("time").to_csv(float_format="%.6g", lineterminator="\n")

    def summary(self) -> str:
        """The forecast of each output at its end, and how well earlier readings were predicted, as text."""
        how = "the record" if self.faces == "record" else "the day before"
        lines = [
            f"forecast     {self.hours:.3g} h from {self.start}, the faces as in {how}, "
            f"from {self.first * self.case.record.step / DAY:.3g} days of readings"
        ]
        for k, name in enumerate(self.names):
            known = f"; {self.inside[k]:.0%} of its readings lie in the 95 % band" if self.inside[k] >= 0 else ""
            lines.append(f"  {name:<11} {self.last(k)} at the end{known}")
        if self.disturbance is not None:
            lines.append(f"disturbance  {self.disturbance}")
        for one in self.step_errors:
            each = ", ".join(
                f"{name} {rms:.2g} {'W/m2' if unit == 'W/m2' else 'K'} ({share:.0%})"
                for name, unit, rms, share in zip(self.names, self.units, one.rms, one.coverage, strict=True)
            )
            lines.append(f"{one.hours:g} h ahead".ljust(13) + f"{each}; in parentheses the share in the 95 % band")
        return "\n".join(lines)

    __str__ = summary

    def _repr_html_(self) -> str:
        rows = [(name, self.last(k), "", "") for k, name in enumerate(self.names)]
        return html_table(f"Forecast for {self.hours:.3g} h from {self.start}: at its end", rows)


def forecast(
    case: Case,
    start: str | float | int,
    hours: float = 24.0,
    *,
    days: float = TRAINING_DAYS,
    faces: Literal["record", "persistence"] = "record",
    progress: Progress | None = None,
) -> Forecast:
    """Forecast the readings of all sensors and plates after a time.

    Args:
        case: the case; with `disturbance` None a disturbance is used where the record has evidence for it.
        start: time of the first row of the forecast, as in the record: ISO 8601, or s where it has seconds.
        hours: length of the forecast.
        days: of readings before it, from which the wall is estimated; fewer where the record has fewer.
        faces: "record": as logged, and as the day before where the record ends. "persistence": as the day before.
        progress: called as `progress(text, share)`; None for a bar in a notebook, and nothing elsewhere.

    Raises:
        InputError: a time outside the record, or too few readings before it.

    Source: J. Durbin, S. J. Koopman, Time Series Analysis by State Space Methods (2012), 4.11.
    """
    one_of("faces", faces, ("record", "persistence"))
    if not hours > 0:
        raise InputError(f"hours = {hours}; it must be above 0")
    if case.choices.disturbance is None:
        case = replace(case, choices=replace(case.choices, disturbance="auto"))
    record = case.record
    first = _row_of(record, start)
    begin = _first_row(record, first, days)
    rows = max(1, round(hours * 3600.0 / record.step))
    case, persistent = _with_faces(case, begin, first, rows, faces)
    window = Window(begin, first - begin + rows)
    check_unbroken(case, window)
    with shown_progress(progress) as report:
        report("forecast: the wall from the readings before", 0.1)
        data, trained = window_data(case, window), first - begin
        model = full_order_model_with_plates(case)
        prior, eta = case.wall.diffusivity_prior, case.choices.eta
        fit = fit_generalised_least_squares(case, window, data, model, prior, eta=eta, rows_used=trained)
        report("forecast: filter", 0.7)
        states = filter_model(case, fit)
        mean, std = _after(states, fit, trained)
        if persistent < rows:
            std = np.hypot(std, _error_of_persistence(case, fit, begin, first, rows, persistent))
        report("forecast: errors of earlier predictions", 0.9)
        errors = step_errors(states, trained, record.step)
    plates = fluxes_of(case)
    return Forecast(
        case=case,
        window=window,
        first=trained,
        names=(*(sensor.name for sensor in case.sensors), *(f"flux_{face}" for face in plates)),
        mean=mean,
        std=std,
        measured=_measured(case, window),
        faces="record" if persistent == rows else "persistence",
        disturbance=fit.disturbance,
        step_errors=errors,
    )


def _row_of(record: Record, start: str | float | int) -> int:
    """The row of a time; the row after the last is allowed.

    Raises:
        InputError: a time that is not one, or outside the record.
    """
    if isinstance(record.stamps[0], np.datetime64):
        try:
            text = str(start).removesuffix("Z")
            seconds = float((np.datetime64(text) - record.stamps[0]) / np.timedelta64(1, "s"))
        except ValueError:
            raise InputError(f"--from {start}: it must be a time such as {record.stamp(0)}") from None
    else:
        try:
            seconds = float(start) - float(record.stamps[0])
        except ValueError:
            raise InputError(f"--from {start}: the record has seconds; state such as {record.stamp(0):g}") from None
    row = math.ceil(seconds / record.step - 1e-6)
    if not 0 < row <= record.rows:
        raise InputError(f"--from {start}: it must lie between {record.stamp(1)} and {record.stamp(record.rows)}")
    return row


def _first_row(record: Record, first: int, days: float) -> int:
    """The first row of the estimate: at most so many days before, without a break."""
    begin = max(0, first - record.rows_in_days(days))
    broken = np.flatnonzero(record.broken[begin:first])
    begin += 0 if not len(broken) else int(broken[-1]) + 1
    if first - begin < _FEWEST_ROWS:
        raise InputError(
            f"--from {record.stamp(first)}: there are {first - begin} rows before it without a break; a forecast needs "
            f"at least {_FEWEST_ROWS}"
        )
    return begin


def _with_faces(case: Case, begin: int, first: int, rows: int, faces: str) -> tuple[Case, int]:
    """The case with faces for all rows, and the number of rows whose faces are the record's own."""
    record = case.record
    known = 0 if faces == "persistence" else max(0, min(rows, record.rows - first))
    if known == rows:
        return case, rows
    day = record.rows_in_days(1.0)
    if first + known - begin < day:
        raise InputError(
            f"the faces after {record.stamp(min(first + known, record.rows))} are taken from the day before, and the "
            "record has less than a day before it"
        )
    total = max(record.rows, first + rows)
    more = total - record.rows

    def longer(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values, np.full((more, *values.shape[1:]), np.nan)])

    both = longer(np.asarray(record.faces, float))
    last = first + known - 1
    moved = both[last] - both[last - day]  # so that the course goes on from the last reading
    for row in range(last + 1, first + rows):
        both[row] = both[row - day * math.ceil((row - last) / day)] + moved
    fill = None if record.fill_std is None else np.nan_to_num(longer(np.asarray(record.fill_std)))
    stamps = np.asarray(record.stamps)
    step = np.timedelta64(round(record.step * 1e9), "ns") if isinstance(stamps[0], np.datetime64) else record.step
    later = replace(
        record,
        time=record.time[0] + record.step * np.arange(total),
        stamps=np.concatenate([stamps, stamps[-1] + step * np.arange(1, more + 1)]).astype(stamps.dtype),
        faces=both,
        sensors=longer(np.asarray(record.sensors)),
        regressors={key: longer(np.asarray(values)) for key, values in record.regressors.items()},
        fill_std=fill,
    )
    return replace(case, record=later), known


def _measured(case: Case, window: Window) -> np.ndarray:
    """The readings of sensors and plates, NaN where there is none."""
    plates = [case.record.regressors[f"flux_{face}"] for face in fluxes_of(case)]
    return np.column_stack([case.record.sensors, *plates])[window.as_slice]


def _after(states: FilterModel, fit: GLSFit, trained: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation of the readings after the first rows."""
    filtered = states.filtered(trained)
    outputs = np.asarray(states.model.outputs_at_rows(len(states.readings)))[trained:]
    after = forecast_states(states.model, filtered.mean[-1], filtered.root[-1], len(outputs))
    mean = np.asarray(fit.minimum.predicted)[trained:] + np.einsum("tos,ts->to", outputs, np.asarray(after.mean))
    roots = np.einsum("tos,tsr->tor", outputs, np.asarray(after.root))
    return mean, np.sqrt(np.sum(roots**2, axis=2) + np.asarray(states.model.output_std) ** 2)


def _error_of_persistence(
    case: Case, fit: GLSFit, begin: int, first: int, rows: int, known: int
) -> Float[np.ndarray, "time output"]:
    """Root mean square of the responses to the errors that persistence would have had on earlier days."""
    day, faces = case.record.rows_in_days(1.0), np.asarray(case.record.faces)[begin : first + known]
    differences = faces[day:] - faces[:-day]
    length = rows - known
    response = fit.noise_shape.response[:, :length]  # (face, row, output)
    total, count = np.zeros((length, response.shape[2])), 0
    for start in range(1, max(2, len(differences) - length + 1), max(1, day // 4)):
        course = differences[start : start + length] - differences[start - 1]
        course = np.pad(course, ((0, length - len(course)), (0, 0)), mode="edge")
        total, count = total + sum(_convolved(course[:, side], response[side]) for side in (0, 1)) ** 2, count + 1
    return np.concatenate([np.zeros((known, total.shape[1])), np.sqrt(total / count)])


def _convolved(course: np.ndarray, response: np.ndarray) -> np.ndarray:
    """The response to a course, `(time, output)`."""
    return np.stack([np.convolve(course, one)[: len(course)] for one in response.T], axis=1)


def step_errors(
    states: FilterModel, rows: int, step: float, horizons: tuple[float, ...] = HORIZONS
) -> tuple[StepErrors, ...]:
    """How well the readings of the first rows are predicted some hours ahead, from the readings up to then.

    The parameters, the size of the noise and the disturbance are those of the fit of all these rows; what the filter
    says of them at a row rests on the readings up to that row.

    Args:
        states: the filter's model.
        rows: of the readings.
        step: from row to row, s.
        horizons: h.
    """
    filtered, results = states.filtered(rows), []
    outputs = np.asarray(states.model.outputs_at_rows(len(states.readings)))
    readings, present = states.readings[:rows], states.present[:rows]
    begin = rows // 5  # before, the filter knows little of the parameters
    for hours in horizons:
        ahead = round(hours * 3600.0 / step)
        if ahead < 1 or begin + ahead >= rows:
            continue
        at = np.arange(begin, rows - ahead)
        mean, covariance = _predicted_ahead(states, filtered, at, ahead, outputs)
        residual = readings[at + ahead] - mean
        mask, inside = present[at + ahead], np.abs(residual) <= NORMAL_95 * np.sqrt(covariance)
        with np.errstate(invalid="ignore"):
            counts = mask.sum(axis=0)
            rms = np.sqrt(np.sum(residual**2 * mask, axis=0) / counts)
            share = (inside & mask).sum(axis=0) / counts
        results.append(StepErrors(hours, tuple(rms.tolist()), tuple(share.tolist()), int(mask.sum())))
    return tuple(results)


def _predicted_ahead(
    states: FilterModel, filtered: Any, at: np.ndarray, ahead: int, outputs: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and variance of the readings some rows after each row, given the readings up to it."""
    transition, G = np.asarray(states.model.transition), np.asarray(states.model.noise_root)
    power, added = np.eye(len(transition)), np.zeros_like(transition)
    for _ in range(ahead):
        added = transition @ added @ transition.T + G @ G.T
        power = transition @ power
    H = outputs[at + ahead]
    through = H @ power
    mean = np.einsum("tos,ts->to", through, np.asarray(filtered.mean)[at])
    roots = np.einsum("tos,tsr->tor", through, np.asarray(filtered.root)[at])
    variance = np.sum(roots**2, axis=2) + np.einsum("tos,sr,tor->to", H, added, H)
    return mean, variance + np.asarray(states.model.output_std) ** 2
