"""The fits of one diagnosis: of the plain model, with candidates added, and without one of its effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...inference.likelihood import LOG_DIFFUSIVITY
from ...inference.noise_covariance import NoiseCovariance
from ...inference.noise_memory import memory_of_noise
from ...inference.whittle_likelihood import MIN_READINGS, estimate_noise
from ...models.flux_plates import fluxes_of
from ..effect_fit import EffectFit, refit
from ..problem import DiagnosisProblem, EffectParameters
from ..residual_tests import ResidualTests, omnibus_directions, run_residual_tests
from .acceptance import reason_for_refusal
from .effect_results import Trial
from .score_test import CandidateJacobian, CandidateScores, candidate_jacobian, jacobian_of_effects, score_candidates

_MODEL_ERROR = 1e-3  # share of the gain of an effect that its discretisation may leave in the residual: 3 % of its size
_FAR_FROM_PRIOR = 1.0  # of ln(alpha) from the prior, from which fits also start at the prior
_MOST_ITERATIONS = 4  # of the plain estimate, and of the pattern of a section
_CONVERGED = 0.05  # standard errors of ln(alpha) by which the last iteration of the plain estimate may change it


def plain_model_of(problem: DiagnosisProblem) -> tuple[CandidateFits, EffectFit]:
    """The fits of a problem, and its plain model fitted.

    Beside plates the faces are filtered for the noise that a first fit shows (`memory_of_noise`). The pattern of a
    section is computed at the diffusivity that is found.
    """
    fits = CandidateFits(problem)
    plain = fits.fit_plain_model()
    if fluxes_of(problem.case):
        shape = problem.noise_shape(plain.parameters)
        memory = memory_of_noise(shape, plain.residual_at_rows, problem.sensor_count, problem.record.step)
        if memory != problem.case.record.noise_memory:
            problem = problem.with_noise_memory(memory)
            fits = CandidateFits(problem)
            plain = fits.fit_plain_model()
    for _ in range(_MOST_ITERATIONS if problem.has_pattern else 0):
        fits = CandidateFits(problem.with_pattern_at(plain.diffusivity))
        last, plain = plain, fits.fit_plain_model()
        if abs(np.log(plain.diffusivity / last.diffusivity)) < _CONVERGED * plain.log_std:
            break
    return fits, plain


class CandidateFits:
    """The fits of one diagnosis problem that the selection compares.

    Args:
        problem: the case prepared for the search.

    `trials` has every fit with candidates added, in the order of the fits.
    """

    def __init__(self, problem: DiagnosisProblem):
        self.problem = problem
        self.random = np.random.default_rng(problem.case.choices.seed)
        self.trials: list[Trial] = []
        self._jacobians: dict[frozenset[EffectParameters], CandidateJacobian] = {}
        self._reduced_fits: dict[tuple[frozenset[EffectParameters], NoiseCovariance], EffectFit] = {}

    def fit_plain_model(self) -> EffectFit:
        """Fit the plain model, with the noise estimated beside the entire library."""
        problem = self.problem
        stated = problem.noise_shape(problem.parameters).stated_covariance()
        return self.refit_with_estimated_noise(refit(problem, (), problem.parameters, stated))

    def plain_estimate(self, plain: EffectFit) -> EffectFit:
        """The plain model as `wallid.estimate` fits it: with the noise estimated from its own residual.

        Where an effect is missing, this noise contains its trace, and that of the search does not.
        """
        fit = plain
        for _ in range(_MOST_ITERATIONS):
            jacobian, residual = fit.unwhitened()
            shape = self.problem.noise_shape(fit.parameters)
            if self.problem.bins.nonempty - jacobian.shape[1] >= MIN_READINGS:
                noise = estimate_noise(shape, residual, jacobian.T, fit.sensitivity)
            else:
                noise = shape.stated_covariance()
            last, fit = fit, refit(self.problem, (), fit.parameters, noise)
            if abs(np.log(fit.diffusivity / last.diffusivity)) < _CONVERGED * fit.log_std:
                break
        return fit

    def refit_with_estimated_noise(self, fit: EffectFit) -> EffectFit:
        """Fit the same model again, with the noise estimated orthogonally to the library and the omnibus directions.

        Where these leave too few readings, the noise is as stated.
        """
        problem = self.problem
        jacobian, residual = fit.unwhitened()
        directions = np.concatenate([self.candidate_jacobian(fit).columns, jacobian.T, *omnibus_directions(fit)])
        shape = problem.noise_shape(fit.parameters)
        noise = estimate_noise(shape, residual, directions)
        noise = noise if noise.degrees_of_freedom >= MIN_READINGS else shape.stated_covariance()
        return refit(problem, fit.active, fit.parameters, noise)

    def plain_model_with_noise_of(self, fit: EffectFit) -> EffectFit:
        """The plain model fitted with the noise of a fit with effects."""
        while fit.active:
            fit = self.without(fit, fit.active[-1])
        return fit

    def score_candidates(self, fit: EffectFit) -> CandidateScores:
        """The score test of the entire library against a fit."""
        return score_candidates(fit, self.candidate_jacobian(fit), self.random)

    def score_effects(
        self, fit: EffectFit, effects: Sequence[EffectParameters], known: Mapping[str, float]
    ) -> CandidateScores:
        """The score test of some effects against a fit.

        Args:
            fit: the base.
            effects: those that are not in it.
            known: their known positions, hours and temperatures by name; the others are scanned.
        """
        return score_candidates(fit, jacobian_of_effects(self.problem, fit, effects, known), self.random)

    def candidate_jacobian(self, fit: EffectFit) -> CandidateJacobian:
        """The derivatives of the library, computed once for each set of effects: they hardly change between fits."""
        effects = frozenset(fit.active)
        if effects not in self._jacobians:
            self._jacobians[effects] = candidate_jacobian(self.problem, fit)
        return self._jacobians[effects]

    def residual_tests(self, fit: EffectFit) -> ResidualTests:
        """The tests of the residual of a fit, with an allowance for the model error of its effects."""
        return run_residual_tests(fit, self.model_error_allowance(fit))

    def model_error_allowance(self, fit: EffectFit) -> float:
        """The part of `-2 log L` that the discretisation of the effects in a fit may leave in the residual."""
        return _MODEL_ERROR * max(self.plain_model_with_noise_of(fit).cost - fit.cost, 0.0)

    def without(self, fit: EffectFit, effect_parameters: EffectParameters) -> EffectFit:
        """A fit without one of its effects, with the same noise; computed once."""
        active = tuple(other for other in fit.active if other is not effect_parameters)
        key = (frozenset(active), fit.noise)
        if key not in self._reduced_fits:
            parameters = fit.parameters.with_values({effect_parameters.names[0]: 0.0})
            self._reduced_fits[key] = refit(self.problem, active, parameters, fit.noise)
        return self._reduced_fits[key]

    def add_candidates(self, scores: CandidateScores, chosen: tuple[int, ...]) -> EffectFit:
        """Fit the base of a score test with some of its candidates, starting from the linear prediction."""
        base, problem = scores.base, self.problem
        parameters = base.parameters
        for k in chosen:
            parameters = parameters.with_values(scores.candidates[k].scan_values)
        active = (*base.active, *(scores.effect(k) for k in chosen))
        sizes, shifts = scores.joint_prediction(chosen)
        step = shifts | {scores.effect(k).names[0]: size for k, size in zip(chosen, sizes.tolist(), strict=True)}
        for error, effect_parameters in problem.replaced_errors(active).items():
            if effect_parameters not in base.active:
                step[effect_parameters.names[0]] += problem.taken_over(error, shifts.get(error, 0.0))
        fits = [refit(problem, active, parameters, base.noise, step=step)]
        starts = [] if fits[0].cost < base.cost else [parameters]  # the linear prediction may be too far off
        if abs(base.parameters[LOG_DIFFUSIVITY]) > _FAR_FROM_PRIOR:  # and so may the base be
            effect_values = {name: float(parameters[name]) for one in active for name in one.names}
            starts.append(problem.parameters.with_values(effect_values))
        fits += [refit(problem, active, start, base.noise) for start in starts]
        fit = min(fits, key=lambda fit: fit.cost)
        self.trials.append(Trial(base, fit, scores.joint_gain(chosen)))
        return fit

    def set_reason(self, fit: EffectFit, reason: str) -> None:
        """Note in the trial of a fit why it is rejected."""
        for trial in self.trials:
            if trial.fit is fit:
                trial.reason = reason

    def acceptable(self, fit: EffectFit) -> bool:
        """Whether a fit is accepted; notes the reason in its trial where it is not."""
        reason = reason_for_refusal(fit)
        self.set_reason(fit, reason)
        return not reason
