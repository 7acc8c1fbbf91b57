"""What the faces' filled gaps make of the readings: one error for each gap, which goes along the whole of it.

    E_g = sum_{rows i in g} e_i G_f(i),      e_i^2 = fill_std_i^2 - s_f^2

`fill_std` is the standard error of the interpolated face in row i, `G_f(i)` the readings' response to 1 K more there,
and `s_f` the noise of a face's reading, which the covariance (`noise`) holds in every row already.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from .noise_covariance import Bins

_MOST_GAPS = 300  # each is a direction in a dense covariance


def gap_errors(
    fill_std: np.ndarray | None, face_std: float, response: np.ndarray, bins: Bins
) -> Float[np.ndarray, "gap reading"]:
    """What each gap's interpolation makes of the binned readings, one standard deviation of it, K.

    Of very many gaps only the largest.

    Args:
        fill_std: of the interpolated faces in each row, K, 0 where a face was read; None for none.
        face_std: of a face reading, K, which the covariance holds in every row already.
        response: of the readings at the rows to 1 K more at one row of one face, `(face, row, sensor)`.
    """
    present = np.asarray(bins.present)
    rows, sensors = present.shape
    found = []
    excess = np.zeros((rows, 2)) if fill_std is None else np.sqrt(np.maximum(fill_std**2 - face_std**2, 0.0))
    excess[~np.isfinite(excess)] = 0.0
    short = ((0, -rows % bins.rows), (0, 0))

    def total(values: np.ndarray) -> np.ndarray:
        return np.pad(values, short).reshape(-1, bins.rows, sensors).sum(axis=1)

    count = np.maximum(total(present), 1.0)
    gaps = [(side, first, end) for side in (0, 1) for first, end in _runs(excess[:, side] > 0)]
    gaps.sort(key=lambda gap: -float(excess[gap[1] : gap[2], gap[0]].sum()))
    for side, first, end in sorted(gaps[:_MOST_GAPS]):
        answer = np.zeros((rows, sensors))
        for row in range(first, end):
            answer[row:] += excess[row, side] * response[side, : rows - row]
        found.append((total(answer * present) / count).T.reshape(-1))
    return np.stack(found) if found else np.zeros((0, count.size))


def _runs(there: np.ndarray) -> list[tuple[int, int]]:
    """First row and the row after the last of each run."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], there.astype(int), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
