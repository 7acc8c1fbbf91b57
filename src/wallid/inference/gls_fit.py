"""Inference at the GLS optimum: standard errors, shares of the variance, a test of constancy, the interval.

    Cov(y) = w (J' R^-1 J + 1)^-1,      y = (ln(alpha), z)

with `z` the nuisance parameters in prior standard deviations (each prior adds 1, except for ln(alpha), which has none),
and `w` an inflation for the uncertainty of the noise's shape. Where the weights are those of the stated noise, and the
noise estimated from the residual has another covariance `R_n`, the sandwich form: `K R_n K' + priors` with `y = K m`
for readings `m`.

Source: G. A. F. Seber, C. J. Wild, Nonlinear Regression (1989), 5.4; P. J. Huber, Proc. Fifth Berkeley Symposium 1
(1967), 221.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from .._internal.arrays import on_device
from .likelihood import LOG_CONDUCTIVITY, PROFILE_MODE, LikelihoodProblem, Minimum
from .noise_covariance import Noise, NoiseShape
from .nuisance_parameters import NuisanceKind, instrument_error_kinds
from .parameters import Parameters, kind_of
from .profile_interval import Interval, interval_95

_MODULATIONS = 3  # of the diffusivity in time: from half a cosine wave over the window to one and a half


@dataclass(frozen=True, eq=False)
class GLSFit:
    """The minimum of the generalised least-squares cost, with its inference.

    Args:
        problem, minimum: the cost, and its minimum over all parameters.
        shape: the covariance for any size of the noise. noise: the covariance that the weights are from.
        kinds: of nuisance parameters, in the order of the parameters.
        reduced_chi_square: the cost under the stated noise, over its degrees of freedom.
        estimated: whether the noise was estimated from the record; if not, it is as stated, and a large residual
            inflates the covariance.
        iterations: of generalised least squares.
        robust: the noise estimated from the residual where the weights are those of the stated noise; or None.
    """

    problem: LikelihoodProblem
    minimum: Minimum
    shape: NoiseShape
    noise: Noise
    kinds: Sequence[NuisanceKind]
    reduced_chi_square: float
    estimated: bool
    iterations: int
    robust: Noise | None = None

    @cached_property
    def parameters(self) -> Parameters:
        """All parameters at the minimum, in their own units."""
        return self.problem.to_parameters(self.minimum.parameters)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The estimated parameters: the order of every array below. The diffusivity's logarithm is the first."""
        return self.problem.parameters.estimated_names

    @cached_property
    def used(self) -> np.ndarray:
        """Indices of the estimated parameters among all."""
        return np.flatnonzero(np.asarray(self.problem.parameters.estimated))

    def indices(self, *kinds: str) -> np.ndarray:
        """Where the estimated parameters of some kinds stand in the arrays below."""
        return np.array([k for k, name in enumerate(self.names) if kind_of(name) in kinds], int)

    @cached_property
    def z(self) -> np.ndarray:
        """ln(alpha/start), then the nuisance parameters in prior standard deviations."""
        return np.asarray(self.minimum.parameters)[self.used]

    @cached_property
    def readings_jacobian(self) -> np.ndarray:
        """Of the binned readings, K, `(reading, param)`."""
        return np.asarray(self.minimum.jacobian)[:, self.used]

    @cached_property
    def jacobian(self) -> np.ndarray:
        """Of the whitened readings, the priors' rows below, `(row, param)`."""
        count = len(self.names)
        return np.concatenate([self.noise.whiten @ self.readings_jacobian, np.eye(count - 1, count, 1)])

    @cached_property
    def finite(self) -> bool:
        """Whether the model's values and derivatives are finite there."""
        return bool(np.all(np.isfinite(self.jacobian)))

    @cached_property
    def inverse(self) -> np.ndarray:
        """Change of each parameter per whitened reading and per prior residual, `(param, row)`; NaN if not finite."""
        if not self.finite:
            return np.full(self.jacobian.shape[::-1], np.nan)
        size = np.maximum(np.linalg.norm(self.jacobian, axis=0), 1e-300)
        return np.linalg.pinv(self.jacobian / size, rcond=1e-13) / size[:, None]

    @cached_property
    def marginal_cost(self) -> float:
        """`-2 log L` with the nuisance parameters integrated out, without the noise's constant."""
        J = self.jacobian[:, 1:]
        return float(self.minimum.cost) + float(np.linalg.slogdet(J.T @ J)[1])

    @property
    def evidence(self) -> float:
        """The same with the noise's constant, to compare minima under noise of different sizes."""
        return self.marginal_cost - 2.0 * float(np.sum(np.log(np.diag(self.noise.whiten))))

    @property
    def sensitivity(self) -> np.ndarray:
        """The binned readings' derivative with respect to ln(alpha), nuisance parameters projected out, K."""
        J, raw = self.jacobian, self.readings_jacobian
        rest = np.linalg.lstsq(J[:, 1:], J[:, 0], rcond=None)[0]
        return raw[:, 0] - raw[:, 1:] @ rest

    @property
    def variance_inflation(self) -> float:
        """Of the covariance: for the uncertainty of the noise's shape, or for a residual beyond the stated noise."""
        if self.robust is not None:
            return float(self.covariance[0, 0] / (self.inverse[0] @ self.inverse[0]))
        return self.noise.widening if self.estimated else max(1.0, self.reduced_chi_square)

    @cached_property
    def covariance(self) -> np.ndarray:
        """Of ln(alpha) and the nuisance parameters in prior standard deviations, `(param, param)`."""
        if self.robust is None:
            return self.inverse @ self.inverse.T * self.variance_inflation
        readings = len(self.noise.whiten)
        own, priors = self.inverse[:, :readings] @ self.noise.whiten, self.inverse[:, readings:]
        return own @ self.robust.covariance @ own.T + priors @ priors.T

    @cached_property
    def readings_covariance(self) -> np.ndarray:
        """Covariance of the binned readings' noise as estimated, inflated for the uncertainty of its shape, K2."""
        return self.noise.covariance * self.variance_inflation if self.robust is None else self.robust.covariance

    @cached_property
    def constancy_p_value(self) -> float:
        """P-value of the test that the diffusivity is constant over the window.

        A score test of the residual along the readings' derivative with respect to ln(alpha), modulated by
        `cos(pi k t / T)`, k = 1, 2, 3, all parameters projected out. The statistic is F-distributed, with as many
        degrees of freedom as the noise was estimated from.

        Source: C. R. Rao, Proc. Camb. Phil. Soc. 44 (1948), 50.
        """
        bins = self.shape.count
        slope = self.readings_jacobian[:, 0].reshape(-1, bins)
        modulation = np.cos(np.pi * np.outer(np.arange(1, _MODULATIONS + 1), (np.arange(bins) + 0.5) / bins))
        varied = self.noise.whiten @ (slope * modulation[:, None]).reshape(_MODULATIONS, -1).T
        scale = np.maximum(np.linalg.norm(self.jacobian, axis=0), 1e-300)
        basis, _ = np.linalg.qr(self.jacobian / scale)
        varied = np.pad(varied, ((0, len(self.names) - 1), (0, 0)))
        varied = varied - basis @ (basis.T @ varied)
        readings = len(self.noise.whiten)
        score = varied.T @ np.concatenate([self.noise.whiten @ np.asarray(self.minimum.left), -self.z[1:]])
        own, priors = varied[:readings].T @ self.noise.whiten, varied[readings:]
        spread = own @ self.readings_covariance @ own.T + priors.T @ priors
        statistic = float(score @ np.linalg.lstsq(spread, score, rcond=1e-9)[0]) / _MODULATIONS
        freedom = (self.robust or self.noise).freedom
        if not np.isfinite(freedom):
            return float(scipy.special.chdtrc(_MODULATIONS, _MODULATIONS * statistic))
        return float(scipy.special.fdtrc(_MODULATIONS, freedom, statistic))

    @property
    def log_alpha(self) -> float:
        """ln(alpha/start)."""
        return float(self.z[0])

    @property
    def diffusivity(self) -> float:
        """m2/s."""
        return float(self.problem.start) * math.exp(self.log_alpha)

    @property
    def log_std(self) -> float:
        """Standard error of ln(alpha)."""
        variance = float(self.covariance[0, 0])
        return math.sqrt(variance) if 0.0 < variance < math.inf else math.inf

    @property
    def quantile(self) -> float:
        """97.5 % quantile, in units of `log_std`: above the normal one for the uncertainty of the noise."""
        if self.robust is not None:
            return self.robust.quantile
        return self.noise.quantile / math.sqrt(self.noise.widening)

    def std(self, name: str) -> float:
        """Standard error of an estimated parameter, in its own unit."""
        k, prior_std = self.names.index(name), float(self.parameters.prior_std[self.parameters.index(name)])
        std = math.sqrt(max(float(self.covariance[k, k]), 0.0))
        return std * prior_std if math.isfinite(prior_std) else std

    @cached_property
    def interval(self) -> Interval:
        """95 % interval of ln(alpha/start)."""
        return interval_95(
            self.problem, self.log_alpha, self.log_std, self.quantile, self.variance_inflation, self.marginal_cost
        )

    def variance(self, combination: np.ndarray) -> float:
        """Variance of a linear combination of the parameters, such as ln(heat capacity)."""
        return float(combination @ self.covariance @ combination)

    def of_instrument_errors(self, combination: np.ndarray) -> dict[str, float]:
        """Change of a combination of the parameters for one prior standard deviation of each instrument error."""
        readings = len(self.noise.whiten)
        per_prior = combination @ self.inverse[:, readings:]
        return {self.names[k]: float(per_prior[k - 1]) for k in self.indices(*instrument_error_kinds(self.kinds))}

    def model_shift(self, model_difference: np.ndarray) -> float:
        """Shift of ln(alpha) by an error of the predictions at the rows, K (of plates as q L / k)."""
        if LOG_CONDUCTIVITY in self.parameters:
            scale = np.asarray(self.problem.flux_scale(self.minimum.parameters) / self.problem.data.temperature)
            plates = len(scale)
            model_difference = np.concatenate(
                [model_difference[:, :-plates], scale * model_difference[:, -plates:]], axis=1
            )
        binned = np.asarray(self.problem.bins.mean(on_device(model_difference)))
        return float(self.inverse[0, : len(binned)] @ (self.noise.whiten @ binned))

    def shares(self) -> dict[str, float]:
        """Share of each source of error in ln(alpha)'s variance.

        The noise with all parameters known, then what the uncertainty of each kind of parameters adds, in order.
        """
        J, readings = self.jacobian, len(self.noise.whiten)
        own = J[:readings, 0] / np.sum(J[:readings, 0] ** 2) @ self.noise.whiten
        known = float(own @ self.noise.covariance @ own)
        faces = float(own @ self.faces_covariance @ own)
        variance = {"sensors' noise": known - faces, "faces' noise": faces}
        groups = {kind.source_of_variance: self.indices(kind.kind) for kind in self.kinds}
        groups["initial profile"] = self.indices(PROFILE_MODE)
        used = [0]
        for source, columns in groups.items():
            used += columns.tolist()
            if len(columns):
                # ln(alpha) last: its row is what the other parameters leave
                R = np.asarray(np.linalg.qr(J[:, used][:, ::-1], mode="r"))
                variance[source] = float(1.0 / R[-1, -1] ** 2) - sum(variance.values())
        total = sum(variance.values())
        return {source: part / total for source, part in variance.items()}

    @cached_property
    def faces_covariance(self) -> np.ndarray:
        """The part of the covariance that is the faces' noise."""
        only = NoiseShape(np.zeros_like(self.shape.response), self.shape.bins, self.shape.sensor_std, 0.0)
        sensors = only.noise(self.noise.white, self.noise.autocorrelated, self.noise.correlation).covariance
        present = self.shape.counts.T.reshape(-1) > 0
        return (self.noise.covariance - sensors) * np.outer(present, present)
