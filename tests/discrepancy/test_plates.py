"""Heat flux plates as readings of a diagnosis: against the independent simulator, differences, and drawn scores."""

from dataclasses import replace

import equinox as eqx
import numpy as np
import pytest
from benchmarks.reference.simulator_with_effects import DAY, Hidden, write_case
from measured_walls import london
from numpy.testing import assert_allclose
from scipy.interpolate import PchipInterpolator
from studies import SPEC, parameters_at, prepare, slot_of

import wallid
from wallid.discrepancy.effect_fit import linearised_at
from wallid.discrepancy.effects.catalogue import library, untestable
from wallid.discrepancy.model_with_effects import face_change_response, first_order_columns, linearise, predict
from wallid.discrepancy.next_measurement.added_sensor import added_sensors
from wallid.discrepancy.next_measurement.present_record import PresentRecord
from wallid.discrepancy.problem import diagnosis_problem
from wallid.discrepancy.selection.candidate_fits import plain_model_of
from wallid.discrepancy.selection.chance_gains import ChanceGains
from wallid.models.flux_plates import faces_of_model
from wallid.records.face_variation import FaceErrors

WITH_PLATES = replace(SPEC, plates=("left", "right"), flux_noise_std=1e-6)
SETTLED = slice(36, None)  # rows after the first six hours
WETTED = 1.3 * DAY  # from a row on; the jump of the model takes half an hour
# of the change by an effect, or of the flux itself: meshes and straight steps of 2 min part both models
SMOOTH, SWITCHED = 0.01, 0.04

PHYSICS = [
    ("plate_gain", "left", {"gain": -0.2}, SMOOTH),
    ("plate_offset", "right", {"offset": 3.0}, SMOOTH),
    ("plate_lag", "left", {"time_constant": 1200.0}, SMOOTH),
    ("plate_lag", "right", {"time_constant": 300.0}, 2 * SMOOTH),
    ("plate_resistance", "left", {"resistance": 0.01}, SMOOTH),
    ("plate_resistance", "right", {"resistance": 0.02}, SMOOTH),
    ("surface_film", "left", {"film_length": 0.03}, SMOOTH),
    ("face_offset", "left", {"offset": 0.4}, SMOOTH),
    ("face_depth", "left", {"depth": 0.006}, 2 * SMOOTH),
    ("solar_gain", "left", {"gain": 0.01}, SMOOTH),
    ("layered_conductivity", None, {"log_ratio": 0.6, "interface": 0.083}, SMOOTH),
    ("layered_capacity", None, {"log_ratio": -0.6, "interface": 0.083}, SMOOTH),
    ("contact_resistance", None, {"thickness": 0.03, "place": 0.071}, SMOOTH),
    ("temperature_dependent_conductivity", None, {"slope": 0.01}, 2 * SMOOTH),
    ("temperature_dependent_capacity", None, {"slope": -0.01}, 2 * SMOOTH),
    ("diffusivity_drift", None, {"rate": 0.2}, SMOOTH),
    ("wetting", None, {"jump": 0.5, "time_constant": DAY, "time": WETTED}, SWITCHED),
    ("heat_source", None, {"rate": 2e-5}, SMOOTH),
    ("lateral_loss", "indoor", {"rate": 1e-5}, SMOOTH),
    ("air_flow", None, {"velocity": 3e-6}, 2 * SMOOTH),
]


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def at_truth(study, true, effects=(), spec=WITH_PLATES):
    """The parameters with everything true of a record, its conductivity included."""
    conductivity = spec.length / true["resistance"]
    reference = float(study.model.reference_conductivity)
    return parameters_at(study, true["diffusivity"], effects).with_values(
        {"log_conductivity": np.log(conductivity / reference)}
    )


def fluxes_of(study, true, effects, spec):
    linear = all(slot_of(study, name, target).effect.linear for name, target, _ in effects)
    parameters = at_truth(study, true, effects, spec)
    return np.asarray(predict(study.model, parameters, linear))[SETTLED, study.sensor_count :]


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return prepare(tmp_path_factory.mktemp("plain"), WITH_PLATES)


def test_the_fluxes_of_a_plain_wall(plain):
    """Against finite volumes of another mesh."""
    study, true = plain
    want = true["fluxes"][SETTLED]
    assert study.instruments == ("T1", "T2", "T3", "flux_left", "flux_right")
    assert rms(fluxes_of(study, true, (), WITH_PLATES) - want) < 0.0008 * rms(want)


@pytest.mark.parametrize(("name", "target", "parameters", "share"), PHYSICS)
def test_an_effect_changes_the_fluxes_as_the_equation_says(tmp_path, plain, name, target, parameters, share):
    """With it in, the model follows the true fluxes as closely as the plain model follows the plain truth."""
    base, true_plain = plain
    own = true_plain["fluxes"][SETTLED] - fluxes_of(base, true_plain, (), WITH_PLATES)
    spec = replace(WITH_PLATES, effects=(Hidden(name, target, parameters),))
    study, true = prepare(tmp_path, spec)
    fluxes = true["fluxes"][SETTLED]
    within = fluxes - fluxes_of(study, true, [(name, target, parameters)], spec)
    if name == "wetting":
        within[np.abs(study.record.time[SETTLED] - WETTED) < 3600.0] = 0.0
    change = rms(fluxes - fluxes_of(study, true, (), spec))
    assert change > 0.1, "W/m2: the case shows the effect"
    assert rms(within - own) < share * change + 0.0002 * rms(fluxes)


def test_another_sensor_beside_plates_leaves_the_noise_of_the_others(plain):
    """What faces do between their rows is in it."""
    study, _ = plain
    noise = study.noise_shape(study.parameters).stated_covariance()
    present = PresentRecord((linearised_at(study, (), study.parameters, noise),))
    (added,) = added_sensors(present, [0.4 * SPEC.length])
    of_all = np.linalg.inv(added.whitening.T @ added.whitening)
    own = np.linalg.inv(noise.whitening.T @ noise.whitening)
    std = np.sqrt(np.diag(own))
    assert_allclose(of_all[: len(own), : len(own)] / np.outer(std, std), own / np.outer(std, std), atol=1e-4)


def test_every_parameter_changes_the_fluxes_by_its_derivative(plain):
    """Against central differences, and the first order of the score test against both."""
    study, true = plain
    parameters = at_truth(study, true)
    chosen = ["log_conductivity", "plate_gain[left]"]
    chosen += [slot.names[0] for slot in study.library if slot.effect.linear and slot.effect.parameters[0].lower != 0.0]
    _, slopes = linearise(study.model, study.bins, parameters, chosen, linear=True)
    effects = [name for name in chosen if name.startswith("effect.")]
    first_order = dict(
        zip(
            effects,
            first_order_columns(study.model, study.bins, parameters, [(name, {}) for name in effects]),
            strict=True,
        )
    )
    for name, slope in zip(chosen, slopes, strict=True):
        step = 2e-4 * float(study.parameters.scale[study.parameters.index(name)])
        high, low = (
            np.asarray(
                study.bins.mean(predict(study.model, parameters.with_values({name: parameters[name] + s}), True))
            )
            for s in (step, -step)
        )
        want = (high - low) / (2 * step)
        assert np.linalg.norm(slope - want) < 1e-5 * np.linalg.norm(want) + 1e-8 / step, name
        if name in first_order:
            column, slope = (
                part.reshape(study.instrument_count, -1)[:, SETTLED] for part in (first_order[name], slope)
            )
            assert np.linalg.norm(column - slope) < 6e-3 * np.linalg.norm(slope) + 1e-9, name


def test_a_lag_smooths_what_a_plate_has_of_the_faces_errors(plain):
    """The noise of the faces goes through the wall and then through the plate."""
    study, true = plain
    rough = replace(study.case.record, boundary_noise_std=0.1)
    noisy = diagnosis_problem(replace(study.case, record=rough))
    without, with_lag = (
        noisy.noise_shape(at_truth(noisy, true, effects)).stated_rms_of_outputs()
        for effects in ((), [("plate_lag", "left", {"time_constant": 3600.0})])
    )
    assert with_lag[3] < 0.8 * without[3]
    assert_allclose(np.delete(with_lag, 3), np.delete(without, 3), rtol=1e-9)


def test_bends_between_the_rows_are_those_of_lines_instead_of_cubics(plain):
    """The readings with straight lines minus those with cubics, by two other simulations; the whole face is slow."""
    study, true = plain
    faces, step = study.record.faces, study.record.step
    errors = FaceErrors(np.zeros((2, 1)), np.ones((2, 1)), (0.5, 3.0))
    slow, fast = errors.bent_courses(faces, faces, step)
    assert not fast.any()
    change = 2.0 * np.stack([slow[0], slow[1]], axis=-1)
    parameters = at_truth(study, true)
    got = face_change_response(study.model, parameters, change[None])[0]
    lines = np.stack([faces[:-1], np.diff(faces, axis=0), 0 * faces[1:], 0 * faces[1:]], axis=1)
    straight = eqx.tree_at(lambda m: m.forcing.faces, study.model, lines)
    cubics = np.moveaxis([PchipInterpolator(np.arange(len(face)), face).c[::-1].T for face in faces.T], 0, -1)
    curved = eqx.tree_at(lambda m: m.forcing.faces, study.model, cubics)
    want = predict(straight, parameters, True) - predict(curved, parameters, True)
    assert_allclose(got, np.asarray(want), rtol=0, atol=1e-9 * np.abs(faces).max() + 1e-6 * np.abs(want).max())


def test_what_is_uncertain_in_the_faces_filter_is_in_the_noise(plain):
    """Each direction of each face as a change of that face alone, without jumps at the rows."""
    study, _ = plain
    record = study.case.record
    courses = record.face_filter.courses_of_deviations(record.faces, record.step)
    responses = study.responses_to_face_errors(study.parameters)
    changes = study._changed_faces[4:]
    assert len(changes) == 6 == len(responses.shared) - 4
    for change, (direction, side) in zip(changes, np.ndindex(3, 2), strict=True):
        course = courses[direction, side]
        assert not change[..., 1 - side].any()
        assert_allclose(change[:, 0, side], course[:-1], atol=1e-12)
        assert_allclose(change[..., side].sum(axis=1), course[1:], atol=1e-12)
    assert np.all(np.abs(responses.shared[4:, :, 3:]).max(axis=(1, 2)) > 0.0)


def test_effects_of_plates_need_their_plates():
    def of_plates(logged):
        return {(one.name, one.target) for one in library(2, logged) if one.name.startswith("plate_")}

    names = ("plate_offset", "plate_lag", "plate_resistance")
    assert of_plates(()) == set() and "plate_gain" not in untestable(2, ())
    assert of_plates(("flux_left",)) == {(name, "left") for name in names}
    assert untestable(2, ("flux_left",))["plate_gain"] == ("flux_right",)
    both = of_plates(("flux_left", "flux_right"))
    assert both == {(name, face) for name in (*names, "plate_gain") for face in ("left", "right")}
    assert "plate_gain" not in untestable(2, ("flux_left", "flux_right"))


@pytest.mark.parametrize("spread", [0.0, 0.6])
def test_what_rests_on_priors_is_surer(spread):
    """Weights by drawn scores: with its own weight each is the largest as rarely, whatever part is the priors'."""
    rng = np.random.default_rng(0)
    prior = np.array([0.0, 0.4, 1.0])
    chance = ChanceGains(np.eye(3), np.diag(prior), np.zeros(3), spread, rng)
    draws, size = rng.standard_normal((2, 400_000, 3)), np.exp(0.5 * spread * rng.standard_normal((400_000, 1)))
    scores = size * np.sqrt(1 - prior) * draws[0] + np.sqrt(prior) * draws[1]
    rare = np.quantile(scores**2, 0.999, axis=0)
    assert_allclose(chance.weight, rare[0] / rare, rtol=0.06)
    assert chance.weight[0] == 1.0
    largest = (chance.weight * scores**2).max(axis=1)
    assert_allclose(chance.threshold(0.05), np.quantile(largest, 0.95), rtol=0.12)
    assert chance.p_value(np.quantile(largest, 0.9)) == pytest.approx(0.1, abs=0.025)


# ------------------------------------------------------------------------------------------------- the diagnosis

# one shape with sensors, one without: each is compiled anew
CAMPAIGN = replace(
    SPEC,
    length=0.3,
    diffusivity=5e-7,
    positions=(),
    step=1800.0,
    days=14.0,
    weather_seed=7001,
    noise_seed=7001,
    noise_std=0.05,
    boundary_noise_std=0.05,
    rounding=0.01,
    misplaced=True,
    plates=("left", "right"),
    flux_noise_std=0.3,
)


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    """The diagnosis of a record with an effect hidden in it, and what is true of it."""

    def find(*effects, **changes):
        spec = replace(CAMPAIGN, effects=tuple(Hidden(*one) for one in effects), **changes)
        folder = tmp_path_factory.mktemp("case")
        true = write_case(spec, folder)["truth"]
        return wallid.diagnose(wallid.load(folder)), true

    return find


def names(found):
    return [
        (one["name"], one["target"], {(other["name"], other["target"]) for other in one["alternatives"]})
        for one in found.to_dict()["effects"]
    ]


def inside(quantity, value):
    low, high = quantity.interval_95
    return low < value < high


def test_a_wall_with_plates_alone(diagnosed):
    """Nothing is missing; the resistance and the capacity are in their intervals; the gap is that of the fluxes."""
    found, true = diagnosed()
    entries = found.to_dict()
    assert found.verdict == "adequate", str(found)
    resistance, capacity = true["resistance"], 0.3**2 / (true["resistance"] * true["diffusivity"])
    assert inside(found.quantities["resistance"], resistance)
    assert inside(found.quantities["areal_heat_capacity"], capacity)
    assert entries["gap"] is None and 0.1 < entries["flux_gap"]["after_W_per_m2"] < 1.0
    assert entries["transmittance"]["value"] == pytest.approx(1 / (entries["resistance"]["value"] + 0.17))
    assert "the resistance" in found.sentence and "W/m2" in found.sentence


@pytest.mark.slow
def test_the_gain_of_one_of_two_plates_cannot_be_told_from_that_of_the_other(diagnosed):
    found, true = diagnosed(("plate_gain", "left", {"gain": -0.3}))
    assert found.verdict == "confusable"
    assert names(found) == [("plate_gain", "left", {("plate_gain", "right")})] or names(found) == [
        ("plate_gain", "right", {("plate_gain", "left")})
    ]
    assert inside(found.quantities["resistance"], true["resistance"]), "the interval spans both"
    assert not any(action.kind == "flux_plate" for one in found.prescriptions for action in one.actions)


def test_the_faces_are_filtered_for_the_noise_that_the_sensors_show(tmp_path):
    """Its memory is that of the drawn noise, and the model's faces are the readings filtered for it."""
    spec = replace(CAMPAIGN, positions=(0.1, 0.2), plates=("left",), noise="ar09")
    write_case(spec, tmp_path)
    case = wallid.load(tmp_path)
    fits, plain = plain_model_of(diagnosis_problem(case))
    memory = fits.problem.case.record.noise_memory
    assert memory.share > 0.8 and memory.correlation == pytest.approx(0.9, abs=0.1)
    faces, _ = faces_of_model(replace(case, record=case.record.with_noise_memory(memory)))
    at_rows = np.asarray(plain.problem.model.forcing.faces)[:, 0]
    assert_allclose(at_rows, faces[: len(at_rows)], atol=1e-9)
    assert not np.allclose(at_rows, faces_of_model(case)[0][: len(at_rows)], atol=1e-3)


def test_an_offset_of_a_plate_is_named(diagnosed):
    found, true = diagnosed(("plate_offset", "right", {"offset": 2.0}))
    assert found.verdict == "named" and names(found) == [("plate_offset", "right", set())]
    value, std = found.effects[0].values["offset"]
    assert abs(value - 2.0) < 4 * std and std < 0.5
    assert inside(found.quantities["resistance"], true["resistance"])


@pytest.mark.slow
def test_a_resistance_before_the_wall_is_a_film_or_a_plates(diagnosed):
    """Both have the same equation, so the verdict names both: the plate's first, for no film of air is as thin."""
    found, true = diagnosed(("plate_resistance", "left", {"resistance": 0.01}))
    assert found.verdict == "confusable"
    ((name, target, alternatives),) = names(found)
    assert (name, target) == ("plate_resistance", "left") and alternatives == {("surface_film", "left")}
    assert inside(found.quantities["diffusivity"], true["diffusivity"])


@pytest.mark.slow
def test_exchanged_plates_are_a_mixup(diagnosed, tmp_path):
    write_case(CAMPAIGN, tmp_path)
    case = wallid.load(tmp_path)
    columns = dict(case.record.regressors)
    columns["flux_left"], columns["flux_right"] = columns["flux_right"], columns["flux_left"]
    found = wallid.diagnose(replace(case, record=replace(case.record, regressors=columns)))
    assert [one.targets for one in found.mixups] == [("flux_left", "flux_right")]
    assert found.verdict == "named" and not found.effects


@pytest.mark.slow
def test_one_plate_beside_sensors(diagnosed):
    """Its gain has no trace, and the text says so; a lag of it has one."""
    shape = {"positions": (0.1, 0.2), "plates": ("left",)}
    found, true = diagnosed(("plate_lag", "left", {"time_constant": 1500.0}), **shape)
    assert found.verdict == "named" and names(found) == [("plate_lag", "left", set())]
    assert "cannot distinguish a gain of the left plate from another conductivity" in found.sentence
    assert inside(found.quantities["resistance"], true["resistance"])
    low, high = found.quantities["resistance"].interval_95
    assert high / low > np.exp(2 * 1.9 * 0.05), "no surer than the calibration"


@pytest.mark.slow
def test_the_london_wall_gets_a_verdict(measured):
    """Layers near both faces halve the residual; the resistance with them is that of the published fits."""
    found = wallid.diagnose(london(measured))
    assert found.verdict in ("named", "confusable", "unnamed")
    assert found.gap.after < 0.6 * found.gap.before and found.gap.held_out_after < 0.7 * found.gap.held_out_before
    resistance, capacity = found.quantities["resistance"], found.quantities["areal_heat_capacity"]
    assert 0.40 < resistance.value < 0.47 and 280e3 < capacity.value < 450e3
    low, high = resistance.interval_95
    assert low < 0.42 and high > 0.46
