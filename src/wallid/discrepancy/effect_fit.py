"""The fit of the model with chosen effects: least squares for the effects and the nuisance parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy

from ..inference.likelihood import LOG_DIFFUSIVITY
from ..inference.noise_covariance import NoiseCovariance, whitening_of
from ..inference.parameters import Parameters
from ..inference.physical_bounds import limited_log_std
from ..inference.quantity import Quantity, lognormal
from ..inference.whittle_likelihood import projected_sensitivity
from .least_squares import LeastSquares, levenberg_marquardt
from .problem import DiagnosisProblem, EffectParameters

_MAX_INITIAL_STEP = 1.5  # of ln(alpha)
_BOUND_TOLERANCE = 1e-6  # distance from a bound over the scale of the parameter


@dataclass(frozen=True, eq=False)
class EffectFit:
    """A model fitted to the readings.

    Args:
        problem: the case prepared for the search.
        active: the effects in the model.
        parameters: all at the fit, with the mask of those estimated.
        cost: `-2 log L` without the normalisation by the noise, with the priors.
        converged: whether the optimizer converged.
        noise: the noise covariance of the fit.
        jacobian: whitened, of the estimated parameters, with the rows of the priors below,
            `(reading + estimated, estimated)`.
        residual: whitened, measured minus predicted, with the prior residuals below, `(reading + estimated,)`.
        predicted: the readings, degC (W/m2 of a plate), `(time, instrument)`.
        training_fits: fits of the same model to a part of the rows, by the rows held out.
    """

    problem: DiagnosisProblem
    active: tuple[EffectParameters, ...]
    parameters: Parameters
    cost: float
    converged: bool
    noise: NoiseCovariance
    jacobian: np.ndarray = field(repr=False)
    residual: np.ndarray = field(repr=False)
    predicted: np.ndarray = field(repr=False)
    training_fits: dict[bytes, EffectFit] = field(default_factory=dict, init=False, repr=False)

    def index(self, name: str) -> int:
        """Index of an estimated parameter in the Jacobian and the covariance."""
        return self.parameters.estimated_names.index(name)

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance in the order of `parameters.estimated_names`, `(estimated, estimated)`."""
        return _covariance(self.jacobian)

    @property
    def diffusivity(self) -> float:
        """Diffusivity alpha, m2/s."""
        return float(np.exp(float(self.problem.model.log_prior) + float(self.parameters[LOG_DIFFUSIVITY])))

    @property
    def conductivity(self) -> float:
        """Effective conductivity of the wall, W/m/K; 1 without a plate."""
        return float(self.problem.model.conductivity(self.parameters))

    @property
    def log_std(self) -> float:
        """Standard deviation of ln(alpha), with the uncertainty of the noise's shape where that is known."""
        return self._with_shape_of_noise(self.std(LOG_DIFFUSIVITY))

    @property
    def interval_95(self) -> tuple[float, float]:
        """95 % interval of the diffusivity, m2/s, symmetric in ln(alpha) within the physical bounds."""
        return self.quantity(self.diffusivity, self.std(LOG_DIFFUSIVITY), "m2/s").interval_95

    def quantity(self, value: float, log_std: float, unit: str) -> Quantity:
        """A quantity whose logarithm is linear in the parameters, with its 95 % interval.

        Args:
            value: in `unit`.
            log_std: standard deviation of its logarithm, by the noise of the fit.
            unit: a key of `PHYSICAL_BOUNDS`.
        """
        exact = lognormal(value, log_std**2, self.noise.quantile, unit)
        return replace(exact, std=value * self._with_shape_of_noise(log_std))

    def _with_shape_of_noise(self, log_std: float) -> float:
        """A standard deviation of a logarithm with the uncertainty of the noise's shape."""
        return limited_log_std(log_std * float(np.sqrt(self.noise.variance_inflation)))

    @property
    def events(self) -> list[tuple[float, float]]:
        """Start and duration of each single event (rain), s."""
        events = (
            effect_parameters.effect.at(effect_parameters.values(self.parameters)).event
            for effect_parameters in self.active
        )
        return [event for event in events if event]

    def std(self, name: str) -> float:
        """Standard deviation of an estimated parameter."""
        k = self.index(name)
        return float(np.sqrt(self.covariance[k, k]))

    def std_of_size(self, effect_parameters: EffectParameters) -> float:
        """Standard deviation of the size of an effect at its estimated positions, hours and temperatures.

        `std` of the size includes the uncertainty of these. Where a source is behind the last sensor, its rate and its
        position cannot be estimated together, although it is certain that there is one.
        """
        size, *searched = map(self.index, effect_parameters.names)
        others = np.delete(self.jacobian, searched, axis=1)
        k = size - sum(index < size for index in searched)
        return float(np.sqrt(_covariance(others)[k, k]))

    @cached_property
    def names_at_bound(self) -> frozenset[str]:
        """The parameters of effects that are at a bound of their search range."""
        p = self.parameters
        distance = np.minimum(np.subtract(p.values, p.lower), np.subtract(p.upper, p.values))
        at_bound = distance <= np.multiply(_BOUND_TOLERANCE, p.scale)
        return frozenset(name for one in self.active for name in one.names if at_bound[p.index(name)])

    @property
    def at_bound(self) -> tuple[EffectParameters, ...]:
        """The effects with a parameter at a bound of its search range."""
        return tuple(effect for effect in self.active if self.names_at_bound.intersection(effect.names))

    @cached_property
    def residual_at_rows(self) -> np.ndarray:
        """Measured minus predicted readings, K (W/m2 of a plate), `(time, instrument)`; NaN where one is missing."""
        return self.problem.readings - self.predicted

    @property
    def prior_residual(self) -> np.ndarray:
        """Prior residuals of the estimated parameters, in prior standard deviations."""
        return self.residual[-self.jacobian.shape[1] :]

    def unwhitened(self) -> tuple[np.ndarray, np.ndarray]:
        """Jacobian (K per unit) and residual (K) of the binned readings, before whitening and without the priors."""
        W = self.noise.whitening
        J, r = (scipy.linalg.solve_triangular(W, part[: len(W)], lower=True) for part in (self.jacobian, self.residual))
        return J, r

    @property
    def sensitivity(self) -> np.ndarray:
        """The binned readings' derivative with respect to ln(alpha), the other parameters projected out, K."""
        return projected_sensitivity(self.jacobian, self.unwhitened()[0])

    @property
    def gap(self) -> float:
        """Root mean square of the residual, `rms_over`."""
        return rms_over(self.problem, self.residual_at_rows)

    @property
    def noise_floor(self) -> float:
        """Root mean square that the noise alone would give, over the same instruments."""
        chosen = self.problem.instruments_of_gap
        readings = np.isfinite(self.problem.readings).sum(axis=0)[chosen]
        return float(np.sqrt(np.nansum(readings * self.noise.rms_of_outputs[chosen] ** 2) / readings.sum()))


def _covariance(jacobian: np.ndarray) -> np.ndarray:
    """Covariance of the parameters of a whitened Jacobian, by columns of unit length."""
    size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    inverse = np.linalg.pinv(jacobian / size, rcond=1e-10)
    return (inverse @ inverse.T) / np.outer(size, size)


def rms_over(problem: DiagnosisProblem, residual: np.ndarray) -> float:
    """Root mean square over the inner sensors, K; over the plates, W/m2, where there is no inner sensor.

    Args:
        problem: the case prepared for the search.
        residual: `(time, instrument)`; NaN where a reading is missing.
    """
    return float(np.sqrt(np.nanmean(residual[:, problem.instruments_of_gap] ** 2)))


def refit(
    problem: DiagnosisProblem,
    active: tuple[EffectParameters, ...],
    parameters: Parameters,
    noise: NoiseCovariance,
    *,
    step: Mapping[str, float] | None = None,
    used: np.ndarray | None = None,
) -> EffectFit:
    """Fit the model with these effects, starting from given parameters.

    Args:
        problem: the case prepared for the search.
        active: the effects in the model.
        parameters: where the search starts; those that are not estimated keep their values.
        noise: the noise covariance.
        step: first step of the estimated parameters by name, such as the linear prediction; None for none.
        used: mask of the binned readings to fit; None for all.
    """
    whiten = noise.whitening if used is None else whitening_of_subset(noise, np.flatnonzero(used))
    moved = {}
    for error, effect_parameters in problem.replaced_errors(active).items():
        # the effect takes over the value of the error
        size = effect_parameters.names[0]
        taken_over = problem.taken_over(error, float(parameters[error]))
        moved |= {size: float(parameters[size]) + taken_over, error: 0.0}
    initial = parameters.with_values(moved).estimating(problem.estimated_names(active))
    ahead = initial.flatten()
    if step is not None:
        shift = np.clip(step[LOG_DIFFUSIVITY], -_MAX_INITIAL_STEP, _MAX_INITIAL_STEP)
        ahead += [shift if name == LOG_DIFFUSIVITY else step.get(name, 0.0) for name in initial.estimated_names]
    least_squares = LeastSquares(problem, active, initial, whiten)
    estimate, at, converged = levenberg_marquardt(least_squares, ahead)
    if not at.is_finite:  # the model is not finite at the first step
        estimate, at, converged = levenberg_marquardt(least_squares, initial.flatten())
    cost = float(at.residual @ at.residual) if at.is_finite else np.inf
    fitted = initial.unflatten(estimate)
    return EffectFit(problem, active, fitted, cost, converged, noise, at.jacobian, at.residual, at.predicted)


def linearised_at(
    problem: DiagnosisProblem, active: tuple[EffectParameters, ...], parameters: Parameters, noise: NoiseCovariance
) -> EffectFit:
    """The model with these effects at given parameters, without a fit."""
    given = parameters.estimating(problem.estimated_names(active))
    at = LeastSquares(problem, active, given, noise.whitening).at(given.flatten())
    cost = float(at.residual @ at.residual)
    return EffectFit(problem, active, given, cost, False, noise, at.jacobian, at.residual, at.predicted)


def whitening_block(noise: NoiseCovariance, chosen: np.ndarray) -> np.ndarray:
    """The whitening matrix for some of the readings, by their indices."""
    return whitening_of(noise.covariance[np.ix_(chosen, chosen)])


def whitening_of_subset(noise: NoiseCovariance, chosen: np.ndarray) -> np.ndarray:
    """The same with zero rows and columns for the other readings; cached, as all fits share the days held out."""
    key = chosen.tobytes()
    if key not in noise.whitenings_of_parts:
        part = np.zeros_like(noise.covariance)
        part[np.ix_(chosen, chosen)] = whitening_block(noise, chosen)
        noise.whitenings_of_parts[key] = part
    return noise.whitenings_of_parts[key]
