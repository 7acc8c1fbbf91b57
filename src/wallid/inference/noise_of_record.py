"""The structure of the noise covariance of a record's readings: sensors, faces, and the faces' interpolation.

Each gap is one fully correlated error:

    E_g = sum_{rows i in g} e_i G_f(i),      e_i^2 = fill_std_i^2 - s_f^2

`fill_std` is the standard error of the interpolated face in row i, `G_f(i)` the readings' response to 1 K more there,
and `s_f` the noise of a face's reading, which the noise covariance contains in every row already.

How a face bends between its rows is one more such error of each face, the same in all rows. The readings do not show
whether the face is smooth or rough, or whether the logger stores means. One standard deviation is seven tenths of
the change from cubics to straight lines:

    E_f = 0.7 sum_i c_i G_f(i),      c = `from_cubics_to_lines`
"""

from __future__ import annotations

import numpy as np
import scipy
from jaxtyping import Float

from .._internal.arrays import on_device
from ..records.face_variation import BENDING_STD, from_cubics_to_lines
from ..records.uniform_record import Record
from .noise_covariance import BinnedReadings, NoiseShape, restricted_to_reading_rows

_MAX_GAPS = 300  # each is a term of a dense covariance


def noise_shape_of_record(
    record: Record,
    response: np.ndarray,
    bins: BinnedReadings,
    spacing: int,
    sensor_std: np.ndarray,
    face_errors: np.ndarray | None,
) -> NoiseShape:
    """The structure of the noise covariance of the binned readings.

    Args:
        record: the rows used.
        response: response of the readings at the rows to 1 K more at one row of one face, `(face, row, sensor)`.
        bins, spacing: as from `bin_readings`.
        sensor_std: standard deviation of each sensor's readings, K.
        face_errors: autocovariance of the errors of each face's cubics, K2, `(face, lag)`; None where what the faces do
            between rows is part of a noise that is estimated from the residual.
    """
    gaps = gap_errors(record.fill_std, record.boundary_noise_std, response, bins)
    if face_errors is None:
        face_errors, interpolation = np.zeros((2, 1)), gaps
    else:
        interpolation = np.concatenate([gaps, bending_errors(record.faces, response, bins)])
    response, bins, face_errors = restricted_to_reading_rows(response, bins, spacing, face_errors)
    return NoiseShape(response, bins, sensor_std, record.boundary_noise_std, face_errors, interpolation)


def gap_errors(
    fill_std: np.ndarray | None, face_std: float, response: np.ndarray, bins: BinnedReadings
) -> Float[np.ndarray, "gap reading"]:
    """The effect of one standard deviation of each gap's interpolation on the binned readings, K.

    Of very many gaps only the largest are used.

    Args:
        fill_std: standard error of the interpolated faces in each row, K, 0 where a face was read; None for no gap.
        face_std: of a face reading, K, which the covariance contains in every row already.
        response: response of the readings at the rows to 1 K more at one row of one face, `(face, row, sensor)`.
        bins: the readings and their bins.
    """
    rows, sensors = bins.observed.shape
    excess = np.zeros((rows, 2)) if fill_std is None else np.sqrt(np.maximum(fill_std**2 - face_std**2, 0.0))
    excess[~np.isfinite(excess)] = 0.0
    errors = [np.zeros((0, bins.readings))]
    gaps = [(side, first, end) for side in (0, 1) for first, end in _true_runs(excess[:, side] > 0)]
    gaps.sort(key=lambda gap: -float(excess[gap[1] : gap[2], gap[0]].sum()))
    for side, first, end in sorted(gaps[:_MAX_GAPS]):
        effect = np.zeros((rows, sensors))
        for row in range(first, end):
            effect[row:] += excess[row, side] * response[side, : rows - row]
        errors.append(np.asarray(bins.mean(on_device(effect)))[None])
    return np.concatenate(errors)


def bending_errors(
    faces: Float[np.ndarray, "time face"], response: np.ndarray, bins: BinnedReadings
) -> Float[np.ndarray, "face reading"]:
    """The effect on the binned readings of one standard deviation of how each face bends between its rows, K.

    Args:
        faces: the faces' readings, degC.
        response: of the readings at the rows to 1 K more at one row of one face, `(face, row, sensor)`.
        bins: the readings and their bins.
    """
    errors = []
    for face, own in zip(faces.T, response, strict=True):
        change = BENDING_STD * from_cubics_to_lines(face)[:, None]
        effect = scipy.signal.fftconvolve(change, own, axes=0)[: len(face)]
        errors.append(np.asarray(bins.mean(on_device(effect))))
    return np.stack(errors)


def _true_runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """First row, and the row after the last, of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
