"""The noise that all sensors of one logger may share, as a face's readings show it.

Where the faces hardly vary, noise common to all channels mimics instantaneous conduction and drives alpha to infinity.
Therefore the part of a face's readings that may be noise (by a Wiener filter for the stated noise) is added to the
inner readings, with an estimated share (`nuisance_kinds.CommonNoise`).
"""

from __future__ import annotations

import numpy as np
import scipy
from jaxtyping import Float

from ..case.wall_and_sensors import SIDES
from ..records.uniform_record import Record

_SMOOTHED_FREQUENCIES = 9  # of a face's power spectrum


def common_noise_of_face(record: Record, side: str) -> Float[np.ndarray, " time"]:
    """The part of a face's readings that may be noise, K, which all sensors of one logger may have in common."""
    std = record.boundary_noise_std
    face = np.asarray(record.faces)[:, SIDES.index(side)]
    return wiener_filtered_noise(face, std) if std > 0 else np.zeros(len(face))


def wiener_filtered_noise(readings: np.ndarray, std: float) -> np.ndarray:
    """The part of a face's readings that may be white noise of this size, K: `min(1, std^2 / P)` of each frequency.

    `P` is the power spectrum of the readings, smoothed over neighbouring frequencies.

    Args:
        readings: of a face, degC, `(time,)`.
        std: standard deviation of the noise, K.
    """
    spectrum = np.asarray(scipy.fft.dct(readings - readings.mean(), type=2, norm="ortho"))
    width = min(_SMOOTHED_FREQUENCIES, len(readings))
    power = scipy.ndimage.uniform_filter1d(spectrum**2, width, mode="nearest")
    share = std**2 / np.maximum(power, std**2)
    return np.asarray(scipy.fft.idct(share * spectrum, type=2, norm="ortho"))
