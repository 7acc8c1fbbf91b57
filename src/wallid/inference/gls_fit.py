"""Inference at the GLS optimum: standard errors, shares of the variance, a test of constancy, the interval.

    Cov(y) = w K R K' + K_p K_p',      (K R^1/2, K_p) = (J' R^-1 J + 1)^-1 (J' R^-1/2, 1),      y = (ln(alpha), z)

with `z` the nuisance parameters in prior standard deviations (each prior adds 1, except for ln(alpha), which has none),
`y = K m` for readings `m`, and `w` an inflation for the uncertainty of the noise's shape. Where the weights are those
of the stated noise, and the noise estimated from the residual has another covariance `R_n`, the sandwich form:
`K R_n K' + K_p K_p'`.

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
from jaxtyping import Float

from .._internal.arrays import on_device
from .disturbance_search import Disturbance
from .likelihood import LOG_CONDUCTIVITY, PROFILE_MODE, LikelihoodProblem, Minimum
from .noise_covariance import NoiseCovariance, NoiseShape
from .nuisance_kinds import ContactResistances, NuisanceKind, WallParameters
from .nuisance_parameters import instrument_error_kinds
from .parameters import Parameters, kind_of
from .profile_interval import Interval, interval_95
from .whittle_likelihood import projected_sensitivity

_LEAST_SENSITIVITY = 1e-6  # of the whitened readings to ln(alpha)
_MODULATIONS = 3  # of the diffusivity in time: from half a cosine wave over the window to one and a half


@dataclass(frozen=True, eq=False)
class GLSFit:
    """The minimum of the generalised least-squares cost, with its inference.

    Args:
        problem, minimum: the cost, and its minimum over all parameters.
        noise_shape: the covariance for any size of the noise.
        noise: the covariance from which the weights are.
        kinds: of nuisance parameters, in the order of the parameters.
        reduced_chi_square: the cost under the stated noise, over its degrees of freedom.
        noise_estimated: whether the noise was estimated from the record. If not, it is as stated, and a large residual
            inflates the covariance.
        iterations: of generalised least squares.
        robust: the noise estimated from the residual where the weights are those of the stated noise; or None.
        disturbance: heat that the model does not know, as part of `noise`; or None.
    """

    problem: LikelihoodProblem
    minimum: Minimum
    noise_shape: NoiseShape
    noise: NoiseCovariance
    kinds: Sequence[NuisanceKind]
    reduced_chi_square: float
    noise_estimated: bool
    iterations: int
    robust: NoiseCovariance | None = None
    disturbance: Disturbance | None = None

    @cached_property
    def parameters(self) -> Parameters:
        """All parameters at the minimum, in their own units."""
        return self.problem.to_parameters(self.minimum.vector)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The estimated parameters: the order of every array below. The diffusivity's logarithm is the first."""
        return self.problem.parameters.estimated_names

    @cached_property
    def estimated_indices(self) -> np.ndarray:
        """Indices of the estimated parameters among all."""
        return np.flatnonzero(np.asarray(self.problem.parameters.estimated))

    def indices(self, *kinds: str) -> np.ndarray:
        """Indices in the arrays below of the estimated parameters of some kinds."""
        return np.array([k for k, name in enumerate(self.names) if kind_of(name) in kinds], int)

    @cached_property
    def z(self) -> np.ndarray:
        """ln(alpha/start), then the nuisance parameters in prior standard deviations."""
        return np.asarray(self.minimum.vector)[self.estimated_indices]

    @cached_property
    def deviation(self) -> np.ndarray:
        """The parameters minus the means of their priors, in prior standard deviations; ln(alpha/start) first."""
        return self.z - np.asarray(self.problem.prior_mean)[self.estimated_indices]

    @cached_property
    def readings_jacobian(self) -> np.ndarray:
        """Jacobian of the binned readings, K, `(reading, param)`."""
        return np.asarray(self.minimum.jacobian)[:, self.estimated_indices]

    @cached_property
    def jacobian(self) -> np.ndarray:
        """Jacobian of the whitened readings, then of the prior residuals, `(row, param)`."""
        count = len(self.names)
        return np.concatenate([self.noise.whitening @ self.readings_jacobian, np.eye(count - 1, count, 1)])

    @cached_property
    def whitened_residual(self) -> np.ndarray:
        """Measured minus predicted, whitened, then the prior residuals: the rows of `jacobian`."""
        return np.concatenate([self.noise.whitening @ np.asarray(self.minimum.residual), -self.deviation[1:]])

    @property
    def contacts(self) -> tuple[str, ...]:
        """The names of the estimated contact resistances at plates."""
        return self.parameters.of_kind(ContactResistances.kind)

    @property
    def wall(self) -> Float[np.ndarray, " param"]:
        """The estimates of the wall's own parameters, over their prior standard deviations."""
        return self.parameters.in_prior_std(self.parameters.of_kind(WallParameters.kind))

    @cached_property
    def finite(self) -> bool:
        """Whether the Jacobian is finite."""
        return bool(np.all(np.isfinite(self.jacobian)))

    @property
    def depends_on_diffusivity(self) -> bool:
        """Whether the readings depend on the diffusivity: not where the wall is always as warm as both faces."""
        return float(np.linalg.norm(self.jacobian[:, 0])) > _LEAST_SENSITIVITY

    @cached_property
    def generalised_inverse(self) -> np.ndarray:
        """Pseudo-inverse of the Jacobian, `(param, row)`; NaN where the Jacobian is not finite."""
        if not self.finite:
            return np.full(self.jacobian.shape[::-1], np.nan)
        size = np.maximum(np.linalg.norm(self.jacobian, axis=0), 1e-300)
        return np.linalg.pinv(self.jacobian / size, rcond=1e-13) / size[:, None]

    @cached_property
    def marginal_cost(self) -> float:
        """`-2 log L` with the nuisance parameters integrated out, without `log det R`."""
        J = self.jacobian[:, 1:]
        return float(self.minimum.cost) + float(np.linalg.slogdet(J.T @ J)[1])

    @property
    def marginal_deviance(self) -> float:
        """The marginal cost plus `log det R`, which compares minima under noise of different sizes."""
        return self.marginal_cost - 2.0 * float(np.sum(np.log(np.diag(self.noise.whitening))))

    @property
    def sensitivity(self) -> np.ndarray:
        """The binned readings' derivative with respect to ln(alpha), nuisance parameters projected out, K."""
        return projected_sensitivity(self.jacobian, self.readings_jacobian)

    @property
    def variance_inflation(self) -> float:
        """The variance of ln(alpha) over that by the problem's weights."""
        by_weights = float(self.generalised_inverse[0] @ self.generalised_inverse[0])
        return float(self.covariance[0, 0]) / by_weights if by_weights > 0.0 else self.noise_inflation

    @property
    def noise_inflation(self) -> float:
        """Inflation of the readings' covariance: for an uncertain disturbance or shape of the noise, or a residual."""
        if self.disturbance is not None:
            return float(self.disturbance.inflation[0] ** 2)
        return self.noise.variance_inflation if self.noise_estimated else max(1.0, self.reduced_chi_square)

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance of ln(alpha) and of the nuisance parameters in prior standard deviations, `(param, param)`.

        The shape of an estimated noise is uncertain, the priors are as stated: only the part by noise is inflated. A
        residual above the stated noise has no known reason, so it inflates everything.
        """
        if self.disturbance is not None:
            spread = self.generalised_inverse @ self.generalised_inverse.T
            return spread * np.outer(self.disturbance.inflation, self.disturbance.inflation)
        if self.robust is None and not self.noise_estimated:
            return self.generalised_inverse @ self.generalised_inverse.T * self.noise_inflation
        K, priors = np.split(self.generalised_inverse, [len(self.noise.whitening)], axis=1)
        K = K @ self.noise.whitening
        return K @ self.readings_covariance @ K.T + priors @ priors.T

    @cached_property
    def readings_covariance(self) -> np.ndarray:
        """Covariance of the binned readings' noise as estimated, inflated for the uncertainty of its shape, K2."""
        return self.noise.covariance * self.noise_inflation if self.robust is None else self.robust.covariance

    @cached_property
    def constancy_p_value(self) -> float:
        """P-value of the test that the diffusivity is constant over the window.

        A score test of the residual along the readings' derivative with respect to ln(alpha), modulated by
        `cos(pi k t / T)`, k = 1, 2, 3, all parameters projected out. The statistic is F-distributed, with as many
        degrees of freedom as the noise was estimated from.

        Source: C. R. Rao, Proc. Camb. Phil. Soc. 44 (1948), 50.
        """
        bins = self.noise_shape.bin_count
        slope = self.readings_jacobian[:, 0].reshape(-1, bins)
        modulation = np.cos(np.pi * np.outer(np.arange(1, _MODULATIONS + 1), (np.arange(bins) + 0.5) / bins))
        directions = self.noise.whitening @ (slope * modulation[:, None]).reshape(_MODULATIONS, -1).T
        scale = np.maximum(np.linalg.norm(self.jacobian, axis=0), 1e-300)
        basis, _ = np.linalg.qr(self.jacobian / scale)
        directions = np.pad(directions, ((0, len(self.names) - 1), (0, 0)))
        directions = directions - basis @ (basis.T @ directions)
        readings = len(self.noise.whitening)
        score = directions.T @ self.whitened_residual
        K, priors = directions[:readings].T @ self.noise.whitening, directions[readings:]
        score_covariance = K @ self.readings_covariance @ K.T + priors.T @ priors
        statistic = float(score @ np.linalg.lstsq(score_covariance, score, rcond=1e-9)[0]) / _MODULATIONS
        freedom = (self.robust or self.noise).degrees_of_freedom
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
    def change(self) -> float:
        """How far ln(alpha) is from the point about which the problem was linear; infinite where it is not finite."""
        change = abs(self.log_alpha - float(self.problem.nuisance.log_alpha))
        return change if math.isfinite(change) else math.inf

    @property
    def quantile(self) -> float:
        """97.5 % quantile of ln(alpha) in units of `log_std`, above the normal one where the noise is estimated."""
        if self.robust is not None:
            return self.robust.quantile
        return self.noise.quantile / math.sqrt(self.noise.variance_inflation)

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
        """Variance of a linear combination of the parameters, such as ln(heat capacity).

        Args:
            combination: its coefficients, `(param,)`.
        """
        return float(combination @ self.covariance @ combination)

    def instrument_error_effects(self, combination: np.ndarray) -> dict[str, float]:
        """Change of a combination of the parameters for one prior standard deviation of each instrument error."""
        readings = len(self.noise.whitening)
        per_prior = combination @ self.generalised_inverse[:, readings:]
        return {self.names[k]: float(per_prior[k - 1]) for k in self.indices(*instrument_error_kinds(self.kinds))}

    def model_shift(self, model_difference: np.ndarray) -> float:
        """Shift of ln(alpha) by a model error.

        Args:
            model_difference: error of the predictions at the rows, K (of plates as q L / k), `(time, channel)`.
        """
        if LOG_CONDUCTIVITY in self.parameters:
            scale = np.asarray(self.problem.flux_scale(self.minimum.vector) / self.problem.data.temperature)
            plates = len(scale)
            model_difference = np.concatenate(
                [model_difference[:, :-plates], scale * model_difference[:, -plates:]], axis=1
            )
        binned = np.asarray(self.problem.bins.mean(on_device(model_difference)))
        return float(self.generalised_inverse[0, : len(binned)] @ (self.noise.whitening @ binned))

    def variance_shares(self) -> dict[str, float]:
        """Share of each source of error in ln(alpha)'s variance.

        First the noise, with all nuisance parameters known; then the increase by each kind of parameters, in order.
        """
        J, readings = self.jacobian, len(self.noise.whitening)
        K = J[:readings, 0] / np.sum(J[:readings, 0] ** 2) @ self.noise.whitening
        noise = float(K @ self.noise.covariance @ K)
        faces = float(K @ self.faces_covariance @ K)
        variance = {"sensors' noise": noise - faces, "faces' noise": faces}
        if self.noise.disturbance is not None:
            present = self.noise_shape.has_reading
            variance["disturbance"] = float((K * present) @ self.noise.disturbance @ (K * present))
            variance["sensors' noise"] -= variance["disturbance"]
        groups = {kind.source_of_variance: self.indices(kind.kind) for kind in self.kinds}
        groups["initial profile"] = self.indices(PROFILE_MODE)
        columns = [0]
        for source, indices in groups.items():
            columns += indices.tolist()
            if len(indices):
                # ln(alpha) is the last column: its diagonal element is what remains after projecting out the others
                R = np.asarray(np.linalg.qr(J[:, columns][:, ::-1], mode="r"))
                variance[source] = float(1.0 / R[-1, -1] ** 2) - sum(variance.values())
        total = sum(variance.values())
        return {source: part / total for source, part in variance.items()}

    @cached_property
    def faces_covariance(self) -> np.ndarray:
        """The part of the readings' covariance due to the faces: their noise and what they do between rows, K2."""
        shape, noise = self.noise_shape, self.noise
        of_readings = shape.faces_covariance(noise.white, noise.autocorrelated, noise.correlation)
        return of_readings + shape.gap_errors.T @ shape.gap_errors
