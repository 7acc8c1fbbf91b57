"""A parametric bootstrap: the estimate made again from readings that the fitted model draws.

Source: A. C. Davison, D. V. Hinkley, Bootstrap Methods and their Application (1997), 2.2 and 5.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import jax
import numpy as np

from .._internal.arrays import on_device
from .gls_fit import GLSFit
from .likelihood import resample


@dataclass(frozen=True)
class Bootstrap:
    """The estimate made again from readings that the fitted model draws: a check of standard error and interval.

    Args:
        draws, seed: how many, and of what random numbers.
        std: m2/s, of the estimates; that of ln(alpha) times alpha.
        interval_95: m2/s, `alpha^2` over the draws' 97.5 % and 2.5 % quantiles (the basic interval of ln(alpha)).
        bias: the mean of ln(alpha) less its truth, in standard errors of the fit.
        values: of the draws, m2/s.
    """

    draws: int
    seed: int
    std: float
    interval_95: tuple[float, float]
    bias: float
    values: np.ndarray = field(repr=False)

    def __str__(self) -> str:
        low, high = self.interval_95
        return f"bootstrap    of {self.draws} draws: +- {self.std:.1g}   (95 %: {low:.4g} to {high:.4g})"


def bootstrap(settled: GLSFit, draws: int, seed: int) -> Bootstrap:
    """A parametric bootstrap: noise of the covariance found, offsets and positions from their priors."""
    root = np.linalg.cholesky(settled.noise_covariance)
    found = resample(
        settled.problem,
        settled.minimum.parameters,
        on_device(root),
        draws,
        on_device(settled.names.constants),
        jax.random.key(seed),
    )
    away = np.asarray(found) - settled.log_alpha
    low, high = np.quantile(away, [0.025, 0.975])
    value = settled.diffusivity
    return Bootstrap(
        draws=draws,
        seed=seed,
        std=value * float(np.std(away, ddof=1)),
        interval_95=(value * math.exp(-high), value * math.exp(-low)),
        bias=float(np.mean(away)) / settled.log_std,
        values=value * np.exp(away),
    )
