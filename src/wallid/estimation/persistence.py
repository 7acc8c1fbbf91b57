"""Persistence: faces that go on as on the day before, and the error that this would have had on earlier days.

From the last row n that was logged, with N rows a day, the faces go on as

    f(n + j) = f(n + j - k N) + f(n) - f(n - N),      k = ceil(j / N)

Its error is that which the same rule has from each earlier row on, through the wall.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import scipy
from jaxtyping import Float

from .._internal.errors import InputError
from ..case.case_definition import Case
from ..records.uniform_record import Record

_FEWEST_DAYS = 3  # before the last row: a day to go on from, and a day of rows from which a day ahead is known
_STARTS = 24  # of earlier persistent courses, in each day


def with_persistent_faces(case: Case, first: int, rows: int, faces: str) -> tuple[Case, int]:
    """The case with faces for all rows of a forecast, and the number of them whose faces are the record's own.

    Args:
        first, rows: of the forecast.
        faces: "record" or "persistence".

    Raises:
        InputError: faces are to go on, and there are less than three days before without a break.
    """
    record = case.record
    known = 0 if faces == "persistence" else max(0, min(rows, record.rows - first))
    if known == rows:
        return case, rows
    day, last = record.rows_in_days(1.0), first + known - 1
    if last - record.first_unbroken_row(last) < _FEWEST_DAYS * day:
        raise InputError(
            f"the faces after {record.stamp(last)} are taken from the day before, with the error that this had on "
            f"earlier days; the record has less than {_FEWEST_DAYS} days before it without a break"
        )
    total = max(record.rows, first + rows)
    more = total - record.rows

    def longer(values: np.ndarray, missing: float = np.nan) -> np.ndarray:
        return np.concatenate([values, np.full((more, *values.shape[1:]), missing)])

    both = longer(np.asarray(record.faces, float))
    moved = both[last] - both[last - day]
    for row in range(last + 1, first + rows):
        both[row] = both[row - day * math.ceil((row - last) / day)] + moved
    fill = None if record.fill_std is None else longer(np.asarray(record.fill_std), 0.0)
    if fill is not None:
        fill[last + 1 : first + rows] = 0.0  # the error of persistence is another
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


def error_of_persistence(
    record: Record, response: Float[np.ndarray, "face row output"], first: int, rows: int, known: int
) -> Float[np.ndarray, "time output"]:
    """Root mean square of the readings' responses to the errors that persistence had on earlier days.

    Ahead of where earlier rows show it, the error of a random walk is taken: it grows with the root of the time.

    Args:
        record: the faces.
        response: of the readings at the rows to 1 K more at one row of one face.
        first, rows: of the forecast.
        known: rows of it whose faces were logged.
    """
    day, last, length = record.rows_in_days(1.0), first + known - 1, rows - known
    faces = np.asarray(record.faces)[record.first_unbroken_row(last) : last + 1]
    total, count = np.zeros((length, response.shape[2])), np.zeros(length)
    for start in range(day, len(faces) - 1, max(1, day // _STARTS)):
        course = _errors_from(faces, start, day)[:length]
        effect = sum(
            scipy.signal.fftconvolve(course[:, side, None], response[side, : len(course)], axes=0)[: len(course)]
            for side in (0, 1)
        )
        total[: len(course)] += np.asarray(effect) ** 2
        count[: len(course)] += 1
    seen = min(length, max(1, len(faces) - 2 * day))  # from as many rows as a day has
    rms = np.sqrt(total[:seen] / count[:seen, None])
    ahead = np.arange(seen + 1, length + 1)
    rms = np.concatenate([rms, rms[-1] * np.sqrt(ahead / seen)[:, None]])
    return np.concatenate([np.zeros((known, rms.shape[1])), rms])


def _errors_from(faces: Float[np.ndarray, "time face"], start: int, day: int) -> Float[np.ndarray, "later face"]:
    """What the faces did after a row minus what persistence says from there on."""
    ahead = np.arange(1, len(faces) - start)
    before = start + ahead - day * np.ceil(ahead / day).astype(int)
    return faces[start + ahead] - faces[before] - (faces[start] - faces[start - day])
