"""Mix-ups of columns, places, units and clocks are named before any effect, on records of the independent simulator."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.accuracy import mixups
from benchmarks.reference.simulator_with_effects import Hidden, write_case
from studies import SPEC

import wallid

pytestmark = [pytest.mark.runs_long, pytest.mark.usefixtures("without_next_measurement")]

MONITORED = replace(SPEC, days=10.0, step=1800.0, noise_std=0.05, boundary_noise_std=0.05, rounding=0.01)


@pytest.fixture(scope="module")
def stated(tmp_path_factory):
    """The case as it should be stated, with the truth."""
    folder = tmp_path_factory.mktemp("case")
    truth = write_case(MONITORED, folder)["truth"]["diffusivity"]
    return wallid.load(folder), truth


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("mirrored", "unit", "clock_from_a_row_on", "cm")]


@pytest.mark.parametrize("name", ["exchanged", "copy", *SLOW])
def test_what_was_mixed_up_is_named(stated, name):
    case, truth = stated
    wrong, right = mixups.MISTAKES[name](case, np.random.RandomState(4))
    found = wallid.diagnose(wrong)
    assert found.verdict == "named", found.sentence
    first = found.mixups[0]
    assert first.kind in {kind for kind, _ in right}
    if name not in ("mirrored", "cm", "feet"):
        assert (first.kind, frozenset(first.targets)) in right
    low, high = np.log(found.interval_95)
    # three standard errors: of eight records one may well be outside its 95 % interval
    assert abs(np.log(truth) - (low + high) / 2) < 3 / 1.96 * (high - low) / 2, "with the correction the value is right"
    entries = found.to_dict()
    assert entries["mixups"][0]["kind"] == first.kind and first.words.capitalize()[:10] in found.sentence.capitalize()
    assert entries["diffusivity_before"] != entries["diffusivity"]


def test_what_the_readings_cannot_exclude_is_said_too(stated):
    """Sensors that lie nearly symmetrically: exchanged faces and reversed sensors differ by 1 cm, 8 mm are stated."""
    case, _ = stated
    vague = replace(case, sensors=tuple(replace(sensor, position_std=0.008) for sensor in case.sensors))
    wrong, _ = mixups.MISTAKES["mirrored"](vague, np.random.RandomState(4))
    first = wallid.diagnose(wrong).mixups[0]
    assert first.kind in ("faces", "mirrored", "order")
    assert "which the readings cannot exclude: " in first.words
    assert "counted from the right face" in first.words and "in the reverse order" in first.words
    assert "T1 and T3" not in first.words, "of three sensors, reversed, the middle one stays"


def test_a_sound_record_is_left_alone(stated):
    found = wallid.diagnose(stated[0])
    assert found.verdict == "adequate" and found.mixups == () and found.to_dict()["mixups"] == []


@pytest.mark.slow
def test_an_effect_that_is_no_mixup_is_named_as_an_effect(tmp_path):
    """A lag of most of an hour is not a clock that is an hour late."""
    write_case(replace(MONITORED, effects=(Hidden("sensor_lag", "T2", {"time_constant": 3000.0}),)), tmp_path)
    found = wallid.diagnose(wallid.load(tmp_path))
    assert found.mixups == ()
    assert [(one["name"], one["target"]) for one in found.to_dict()["effects"]] == [("sensor_lag", "T2")]
