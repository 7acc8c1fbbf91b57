"""A wall of stones and mortar in a diagnosis of one dimension, and what one dimension costs."""

import json
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
import scipy
from benchmarks.reference.analytic_slab import weather
from benchmarks.reference.section_by_finite_elements import ElementSection, Rectangle
from pages import check
from stone_wall import REGIONS, case_text
from typer.testing import CliRunner

import wallid
from wallid.case.section import Region, SectionMaterial, section_of_regions
from wallid.case.time_window import entire_record
from wallid.cli.commands import app
from wallid.discrepancy.heterogeneity.heterogeneity import _SizeLikelihood, compare_walls
from wallid.discrepancy.heterogeneity.section_pattern import section_pattern
from wallid.discrepancy.problem import diagnosis_problem
from wallid.discrepancy.selection.candidate_fits import plain_model_of
from wallid.estimation.one_dimension import cost_of_one_dimension
from wallid.inference.sensor_heights import HEIGHT_KIND, section_minus_homogeneous

MATERIALS = {"stone": (1.7, 2.1e6), "mortar": (0.4, 1.5e6)}
PLACES, HEIGHTS = (0.09, 0.2), (0.05, 0.2)
STEP = 3600.0


def simulated(materials, seed):
    """Nine days by finite elements, and the wall's diffusivity."""
    rng = np.random.default_rng(seed)
    wall = ElementSection(0.3, 0.24, [Rectangle(r.x, r.y, *materials[r.material]) for r in REGIONS], 0.015)
    faces = weather(12 * 288, 300.0, rng, hours=(8.0, 2.0))
    inside = wall.temperatures(faces, 300.0, np.stack([PLACES, HEIGHTS], axis=1), 12)
    readings = np.concatenate([faces[::12][: len(inside)], inside], axis=1)[3 * 24 :]
    frame = pd.DataFrame(readings + 0.03 * rng.standard_normal(readings.shape), columns=["left", "right", "T1", "T2"])
    frame.insert(0, "time", STEP * np.arange(len(frame)))
    return frame, wall.diffusivity


def case_of(frame, heights=(None, None), **options):
    section = section_of_regions(0.3, 0.24, [SectionMaterial(k, *v) for k, v in MATERIALS.items()], REGIONS)
    sensors = [
        wallid.Sensor(f"T{k + 1}", x, noise_std=0.03, height=height)
        for k, (x, height) in enumerate(zip(PLACES, heights, strict=True))
    ]
    return wallid.Case.from_dataframe(
        frame, time="time", left="left", right="right", sensors=sensors, section=section, model="lom",
        wall=wallid.Wall(0.3, section.diffusivity_prior), boundary_noise_std=0.03, **options,
    )  # fmt: skip


@pytest.fixture(scope="module")
def record():
    """All conductivities 0.85 times the stated ones."""
    return simulated({name: (0.85 * k, c) for name, (k, c) in MATERIALS.items()}, 2908)


@pytest.fixture(scope="module")
def plain(record):
    """The fits and the plain model with the pattern."""
    return plain_model_of(diagnosis_problem(case_of(record[0])))


@pytest.fixture(scope="module")
def diagnosis(record):
    return wallid.diagnose(case_of(record[0]))


def test_the_diagnosis_has_the_interval_that_one_dimension_lacks(record, diagnosis):
    truth = record[1]
    one_dimension = wallid.estimate(case_of(record[0]).in_one_dimension())
    low, high = one_dimension.interval_95
    assert not low < truth < high
    low, high = diagnosis.interval_95
    assert low < truth < high


def test_heterogeneity_is_named(diagnosis):
    assert diagnosis.verdict == "named" and not diagnosis.effects
    entry = diagnosis.to_dict()
    (effect,) = entry["effects"]
    assert effect["name"] == "heterogeneity" and effect["target"] is None
    size = effect["parameters"]["size"]
    assert abs(size["value"] - 1.0) < 3.0 * size["std"] and effect["p_value"] < 1e-6
    assert entry["gap"]["before_K"] > 1.5 * entry["gap"]["after_K"]
    before = entry["diffusivity_before"]["value"]
    assert abs(np.log(before / entry["diffusivity"]["value"])) > 0.005
    assert "not homogeneous" in diagnosis.sentence and "section      heterogeneity" in diagnosis.summary()


@pytest.mark.slow
def test_a_homogeneous_wall_contradicts_the_section():
    """The same stated section, but stone and mortar are of one material."""
    frame, truth = simulated(dict.fromkeys(MATERIALS, (1.2, 1.9e6)), 2909)
    found = wallid.diagnose(case_of(frame))
    assert found.heterogeneity.is_contradicted and found.heterogeneity.evidence < -20.0
    assert found.verdict == "adequate" and not found.to_dict()["effects"]
    low, high = found.interval_95
    assert low < truth < high
    assert "contradicts the section" in found.sentence


def test_what_the_record_cannot_tell_spans_both(diagnosis):
    """As if the evidence were small: the interval spans both walls, and the effects of the other one are said."""
    doubtful = replace(diagnosis, heterogeneity=replace(diagnosis.heterogeneity, evidence=2.0))
    other = diagnosis.other_wall
    assert other.effects and doubtful.verdict == "confusable" and not doubtful.to_dict()["effects"]
    assert "cannot distinguish the section" in doubtful.sentence
    assert other.problem.label(other.effects[0].effect_parameters.effect) in doubtful.sentence
    low, high = doubtful.interval_95
    ends = [*diagnosis.interval_95, *other.interval_95]
    assert (low, high) == pytest.approx((min(ends), max(ends)))


def test_the_pattern_is_the_difference_of_the_two_models(record):
    """At a known height it is exact at its diffusivity, and of second order beside it."""
    case = case_of(record[0], HEIGHTS)
    window, alpha = entire_record(case), 6e-7
    pattern = section_pattern(case, window, alpha)
    assert pattern.components.shape[0] == 0
    for factor, allowed in ((1.0, 1e-10), (1.05, 0.01)):
        exact = section_minus_homogeneous(case, window, factor * alpha)
        found = np.asarray(pattern.change(jnp.asarray(np.log(factor * alpha)), jnp.zeros(0)))
        for k, one in enumerate(exact):
            assert np.abs(found[:, k] - one.readings[0]).max() <= allowed * np.abs(one.readings).max() + 1e-12


def test_no_pattern_is_the_homogeneous_wall(plain):
    problem = plain[1].problem.without_pattern()
    assert not problem.has_pattern
    assert not [name for name in problem.parameters.estimated_names if name.startswith(HEIGHT_KIND)]
    amplitudes = dict.fromkeys(problem.parameters.of_kind(HEIGHT_KIND), 1.0)
    assert not np.asarray(problem.model.change_by_pattern(problem.parameters.with_values(amplitudes))).any()


def test_the_likelihood_of_the_size_is_the_dense_gaussian(plain):
    """-2 log L with all other parameters in the covariance, ln(alpha) with a wide prior: differences agree."""
    fit = plain[1]
    likelihood, problem, names = _SizeLikelihood(fit), fit.problem, fit.parameters.estimated_names
    jacobian, residual = fit.unwhitened()
    own = [k for k, name in enumerate(names) if name.startswith(HEIGHT_KIND)]
    others = [k for k in range(len(names)) if k not in own]
    std = np.asarray(fit.parameters.prior_std)[np.asarray(fit.parameters.estimated)]
    values = fit.parameters.flatten()
    wide = np.where(np.isfinite(std), std, 1e3)
    C, J = jacobian[:, own], jacobian[:, others] * wide[others]
    zero = fit.parameters.with_values(dict.fromkeys(problem.parameters.of_kind(HEIGHT_KIND), 0.0))
    mean = problem.binned(np.asarray(problem.model.change_by_pattern(zero)))
    # the readings about the prior means of all parameters but ln(alpha)
    start = np.where(np.isfinite(std), values, 0.0)
    data = residual + C @ values[own] + jacobian[:, others] @ start[others] + mean

    def dense(size):
        covariance = fit.noise.covariance + J @ J.T + size**2 * C @ C.T
        rest = data - size * mean
        return np.linalg.slogdet(covariance)[1] + rest @ np.linalg.solve(covariance, rest)

    for size in (0.3, 1.0, 2.0):
        assert likelihood(size) - likelihood(0.0) == pytest.approx(dense(size) - dense(0.0), rel=1e-3, abs=0.05)
    found = compare_walls(fit, fit)
    best = scipy.optimize.minimize_scalar(dense, bounds=(0.0, 5.0), method="bounded").x
    assert found.size == pytest.approx(best, abs=0.02)
    # of the same fit the evidence is what the amplitudes' priors cost, with the opposite sign
    whitened = fit.noise.whitening @ C
    others = np.concatenate([fit.noise.whitening @ J, np.eye(J.shape[1])])
    padded = np.pad(whitened, ((0, J.shape[1]), (0, 0)))
    padded = padded - others @ np.linalg.lstsq(others, padded, rcond=None)[0]
    assert found.evidence == pytest.approx(-np.linalg.slogdet(np.eye(len(own)) + padded.T @ padded)[1], rel=1e-3)


def test_the_error_of_one_dimension_is_that_of_estimates(record):
    """The linear prediction against estimates in one dimension from the section's readings without noise."""
    case = case_of(record[0], HEIGHTS)
    cost = cost_of_one_dimension(case)
    window = entire_record(case)
    from wallid.case.initial_profile import scales
    from wallid.models.section import section_modes
    from wallid.models.sensitivity_equations import simulate_window
    from wallid.models.window_inputs import full_order_model, window_data

    alpha = section_modes(case.section).equivalent.diffusivity
    model, data = full_order_model(case), window_data(case, window)
    readings = scales(case).celsius(np.asarray(simulate_window(model, scales(case).fourier_number(alpha), data)[0]))
    plain = case.in_one_dimension()
    plain = replace(
        plain,
        record=replace(plain.record, sensors=np.asarray(readings)),
        choices=replace(plain.choices, noise="stated"),
    )
    fit = wallid.estimate(plain)
    assert cost.mean == pytest.approx(np.log(fit.value / alpha), rel=0.25)
    assert abs(cost.mean) > 3.0 * cost.log_std and cost.std == 0.0


def test_the_error_by_unknown_heights_is_that_of_the_known_ones(record):
    known, unknown = (cost_of_one_dimension(case_of(record[0], heights)) for heights in (HEIGHTS, (None, None)))
    for name, height in zip(("T1", "T2"), HEIGHTS, strict=True):
        own = unknown.sensors[name]
        assert np.interp(height, own.heights, own.bias) == pytest.approx(known.sensors[name].mean, rel=0.1, abs=1e-4)
        assert own.weights.sum() == pytest.approx(1.0)
    assert unknown.std > 3.0 * unknown.log_std


def test_the_cost_needs_a_section(record):
    with pytest.raises(wallid.InputError, match=r"needs a \[section\]"):
        cost_of_one_dimension(case_of(record[0]).in_one_dimension())


@pytest.fixture(scope="module")
def case_file(record, tmp_path_factory):
    folder = tmp_path_factory.mktemp("stones")
    record[0].to_csv(folder / "record.csv", index=False)
    sensors = [(f"T{k + 1}", place, None) for k, place in enumerate(PLACES)]
    (folder / "case.toml").write_text(case_text(MATERIALS, sensors, 0.03, record=["boundary_noise_std = 0.03"]))
    return folder


@pytest.mark.slow
def test_the_page_of_a_diagnosis_shows_both_walls(case_file, tmp_path):
    ended = CliRunner().invoke(app, ["diagnose", str(case_file), "--out", str(tmp_path / "out")])
    assert ended.exit_code == 0, ended.output
    page = check((tmp_path / "out" / "report.html").read_text("utf-8"))
    assert "with the section" in page.text and "homogeneous wall" in page.text
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert [effect["name"] for effect in result["effects"]] == ["heterogeneity"]


def test_the_section_command_says_what_one_dimension_costs(case_file, tmp_path):
    words = ["section", str(case_file), "--one-dimension", "--out", str(tmp_path / "out")]
    ended = CliRunner().invoke(app, words)
    assert ended.exit_code == 0, ended.output
    assert "an estimate of a homogeneous wall is off by" in ended.stdout
    entry = json.loads((tmp_path / "out" / "result.json").read_text())["section"]["one_dimension"]
    assert set(entry) == {"bias", "std", "stated_std", "sensors"} and entry["std"] > entry["stated_std"]
    assert (tmp_path / "out" / "one-dimension.png").exists()


def test_a_size_that_excludes_the_section_is_not_the_section(diagnosis):
    doubted = replace(diagnosis, heterogeneity=replace(diagnosis.heterogeneity, size=0.3, std=0.05))
    assert not doubted.shows_heterogeneity and doubted.verdict == "confusable"
    assert "where the section says 1" in doubted.sentence


@pytest.mark.slow
def test_faults_of_instruments_are_not_taken_for_stones():
    """A homogeneous wall with a stated section and two faults: the wall with the faults explains the record."""
    frame, truth = simulated(dict.fromkeys(MATERIALS, (1.2, 1.9e6)), 2910)
    frame["T1"] += 0.3
    frame["left"] -= 1.0
    found = wallid.diagnose(case_of(frame))
    low, high = found.interval_95
    assert not found.shows_heterogeneity and low < truth < high


def test_a_section_of_one_material_is_a_wall_in_one_dimension(record):
    case = case_of(record[0])
    section = section_of_regions(
        0.3, 0.24, [SectionMaterial("stone", 1.2, 1.9e6)], [Region("stone", (0, 0.3), (0, 0.24))]
    )
    problem = diagnosis_problem(replace(case, section=section))
    assert not problem.has_pattern and problem.model.pattern is None
    assert not [name for name in problem.parameters.names if name.startswith(HEIGHT_KIND)]


def test_a_part_of_a_record_may_be_shorter_than_a_window(record):
    """A break of a face leaves a part that is shorter than `window_days`: the diagnosis has no windows of its own."""
    broken = record[0].copy()
    broken.loc[110:120, "left"] = np.nan
    problem = diagnosis_problem(case_of(broken, window_days=8.0))
    assert problem.record.rows < 120 and problem.readings.shape == (problem.record.rows, 2)
