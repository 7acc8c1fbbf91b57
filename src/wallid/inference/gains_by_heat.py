"""What heat that the model does not know tells about the calibrations of two plates: both answer to the same heat.

A plate with the calibration error g reads `(1 + g) (q + h)` and noise, with `q` the flux that the model predicts and
`h` the flux by a disturbance. So the disturbance's part S of the readings' covariance R depends on g too:

    d ln L / d g_i = (J_i + H_i)' R^-1 r - tr(E_i S R^-1) / (1 + g_i),      H_i = E_i S R^-1 r / (1 + g_i)

`r` is the residual, `J_i` the change of the prediction by `g_i`, and `E_i` keeps the readings of plate i. `S R^-1 r` is
the disturbance's flux given all readings: `J_i + H_i` is the change of all that the plate reads. The trace is the
expectation of `H_i' R^-1 r`. It enters as a mean of the prior of `g_i`, which has the same derivative: minus the trace
times the prior's variance.

What both gains have in common cannot be told from the size of the disturbance, which is estimated. The heat tells their
difference alone: the effect of one is `(H_left - H_right) / 2`, that of the other its negative.

Source: D. A. Harville, J. Am. Stat. Assoc. 72 (1977), 320.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Float

from .noise_covariance import NoiseCovariance, NoiseShape


class GainsByHeat(NamedTuple):
    """The effect of two plates' gains by the disturbance.

    Args:
        columns: change of the plates' readings for a gain of 1 of each, W/m2, `(gain, time, plate)`.
        prior_mean: of each gain, in prior standard deviations; it stands for the trace.
    """

    columns: Float[np.ndarray, "gain time plate"]
    prior_mean: Float[np.ndarray, " gain"]


def gains_by_heat(
    noise: NoiseCovariance,
    shape: NoiseShape,
    residual: Float[np.ndarray, " reading"],
    gains: Float[np.ndarray, " gain"],
    gain_std: Float[np.ndarray, " gain"],
    rows: int,
) -> GainsByHeat:
    """The effect of two plates' gains by the disturbance, at given gains.

    Args:
        noise: with a disturbance, at these gains.
        shape: of the noise; the readings of the two plates are its last.
        residual: measured minus predicted, of the binned readings, W/m2 of plates.
        gains: calibration errors of the left and the right plate. gain_std: of their priors.
        rows: of the window. A mean over a bin stands for all rows of the bin; after the bins there is no known heat.
    """
    assert noise.disturbance is not None
    assert len(gains) == 2
    present = shape.has_reading
    S, W = noise.disturbance * np.outer(present, present), noise.whitening
    lower, _ = scipy.linalg.lapack.dlauum(W, lower=1)  # the lower triangle of R^-1 = W' W
    inverse = np.tril(lower) + np.tril(lower, -1).T
    flux, trace_of_readings = S @ (inverse @ (residual * present)), np.sum(S * inverse, axis=1)
    of_plates = (shape.sensor_count, shape.bin_count)
    course = flux.reshape(of_plates)[-2:] / (1.0 + gains)[:, None]
    trace = trace_of_readings.reshape(of_plates)[-2:].sum(axis=1) / (1.0 + gains)
    by_row = np.repeat(course, shape.rows_per_bin, axis=1)[:, :rows]
    left, right = np.pad(by_row, ((0, 0), (0, rows - by_row.shape[1])))
    one = 0.5 * np.stack([left, -right], axis=1)
    half = 0.5 * (trace[0] - trace[1])
    return GainsByHeat(np.stack([one, -one]), np.array([-half, half]) * gain_std)
