"""What to measure next: added sensors against a case that has them, changed faces, and the search."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pvlib
import pytest
import scipy
from benchmarks.reference.simulator_with_effects import Hidden, Spec, write_case
from hypothesis import given
from hypothesis import strategies as st

import wallid
from wallid.case.options import ACTIONS, Choices
from wallid.case.planned_campaign import CampaignSettings
from wallid.discrepancy import search_for_effects
from wallid.discrepancy.effect_fit import linearised_at, refit
from wallid.discrepancy.model_with_effects import predict
from wallid.discrepancy.next_measurement import added_instrument, candidate_records, changed_faces, refits, search
from wallid.discrepancy.next_measurement.actions import (
    EFFORTS,
    Action,
    Prescription,
    best_actions,
    best_of,
    not_probable_enough,
    score,
)
from wallid.discrepancy.next_measurement.added_instrument import RecordWithFirstSensor, RecordWithPlate
from wallid.discrepancy.next_measurement.added_sensor import added_sensors
from wallid.discrepancy.next_measurement.candidate_records import LongerRecord, RecordWithSensor, records_with_sensor
from wallid.discrepancy.next_measurement.changed_records import (
    HeatedRecord,
    SwappedRecord,
    changed_records,
    swapped_records,
)
from wallid.discrepancy.next_measurement.confusable_sets import ConfusableSet, confusable_sets
from wallid.discrepancy.next_measurement.informative_records import open_diffusivities
from wallid.discrepancy.next_measurement.other_weather import SAME_WEATHER
from wallid.discrepancy.next_measurement.present_record import PresentRecord, explanation_of
from wallid.discrepancy.next_measurement.refits import refits_without_noise, refitted_separations
from wallid.discrepancy.next_measurement.search import what_to_measure
from wallid.discrepancy.next_measurement.unlogged_columns import typical_courses, unlogged_columns
from wallid.discrepancy.problem import diagnosis_problem
from wallid.discrepancy.record_forcing import hours_of_day
from wallid.discrepancy.selection.candidate_fits import CandidateFits
from wallid.discrepancy.selection.effect_results import Trial
from wallid.inference import noise_covariance
from wallid.records.weather_year import read_weather_year

SPEC = Spec(
    length=0.4,
    diffusivity=8e-7,
    positions=(0.1, 0.3),
    step=3600.0,
    days=8.0,
    weather_seed=11,
    noise_std=0.05,
    boundary_noise_std=0.05,
    noise_seed=5,
    position_std=0.002,
    offset_std=0.05,
    effects=(Hidden("surface_film", "left", {"film_length": 0.05}),),
)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """A diagnosis with a film, as if the depth of the face's sensor explained the record as well."""
    folder = tmp_path_factory.mktemp("case")
    write_case(SPEC, folder)
    diagnosis = wallid.diagnose(wallid.load(folder))
    named = diagnosis.effects[0]
    (depth,) = [
        one for one in diagnosis.problem.library if diagnosis.problem.label(one.effect) == "depth of the left face"
    ]
    start = diagnosis.after.parameters.with_values({named.effect_parameters.names[0]: 0.0})
    other = refit(diagnosis.problem, (depth,), start, diagnosis.after.noise)
    doubted = replace(named, alternatives=(depth,), exchanged=(other,))
    return replace(diagnosis, effects=(doubted,), rivals=(other,))


@pytest.mark.parametrize(("most", "rows_per_bin"), [(1500, 1), (450, 2)])
def test_an_added_sensor_reads_what_a_case_with_it_predicts(found, monkeypatch, most, rows_per_bin):
    """Where the readings with it are too many, in longer bins than those of the present 384."""
    monkeypatch.setattr(noise_covariance, "MAX_READINGS", most)
    (confusable,) = confusable_sets(found)
    (added,) = added_sensors(confusable.present, [0.22])
    record = RecordWithSensor(confusable.present, added)
    problem, fit = record.problem, confusable.present.fits[0]
    assert (fit.problem.bins.rows_per_bin, problem.bins.rows_per_bin) == (1, rows_per_bin)
    assert [sensor.name for sensor in problem.case.sensors][:2] == ["T1", "T2"] and len(problem.case.sensors) == 3
    values = {name: float(fit.parameters[name]) for name in fit.parameters.names}
    active = tuple(one for one in problem.library if one.names == fit.active[0].names)
    shape = problem.noise_shape(problem.parameters.with_values(values))
    noise = shape.covariance_of(fit.noise.white, fit.noise.autocorrelated, fit.noise.correlation)
    exact = explanation_of(linearised_at(problem, active, problem.parameters.with_values(values), noise))
    mine = added.explanations[0]
    assert np.allclose(mine.predicted, exact.predicted, atol=1e-6)
    sums = [one.jacobian @ np.ones(one.jacobian.shape[1]) for one in (mine, exact)]
    assert np.allclose(*sums, rtol=1e-5, atol=1e-6)
    assert sorted(mine.prior_std) == pytest.approx(sorted(exact.prior_std))
    assert np.allclose(added.whitening, noise.whitening, rtol=1e-4, atol=1e-6)


def test_the_warming_of_a_heated_face_is_that_of_a_half_space():
    """Against finite differences of a thick wall by SciPy."""
    conductivity, diffusivity, cells, width = 0.9, 6e-7, 300, 0.005
    film = changed_faces._INDOOR_FILM

    def rate(_, T):
        flux = np.concatenate([[0.0], -conductivity * np.diff(T) / width, [0.0]])
        surface = T[0] + (changed_faces.HEATING_POWER - film * T[0]) / (film + 2 * conductivity / width)
        flux[0] = changed_faces.HEATING_POWER - film * surface
        return -np.diff(flux) / (width * conductivity / diffusivity)

    hours = np.array([0.5, 2.0, 6.0, 12.0])
    solved = scipy.integrate.solve_ivp(
        rate, (0, 12 * 3600), np.zeros(cells), method="BDF", t_eval=3600 * hours, rtol=1e-8
    )
    first = solved.y[0]
    surface = first + (changed_faces.HEATING_POWER - film * first) / (film + 2 * conductivity / width)
    assert changed_faces._warming(3600 * hours, conductivity, diffusivity) == pytest.approx(surface, rel=0.01)
    assert changed_faces._warming(np.array([-5.0, 0.0]), conductivity, diffusivity) == pytest.approx([0.0, 0.0])


def test_shade_and_heat_change_the_faces_alone(found):
    problem = found.problem
    shaded, heated = changed_faces.shaded(problem), changed_faces.heated(problem, 8e-7)
    half = problem.record.rows // 2
    sun = problem.record.regressors["irradiance"]
    assert shaded.record.regressors["irradiance"][half:].max() == 0.0
    assert np.array_equal(shaded.record.regressors["irradiance"][:half], sun[:half])
    lost = problem.record.faces[:, 0] - shaded.record.faces[:, 0]
    assert lost[half:] == pytest.approx(changed_faces.SUN_ON_FACE * sun[half:]) and lost[:half].max() == 0.0
    assert np.array_equal(heated.record.faces[:, 0], problem.record.faces[:, 0])
    warmer = heated.record.faces[:, 1] - problem.record.faces[:, 1]
    assert warmer.max() > 3.0 and warmer[: problem.record.rows // 3].max() == 0.0
    assert np.array_equal(heated.record.sensors, problem.record.sensors)


def test_a_heating_tells_the_same_in_any_weather(found):
    """Its twelve hours and the day after it, from a third of the eight days on; the faces' errors are those of now."""
    (confusable,) = confusable_sets(found)
    heated = HeatedRecord(confusable.present)
    first, second = np.split(heated.blocks(2 * 8 * 24), 2)
    assert np.array_equal(np.flatnonzero(first == SAME_WEATHER), 64 + np.arange(36)) and np.array_equal(first, second)
    present, repeat = confusable.present.whitening, LongerRecord(confusable.present, 1.0)
    changes = [np.linalg.norm(one - present) for one in (heated.whitening, repeat.own_whitening())]
    assert changes[0] > 10.0 * changes[1]


def test_forms_of_one_effect_are_no_rivals_of_each_other(found):
    """Heat in the entire wall and at one place is one answer; both are rivals of an offset."""
    by_label = {found.problem.label(one.effect): one for one in found.problem.library}
    chosen = ("heat source", "offset of the left face", "heat source (placed)", "offset of the right face")
    fits = [replace(found.before, active=(by_label[label],)) for label in chosen]
    effects = tuple(by_label[label] for label in chosen[:3])
    confusable = ConfusableSet(effects, PresentRecord((*fits, found.before)), chance_gain=15.0)
    assert [confusable.rivals_of(k) for k in range(3)] == [(1, 3, 4), (0, 2, 3, 4), (1, 3, 4)]
    assert confusable.distinct_effects == effects[:2]


def test_another_form_that_the_diagnosis_tried_is_a_possible_truth(found):
    """As if heat in the entire wall had been named, and heat at a place been tried."""
    by_label = {found.problem.label(one.effect): one for one in found.problem.library}
    entire, placed = by_label["heat source"], by_label["heat source (placed)"]
    start = found.before.parameters.with_values({placed.names[0]: 2e-5, placed.names[1]: 0.3 * SPEC.length})
    other = refit(found.problem, (placed,), start, found.after.noise)
    trials = (Trial(found.before, other, 0.0), Trial(found.before, replace(other, cost=1e9), 0.0))
    named = replace(found.effects[0], effect_parameters=entire, without=found.before)
    after = replace(found.after, active=(entire,), cost=other.cost)
    (confusable,) = confusable_sets(replace(found, effects=(named,), after=after, trials=trials))
    assert confusable.effects[0] is entire and confusable.effects[-1] is placed and len(confusable.effects) == 3
    fit = confusable.present.fits[2]
    assert fit.cost == pytest.approx(other.cost, abs=1e-3)
    lower, upper = (
        float(bound[fit.parameters.index(placed.names[1])]) for bound in (fit.parameters.lower, fit.parameters.upper)
    )
    open_share = min(np.sqrt(2.0 * np.pi) * fit.std(placed.names[1]) / (upper - lower), 1.0)
    by_cost = np.exp(-0.5 * (fit.cost - confusable.present.fits[0].cost))
    assert confusable.weights[2] / confusable.weights[0] == pytest.approx(by_cost * open_share)


def test_exchanged_sensors_read_each_others_places(found):
    """Offsets and lags go with the instrument; position errors stay at the place."""
    (confusable,) = confusable_sets(found)
    present = confusable.present
    swapped = SwappedRecord(present, ("T1", "T2"))
    fit, now, then = present.fits[0], present.explanations[0], swapped.explanations[0]
    bins = len(now.predicted) // 2
    first, second = slice(0, bins), slice(bins, None)
    offset = {name: float(fit.parameters[f"sensor_offset[{name}]"]) for name in ("T1", "T2")}
    assert then.predicted[first] - offset["T1"] == pytest.approx(now.predicted[second] - offset["T2"], abs=1e-9)
    assert then.predicted[second] - offset["T2"] == pytest.approx(now.predicted[first] - offset["T1"], abs=1e-9)
    names = fit.parameters.estimated_names
    place, instrument = names.index("sensor_position[T1]"), names.index("sensor_offset[T1]")
    assert (
        then.jacobian[second, place] == pytest.approx(now.jacobian[first, place])
        and not then.jacobian[first, place].any()
    )
    assert then.jacobian[first, instrument] == pytest.approx(1.0) and not then.jacobian[second, instrument].any()
    assert [one.pair for one in swapped_records(present)] == []  # no effect blames a sensor
    assert swapped.next_name("effect.sensor_position[T2].shift") == "effect.sensor_position[T1].shift"
    assert swapped.next_name("effect.sensor_lag[T2].time_constant") == "effect.sensor_lag[T2].time_constant"
    refitted = refitted_separations(confusable, swapped, refits_without_noise(confusable, swapped))
    assert np.isfinite(confusable.probability(refitted))


def test_an_exchanged_sensor_may_be_mistaken_for_another_face(tmp_path):
    """The offset of a sensor near one face is like one of this face; exchanged, like one of the other face."""
    offset = Hidden("sensor_offset", "T2", {"offset": 0.6})
    write_case(
        replace(SPEC, length=0.25, positions=(0.08, 0.17), days=20.0, offset_std=0.1, effects=(offset,)), tmp_path
    )
    problem = diagnosis_problem(wallid.load(tmp_path))
    by_label = {problem.label(one.effect): one for one in problem.library}
    own, face = by_label["sensor offset of T2"], by_label["offset of the right face"]
    noise = problem.noise_shape(problem.parameters).stated_covariance()
    without = refit(problem, (), problem.parameters, noise)
    fits = tuple(refit(problem, (one,), without.parameters, without.noise) for one in (own, face))
    confusable = ConfusableSet((own, face), PresentRecord((*fits, without)), chance_gain=15.0)
    (swapped,) = swapped_records(confusable.present)
    names = [one.names[0] for one in problem.library if len(one.names) == 1 and problem.is_linear((one,))]
    assert len(swapped.further) == len(names) - 2
    third = names.index("effect.face_offset[left].offset")
    third -= sum(names.index(one.names[0]) < third for one in (own, face))
    then = swapped.problem
    step = then.parameters.with_known_values(swapped.next_parameters(without).to_dict())
    shifted = step.with_values({"effect.face_offset[left].offset": 0.5})
    change = then.binned(np.asarray(predict(then.model, shifted, True)) - np.asarray(predict(then.model, step, True)))
    assert swapped.further[third].jacobian[:, -1] == pytest.approx(change / 0.5, abs=1e-7)
    with_all = confusable.probability(confusable.separations(swapped))
    without_further = SwappedRecord(confusable.present, swapped.pair)
    without_further.whitened_further = ()
    alone = confusable.probability(confusable.separations(without_further))
    assert with_all < 0.2 and alone > 0.8


@pytest.mark.parametrize(
    ("conductivity", "face", "is_like"), [(2.5, "left", True), (0.9, "left", False), (2.5, "right", False)]
)
def test_a_small_film_may_be_the_resistance_of_a_new_plate(found, conductivity, face, is_like):
    """A film of 5 cm has 0.02 m2 K/W in a wall of 2.5 W/m/K, as a plate may have, and 0.056 in one of 0.9."""
    case = found.problem.case
    problem = replace(found.problem, case=replace(case, wall=replace(case.wall, conductivity=conductivity)))
    (confusable,) = confusable_sets(replace(found, problem=problem))
    fits = tuple(replace(fit, problem=problem) for fit in confusable.present.fits)
    confusable = replace(confusable, present=PresentRecord(fits))
    record = RecordWithPlate(confusable.present, face)
    assert len(record.further) == is_like
    film, *_ = confusable.separations(record)
    if is_like:
        assert film.excess[:, -1] == pytest.approx(0.0, abs=1e-6)
        assert confusable.probability(confusable.separations(record)) <= confusable.weights[1]


def test_another_season_has_the_faces_of_the_typical_year(found, tmp_path):
    shutil.copy(Path(pvlib.__file__).parent / "data" / "723170TYA.CSV", tmp_path / "weather.csv")
    plan = CampaignSettings(weather=str(tmp_path / "weather.csv"), azimuth=180.0)
    problem = replace(found.problem, case=replace(found.problem.case, plan=plan))
    fits = tuple(replace(fit, problem=problem) for fit in (found.after, found.before))
    present = PresentRecord(fits)
    weather = read_weather_year(tmp_path / "weather.csv")
    seasons = [one for one in changed_records(present, weather) if one.kind == "season"]
    assert len(seasons) == 6 and seasons[0].parameters() == {"start": 1}
    winter, summer = seasons[0].problem.record, seasons[3].problem.record
    assert summer.faces[:, 0].mean() > winter.faces[:, 0].mean() + 8.0
    assert summer.regressors["irradiance"].max() > 100.0 and summer.rows == found.problem.record.rows
    assert all(np.isfinite(one.predicted).all() for one in seasons[3].explanations)
    assert abs(seasons[3].explanations[0].predicted.mean() - summer.faces.mean()) < 5.0


def typical_summer(case):
    """The problem of a case's record in a typical year from the end of June on."""
    weather = Path(pvlib.__file__).parent / "data" / "723170TYA.CSV"
    case = replace(case, plan=CampaignSettings(weather=str(weather), azimuth=180.0))
    problem = diagnosis_problem(case)
    return changed_faces.in_season(problem, read_weather_year(weather), 24 * 180, 8e-7)


@pytest.mark.parametrize("later", [0.0, 14.5])
def test_the_sun_of_another_season_is_at_the_hour_of_the_clock(found, later):
    """Also where the record does not begin at midnight."""
    case = found.problem.case
    stamps = case.record.stamps + np.timedelta64(round(3600 * later), "s")
    season = typical_summer(replace(case, record=replace(case.record, stamps=stamps))).record
    sun, angle = season.regressors["irradiance"], 2 * np.pi * hours_of_day(season) / 24.0
    noon = np.angle(np.sum(sun * np.exp(1j * angle))) * 24.0 / (2 * np.pi) % 24.0
    assert noon == pytest.approx(12.4, abs=0.6)  # 80 degrees west in the zone of 75


def test_another_season_of_plates_alone(found):
    case = found.problem.case
    record = case.record
    plates = {"flux_left": np.zeros(record.rows), "flux_right": np.zeros(record.rows)}
    record = replace(
        record, sensors=record.sensors[:, :0], names=(), regressors=plates, flux_noise_std=0.3, flux_gain_std=0.05
    )
    wall = replace(case.wall, conductivity=0.8)
    choices = replace(case.choices, initial_profile=1)
    season = typical_summer(replace(case, sensors=(), record=record, wall=wall, choices=choices))
    assert season.record.faces[:, 0].mean() > 20.0 and season.sensor_count == 0


def test_a_weather_file_that_is_not_there_ends_a_diagnosis_at_once(found, monkeypatch):
    monkeypatch.setattr(search_for_effects, "_fit_plain_model", None)  # no search has begun
    case = replace(found.problem.case, plan=CampaignSettings(weather="gone.epw", azimuth=180.0))
    with pytest.raises(wallid.InputError, match=r"\[plan\] weather: .*gone.epw: there is no such file"):
        wallid.diagnose(case)


def test_the_first_sensor_has_the_errors_of_a_planned_one(found, monkeypatch):
    """The case of the next record is looked at, no model is built."""
    monkeypatch.setattr(added_instrument, "diagnosis_problem", lambda case: case)
    monkeypatch.setattr(added_instrument, "with_profile_of", lambda case, present: case)
    (sensor,) = RecordWithFirstSensor(PresentRecord((found.before,)), 0.1).problem.sensors
    assert (sensor.position, sensor.noise_std, sensor.position_std, sensor.offset_std) == (0.1, 0.05, 0.002, 0.05)


def test_every_action_has_a_probability_and_the_page_of_numbers_its_keys(found, monkeypatch):
    shares = []
    (prescription,) = what_to_measure(found, shares.append)
    assert shares == sorted(shares) and shares[0] >= 0.0 and shares[-1] <= 1.0
    assert 0.0 <= prescription.now <= 1.0 and len(prescription.curve) == 9
    assert all(0.0 <= chance <= 1.0 for _, chance in prescription.curve)
    assert {"sensor", "flux_plate", "heating", "shade", "longer"} == set(prescription.tried)
    entries = prescription.to_dict(lambda effect: found.problem.target_name(effect.effect))
    assert entries["separate"][0] == {"name": "surface_film", "target": "left"}
    assert {"separate", "now", "actions"} == set(entries)
    probabilities = [action.probability for action in prescription.actions]
    assert len(probabilities) <= 5 and all(one >= 0.5 for one in probabilities)
    for action in entries["actions"]:
        assert {"kind", "days", "probability", "effort"} <= set(action)
    choices = replace(found.problem.case.choices, efforts=dict.fromkeys(EFFORTS, 100.0) | {"longer": 0.0})
    costly = replace(found, problem=replace(found.problem, case=replace(found.problem.case, choices=choices)))
    # a repeat of this record is as good as any action: the order by effort is that of a record that is not
    monkeypatch.setattr(search, "best_actions", lambda actions, now: best_actions(actions, 0.0))
    (other,) = what_to_measure(costly, shares.append)
    assert other.now == prescription.now and other.actions[0].kind == "longer"


@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 6.0)), min_size=1, max_size=7))
def test_the_best_action_has_its_probability_by_refits(drawn):
    """The best three and, one after the other, each that is the best of all then."""
    by_derivative = [Action("shade", {}, 1.0, effort, p) for p, _, effort in drawn]
    ranked, asked = sorted(by_derivative, key=lambda action: -score(action)), []
    exact = {action.effort: p for action, (_, p, _) in zip(by_derivative, drawn, strict=True)}

    def by_refits(k):
        asked.append(k)
        return exact[ranked[k].effort]

    found = search.with_probability_by_refits(ranked, by_refits)
    assert asked[:3] == list(range(len(ranked)))[:3] and len(asked) == len(set(asked))
    assert [one.probability for one in found] == [
        exact[one.effort] if k in asked else one.probability for k, one in enumerate(ranked)
    ]
    best = best_of(found)
    assert any(found[k] is best for k in asked)
    if len(asked) > 3:  # the last one was the best before its refits
        last = asked[-1]
        assert best_of([*found[:last], ranked[last], *found[last + 1 :]]) is ranked[last]


def test_refits_confirm_the_derivatives_of_a_repeat(found):
    """For effects that are nearly linear, the refits give the squared distance of the derivatives."""
    (confusable,) = confusable_sets(found)
    repeat = LongerRecord(confusable.present, 1.0)
    refitted = refitted_separations(confusable, repeat, refits_without_noise(confusable, repeat))
    for derivative, exact in zip(confusable.separations(repeat), refitted, strict=True):
        assert exact.excess == pytest.approx(derivative.excess, rel=0.35, abs=1.5)


def test_a_rivals_position_is_searched_anew(found, monkeypatch):
    """A change of the conductivity whose interface is at the wrong side, against fits from many interfaces."""
    problem, after, length = found.problem, found.after, SPEC.length
    (layers,) = [one for one in problem.library if problem.label(one.effect) == "layered conductivity"]
    ratio, interface = layers.names
    start = after.parameters.with_values({after.active[0].names[0]: 0.0, ratio: 0.0})
    far = linearised_at(problem, (layers,), start.with_values({ratio: -0.3, interface: 0.7 * length}), after.noise)
    without = refit(problem, (), start, after.noise)
    confusable = ConfusableSet((*after.active, layers), PresentRecord((after, far, without)), chance_gain=15.0)
    monkeypatch.setattr(refits, "_CLEAR_EXCESS", np.inf)
    repeat = LongerRecord(confusable.present, 1.0)
    rival = refits_without_noise(confusable, repeat)[0].rivals[0]
    exact = refits._with_readings_of(repeat, after)

    def cost(parameters, *effects):
        return refit(exact, effects, parameters, after.noise).cost

    own = cost(after.parameters, *after.active)
    starts = [
        start.with_values({interface: share * length, ratio: sign * 0.3})
        for share in (0.28, 0.35, 0.5, 0.7)
        for sign in (-1, 1)
    ]
    want = min(cost(one, layers) for one in starts) - own
    assert rival.cost - own == pytest.approx(want, abs=1.0)
    assert cost(far.parameters, layers) - own > want + 5.0


def test_no_sensor_is_proposed_where_there_is_one(found, monkeypatch):
    """The present sensors are at 0.1 and 0.3 m of 0.4."""
    monkeypatch.setattr(candidate_records, "SHARES", np.array([0.2495, 0.5, 0.75]))
    (record,) = records_with_sensor(PresentRecord((found.after,)))
    assert record.parameters()["position"] == 0.2


def test_a_longer_record_tells_less_a_day_where_its_bins_are_longer(tmp_path):
    """The standard error of a lag of minutes, against the record itself six times, backwards in between."""
    thin = replace(SPEC, length=0.12, positions=(0.03, 0.09), days=30.0, effects=())
    write_case(thin, tmp_path)
    case = wallid.load(tmp_path)
    record = case.record

    def six_times(rows):
        return np.concatenate([rows, rows[::-1]] * 3)

    count = np.arange(6 * record.rows)
    many = replace(
        record,
        time=record.step * count,
        stamps=record.stamps[0] + np.timedelta64(round(record.step), "s") * count,
        faces=six_times(record.faces),
        sensors=six_times(record.sensors),
        regressors={key: six_times(values) for key, values in record.regressors.items()},
    )

    def lagging(case):
        problem = diagnosis_problem(case)
        (lag,) = [one for one in problem.library if problem.label(one.effect) == "lag of the left face"]
        parameters = problem.parameters.with_values({lag.names[0]: 300.0})
        noise = problem.noise_shape(parameters).stated_covariance()
        return linearised_at(problem, (lag,), parameters, noise), lag.names[0]

    fit, name = lagging(case)
    exact, _ = lagging(replace(case, record=many))
    assert (fit.problem.bins.rows_per_bin, exact.problem.bins.rows_per_bin) == (1, 6)
    (longer,) = LongerRecord(PresentRecord((fit,)), 6.0).whitened_explanations
    assert longer.std(fit.index(name), 6.0) == pytest.approx(exact.std(name), rel=0.25)
    assert exact.std(name) > 1.4 * fit.std(name) / np.sqrt(6.0)


@pytest.mark.slow
def test_a_longer_record_makes_an_uninformative_one_informative(found):
    case = found.problem.case
    strict = replace(case, choices=replace(case.choices, largest_interval_factor=1.013))
    unclear = replace(found, problem=replace(found.problem, case=strict))
    assert unclear.verdict == "uninformative"
    unknown = open_diffusivities(unclear)
    chances = [unknown.probability(LongerRecord(unknown.present, length)) for length in (1.0, 4.0, 6.0)]
    assert chances == sorted(chances) and chances[0] < 0.1 and chances[-1] > 0.9
    (prescription,) = what_to_measure(unclear, lambda share: None)
    assert prescription.separate == () and prescription.question == "To determine the diffusivity"
    assert "longer" in {action.kind for action in prescription.actions}


def test_a_column_is_worth_logging_where_its_effect_would_be_named(found):
    record = found.problem.case.record
    without = {key: values for key, values in record.regressors.items() if key not in ("irradiance", "air_outdoor")}
    case = replace(found.problem.case, record=replace(record, regressors=without))
    problem = diagnosis_problem(case)
    plain = CandidateFits(problem).fit_plain_model()
    left = replace(found, problem=problem, before=plain, after=plain, effects=(), rivals=())
    columns = {one.column: one for one in unlogged_columns(left)}
    assert set(columns) == {"irradiance", "air_outdoor"}
    assert all(0.0 <= one.probability <= 1.0 for one in columns.values())
    assert {one.effect.name for one in columns["irradiance"].effects} == {"solar_gain"}
    assert {one.effect.name for one in columns["air_outdoor"].effects} == {"lateral_loss"}
    (film,) = [one for one in problem.library if one.names == found.effects[0].effect_parameters.names]
    alone, after = (refit(problem, active, plain.parameters, found.after.noise) for active in ((), (film,)))
    without_film = {one.column: one for one in unlogged_columns(replace(left, before=alone, after=alone))}
    for one in unlogged_columns(replace(left, effects=found.effects, after=after)):
        # of the same noise: what the film explains is projected out, and a further effect needs more evidence
        assert 0.0 < one.probability < without_film[one.column].probability
    (second, *_) = (one for one in problem.library if one.effect.name == "face_offset")
    two = refit(problem, (film, second), plain.parameters, found.after.noise)
    assert not list(unlogged_columns(replace(left, effects=found.effects, after=two)))  # no third is named
    no_gap = replace(found.gap, held_out_after=found.gap.noise_floor)
    explained = replace(
        left, gap=no_gap, trials=(), residual_tests_after=replace(found.residual_tests_after, p_value=0.5)
    )
    for one, verdict in ((left, "unnamed"), (explained, "adequate")):
        assert one.verdict == verdict, one.incomplete
        assert [asked.column for asked in what_to_measure(one, lambda share: None)] == ["air_outdoor", "irradiance"]


def test_typical_courses_are_those_of_a_day(found):
    courses = typical_courses(found.problem.record, 0)
    hour = np.arange(found.problem.record.rows) % 24
    assert courses["irradiance"][hour == 12].mean() > 100.0 and courses["irradiance"][hour == 0].max() == 0.0
    assert set(np.unique(courses["heating"])) == {0.0, 1.0}
    assert np.abs(courses["air_outdoor"] - found.problem.record.faces[:, 0]).std() < 2.0


def test_efforts_are_of_known_kinds():
    assert set(EFFORTS) == set(ACTIONS)
    assert Choices(efforts={"sensor": 5}).efforts == (("sensor", 5.0),)
    for wrong in ({"hole": 1.0}, {"sensor": -1.0}, "sensor"):
        with pytest.raises(wallid.InputError, match="efforts"):
            Choices(efforts=wrong)


def action(kind, probability, effort, **parameters):
    return Action(kind, parameters, 10.0, effort, probability)


def test_the_best_actions_weigh_probability_and_effort():
    column, sensor = action("column", 0.8, 1.0, column="irradiance"), action("sensor", 0.85, 3.0, position=0.1)
    sure, weak = action("longer", 0.99, 4.0), action("shade", 0.4, 2.0, face="left")
    assert best_actions([weak, sensor, column, sure], 0.1) == (sure, column, sensor)
    assert best_actions([sensor, column], 0.9) == ()
    assert best_actions([column], 0.8) == ()  # no better than a repeat
    best = Prescription((), (), 0.1, (column, sensor), ("column", "sensor"), ((0.1, 0.85),))
    assert best.sentence.startswith("To determine the diffusivity, log the irradiance on the outer face")
    assert "put one more temperature sensor 0.1 m from the left face (0.85)" in best.sentence
    none = replace(best, actions=(), tried=("sensor", "longer"))
    repeat = replace(best, actions=(), now=0.8)
    assert "a mere repeat of this record is as good" in repeat.sentence and "0.80" in repeat.sentence
    unlogged = Prescription((), ("solar gain",), 0.0, (), ("column",), column="irradiance")
    assert unlogged.sentence == (
        "To test for solar gain, logging the irradiance on the outer face is probably not enough: "
        "an effect of typical size is then named with probability 0.00."
    )
    weak = replace(unlogged, refused=action("column", 0.3, 1.0, column="irradiance"))
    assert weak.sentence.endswith("named with probability 0.30.")
    refused = replace(none, refused=action("sensor", 0.3, 3.0, position=0.1))
    assert refused.sentence.endswith(
        ". The best of them: put one more temperature sensor 0.1 m from the left face (0.30)."
    )
    assert not_probable_enough([weak.refused, *best.actions], 0.1) is None and not_probable_enough([], 0.1) is None
    assert not_probable_enough([weak.refused], 0.1) is weak.refused
    assert not_probable_enough([weak.refused], 0.3) is None  # no better than a repeat
    logged = replace(unlogged, actions=(column,))
    assert logged.sentence.endswith("face: an effect of typical size is then named with probability 0.80.")
    assert none.step == "" and "a further temperature sensor or a record of up to six times the length" in none.sentence


def test_the_present_record_has_its_length_and_noise(found):
    fits = (found.after,)
    present = PresentRecord(fits)
    assert present.days == pytest.approx(SPEC.days) and present.whitening is found.after.noise.whitening
    assert np.allclose(present.explanations[0].predicted, found.problem.binned(found.after.predicted))
