"""The paper's measures of error (its Section 5)."""

from __future__ import annotations

import numpy as np
from jaxtyping import ArrayLike


def eps_2(values: ArrayLike, reference: ArrayLike) -> float:
    """Root mean square over all rows and points, `sqrt(mean((u - u_ref)^2))`; missing values left out."""
    return float(np.sqrt(np.nanmean(np.square(np.asarray(values) - np.asarray(reference)))))


def eps_inf(values: ArrayLike, reference: ArrayLike) -> float:
    """Largest absolute difference over all rows and points; missing values left out."""
    return float(np.nanmax(np.abs(np.asarray(values) - np.asarray(reference))))


def eps_r(value: float, reference: float) -> float:
    """Relative error of a parameter, `(p - p_ref)/p_ref`."""
    return (value - reference) / reference
