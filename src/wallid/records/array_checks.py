"""Checks of a record's arrays: shapes, finite numbers, and times that increase at a uniform step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .._internal.arrays import is_traced
from .._internal.errors import InputError
from .._internal.validation import format_value, spelling_hint, text
from .row_times import STEP_TOLERANCE

_MIN_ROWS = 2
# a reader accepts steps within STEP_TOLERANCE of the file's typical step, from which any two then differ by twice that
_UNEVEN = 2.0 * STEP_TOLERANCE / (1.0 - STEP_TOLERANCE)
_RESAMPLE = "resample it, or give the readings as a DataFrame to wallid.Case.from_dataframe, which does that"


def checked_times(time: object) -> np.ndarray:
    """The times of a record, s since the first row, as an array of floats.

    Raises:
        InputError: not one finite number for each row, fewer than two rows, a first time that is not 0, times that do
            not increase, or steps that differ.
    """
    values = _numbers("time", time)
    if values.ndim != 1 or len(values) < _MIN_ROWS:
        raise InputError(f"time has shape {values.shape}; it must be (time,) with at least {_MIN_ROWS} rows")
    _check_finite("time", values)
    steps = np.diff(values)
    if not np.all(steps > 0.0):
        row = int(np.argmax(steps <= 0.0)) + 1
        raise InputError(
            f"time[{row}] = {values[row]:.12g} s follows {values[row - 1]:.12g} s; the times must increase from row to "
            "row: sort the rows, and remove repeated ones"
        )
    typical = float(np.median(steps))
    uneven = np.abs(steps - typical) > _UNEVEN * typical
    if uneven.any():
        row = int(np.argmax(uneven)) + 1
        raise InputError(
            f"time[{row}] is {steps[row - 1]:.6g} s after the row before it, and the typical step is {typical:.6g} s; "
            f"a record needs a uniform step: {_RESAMPLE}"
        )
    if abs(values[0]) > _UNEVEN * typical:
        raise InputError(
            f"time[0] = {values[0]:.12g} s; the times must be counted from the first row: give `time - time[0]`, and "
            "the times themselves as `stamps`"
        )
    return values


def checked_stamps(stamps: object, rows: int) -> np.ndarray:
    """The rows' times as in the file, as datetime64[ns] or numbers of s.

    Raises:
        InputError: another shape, values of another kind, or times that do not increase.
    """
    values = np.asarray(stamps)
    if np.issubdtype(values.dtype, np.datetime64):
        values = values.astype("datetime64[ns]", copy=False)
    elif not np.issubdtype(values.dtype, np.number):
        raise InputError(
            f"stamps has values of type {values.dtype}; it must be datetime64 or s: use `pandas.to_datetime(...)"
            ".to_numpy()`, without a time zone"
        )
    _check_shape("stamps", values, (rows,), "(time,)")
    if not np.all(values[1:] > values[:-1]):  # False also for NaN and NaT
        row = int(np.argmin(values[1:] > values[:-1])) + 1
        raise InputError(
            f"stamps[{row}] = {values[row]} follows {values[row - 1]}; the times must increase from row to row"
        )
    return values


def checked_columns(name: str, given: object, rows: int, columns: int, meaning: str, *, finite: bool) -> np.ndarray:
    """An array of floats with one row for each time.

    Args:
        name: of the argument.
        given: its value.
        rows, columns: the shape that it must have.
        meaning: of the columns, for messages, such as "left and right face".
        finite: whether all values must be finite.

    Raises:
        InputError: another shape, or values that are not numbers or, with `finite`, not finite.
    """
    values = _numbers(name, given)
    _check_shape(name, values, (rows, columns), f"(time, {columns}), one column for each {meaning}")
    if finite:
        _check_finite(name, values)
    return values


def checked_names(names: Sequence[str]) -> tuple[str, ...]:
    """The names of the inner sensors.

    Raises:
        InputError: a text instead of a sequence of texts, a blank name, or a name that occurs twice.
    """
    if isinstance(names, str):
        raise InputError(f"names = {format_value(names)}; it must be a sequence of texts, such as ({names!r},)")
    checked = tuple(text(f"names[{k}]", name) for k, name in enumerate(names))
    for k, name in enumerate(checked):
        if name in checked[:k]:
            raise InputError(f"names: {format_value(name)} occurs twice; names must differ")
    return checked


def checked_regressors(given: Mapping[str, Any], rows: int, known: Sequence[str]) -> dict[str, np.ndarray]:
    """The regressors by key, one value for each time.

    Raises:
        InputError: an unknown key, or values of another shape.
    """
    regressors = {}
    for key, column in given.items():
        if key not in known:
            hint = spelling_hint(key, known) or f"; known are {', '.join(known)}"
            raise InputError(f"regressors: unknown key {format_value(key)}{hint}")
        values = _numbers(f'regressors["{key}"]', column)
        _check_shape(f'regressors["{key}"]', values, (rows,), "(time,)")
        regressors[key] = values
    return regressors


def _numbers(name: str, given: object) -> np.ndarray:
    """An array of floats."""
    if is_traced(given):
        raise InputError(
            f"{name} is traced by JAX, and a record holds measured numbers; to differentiate by temperatures, put them "
            "in the `inputs` of `wallid.models.window_data(case)`"
        )
    try:
        return np.asarray(given, float)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} = {format_value(given)}; it must be an array of numbers") from error


def _check_shape(name: str, values: np.ndarray, shape: tuple[int, ...], meaning: str) -> None:
    if values.shape == shape:
        return
    transposed = len(shape) == 2 and values.shape == shape[::-1]
    hint = f"; give `{name}.T`" if transposed else ""
    raise InputError(f"{name} has shape {values.shape}; with {shape[0]} times it must be {shape}: {meaning}{hint}")


def _check_finite(name: str, values: np.ndarray) -> None:
    finite = np.isfinite(values)
    if not finite.all():
        index = tuple(int(i) for i in np.argwhere(~finite)[0])
        place = ", ".join(map(str, index))
        raise InputError(
            f"{name}[{place}] = {values[index]}; all its {values.size} values must be finite, and "
            f"{int((~finite).sum())} are not: interpolate them, or give the readings to wallid.Case.from_dataframe, "
            "which does that and counts their error"
        )
