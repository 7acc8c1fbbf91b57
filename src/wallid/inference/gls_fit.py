"""What a minimum says under the covariance that belongs to it: standard errors, shares of the variance, the interval.

    Cov(y) = w (J' R^-1 J + 1)^-1,      y = (ln(alpha), z)

in generalised least squares, with `z` all else that is free in standard deviations of its prior (whose rows are the 1,
but for ln(alpha)), and `w` for what the record leaves open of the noise. Where the weights are those of the noise as
stated and another, `R_n`, was found, both sides of it: `K R_n K' + priors` with `y = K m` for readings `m`.

Source: G. A. F. Seber, C. J. Wild, Nonlinear Regression (1989), 5.4; P. J. Huber, Proc. Fifth Berkeley Symposium 1
(1967), 221.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from .._internal.arrays import on_device
from .likelihood import LikelihoodProblem, Minimum
from .noise_covariance import Noise, NoiseShape
from .nuisance_parameters import NuisanceParameters
from .profile_interval import Interval, interval_95

_MODULATIONS = 3  # of the diffusivity in time: half a wave over the window to one and a half


@dataclass(frozen=True, eq=False)
class GLSFit:
    """The minimum under the covariance that belongs to it.

    Args:
        shape: the covariance for any size of the noise. noise: at the size that the weights have.
        reduced_chi_square: the cost under the noise as stated, over its degrees of freedom.
        estimated: whether the noise's sizes are the record's; else as stated, and a misfit widens the interval.
        robust: the noise that was found beside weights as stated; or None.
        rounds: how many it took.
    """

    problem: LikelihoodProblem
    minimum: Minimum
    shape: NoiseShape
    noise: Noise
    names: NuisanceParameters
    reduced_chi_square: float
    estimated: bool
    rounds: int
    robust: Noise | None = None

    @cached_property
    def jacobian(self) -> np.ndarray:
        """Of the whitened readings, the priors' rows below, `(row, param)`."""
        J = self.noise.whiten @ np.asarray(self.minimum.jacobian)
        return np.concatenate([J, np.eye(self.names.count, 1 + self.names.count, 1)])

    @cached_property
    def finite(self) -> bool:
        """Whether the model has a value and a slope there."""
        return bool(np.all(np.isfinite(self.jacobian)))

    @cached_property
    def inverse(self) -> np.ndarray:
        """What each whitened reading and each prior does to each parameter, `(param, row)`; NaN where it failed."""
        if not self.finite:
            return np.full(self.jacobian.shape[::-1], np.nan)
        size = np.maximum(np.linalg.norm(self.jacobian, axis=0), 1e-300)
        return np.linalg.pinv(self.jacobian / size, rcond=1e-13) / size[:, None]

    @cached_property
    def marginal(self) -> float:
        """`-2 log L` with all that is free integrated out, up to what the noise alone sets."""
        J = self.jacobian[:, 1:]
        return float(self.minimum.cost) + float(np.linalg.slogdet(J.T @ J)[1])

    @property
    def evidence(self) -> float:
        """The same with what the noise sets, to compare minima under noise of different sizes."""
        return self.marginal - 2.0 * float(np.sum(np.log(np.diag(self.noise.whiten))))

    @property
    def along(self) -> np.ndarray:
        """The binned readings' derivative by ln(alpha), K, with all that is free at its best."""
        J = self.jacobian
        rest = np.linalg.lstsq(J[:, 1:], J[:, 0], rcond=None)[0]
        raw = np.asarray(self.minimum.jacobian)
        return raw[:, 0] - raw[:, 1:] @ rest

    @property
    def widening(self) -> float:
        """Of the covariance: by how uncertain the noise's shape is, or by a misfit beyond the stated noise."""
        if self.robust is not None:
            return float(self.covariance[0, 0] / (self.inverse[0] @ self.inverse[0]))
        return self.noise.widening if self.estimated else max(1.0, self.reduced_chi_square)

    @cached_property
    def covariance(self) -> np.ndarray:
        """Of ln(alpha) and all that is free, in prior standard deviations."""
        if self.robust is None:
            return self.inverse @ self.inverse.T * self.widening
        # what the noise found makes of an estimate by these weights, and the priors' part
        readings = len(self.noise.whiten)
        own, priors = self.inverse[:, :readings] @ self.noise.whiten, self.inverse[:, readings:]
        return own @ self.robust.covariance @ own.T + priors @ priors.T

    @cached_property
    def noise_covariance(self) -> np.ndarray:
        """Of the binned readings, as the record shows it and as far as its shape is known, K2."""
        return self.noise.covariance * self.widening if self.robust is None else self.robust.covariance

    @cached_property
    def steadiness(self) -> float:
        """How often chance alone makes the readings ask for a diffusivity that varies in time as much as these do.

        The residual along the readings' derivative by ln(alpha), modulated by `cos(pi k t / T)` with k = 1, 2, 3,
        beside all that is free: a score test, `F` with as many degrees of freedom as the noise was estimated from.

        Source: C. R. Rao, Proc. Camb. Phil. Soc. 44 (1948), 50.
        """
        bins = self.shape.count
        slope = np.asarray(self.minimum.jacobian)[:, 0].reshape(-1, bins)
        course = np.cos(np.pi * np.outer(np.arange(1, _MODULATIONS + 1), (np.arange(bins) + 0.5) / bins))
        varied = self.noise.whiten @ (slope * course[:, None]).reshape(_MODULATIONS, -1).T
        scale = np.maximum(np.linalg.norm(self.jacobian, axis=0), 1e-300)
        taken, _ = np.linalg.qr(self.jacobian / scale)
        varied = np.pad(varied, ((0, self.names.count), (0, 0)))
        varied = varied - taken @ (taken.T @ varied)
        readings, z = len(self.noise.whiten), np.asarray(self.minimum.parameters)[1:]
        score = varied.T @ np.concatenate([self.noise.whiten @ np.asarray(self.minimum.left), -z])
        own, priors = varied[:readings].T @ self.noise.whiten, varied[readings:]
        spread = own @ self.noise_covariance @ own.T + priors.T @ priors
        statistic = float(score @ np.linalg.lstsq(spread, score, rcond=1e-9)[0]) / _MODULATIONS
        freedom = (self.robust or self.noise).freedom
        if not np.isfinite(freedom):
            return float(scipy.special.chdtrc(_MODULATIONS, _MODULATIONS * statistic))
        return float(scipy.special.fdtrc(_MODULATIONS, freedom, statistic))

    @property
    def log_alpha(self) -> float:
        """ln(alpha/start)."""
        return float(np.asarray(self.minimum.parameters)[0])

    @property
    def diffusivity(self) -> float:
        """m2/s."""
        return float(self.problem.start) * math.exp(self.log_alpha)

    @property
    def log_std(self) -> float:
        """Of ln(alpha)."""
        variance = float(self.covariance[0, 0])
        return math.sqrt(variance) if 0.0 < variance < math.inf else math.inf

    @property
    def quantile(self) -> float:
        """97.5 %, in units of `log_std`: beyond the normal one by what the record leaves open of the noise."""
        if self.robust is not None:
            return self.robust.quantile
        return self.noise.quantile / math.sqrt(self.noise.widening)

    @cached_property
    def interval(self) -> Interval:
        """95 %, of ln(alpha/start)."""
        return interval_95(self.problem, self.log_alpha, self.log_std, self.quantile, self.widening, self.marginal)

    def variance(self, along: np.ndarray) -> float:
        """Of a combination of the parameters, such as ln(heat capacity)."""
        return float(along @ self.covariance @ along)

    def of_constants(self, along: np.ndarray) -> np.ndarray:
        """What one standard deviation of each constant (offsets, places, gains) makes of such a combination."""
        readings = len(self.noise.whiten)
        return along @ self.inverse[:, readings:][:, self.names.constants[1:]]

    def model_shift(self, apart: np.ndarray) -> float:
        """How far an error of the predictions, K at the rows and of plates that of q L / k, moves ln(alpha)."""
        if plates := len(self.names.fluxes):
            conductance = np.asarray(self.problem.flux_scale(self.minimum.parameters) / self.problem.data.temperature)
            apart = np.concatenate([apart[:, :-plates], conductance * apart[:, -plates:]], axis=1)
        binned = np.asarray(self.problem.bins.mean(on_device(apart)))
        return float(self.inverse[0, : len(binned)] @ (self.noise.whiten @ binned))

    def shares(self) -> dict[str, float]:
        """What each kind of error makes of ln(alpha)'s variance, 1.

        The noise with all else known, then what it adds that offsets, positions and the initial profile are not.
        """
        names, J = self.names, self.jacobian
        readings = len(self.noise.whiten)
        own = J[:readings, 0] / np.sum(J[:readings, 0] ** 2) @ self.noise.whiten
        known = float(own @ self.noise.covariance @ own)
        faces = float(own @ self.faces_covariance @ own)
        variance = {"sensors' noise": known - faces, "faces' noise": faces}
        groups = {"offsets": len(names.offsets), "positions": len(names.positions), "faces' places": len(names.depths)}
        groups |= {"layers and films": len(names.structure), "common noise": len(names.common)}
        groups |= {"initial profile": names.modes}
        used = 1
        for name, count in groups.items():
            used += count
            if count:
                # ln(alpha) last: its row is what the rest leave
                R = np.asarray(np.linalg.qr(J[:, :used][:, ::-1], mode="r"))
                variance[name] = float(1.0 / R[-1, -1] ** 2) - sum(variance.values())
        total = sum(variance.values())
        return {name: part / total for name, part in variance.items()}

    @cached_property
    def faces_covariance(self) -> np.ndarray:
        """The part of the covariance that comes through the faces."""
        only = NoiseShape(np.zeros_like(self.shape.response), self.shape.bins, self.shape.sensor_std, 0.0)
        sensors = only.noise(self.noise.white, self.noise.autocorrelated, self.noise.correlation).covariance
        there = self.shape.counts.T.reshape(-1) > 0
        return (self.noise.covariance - sensors) * np.outer(there, there)
