import json
from dataclasses import replace

import numpy as np
import pytest
from systems import scipy_field_and_sensitivity_of_cubics

import wallid
from wallid.case.initial_profile import dimensionless_profile, profile_degree
from wallid.estimation import diffusivity
from wallid.models.window_inputs import full_order_model


@pytest.fixture(scope="module")
def case():
    """Three weeks of the twin, so that the SciPy loop is quick."""
    case = wallid.load("saint_julien")
    return replace(case, record=case.record.window(24 * 60, 24 * 21))


def window_by_scipy(case, row, rows, alpha, offset=0.0):
    """u and theta over a window by SciPy, from the profile fitted at its start.

    With an offset of the second sensor, its reading there is held against the truth that much less.
    """
    sensors = np.array(case.record.sensors)
    sensors[:, 1] -= offset
    case = replace(case, record=replace(case.record, sensors=sensors))
    scale = wallid.case.scales(case)
    outputs = [wallid.models.Output(sensor.position) for sensor in case.sensors]
    system = wallid.models.finite_volume_model(
        case.wall, outputs, nodes=case.choices.nodes, profile_degree=profile_degree(case)
    )
    initial = dimensionless_profile(wallid.case.fit_profile(case, row).coefficients, scale)
    return scipy_field_and_sensitivity_of_cubics(
        system, scale.fourier_number(alpha), case.record, row, rows, scale, initial
    )


def information_by_scipy(case, row, rows, alpha, offset_std=None):
    """The window's information on alpha from SciPy's theta and a full covariance matrix."""
    scale = wallid.case.scales(case)
    u, theta = window_by_scipy(case, row, rows, alpha)
    slope = theta * scale.temperature * scale.fourier_number(1.0)
    noise = np.array([sensor.noise_std for sensor in case.sensors])
    if offset_std is not None:
        # one kelvin of the second sensor's offset: it reads more, and the profile starts lower
        moved, _ = window_by_scipy(case, row, rows, alpha, offset=1.0)
        column = (moved - u) * scale.temperature + np.array([0.0, 1.0, 0.0])
        R = np.diag(np.tile(noise**2, rows)) + offset_std**2 * np.outer(column.ravel(), column.ravel())
        return slope.ravel() @ np.linalg.solve(R, slope.ravel())
    return np.sum((slope / noise) ** 2)


def test_information_against_scipy(case):
    found = wallid.design(case)
    for window in (0, 7, len(found.starts) - 1):
        want = information_by_scipy(case, int(found.starts[window]), found.rows, 2.8e-7)
        assert found.information[0, window] == pytest.approx(want, rel=1e-8)


def test_offsets_are_projected_out(case):
    one, two, three = case.sensors
    stated = replace(case, sensors=(one, replace(two, offset_std=0.4), three))
    found = wallid.design(stated)
    want = information_by_scipy(stated, int(found.starts[5]), found.rows, 2.8e-7, offset_std=0.4)
    assert found.information[0, 5] == pytest.approx(want, rel=1e-8)
    assert np.all(found.information < wallid.design(case).information)
    cut = wallid.design(stated, restart=False)
    assert cut.information[0, 0] == pytest.approx(found.information[0, 0], rel=1e-10)


def test_map_and_vmap_give_the_same_numbers(case):
    alphas = (2.8e-7, 1.06e-6)
    one = wallid.design(case, diffusivities=alphas, sweep="map")
    two = wallid.design(case, diffusivities=alphas, sweep="vmap")
    np.testing.assert_allclose(one.information, two.information, rtol=1e-12)
    assert one.information.shape == (2, len(one.starts))


def test_cut_theta_is_one_run_over_the_record(case):
    found = wallid.design(case, restart=False)
    system = wallid.full_order_model(case)
    _, theta = wallid.models.explicit(
        system, wallid.case.scales(case).fourier_number(2.8e-7), wallid.models.window_data(case)
    )
    slope = (
        np.asarray(theta) * wallid.case.scales(case).temperature * wallid.case.scales(case).fourier_number(1.0) / 0.1
    )
    row = int(found.starts[4])
    assert found.information[0, 4] == pytest.approx(np.sum(slope[row : row + found.rows] ** 2), rel=1e-10)
    # at the record's first window both are the same run
    assert found.information[0, 0] == pytest.approx(wallid.design(case).information[0, 0], rel=1e-10)


def test_every_start_and_any_length(case):
    found = wallid.design(case, window_days=2.5, every_rows=1)
    assert found.rows == 60
    np.testing.assert_array_equal(found.starts, np.arange(24 * 21 - 60 + 1))
    assert found.best.row == found.starts[np.argmax(found.information[0])]
    assert found.criterion.max() == 1.0


def test_information_grows_with_length(case):
    """More readings never tell less: the same start, longer windows."""
    first = [wallid.design(case, window_days=days).information[0, 0] for days in (1, 2, 4, 8)]
    assert np.all(np.diff(first) > 0)


def test_the_window_of_a_whole_record(case):
    found = wallid.design(wallid.load("validation"))
    assert found.best == wallid.Window(0, 2881)


def test_lengths_hold_criterion_and_cost(case):
    seen = []
    found = wallid.experiment_design.compare_lengths(
        case, [1.0, 3.0], lambda window: float(window.rows), progress=lambda text, share: seen.append((text, share))
    )
    assert seen[1:] == [("lengths: 1 d", 0.5), ("lengths: 3 d", 0.75), ("done", 1.0)]
    np.testing.assert_array_equal(found.seconds, [24.0, 72.0])
    assert found.criterion[1] == 1.0 and 0 < found.criterion[0] < 1
    four = wallid.experiment_design.compare_lengths(case, [1.0, 2.0, 3.0, 4.0], lambda window: float(window.rows))
    np.testing.assert_array_equal(four.seconds, [24.0, np.nan, 72.0, 96.0])  # nothing made up between
    assert str(four).count(" ms") == 3 and "nan" not in str(four)


def test_a_short_estimate_is_timed_many_times(monkeypatch, case):
    """Half a millisecond is what else a machine does in between: three runs told of that."""
    ran = []
    monkeypatch.setattr(diffusivity, "fit_weighted_least_squares", lambda *given: ran.append(given))
    assert 0 <= wallid.estimation.seconds_of_estimate(case, wallid.Window(0, 72), full_order_model(case)) < 0.1
    assert len(ran) == 31


def test_a_record_without_information_says_so(case):
    still = np.full_like(case.record.faces, 12.0)
    dead = replace(case, record=replace(case.record, faces=still, sensors=np.full_like(case.record.sensors, 12.0)))
    found = wallid.design(dead)
    assert not found.informative
    assert "no window of 72 rows has information" in str(found)


def test_the_expected_error_is_what_estimates_scatter_by(case):
    """Over noise seeds, the scatter of the paper's estimate against the design's expected standard error.

    The design counts the readings' own noise; what else the full covariance leaves free is not in it.
    """
    large = wallid.full_order_model(case)
    found = wallid.design(case, diffusivities=[1.06e-6])
    scale = wallid.case.scales(case)
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
        values.append(wallid.estimate(drawn, found.best, large, weights="none").value)
    expected = 1 / np.sqrt(found.information[0].max())
    assert np.std(values) == pytest.approx(expected, rel=0.3)


def test_wrong_windows_and_distances_are_named(case):
    for days in (1000.0, 0.01):
        with pytest.raises(wallid.InputError, match="window_days"):
            wallid.design(case, window_days=days)
    with pytest.raises(wallid.InputError, match="every_rows"):
        wallid.design(case, every_rows=0)
    np.testing.assert_array_equal(wallid.design(case, window_days=16.0, every_rows=100).starts, [0, 100])


def test_through_diffrax_the_same(case):
    short = replace(case, record=case.record.window(0, 24 * 6))
    one, two = (wallid.design(short, integrator=way) for way in ("propagator", "diffrax"))
    np.testing.assert_allclose(one.information, two.information, rtol=1e-10)


def test_a_design_as_text_dict_and_html(case):
    found = wallid.design(case)
    assert found.summary() == str(found)
    result = json.loads(json.dumps(found.to_dict()))
    assert (
        result["row"] == found.best.row
        and result["starts"][int(np.argmax(result["relative_criterion"]))] == found.best.row
    )
    assert result["expected_relative_std"] == found.expected_relative_std
    assert found.labels[0] in found._repr_html_()
