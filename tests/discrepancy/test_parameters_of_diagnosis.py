"""The named parameters of a diagnosis: names, units, bounds, one vector; one compilation for all that may be free."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from studies import SPEC, prepare, slot_of, trimmed

from wallid.discrepancy import model_with_effects
from wallid.discrepancy.effect_fit import refit
from wallid.discrepancy.effects.catalogue import LIBRARY
from wallid.discrepancy.effects.plates import OnePlate
from wallid.discrepancy.problem import diagnosis_problem

# a shape of record that no other test has: what is compiled for it is compiled here
SHORT = replace(SPEC, step=3600.0, days=3.0 + 1.0 / 24.0, noise_std=0.05, boundary_noise_std=0.03)
UNITS = {"", "K", "m", "s", "h", "degC", "K/s", "m/s", "1/s", "1/K", "K/day", "1/day", "K m2/W"}
ALL = {"offset_std": 0.1, "position_std": 0.002}


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return prepare(tmp_path_factory.mktemp("short"), SHORT)[0]


def with_priors(study, face_position_std=0.0, **stds):
    """The study of a case that states these standard deviations, and no others, of its sensors' errors."""
    sensors = tuple(replace(one, **{"offset_std": 0.0, "position_std": 0.0, **stds}) for one in study.case.sensors)
    record = replace(study.case.record, face_position_std=face_position_std)
    return diagnosis_problem(replace(study.case, sensors=sensors, record=record))


def test_every_parameter_has_a_name_of_its_own_a_unit_and_bounds(study):
    parameters = study.parameters
    assert len(set(parameters.names)) == len(parameters)
    assert set(parameters.units) <= UNITS
    low, value, high = (np.asarray(part) for part in (parameters.lower, parameters.values, parameters.upper))
    assert np.all(low < high) and np.all(low <= value) and np.all(value <= high)
    assert np.all(np.asarray(parameters.scale) > 0)
    of_effects = [name for slot in study.library for name in slot.names]
    assert list(parameters.names[-len(of_effects) :]) == of_effects
    assert {type(slot.effect) for slot in study.library} == {kind for kind in LIBRARY if not issubclass(kind, OnePlate)}
    for slot in study.library:
        assert list(slot.full_names) == [parameter.name for parameter in slot.effect.parameters]
        assert slot.values(parameters)[slot.effect.parameters[0].name] == 0.0, "neutral"
        for parameter, name in zip(slot.effect.parameters, slot.names, strict=True):
            assert name.startswith(f"effect.{slot.effect.name}") and name.endswith(f".{parameter.name}")
            assert parameters.units[parameters.index(name)] == parameter.unit
    assert "effect.sensor_gain[T2].gain" in parameters and "effect.clock_shift.delay" in parameters
    assert slot_of(study, "heat_source", None, ("place", "start")).names[0] == "effect.heat_source[placed, hourly].rate"


def test_what_is_free_are_the_priors_of_the_case_and_the_effects_chosen(study):
    modes = [f"profile_mode[{k}]" for k in range(1, 9)]
    common = ["common_noise[left]", "common_noise[right]"]
    assert list(with_priors(study).estimated_names(())) == ["log_diffusivity", *common, *modes]
    everything = with_priors(study, 0.002, **ALL)
    errors = [f"{kind}[{name}]" for kind in ("sensor_offset", "sensor_position") for name in ("T1", "T2", "T3")]
    faces = ["face_position[left]", "face_position[right]"]
    assert list(everything.estimated_names(())) == ["log_diffusivity", *errors, *faces, *common, *modes]
    slot = slot_of(everything, "sensor_offset", "T2")
    free = everything.estimated_names((slot,))
    assert "sensor_offset[T2]" not in free, "the effect has its place"
    assert free[-1] == "effect.sensor_offset[T2].offset"


@given(data=st.data())
@settings(max_examples=30)
def test_a_vector_goes_in_where_it_came_out(study, data):
    names = data.draw(st.lists(st.sampled_from(study.parameters.names), unique=True, min_size=1))
    parameters = study.parameters.estimating(names)
    vector = np.array(data.draw(st.lists(st.floats(-1e9, 1e9), min_size=len(names), max_size=len(names))))
    moved = parameters.unflatten(vector)
    assert_array_equal(moved.flatten(), vector)
    assert_array_equal(moved.vector(moved.estimated_names), vector)
    held = [name for name in parameters.names if name not in names]
    assert_array_equal(moved.vector(held), parameters.vector(held))
    assert_array_equal(parameters.unflatten(parameters.flatten()).values, parameters.values)


CHOICES = [
    [],
    [("clock_shift", None)],
    [("face_depth", "left"), ("sensor_offset", "T1")],
    [("contact_resistance", None), ("heat_source", None)],
    [("wetting", None)],
    [("sensor_lag", "T3"), ("temperature_dependent_capacity", None)],
]
PRIORS = [
    {},
    {"offset_std": 0.1},
    {"position_std": 0.002},
    {"face_position_std": 0.002},
    {**ALL, "face_position_std": 0.001},
]


@pytest.mark.slow
def test_one_compilation_serves_every_choice_of_effects_and_of_nuisance_parameters(study, monkeypatch):
    """Of the linear wall and of one whose heat equation is not: each is traced once for all of them."""
    traced, simulate = {True: 0, False: 0}, model_with_effects.simulate_readings

    def counted(*given_, linear, **options):
        traced[linear] += 1
        return simulate(*given_, linear=linear, **options)

    monkeypatch.setattr(model_with_effects, "simulate_readings", counted)
    chosen = {name for choice in CHOICES for name, _ in choice}
    sizes = set()
    for stds in PRIORS:
        problem = trimmed(with_priors(study, **stds), lambda effect: effect.name in chosen)
        noise = problem.noise_shape(problem.parameters).stated_covariance()
        for choice in CHOICES if len(stds) != 1 else CHOICES[:4]:
            active = tuple(slot_of(problem, *one) for one in choice)
            fit = refit(problem, active, problem.parameters, noise)
            sizes.add(len(fit.parameters.estimated_names))
            assert np.isfinite(fit.cost)
    assert len(sizes) > 8
    assert traced == {True: 1, False: 1}
