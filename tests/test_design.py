from dataclasses import replace

import numpy as np
import pytest
from systems import scipy_field_and_sensitivity

import wallid
from wallid.experiment import dimensionless_profile, profile_degree


@pytest.fixture(scope="module")
def case():
    """Three weeks of the twin, so that the SciPy loop is quick."""
    case = wallid.load("saint_julien")
    return replace(case, record=case.record.window(24 * 60, 24 * 21))


def window_by_scipy(case, row, rows, alpha):
    """u and theta over a window by `lsim`, from the profile fitted at its start."""
    scale = wallid.scales(case)
    outputs = [wallid.Output(sensor.position) for sensor in case.sensors]
    system = wallid.lom(case.wall, outputs, nodes=case.choices.nodes, profile_degree=profile_degree(case))
    part = case.record.window(row, rows)
    initial = dimensionless_profile(wallid.fit_profile(case, row).coefficients, scale)
    inputs = (part.faces - scale.temperature_min) / scale.temperature
    return scipy_field_and_sensitivity(system, scale.fourier(alpha), part.time / 86400.0, inputs, initial)


def information_by_scipy(case, row, rows, alpha, offset_std=None):
    """The window's information on alpha from `lsim`'s theta and a full covariance matrix."""
    scale = wallid.scales(case)
    _, theta = window_by_scipy(case, row, rows, alpha)
    slope = theta * scale.temperature * scale.fourier(1.0)
    total = 0.0
    for s, sensor in enumerate(case.sensors):
        R = sensor.noise_std**2 * np.eye(rows) + (offset_std or 0.0) ** 2
        total += slope[:, s] @ np.linalg.solve(R, slope[:, s])
    return total


def test_information_against_scipy(case):
    found = wallid.design(case)
    for window in (0, 7, len(found.starts) - 1):
        want = information_by_scipy(case, int(found.starts[window]), found.rows, 2.8e-7)
        assert found.information[0, window] == pytest.approx(want, rel=1e-8)


def test_offsets_are_projected_out(case):
    stated = replace(case, sensors=tuple(replace(sensor, offset_std=0.4) for sensor in case.sensors))
    found = wallid.design(stated)
    want = information_by_scipy(stated, int(found.starts[5]), found.rows, 2.8e-7, offset_std=0.4)
    assert found.information[0, 5] == pytest.approx(want, rel=1e-8)
    assert np.all(found.information < wallid.design(case).information)


def test_map_and_vmap_give_the_same_numbers(case):
    alphas = (2.8e-7, 1.06e-6)
    one = wallid.design(case, diffusivities=alphas, sweep="map")
    two = wallid.design(case, diffusivities=alphas, sweep="vmap")
    np.testing.assert_allclose(one.information, two.information, rtol=1e-12)
    assert one.information.shape == (2, len(one.starts))


def test_cut_theta_is_one_run_over_the_record(case):
    found = wallid.design(case, restart=False)
    system = wallid.large_model(case)
    _, theta = wallid.explicit(system, wallid.scales(case).fourier(2.8e-7), wallid.experiment(case))
    slope = np.asarray(theta) * wallid.scales(case).temperature * wallid.scales(case).fourier(1.0) / 0.1
    row = int(found.starts[4])
    assert found.information[0, 4] == pytest.approx(np.sum(slope[row : row + found.rows] ** 2), rel=1e-10)
    # at the record's first window both are the same run
    assert found.information[0, 0] == pytest.approx(wallid.design(case).information[0, 0], rel=1e-10)


def test_every_start_and_any_length(case):
    found = wallid.design(case, window_days=2.5, every_rows=1)
    assert found.rows == 60
    np.testing.assert_array_equal(found.starts, np.arange(24 * 21 - 60 + 1))
    assert found.best.row == found.starts[np.argmax(found.information[0])]
    assert found.criterion.max() == 1.0 and found.best.criterion == 1.0


def test_information_grows_with_length(case):
    """More readings never tell less: the same start, longer windows."""
    first = [wallid.design(case, window_days=days).information[0, 0] for days in (1, 2, 4, 8)]
    assert np.all(np.diff(first) > 0)


def test_the_window_of_a_whole_record(case):
    found = wallid.design(wallid.load("validation"))
    assert found.best == wallid.Window(0, 2881, 1.0)


def test_lengths_hold_criterion_and_cost(case):
    seen = []
    found = wallid.lengths(case, [1.0, 3.0], lambda window: float(window.rows), on_length=seen.append)
    assert seen == [1.0, 3.0]
    np.testing.assert_array_equal(found.seconds, [24.0, 72.0])
    assert found.criterion[1] == 1.0 and 0 < found.criterion[0] < 1


def test_a_record_without_information_says_so(case):
    still = np.full_like(case.record.faces, 12.0)
    dead = replace(case, record=replace(case.record, faces=still, sensors=np.full_like(case.record.sensors, 12.0)))
    found = wallid.design(dead)
    assert not found.informative
    assert "no window of 72 rows tells anything" in str(found)


def test_the_expected_error_is_what_estimates_scatter_by(case):
    """Over noise seeds, the scatter of the estimate against the design's expected standard error."""
    large = wallid.large_model(case)
    found = wallid.design(case, diffusivities=[1.06e-6])
    scale = wallid.scales(case)
    u, _ = window_by_scipy(case, found.best.row, found.rows, 1.06e-6)
    clean = scale.temperature_min + scale.temperature * u
    rng = np.random.default_rng(5)
    values = []
    for _ in range(60):
        sensors = np.array(case.record.sensors)
        rows = slice(found.best.row, found.best.row + found.rows)
        # the first row makes the profile: it stays, so that readings alone scatter
        noisy = clean + rng.normal(0, 0.1, clean.shape)
        noisy[0] = case.record.sensors[found.best.row]
        sensors[rows] = noisy
        drawn = replace(case, record=replace(case.record, sensors=sensors))
        values.append(wallid.estimate(drawn, found.best, large).value)
    expected = 1 / np.sqrt(found.information[0].max())
    assert np.std(values) == pytest.approx(expected, rel=0.3)
