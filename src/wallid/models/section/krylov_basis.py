"""A basis of few columns for a section's states: compressed solutions of the Laplace transform.

V spans, at several shifts s and several values of the materials (rational Krylov snapshots),

    (s E - K)^-1 B,      (s E - K)^-1 C',      s (s E - K)^-1 E P

compressed by their singular values in the norm of the heat content. Faces vary less the faster they do, so a snapshot
of the inputs counts in proportion to the period, below a day. The error of an output is a product of two: of what the
inputs reach, and of what the outputs see. So with the outputs' snapshots a small basis serves; without outputs it
serves all points of the section. A shift of 0 gives the static part. A temperature that is the same everywhere lies in
V, so constant inputs give exactly that temperature.

Source: U. Baur, C. Beattie, P. Benner, S. Gugercin, SIAM J. Sci. Comput. 33 (2011), 2489 (parametric projection);
A. C. Antoulas, Approximation of Large-Scale Dynamical Systems (2005), 11.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy

from ..._internal.progress import Progress
from .affine_model import AffineModel, Factorised

DAY = 2.0 * np.pi / 86400.0
"""Frequency below which all inputs count alike, 1/s."""
_PROFILE_WEIGHT = 0.03  # of the initial profiles: they decay, the inputs go on
_NEGLIGIBLE = 1e-11  # of the largest singular value

Values = tuple[np.ndarray, np.ndarray]
"""Conductivity and heat capacity of the materials, W/m/K and J/m3/K."""


def snapshots(model: AffineModel, values: Sequence[Values], shifts: Sequence[float], report: Progress) -> np.ndarray:
    """Solutions of the Laplace transform at all shifts and values, weighted, `(state, snapshot)`.

    Args:
        model: full-order; without outputs there are no snapshots of them.
        values: of the materials.
        shifts: s, 1/s, without 0.
        report: called as `progress(text, share)`.
    """
    of_inputs, of_outputs, of_profile = [], [], []
    C = model.C.T.toarray()
    for number, (conductivity, heat_capacity) in enumerate(values):
        report(f"reduce: snapshots, values {number + 1} of {len(values)}", number / len(values))
        E, K, B = model.at(conductivity, heat_capacity)
        for shift in (0.0, *shifts):
            solver = Factorised(shift * E - K)
            of_inputs.append(solver.solve(B) / (1.0 + shift / DAY))
            if C.shape[1]:
                of_outputs.append(solver.solve(C))
            if shift > 0.0:
                of_profile.append(_PROFILE_WEIGHT * shift * solver.solve(E @ model.P[:, 1:]))
    columns = [np.concatenate(part, axis=1) for part in (of_inputs, of_profile)]
    if of_outputs:
        outputs = np.concatenate(of_outputs, axis=1)
        root = heat_content(model)[:, None] ** 0.5
        size = np.linalg.norm(root * columns[0], axis=0).max() / np.linalg.norm(root * outputs, axis=0).max()
        columns.append(size * outputs)
    return np.concatenate(columns, axis=1)


def heat_content(model: AffineModel) -> np.ndarray:
    """The weight of each state in the heat content at equal capacities, m2."""
    return np.sum([part.diagonal() for part in model.capacity], axis=0)


def orthonormal_basis(model: AffineModel, columns: np.ndarray, order: int | None = None) -> np.ndarray:
    """The constant, then the first singular vectors of some columns, orthonormal in the norm of the heat content.

    Args:
        model: full-order.
        columns: snapshots, `(state, snapshot)`.
        order: number of vectors; None for all that are not negligible.
    """
    root = np.sqrt(heat_content(model))
    constant = root / np.linalg.norm(root)
    scaled = root[:, None] * columns
    scaled -= constant[:, None] * (constant @ scaled)
    vectors, sizes, _ = scipy.linalg.svd(scaled, full_matrices=False, overwrite_a=True)
    kept = int(np.count_nonzero(sizes > _NEGLIGIBLE * sizes[0]))
    kept = kept if order is None else min(kept, order - 1)
    return np.column_stack([constant, vectors[:, :kept]]) / root[:, None]


def log_frequencies(shortest: float, longest: float, count: int) -> list[float]:
    """Frequencies between those of two periods, even in the logarithm, 1/s."""
    return (2.0 * np.pi / np.geomspace(longest, shortest, count)).tolist()


def generalised_modes(E: Any, K: Any) -> tuple[np.ndarray, np.ndarray]:
    """Rates f < 0 and modes Q of a dense `E x' = K x`: `Q' E Q = 1`, `Q' K Q = diag(f)`."""
    return scipy.linalg.eigh(K, E)
