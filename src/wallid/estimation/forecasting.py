"""A forecast of the readings: mean and standard deviation of each sensor and plate, row by row.

The wall is estimated from the readings before a time. A Kalman filter carries what they say of the disturbance, of the
noise that has a memory, and of every parameter to that time, and from there on without readings:

    y_t ~ N(M_t + H_t m_t, H_t P_t H_t' + r),      s_{t+1} = Phi s_t + G w_t

with `M_t` the fit's prediction for the faces, and `r` the variance of a reading's white noise. A few days of readings
say little of the place, size and memory of a disturbance: the forecast is the average over those that are probable. The
faces are those of the record, or go on as a day before from their last reading (`persistence`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from .._internal.blas_threads import one_blas_thread
from .._internal.errors import InputError
from .._internal.progress import Progress, shown_progress
from .._internal.validation import number, one_of
from ..case.case_definition import Case
from ..case.time_window import Window, check_unbroken, row_at
from ..inference.filter_model import FilterModel, alternative_filter_models, response_at_rows
from ..inference.generalised_least_squares import fit_generalised_least_squares
from ..inference.kalman_filter import Filtered, forecast_states
from ..inference.quantity import NORMAL_95
from ..models.flux_plates import fluxes_of, full_order_model_with_plates
from ..models.window_inputs import window_data
from ..records.uniform_record import Record
from .forecast_result import Forecast, StepErrors
from .persistence import error_of_persistence, with_persistent_faces

TRAINING_DAYS = 7.0
"""Days before the forecast from which the wall is estimated."""
HORIZONS = (1.0, 6.0, 24.0)
"""Hours ahead, at which predictions of the readings already taken are tested."""
_FEWEST_ROWS = 24  # to estimate from, and readings in them
_MOST_HOURS = 8760.0


@one_blas_thread
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
        case: the case; with `disturbance` and `noise` None a disturbance is used where the record has evidence for it.
        start: time of the first row of the forecast, as in the record's file: ISO 8601, or s where it has seconds.
        hours: length of the forecast.
        days: of readings before it, from which the wall is estimated; fewer where the record has fewer.
        faces: "record": as logged, and as the day before where the record ends. "persistence": as the day before.
        progress: called as `progress(text, share)`; None for a bar in a notebook, and nothing elsewhere.

    Raises:
        InputError: a time outside the record, a break in its window, too few rows or readings before it, or less than
            three days of faces before persistence.

    Source: J. Durbin, S. J. Koopman, Time Series Analysis by State Space Methods (2012), 4.11.
    """
    one_of("faces", faces, ("record", "persistence"))
    hours = number("hours", hours, "h", above=0.0, maximum=_MOST_HOURS)
    days = number("days", days, "days", above=0.0)
    if case.choices.disturbance is None and case.choices.noise in (None, "estimated"):
        case = replace(case, choices=replace(case.choices, disturbance="auto"))
    record = case.record
    first = row_at(record, "--from", start, beyond=1)
    begin = _first_row(record, first, days)
    rows = max(1, round(hours * 3600.0 / record.step))
    _check_readings(case, begin, first)
    case, logged = with_persistent_faces(case, first, rows, faces)
    window = Window(begin, first - begin + rows)
    shorter = "shorten --days or --hours"
    check_unbroken(case, window, remedy=shorter if faces == "persistence" else f"{shorter}, take --faces persistence")
    with shown_progress(progress) as report:
        report("forecast: the wall from the readings before", 0.1)
        data, trained = window_data(case, window), first - begin
        model = full_order_model_with_plates(case)
        prior, eta = case.wall.diffusivity_prior, case.choices.eta
        fit = fit_generalised_least_squares(
            case, window, data, model, prior, eta=eta, rows_used=trained, other_rows_binned=False
        )
        report("forecast: filter", 0.7)
        alternatives = alternative_filter_models(case, window, fit)
        each = [(share, states, states.filtered(trained)) for share, states in alternatives]
        mean, variance = _averaged([(share, *_after(states, filtered)) for share, states, filtered in each])
        mean, std = np.asarray(fit.minimum.predicted)[trained:] + mean, np.sqrt(variance)
        if logged < rows:
            response = response_at_rows(case, window, fit)
            std = np.hypot(std, error_of_persistence(case.record, response, first, rows, logged))
        report("forecast: errors of earlier predictions", 0.9)
        errors = step_errors(each, record.step)
    plates = fluxes_of(case)
    return Forecast(
        case=case,
        window=window,
        first=trained,
        names=(*(sensor.name for sensor in case.sensors), *(f"flux_{face}" for face in plates)),
        mean=mean,
        std=std,
        measured=_measured(case, window),
        logged=logged,
        disturbance=fit.disturbance,
        step_errors=errors,
    )


def _first_row(record: Record, first: int, days: float) -> int:
    """The first row of the estimate: at most so many days before, without a break."""
    begin = max(first - record.rows_in_days(days), record.first_unbroken_row(first - 1))
    if first - begin < _FEWEST_ROWS:
        limited = f" in days = {days:g}" if record.rows_in_days(days) < _FEWEST_ROWS else ""
        raise InputError(
            f"--from {record.stamp(first)}: there are {first - begin} rows before it without a break{limited}; a "
            f"forecast needs at least {_FEWEST_ROWS}"
        )
    return begin


def _check_readings(case: Case, begin: int, first: int) -> None:
    """Check that there are readings to estimate from."""
    count = int(np.isfinite(_measured(case, Window(begin, first - begin))).sum())
    if count < _FEWEST_ROWS:
        raise InputError(
            f"--from {case.record.stamp(first)}: there are {count} readings of sensors and plates in the "
            f"{first - begin} rows before it; a forecast needs at least {_FEWEST_ROWS}"
        )


def _measured(case: Case, window: Window) -> np.ndarray:
    """The readings of sensors and plates, NaN where there is none."""
    plates = [case.record.regressors[f"flux_{face}"] for face in fluxes_of(case)]
    return np.column_stack([case.record.sensors, *plates])[window.as_slice]


def _after(states: FilterModel, filtered: Filtered) -> tuple[np.ndarray, np.ndarray]:
    """Mean and variance of the readings after the filtered rows, less the fit's prediction."""
    rows = len(filtered.mean)
    outputs = np.asarray(states.model.outputs_at_rows(len(states.readings)))[rows:]
    after = forecast_states(states.model, filtered.mean[-1], filtered.root[-1], len(outputs))
    mean = np.einsum("tos,ts->to", outputs, np.asarray(after.mean))
    roots = np.einsum("tos,tsr->tor", outputs, np.asarray(after.root))
    return mean, np.sum(roots**2, axis=2) + np.asarray(states.model.output_std) ** 2


def _averaged(each: list[tuple[float, np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Mean and variance of a mixture, from the probability, mean and variance of each part.

    The total variance is the mean of the variances plus the variance of the means.
    """
    shares, means, variances = (np.array(part) for part in zip(*each, strict=True))
    mean = np.tensordot(shares, means, axes=1)
    return mean, np.tensordot(shares, variances + (means - mean) ** 2, axes=1)


def step_errors(
    each: list[tuple[float, FilterModel, Filtered]], step: float, horizons: tuple[float, ...] = HORIZONS
) -> tuple[StepErrors, ...]:
    """How well the filtered readings are predicted some hours ahead, from the readings up to then.

    The parameters, the size of the noise and the probable disturbances are those of the fit of all these rows; what the
    filter says of them at a row rests on the readings up to that row.

    Args:
        each: the probability of a disturbance, its model for the filter, and the states of the rows with readings.
        step: from row to row, s.
        horizons: h.
    """
    _, states, first = each[0]
    rows, results = len(first.mean), []
    readings, present = states.readings[:rows], states.present[:rows]
    begin = rows // 5  # before, the filter knows little of the parameters
    for hours in horizons:
        ahead = round(hours * 3600.0 / step)
        if ahead < 1 or begin + ahead >= rows:
            continue
        at = np.arange(begin, rows - ahead)
        mean, variance = _averaged([(share, *_ahead(model, of_model, at, ahead)) for share, model, of_model in each])
        residual = readings[at + ahead] - mean
        mask, inside = present[at + ahead], np.abs(residual) <= NORMAL_95 * np.sqrt(variance)
        with np.errstate(invalid="ignore"):
            counts = mask.sum(axis=0)
            rms = np.sqrt(np.sum(residual**2 * mask, axis=0) / counts)
            share = (inside & mask).sum(axis=0) / counts
        results.append(StepErrors(hours, tuple(rms.tolist()), tuple(share.tolist()), int(mask.sum())))
    return tuple(results)


def _ahead(states: FilterModel, filtered: Filtered, at: np.ndarray, ahead: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean and variance of the readings some rows after each row, given the readings up to it."""
    transition, G = np.asarray(states.model.transition), np.asarray(states.model.noise_root)
    power, added = np.eye(len(transition)), np.zeros_like(transition)
    for _ in range(ahead):
        added = transition @ added @ transition.T + G @ G.T
        power = transition @ power
    H = np.asarray(states.model.outputs_at_rows(len(states.readings)))[at + ahead]
    through = H @ power
    mean = np.einsum("tos,ts->to", through, np.asarray(filtered.mean)[at])
    roots = np.einsum("tos,tsr->tor", through, np.asarray(filtered.root)[at])
    variance = np.sum(roots**2, axis=2) + np.einsum("tos,sr,tor->to", H, added, H)
    return mean, variance + np.asarray(states.model.output_std) ** 2
