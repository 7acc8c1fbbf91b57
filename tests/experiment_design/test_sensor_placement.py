"""Where a further sensor helps, D, A and E, robustness and sampling, against the sine series of an analytic slab."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.reference.analytic_slab import refined, temperatures, weather
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.linalg import block_diag, toeplitz

import wallid
from wallid.case.options import Choices
from wallid.experiment_design.fisher_information import criterion_value, relative_criterion
from wallid.inference.common_noise import wiener_filtered_noise

LENGTH, ALPHA, STEP, ROWS, MODES = 0.4, 7e-7, 3600.0, 72, 8
pytestmark = pytest.mark.usefixtures("faces_known_in_all_tests")

PARTS = 24  # of a row, between which the true faces are straight lines
THERE, CANDIDATES = (0.08, 0.31), (0.06, 0.15, 0.2, 0.25, 0.34)
NOISE, FACE, POSITION, OFFSET = 0.05, 0.08, 0.004, 0.06


def still_at_first(seed=4, symmetric=False):
    """Faces of a wall that starts in its steady state."""
    faces = weather(ROWS, STEP, np.random.default_rng(seed))
    faces[:, 1] = faces[:, 0] if symmetric else faces[:, 1]
    return faces


def case_of(faces, places=THERE, *, missing=()):
    x = np.array(places) / LENGTH
    readings = temperatures(refined(faces, PARTS), STEP / PARTS, x, ALPHA / LENGTH**2)[::PARTS]
    for row, sensor in missing:
        readings[row, sensor] = np.nan
    time, names = STEP * np.arange(len(faces)), tuple(f"T{s}" for s in range(len(places)))
    record = wallid.Record(time, time, None, faces, readings, names, boundary_noise_std=FACE)
    sensors = tuple(
        wallid.Sensor(name, place, noise_std=NOISE, position_std=POSITION, offset_std=OFFSET)
        for name, place in zip(names, places, strict=True)
    )
    wall = wallid.Wall(length=LENGTH, diffusivity_prior=ALPHA)
    choices = Choices(model="lom", nodes=101, initial_profile=1)  # at rest: a straight line, which is the truth
    return wallid.Case("slab", Path("slab.toml"), wall, sensors, record, choices)


@pytest.fixture(scope="module")
def case():
    return case_of(still_at_first(), missing=[(row, 1) for row in (5, 6, 30, 31, 32, 71)])


@pytest.fixture(scope="module")
def found(case):
    return wallid.place_sensors(case, candidates=CANDIDATES, count=2)


def truth(case, places, stride=1, alpha=ALPHA):
    """Derivatives, nuisances and covariance of the readings by finite differences of the sine series.

    Returns:
        h by ln(alpha), the constants' columns (offsets, then positions, sensor by sensor), the other nuisances', R, and
        what rarer faces make of the readings.
    """
    faces, x, rate = case.record.faces, np.array(places) / LENGTH, alpha / LENGTH**2
    at = np.arange(0, len(faces), stride)
    rare = refined(faces[at], PARTS, at)
    rare = np.pad(rare, ((0, (len(faces) - 1) * PARTS + 1 - len(rare)), (0, 0)), mode="edge")

    def field(x=x, rate=rate, faces=rare):
        return temperatures(faces, STEP / PARTS, x, rate)[::PARTS][at]

    h = (field(rate=rate * 1.0001) - field(rate=rate * 0.9999)) / 2e-4
    gradient = (field(x + 1e-5) - field(x - 1e-5)) / (2e-5 * LENGTH)
    n, t = np.arange(1, MODES + 1), STEP * at
    waves = np.exp(-np.outer(t, rate * (n * np.pi) ** 2))[:, None] * np.sin(np.pi * np.outer(x, n))
    inner = case.record.sensors
    everything = np.concatenate([faces.ravel(), inner[np.isfinite(inner)]])
    span = max(1.0, np.ptp(everything))
    shared = [np.sqrt(2) * span / n * waves]
    shared.append(
        np.repeat(np.stack([wiener_filtered_noise(f[at], FACE) for f in faces.T], axis=1)[:, None], len(x), axis=1)
    )
    shared = np.concatenate(shared, axis=2)
    R = NOISE**2 * np.eye(len(t) * len(x))
    for side in (0, 1):
        pulse = np.zeros((len(faces) + stride, 2))
        pulse[: 2 * stride + 1, side] = 1 - np.abs(np.arange(2 * stride + 1) - stride)[: len(pulse)] / stride
        answer = temperatures(pulse, STEP, x, rate)[stride::stride]
        G = np.concatenate([np.tril(toeplitz(answer[: len(t), s])) for s in range(len(x))])
        R += FACE**2 * G @ G.T
    own = [np.stack([np.full(len(t), OFFSET), POSITION * gradient[:, s]], axis=1) for s in range(len(x))]
    there = np.ones((len(t), len(x)), bool)
    there[:, : len(case.sensors)] = np.isfinite(inner[at])
    kept = there.T.ravel()
    apart = (field(faces=refined(faces, PARTS)) - field()).T.ravel()
    return (
        h.T.ravel()[kept], block_diag(*own)[kept], shared.transpose(1, 0, 2).reshape(len(kept), -1)[kept],
        R[np.ix_(kept, kept)], apart[kept],
    )  # fmt: skip


def truth_std(case, places, **options):
    h, own, shared, R, _ = truth(case, places, **options)
    V = R + own @ own.T + shared @ shared.T
    return 1 / np.sqrt(h @ np.linalg.solve(V, h))


def test_a_further_sensor_adds_what_its_readings_tell(case, found):
    """The expected standard error with and without it, by the readings' whole covariance."""
    assert found.std_before[0] == pytest.approx(truth_std(case, THERE), rel=3e-3)
    want = [truth_std(case, (*THERE, x)) for x in CANDIDATES]
    assert_allclose(found.std[0, 0], want, rtol=3e-3)
    assert found.best == CANDIDATES[int(np.argmin(want))]
    assert_allclose(found.criterion_gain[0], (found.std_before[0] / found.std[0, 0]) ** 2)


def test_the_next_one_is_placed_beside_the_first(case, found):
    want = [truth_std(case, (*THERE, found.chosen[0], x)) for x in CANDIDATES]
    assert_allclose(found.std[1, 0], want, rtol=3e-3)
    assert found.chosen[1] == CANDIDATES[int(np.argmin(want))]
    assert "a third sensor helps most" in str(found) and "a fourth sensor" in str(found)


def test_d_a_and_e_of_the_constants(case):
    h, own, shared, R, _ = truth(case, THERE)
    J = np.column_stack([h, own])
    M = J.T @ np.linalg.solve(R + shared @ shared.T, J) + np.diag([0.0, 1, 1, 1, 1])
    want = {
        "D": np.linalg.det(M) ** 0.2,
        "A": 5 / np.trace(np.linalg.inv(M)),
        "E": 1 / np.linalg.norm(np.linalg.inv(M), 2),
    }
    for kind, value in want.items():
        design = wallid.design(case, window_days=3, full=True, criterion=kind, of="constants")
        assert design.criterion_values[0, 0] == pytest.approx(value, rel=5e-3)
        assert design.expected_relative_std == pytest.approx(truth_std(case, THERE), rel=3e-3)


def test_with_one_parameter_they_are_one(case):
    found = [wallid.design(case, window_days=1, criterion=kind, full=True) for kind in "DAE"]
    for other in found[1:]:
        assert_allclose(other.criterion, found[0].criterion)
    assert "D, A and E agree" in str(found[0]) and "the full covariance" in str(found[0])


@pytest.mark.parametrize(("criterion", "of"), [("D", "all"), ("A", "constants"), ("E", "all")])
def test_a_sensor_never_tells_less(case, criterion, of):
    found = wallid.place_sensors(case, candidates=CANDIDATES, criterion=criterion, of=of)
    assert np.all(found.criterion_gain >= 1 - 1e-9) and np.all(found.std[0] <= found.std_before[:, None] * (1 + 1e-9))


def test_a_symmetric_wall_has_symmetric_places():
    case = case_of(still_at_first(symmetric=True), (0.2, 0.2001))
    found = wallid.place_sensors(case, candidates=(0.06, 0.15, 0.2, 0.25, 0.34))
    assert_allclose(found.std[0, 0], found.std[0, 0, ::-1], rtol=1e-3)  # the second sensor is 0.1 mm off


def test_robust_over_the_diffusivity(case):
    alphas = (ALPHA, ALPHA / 4, 4 * ALPHA)
    each = [wallid.place_sensors(case, candidates=CANDIDATES, diffusivities=[alpha]) for alpha in alphas]
    sizes = np.array([one.criterion_after[0, 0] for one in each])
    share = sizes / sizes.max(axis=1, keepdims=True)
    for robust, over in (("expected", np.exp(np.log(share).mean(axis=0))), ("worst", share.min(axis=0))):
        found = wallid.place_sensors(case, candidates=CANDIDATES, diffusivities=alphas, robust=robust)
        assert_allclose(found.relative_criterion(), over)
        assert found.best == CANDIDATES[int(np.argmax(over))]
    design = wallid.design(case, window_days=1, robust="worst")
    assert len(design.diffusivities) == 5 and design.diffusivities[0] == ALPHA
    assert_allclose(design.relative_criterion, design.criterion.min(axis=0) / design.criterion.min(axis=0).max())
    assert design.best.row == design.starts[np.argmax(design.relative_criterion)]


def test_a_rarer_row_tells_less(case):
    whole = case_of(still_at_first())
    found = wallid.experiment_design.compare_sampling_steps(whole, factors=(0.5, 1, 2, 3))
    assert_allclose(found.steps, [1800, 3600, 7200, 10800])
    for k, stride in ((1, 1), (2, 2), (3, 3)):
        assert found.std[k] == pytest.approx(truth_std(whole, THERE, stride=stride), rel=5e-3)
        h, own, shared, R, apart = truth(whole, THERE, stride)
        solved = np.linalg.solve(R + own @ own.T + shared @ shared.T, np.column_stack([h, apart]))
        moved = (h @ solved[:, 1]) / (h @ solved[:, 0])
        assert found.interpolation_bias[k] == pytest.approx(np.expm1(moved), rel=0.02, abs=1e-4)
    assert np.all(np.diff(found.std) > 0), "every reading tells something"
    assert "<- the record's" in str(found).splitlines()[2]


@settings(max_examples=50)
@given(st.integers(0, 10**6), st.integers(2, 6))
def test_means_of_eigenvalues(seed, count):
    """E <= A <= D, and D ranks the same whatever the parameters' units."""
    rng = np.random.default_rng(seed)
    one, two = (B @ B.T + 0.1 * np.eye(count) for B in rng.standard_normal((2, count, count)))
    assert criterion_value(one, "E") <= criterion_value(one, "A") * (1 + 1e-9) <= criterion_value(one, "D") * (1 + 2e-9)
    T = np.diag(np.exp(rng.uniform(-3, 3, count)))
    assert criterion_value(T @ one @ T, "D") / criterion_value(T @ two @ T, "D") == pytest.approx(
        criterion_value(one, "D") / criterion_value(two, "D")
    )


def test_nothing_told_is_no_information():
    assert criterion_value(np.diag([1.0, 0.0]), "D") == criterion_value(np.diag([1.0, 0.0]), "A") == 0.0
    assert_allclose(relative_criterion(np.zeros((2, 3)), "worst"), 0.0)


def test_choices_that_cannot_be_are_named(case):
    for message, call in (
        ("full", lambda: wallid.design(case, of="all")),
        ("restart", lambda: wallid.design(case, full=True, restart=False)),
        ("candidates", lambda: wallid.place_sensors(case, candidates=[0.5])),
        ("count", lambda: wallid.place_sensors(case, count=0)),
        ("diffusivities", lambda: wallid.place_sensors(case, diffusivities=[0.0])),
        ("factors", lambda: wallid.experiment_design.compare_sampling_steps(case, factors=[1.5, 0.3])),
        ("no .*sensor", lambda: wallid.place_sensors(replace_sensors(case))),
    ):
        with pytest.raises(wallid.InputError, match=message):
            call()


def replace_sensors(case):
    """The same record with a plate in place of the sensors."""
    record = replace(case.record, sensors=np.empty((ROWS, 0)), names=(), regressors={"flux_left": np.zeros(ROWS)})
    return replace(case, sensors=(), record=record)


def test_where_nothing_moves_no_sensor_helps():
    still = case_of(np.full((ROWS, 2), 15.0))
    assert "no additional sensor" in str(wallid.place_sensors(still, candidates=CANDIDATES))
    assert "no sampling step" in str(wallid.experiment_design.compare_sampling_steps(still, factors=(0.5, 1, 2, 3)))


def test_a_dead_sensor_tells_nothing(case):
    """As if it were not there."""
    dead = case_of(still_at_first(), missing=[(row, 1) for row in range(ROWS)])
    alone = case_of(still_at_first(), THERE[:1])
    found = wallid.place_sensors(dead, candidates=CANDIDATES[:4])
    assert_allclose(found.std, wallid.place_sensors(alone, candidates=CANDIDATES).std[:, :, :4], rtol=1e-6)


def test_longer_windows_in_full(case):
    """The same numbers as a design of each length has, from one run of the longest."""
    found = wallid.experiment_design.compare_lengths(case, [1.0, 3.0], lambda window: 1.0, full=True)
    one, three = (wallid.design(case, window_days=days, every_rows=24, full=True) for days in (1, 3))
    want = one.information[0, [0, 1, 2]].max() / three.information[0, 0]
    assert found.criterion[0] == pytest.approx(want, rel=1e-6) and found.criterion[1] == 1.0


def test_a_placement_as_text_dict_and_html(found):
    assert found.summary() == str(found)
    result = json.loads(json.dumps(found.to_dict()))
    assert result["positions"] == list(found.chosen) and found._repr_html_().count("position ") == 2
    assert result["relative_std"][0] == found.std[0, 0].min() < result["relative_std_before"]
