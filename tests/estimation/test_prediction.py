import json
from dataclasses import replace

import numpy as np
import pytest
from systems import scipy_field_and_sensitivity_of_cubics

import wallid
from wallid.case.initial_profile import dimensionless_profile
from wallid.inference.weighted_least_squares import paper_sigma


@pytest.fixture(scope="module")
def case():
    case = wallid.load("saint_julien")
    return replace(case, record=case.record.window(0, 24 * 20))


@pytest.fixture(scope="module")
def fit(case):
    return wallid.estimate(case, wallid.Window(100, 72), wallid.full_order_model(case))


@pytest.fixture(scope="module")
def found(case, fit):
    return wallid.predict(case, fit)


def by_scipy(case, alpha, outputs):
    scale = wallid.case.scales(case)
    system = wallid.models.finite_volume_model(case.wall, outputs, nodes=case.choices.nodes)
    initial = dimensionless_profile(wallid.case.fit_profile(case, 0).coefficients, scale)
    fourier, record = scale.fourier_number(alpha), case.record
    u, _ = scipy_field_and_sensitivity_of_cubics(system, fourier, record, 0, record.rows, scale, initial)
    return u, scale


def test_the_whole_record_is_predicted_with_prior_and_estimate(case, fit, found):
    sensors = [wallid.models.Output(sensor.position) for sensor in case.sensors]
    for alpha, have in ((2.8e-7, found.predicted_with_prior), (fit.value, found.predicted)):
        u, scale = by_scipy(case, alpha, sensors)
        np.testing.assert_allclose(have, scale.temperature_min + scale.temperature * u, atol=1e-9)
    np.testing.assert_allclose(found.residual, case.record.sensors - found.predicted)


def test_estimate_beats_prior(found):
    for s in range(3):
        assert np.std(found.residual[:, s]) < 0.6 * np.std(found.residual_with_prior[:, s])


def test_flux_and_loads_at_the_inner_face(case, fit, found):
    """j = -k dT/dx at x = 0 (inside), E its integral, at fixed conductivity."""
    u, scale = by_scipy(case, fit.value, [wallid.models.Output(0.0, "flux")])
    flux = u[:, 0] * 1.75 * scale.temperature / case.wall.length
    # the first row holds the jump between face and profile, at the mesh's mercy
    assert np.isnan(found.loads.flux[0])
    np.testing.assert_allclose(found.loads.flux[1:], flux[1:], atol=1e-7)
    energy = np.trapezoid(flux[1:], dx=3600.0)
    assert found.loads.energy[2] == pytest.approx(energy, rel=1e-9)
    # warm inside, at x = 0: heat flows along +x, and the load is a loss
    assert energy > 0
    assert (
        found.loads.relative_change[2] == 0.0 and found.loads.relative_change[0] * found.loads.relative_change[-1] < 0
    )


def test_a_mirrored_wall_has_the_mirrored_load(case, fit, found):
    """Turned round, the flux along +x changes its sign and nothing else."""
    turned = replace(
        case,
        wall=replace(case.wall, outside="left"),
        sensors=tuple(replace(sensor, position=case.wall.length - sensor.position) for sensor in case.sensors),
        record=replace(case.record, faces=case.record.faces[:, ::-1].copy()),
    )
    again = wallid.predict(turned, fit)
    np.testing.assert_allclose(again.predicted, found.predicted, atol=1e-9)
    np.testing.assert_allclose(again.loads.energy, -found.loads.energy, rtol=1e-9)


def test_without_conductivity_it_says_what_to_do(case, fit):
    bare = wallid.predict(replace(case, wall=replace(case.wall, conductivity=None)), fit)
    assert bare.loads is None
    assert "conductivity" in str(bare)


def test_the_papers_sigma(case, fit, found):
    """sqrt(sigma_m^2 + (dT/dx delta_x)^2) with the model's own gradient."""
    u, scale = by_scipy(case, fit.value, [wallid.models.Output(0.23 - 1e-4), wallid.models.Output(0.23 + 1e-4)])
    gradient = (u[:, 1] - u[:, 0]) * scale.temperature / 2e-4
    want = np.sqrt(0.1**2 + (gradient * 0.02) ** 2)
    np.testing.assert_allclose(found.sigma[:, 1], want, rtol=1e-4)
    np.testing.assert_allclose(paper_sigma(np.array([0.3]), np.array([[2.0]]), np.array([0.2])), 0.5)


def test_offsets_of_the_estimate_are_in_the_prediction(case, fit, found):
    shifted = wallid.predict(case, replace(fit, offsets={"T2": (0.25, 0.01)}))
    np.testing.assert_allclose(
        shifted.predicted - found.predicted, np.tile([0.0, 0.25, 0.0], (case.record.rows, 1)), atol=1e-12
    )


def test_summaries_are_text(found):
    assert "T3" in str(found) and "kWh/m2" in str(found)


def test_a_prediction_as_text_dict_and_html(found):
    assert found.summary() == str(found)
    result = json.loads(json.dumps(found.to_dict()))
    assert list(result["sensors"]) == list(found.sensor_names)
    assert result["sensors"]["T2"]["rms"] == found.rms_of_sensor(1)[1]
    assert found._repr_html_().count("rms residual of") == len(found.sensor_names)
