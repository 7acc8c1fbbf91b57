"""Sensors of unknown height in a section: the spread that an estimate counts, and where a sensor is found."""

from itertools import product

import numpy as np
import pytest
from benchmarks.reference.analytic_slab import weather
from benchmarks.reference.section_by_finite_elements import ElementSection, Rectangle

import wallid
from wallid.case.section import Region, SectionMaterial, section_of_regions
from wallid.inference.sensor_heights import candidate_heights, principal_components
from wallid.inference.sensor_places import _posterior_of_sets
from wallid.models.section.section_state_space import section_modes

MATERIALS = {"stone": (1.7, 2.1e6), "mortar": (0.4, 1.5e6)}
REGIONS = (
    Region("mortar", (0.0, 0.3), (0.0, 0.24)),
    Region("stone", (0.0, 0.11), (0.0, 0.1)),
    Region("stone", (0.15, 0.3), (0.0, 0.1)),
    Region("stone", (0.0, 0.18), (0.14, 0.24)),
    Region("stone", (0.22, 0.3), (0.14, 0.24)),
)
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


def test_stone_and_mortar_are_told(fits):
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
    _, even = candidate_heights(records["unknown"], records["unknown"].sensors[0])
    assert even == pytest.approx(1.0 / len(even))


def test_principal_components_have_the_covariance_of_the_deviations():
    rng = np.random.default_rng(0)
    deviations, weights = rng.normal(size=(40, 3)), rng.uniform(0.5, 1.0, 40)
    weights /= weights.sum()
    mean, components = principal_components(deviations, weights)
    assert mean == pytest.approx(weights @ deviations)
    centred = deviations - mean
    assert components.T @ components == pytest.approx(centred.T @ (weights[:, None] * centred))


def test_the_probability_of_sets_is_that_of_each_set_by_itself():
    rng = np.random.default_rng(1)
    base, moves = rng.normal(size=6), [rng.normal(size=(4, 6)), rng.normal(size=(3, 6))]
    log_weights = [np.log(np.full(4, 0.25)), np.log(np.array([0.2, 0.3, 0.5]))]
    table = np.zeros((4, 3))
    for i, j in product(range(4), range(3)):
        residual = base - moves[0][i] - moves[1][j]
        table[i, j] = np.exp(-0.5 * residual @ residual + log_weights[0][i] + log_weights[1][j])
    table /= table.sum()
    found = _posterior_of_sets(base, moves, log_weights)
    assert found[0] == pytest.approx(table.sum(axis=1)) and found[1] == pytest.approx(table.sum(axis=0))


def test_many_sensors_are_combined_at_their_most_probable_heights():
    rng = np.random.default_rng(2)
    base = rng.normal(size=50)
    moves = [rng.normal(size=(64, 50)) for _ in range(5)]
    truth = [3, 60, 20, 41, 8]
    base = base * 0.1 + sum(move[k] for move, k in zip(moves, truth, strict=True))
    found = _posterior_of_sets(base, moves, [np.full(64, -np.log(64))] * 5)
    assert [int(np.argmax(one)) for one in found] == truth
