"""The response of a section's full-order model to faces that are straight lines between rows.

Over a row of length h the Laplace transform of the state is a sum of three terms, and its inverse an integral over a
contour about the negative real axis:

    x(h) = 1/(2 pi i) int exp(z) (z E - h K)^-1 (E x(0) + h B q_0 / z + h B (q_1 - q_0) / z^2) dz

The midpoint rule with N nodes has an error of about `3.9^-N` of the largest value, so that N follows from the
tolerance. Each node costs one sparse decomposition, and each row one solution with it. It is a reference: it serves to
test a reduced model, and no estimate steps through it.

Source: L. N. Trefethen, J. A. C. Weideman, T. Schmelzer, BIT 46 (2006), 653; J. A. C. Weideman, SIAM J. Numer. Anal. 44
(2006), 2342 (the contour).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from .affine_model import AffineModel, Factorised

_RATE = 3.89  # the error falls by this factor with each node
_SAFETY = 4  # nodes more than the tolerance needs
_CHECK = 6  # nodes more in the check of a row
_CHECKED = 24  # rows between two checks


def section_response(
    model: AffineModel,
    conductivity: np.ndarray,
    heat_capacity: np.ndarray,
    inputs: np.ndarray,
    step: float,
    *,
    profile: Sequence[float] | None = None,
    tolerance: float = 1e-9,
) -> np.ndarray:
    """The outputs of a model row by row.

    Args:
        model: full-order or projected.
        conductivity, heat_capacity: of the materials, W/m/K and J/m3/K.
        inputs: temperatures given at the faces, degC, `(time, 2)`; straight lines between rows.
        step: from row to row, s.
        profile: coefficients of the initial profile, degC; None for the steady state with the first row's inputs.
        tolerance: of each row, over the range of the inputs.

    Returns:
        `(time, output)`, degC.

    Raises:
        RuntimeError: a row that misses the tolerance.
    """
    E, K, B = model.at(conductivity, heat_capacity)
    inputs = np.asarray(inputs, float)
    shift = float(inputs.mean())  # a temperature that is the same everywhere stays: the range is what counts
    inputs = inputs - shift
    if profile is None:
        state = Factorised(-K).solve(B @ inputs[0])
    else:
        state = model.P @ (np.asarray(profile, float) - shift * (np.arange(len(profile)) == 0))
    nodes = math.ceil(math.log(1.0 / tolerance) / math.log(_RATE)) + _SAFETY
    stepper, finer = (_Contour(E, K, B, step, count) for count in (nodes, nodes + _CHECK))
    size = max(float(np.ptp(inputs)), float(np.abs(state).max()), 1e-300)
    outputs = [model.C @ state + model.D @ inputs[0]]
    for row, (before, after) in enumerate(pairwise(inputs)):
        following = stepper(state, before, after)
        if row % _CHECKED == 0:
            error = float(np.abs(following - finer(state, before, after)).max()) / size
            if error > tolerance:
                raise RuntimeError(f"section_response: row {row} has an error of {error:.1e}, above {tolerance:.1e}")
        state = following
        outputs.append(model.C @ state + model.D @ after)
    return np.array(outputs) + shift


class _Contour:
    """One row's step by the midpoint rule on a contour, as a function of the state and of the inputs at its ends."""

    def __init__(self, E, K, B, step: float, nodes: int):
        theta = np.pi * (np.arange(1, nodes, 2)) / nodes  # the upper half; the lower one is its conjugate
        z = nodes * (0.5017 * theta / np.tan(0.6407 * theta) - 0.6122 + 0.2645j * theta)
        slope = nodes * (
            0.5017 / np.tan(0.6407 * theta) - 0.5017 * 0.6407 * theta / np.sin(0.6407 * theta) ** 2 + 0.2645j
        )
        # 1/(2 pi i) times the distance 2 pi / nodes of the midpoints, and the real part of both halves
        self.weights = 2.0 * np.exp(z) * slope / (1j * nodes)
        self.z, self.E, self.drive = z, E, step * B
        self.solvers = [Factorised(one * E - step * K) for one in z]

    def __call__(self, state: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        first, heat, change = self.E @ state, self.drive @ before, self.drive @ (after - before)
        result = np.zeros(len(state))
        for z, weight, solver in zip(self.z, self.weights, self.solvers, strict=True):
            result += (weight * solver.solve(first + heat / z + change / z**2)).real
        return result
