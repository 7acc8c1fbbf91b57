"""Intervals against truths that are drawn from an analytic slab (no part of wallid), and against bounds."""

import json
import re
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.accuracy import ice, interval
from benchmarks.reference.analytic_slab import temperatures, weather
from benchmarks.reference.synthetic_twins import slab_response
from numpy.testing import assert_allclose
from own_case import write_own
from scipy.fft import dct
from scipy.linalg import solve_banded, toeplitz
from scipy.stats import kstest
from typer.testing import CliRunner

import wallid
from wallid.case.initial_profile import profile_degree, scales
from wallid.cli.commands import app
from wallid.estimation import conclusion as conclude
from wallid.inference.common_noise import wiener_filtered_noise
from wallid.inference.noise_covariance import NoiseShape, bin_readings, restricted_to_reading_rows
from wallid.inference.position_errors import face_position_response
from wallid.inference.validity import distinguishable_range
from wallid.inference.whittle_likelihood import dct_spectrum, edge_spectrum
from wallid.models.finite_volume_wall import Output, finite_volume_model
from wallid.models.sensitivity_equations import simulate_window
from wallid.models.window_inputs import window_data
from wallid.records.face_filter import FaceNoise
from wallid.records.face_variation import FaceErrors
from wallid.records.uniform_record import Record

STATED = {"noise": "stated"}
STEP = interval.STEP / interval.PARTS  # s, between the times at which the true faces are known


def drawn(kind, seed, **choices):
    """A case of `benchmarks.accuracy.interval`, its true faces and its errors."""
    errors = interval.KINDS[kind]
    faces, measured, readings = interval.draw(errors, seed)
    case = interval.case_of(errors, measured, readings)
    return replace(case, choices=replace(case.choices, **choices)), faces, errors


def fine_weather(rng):
    """True faces that vary within the rows, with their past, and their readings without noise in the window."""
    fine = weather((interval.BEFORE + interval.ROWS - 1) * interval.PARTS + 1, STEP, rng, hours=(8.0, 2.0))
    return fine, interval.at_rows(fine)[-interval.ROWS :]


def estimated(case, **options):
    return wallid.estimate(case, None, wallid.full_order_model(case), **options)


def test_the_truths_own_series_is_the_analytic_slab():
    t, omega = np.arange(200) * 900.0, 2 * np.pi / 86400
    x = np.array([0.1, 0.25, 0.4])
    want, _ = slab_response(x, t, length=0.5, diffusivity=6e-7, harmonics=((omega, 0.0, 6.0),))
    faces = np.stack([6 * np.sin(omega * t), 0 * t], axis=1)
    found = temperatures(faces, 900.0, x / 0.5, 6e-7 / 0.25)
    # of straight lines between the rows of a sine: at most omega^2 h^2 / 8 of its amplitude
    assert np.abs(found - want).max() < 6 * (omega * 900) ** 2 / 8


@pytest.mark.usefixtures("faces_known_between_rows")
@pytest.mark.parametrize("kind", ["propagated", "positions", "faces"])
def test_the_standard_error_is_the_cramer_rao_bound(kind):
    """With noise as stated, against the bound by SciPy with the covariance that the errors are drawn from."""
    case, faces, errors = drawn(kind, 3, **STATED)
    case = replace(case, record=replace(case.record, faces=interval.at_rows(faces)[-interval.ROWS :]))
    fit = estimated(case)
    assert fit.rounds and fit.interval_kind == "normal"
    widened = np.sqrt(max(1.0, fit.reduced_chi_square))
    # at the estimate instead of the truth, and with what the sensors may share of the faces' noise free
    assert fit.std / fit.value / widened == pytest.approx(interval.best_std(errors, faces), rel=0.12)


@pytest.mark.slow
def test_intervals_hold_the_truth():
    """The benchmark takes 2000 of each kind; of 20 that hold with 95 %, 15 do in all but 0.03 % of cases."""
    for kind in ("propagated", "positions"):
        rows = interval.many(kind, range(500, 520))
        assert all(row.reliable for row in rows)
        assert sum(row.low <= 0 <= row.high for row in rows) >= 15
        width = np.mean([(row.high - row.low) / (2 * interval.NORMAL_95 * row.best) for row in rows])
        assert 0.9 < width < 1.35


def test_an_interval_that_forgets_the_faces_is_too_small(monkeypatch):
    case, *_ = drawn("propagated", 4, **STATED)
    unstated = replace(case, record=replace(case.record, boundary_noise_std=0.0))
    counted, seen = estimated(case), estimated(unstated)
    assert counted.variance_shares["faces' noise"] > 0.25 and sum(counted.variance_shares.values()) == pytest.approx(
        1.0
    )
    assert seen.std > 0.9 * counted.std, "the faces themselves show their noise"
    monkeypatch.setattr(Record, "face_errors", FaceErrors.none())
    forgotten = estimated(replace(unstated, record=replace(unstated.record)))
    assert counted.std > 2 * forgotten.std / np.sqrt(max(1.0, forgotten.reduced_chi_square))


def test_memory_in_the_noise_is_found_and_counted():
    case, *_ = drawn("correlated", 5)
    fit, stated = estimated(case), estimated(replace(case, choices=replace(case.choices, **STATED)))
    assert "correlation" in fit.noise_description and stated.noise_description == "noise as stated"
    assert fit.std > 1.3 * stated.std


def test_position_errors_are_found_as_constants():
    errors = interval.Errors(0.02, 0.005, position=0.01)
    fine, faces = fine_weather(np.random.default_rng(8))
    shift = np.array([0.008, -0.011, 0.004])
    noise = 0.02 * np.random.default_rng(9).standard_normal((interval.ROWS, 3))
    readings = interval.truth(fine, np.array(interval.PLACES) + shift) + noise
    fit = estimated(interval.case_of(errors, faces, readings))
    for (value, std), true in zip(fit.positions.values(), shift, strict=True):
        assert abs(value - true) < 4 * std < 0.02
    low, high = fit.interval_95
    assert low < interval.DIFFUSIVITY < high


@pytest.mark.slow
def test_the_places_of_the_faces_sensors_are_counted():
    """Of 20 intervals that hold the truth with 95 %, 15 do in all but 0.03 % of cases; of fewer hold without."""
    kind, held = interval.KINDS["faces"], []
    for seed in range(20):
        _, measured, readings = interval.draw(kind, seed)
        stated = [replace(kind, face_position=std) for std in (kind.face_position, 0.0)]
        ends = [estimated(interval.case_of(errors, measured, readings)).interval_95 for errors in stated]
        held.append([low < interval.DIFFUSIVITY < high for low, high in ends])
    counted, forgotten = np.sum(held, axis=0)
    assert counted >= 15 and forgotten < 12
    fit = estimated(interval.case_of(kind, measured, readings))
    assert fit.variance_shares["faces' places"] > 0.1
    assert all(abs(value) < 4 * kind.face_position and std < 1.2 * kind.face_position
               for value, std in fit.face_positions.values())  # fmt: skip
    assert "position     left face" in str(fit)
    assert any("left face's sensor" in name for name in fit.identifiability.names)


def test_what_a_faces_place_does_to_the_readings():
    """Against the model of a wall between the true places, by differences."""
    case, *_ = drawn("white", 1)
    case, std, step = replace(case, record=replace(case.record, face_position_std=0.01)), 0.01, 1e-5
    window, length, alpha = wallid.Window(0, interval.ROWS), case.wall.length, 6e-7
    data = window_data(case, window)
    outputs = [Output(sensor.position, name=sensor.name) for sensor in case.sensors] + [Output(0.0, "flux")]

    def run_between(left, right):
        wall = wallid.Wall(length=length + right - left, diffusivity_prior=alpha)
        moved = [replace(one, position=one.position - left if one.position else 0.0) for one in outputs]
        fourier = jnp.asarray(scales(case).fourier_number(alpha) * (length / wall.length) ** 2)
        found = (
            data.temperature
            * simulate_window(
                finite_volume_model(wall, moved, nodes=61, profile_degree=profile_degree(case)), fourier, data
            )[0]
        )
        return found.at[:, -1].multiply(length / wall.length)  # k over the length

    seen = [*outputs, *(Output(sensor.position, "gradient") for sensor in case.sensors)]
    found = face_position_response(
        case, data, alpha, finite_volume_model(case.wall, seen, nodes=61, profile_degree=profile_degree(case))
    )
    for face in (0, 1):
        ends = [run_between(*(np.arange(2) == face) * one) for one in (step, -step)]
        want = std * (ends[0] - ends[1]) / (2 * step)
        assert_allclose(found[face], want, atol=2e-3 * np.abs(want).max(axis=0).min())


def test_what_contradicts_the_instruments_as_stated_is_not_relied_on():
    errors = interval.Errors(0.02, 0.005, position=0.002)
    fine, faces = fine_weather(np.random.default_rng(8))
    noise = 0.02 * np.random.default_rng(9).standard_normal((interval.ROWS, 3))
    places = np.array(interval.PLACES) + np.array([0.0, 0.015, 0.0])
    readings = interval.truth(fine, places) + noise
    fit = estimated(interval.case_of(errors, faces, readings))
    assert not fit.reliable and fit.reason.startswith("the position error of T1 would be +0.01")
    assert "times its stated standard deviation" in fit.reason and "wallid diagnose" in fit.reason


@pytest.mark.parametrize(("moves", "stated", "says"), [(0.02, 0.1, False), (1.0, 0.1, True), (0.02, 0.005, True)])
def test_sensors_too_coarse_for_what_moves_say_nothing(moves, stated, says):
    places, course = np.array(interval.PLACES), np.random.default_rng(3)
    fine, faces = fine_weather(course)
    faint = (0.05 if moves == 1.0 else 0.02) * fine
    error = interval.truth(faint, places, 2 * interval.DIFFUSIVITY) - interval.truth(faint, places)
    assert np.ptp(error, axis=0).max() < 0.1, "a sensor good to 0.1 K may err so"
    noise = 0.002 * course.standard_normal(error.shape)
    readings = interval.truth(moves * fine, places) + (error if stated == 0.1 else 0.0) + noise
    case = interval.case_of(interval.Errors(0.002, 0.002, offset=stated), moves * faces, readings)
    fit = estimated(case)
    assert ("less than its stated offset_std" in fit.reason) is not says
    erring = says and stated == 0.1  # the sensors' errors of up to 0.1 K are no noise of 0.002 K
    assert ("times the stated noise" in fit.reason) is erring and fit.reliable is (says and not erring)
    assert fit.value == pytest.approx(interval.DIFFUSIVITY * (1 if says else 2), rel=0.05)


def by_steps(faces, diffusivity, cells=160):
    """Temperatures at the places of a wall whose diffusivity changes from row to row: implicit steps on a fine grid."""
    x, dx = np.linspace(0.0, interval.LENGTH, cells + 1), interval.LENGTH / cells
    T, found, fine = np.interp(x, [0, interval.LENGTH], faces[0]), [], 12
    for before, after, alpha in zip(faces[:-1], faces[1:], diffusivity, strict=True):
        found.append(np.interp(interval.PLACES, x, T))
        r = alpha * interval.STEP / fine / dx**2
        band = np.zeros((3, cells + 1))
        band[0, 2:], band[1], band[2, :-2] = -r / 2, 1 + r, -r / 2
        band[1, [0, -1]] = 1.0
        for k in range(1, fine + 1):
            right = T.copy()
            right[1:-1] += r / 2 * (T[2:] - 2 * T[1:-1] + T[:-2])
            right[[0, -1]] = before + (after - before) * k / fine
            T = solve_banded((1, 1), band, right)
    return np.array([*found, np.interp(interval.PLACES, x, T)])


@pytest.mark.parametrize("later", [1.0, 1.6])
def test_a_diffusivity_that_changes_in_the_window_is_not_relied_on(later):
    rng = np.random.default_rng(4)
    faces = weather(interval.BEFORE + interval.ROWS, interval.STEP, rng)
    course = np.full(len(faces) - 1, interval.DIFFUSIVITY)
    course[-interval.ROWS // 2 :] *= later
    readings = by_steps(faces, course)[-interval.ROWS :] + 0.02 * rng.standard_normal((interval.ROWS, 3))
    fit = estimated(interval.case_of(interval.Errors(0.02, 0.005), faces[-interval.ROWS :], readings))
    assert fit.reliable == (later == 1.0)
    assert ("not constant over the window" in fit.reason) == (later != 1.0)


@pytest.mark.slow
def test_a_steady_diffusivity_is_called_unsteady_as_often_as_chance_says(monkeypatch):
    seen = []
    monkeypatch.setattr(conclude, "why_not_constant", lambda case, fit: seen.append(fit.constancy_p_value) or "")
    for kind in ("propagated", "correlated"):
        interval.many(kind, range(600, 630))
    assert len(seen) == 60
    assert kstest(seen, "uniform").pvalue > 1e-3


def test_the_bootstrap_agrees_with_the_standard_error():
    case, *_ = drawn("positions", 6)
    fit = estimated(case, draws=200)
    found = fit.bootstrap
    # of 200 draws a standard deviation has a relative error of 5 %; four of them, and the noise's own uncertainty
    assert found.std == pytest.approx(fit.std, rel=0.25)
    assert abs(found.bias) < 4 / np.sqrt(200) + 0.1
    assert_allclose(np.log(found.interval_95), np.log(fit.interval_95), atol=0.8 * fit.std / fit.value)
    again = estimated(case, draws=200).bootstrap
    assert_allclose(again.values, found.values, rtol=1e-9), "the seed decides"


def test_where_nothing_moves_the_interval_reaches_the_bound():
    errors = interval.KINDS["white"]
    still = np.full((interval.ROWS, 2), 15.0)
    rng = np.random.default_rng(1)
    case = interval.case_of(errors, still, 15 + errors.sensor * rng.standard_normal((interval.ROWS, 3)))
    fit = estimated(case)
    low, high = distinguishable_range(case, wallid.Window(0, interval.ROWS))
    assert not fit.reliable and fit.bootstrap is None
    assert fit.interval_kind == "profile likelihood"
    assert fit.interval_95[0] < 2 * low or fit.interval_95[1] > 0.5 * high
    assert str(fit).startswith("diffusivity  NOT TO BE RELIED ON")


def test_noise_of_one_logger_is_no_heat():
    """Faces at rest, and noise that all sensors share: it comes through at once, which is no diffusivity."""
    rng, rows = np.random.default_rng(2), interval.ROWS
    shared, own = 0.01 * rng.standard_normal((rows, 1)), 0.006 * rng.standard_normal((rows, 5))
    readings = -3 + shared + own
    case = interval.case_of(interval.Errors(0.012, 0.012), readings[:, :2], readings[:, 2:])
    assert not estimated(case).reliable


def test_a_record_has_two_ends():
    """The variance of cosine coefficients of an autoregression, against its transformed covariance matrix."""
    for count in (7, 72, 101):
        cov, omega = 0.9 ** np.arange(count), np.pi * np.arange(count) / count
        D = dct(np.eye(count), type=2, norm="ortho", axis=0)
        found = 2 * dct_spectrum(cov, omega) - cov[0] - edge_spectrum(cov, omega)
        assert_allclose(found, np.diag(D @ toeplitz(cov) @ D.T), rtol=1e-10, atol=1e-12)


def test_what_of_a_faces_readings_may_be_noise():
    rng = np.random.default_rng(3)
    t = np.arange(400)
    signal, noise = 5 * np.sin(2 * np.pi * t / 24), 0.1 * rng.standard_normal(400)
    assert np.corrcoef(wiener_filtered_noise(signal + noise, 0.1), noise)[0, 1] > 0.7
    assert np.std(wiener_filtered_noise(signal, 0.1)) < 0.05, "what varies more than noise is none"


def test_readings_far_apart_are_thinned_and_not_taken_for_means():
    """A reading every 120 rows: the sensor's noise is that of one reading, the faces' that of 120."""
    present = np.zeros((2881, 2), bool)
    present[::120] = True
    assert bin_readings(present, np.zeros((2881, 2)), plates=True)[1] == 1, "a flux answers to the rows before it"
    bins, apart = bin_readings(present, np.zeros((2881, 2)), plates=False)
    assert apart == 120 and bins.rows_per_bin == 120
    response = np.full((2, 2881, 2), 1e-3)
    thin, few, errors = restricted_to_reading_rows(response, bins, apart, np.zeros((2, 24)))
    shape = NoiseShape(thin, few, np.array([0.1, 0.2]), FaceNoise.white(0.05), errors)
    R = shape.covariance_of(1.0, 0.0, 0.5).covariance
    assert R.shape == (50, 50)
    # the last reading sees the noise of all rows before, each with 1e-3, from two faces
    assert R[24, 24] == pytest.approx(0.1**2 + 2 * 2881 * (0.05 * 1e-3) ** 2, rel=0.05)


def test_the_range_that_a_window_can_tell():
    case, *_ = drawn("white", 0)
    low, high = distinguishable_range(case, wallid.Window(0, 72))
    assert low < 1e-8 and high > 1e-5, "far on both sides of any wall"
    exact = replace(case, sensors=tuple(replace(sensor, noise_std=1e-4) for sensor in case.sensors))
    low, high = distinguishable_range(exact, wallid.Window(0, 72))
    assert distinguishable_range(exact, wallid.Window(0, 36))[0] == pytest.approx(2 * low)
    # a face that hardly moves must come farther to be more than noise
    quiet = replace(exact, record=replace(exact.record, faces=20 + 1e-4 * (exact.record.faces - 20)))
    assert distinguishable_range(quiet, wallid.Window(0, 72))[0] > 3 * low
    still = replace(exact, record=replace(exact.record, faces=np.full_like(exact.record.faces, 20.0)))
    assert low < distinguishable_range(still, wallid.Window(0, 72))[0] < 100 * low


@pytest.mark.parametrize(
    ("borehole", "start", "informative", "reason"),
    [
        ("borehole_248", "2014-12-01", True, ""),
        ("borehole_248", "2014-12-15", True, ""),
        ("borehole_248", "2014-12-29", False, "would change T_1m by 0.03"),
        ("borehole_248", "2015-01-12", False, "spans a factor of"),
        # what had been stirred up in the hole until the day before
        ("borehole_247", "2014-12-01", False, "times its stated standard deviation"),
    ],
)
def test_the_ice_is_known_or_nothing_is_said(measured, tmp_path, borehole, start, informative, reason):
    """The issue's figure on some of its fortnights; `benchmarks.accuracy.ice` takes all of them."""
    found = next(f for f in ice.fortnights(measured, borehole, tmp_path) if f.start == start)
    assert found.informative is informative and reason in found.reason
    assert found.right and (not informative or found.high < 1.5 * found.low)


def test_the_bootstrap_on_the_command_line(tmp_path):
    case = write_own(tmp_path)
    words = ["estimate", str(case), "--model", "lom", "--from-row", "0", "--out", str(tmp_path / "out")]
    ended = CliRunner().invoke(app, [*words, "--bootstrap", "40", "--json"])
    assert ended.exit_code == 0, ended.stderr
    result = json.loads(ended.stdout)
    drawn = result["interval"]["bootstrap"]
    assert drawn["draws"] == 40 and drawn["std"] == pytest.approx(result["diffusivity"]["std"], rel=0.6)
    assert CliRunner().invoke(app, [*words, "--bootstrap", "3"]).exit_code == 2
    refused = CliRunner().invoke(app, [*words, "--bootstrap", "40", "--weights", "none"])
    assert refused.exit_code == 2 and "--weights" in refused.stderr


@pytest.mark.parametrize(
    ("size", "memory", "reliable", "word"),
    [
        (1.0, 0.0, True, ""),
        (1.0, 0.9, True, ""),
        (0.3, 0.0, True, "noise_std = "),
        (2.2, 0.0, True, "noise_std = "),
        (2.5, 0.95, False, "times the stated noise"),
        (6.0, 0.0, False, "times the stated noise"),
    ],
)
def test_the_noise_found_is_held_against_the_noise_stated(size, memory, reliable, word):
    """Far larger or remembered: an effect is missing; somewhat larger or smaller: which value to state."""
    drawn = interval.Errors(0.05 * size, 0.002, memory=memory)
    _, measured, readings = interval.draw(drawn, 11)
    fit = estimated(interval.case_of(interval.Errors(0.05, 0.002), measured, readings))
    assert fit.reliable is reliable, fit.reason
    words = fit.reason if not reliable else " ".join(fit.advice)
    assert word in words
    assert bool(fit.advice) is (reliable and bool(word))
    if fit.advice:
        stated = re.search(r"noise_std = ([0-9.]+) instead", words)
        assert stated is not None and float(stated[1]) == pytest.approx(0.05 * size, rel=0.2)
    assert fit.noise_ratio == pytest.approx(size, rel=0.5)
