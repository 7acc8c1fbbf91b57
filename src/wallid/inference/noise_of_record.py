"""The structure of the noise covariance of a record's readings: sensors, faces, and the faces' interpolation.

Each gap is one fully correlated error:

    E_g = sum_{rows i in g} e_i G_f(i),      e_i^2 = fill_std_i^2 - s_f^2

`fill_std` is the standard error of the interpolated face in row i, `G_f(i)` the readings' response to 1 K more there,
and `s_f` the noise of a face's reading, which the noise covariance contains in every row already.

Other errors of a face have one share in all rows. Two are how its slow and its fast part bend between the rows: the
readings do not show whether the face is smooth or rough, or whether the logger stores means. Beside flux plates it is
what is uncertain in the filter of the face:

    E_f = sum_i c_i G_f(i),      c = `FaceErrors.shared_errors`
"""

from __future__ import annotations

import numpy as np
import scipy
from jaxtyping import Array, Float

from .._internal.arrays import on_device
from ..case.case_definition import Case
from ..case.initial_profile import scales
from ..models.flux_plates import full_order_model_with_plates
from ..models.state_space import StateSpace
from ..records.face_filter import FaceNoise
from ..records.face_variation import FaceErrors
from ..records.uniform_record import Record
from .likelihood import face_response
from .noise_covariance import BinnedReadings, NoiseShape, restricted_to_reading_rows

_MAX_GAPS = 300  # each is a term of a dense covariance
_MAX_COURSES = 20  # gaps in a Kalman filter, in which each is a state


def noise_shape_of_record(
    record: Record,
    response: np.ndarray,
    bins: BinnedReadings,
    spacing: int,
    sensor_std: np.ndarray,
    face_noise: FaceNoise,
    face_errors: FaceErrors,
    shared: Float[np.ndarray, "error reading"] | None = None,
) -> NoiseShape:
    """The structure of the noise covariance of the binned readings.

    Args:
        record: the rows used.
        response: response of the readings at the rows to 1 K more at one row of one face, `(face, row, sensor)`.
        bins, spacing: as from `bin_readings`; of the first rows of the record, or all.
        sensor_std: standard deviation of each sensor's readings, K.
        face_noise: of the temperatures that drive the model.
        face_errors: what the faces do between rows; `FaceErrors.none()` where it is part of a noise that is estimated
            from the residual.
        shared: effect on the binned readings of one standard deviation of each error with one share in all rows; None
            where it follows from the response, as that of temperatures does.
    """
    response = response[:, : len(bins.present)]
    gaps = gap_errors(record.fill_std, record.boundary_noise_std, response, bins)
    if shared is None:
        shared = effects_of_shared_errors(face_errors.shared_errors(record.faces, record.step), response, bins)
    errors = face_errors.autocovariance
    response, bins, errors = restricted_to_reading_rows(response, bins, spacing, errors)
    return NoiseShape(response, bins, sensor_std, face_noise, errors, np.concatenate([gaps, shared]))


def response_to_faces(
    case: Case,
    system: StateSpace,
    diffusivity: float,
    step: Float[Array, ""],
    rows: int,
    *,
    conductance: float,
    contacts: tuple[float, float],
    wall: Float[np.ndarray, " param"],
) -> Float[np.ndarray, "face row output"]:
    """The readings' response to 1 K more at one row of one face, K, and W/m2 of plates.

    Args:
        system: the model; with contact resistances it is built anew.
        diffusivity: m2/s.
        step: between rows, relative to the reference time.
        rows: of the response.
        conductance: k/L, W/m2/K, by which a face enters the fluxes.
        contacts: length of wall with the resistance between each face and its sensor, m.
        wall: the wall's own parameters, in prior standard deviations.
    """
    if any(contacts):
        system = full_order_model_with_plates(case, wall, contacts=contacts)
    response = np.array(face_response(system, on_device(scales(case).fourier_number(diffusivity)), step, rows))
    response[:, :, len(case.sensors) :] *= conductance
    return response


def courses_of_face_errors(
    record: Record,
    response: np.ndarray,
    face_errors: FaceErrors,
    shared: Float[np.ndarray, "error time instrument"] | None = None,
) -> Float[np.ndarray, "time instrument error"]:
    """The effect at the rows of one standard deviation of each gap, and of each error with one share in all rows.

    Of many gaps only the largest are used.

    Args:
        record, response, face_errors: as for `noise_shape_of_record`.
        shared: effect at the rows of one standard deviation of each error with one share in all rows; None where it
            follows from the response.
    """
    everywhere = np.ones(response.shape[1:])
    rows = BinnedReadings(on_device(0.0 * everywhere), on_device(everywhere), 1)
    gaps = gap_errors(record.fill_std, record.boundary_noise_std, response, rows, _MAX_COURSES)
    if shared is None:
        of_shared = effects_of_shared_errors(face_errors.shared_errors(record.faces, record.step), response, rows)
    else:
        of_shared = shared.transpose(0, 2, 1).reshape(len(shared), -1)
    errors = np.concatenate([gaps, of_shared])
    return errors.reshape(len(errors), *everywhere.shape[::-1]).transpose(2, 1, 0)


def gap_errors(
    fill_std: np.ndarray | None,
    face_std: float,
    response: np.ndarray,
    bins: BinnedReadings,
    most: int = _MAX_GAPS,
) -> Float[np.ndarray, "gap reading"]:
    """The effect of one standard deviation of each gap's interpolation on the binned readings, K.

    Of more gaps than `most` only the largest are used.

    Args:
        fill_std: standard error of the interpolated faces in each row, K, 0 where a face was read; None for no gap.
        face_std: of a face reading, K, which the covariance contains in every row already.
        response: response of the readings at the rows to 1 K more at one row of one face, `(face, row, sensor)`.
        bins: the readings and their bins.
    """
    rows, sensors = bins.observed.shape
    fill_std = np.zeros((rows, 2)) if fill_std is None else fill_std[:rows]
    excess = np.sqrt(np.maximum(fill_std**2 - face_std**2, 0.0))
    excess[~np.isfinite(excess)] = 0.0
    errors = [np.zeros((0, bins.readings))]
    gaps = [(side, first, end) for side in (0, 1) for first, end in _true_runs(excess[:, side] > 0)]
    gaps.sort(key=lambda gap: -float(excess[gap[1] : gap[2], gap[0]].sum()))
    for side, first, end in sorted(gaps[:most]):
        effect = np.zeros((rows, sensors))
        for row in range(first, end):
            effect[row:] += excess[row, side] * response[side, : rows - row]
        errors.append(np.asarray(bins.mean(on_device(effect)))[None])
    return np.concatenate(errors)


def effects_of_shared_errors(
    changes: Float[np.ndarray, "change face time"], response: np.ndarray, bins: BinnedReadings
) -> Float[np.ndarray, "error reading"]:
    """The effect on the binned readings of errors of the faces with one share in all rows, K; none where zero.

    Args:
        changes: one standard deviation of each, as a change of each face's mean over a row, K.
        response: of the readings at the rows to 1 K more at one row of one face, `(face, row, sensor)`.
        bins: the readings and their bins.
    """
    errors = [np.zeros((0, bins.readings))]
    for part in changes:
        for change, own in zip(part, response, strict=True):
            if change.any():
                effect = scipy.signal.fftconvolve(change[:, None], own, axes=0)[: len(change)]
                errors.append(np.asarray(bins.mean(on_device(effect)))[None])
    return np.concatenate(errors)


def _true_runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """First row, and the row after the last, of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
