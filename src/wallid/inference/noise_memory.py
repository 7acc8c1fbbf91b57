"""The memory of the noise beside flux plates, by which the faces are filtered.

A plate shows the fast part of its face as a large flux, and the face's readings alone do not tell how much of that part
is noise. The sensors inside the wall do: fast changes of the faces hardly reach them, so their fast residual is noise.
The noise of the faces is taken to have the same shape. It is sought by the Whittle likelihood at periods of two hours
and less, where neither a parameter nor heat that the model does not know changes a temperature inside much: heat with a
memory of some hours has a power there that falls with the fourth power of the frequency.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from .._internal.arrays import on_device
from ..records.face_spectrum import WHITE, NoiseMemory
from .noise_covariance import BinnedReadings, NoiseShape
from .whittle_likelihood import MIN_READINGS, shape_of_fast_noise

_LONGEST_PERIOD = 7200.0  # s
_HIGHEST = 0.8  # of the highest frequency: a band that begins above it is too narrow to show a shape
_FEWEST_READINGS = 0.5  # of the rows of a sensor: fewer do not show fast noise


def memory_of_noise(
    shape: NoiseShape, residual: Float[np.ndarray, "time output"], sensors: int, step: float
) -> NoiseMemory:
    """The share of the noise that is autocorrelated, and its correlation from row to row.

    Args:
        shape: of the noise covariance of the binned readings, of sensors and plates.
        residual: of the readings at the rows, K; any value where one is missing.
        sensors: number of the first outputs that are sensors inside the wall.
        step: from row to row, s.

    Returns:
        white noise where no memory is significant, where no sensor has readings in half of the rows, and where the rows
        are too far apart to show a period of two hours.
    """
    slowest = 2.0 * np.pi * step / _LONGEST_PERIOD
    with_flux = np.flatnonzero(shape.present[:, sensors:].any(axis=1))
    if not len(with_flux) or slowest > _HIGHEST * np.pi:
        return WHITE
    rows = slice(with_flux[0], with_flux[-1] + 1)  # not the first ones, which the initial profile may fit at will
    used = np.flatnonzero(shape.present[rows, :sensors].mean(axis=0) >= _FEWEST_READINGS)
    present = shape.present[rows, used]
    if present.sum() < 2 * MIN_READINGS:
        return WHITE
    values = np.where(present > 0, residual[rows, used], 0.0)
    bins = BinnedReadings(on_device(values), on_device(present), 1)
    response = shape.response[:, : len(values), used]
    of_sensors = NoiseShape(response, bins, shape.sensor_std[used], shape.face_noise, np.zeros((2, 1)))
    return shape_of_fast_noise(of_sensors, values.T.reshape(-1), slowest)
