"""Heat flux: against the sine series of an analytic slab (no part of wallid), SciPy's hand and ISO 9869-1's rules."""

import json
import re
from dataclasses import replace
from pathlib import Path

import jax
import jax.monitoring
import jax.numpy as jnp
import jsonschema
import numpy as np
import pandas as pd
import pytest
from benchmarks.reference.analytic_slab import fluxes, refined, temperatures, weather
from measured_walls import london
from numpy.testing import assert_allclose
from pages import check
from results import SCHEMA
from scipy.linalg import toeplitz
from scipy.optimize import least_squares
from scipy.signal import lfilter
from scipy.stats import chi2
from typer.testing import CliRunner

import wallid
from wallid import plot
from wallid.case.options import Choices
from wallid.cli.commands import app
from wallid.estimation.iso_9869 import average_method, resistance_over_time
from wallid.experiment_design.expected_errors import expected_errors, with_expected_errors
from wallid.inference import generalised_least_squares
from wallid.inference.common_noise import wiener_filtered_noise
from wallid.inference.generalised_least_squares import fit_generalised_least_squares
from wallid.inference.likelihood import profile_likelihood
from wallid.inference.nuisance_kinds import NUISANCE_KINDS, ContactResistances
from wallid.inference.validity import distinguishable_range
from wallid.models.flux_plates import full_order_model_with_plates, initial_conductivity, uninformative_rows
from wallid.report.next_steps import next_steps
from wallid.report.page import answer, render_page
from wallid.report.result_json import result_entries
from wallid.workflow import Run

LENGTH, CONDUCTIVITY, CAPACITY = 0.3, 0.75, 1.5e6
R, C = LENGTH / CONDUCTIVITY, LENGTH * CAPACITY
DIFFUSIVITY = CONDUCTIVITY / CAPACITY
STEP, ROWS = 900.0, 288
PARTS = 40  # of a row, between which the true faces are straight lines
NOISE, FACE = 0.3, 0.01


def course(seed=3, windows=1):
    """Three days after twelve others, or more: faces, fluxes (W/m2), and a temperature in the middle.

    The faces are drawn at the fine step, so that no course between rows is that of the model.
    """
    rows, step = ROWS * windows, STEP / PARTS
    fine = weather((4 * ROWS + rows - 1) * PARTS + 1, step, np.random.default_rng(seed), hours=(8.0, 2.0))
    faces = fine[::PARTS]
    through = CONDUCTIVITY / LENGTH * fluxes(fine, step, DIFFUSIVITY / LENGTH**2)[::PARTS]
    inside = temperatures(fine, step, np.array([0.5]), DIFFUSIVITY / LENGTH**2)[::PARTS]
    return faces[-rows:], through[-rows:], inside[-rows:]


def case_of(
    plates=("left", "right"),
    *,
    length=LENGTH,
    gain=(0.0, 0.0),
    seed=3,
    draw=1,
    sensor=False,
    windows=1,
    noise=1.0,
    noise_model=None,
):
    faces, through, inside = course(seed, windows)
    rows, rng = len(faces), np.random.default_rng([seed, draw])
    time = STEP * np.arange(rows)
    noisy = through * (1 + np.array(gain)) + noise * NOISE * rng.standard_normal(through.shape)
    names = ("T1",) if sensor else ()
    record = wallid.Record(
        time,
        time,
        None,
        faces + noise * FACE * rng.standard_normal(faces.shape),
        inside + 0.05 * noise * rng.standard_normal(inside.shape) if sensor else np.empty((rows, 0)),
        names,
        regressors={f"flux_{face}": noisy[:, ("left", "right").index(face)] for face in plates},
        boundary_noise_std=FACE,
        flux_noise_std=NOISE,
        flux_gain_std=0.05 if any(gain) else 0.0,
    )
    wall = wallid.Wall(length=length, diffusivity_prior=2e-7 * (length / LENGTH) ** 2, outside="right")
    sensors = (wallid.Sensor("T1", 0.5 * length, noise_std=0.05),) if sensor else ()
    return wallid.Case("slab", Path("case.toml"), wall, sensors, record, Choices(initial_profile=1, noise=noise_model))


@pytest.fixture(scope="module")
def both():
    return wallid.estimate(case_of())


@pytest.fixture(scope="module")
def fitted():
    """A fit by generalised least squares with two plates that read too much and too little."""
    case, window = case_of(gain=(0.04, -0.03)), wallid.Window(0, ROWS)
    data, model = wallid.models.window_data(case, window), full_order_model_with_plates(case)
    return fit_generalised_least_squares(case, window, data, model, DIFFUSIVITY, eta=1e-8)


def test_the_profile_is_the_minimum_over_the_other_parameters(fitted):
    """At each diffusivity, against SciPy's minimum; the same for any number of points."""
    problem = fitted.problem
    residual_at = jax.jit(lambda y: problem.residual(y)[0])
    points = fitted.log_alpha + fitted.log_std * np.linspace(-3.0, 3.0, 13)  # no multiple of those computed together
    profile = np.asarray(profile_likelihood(problem, jnp.asarray(points)))
    for point, one in zip(points[::4], profile[::4], strict=True):
        assert float(profile_likelihood(problem, jnp.asarray([point]))[0]) == pytest.approx(one, abs=1e-6)

        def residual(z, point=point):
            return np.asarray(residual_at(jnp.asarray(np.append(point, z))))

        found = least_squares(residual, np.zeros(len(problem.parameters) - 1), x_scale="jac", xtol=1e-10, ftol=1e-12)
        _, log_det = np.linalg.slogdet(found.jac.T @ found.jac)
        assert one == pytest.approx(2.0 * found.cost + log_det, abs=2e-3)


@pytest.mark.parametrize("ratio", [0.9, 1.2])
def test_an_uncertain_noise_does_not_change_what_the_instruments_errors_add(fitted, ratio):
    """Each property varies by the noise, with that inflation, and by the priors, without it."""
    noise = replace(fitted.noise, shape_probability=np.ones(1), std_ratio=np.array([ratio]))
    exact = replace(fitted, noise=replace(noise, std_ratio=np.ones(1)), disturbance=None, noise_estimated=True)
    inflated = replace(exact, noise=noise)
    for combination in np.eye(len(fitted.names)):
        by_errors = sum(effect**2 for effect in fitted.instrument_error_effects(combination).values())
        by_priors = np.sum((combination @ fitted.generalised_inverse)[len(fitted.noise.whitening) :] ** 2)
        assert by_errors <= by_priors <= inflated.variance(combination)  # so what windows have in common is a part
        expected = by_priors + ratio**2 * (exact.variance(combination) - by_priors)
        assert inflated.variance(combination) == pytest.approx(expected, rel=1e-9)


def near(quantity, truth, sigmas=4.0):
    assert abs(np.log(quantity.value / truth)) < sigmas * quantity.std / quantity.value
    assert quantity.interval_95[0] < quantity.value < quantity.interval_95[1]


def test_the_truths_fluxes_balance_what_is_stored():
    """What comes in at the left and does not leave at the right is the heat that the slab takes up."""
    faces = weather(2000, 300.0, np.random.default_rng(0))
    rate = 3e-6
    j = fluxes(faces, 300.0, rate)
    x = (np.arange(200) + 0.5) / 200
    stored = temperatures(faces, 300.0, x, rate).mean(axis=1)
    gained = np.sum(0.5 * (j[1:] + j[:-1]) @ [1.0, -1.0]) * 300.0 * rate
    assert stored[-1] - stored[0] == pytest.approx(gained, abs=0.02)


def test_conductivity_and_capacity_are_told_apart(both):
    told = both.thermal
    assert both.reliable
    near(told.resistance, R)
    near(told.areal_heat_capacity, C)
    near(told.conductivity, CONDUCTIVITY)
    near(told.heat_capacity, CAPACITY)
    assert told.resistance.std < 0.02 * R and told.areal_heat_capacity.std < 0.05 * C
    U = 1 / (told.resistance.value + 0.17)
    assert told.transmittance.value == pytest.approx(U)
    assert_allclose(told.transmittance.interval_95, [1 / (end + 0.17) for end in told.resistance.interval_95[::-1]])
    assert "resistance" in str(both) and "W/m2" in str(both)


def test_the_length_may_be_a_guess(both):
    guess = wallid.estimate(case_of(length=1.1)).thermal
    assert guess.resistance.value == pytest.approx(both.thermal.resistance.value, rel=1e-6)
    assert guess.areal_heat_capacity.value == pytest.approx(both.thermal.areal_heat_capacity.value, rel=1e-6)
    assert guess.conductivity.value == pytest.approx(1.1 / LENGTH * both.thermal.conductivity.value, rel=1e-6)


def test_a_plates_calibration_is_counted(both):
    """Two plates that are off by +4 and -3 %: within the prior, and the resistance's interval is as wide as that."""
    fit = wallid.estimate(case_of(gain=(0.04, -0.03)))
    told = fit.thermal
    near(told.resistance, R)
    assert fit.advice == () and sum(told.resistance_shares.values()) == pytest.approx(1.0)
    assert told.resistance_shares["plates' calibration"] > 0.9
    assert told.resistance.std / told.resistance.value == pytest.approx(0.05 / np.sqrt(2), rel=0.3)
    # of the two only their difference is in the record
    assert told.plate_gains["left"][0] - told.plate_gains["right"][0] == pytest.approx(0.07, abs=0.03)


def test_plates_that_disagree_are_an_advice():
    """Two plates that are off by +15 and -15 %, three times what is stated: the estimate says so, first what to do."""
    case = case_of(gain=(0.15, -0.15))
    fit = wallid.estimate(case)
    (advice,) = fit.advice
    assert advice.startswith("the plates disagree") and "where 5 % is stated" in advice
    assert "the left one reads 1" in advice and "too high and the right one reads 1" in advice
    first, second, *_ = next_steps(Run(case, fit=fit))
    assert first == advice and second == "until then take R and U as first values"


def test_a_plate_that_reads_too_much_says_by_how_much(both):
    """3 W/m2 more at all rows, ten times the stated noise: the line of the plate has its mean residual."""
    assert all(abs(mean) < 0.1 for mean in both.thermal.mean_residuals.values())
    case = case_of()
    fluxes = case.record.regressors | {"flux_right": case.record.regressors["flux_right"] + 3.0}
    told = wallid.estimate(replace(case, record=replace(case.record, regressors=fluxes))).thermal
    assert told.mean_residuals["right"] - told.mean_residuals["left"] == pytest.approx(3.0, abs=0.5)
    assert re.search(r"right: calibration .* differs from the model by \+\d\S* W/m2 on average", str(told))


@pytest.mark.slow
def test_one_plate_serves():
    told = wallid.estimate(case_of(("left",))).thermal
    near(told.resistance, R)
    near(told.areal_heat_capacity, C)


def test_the_first_half_predicts_the_second(both):
    held = both.thermal.held_out
    assert held.hours == 36.0 and held.coverage > 0.85
    assert held.rms < 3 * np.sqrt(NOISE**2 + (FACE * 60) ** 2)


def test_a_contact_that_only_the_whole_record_shows(monkeypatch):
    """The first half predicts the second with its own parameters, without the contact resistances of the whole."""
    scores = iter([{"left": 9.0, "right": 9.0}, {"left": 0.0, "right": 0.0}])
    monkeypatch.setattr(generalised_least_squares, "contact_scores", lambda *_: next(scores))
    case = case_of()
    fit = wallid.estimate(replace(case, choices=replace(case.choices, disturbance="none")))
    assert set(fit.thermal.contact_resistances) == {"left", "right"} and next(scores, None) is None
    assert fit.thermal.held_out.coverage > 0.85 and fit.thermal.held_out.rms < 1.0


def test_below_a_memory_as_long_as_the_window_nothing_is_told():
    low, _ = distinguishable_range(case_of(), wallid.Window(0, ROWS))
    assert low == pytest.approx(LENGTH**2 / (np.pi**2 * ROWS * STEP))


def test_the_average_method_in_a_steady_state():
    faces = np.tile([20.0, 5.0], (400, 1))
    steady = average_method(faces, np.full(400, 30.0), 900.0, "left", 3e5)
    assert steady.resistance == pytest.approx(0.5) and steady.corrected_resistance == pytest.approx(0.5)
    assert steady.complete and steady.days == pytest.approx(400 / 96)
    short = average_method(faces[:280], np.full(280, 30.0), 900.0, "left")
    assert not short.three_days and not short.complete and short.corrected_resistance is None
    gone = average_method(faces, np.zeros(400), 900.0, "right")
    assert gone.resistance is None and "no resistance" in str(gone)


def test_each_stopping_rule_stops():
    faces, days = np.tile([20.0, 5.0], (6 * 96, 1)), np.arange(6 * 96) / 96
    jump = average_method(faces, np.where(days < 5, 30.0, 60.0), 900.0, "left")
    assert not jump.day_before and jump.change_of_a_day == pytest.approx(1 - 30 / 35)
    assert jump.resistance_day_before == pytest.approx(0.5) and jump.resistance == pytest.approx(15 / 35)
    assert jump.unmet_rules[0] == "R changed by 14.3 % in the last day (limit: 5 %)"
    drift = average_method(faces, 30.0 * (1 + 0.03 * (days - 3)), 900.0, "left")
    assert drift.day_before and not drift.two_thirds
    # INT(2 * 6 / 3) = 4 days from each end
    assert drift.first_to_last == pytest.approx((1 + 0.03 * (4 - 3)) / (1 + 0.03 * (2 - 3)) - 1, abs=0.002)
    assert drift.unmet_rules == ("R of the first and of the last 4 days differ by 6.19 % (limit: 5 %)",)
    assert drift.resistances_of_parts[0] / drift.resistances_of_parts[1] == pytest.approx(1 + drift.first_to_last)
    short = average_method(faces[:150], np.full(150, 30.0), 900.0, "left")
    assert [text.split(" (")[0] for text in short.unmet_rules] == [
        "1.56 days were measured",
        "R at the end cannot be compared with R a day before",
        "R of the first and of the last two thirds cannot be compared",
    ]


def test_the_average_is_over_whole_days():
    """Half a day more of a daily cycle biases the mean flux; the standard asks for a multiple of 24 h."""
    days = np.arange(int(6.5 * 96)) / 96
    faces, flux = np.tile([20.0, 5.0], (len(days), 1)), 30.0 + 20.0 * np.sin(2 * np.pi * days)
    entire = average_method(faces, flux, 900.0, "left")
    assert entire.resistance == pytest.approx(0.5) and (entire.days, entire.averaged_days) == (6.5, 6.0)
    assert "6 of 6.50 days" in str(entire)
    course = resistance_over_time(faces, flux)
    assert course[6 * 96 - 1] == pytest.approx(entire.resistance) and course[-1] < 0.49, "what half a day more gives"
    assert course[5 * 96 - 1] == pytest.approx(entire.resistance_day_before)
    # a step that does not divide a day, and less than a day
    uneven = average_method(
        faces[:617], 30.0 + 20.0 * np.sin(2 * np.pi * np.arange(617) * 1000.0 / 86400.0), 1000.0, "left"
    )
    assert uneven.averaged_days == 7.0 and uneven.resistance == pytest.approx(0.5, abs=1e-3)
    assert average_method(faces[:48], np.full(48, 30.0), 900.0, "left").averaged_days == 0.5


def test_missing_fluxes_are_left_out_of_the_course():
    flux = np.array([np.nan, 30.0, np.nan, 15.0])
    faces = np.array([[90.0, 0.0], [15.0, 0.0], [90.0, 0.0], [30.0, 0.0]])
    assert_allclose(resistance_over_time(faces, flux), [np.nan, 0.5, 0.5, 1.0])


@pytest.mark.parametrize("every", [1, 6], ids=["all rows", "every sixth row has a flux"])
@pytest.mark.parametrize("face", ["left", "right"])
def test_the_stored_heat_is_taken_out(face, every):
    """Faces that warm by 1 K a day: each plate is off by what is stored, and the correction takes most of it out."""
    rows, per_day = 20 * 96, 96
    warm = np.arange(3 * rows)[:, None] / per_day
    faces = np.array([20.0, 5.0]) + warm
    j = CONDUCTIVITY / LENGTH * fluxes(faces, 900.0, DIFFUSIVITY / LENGTH**2)
    side = ("left", "right").index(face)
    flux = np.where(np.arange(rows) % every == 0, j[-rows:, side], np.nan)
    found = average_method(faces[-rows:], flux, 900.0, face, C)
    # the change from the first day's mean to the last's is 19 of 20 days'
    assert abs(found.corrected_resistance / R - 1) < 0.1 * abs(found.resistance / R - 1)


def test_a_plate_that_reads_every_fourth_row():
    """The noise of the faces at a reading is that of its own rows, not of the mean between two readings."""
    case = case_of(noise_model="stated")
    sparse = {name: np.where(np.arange(ROWS) % 4 == 0, flux, np.nan) for name, flux in case.record.regressors.items()}
    fit = wallid.estimate(replace(case, record=replace(case.record, regressors=sparse)))
    near(fit.thermal.resistance, R)
    near(fit.thermal.areal_heat_capacity, C)
    assert fit.thermal.average_methods[0].corrected_resistance == pytest.approx(R, rel=0.1)
    every = wallid.estimate(case)
    assert 0.5 < fit.reduced_chi_square / every.reduced_chi_square < 1.5


def test_hourly_rows_of_smooth_faces_do_not_shift_the_diffusivity():
    """The truth is known every minute. Cubics that are flat at each extreme shift it by 0.2 %."""
    minutes, rows = 60, 24 * 14
    turn = 2 * np.pi * np.arange(60 * 24 * 20) / (60 * 24)
    left = 20 + 0.5 * np.sin(turn + 0.4) + 0.8 * np.sin(turn / 6.3)
    right = 5 + 5 * np.sin(turn) + 1.5 * np.sin(2 * turn + 1.0) + 0.4 * np.sin(5 * turn + 2.0) + 3 * np.sin(turn / 4.1)
    faces = np.stack([left, right], axis=1)
    through = CONDUCTIVITY / LENGTH * fluxes(faces, 60.0, DIFFUSIVITY / LENGTH**2)
    read = np.arange(rows) * minutes + len(faces) - rows * minutes
    time = 3600.0 * np.arange(rows)
    record = wallid.Record(
        time, time, None, faces[read], np.empty((rows, 0)), (),
        regressors={"flux_left": through[read, 0], "flux_right": through[read, 1]},
        boundary_noise_std=0.001, flux_noise_std=0.05, flux_gain_std=0.0,
    )  # fmt: skip
    wall = wallid.Wall(length=LENGTH, diffusivity_prior=7e-7, outside="right")
    fit = wallid.estimate(wallid.Case("slab", Path("case.toml"), wall, (), record, Choices(initial_profile=1)))
    assert fit.value == pytest.approx(DIFFUSIVITY, rel=1e-3)
    assert fit.thermal.resistance.value == pytest.approx(R, rel=1e-3)


def test_sensors_and_plates_together():
    alone, joined = (wallid.estimate(case_of(("left",), sensor=sensor)) for sensor in (False, True))
    near(joined.thermal.resistance, R)
    assert joined.std < alone.std
    assert joined.residual.shape == (ROWS, 2) and joined.sensor_count == 1


def test_noise_with_a_memory_beside_a_plate_is_no_gust_and_no_heat():
    """Six days of sensors and a plate, each with noise of the correlation 0.9; the sine series is the truth.

    With faces filtered for white noise the errors are 3.9 and 3.5 standard errors, and heat is found behind a face.
    """
    places, rows, rho = np.array([0.25, 0.5, 0.75]), 2 * ROWS, 0.9
    rate = DIFFUSIVITY / LENGTH**2

    def noise(std, rng, *shape):
        own = rng.standard_normal((200 + rows, *shape))
        return std * lfilter([np.sqrt(1.0 - rho**2)], [1.0, -rho], own, axis=0)[200:]

    def standardised_error(seed):
        fine = weather((12 * ROWS + rows - 1) * PARTS + 1, STEP / PARTS, np.random.default_rng(seed), hours=(8.0, 2.0))
        inside = temperatures(fine, STEP / PARTS, places, rate)[::PARTS][-rows:]
        flux = CONDUCTIVITY / LENGTH * fluxes(fine, STEP / PARTS, rate)[::PARTS][-rows:, 0]
        time, rng = STEP * np.arange(rows), np.random.default_rng([seed, 5])
        record = wallid.Record(
            time,
            time,
            None,
            fine[::PARTS][-rows:] + noise(0.1, rng, 2),
            inside + noise(0.05, rng, 3),
            ("T1", "T2", "T3"),
            regressors={"flux_left": flux + noise(NOISE, rng)},
            boundary_noise_std=0.1,
            flux_noise_std=NOISE,
            flux_gain_std=0.02,
        )
        sensors = tuple(
            wallid.Sensor(name, LENGTH * place, noise_std=0.05)
            for name, place in zip(record.names, places, strict=True)
        )
        wall = wallid.Wall(length=LENGTH, diffusivity_prior=4e-7, outside="right")
        case, window = wallid.Case("slab", Path("case.toml"), wall, sensors, record, Choices()), wallid.Window(0, rows)
        model, data = full_order_model_with_plates(case), wallid.models.window_data(case, window)
        fit = fit_generalised_least_squares(case, window, data, model, 4e-7, eta=1e-6)
        assert fit.disturbance is None
        return np.log(fit.diffusivity / DIFFUSIVITY) / fit.log_std

    assert max(abs(standardised_error(seed)) for seed in (0, 2)) < 2.5


@pytest.mark.slow
def test_a_campaign_takes_fluxes_window_by_window(both):
    """What one estimate has compiled serves all windows; each is that of `estimate`, and all know the wall better."""
    case, compiled = case_of(windows=2), []
    jax.monitoring.register_event_duration_secs_listener(
        lambda event, *_, **__: compiled.append(event) if "backend_compile" in event else None
    )
    found = wallid.campaign(case)
    jax.monitoring.clear_event_listeners()
    assert not compiled
    assert found.fits[1].value == wallid.estimate(case, found.windows[1]).value
    told = found.thermal
    assert found.reliable and found.used == (0, 1) and found.conductivity_mean.degrees_of_freedom == 1
    near(told.resistance, R)
    near(told.areal_heat_capacity, C)
    near(told.conductivity, CONDUCTIVITY)
    near(told.heat_capacity, CAPACITY)
    assert told.resistance.std < min(fit.thermal.resistance.std for fit in found.fits)
    assert told.average_methods[0].days == 6.0 and told.held_out is None
    assert "agreement    of the conductivity" in str(found)


def test_no_number_of_windows_takes_a_plates_calibration_out():
    """Without noise, a plate that reads 2 % more: the resistance is that much less, from two windows as from one."""
    case = case_of(("left",), windows=2, noise=0.0, gain=(0.02, 0.0), noise_model="robust")
    case = replace(case, choices=replace(case.choices, disturbance="none"))
    found = wallid.campaign(replace(case, record=replace(case.record, flux_gain_std=0.05)))
    told, one = found.thermal.resistance, found.fits[0]
    assert told.value == pytest.approx(R / 1.02, rel=1e-3)
    assert told.std / told.value == pytest.approx(0.05, rel=0.01)
    assert found.mean.std < 0.8 * one.std / one.value, "the diffusivity is not touched by it"


def test_a_window_may_have_plates_alone_or_sensors_alone():
    case = case_of(("left",), sensor=True, windows=3)
    sensors, flux = case.record.sensors.copy(), case.record.regressors["flux_left"].copy()
    sensors[:ROWS] = np.nan
    flux[ROWS : 2 * ROWS] = np.nan
    sensors[2 * ROWS :], flux[2 * ROWS :] = np.nan, np.nan
    case = replace(case, record=replace(case.record, sensors=sensors, regressors={"flux_left": flux}))
    found = wallid.campaign(case)
    first, second, third = found.fits
    assert third is None and "no reading" in str(found)
    assert found.used == (0, 1) and [fit.has_flux for fit in (first, second)] == [True, False]
    assert distinguishable_range(case, found.windows[0])[0] == pytest.approx(LENGTH**2 / (np.pi**2 * ROWS * STEP))
    assert abs(np.log(found.value / DIFFUSIVITY)) < 4 * found.mean.std
    near(found.thermal.resistance, R)
    assert found.thermal.resistance.value == pytest.approx(first.thermal.resistance.value, rel=1e-12)


def at_rest(*, gap=True):
    """A case from rest, so that its initial straight line is true, at the true diffusivity, conductivity stated."""
    case, faces = case_of(sensor=True), weather(ROWS, STEP, np.random.default_rng(4))
    fine, step, rate = refined(faces, PARTS), STEP / PARTS, DIFFUSIVITY / LENGTH**2
    inside = temperatures(fine, step, np.array([0.5]), rate)[::PARTS]
    through = CONDUCTIVITY / LENGTH * fluxes(fine, step, rate)[::PARTS]
    read = {f"flux_{face}": through[:, side] for side, face in enumerate(("left", "right"))}
    read["flux_right"][40 : 60 if gap else 40] = np.nan
    record = replace(case.record, faces=faces, sensors=inside, regressors=read, flux_gain_std=0.04)
    wall = wallid.Wall(length=LENGTH, diffusivity_prior=DIFFUSIVITY, conductivity=CONDUCTIVITY, outside="right")
    return replace(case, wall=wall, record=record)


def bound(case, *, sensors, full):
    """The Cramer-Rao bound of ln(alpha) by differences of the sine series, from rest.

    With the readings' own noise, ln(conductivity) and the plates' gains; in full with the faces' noise, what sensors
    have in common with it, and the initial profile's eight slowest modes.
    """
    record, rate, t = case.record, DIFFUSIVITY / LENGTH**2, case.record.time
    faces, scale = record.faces, CONDUCTIVITY / LENGTH

    def outputs(rate, faces, step=STEP):
        return np.column_stack([temperatures(faces, step, np.array([0.5]), rate), scale * fluxes(faces, step, rate)])

    def of_cubics(rate):
        return outputs(rate, refined(faces, PARTS), STEP / PARTS)[::PARTS]

    h = (of_cubics(1.0001 * rate) - of_cubics(0.9999 * rate)) / 2e-4
    through = of_cubics(rate)[:, 1:]
    constants = np.zeros((len(t), 3, 3))
    constants[:, 1:, 0] = 3.0 * through
    constants[:, 1, 1], constants[:, 2, 2] = (0.04 * through).T
    std = np.array([0.05, NOISE, NOISE])
    V = np.diag(np.repeat(std**2, len(t)))
    if full:
        n = np.arange(1, 9)
        shapes = np.stack([np.sin(0.5 * np.pi * n), -scale * np.pi * n, -scale * np.pi * n * (-1.0) ** n])
        everything = np.concatenate([faces.ravel(), record.sensors.ravel() if sensors else []])
        waves = np.sqrt(2) * np.ptp(everything) / n * np.exp(-np.outer(t, rate * (n * np.pi) ** 2))[:, None] * shapes
        common = np.zeros((len(t), 3, 2))
        common[:, 0] = np.stack([wiener_filtered_noise(face, FACE) for face in faces.T], axis=1)
        constants = np.concatenate([constants, waves, *([common] if sensors else [])], axis=2)
        for side in (0, 1):
            pulse = np.zeros((len(t) + 1, 2))
            pulse[1, side] = 1.0
            answer = outputs(rate, pulse)[1:]
            G = np.concatenate([toeplitz(column, np.zeros(len(t))) for column in answer.T])
            V += FACE**2 * G @ G.T
    there = np.isfinite(np.column_stack([record.sensors, *record.regressors.values()]))
    there[: uninformative_rows(case, ROWS, STEP), 1:] = False
    there[:, 0] &= sensors
    kept = there.T.ravel()
    columns = constants.transpose(1, 0, 2).reshape(len(kept), -1)[kept]
    V = V[np.ix_(kept, kept)] + columns @ columns.T
    slope = h.T.ravel()[kept]
    return 1 / np.sqrt(slope @ np.linalg.solve(V, slope))


@pytest.mark.parametrize("sensors", [False, True])
def test_a_design_counts_fluxes_to_the_cramer_rao_bound(sensors):
    case = at_rest()
    if not sensors:
        case = replace(case, sensors=(), record=replace(case.record, sensors=np.empty((ROWS, 0)), names=()))
    plain, full = (wallid.design(case, full=full).expected_relative_std for full in (False, True))
    assert plain == pytest.approx(bound(at_rest(), sensors=sensors, full=False), rel=3e-3)
    assert full == pytest.approx(bound(at_rest(), sensors=sensors, full=True), rel=1e-2)
    found = wallid.design(case)
    assert found.full and found.expected_relative_std == full, (
        "where there are plates, all counts unless told otherwise"
    )
    assert "the full covariance" in str(found)
    if sensors:  # where a further one helps, and other steps, begin with what there is
        assert wallid.place_sensors(case, candidates=[0.1]).std_before[0] == pytest.approx(full, rel=1e-9)
        whole = bound(at_rest(gap=False), sensors=True, full=True)
        assert wallid.experiment_design.compare_sampling_steps(case, factors=[1.0]).std[0] == pytest.approx(
            whole, rel=1e-2
        )
    cut = wallid.design(case, restart=False)
    assert not cut.full and cut.expected_relative_std == pytest.approx(plain, rel=1e-9), (
        "one window: theta from its start"
    )


def test_noise_of_the_faces_with_a_memory_reaches_the_plates():
    """Its size at the plates, against the sine series."""
    case, window = case_of(), wallid.Window(0, ROWS)
    model, data = full_order_model_with_plates(case), wallid.models.window_data(case, window)
    shape = fit_generalised_least_squares(case, window, data, model, DIFFUSIVITY, eta=1e-6).noise_shape
    rho, rng = 0.9, np.random.default_rng(8)
    noise = FACE * lfilter([np.sqrt(1.0 - rho**2)], [1.0, -rho], rng.standard_normal((100 * ROWS, 2)), axis=0)
    left = np.stack([
        np.convolve(one, weights, mode="same")
        for one, weights in zip(noise.T, case.record.face_filter.weights, strict=True)
    ], axis=1)  # fmt: skip
    through = CONDUCTIVITY / LENGTH * fluxes(left, STEP, DIFFUSIVITY / LENGTH**2)[ROWS:]
    found = np.sqrt(shape.face_variance(0.0, 1.0, rho))
    assert_allclose(found, np.sqrt(np.mean(through**2, axis=0)), rtol=0.1)


def test_what_is_uncertain_in_the_faces_filter_reaches_the_plates(fitted):
    """Each direction of each face, against the sine series of its course."""
    case, shape = case_of(gain=(0.04, -0.03)), fitted.noise_shape
    record = case.record
    conductivity = initial_conductivity(case, wallid.Window(0, ROWS)) * np.exp(fitted.parameters["log_conductivity"])
    courses = record.face_filter.courses_of_deviations(record.faces, record.step)
    assert len(courses) == 3 and len(shape.gap_errors) == 6
    for found, (direction, side) in zip(shape.gap_errors, np.ndindex(3, 2), strict=True):
        faces = np.zeros((ROWS, 2))
        faces[:, side] = courses[direction, side]
        through = conductivity / LENGTH * fluxes(faces, STEP, fitted.diffusivity / LENGTH**2)
        want = np.asarray(shape.bins.mean(jnp.asarray(through)))
        assert np.sqrt(np.mean((found - want) ** 2)) < 0.03 * np.sqrt(np.mean(want**2))


@pytest.mark.slow
def test_estimates_from_fluxes_scatter_as_the_design_expects():
    """Twelve records of other noise from a wall that did not begin at rest; the chi-square of their scatter."""
    values = []
    for seed in range(12):
        case, window = case_of(seed=3, draw=seed, noise_model="stated"), wallid.Window(0, ROWS)
        model, data = full_order_model_with_plates(case), wallid.models.window_data(case, window)
        values.append(
            np.log(
                fit_generalised_least_squares(case, window, data, model, DIFFUSIVITY, eta=1e-8).diffusivity
                / DIFFUSIVITY
            )
        )
    expected = wallid.design(case, diffusivities=[DIFFUSIVITY]).expected_relative_std
    low, high = chi2.ppf([0.001, 0.999], 12)
    assert low < np.sum(np.square(values)) / expected**2 < high


@pytest.mark.slow
def test_a_reduced_model_learns_fluxes_and_answers_for_its_error(both):
    """Nine modes: the sine series' fluxes, the large model's estimate, and the shift that its own error makes."""
    case, window = case_of(sensor=True), wallid.Window(0, ROWS)
    case = replace(case, choices=replace(case.choices, learning_diffusivities=(3e-7, 8e-7)))
    learned = wallid.learn(case, window, 9, plates=True).system
    assert learned.output_names == ("T1", "flux_left", "flux_right")
    still = at_rest(gap=False)
    data, scale = wallid.models.window_data(still), wallid.case.scales(still)
    u = np.asarray(wallid.models.explicit(learned, scale.fourier_number(DIFFUSIVITY), data)[0])
    through = CONDUCTIVITY / LENGTH * scale.temperature * u[:, 1:]
    truth = np.column_stack(list(still.record.regressors.values()))
    assert np.abs(through - truth)[1:].max() < 0.2 * NOISE
    assert np.abs(scale.celsius(u[:, :1]) - still.record.sensors).max() < 0.05
    fit = wallid.estimate(case_of(), window, learned.select([1, 2]))
    moved, std = np.log(fit.value / both.value), both.std / both.value
    assert abs(moved) < 0.2 * std and fit.thermal.resistance.value == pytest.approx(R, rel=0.02)
    assert fit.model_shift == pytest.approx(moved, rel=0.2)
    coarse = wallid.learn(case, window, 7, plates=True).system.select([1, 2])
    less_exact = wallid.estimate(case_of(), window, coarse)
    assert less_exact.model_shift == pytest.approx(np.log(less_exact.value / both.value), rel=0.1)
    assert "reduced-order model of order 9" in str(fit) and "full-order model" in str(both)


def written(folder, *, windows=1, **more):
    """The slab as files."""
    record = case_of(windows=windows).record
    columns = {"time": record.time, "in": record.faces[:, 0], "out": record.faces[:, 1]}
    columns |= {"q_in": record.regressors["flux_left"], "q_out": record.regressors["flux_right"]}
    pd.DataFrame(columns | more).to_csv(folder / "record.csv", index=False)
    (folder / "case.toml").write_text(f"""
[wall]
length = {LENGTH}
diffusivity_prior = 2e-7
outside = "right"
[record]
file = "record.csv"
time = "time"
left = "in"
right = "out"
flux_left = "q_in"
flux_right = "q_out"
boundary_noise_std = {FACE}
flux_noise_std = {NOISE}
""")
    return str(folder)


def result_of(*words):
    """What a command that ends well says as JSON."""
    ended = CliRunner().invoke(app, [*words, "--json"])
    assert ended.exit_code == 0, ended.stderr
    result = json.loads(ended.stdout)
    jsonschema.validate(result, SCHEMA)
    return result


def noise_of_plate_and_faces(plate):
    """The stated noise of a plate, with the error of the filtered faces through the sine series, root mean square."""
    noise, rng = case_of().record.face_filter.noise, np.random.default_rng(5)
    faces = np.zeros((20 * ROWS, 2))
    for side, lags in enumerate(noise.limited(1.0, 0.0, 0.0)):
        assert lags[0] < FACE**2, "what is left of a face's noise"
        power = np.fft.rfft(np.pad(np.concatenate([lags, np.zeros(1), lags[:0:-1]]), (0, 0))).real.clip(0.0)
        kernel = np.fft.irfft(np.sqrt(power))
        faces[:, side] = np.convolve(rng.standard_normal(len(faces)), np.fft.fftshift(kernel), mode="same")
    through = CONDUCTIVITY / LENGTH * fluxes(faces, STEP, DIFFUSIVITY / LENGTH**2)[100:, plate]
    return np.sqrt(NOISE**2 + np.mean(through**2))


def test_a_misfit_is_held_against_the_noise_of_plates_and_faces(both):
    """The page says that noise explains a residual of its size, and that it does not explain twice as much."""
    case = case_of()

    def sentence(rms, floor, chi_square):
        gap = {"after_W_per_m2": rms, "floor_W_per_m2": floor}
        return answer(Run(case, fit=replace(both, reduced_chi_square=chi_square)), {"flux_gap": gap})

    assert "That is within the noise" in sentence(0.5, 0.5, 1.0)
    assert "That is more than noise: the stated noise of plates and faces accounts for 0.5 W/m²" in sentence(
        1.0, 0.5, 4.0
    )
    assert "this difference lasts for hours" in sentence(0.5, 0.5, 4.0)


def test_a_flux_case_leads_with_resistance_and_u(both):
    """As text and on the page; the surface resistances of U are numbers."""
    first, second = str(both).splitlines()[:2]
    assert first.startswith("resistance") and second.startswith("U-value")
    assert "0.13 inside and 0.04 m2 K/W outside" in second
    run = Run(case_of(), fit=both)
    page = render_page(run, result_entries(run), [])
    card = page[page.index('class="answer') : page.index("</section>")]
    values = re.findall(r'<p class="value"><small>([^<]*)</small><br>([^<]*)', card)
    assert [name.partition(",")[0] for name, _ in values] == ["Thermal resistance R", "U-value"]
    assert all("±" in value for _, value in values) and "0.13 inside and 0.04" in values[1][0]
    assert "<strong>Next:</strong> Use R and U" in card


def test_expected_errors_are_those_of_the_estimate():
    """The design's expected errors of diffusivity and R, beside the standard errors of an estimate as stated."""
    case, window = case_of(noise_model="stated"), wallid.Window(0, ROWS)
    found = expected_errors(case, window, DIFFUSIVITY)
    fit = wallid.estimate(case, window)
    assert found.diffusivity == pytest.approx(fit.std / fit.value, rel=0.05)
    assert found.resistance == pytest.approx(fit.thermal.resistance.std / fit.thermal.resistance.value, rel=0.05)
    design = with_expected_errors(case, wallid.design(case, diffusivities=[DIFFUSIVITY]))
    assert design.errors.diffusivity == pytest.approx(design.expected_relative_std, rel=1e-9)
    assert str(design).splitlines()[-1].startswith(f"expected     a standard error of {found.resistance:.2%} of the")


def test_the_figures_of_a_plate_show_the_estimates_numbers(both):
    """The interval by hand, the residual reading by reading, and a density of area one beside the noise's."""
    case, plate = case_of(), 1
    k, j = both.thermal.conductivity, both.predicted[:, plate]
    sigma = both.noise_rms[plate]
    assert sigma == pytest.approx(noise_of_plate_and_faces(plate), rel=0.03)
    half = plot.flux_interval(case, both, plate)
    assert_allclose(half, 1.959964 * np.sqrt(sigma**2 + (j * k.std / k.value) ** 2), rtol=1e-6)
    _, (course, residual, density) = plot.figure(1, 3)
    plot.measured_flux(case, both, plate, ax=course)
    there = np.isfinite(both.residual[:, plate])
    box = course.collections[0].get_paths()[0].get_extents()
    assert (box.y0, box.y1) == pytest.approx(((j - half)[there].min(), (j + half)[there].max()))
    plot.flux_residual(case, both, plate, ax=residual)
    assert_allclose(residual.lines[0].get_ydata(), both.residual[there, plate])
    plot.flux_density(case, both, plate, ax=density)
    (noise,) = density.lines
    x = noise.get_xdata()
    assert_allclose(noise.get_ydata(), np.exp(-0.5 * (x / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi)), rtol=1e-9)


def test_a_case_with_flux_alone_on_the_command_line(tmp_path):
    out = tmp_path / "out"
    result = result_of("run", written(tmp_path), "--out", str(out))
    assert {path.name for path in out.iterdir()} >= {"result.json", "record.png", "flux.png", "report.html"}
    for key, unit in (("conductivity", "W/m/K"), ("heat_capacity", "J/m3/K"), ("resistance", "m2 K/W"),
                      ("areal_heat_capacity", "J/m2/K"), ("transmittance", "W/m2/K")):  # fmt: skip
        assert set(result[key]) == {"value", "std", "interval_95", "unit"} and result[key]["unit"] == unit
    assert set(result["iso_9869"]) == {"flux_left", "flux_right"}
    assert result["iso_9869"]["flux_left"]["three_days"] is True
    of_both = np.sqrt(np.mean([noise_of_plate_and_faces(plate) ** 2 for plate in (0, 1)]))
    assert result["gap"] is None and result["flux_gap"]["floor_W_per_m2"] == pytest.approx(of_both, rel=0.03)
    # the floor is for straight lines between the rows of the faces; cubics pass on a tenth less of their noise
    assert result["flux_gap"]["after_W_per_m2"] == pytest.approx(result["flux_gap"]["floor_W_per_m2"], rel=0.15)
    page = check((out / "report.html").read_text("utf-8"))
    assert "Thermal resistance" in page.text and "residual of the fluxes" in page.text
    assert any(image["alt"].startswith("The estimate converges to") for image in page.images)
    wrong = CliRunner().invoke(app, ["estimate", written(tmp_path), "--weights", "none", "--out", str(out)])
    assert wrong.exit_code == 2 and "sensor" in wrong.stderr


def test_a_design_of_fluxes_on_the_command_line(tmp_path):
    out = tmp_path / "out"
    result = result_of("design", written(tmp_path), "--out", str(out))
    assert result["design"]["full"] and 0.0 < result["design"]["expected_relative_std"] < 0.01
    assert (out / "design.png").exists() and "Experiment design" in (out / "report.html").read_text("utf-8")


@pytest.mark.slow
def test_all_windows_of_fluxes_on_the_command_line(tmp_path):
    out = tmp_path / "out"
    result = result_of("estimate", written(tmp_path, windows=2), "--all-windows", "--out", str(out))
    for key in ("conductivity", "heat_capacity", "resistance", "areal_heat_capacity", "transmittance"):
        assert set(result[key]) == {"value", "std", "interval_95", "unit"}
    assert result["iso_9869"]["flux_right"]["days"] == 6.0
    assert result["windows"]["conductivities"]["degrees_of_freedom"] == 1
    each = [window["resistance"]["value"] for window in result["windows"]["each"]]
    assert min(each) < result["resistance"]["value"] < max(each)
    page = check((out / "report.html").read_text("utf-8"))
    assert "Thermal resistance" in page.text and "a resistance from face to face of" in page.text
    assert any("m² K/W" in image["alt"] for image in page.images if image["alt"].startswith("Intervals of 2 windows"))


def test_the_london_wall_as_a_homogeneous_slab(measured):
    """R within 0.42 to 0.46 m2K/W, C within 300 to 345 kJ/m2K, without contact resistances and a disturbance."""
    slab = [kind for kind in NUISANCE_KINDS if not isinstance(kind, ContactResistances)]
    fit = wallid.estimate(london(measured, noise="robust", disturbance="none"), nuisance=slab)
    told = fit.thermal
    assert fit.reliable
    assert 0.42 < told.resistance.value < 0.46
    assert 300e3 < told.areal_heat_capacity.value < 345e3
    assert [round(one.resistance, 3) for one in told.average_methods] == [0.372, 0.465], "as published of this record"


@pytest.mark.slow
def test_the_days_of_the_london_wall_agree_with_the_whole(measured):
    """By default: a contact resistance and heat behind the outer face are found; R of each day and of all together."""
    case = london(measured)
    whole = wallid.estimate(case).thermal
    assert whole.held_out.coverage > 0.75, "measured 0.87: the first half knows only half of the disturbance"
    found = wallid.campaign(case, window_days=0.99)
    assert len(found.used) == 3 and all(fit.disturbance.place == "right" for fit in found.fits)
    assert 0.42 < found.thermal.resistance.value < 0.46
    for fit in found.fits:
        one = fit.thermal.resistance
        assert abs(one.value - whole.resistance.value) < 2.5 * np.hypot(one.std, whole.resistance.std)
        assert 0.02 < fit.thermal.contact_resistances["left"].value < 0.04
