"""Heat in the wall that explains what no known effect does, as the residual of a diagnosis shows it.

The disturbance of an estimate is searched in the residual of the final model, all its parameters integrated out. Its
evidence is that over autocorrelated noise, so that memory alone is not taken for heat. Its course is smoothed. No daily
kernel is used: it would take the daily course of the sun for noise.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..case.time_window import Window, diagnosis_window
from ..estimation.unknown_heat import UnknownHeat, unknown_heat_of
from ..inference.disturbance_covariance import DisturbedReadings, disturbed_readings
from ..inference.disturbance_search import Disturbance, RestrictedLikelihood, find_disturbance, search_bins
from ..inference.filter_model import FittedReadings, filter_model_of
from ..inference.noise_covariance import BinnedReadings
from ..inference.noise_of_record import courses_of_face_errors
from ..models.flux_plates import face_noise_of_model, with_filtered_faces, with_flux
from ..models.window_inputs import window_data
from .effect_fit import EffectFit, refit
from .model_with_effects import linearise

CLEAR_EVIDENCE = 50.0
"""Of -2 log L: records without heat have less than 3, with gusty faces at hourly rows up to 23."""
_WIDE = 10.0  # typical sizes: the prior of a parameter that has none


class UnexplainedHeat:
    """The heat that would explain the residual of a diagnosis.

    Args:
        fit: the final model of the diagnosis.
        allowance: the part of `-2 log L` that the discretisation of its effects may leave in the residual.

    Attributes:
        disturbance: where it is, how large and with which memory; None where the readings are too few.
    """

    def __init__(self, fit: EffectFit, allowance: float = 0.0):
        self.fit, self.allowance = fit, allowance
        problem, parameters = fit.problem, fit.parameters
        mask = np.asarray(parameters.estimated)
        stated = np.asarray(parameters.prior_std)[mask]
        wide = _WIDE * np.asarray(parameters.scale)[mask]
        self._unit = np.where(np.isfinite(stated) & (stated > 0), stated, wide)
        self._unit[0] = 1.0
        self._deviation = np.where(np.isfinite(stated), np.asarray(parameters.values)[mask] / self._unit, 0.0)
        self._deviation[0] = 0.0
        few = problem.bins.nonempty <= 2 * len(parameters.estimated_names)
        self.disturbance: Disturbance | None = None if few else self._search()

    @property
    def _window(self) -> Window:
        return diagnosis_window(self.fit.problem.case)

    def _disturbed(self, spacing: int) -> DisturbedReadings:
        """How heat changes the readings at every `spacing`-th row."""
        case, window = self.fit.problem.case, self._window
        model = self.fit.problem.model
        terms = model.terms(self.fit.parameters, linear=True)
        return disturbed_readings(
            case, with_filtered_faces(case, window, with_flux(case, window, window_data(case, window))),
            self.fit.diffusivity, conductance=float(terms.conductivity) / case.wall.length,
            contacts=tuple(terms.film_lengths.tolist()), spacing=spacing,
            gains=np.asarray(terms.plate_gain)[list(model.forcing.plates)],
        )  # fmt: skip

    @cached_property
    def _readings(self) -> DisturbedReadings:
        """How heat changes the readings, at the rows with readings."""
        return self._disturbed(self.fit.problem.spacing)

    def _search(self) -> Disturbance:
        problem, parameters = self.fit.problem, self.fit.parameters
        shape = problem.noise_shape(parameters, search_bins(problem.bins))
        jacobian, residual = self.fit.unwhitened()
        likelihood = RestrictedLikelihood.of_coarser_bins(
            shape, problem.noise_shape(parameters).bins, residual, jacobian * self._unit, self._deviation
        )
        step = problem.record.step * problem.spacing
        memory = problem.case.record.noise_memory
        return find_disturbance(self._readings, shape, step, likelihood, self.fit.noise, memory)

    @property
    def is_clear(self) -> bool:
        """Whether heat explains the residual far better than noise with a memory does."""
        return self.disturbance is not None and self.disturbance.evidence > CLEAR_EVIDENCE + self.allowance

    @cached_property
    def fit_beside(self) -> EffectFit:
        """The same model fitted beside the heat: its covariance takes the place of the autocorrelated noise."""
        assert self.disturbance is not None
        problem, parameters = self.fit.problem, self.fit.parameters
        degrees = float(problem.bins.nonempty - len(parameters.estimated_names))
        noise = self.disturbance.noise_beside(problem.noise_shape(parameters), self._readings, degrees)
        return refit(problem, self.fit.active, parameters, noise)

    def course(self) -> UnknownHeat:
        """Its course, given all readings."""
        assert self.disturbance is not None
        problem, parameters = self.fit.problem, self.fit.parameters
        rows = BinnedReadings(problem.bins.observed, problem.bins.present, 1)
        names, linear = parameters.estimated_names, problem.is_linear(self.fit.active)
        _, slopes = linearise(problem.model, rows, parameters, names, linear=linear)
        count, instruments = rows.observed.shape
        prior_std = np.ones(len(self._unit))
        prior_std[0] = _WIDE
        face_noise, face_errors = face_noise_of_model(problem.case)
        responses = problem.responses_to_face_errors(parameters)
        white, autocorrelated = self.disturbance.noise_variances
        correlation = self.disturbance.noise_memory.correlation
        fitted = FittedReadings(
            sensor_std=problem.noise_stds,
            face_courses=courses_of_face_errors(problem.record, responses.impulse, face_errors, responses.shared),
            face_noise=face_noise.limited(white, autocorrelated, correlation),
            face_errors=face_errors.autocovariance,
            spacing=problem.spacing,
            white=white,
            autocorrelated=autocorrelated,
            correlation=correlation,
            disturbance=self.disturbance,
            residual=self.fit.residual_at_rows,
            present=np.isfinite(problem.readings),
            jacobian=(np.asarray(slopes).T * self._unit).reshape(instruments, count, -1).transpose(1, 0, 2),
            prior_std=prior_std,
            deviation=self._deviation,
        )
        course, std = filter_model_of(fitted, self._disturbed(1)).smoothed_heat()
        return unknown_heat_of(problem.case, self._window, self.disturbance, course, std)
