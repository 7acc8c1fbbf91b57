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
        shared: to one standard deviation of each error of the faces that has one share in all rows, `(error, time,
            instrument)`; None without plates.
    """

    impulse: Float[np.ndarray, "face row instrument"]
    shared: Float[np.ndarray, "error time instrument"] | None

    def binned_shared(self, bins: BinnedReadings) -> Float[np.ndarray, "error reading"] | None:
        """The means over bins of the responses to the shared errors; None without plates."""
        if self.shared is None:
            return None
        return np.stack([np.asarray(bins.mean(on_device(error))) for error in self.shared])

    def with_last(self, other: FaceErrorResponses, index: int) -> FaceErrorResponses:
        """The same with one instrument of others as the last."""

        def both(own: np.ndarray, others: np.ndarray) -> np.ndarray:
            return np.concatenate([own, others[..., index : index + 1]], axis=2)

        shared = None
        if self.shared is not None and other.shared is not None:
            shared = both(self.shared, other.shared)
        return FaceErrorResponses(both(self.impulse, other.impulse), shared)
