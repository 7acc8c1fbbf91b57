"""Bounds that no wall, soil, ice or metal passes: no value and no end of an interval lies outside them."""

from __future__ import annotations

import math

LOWEST, HIGHEST = 1e-9, 2e-4
"""Bounds of a diffusivity, m2/s: insulating powders in heavy gases have 1e-8, silver 1.7e-4."""

PHYSICAL_BOUNDS = {
    "m2/s": (LOWEST, HIGHEST),
    "W/m/K": (1e-3, 1e3),
    "J/m3/K": (1e3, 1e7),
    "m2 K/W": (1e-5, 1e3),
    "J/m2/K": (1.0, 1e9),
    "W/m2/K": (1e-3, 1e5),
}
"""Smallest and largest value of each quantity by its unit: a vacuum panel conducts 0.004 W/m/K, copper 400; air holds
1.2e3 J/m3/K, water 4.2e6."""


def clip_to_physical(low: float, high: float, unit: str) -> tuple[float, float]:
    """The ends of an interval, moved to the physical bounds of its unit where they lie outside.

    Args:
        low, high: ends of the interval, in `unit`; NaN stays NaN.
        unit: a key of `PHYSICAL_BOUNDS`; for another unit the ends stay as they are.
    """
    lowest, highest = PHYSICAL_BOUNDS.get(unit, (-math.inf, math.inf))
    return tuple(end if math.isnan(end) else min(max(end, lowest), highest) for end in (low, high))  # pyright: ignore[reportReturnType]


def limited_log_std(std: float) -> float:
    """A standard error of ln(alpha), at most the logarithm of the ratio of the bounds of a diffusivity."""
    return min(std, math.log(HIGHEST / LOWEST)) if not math.isnan(std) else std
