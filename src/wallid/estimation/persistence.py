"""Persistence: faces that go on as on the day before, and the error that this would have had on earlier days."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from .._internal.errors import InputError
from ..case.case_definition import Case
from ..inference.gls_fit import GLSFit


def with_persistent_faces(case: Case, begin: int, first: int, rows: int, faces: str) -> tuple[Case, int]:
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


def error_of_persistence(
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
