"""How errors of the faces' readings change those of the instruments."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .._internal.arrays import on_device
from ..inference.noise_covariance import BinnedReadings


@dataclass(frozen=True, eq=False)
class FaceErrorResponses:
    """The responses of the instruments to errors of the faces.

    Args:
        impulse: to an error of 1 K in one reading, `(face, row, instrument)`.
        bending: to one standard deviation of how the faces bend between their rows, `(error, time, instrument)`; None
            without plates.
    """

    impulse: Float[np.ndarray, "face row instrument"]
    bending: Float[np.ndarray, "error time instrument"] | None

    def binned_bending(self, bins: BinnedReadings) -> Float[np.ndarray, "error reading"] | None:
        """The means over bins of the responses to the bending; None without plates."""
        if self.bending is None:
            return None
        return np.stack([np.asarray(bins.mean(on_device(error))) for error in self.bending])

    def with_last(self, other: FaceErrorResponses, index: int) -> FaceErrorResponses:
        """The same with one instrument of others as the last."""

        def both(own: np.ndarray, others: np.ndarray) -> np.ndarray:
            return np.concatenate([own, others[..., index : index + 1]], axis=2)

        bending = None
        if self.bending is not None and other.bending is not None:
            bending = both(self.bending, other.bending)
        return FaceErrorResponses(both(self.impulse, other.impulse), bending)
