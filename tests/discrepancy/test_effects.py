"""Each effect: its neutral value, its physics against an independent simulator, its derivative; how they compose."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.reference import simulator_with_effects as truth
from benchmarks.reference.simulator_with_effects import DAY, HOUR
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from studies import SPEC, parameters_at, prepare, slot_of

from wallid.discrepancy.effects.catalogue import LIBRARY, library, untestable
from wallid.discrepancy.effects.equation_terms import Terms, Wetting
from wallid.discrepancy.effects.faces import FaceDepth, FaceLag, FaceOffset, SolarGain, SurfaceFilm
from wallid.discrepancy.effects.heat_sources import (
    AirFlow,
    HeatedSource,
    HourlySource,
    LateralLoss,
    PlacedSource,
    UniformSource,
    hours_signal,
)
from wallid.discrepancy.effects.material import (
    ContactResistance,
    DiffusivityDrift,
    LayeredCapacity,
    LayeredConductivity,
    PhaseChange,
    TemperatureDependentCapacity,
    TemperatureDependentConductivity,
    WettingByRain,
    latent_capacity,
)
from wallid.discrepancy.effects.plates import OnePlate
from wallid.discrepancy.effects.search_range import SearchRange, search_range_of_record
from wallid.discrepancy.effects.sensors import (
    ClockShift,
    SensorDrift,
    SensorGain,
    SensorLag,
    SensorOffset,
    SensorPosition,
)
from wallid.discrepancy.forward.cells import build_cells
from wallid.discrepancy.forward.response import simulate_readings
from wallid.discrepancy.model_with_effects import first_order_columns, linearise, predict
from wallid.discrepancy.problem import diagnosis_problem

REGRESSORS = ("irradiance", "air_outdoor", "air_indoor", "heating", "rain")
SETTLED = int(DAY / SPEC.step)
"""Rows left out at the beginning: the model starts from a straight line, the truth from its past."""


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """The study of a record from which nothing is missing, and what is true of it."""
    return prepare(tmp_path_factory.mktemp("plain"))


@pytest.fixture(scope="module")
def campaign(plain):
    return plain[0].model.forcing


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


# ---------------------------------------------------------------------------------------- names and what they need


def test_the_library_is_the_interface():
    """Names, targets and parameters are a promise to records and scripts."""
    whole, faces, sensors, airs = {None}, {"left", "right"}, {0, 1, 2}, {"outdoor", "indoor"}
    hours = {"start": "h", "end": "h"}
    promised = {
        "sensor_position": (sensors, {"shift": "m"}),
        "sensor_lag": (sensors, {"time_constant": "s"}),
        "sensor_offset": (sensors, {"offset": "K"}),
        "sensor_gain": (sensors, {"gain": ""}),
        "sensor_drift": (sensors, {"rate": "K/day"}),
        "clock_shift": (whole, {"delay": "s"}),
        "face_offset": (faces, {"offset": "K"}),
        "face_lag": (faces, {"time_constant": "s"}),
        "face_depth": (faces, {"depth": "m"}),
        "solar_gain": (faces, {"gain": "K m2/W"}),
        "surface_film": (faces, {"film_length": "m"}),
        "layered_conductivity": (whole, {"log_ratio": "", "interface": "m"}),
        "layered_capacity": (whole, {"log_ratio": "", "interface": "m"}),
        "contact_resistance": (whole, {"thickness": "m", "place": "m"}),
        "temperature_dependent_conductivity": (whole, {"slope": "1/K"}),
        "temperature_dependent_capacity": (whole, {"slope": "1/K"}),
        "phase_change": (whole, {"area": "K", "temperature": "degC"}),
        "diffusivity_drift": (whole, {"rate": "1/day"}),
        "wetting": (whole, {"jump": "", "time_constant": "s", "time": "s"}),
        "heat_source": (whole, {"rate": "K/s", "place": "m"} | hours),
        "lateral_loss": (airs, {"rate": "1/s"}),
        "air_flow": (whole, {"velocity": "m/s"}),
    }
    found = {}
    for effect in library(3, REGRESSORS):
        targets, parameters = found.setdefault(effect.name, (set(), {}))
        targets.add(effect.target)
        parameters.update({parameter.name: parameter.unit for parameter in effect.parameters})
    assert found == promised


def test_an_effect_without_its_regressor_cannot_be_tested():
    assert untestable(2, REGRESSORS) == {}
    assert untestable(2, ()) == {"solar_gain": ("irradiance",), "lateral_loss": ("air_indoor", "air_outdoor")}
    assert untestable(2, ("irradiance", "air_outdoor")) == {"lateral_loss": ("air_indoor",)}
    kinds = {type(effect) for effect in library(2, ())}
    without = {SolarGain, LateralLoss, HeatedSource}
    assert kinds == {kind for kind in LIBRARY if kind not in without and not issubclass(kind, OnePlate)}
    assert {e.target for e in library(2, ("air_indoor",)) if isinstance(e, LateralLoss)} == {"indoor"}


def test_only_what_changes_with_temperature_or_time_is_not_linear():
    assert {effect.name for effect in library(1, REGRESSORS) if not effect.linear} == {
        "temperature_dependent_conductivity", "temperature_dependent_capacity", "phase_change", "diffusivity_drift",
        "wetting",
    }  # fmt: skip


@pytest.mark.parametrize("rain", [(), (0.4 * DAY, 2.0 * DAY)])
def test_the_scan_stays_within_the_bounds(rain):
    search = SearchRange(
        interface_positions=(0.05, 0.08, 0.1, 0.12, 0.15),
        length=0.2,
        face_clearance=(0.05, 0.03),
        duration=5 * DAY,
        rain=rain,
        coldest=-4.0,
        warmest=21.0,
    )
    for effect in library(2, REGRESSORS):
        grid = list(effect.scan(search))
        assert len({tuple(values.items()) for values in grid}) == len(grid) > 0
        for parameter in effect.parameters:
            low, high = effect.bounds(parameter, search)
            assert low < high
            if parameter.is_size:
                assert low <= 0.0 <= high and parameter.smallest_reported > 0
                assert all(parameter.name not in values for values in grid)
            else:
                assert all(low <= values[parameter.name] <= high for values in grid)
    if rain:
        assert {values["time"] for values in WettingByRain().scan(search)} == set(rain)
    assert any(values["temperature"] == 0.0 for values in PhaseChange().scan(search)), "water freezes at 0 degC"
    deepest = [FaceDepth(side=side).bounds(FaceDepth.parameters[0], search)[1] for side in ("left", "right")]
    assert deepest == pytest.approx([0.045, 0.027])


def test_a_heavy_rain_begins_by_itself_after_a_shower(plain):
    record = plain[0].record
    hours = record.time / 3600.0
    rain = np.where((hours >= 6) & (hours < 8), 0.5, 0.0) + np.where((hours >= 16) & (hours < 22), 6.0, 0.0)
    rain[(hours >= 18) & (hours < 19)] = 0.0  # a pause
    wet = replace(record, regressors={"rain": rain})
    assert search_range_of_record(wet, (0.1,), 0.4).rain == (6 * 3600.0, 16 * 3600.0)


def test_interfaces_are_looked_for_between_the_outermost_sensors(plain):
    record = plain[0].record
    inside = search_range_of_record(record, (0.15, 0.04, 0.1), 0.2).interface_positions
    assert inside[0] > 0.04 and inside[-1] < 0.15 and np.all(np.diff(inside) > 0)
    alone = search_range_of_record(record, (0.1,), 0.2).interface_positions
    assert alone[0] >= 0.05 and alone[-1] <= 0.15


# --------------------------------------------------------------------------------------------------- neutral values


def test_each_effect_at_its_neutral_value_changes_no_term(campaign):
    """Nothing but entries of size 0 is added, and cells, faces and readings are the plain ones to the bit."""
    nothing = Terms.plain(campaign)
    bare = build_cells(nothing, campaign)
    changing, kinds = set(), set()
    for effect in library(3, REGRESSORS):
        terms = effect.apply(nothing, campaign)
        for name in Terms.__dataclass_fields__:
            before, after = getattr(nothing, name), getattr(terms, name)
            if isinstance(after, tuple):
                assert all(float(entry[0]) == 0.0 for entry in after), f"{effect.name}: {name}"
            else:
                assert_array_equal(after, before, err_msg=f"{effect.name}: {name}")
        found = build_cells(terms, campaign) if type(effect) not in kinds else bare
        kinds.add(type(effect))
        for name in (
            "positions",
            "resistance",
            "capacity",
            "advection",
            "loss",
            "state_to_readings",
            "faces_to_readings",
        ):
            assert_array_equal(getattr(found, name), getattr(bare, name), err_msg=f"{effect.name}: {name}")
        assert_array_equal(found.heat_input_matrix[:, :2], bare.heat_input_matrix)
        assert not np.any(found.heat_input_matrix[:, 2:])
        assert_array_equal(found.inputs[..., :4], bare.inputs)
        size = effect.parameters[0]
        moved = replace(effect, **{size.name: size.scale}).apply(nothing, campaign)
        if not eqx.tree_equal(moved, terms):
            changing.add((effect.name, effect.target, effect.variant))
    assert len(changing) == len(library(3, REGRESSORS)), "away from it each of them changes something"


def test_the_whole_library_at_its_neutral_values_is_the_plain_model(plain):
    """Whatever the places, times and temperatures of effects whose size is 0."""
    study, _ = plain
    without = replace(study.model, effects=())
    here = parameters_at(study, 6e-7).with_values(
        {f"profile_mode[{k}]": (-1) ** k * 0.1 * (k - 5) for k in range(1, 5)}
    )
    elsewhere = here.with_values(
        {
            name: here[name] + 0.7 * parameter.scale
            for slot in study.library
            for name, parameter in zip(slot.names, slot.effect.parameters, strict=True)
            if not parameter.is_size
        }
    )
    for linear in (True, False):
        want = predict(without, here, linear)
        for given_ in (here, elsewhere):
            assert_allclose(predict(study.model, given_, linear), want, rtol=0, atol=1e-12)


def test_how_deep_the_faces_sensors_sit_is_free_where_the_case_says_so(plain):
    study, _ = plain
    as_effect, as_error = (
        parameters_at(study, 6e-7, [("face_depth", "left", {"depth": 0.004})]),
        parameters_at(study, 6e-7),
    )
    left, right = faces = study.parameters.of_kind("face_position")
    as_error = as_error.with_values({left: 0.004})
    assert_array_equal(predict(study.model, as_error, True), predict(study.model, as_effect, True))
    assert not set(faces) & set(study.estimated_names(()))
    uncertain = diagnosis_problem(replace(study.case, record=replace(study.case.record, face_position_std=0.002)))
    assert set(faces) <= set(uncertain.estimated_names(()))
    assert_array_equal(uncertain.parameters.prior_std[uncertain.parameters.indices(faces)], 0.002)
    effect = slot_of(study, "face_depth", "left")
    assert left not in uncertain.estimated_names((effect,)) and right in uncertain.estimated_names((effect,))


# ------------------------------------------------------------------------------------------------------ the physics

# Mesh and straight steps of the simulator's faces (2 min) leave 2e-4 K between it and the plain model, whose own
# mesh and monotone cubics over 10 min are in it; the same again may part their answers to an effect: under 0.5 % of
# the changes below, whose root mean square is 0.01 to 1 K. What is switched within a step is given 2 %: the model
# takes an hour's part of each interval and does not soften it by the 5 min that the simulator does, and a jump of the
# diffusivity inside a step is seen from the next sub-step on.
SMOOTH, SWITCHED = 0.005, 0.02

PHYSICS = [
    ("sensor_position", "T2", {"shift": 0.008}, SMOOTH),
    ("sensor_offset", "T1", {"offset": 0.3}, SMOOTH),
    ("sensor_gain", "T2", {"gain": 0.05}, SMOOTH),
    ("sensor_drift", "T3", {"rate": 0.2}, SMOOTH),
    ("sensor_lag", "T1", {"time_constant": 1800.0}, SMOOTH),
    ("sensor_lag", "T2", {"time_constant": 300.0}, SMOOTH),
    ("clock_shift", None, {"delay": 900.0}, SMOOTH),
    ("clock_shift", None, {"delay": -750.0}, SWITCHED),  # the last two rows lie beyond the record
    ("face_offset", "left", {"offset": 0.4}, SMOOTH),
    ("face_lag", "left", {"time_constant": 1200.0}, SMOOTH),
    ("face_lag", "right", {"time_constant": 600.0}, SMOOTH),
    ("face_depth", "left", {"depth": 0.006}, SMOOTH),
    ("face_depth", "right", {"depth": 0.006}, SMOOTH),
    ("surface_film", "left", {"film_length": 0.03}, SMOOTH),
    ("surface_film", "right", {"film_length": 0.01}, SMOOTH),
    ("solar_gain", "left", {"gain": 0.01}, SMOOTH),
    ("solar_gain", "right", {"gain": 0.01}, SMOOTH),
    ("layered_conductivity", None, {"log_ratio": 0.6, "interface": 0.083}, SMOOTH),
    ("layered_capacity", None, {"log_ratio": -0.6, "interface": 0.083}, SMOOTH),
    ("contact_resistance", None, {"thickness": 0.03, "place": 0.071}, SMOOTH),
    ("temperature_dependent_conductivity", None, {"slope": 0.01}, SMOOTH),
    ("temperature_dependent_capacity", None, {"slope": -0.01}, SMOOTH),
    ("phase_change", None, {"area": 3.0, "temperature": 9.0}, SMOOTH),
    ("diffusivity_drift", None, {"rate": 0.2}, SMOOTH),
    ("wetting", None, {"jump": 0.5, "time_constant": DAY, "time": 1.3 * DAY}, SWITCHED),
    ("heat_source", None, {"rate": 2e-5}, SMOOTH),
    ("heat_source", None, {"rate": 1e-4, "place": 0.11}, SMOOTH),
    ("heat_source", None, {"rate": 5e-5, "hours": (22.0, 28.0)}, SWITCHED),
    ("heat_source", None, {"rate": 2e-4, "place": 0.08, "hours": (6.5, 13.0)}, SWITCHED),
    ("lateral_loss", "outdoor", {"rate": 1e-5}, SMOOTH),
    ("lateral_loss", "indoor", {"rate": 1e-5}, SMOOTH),
    ("air_flow", None, {"velocity": 3e-6}, SMOOTH),
    ("air_flow", None, {"velocity": -3e-6}, SMOOTH),
]


def simulated(folder, effects):
    """A study of a record with these effects in; the truth, with them and without, beside the face readings."""
    hidden = tuple((n, t, {k: v if k != "hours" else [h % 24 for h in v] for k, v in p.items()}) for n, t, p in effects)
    study, true = prepare(folder, replace(SPEC, effects=hidden))
    linear = all(slot_of(study, *effect).effect.linear for effect in ((n, t) for n, t, _ in effects))
    readings = np.stack([true["readings"][name] for name in SPEC.names], axis=1)

    def remainder(*given_):
        return (readings - predict(study.model, parameters_at(study, true["diffusivity"], given_), linear))[SETTLED:]

    return remainder(*effects), remainder(), linear


@pytest.fixture(scope="module")
def own(plain):
    """What parts the two plain models, by whether the package's goes through its exact or its stepped solver."""
    study, true = plain
    readings = np.stack([true["readings"][name] for name in SPEC.names], axis=1)
    parameters = parameters_at(study, true["diffusivity"])
    found = {linear: (readings - predict(study.model, parameters, linear))[SETTLED:] for linear in (True, False)}
    assert np.abs(found[True]).max() < 3e-4 and np.abs(found[False]).max() < 1e-3
    return found


@pytest.mark.parametrize(("name", "target", "parameters", "share"), PHYSICS)
def test_an_effect_does_what_it_does_in_the_equation(tmp_path, own, name, target, parameters, share):
    """With it in, the model follows the true readings as closely as the plain model follows the plain truth."""
    within, without, linear = simulated(tmp_path, [(name, target, parameters)])
    change = rms(without)
    assert change > 0.005, "the case shows the effect"
    assert rms(within - own[linear]) < share * change


OTHERS = [
    ("layered_capacity", None, {"log_ratio": -0.4, "interface": 0.083}),
    ("solar_gain", "left", {"gain": 0.005}),
    ("heat_source", None, {"rate": 2e-5}),
    ("lateral_loss", "outdoor", {"rate": 3e-6}),
    ("sensor_lag", "T1", {"time_constant": 900.0}),
    ("sensor_drift", "T3", {"rate": 0.1}),
    ("face_offset", "left", {"offset": 0.3}),
]
JOINED = [
    ("layered_conductivity", None, {"log_ratio": 0.5, "interface": 0.083}),
    ("contact_resistance", None, {"thickness": 0.02, "place": 0.13}),
    *OTHERS,
]
BLOWN = [("surface_film", "right", {"film_length": 0.01}), ("air_flow", None, {"velocity": 5e-7}), *OTHERS]
STEPPED = [
    ("temperature_dependent_conductivity", None, {"slope": 0.008}),
    ("phase_change", None, {"area": 2.0, "temperature": 9.0}),
    ("diffusivity_drift", None, {"rate": 0.1}),
    ("layered_capacity", None, {"log_ratio": -0.4, "interface": 0.083}),
    ("heat_source", None, {"rate": 2e-5}),
    ("sensor_position", "T2", {"shift": -0.004}),
]


@pytest.mark.parametrize("effects", [JOINED, BLOWN, STEPPED])
def test_effects_together_do_what_they_do_together_in_the_equation(tmp_path, own, effects):
    within, without, linear = simulated(tmp_path, effects)
    assert rms(within - own[linear]) < SMOOTH * rms(without)


def test_the_heating_column_times_the_rate_is_a_source(plain):
    """Against the simulator with no shape in time: the logged column stands in for its hours."""
    study, _ = plain
    spec = SPEC
    drive = truth.weather(spec, truth.spin_up(spec))
    step, rate = 120.0, 4e-5
    level = drive["heating"] / study.record.regressors["heating"].max()
    slab = truth.Slab(spec)
    # dT/dt = A T + rate c(t), the faces taken out, by implicit midpoints of 2 min
    conductance = spec.diffusivity / slab.path
    A = (
        np.diag(-(conductance[1:] + conductance[:-1]) / slab.width)
        + np.diag(conductance[1:-1] / slab.width[:-1], 1)
        + np.diag(conductance[1:-1] / slab.width[1:], -1)
    )
    whole = np.linalg.inv(np.eye(len(A)) - 0.5 * step * A)
    advance, enter = whole @ (np.eye(len(A)) + 0.5 * step * A), whole @ np.full(len(A), step * rate)
    first = round(-drive["time"][0] / step)
    T, course = np.zeros(len(A)), []
    read = slab.reading(spec.positions)[:, 1:-1]
    for i in range(first, first + int(spec.days * DAY / step)):
        course.append(read @ T)
        T = advance @ T + enter * 0.5 * (level[i] + level[i + 1])
    want = np.array(course)[:: round(spec.step / step)][SETTLED:]
    (slot,) = (slot for slot in study.library if slot.effect.variant == "with the heating")
    parameters = parameters_at(study, spec.diffusivity)
    with_source = parameters.with_values({slot.names[0]: rate})
    got = (predict(study.model, with_source, True) - predict(study.model, parameters, True))[SETTLED:]
    assert rms(got - want) < 2 * SMOOTH * rms(want), "the column is known at its rows only"


@given(
    start=st.floats(-6, 30),
    width=st.floats(0.2, 20),
    first=st.floats(0, 23.9),
)
@settings(max_examples=12)
def test_hours_of_the_day_are_shared_among_the_rows(campaign, start, width, first):
    """Against a count of the minutes."""
    step, rows, parts = 1800.0, 60, 450
    hour = (first + np.arange(rows) * step / HOUR) % 24
    driven = eqx.tree_at(
        lambda c: (c.step, c.hour, c.faces), campaign, (jnp.asarray(step), jnp.asarray(hour), jnp.zeros((rows, 4, 2)))
    )
    fine = (hour[:, None] + (np.arange(parts) + 0.5) / parts * step / HOUR - start) % 24
    want = (fine < width).mean(axis=1)
    got = np.asarray(hours_signal(driven, jnp.asarray(start), jnp.asarray(start + width)))
    assert_allclose(got[:, 0], want, rtol=0, atol=2.01 / parts)
    assert not np.any(got[:, 1:])


def test_the_bump_of_a_phase_change_has_its_area(campaign):
    T = np.linspace(-6.0, 10.0, 40001)
    latent = PhaseChange(area=3.5, temperature=1.2).apply(Terms.plain(campaign), campaign).latent
    bump = np.asarray(latent_capacity(latent, jnp.asarray(T)))
    assert_allclose(np.trapezoid(bump, T), 3.5, rtol=1e-10)
    assert_allclose(np.trapezoid(bump * T, T) / 3.5, 1.2, rtol=1e-10)


# ---------------------------------------------------------------------------------------------------- composition

SIZES = st.floats(0.1, 1.0)


def _signed(kind, field, scale, **fixed):
    return st.builds(lambda size, sign: kind(**{field: size * sign * scale}, **fixed), SIZES, st.sampled_from([-1, 1]))


def _positive(kind, field, scale, **fixed):
    return st.builds(lambda size: kind(**{field: size * scale}, **fixed), SIZES)


ANY = st.one_of(
    _signed(SensorPosition, "shift", 0.005, sensor=1),
    _positive(SensorLag, "time_constant", 900.0, sensor=0),
    _signed(SensorOffset, "offset", 0.3, sensor=2),
    _signed(SensorGain, "gain", 0.1, sensor=1),
    _signed(SensorDrift, "rate", 0.1, sensor=0),
    _signed(ClockShift, "delay", 900.0),
    _signed(FaceOffset, "offset", 0.5, side="right"),
    _positive(FaceLag, "time_constant", 900.0, side="left"),
    _positive(FaceDepth, "depth", 0.01, side="left"),
    _signed(SolarGain, "gain", 0.01, side="left"),
    _positive(SurfaceFilm, "film_length", 0.03, side="right"),
    _signed(LayeredConductivity, "log_ratio", 0.7, interface=0.077),
    _signed(LayeredCapacity, "log_ratio", 0.7, interface=0.12),
    _positive(ContactResistance, "thickness", 0.05, place=0.093),
    _signed(UniformSource, "rate", 1e-5),
    _signed(PlacedSource, "rate", 1e-4, place=0.07),
    _signed(HourlySource, "rate", 1e-4, start=3.0, end=9.5),
    _positive(LateralLoss, "rate", 1e-5, air="indoor"),
    _signed(AirFlow, "velocity", 1e-6),
    _signed(TemperatureDependentConductivity, "slope", 0.01),
    _signed(TemperatureDependentCapacity, "slope", 0.01),
    _positive(PhaseChange, "area", 4.0, temperature=9.0),
    _signed(DiffusivityDrift, "rate", 0.05),
    _signed(WettingByRain, "jump", 0.4, time=DAY),
)


def everything(effects, campaign):
    """All that the wall, its inputs and its sensors are with these effects in."""
    terms = Terms.plain(campaign)
    for effect in effects:
        terms = effect.apply(terms, campaign)
    wall = build_cells(terms, campaign)
    T = jnp.linspace(5.0, 15.0, 21)
    t = np.linspace(0.0, 3 * DAY, 13)
    pace = np.ones_like(t)
    for event in terms.wettings:
        assert isinstance(event, Wetting)
        since = t - float(event.time)
        pace *= 1 + np.where(since >= 0, float(event.jump) * np.exp(-since / float(event.time_constant)), 0.0)
    return {
        "places": wall.positions,
        "resistance": wall.resistance,
        "capacity": wall.capacity,
        "advection": wall.advection,
        "loss": wall.loss,
        "state": wall.state_to_readings,
        "face": wall.faces_to_readings,
        "faces": wall.inputs[..., :2],
        "heat": jnp.einsum("nc,ipc->ipn", wall.heat_input_matrix, wall.inputs[..., 2:]),
        "latent": latent_capacity(terms.latent, T),
        "pace": pace * (1 + float(terms.drift) * t / DAY),
    } | {
        name: getattr(terms, name)
        for name in ("conductivity_slope", "capacity_slope", "lag", "delay", "gain", "offset", "rate")
    }


@given(effects=st.lists(ANY, min_size=2, max_size=6), random=st.randoms(use_true_random=False))
@settings(max_examples=15)
def test_effects_compose_in_any_order(campaign, effects, random):
    shuffled = effects.copy()
    random.shuffle(shuffled)
    one, other = everything(effects, campaign), everything(shuffled, campaign)
    for name, value in one.items():
        size = float(np.max(np.abs(value)))
        assert_allclose(other[name], value, rtol=1e-12, atol=1e-13 * size, err_msg=name)


def test_the_order_of_the_library_does_not_matter(plain):
    """The whole of it, each effect at a fifth of its typical size, forward and backward."""
    study, _ = plain
    parameters = sized(study, 0.2)
    backward = tuple(reversed(study.model.effects))
    turned = eqx.tree_at(lambda model: model.effects, study.model, backward)
    one, other = predict(study.model, parameters, True), predict(turned, parameters, True)
    assert rms(one - predict(study.model, study.parameters, True)) > 0.05
    assert_allclose(other, one, rtol=0, atol=1e-9)


def test_two_effects_of_a_kind_add_up(campaign):
    twice = [SensorOffset(sensor=1, offset=0.2), SensorOffset(sensor=1, offset=0.1)]
    terms = Terms.plain(campaign)
    for effect in (*twice, ContactResistance(0.01, 0.08), ContactResistance(0.02, 0.12)):
        terms = effect.apply(terms, campaign)
    assert_allclose(terms.offset, [0.0, 0.3, 0.0])
    wall = build_cells(terms, campaign)
    joined = np.asarray(wall.resistance) / np.asarray(campaign.resistance)
    assert_allclose((joined / joined.min() - 1).sum() * campaign.resistance[0], 0.03, rtol=1e-10)
    assert_allclose(wall.resistance.sum(), campaign.length, rtol=1e-14), "the effective resistance stays"


# ----------------------------------------------------------------------------------------------------- derivatives


def sized(study, share):
    """Every effect at this share of its typical size, places and hours off the nodes and the rows."""
    values = {"profile_mode[1]": 0.5, "profile_mode[2]": -0.2, "profile_mode[3]": 0.1}
    where = {"interface": 0.0853, "place": 0.1127, "temperature": 8.3, "start": 6.53, "end": 13.21}
    where |= {"time_constant": 0.9 * DAY, "time": 0.7131 * DAY}
    for slot in study.library:
        for name, parameter in zip(slot.names, slot.effect.parameters, strict=True):
            values[name] = share * parameter.scale if parameter.is_size else where[parameter.name]
    return parameters_at(study, 7e-7).with_values(values)


def difference(study, parameters, name, step, linear, *, sided=False):
    """The binned predictions' derivative by differences of second order."""

    def at(size):
        moved = parameters.with_values({name: parameters[name] + size})
        return np.asarray(study.bins.mean(predict(study.model, moved, linear)))

    if sided:
        return (4 * at(step) - 3 * at(0.0) - at(2 * step)) / (2 * step)
    return (at(step) - at(-step)) / (2 * step)


def test_every_parameter_has_its_derivative(plain):
    """Against central differences, all effects in; their error is the step's square and the round-off over it."""
    study, _ = plain
    parameters = sized(study, 0.3)
    chosen = ["log_diffusivity", "profile_mode[1]", "profile_mode[4]", "sensor_position[T2]", "sensor_offset[T3]"]
    chosen += [name for slot in study.library for name in slot.names]
    value, slopes = linearise(study.model, study.bins, parameters, chosen, linear=False)
    assert_allclose(value, predict(study.model, parameters, False), rtol=0, atol=1e-10)
    for name, slope in zip(chosen, slopes, strict=True):
        index = study.parameters.index(name)
        step = 2e-4 * (float(study.parameters.scale[index]) if study.parameters.prior_std[index] > 0 else 0.1)
        want = difference(study, parameters, name, step, False)
        error = np.linalg.norm(slope - want)
        assert error < 1e-5 * np.linalg.norm(want) + 1e-9 / step, name


def test_the_first_order_of_every_effect(plain):
    """By one linear solve: against differences of the prediction.

    The stepped one of effects that are not linear leaves a few in a thousand, by its own time step; so does a
    source that is a straight line between rows.
    """
    study, _ = plain
    parameters = sized(study, 0.0)
    linear = parameters_at(study, 7e-7, [*JOINED[:2], BLOWN[1]])
    places = parameters
    for slot in study.library:
        if slot.effect.linear:
            parameters = parameters.with_values({name: linear[name] for name in slot.names})
    slots = [slot for slot in study.library if parameters[slot.names[0]] == 0.0]
    assert len(slots) > len(study.library) - 4
    points = [{name: float(places[name]) for name in slot.names} for slot in slots]
    candidates = [(slot.names[0], point) for slot, point in zip(slots, points, strict=True)]
    found = first_order_columns(study.model, study.bins, parameters, candidates)
    for slot, point, column in zip(slots, points, found, strict=True):
        parameter = slot.effect.parameters[0]
        sided = parameter.lower == 0.0
        step = (1e-3 if slot.effect.linear else 1e-2) * parameter.scale
        at = parameters.with_values(point)
        want = difference(study, at, slot.names[0], step, slot.effect.linear, sided=sided)
        # without the first six hours: a straight start bends within seconds, which lines of 10 min make too much of
        column, want = (part.reshape(study.sensor_count, -1)[:, 36:] for part in (column, want))
        assert np.linalg.norm(column - want) < 6e-3 * np.linalg.norm(want) + 1e-9 / step, study.label(slot.effect)


def test_a_new_value_is_not_compiled_anew(campaign):
    """Parameters are arrays, so that a search runs in one compilation."""
    traced = 0

    @eqx.filter_jit
    def last(effect):
        nonlocal traced
        traced += 1
        terms = effect.apply(Terms.plain(campaign), campaign)
        return simulate_readings(terms, campaign, jnp.asarray(5e-7), jnp.zeros(8), linear=True)[-1]

    results = [last(SensorOffset(sensor=0, offset=offset)) for offset in (0.0, 0.25, 1)]
    assert traced == 1
    assert_allclose(results[1][0] - results[0][0], 0.25, atol=1e-12)
    assert jax.tree.leaves(SensorOffset(sensor=0, offset=1))[0].dtype == jnp.float64
