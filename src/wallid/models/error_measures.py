"""The paper's measures of error. Source: Berger and Kadoch, Section 5."""

from __future__ import annotations

import numpy as np
from jaxtyping import ArrayLike


def eps_2(values: ArrayLike, reference: ArrayLike) -> float:
    """Root mean square over all rows and points, `sqrt(mean((u - u_ref)^2))`; missing values are ignored."""
    return float(np.sqrt(np.nanmean(np.square(np.asarray(values) - np.asarray(reference)))))


def eps_inf(values: ArrayLike, reference: ArrayLike) -> float:
    """Largest absolute difference over all rows and points; missing values are ignored."""
    return float(np.nanmax(np.abs(np.asarray(values) - np.asarray(reference))))
