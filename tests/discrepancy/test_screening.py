"""The test of the plain model on the entire record, on records of the independent simulator."""

import json
from dataclasses import replace

import pytest
from benchmarks.reference.simulator_with_effects import Hidden, write_case
from studies import SPEC

import wallid
from wallid.discrepancy.screening import screen

MONITORED = replace(SPEC, days=10.0, step=1800.0, noise_std=0.05, boundary_noise_std=0.05, rounding=0.01)


@pytest.fixture(scope="module")
def screened(tmp_path_factory):
    """The screening of a record with these effects hidden in it."""

    def find(*hidden, **changes):
        folder = tmp_path_factory.mktemp("case")
        write_case(replace(MONITORED, effects=tuple(Hidden(*one) for one in hidden), **changes), folder)
        return screen(wallid.load(folder))

    return find


@pytest.mark.parametrize("noise", ["white", "ar06", "ar09"])
def test_nothing_is_missing_where_nothing_is_hidden(screened, noise):
    found = screened(noise=noise)
    assert found.missing == "" and "shows no missing effect" in str(found)
    assert found.score_p_value > 0.005 and found.residual_p_value > 0.001


@pytest.mark.parametrize(
    "hidden",
    [
        ("sensor_gain", "T2", {"gain": -0.2}),
        ("solar_gain", "left", {"gain": 0.01}),
        ("clock_shift", None, {"delay": 3600.0}),
        ("layered_conductivity", None, {"log_ratio": -0.36, "interface": 0.1}),
    ],
    ids=lambda hidden: hidden[0],
)
def test_a_hidden_effect_is_seen_and_the_next_step_follows(screened, hidden):
    found = screened(hidden)
    assert found.missing and found.candidate in found.missing
    assert found.score_p_value < 0.001
    assert json.loads(json.dumps(found.to_dict()))["missing"] is True


def test_the_size_of_a_hidden_effect_is_about_right(screened):
    found = screened(("sensor_gain", "T2", {"gain": -0.1}))
    assert found.candidate == "sensor gain of T2"
    assert found.size == pytest.approx(-0.1, abs=0.05) and 0 < found.size_std < 0.05
