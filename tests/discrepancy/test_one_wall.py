"""One wall: the estimate and the diagnosis have the same plain model, the same noise, and the same diffusivity."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from studies import SPEC, parameters_at, prepare

import wallid
from wallid.case.time_window import diagnosis_window
from wallid.discrepancy.model_with_effects import face_impulse_response, predict
from wallid.discrepancy.problem import diagnosis_problem
from wallid.discrepancy.selection.candidate_fits import CandidateFits
from wallid.estimation.diffusivity import estimate_by_gls
from wallid.inference.likelihood import face_response
from wallid.models.window_inputs import full_order_model, window_data

NOISY = replace(SPEC, step=3600.0, days=8.0, noise_std=0.05, boundary_noise_std=0.05)
SUN = (("solar_gain", "left", {"gain": 3e-3}),)
LAYERS = (wallid.Layer(0.07, 0.8, 1.6e6), wallid.Layer(0.05, 0.2, 0.9e6), wallid.Layer(0.08, 1.2, 1.9e6))


def plain_case(folder, *, layered, spec=NOISY, **changes):
    """A simulated record with offsets as nuisance parameters; the wall stated as homogeneous or of three layers."""
    case = prepare(folder, spec)[0].case
    wall = replace(case.wall, layers=LAYERS) if layered else case.wall
    return replace(case, wall=wall, sensors=tuple(replace(one, offset_std=0.1, **changes) for one in case.sensors))


@pytest.fixture(scope="module", params=[False, True], ids=["homogeneous", "layered"])
def both(request, tmp_path_factory):
    """The fit of an estimate, and the problem of a diagnosis of the same rows."""
    case = plain_case(tmp_path_factory.mktemp("one"), layered=request.param, position_std=0.0)
    window = diagnosis_window(case)
    alpha, eta = case.wall.diffusivity_prior, case.choices.eta
    return estimate_by_gls(case, window, full_order_model(case), alpha, eta)[1].problem, diagnosis_problem(case)


@given(seed=st.integers(0, 10**6))
@settings(max_examples=20)
def test_the_plain_models_are_the_same_at_any_parameters(both, seed):
    likelihood, problem = both
    draw = np.random.default_rng(seed)
    z = draw.standard_normal(len(likelihood.parameters))
    z[likelihood.parameters.index("log_diffusivity")] *= 0.3
    z = jnp.asarray(z)
    named = likelihood.to_parameters(z).to_dict()
    parameters = problem.parameters.with_values(named)
    assert set(named) <= set(parameters.names)
    assert_allclose(predict(problem.model, parameters, True), likelihood.predicted(z), rtol=0, atol=1e-9)


def test_the_parameters_and_their_priors_are_the_same(both):
    likelihood, problem = both
    for name, std in zip(likelihood.parameters.names, np.asarray(likelihood.parameters.prior_std), strict=True):
        assert float(problem.parameters.prior_std[problem.parameters.index(name)]) == std


def test_the_responses_to_the_faces_are_the_same(both):
    likelihood, problem = both
    alpha = problem.case.wall.diffusivity_prior
    data = window_data(problem.case, diagnosis_window(problem.case))
    fourier = likelihood.fourier_per_alpha * alpha
    want = face_response(likelihood.system, fourier, data.step, problem.record.rows)
    got = face_impulse_response(problem.model, parameters_at(problem, alpha))
    assert_allclose(got[:, :-1], want[:, :-1], rtol=0, atol=1e-12)


@pytest.mark.parametrize("effects", [(), SUN], ids=["nothing hidden", "sun hidden"])
@pytest.mark.parametrize("noise", ["white", pytest.param("ar09", marks=pytest.mark.slow)])
def test_the_plain_diffusivity_is_the_same_to_a_tenth_of_its_standard_error(tmp_path, effects, noise):
    case = plain_case(tmp_path, layered=False, spec=replace(NOISY, effects=effects, noise=noise))
    found = wallid.estimate(case, diagnosis_window(case))
    fits = CandidateFits(diagnosis_problem(case))
    plain = fits.plain_estimate(fits.fit_plain_model())
    relative_std = found.std / found.value
    assert abs(np.log(plain.diffusivity / found.value)) < 0.1 * relative_std
    assert plain.log_std == pytest.approx(relative_std, rel=0.05)
    if found.interval_kind == "normal":  # the other kind is the profile likelihood's, which need not be symmetric
        assert_allclose(np.log(np.array(plain.interval_95) / found.interval_95), 0, atol=0.2 * relative_std)


def test_the_diagnosis_reports_the_plain_estimate_where_nothing_is_missing(tmp_path):
    case = plain_case(tmp_path, layered=False)
    found = wallid.diagnose(case)
    assert found.verdict == "adequate" and found.final is found.plain
    alone = wallid.estimate(case, diagnosis_window(case))
    assert abs(np.log(found.to_dict()["diffusivity"]["value"] / alone.value)) < 0.1 * alone.std / alone.value
