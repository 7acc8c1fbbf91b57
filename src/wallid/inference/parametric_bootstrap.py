"""A parametric bootstrap: the estimate repeated on readings drawn from the fitted model.

Source: A. C. Davison, D. V. Hinkley, Bootstrap Methods and their Application (1997), 2.2 and 5.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import jax
import numpy as np

from .._internal.arrays import on_device
from .._internal.result_object import ResultObject
from .gls_fit import GLSFit
from .likelihood import bootstrap_estimates
from .nuisance_parameters import instrument_error_kinds


@dataclass(frozen=True)
class Bootstrap(ResultObject):
    """The estimates from readings drawn from the fitted model: a check of standard error and interval.

    Args:
        draws, seed: the number of draws, and the seed of the random numbers.
        std: standard deviation of the estimates, m2/s: that of ln(alpha) times alpha.
        interval_95: 95 % interval, m2/s: `alpha^2` over the draws' 97.5 % and 2.5 % quantiles (the basic bootstrap
            interval of ln(alpha)).
        bias: mean of ln(alpha) minus its true value, in standard errors of the fit.
        values: the diffusivity of each draw, m2/s.
    """

    draws: int
    seed: int
    std: float
    interval_95: tuple[float, float]
    bias: float
    values: np.ndarray = field(repr=False)

    def __str__(self) -> str:
        low, high = self.interval_95
        return f"bootstrap    of {self.draws} draws: +- {self.std:.2g} m2/s   (95 %: {low:.4g} to {high:.4g})"


def bootstrap(fit: GLSFit, draws: int, seed: int) -> Bootstrap:
    """A parametric bootstrap: noise from the estimated covariance, instrument errors from their priors.

    Args:
        draws: the number of draws.
        seed: of the random numbers.
    """
    root = np.linalg.cholesky(fit.readings_covariance)
    parameters = fit.problem.parameters
    instrument_errors = parameters.indices(parameters.of_kind(*instrument_error_kinds(fit.kinds)))
    log_alphas = bootstrap_estimates(
        fit.problem,
        fit.minimum.vector,
        on_device(root),
        draws,
        on_device(np.isin(np.arange(len(parameters)), instrument_errors)),
        jax.random.key(seed),
    )
    errors = np.asarray(log_alphas) - fit.log_alpha
    low, high = np.quantile(errors, [0.025, 0.975])
    value = fit.diffusivity
    return Bootstrap(
        draws=draws,
        seed=seed,
        std=value * float(np.std(errors, ddof=1)),
        interval_95=(value * math.exp(-high), value * math.exp(-low)),
        bias=float(np.mean(errors)) / fit.log_std,
        values=value * np.exp(errors),
    )
