"""Conductivity and heat capacity of each material of a section, estimated within priors."""

import json

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from benchmarks.reference.analytic_slab import weather
from benchmarks.reference.section_by_finite_elements import ElementSection, Rectangle
from hypothesis import given, settings
from hypothesis import strategies as st
from pages import check
from stone_wall import REGIONS, case_text
from typer.testing import CliRunner

import wallid
from wallid.case.section import SectionMaterial, section_of_regions
from wallid.cli.commands import app
from wallid.inference.material_values import conditioned
from wallid.models.finite_volume_wall import Output
from wallid.models.integration import simulate
from wallid.models.section import (
    MaterialRange,
    SectionPoint,
    equivalent_wall,
    full_order_section,
    material_sensitivity,
    section_modes,
    section_over_range,
)

STATED = {"stone": (1.7, 2.1e6), "mortar": (0.6, 1.5e6)}
TRUE = {"stone": (2.2, 1.8e6), "mortar": (0.5, 1.8e6)}
PLACES, HEIGHTS = (0.05, 0.13, 0.2, 0.25), (0.05, 0.05, 0.12, 0.2)


@pytest.fixture(scope="module")
def section():
    return section_of_regions(
        0.3, 0.24, [SectionMaterial(name, *values) for name, values in STATED.items()], REGIONS, step=0.01
    )


@pytest.fixture(scope="module")
def projection(section):
    return section_over_range(section)


def test_the_equivalent_wall_is_that_of_the_full_order_model(section, projection):
    full, materials = full_order_section(section), MaterialRange.of(section)
    for point in materials.points(4, seed=5):
        conductivity, heat_capacity = materials.at(point)
        own = projection.equivalent_at(conductivity, heat_capacity)
        assert own.conductivity == pytest.approx(equivalent_wall(full, conductivity).conductivity, rel=1e-7)
        assert own.heat_capacity == pytest.approx(section.areas @ heat_capacity)


def test_the_modes_over_the_range_are_those_of_the_full_order_model(section, projection):
    """Transfer functions to temperatures inside, at unseen values and frequencies.

    Faces vary less the faster they do, so an error below a day's period counts in proportion to the period.
    """
    places = [(0.05, 0.05), (0.13, 0.12), (0.2, 0.2)]
    full, materials = full_order_section(section, [SectionPoint(*place) for place in places]), MaterialRange.of(section)
    for point in materials.points(4, seed=8):
        conductivity, heat_capacity = materials.at(point)
        modes = projection.modes_at(conductivity, heat_capacity)
        own = modes.state_space([Output(x, height=y) for x, y in places])
        E, K, B = full.model.at(conductivity, heat_capacity)
        rate = modes.equivalent.diffusivity / 0.3**2
        for period in (5000.0, 40000.0, 300000.0):
            s = 2j * np.pi / period
            exact = full.model.C @ np.linalg.solve((s * E - K).toarray(), B) + full.model.D
            found = own.C @ (np.asarray(own.B) * rate / (s - rate * np.asarray(own.A))[:, None]) + own.D
            assert np.asarray(found) == pytest.approx(exact, abs=1e-4 * max(1.0, 86400.0 / period))


@settings(max_examples=10, deadline=None)
@given(st.floats(0.4, 2.5), st.floats(0.4, 2.5))
def test_only_ratios_count_beside_the_equivalent_diffusivity(section, projection, conductivity, heat_capacity):
    """All conductivities times one number, all capacities times another: the same state space."""
    full, outputs = full_order_section(section), [Output(0.1, height=0.12), Output(0.0, "flux")]
    one, other = (
        projection.modes_at(k * full.conductivity, c * full.heat_capacity).state_space(outputs)
        for k, c in ((1.0, 1.0), (conductivity, heat_capacity))
    )
    assert np.asarray(other.A) == pytest.approx(np.asarray(one.A), rel=1e-8)
    time = jnp.linspace(0.0, 1.0, 30)
    inputs = jnp.stack([jnp.sin(3 * time), jnp.cos(5 * time)], axis=1)
    responses = [np.asarray(simulate(m, 1.0, time, inputs, jnp.array([0.0, 1.0, 0.3]))[0]) for m in (one, other)]
    assert responses[1] == pytest.approx(responses[0], abs=1e-8)


def test_differences_of_the_model_are_the_explicit_sensitivities(section, projection):
    """What an estimate takes by differences at a fixed diffusivity of the equivalent wall is, with the chain rule,
    what the explicit coupled system has at fixed values of the other materials."""
    full, place, step, rows = full_order_section(section, [SectionPoint(0.13, 0.12)]), (0.13, 0.12), 3600.0, 96
    k, c = full.conductivity, full.heat_capacity
    time = step * np.arange(rows)
    faces = np.stack([10.0 + 5.0 * np.sin(2 * np.pi * time / 86400.0), 15.0 + 0.0 * time], axis=1)
    own = full.model.projected(projection.basis)
    _, theta = material_sensitivity(own, k, c, faces, step)
    alpha = projection.equivalent_at(k, c).diffusivity

    def response(changes):
        factors = np.exp(changes)
        modes = projection.modes_at(k * factors[:2], c * factors[2:])
        model, fourier = modes.state_space([Output(place[0], height=place[1])]), alpha * 86400.0 / 0.3**2
        start = jnp.array([faces[0, 0], faces[0, 1] - faces[0, 0], 0.0])
        return np.asarray(simulate(model, fourier, jnp.asarray(time / 86400.0), jnp.asarray(faces), start)[0])[:, 0]

    total = theta[:, :2, 0].sum(axis=1)  # all conductivities together: the derivative by ln(alpha)
    for number in range(4):
        change = 1e-4 * np.eye(4)[number]
        difference = (response(change) - response(-change)) / 2e-4
        ends = [
            np.log(projection.equivalent_at(k * np.exp(one[:2]), c * np.exp(one[2:])).diffusivity)
            for one in (change, -change)
        ]
        expected = theta[:, number, 0] - (ends[0] - ends[1]) / 2e-4 * total
        assert difference == pytest.approx(expected, abs=2e-4 * np.abs(total).max())


def test_a_normal_distribution_under_a_linear_condition():
    """The conditional distribution of the sum and the difference of two numbers, and a third that follows."""
    covariance = np.array([[2.0, 0.3, 0.5], [0.3, 1.0, 0.2], [0.5, 0.2, 1.5]])
    mean, row, value = np.array([1.0, -1.0, 0.5]), np.array([1.0, 1.0, 0.0]), 0.7
    found, spread = conditioned(mean, covariance, lambda y: np.array([row @ y - value]))
    variance = row @ covariance @ row
    assert found == pytest.approx(mean + covariance @ row * (value - row @ mean) / variance, rel=1e-6)
    assert spread == pytest.approx(covariance - np.outer(covariance @ row, covariance @ row) / variance, abs=1e-6)
    assert row @ found == pytest.approx(value) and row @ spread @ row == pytest.approx(0.0, abs=1e-8)


@pytest.fixture(scope="module")
def record():
    """Nine days by finite elements of a wall whose materials are not those stated, and its diffusivity."""
    rng = np.random.default_rng(2906)
    wall = ElementSection(0.3, 0.24, [Rectangle(r.x, r.y, *TRUE[r.material]) for r in REGIONS], 0.012)
    faces = weather(12 * 288, 300.0, rng, hours=(8.0, 2.0))
    inside = wall.temperatures(faces, 300.0, np.stack([PLACES, HEIGHTS], axis=1), 6)
    readings = np.concatenate([faces[::6][: len(inside)], inside], axis=1)[3 * 48 :]
    frame = pd.DataFrame(readings + 0.02 * rng.standard_normal(readings.shape), columns=["left", "right", *"abcd"])
    frame.insert(0, "time", 1800.0 * np.arange(len(frame)))
    return frame, wall.diffusivity


def case_of(record, section, heights=HEIGHTS, **options):
    sensors = [
        wallid.Sensor(name, x, noise_std=0.02, height=height)
        for name, x, height in zip("abcd", PLACES, heights, strict=True)
    ]
    return wallid.Case.from_dataframe(
        record[0], time="time", left="left", right="right", sensors=sensors, section=section, model="lom",
        wall=wallid.Wall(0.3, section.diffusivity_prior), boundary_noise_std=0.02, **options,
    )  # fmt: skip


@pytest.fixture(scope="module")
def fit(record, section):
    return wallid.estimate(case_of(record, section, free="materials"))


def test_wrong_ratios_make_a_wrong_diffusivity_and_free_ones_the_right_one(record, section, fit):
    truth = record[1]
    stated = wallid.estimate(case_of(record, section))
    assert not stated.interval_95[0] < truth < stated.interval_95[1]
    assert fit.interval_95[0] < truth < fit.interval_95[1] and fit.reliable


def test_the_values_of_the_materials_are_found(fit):
    for name, one in fit.materials.quantities.items():
        kind, _, material = name.partition(" of ")
        true = TRUE[material][0 if kind == "conductivity" else 1]
        assert abs(np.log(one.value / true)) < 3.0 * one.std / one.value
    ratio = fit.materials.combinations["conductivity of mortar over stone"]
    assert ratio.value == pytest.approx(0.5 / 2.2, rel=0.1) and fit.materials.is_learned(
        "conductivity of mortar over stone"
    )
    stone = fit.materials.combinations["diffusivity of stone"]
    assert stone.value == pytest.approx(2.2 / 1.8e6, rel=0.1)


def test_what_the_record_cannot_tell_keeps_its_prior(fit):
    """Temperatures alone leave the common factor of conductivities and capacities to the priors."""
    found = fit.materials
    assert found.learned == 3 and len(found.quantities) == 4
    std = np.array([one.std / one.value for one in found.quantities.values()])
    product = np.sqrt(std @ found.correlations @ std)  # of all four values
    assert product == pytest.approx(np.sqrt(4.0) * 0.3, rel=0.06)
    assert (std < 0.3).all()
    assert "determines 3 independent combinations of their 4 values" in fit.summary()
    entry = fit.to_dict()["materials"]
    assert entry["values"]["conductivity of stone"]["prior_log_std"] == pytest.approx(0.3)
    assert set(entry["combinations"]) == set(found.combinations)


def test_the_values_agree_with_the_diffusivity(section, fit):
    """The materials that are reported have the equivalent wall that is reported."""
    values = {name: one.value for name, one in fit.materials.quantities.items()}
    own = section_over_range(section).equivalent_at(
        np.array([values[f"conductivity of {name}"] for name in STATED]),
        np.array([values[f"heat_capacity of {name}"] for name in STATED]),
    )
    assert own.diffusivity == pytest.approx(fit.value, rel=0.01)


def test_refusals(record, section):
    with pytest.raises(wallid.InputError, match="no layers or films"):
        case_of(record, section, free="film_left")
    known = section_of_regions(0.3, 0.24, [SectionMaterial(n, *v, uncertainty=0.0) for n, v in STATED.items()], REGIONS)
    with pytest.raises(wallid.InputError, match="uncertainty = 0"):
        case_of(record, known, free="materials")
    with pytest.raises(wallid.InputError, match=r"no \[section\]"):
        wallid.Case.from_dataframe(
            record[0], time="time", left="left", right="right", sensors={"a": 0.05}, noise_std=0.02, length=0.3,
            diffusivity_prior=7e-7, free="materials",
        )  # fmt: skip


def test_a_known_material_is_not_estimated(record):
    materials = [
        SectionMaterial("stone", *TRUE["stone"], uncertainty=0.0),
        SectionMaterial("mortar", *STATED["mortar"]),
    ]
    half_known = section_of_regions(0.3, 0.24, materials, REGIONS, step=0.01)
    found = wallid.estimate(case_of(record, half_known, free="materials")).materials
    assert set(found.quantities) == {"conductivity of mortar", "heat_capacity of mortar"}
    assert "diffusivity of stone" not in found.combinations
    assert found.quantities["conductivity of mortar"].value == pytest.approx(0.5, rel=0.1)
    assert section_modes(half_known).equivalent.diffusivity > 0


@pytest.mark.slow
def test_unknown_heights_and_free_materials_together(record, section, fit):
    """What a sensor reads at its probable heights depends on the materials too: the interval is wider, and true."""
    found = wallid.estimate(case_of(record, section, (None,) * 4, free="materials"))
    assert found.interval_95[0] < record[1] < found.interval_95[1]
    assert found.std > fit.std
    stone = found.materials.quantities["conductivity of stone"]
    assert abs(np.log(stone.value / TRUE["stone"][0])) < 3.0 * stone.std / stone.value


@pytest.mark.slow
def test_the_command_writes_the_materials(record, section, tmp_path):
    """`wallid estimate --free materials` on a case file."""
    record[0].to_csv(tmp_path / "record.csv", index=False)
    sensors = zip("abcd", PLACES, HEIGHTS, strict=True)
    (tmp_path / "case.toml").write_text(case_text(STATED, sensors, 0.02, choices=["window_days = 8"]))
    words = ["estimate", str(tmp_path), "--free", "materials", "--out", str(tmp_path / "out"), "--json"]
    ended = CliRunner().invoke(app, words)
    assert ended.exit_code == 0, ended.output
    found = json.loads(ended.stdout)["materials"]
    assert found["parameters"] == list(found["values"]) and len(found["correlations"]) == 4
    check((tmp_path / "out" / "report.html").read_text("utf-8"))
