"""Sensors of unknown height in a section: the spread that an estimate counts, and where a sensor is found."""

import numpy as np
import pytest
from benchmarks.reference.analytic_slab import weather
from benchmarks.reference.section_by_finite_elements import ElementSection, Rectangle
from stone_wall import REGIONS

import wallid
from wallid.case.section import SectionMaterial, section_of_regions
from wallid.inference.sensor_heights import Deviations, candidate_heights, principal_components
from wallid.inference.sensor_places import place_of_likelihoods
from wallid.models.section.section_state_space import section_modes
from wallid.report.settings import settings_tables

MATERIALS = {"stone": (1.7, 2.1e6), "mortar": (0.4, 1.5e6)}
PLACES, HEIGHTS, FACTOR = (0.09, 0.2), (0.05, 0.2), 0.85  # T1 in a stone, T2 in a joint between stones
STEP = 1800.0


@pytest.fixture(scope="module")
def records():
    """The same record with the heights as known, as unknown, and as uncertain."""
    rng = np.random.default_rng(2904)
    rectangles = [Rectangle(r.x, r.y, FACTOR * MATERIALS[r.material][0], MATERIALS[r.material][1]) for r in REGIONS]
    faces = weather(9 * 288, 300.0, rng, hours=(8.0, 2.0))
    points = np.stack([PLACES, HEIGHTS], axis=1)
    inside = ElementSection(0.3, 0.24, rectangles, 0.012).temperatures(faces, 300.0, points, 6)
    readings = np.concatenate([faces[::6][: len(inside)], inside], axis=1)[3 * 48 :]
    readings = readings + 0.02 * rng.standard_normal(readings.shape)
    section = section_of_regions(
        0.3, 0.24, [SectionMaterial(name, *values) for name, values in MATERIALS.items()], REGIONS
    )
    import pandas as pd

    frame = pd.DataFrame(readings, columns=["left", "right", "T1", "T2"])
    frame.insert(0, "time", STEP * np.arange(len(frame)))

    def case(heights, height_std=0.0):
        sensors = [
            wallid.Sensor(f"T{k + 1}", x, noise_std=0.02, height=height, height_std=height_std)
            for k, (x, height) in enumerate(zip(PLACES, heights, strict=True))
        ]
        return wallid.Case.from_dataframe(
            frame, time="time", left="left", right="right", sensors=sensors, section=section, model="lom",
            wall=wallid.Wall(0.3, section.diffusivity_prior), boundary_noise_std=0.02,
        )  # fmt: skip

    return {
        "known": case(HEIGHTS),
        "unknown": case((None, None)),
        "uncertain": case(HEIGHTS, 0.01),
        "truth": FACTOR * section_modes(section).equivalent.diffusivity,
    }


@pytest.fixture(scope="module")
def fits(records):
    return {name: wallid.estimate(case) for name, case in records.items() if name != "truth"}


@pytest.mark.parametrize("heights", ["known", "uncertain", "unknown"])
def test_the_interval_holds_the_truth(records, fits, heights):
    low, high = fits[heights].interval_95
    assert low < records["truth"] < high and fits[heights].reliable


def test_what_is_not_known_widens_the_interval(fits):
    assert fits["known"].std < fits["uncertain"].std < fits["unknown"].std
    assert fits["unknown"].variance_shares["heights"] > 0.2 and "heights" not in fits["known"].variance_shares


def test_a_sensor_is_placed_in_stone_or_in_mortar(fits):
    places = fits["unknown"].sensor_places
    assert places["T1"].material == "stone" and places["T2"].material == "mortar"
    for place in places.values():
        assert sum(place.materials.values()) == pytest.approx(1.0) and place.probability.sum() == pytest.approx(1.0)
        assert place.materials[place.material] > 0.7
    assert not fits["known"].sensor_places
    assert "heights      T1 in stone with probability" in fits["unknown"].summary()


def test_a_stated_height_weighs(records):
    case = records["uncertain"]
    heights, weights = candidate_heights(case, case.sensors[0])
    assert weights @ heights == pytest.approx(HEIGHTS[0], abs=1e-3)
    assert weights @ (heights - HEIGHTS[0]) ** 2 == pytest.approx(0.01**2, rel=0.1)
    all_heights, lengths = candidate_heights(records["unknown"], records["unknown"].sensors[1])
    in_mortar = (all_heights > 0.1) & (all_heights < 0.14) | (all_heights > 0.14)
    assert lengths.sum() == pytest.approx(1.0) and lengths[in_mortar].sum() == pytest.approx(0.14 / 0.24)


def test_principal_components_have_the_covariance_of_the_deviations():
    rng = np.random.default_rng(0)
    deviations, weights = Deviations(rng.normal(size=(40, 3)), rng.normal(size=(40, 3))), rng.uniform(0.5, 1.0, 40)
    weights /= weights.sum()
    found = principal_components(deviations, weights)
    assert found.mean == pytest.approx(weights @ deviations.readings)
    centred = deviations.readings - found.mean
    assert found.components.T @ found.components == pytest.approx(centred.T @ (weights[:, None] * centred))
    # the slopes are the same combinations of the heights
    linear = Deviations(deviations.readings, 2.0 * deviations.readings)
    assert principal_components(linear, weights).component_slopes == pytest.approx(2.0 * found.components)


def test_few_heights_have_components_of_zero():
    found = principal_components(Deviations(np.array([[1.0, 2.0]]), np.array([[0.0, 0.0]])), np.ones(1))
    assert found.components.shape == (3, 2) and not found.components.any()


def test_the_place_is_that_of_the_likelihoods():
    heights, weights = np.arange(4.0), np.array([0.1, 0.2, 0.3, 0.4])
    log_likelihood = np.log([1.0, 2.0, 3.0, 4.0])
    names = ["stone", "mortar", "stone", "mortar"]
    place = place_of_likelihoods(heights, weights, names, log_likelihood, ["stone", "mortar", "brick"])
    assert place.probability == pytest.approx(np.array([0.1, 0.4, 0.9, 1.6]) / 3.0)
    assert place.materials == pytest.approx({"stone": 1.0 / 3.0, "mortar": 2.0 / 3.0, "brick": 0.0})
    assert place.deviance == pytest.approx(2.0 * np.log((2.0 / 0.6) / (1.0 / 0.4)))


def test_a_decisive_place_has_a_finite_deviance_and_one_material_none():
    decisive = place_of_likelihoods(np.arange(2.0), np.full(2, 0.5), ["a", "b"], np.array([0.0, -5000.0]), ["a", "b"])
    assert decisive.deviance == pytest.approx(10_000.0) and decisive.materials == {"a": 1.0, "b": 0.0}
    alone = place_of_likelihoods(np.arange(2.0), np.full(2, 0.5), ["a", "a"], np.zeros(2), ["a", "b"])
    assert alone.deviance is None and alone.material == "a"


def test_the_prediction_is_at_the_probable_height(records, fits):
    """The mean over the heights would miss the readings by far more than their noise."""
    found = wallid.predict(records["unknown"], fits["unknown"])
    rms = np.sqrt(np.nanmean((found.measured - found.predicted)[48:] ** 2, axis=0))
    assert (rms < 0.03).all()
    assert (found.sigma[48:] >= 0.02).all()


def test_the_report_has_the_section_and_the_heights(records):
    tables = {table.title: table for table in settings_tables(records["unknown"])}
    assert [row[0] for row in tables["[[section.material]]"].rows] == ["stone", "mortar"]
    assert dict(tables["[section]"].rows)["height (m)"] == "0.24"
    assert tables["[[sensor]]"].head[-2:] == ("height (m)", "height_std (m)")
    assert [row[-2] for row in tables["[[sensor]]"].rows] == ["not known"] * 2
    assert settings_tables(records["known"])[-2].rows[0][-2] == "0.05"


def test_windows_of_one_height_are_not_averaged(records):
    with pytest.raises(wallid.InputError, match="the same in all windows"):
        wallid.campaign(records["unknown"])


def test_sensors_at_one_distance_differ_by_their_heights(records):
    case = records["unknown"]
    twice = [wallid.Sensor(f"T{k + 1}", 0.09, noise_std=0.02) for k in range(2)]
    frame = case.record.to_frame()
    options = {"section": case.section, "wall": case.wall}
    columns = {"left": frame.columns[0], "right": frame.columns[1]}
    assert wallid.Case.from_dataframe(frame, sensors=twice, **columns, **options).sensors[1].position == 0.09
    same = [wallid.Sensor(f"T{k + 1}", 0.09, noise_std=0.02, height=0.1) for k in range(2)]
    with pytest.raises(wallid.InputError, match=r"position = 0\.09 m at height = 0\.1 m is that of"):
        wallid.Case.from_dataframe(frame, sensors=same, **columns, **options)


def test_amplitudes_are_weights_of_the_heights():
    """The sum over the heights with these weights has the readings of the mean and the components."""
    rng = np.random.default_rng(1)
    deviations, weights = Deviations(rng.normal(size=(40, 6)), rng.normal(size=(40, 6))), rng.uniform(0.5, 1.0, 40)
    weights /= weights.sum()
    found, z = principal_components(deviations, weights), np.array([0.7, -1.2, 0.3])
    of_heights = found.weights_at(z)
    assert of_heights.sum() == pytest.approx(1.0)
    assert of_heights @ deviations.readings == pytest.approx(found.mean + z @ found.components)
    assert of_heights @ deviations.slopes == pytest.approx(found.mean_slope + z @ found.component_slopes)
