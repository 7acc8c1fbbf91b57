"""The filter's model of a fit: the same likelihood as the dense covariance."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.reference.analytic_slab import refined, temperatures, weather
from numpy.testing import assert_allclose
from scipy.stats import multivariate_normal

import wallid
from wallid.case.options import Choices
from wallid.case.time_window import entire_record
from wallid.inference.disturbance_covariance import HEAT_PROFILES
from wallid.inference.disturbance_search import Disturbance
from wallid.inference.filter_model import filter_model, readings_at
from wallid.inference.generalised_least_squares import fit_generalised_least_squares
from wallid.inference.likelihood import predicted_jacobian
from wallid.models.flux_plates import full_order_model_with_plates
from wallid.models.window_inputs import window_data
from wallid.records.face_variation import FaceErrors

LENGTH, DIFFUSIVITY, STEP, ROWS = 0.3, 5e-7, 1800.0, 60


def fitted(monkeypatch, every=1, face_std=0.02, fill_std=None):
    """A fit of two sensors with offsets and missing readings, the faces known between their rows.

    `every`: rows from reading to reading. `fill_std`: of faces that were interpolated.
    """
    monkeypatch.setattr(wallid.Record, "face_errors", FaceErrors.none())
    rng = np.random.default_rng(4)
    faces = weather(4 * ROWS, STEP, rng, hours=(8.0, 2.0))
    fine = refined(faces, 10)
    inside = temperatures(fine, STEP / 10, np.array([0.3, 0.7]), DIFFUSIVITY / LENGTH**2)[::10][-ROWS:]
    inside = inside + 0.05 * rng.standard_normal(inside.shape)
    inside[rng.random(inside.shape) < 0.2] = np.nan
    inside[np.arange(ROWS) % every != 0] = np.nan
    time = STEP * np.arange(ROWS)
    record = wallid.Record(
        time,
        time,
        None,
        faces[-ROWS:] + face_std * rng.standard_normal((ROWS, 2)),
        inside,
        ("A", "B"),
        boundary_noise_std=face_std,
        fill_std=fill_std,
    )
    sensors = tuple(
        wallid.Sensor(name, LENGTH * x, noise_std=0.05, offset_std=0.1) for name, x in (("A", 0.3), ("B", 0.7))
    )
    wall = wallid.Wall(length=LENGTH, diffusivity_prior=7e-7)
    case = wallid.Case(
        "slab",
        Path("case.toml"),
        wall,
        sensors,
        record,
        Choices(nodes=13, model="lom", noise="stated", window_days=1.0),
    )
    window = entire_record(case)
    data = window_data(case, window)
    return case, fit_generalised_least_squares(case, window, data, full_order_model_with_plates(case), 5e-7, eta=1e-9)


@pytest.mark.parametrize("smoothness", ["matern-1/2", "matern-3/2"])
@pytest.mark.parametrize("autocorrelated", [0.0, 0.7])
@pytest.mark.parametrize("profile", [0, 1, 4])
def test_the_filter_has_the_likelihood_of_the_dense_covariance(monkeypatch, smoothness, autocorrelated, profile):
    case, fit = fitted(monkeypatch)
    disturbance = Disturbance(
        HEAT_PROFILES[profile], 2.0, "K/day", 7200.0, smoothness, 0.0, 1.0, np.ones(len(fit.names))
    )
    readings = readings_at(case, fit)
    shape = fit.noise_shape
    by_heat = disturbance.std**2 * readings.covariance(HEAT_PROFILES[profile], 7200.0, smoothness, ROWS, 1)
    noise = shape.covariance_of(0.8, autocorrelated, 0.6, by_heat)
    fit = replace(fit, noise=noise, disturbance=disturbance)
    one = filter_model(case, entire_record(case), fit)
    filtered = one.filtered()
    assert float(filtered.log_likelihood) == pytest.approx(of_dense(fit, one, noise.covariance), rel=1e-8)


def test_interpolated_faces_are_in_the_filter_too(monkeypatch):
    """Each gap is one error, in the dense covariance and as a state."""
    fill_std = np.zeros((ROWS, 2))
    fill_std[10:14, 0] = fill_std[40:50, 1] = 1.0
    case, fit = fitted(monkeypatch, fill_std=fill_std)
    noise = fit.noise_shape.covariance_of(0.8, 0.0, 0.0)
    one = filter_model(case, entire_record(case), replace(fit, noise=noise))
    without = fit.noise_shape.gap_errors
    assert len(without) == 2 and np.abs(without).max() > 0.1
    dense = of_dense(fit, one, noise.covariance)
    assert float(one.filtered().log_likelihood) == pytest.approx(dense, rel=1e-6)
    assert of_dense(fit, one, noise.covariance - without.T @ without) != pytest.approx(dense, rel=1e-3)


def of_dense(fit, one, covariance):
    """The log-likelihood by a dense covariance of all rows, the parameters' priors as covariance and mean."""
    J = np.asarray(predicted_jacobian(fit.problem, fit.minimum.vector))[:, :, fit.estimated_indices]
    J = J.transpose(1, 0, 2).reshape(-1, J.shape[2])
    prior = np.ones(J.shape[1])
    prior[0] = 3.0
    z = fit.z.copy()
    z[0] = 0.0
    kept = one.present.T.reshape(-1)
    covariance = covariance + (J * prior**2) @ J.T
    residual = one.readings.T.reshape(-1) + J @ z
    return multivariate_normal.logpdf(residual[kept], cov=covariance[np.ix_(kept, kept)])


def test_noise_remembers_the_hours_between_slow_readings(monkeypatch):
    """The correlation from reading to reading is 0.6 where sensors are read in every fourth row."""
    case, fit = fitted(monkeypatch, every=4, face_std=0.0)
    assert fit.noise_shape.rows_per_bin == 1 and fit.problem.bins.rows_per_bin == 4
    fit = replace(fit, noise=fit.noise_shape.covariance_of(0.8, 0.7, 0.6))
    one = filter_model(case, entire_record(case), fit)
    between = 0.6 ** (np.abs(np.subtract.outer(np.arange(ROWS), np.arange(ROWS))) / 4.0)
    covariance = 0.05**2 * (0.8 * np.eye(2 * ROWS) + 0.7 * np.kron(np.eye(2), between))
    assert float(one.filtered().log_likelihood) == pytest.approx(of_dense(fit, one, covariance), rel=1e-8)


@pytest.mark.parametrize("autocorrelated", [0.0, 0.7])
def test_the_filter_follows_the_thinned_covariance(monkeypatch, autocorrelated):
    """Slow readings beside faces with noise: thinned, their noise enters as that of its mean between two readings."""
    case, fit = fitted(monkeypatch, every=4, face_std=0.1)
    noise = fit.noise_shape.covariance_of(0.8, autocorrelated, 0.6)
    one = filter_model(case, entire_record(case), replace(fit, noise=noise))
    covariance = np.zeros((2, ROWS, 2, ROWS))
    covariance[:, ::4, :, ::4] = noise.covariance.reshape(2, ROWS // 4, 2, ROWS // 4)
    dense = of_dense(fit, one, covariance.reshape(2 * ROWS, 2 * ROWS))
    assert float(one.filtered().log_likelihood) == pytest.approx(dense, abs=0.5)


def test_the_smoothed_heat_is_the_conditional_mean(monkeypatch):
    """Against the dense covariance between heat and readings."""
    case, fit = fitted(monkeypatch)
    disturbance = Disturbance(HEAT_PROFILES[0], 2.0, "K/day", 7200.0, "matern-1/2", 0.0, 1.0, np.ones(len(fit.names)))
    readings = readings_at(case, fit)
    by_heat = disturbance.std**2 * readings.covariance(HEAT_PROFILES[0], 7200.0, "matern-1/2", ROWS, 1)
    fit = replace(fit, noise=fit.noise_shape.covariance_of(1.0, 0.0, 0.8, by_heat), disturbance=disturbance)
    course, std = filter_model(case, entire_record(case), fit).smoothed_heat()
    assert course.shape == std.shape == (ROWS,)
    assert np.all(std < 2.0 * np.sqrt(2.0) + 1e-9) and std.min() < 1.5
    step = readings.step_of(HEAT_PROFILES[0], 2.0, 7200.0, "matern-1/2")
    # covariance of the heat at row i with the readings at row j, by the steps
    n = len(np.asarray(step.transition))
    P, joint = np.asarray(step.initial), np.zeros((ROWS, n, ROWS, n))
    for j in range(ROWS):
        cross = P
        for i in range(j, ROWS):
            joint[i, :, j, :] = cross
            joint[j, :, i, :] = cross.T
            cross = np.asarray(step.transition) @ cross
        P = np.asarray(step.transition) @ P @ np.asarray(step.transition).T + np.asarray(step.noise)
    to_readings = np.einsum("isjt,ot->isoj", joint, np.asarray(step.C))[:, n - 1].reshape(ROWS, -1) / readings.unit_rate
    to_readings = to_readings + 2.0**2 * readings.of_constant_heat(HEAT_PROFILES[0], ROWS).T.reshape(-1)
    one = filter_model(case, entire_record(case), fit)
    J = np.asarray(predicted_jacobian(fit.problem, fit.minimum.vector))[:, :, fit.estimated_indices]
    J = J.transpose(1, 0, 2).reshape(-1, J.shape[2])
    prior = np.ones(J.shape[1])
    prior[0] = 3.0
    z = fit.z.copy()
    z[0] = 0.0
    kept = one.present.T.reshape(-1)
    cov = (fit.noise.covariance + (J * prior**2) @ J.T)[np.ix_(kept, kept)]
    residual = (one.readings.T.reshape(-1) + J @ z)[kept]
    assert_allclose(course, to_readings[:, kept] @ np.linalg.solve(cov, residual), atol=1e-7)
