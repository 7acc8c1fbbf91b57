"""The shape of what no known effect explains: heat in the wall, as the residual of a diagnosis shows it.

The disturbance of an estimate is searched in the residual of the final model, all its parameters integrated out, and
smoothed. No daily kernel is used: it would take the daily course of the sun for noise.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from ..case.time_window import diagnosis_window
from ..estimation.unknown_heat import UnknownHeat, unknown_heat_of
from ..inference.disturbance_covariance import disturbed_readings
from ..inference.disturbance_search import RestrictedLikelihood, find_disturbance
from ..inference.filter_model import FittedReadings, filter_model_of
from ..inference.noise_covariance import BinnedReadings
from ..models.flux_plates import with_filtered_faces, with_flux
from ..models.window_inputs import window_data
from .effect_fit import EffectFit
from .model_with_effects import linearise

_MAX_READINGS = 480  # of the search, as in an estimate
_WIDE = 10.0  # typical sizes: the prior of a parameter that has none


def unexplained_heat(fit: EffectFit) -> UnknownHeat | None:
    """The heat that would explain the residual of a diagnosis; None where the readings are too few.

    Args:
        fit: the final model of the diagnosis.
    """
    problem, parameters = fit.problem, fit.parameters
    case, window = problem.case, diagnosis_window(problem.case)
    if problem.bins.nonempty <= 2 * len(parameters.estimated_names):
        return None
    mask = np.asarray(parameters.estimated)
    stated = np.asarray(parameters.prior_std)[mask]
    wide = _WIDE * np.asarray(parameters.scale)[mask]
    unit = np.where(np.isfinite(stated) & (stated > 0), stated, wide)
    unit[0] = 1.0
    deviation = np.where(np.isfinite(stated), np.asarray(parameters.values)[mask] / unit, 0.0)
    deviation[0] = 0.0
    data = with_filtered_faces(case, window, with_flux(case, window, window_data(case, window)))
    terms = problem.model.terms(parameters, linear=True)
    disturbed = partial(
        disturbed_readings, case, data, fit.diffusivity,
        conductance=float(terms.conductivity) / case.wall.length, contacts=tuple(terms.film_lengths.tolist()),
    )  # fmt: skip
    readings = disturbed(spacing=problem.spacing)
    factor = -(-problem.bins.readings // _MAX_READINGS)
    coarse = BinnedReadings(problem.bins.observed, problem.bins.present, problem.bins.rows_per_bin * factor)
    shape = problem.noise_shape(parameters, coarse)
    fine = problem.noise_shape(parameters)
    binned = shape.bins.in_coarser_bins(fine.bins)
    jacobian, residual = fit.unwhitened()
    likelihood = RestrictedLikelihood(
        shape.counts.T.reshape(-1) > 0, binned(residual), binned((jacobian * unit).T).T, deviation
    )
    step = problem.record.step * problem.spacing
    without = None if readings.in_flux else fit.noise  # as in an estimate
    found = find_disturbance(readings, shape, step, likelihood, without)
    rows = BinnedReadings(problem.bins.observed, problem.bins.present, 1)
    names, linear = parameters.estimated_names, problem.is_linear(fit.active)
    _, slopes = linearise(problem.model, rows, parameters, names, linear=linear)
    count, instruments = rows.observed.shape
    prior_std = np.ones(len(unit))
    prior_std[0] = _WIDE
    fitted = FittedReadings(
        shape=fine,
        white=found.noise_size,
        autocorrelated=0.0,
        correlation=0.0,
        disturbance=found,
        residual=fit.residual_at_rows,
        present=np.isfinite(problem.readings),
        jacobian=(np.asarray(slopes).T * unit).reshape(instruments, count, -1).transpose(1, 0, 2),
        prior_std=prior_std,
        deviation=deviation,
    )
    course, std = filter_model_of(fitted, disturbed()).smoothed_heat()
    return unknown_heat_of(case, window, found, course, std)
