"""Estimates of walls with heat that no column explains, and its course; truths are sine series and SciPy's solver."""

import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.accuracy import disturbance
from benchmarks.accuracy.disturbance import CAPACITY, DIFFUSIVITY, FINE, LENGTH, Kind
from benchmarks.reference.analytic_slab import heated, weather
from heated_walls import case_of, hidden_heat
from scipy.linalg import solve_banded
from scipy.signal import lfilter
from scipy.stats import binom

import wallid
from wallid.case.options import Choices
from wallid.estimation import heat_flux, smoothed_disturbance
from wallid.estimation.unknown_heat import column_followed
from wallid.inference import generalised_least_squares as gls
from wallid.inference.contact_test import SIGNIFICANT, contact_scores
from wallid.inference.disturbance_search import find_disturbance
from wallid.inference.generalised_least_squares import fit_generalised_least_squares
from wallid.inference.nuisance_kinds import NUISANCE_KINDS, ContactResistances
from wallid.models.flux_plates import full_order_model_with_plates
from wallid.models.window_inputs import window_data
from wallid.report.result_json import result_entries
from wallid.workflow import Run


def with_option(case, option):
    return replace(case, choices=replace(case.choices, disturbance=option, model="lom"))


def full_order_fit(case, **options):
    """The fit of the entire record with the full-order model."""
    window, model = wallid.Window(0, case.record.rows), full_order_model_with_plates(case)
    data, first = window_data(case, window), case.wall.diffusivity_prior
    return fit_generalised_least_squares(case, window, data, model, first, eta=1e-6, **options)


def test_heat_released_inside_balances_what_leaves():
    """Of the simulator: what is released and does not leave through the faces is stored."""
    rng, x = np.random.default_rng(0), np.linspace(0, 1, 401)
    heat = np.convolve(rng.standard_normal(4000), np.ones(50) / 50, mode="same")
    heat[0] = 0.0
    rate, profile = 3e-6, np.exp(-x / 0.2)
    places = (np.arange(400) + 0.5) / 400
    inside, through = heated(heat, 60.0, profile, rate, places)
    stored = inside.mean(axis=1)
    released = np.sum(0.5 * (heat[1:] + heat[:-1])) * 60.0 * np.trapezoid(profile, x)
    left = np.sum(0.5 * (through[1:] + through[:-1]) @ [-1.0, 1.0]) * 60.0 * rate
    assert stored[-1] - stored[0] == pytest.approx(released - left, abs=2e-3 * np.abs(stored).max())


@pytest.mark.parametrize(
    ("kind", "places"),
    [
        pytest.param(Kind("sensors", "wall", 3.0), {"wall"}, id="in the wall"),
        pytest.param(Kind("plates", "face", 48.0), {"right"}, id="behind a face", marks=pytest.mark.slow),
    ],
)
def test_the_interval_holds_the_truth_with_a_disturbance(kind, places):
    case = case_of(kind)
    fit = wallid.estimate(with_option(case, "auto"))
    assert fit.reliable and fit.disturbance.place in places and fit.disturbance.evidence > 10
    low, high = fit.interval_95
    assert low < DIFFUSIVITY < high
    if fit.thermal is not None:
        for name, truth in (("resistance", 0.4), ("areal_heat_capacity", LENGTH * CAPACITY)):
            low, high = getattr(fit.thermal, name).interval_95
            assert low < truth < high
    plain = wallid.estimate(with_option(case, "none"))
    assert plain.disturbance is None and not plain.reliable
    entry = result_entries(Run(case, fit=fit))["disturbance"]
    assert set(entry) >= {"place", "std", "unit", "time_constant", "evidence"}
    json.dumps(entry, allow_nan=False)
    assert "no column explains" in str(fit) and "disturbance" in fit.variance_shares


@pytest.mark.parametrize(("logged", "number"), [("plates", 32), pytest.param("sensors", 359, marks=pytest.mark.slow)])
def test_a_large_disturbance_is_found_where_it_is(logged, number):
    """Under the noise alone these records give a third of the diffusivity and less.

    There heat behind a face explains the first one, noise with a long memory the second.
    """
    case = disturbance.case_of(Kind(logged, "wall", 48.0), number, disturbance="auto")
    fit = full_order_fit(case)
    assert fit.disturbance.place == "wall" and fit.disturbance.noise_size < 2
    assert abs(np.log(fit.diffusivity / DIFFUSIVITY)) < 3 * fit.log_std
    without = full_order_fit(replace(case, choices=replace(case.choices, disturbance="none", noise="stated")))
    assert without.diffusivity < DIFFUSIVITY / 2


def test_the_first_search_does_not_lead_to_heat_of_another_depth():
    """Under the noise alone the first half of this record gives half of the diffusivity.

    The depth that explains the residual there is a third of the wall, and the next fits stay with it.
    """
    case = disturbance.case_of(Kind("plates", "face", 48.0, 78), 0, disturbance="auto")
    half = case.record.rows // 2
    fit = full_order_fit(case, rows_used=half)
    assert fit.disturbance.place == "right" and fit.disturbance.profile.depth < 0.2
    assert abs(np.log(fit.diffusivity / DIFFUSIVITY)) < 3 * fit.log_std
    # where an earlier search has left heat, one of its probable depths is found; nothing where it has left none
    again = full_order_fit(case, rows_used=half, heat_among=fit.disturbance.probable)
    assert again.disturbance.profile in {one.profile for one in fit.disturbance.probable}
    assert again.disturbance.place == "right" and abs(again.log_alpha - fit.log_alpha) < fit.log_std
    assert again.log_std == pytest.approx(fit.log_std, rel=0.05)
    assert full_order_fit(case, rows_used=half, heat_among=()).disturbance is None


@pytest.mark.slow
def test_further_searches_of_everything_change_nothing(monkeypatch):
    """The search ends early and is limited to what the last one left; without that the estimate is the same."""
    case = disturbance.case_of(Kind("plates", "face", 3.0, 78), 0, disturbance="auto")
    fit = full_order_fit(case)
    monkeypatch.setattr(gls, "_MOVED", 0.0)
    monkeypatch.setattr(gls, "_CONVERGED", 0.0)
    monkeypatch.setattr(gls, "find_disturbance", lambda *arguments: find_disturbance(*arguments[:6]))
    further = full_order_fit(case)
    assert further.iterations > fit.iterations and np.log(further.diffusivity / fit.diffusivity) != 0.0
    assert abs(np.log(further.diffusivity / fit.diffusivity)) < 0.1 * fit.log_std
    assert further.log_std == pytest.approx(fit.log_std, rel=0.05)


def test_heat_behind_a_face_is_not_taken_for_a_contact_resistance(monkeypatch):
    """Also where the score of a resistance is taken for significant: other heat explains the record about as well."""
    case = disturbance.case_of(Kind("plates", "face", 3.0, 2813), 30, disturbance="auto")
    kinds = [kind for kind in NUISANCE_KINDS if not isinstance(kind, ContactResistances)]
    scores = contact_scores(case, full_order_fit(case, kinds=kinds))
    assert 2.0 < max(scores.values()) < SIGNIFICANT
    monkeypatch.setattr(gls, "SIGNIFICANT", 2.0)
    fit = full_order_fit(case)
    assert not fit.parameters.of_kind(ContactResistances.kind)
    assert abs(np.log(fit.diffusivity / DIFFUSIVITY)) < 2 * fit.log_std


@pytest.mark.parametrize("number", [23, 44])
def test_noise_of_the_faces_is_not_taken_for_a_contact_resistance(number):
    """Faces with 0.06 K, of which a part passed for gusts that never reach the plates: errors of 7 standard errors."""
    noisy = Kind("plates", "face", 3.0, 2815, face_std=0.06)
    fit = full_order_fit(disturbance.case_of(noisy, number, disturbance="auto"))
    assert not fit.parameters.of_kind(ContactResistances.kind)
    assert abs(np.log(fit.diffusivity / DIFFUSIVITY)) < 2 * fit.log_std


@pytest.mark.parametrize("number", [3, 4])
def test_the_depth_of_heat_behind_a_face_is_found_between_the_doubled_ones(number, monkeypatch):
    """Heat that decays over 4 cm of 30: with 2.5 and 5 cm alone, errors of the diffusivity were twice as large."""
    monkeypatch.setattr(disturbance, "DECAYS", (0.04, 0.04))
    fit = full_order_fit(disturbance.case_of(Kind("plates", "decaying", 3.0), number, disturbance="auto"))
    assert fit.disturbance.place == "right"
    assert abs(np.log(fit.disturbance.profile.depth * LENGTH / 0.04)) < 0.15
    depths = {one.profile.depth for _, one in fit.disturbance.alternatives}
    assert len(depths) > 1 and fit.disturbance.inflation[0] > 1  # the interval knows more than one depth
    assert abs(np.log(fit.diffusivity / DIFFUSIVITY)) < 2 * fit.log_std


def test_a_default_that_is_stated_changes_nothing():
    """With plates a disturbance is searched for where the noise is estimated, by default or as stated."""
    case = case_of(Kind("plates", "wall", 48.0))
    assert case.choices.disturbance is None and case.choices.noise is None
    default = wallid.estimate(case)
    stated = wallid.estimate(replace(case, choices=replace(case.choices, noise="estimated")))
    assert default.disturbance is not None and stated.value == default.value and stated.std == default.std


def test_without_hidden_heat_nothing_is_found():
    """With "on" the size is small and the interval hardly wider."""
    case = case_of(Kind("sensors", "nothing", 3.0))
    auto, on, none = (wallid.estimate(with_option(case, option)) for option in ("auto", "on", "none"))
    assert auto.disturbance is None and auto.value == none.value and auto.std == none.std
    assert on.disturbance is not None and on.disturbance.evidence < 10 and on.disturbance.std < 0.5
    assert none.std < 2 * on.std < 4 * none.std


def test_the_smoothed_heat_is_like_the_hidden_one():
    """And it follows the column that is the hidden heat two hours earlier, among others that are not."""
    kind = Kind("sensors", "wall", 3.0)
    hidden, stride = 86400.0 * hidden_heat(kind), round(1800.0 / FINE)
    rows = np.arange(0, len(hidden), stride)
    early = hidden[np.minimum(rows + round(7200.0 / FINE), len(hidden) - 1)]
    case = case_of(kind)
    other = np.random.default_rng(1).standard_normal(kind.rows).cumsum()
    record = replace(case.record, regressors={"irradiance": early, "wind": other})
    found = smoothed_disturbance(replace(case, record=record))
    assert np.corrcoef(found.course, hidden[rows])[0, 1] > 0.9
    assert found.follows.column == "irradiance" and found.follows.significant
    assert abs(found.follows.lag - 7200.0) <= 1800.0
    assert "irradiance" in found.sentence and found.unit == "K/day"
    assert found.to_frame().shape == (kind.rows, 2) and json.dumps(found.to_dict(), allow_nan=False)
    inside = np.abs(found.course - hidden[rows]) < 2 * found.std
    assert inside.mean() > 0.85


def test_a_course_that_follows_nothing_is_not_said_to_follow():
    """Over many pairs of independent courses few p-values are below 5 %."""
    rng, small = np.random.default_rng(3), 0
    for _ in range(40):
        one, other = (np.convolve(rng.standard_normal(400), np.ones(20), mode="valid") for _ in range(2))
        small += column_followed(one, {"wind": other}, 1800.0).significant
    assert small <= 6
    assert column_followed(one, {}, 1800.0) is None
    assert column_followed(one, {"rain": np.zeros(len(one))}, 1800.0) is None


@pytest.mark.parametrize("hours", [3.0, 48.0, 200.0])
def test_slow_heat_follows_nothing_by_chance(hours):
    """With a memory as long as the record, five days: first-order autoregressions that are independent."""
    rng, rows, draws = np.random.default_rng(5), 240, 150

    def course():
        decay = np.exp(-0.5 / hours)
        noise = np.sqrt(1 - decay**2) * rng.standard_normal(rows)
        return lfilter([1.0], [1.0, -decay], noise, zi=[decay * rng.standard_normal()])[0]

    small = sum(column_followed(course(), {"wind": course()}, 1800.0, seed).significant for seed in range(draws))
    assert small <= binom.ppf(0.999, draws, 0.05)


def test_readings_that_do_not_depend_on_the_diffusivity_have_no_disturbance():
    """Faces and wall are always as warm: the estimate says so."""
    case = case_of()
    rng, rows = np.random.default_rng(0), case.record.rows
    record = replace(case.record, faces=np.full((rows, 2), 20.0), sensors=20.0 + 0.05 * rng.standard_normal((rows, 2)))
    choices = replace(case.choices, disturbance="auto", model="lom", initial_coefficients=(20.0,))
    fit = wallid.estimate(replace(case, record=record, choices=choices))
    assert not fit.reliable and fit.disturbance is None


def test_a_disturbance_needs_noise_that_is_estimated():
    for noise in ("stated", "robust"):
        with pytest.raises(wallid.InputError, match="state only one"):
            Choices(noise=noise, disturbance="auto")
        assert Choices(noise=noise, disturbance="none").noise == noise


def test_contacts_are_those_of_one_wall_in_all_windows(monkeypatch):
    """One of two windows shows a contact: both are estimated with it, and pooled."""
    case = case_of(Kind("plates", "nothing", 3.0))
    case = replace(case, choices=replace(case.choices, disturbance="none", noise="stated", nodes=41, model="lom"))
    scores = iter([9.0, 0.0])
    monkeypatch.setattr(gls, "contact_scores", lambda case, fit: {"left": next(scores), "right": 0.0})
    monkeypatch.setattr(heat_flux, "_second_half_prediction", lambda *arguments: None)
    found = wallid.campaign(case, window_days=1.5)
    assert len(found.fits) == 2 and set(found.thermal.contact_resistances) == {"left", "right"}


def slab_with_contacts(contact, rows=288, step=900.0, seed=2):
    """A wall of two plates, with a resistance between each face and its sensor, m2 K/W; Crank-Nicolson by SciPy."""
    parts, cells, k, c = 15, 150, 0.75, 1.5e6
    before = 10 * 96
    faces = weather((before + rows) * parts, step / parts, np.random.default_rng(seed), hours=(8.0, 2.0))
    width, h = LENGTH / cells, step / parts
    ends = 1.0 / (width / (2 * k) + np.array(contact))  # W/m2/K
    conductance = np.concatenate([[ends[0]], np.full(cells - 1, k / width), [ends[1]]])
    diagonal = -(conductance[:-1] + conductance[1:]) / (c * width)
    beside = conductance[1:-1] / (c * width)
    bands = np.zeros((3, cells))
    bands[0, 1:], bands[1], bands[2, :-1] = -0.5 * h * beside, 1 - 0.5 * h * diagonal, -0.5 * h * beside
    T, through = np.interp((np.arange(cells) + 0.5) / cells, [0, 1], faces[0]), []
    for now, then in itertools.pairwise(faces):
        through.append([ends[0] * (now[0] - T[0]), ends[1] * (T[-1] - now[1])])
        b = T + 0.5 * h * diagonal * T
        b[1:] += 0.5 * h * beside * T[:-1]
        b[:-1] += 0.5 * h * beside * T[1:]
        b[[0, -1]] += 0.5 * h * ends * (now + then) / (c * width)
        T = solve_banded((1, 1), bands, b)
    rng, some = np.random.default_rng(seed + 1), slice(before * parts, None, parts)
    time = step * np.arange(rows)
    flux = np.array(through)[some][:rows] + 0.3 * rng.standard_normal((rows, 2))
    record = wallid.Record(
        time, time, None, faces[some][:rows] + 0.01 * rng.standard_normal((rows, 2)), np.empty((rows, 0)), (),
        regressors={"flux_left": flux[:, 0], "flux_right": flux[:, 1]},
        boundary_noise_std=0.01, flux_noise_std=0.3, flux_gain_std=0.02,
    )  # fmt: skip
    wall = wallid.Wall(length=LENGTH, diffusivity_prior=7e-7, outside="right")
    return wallid.Case("contacts", Path("case.toml"), wall, (), record, Choices(initial_profile=1))


def test_a_contact_resistance_is_found_where_there_is_one():
    """0.02 m2 K/W at the left face: the resistance contains it, and the diffusivity is that of the wall."""
    fit = wallid.estimate(slab_with_contacts((0.02, 0.004)))
    found = fit.thermal
    low, high = found.contact_resistances["left"].interval_95
    assert low < 0.02 < high and high < 0.03
    assert abs(found.resistance.value - 0.424) < 3 * found.resistance.std
    assert abs(fit.value - DIFFUSIVITY) < 3 * fit.std and fit.std < 0.02 * fit.value
    assert "between this face and its sensor" in str(fit)


def test_no_contact_resistance_is_found_where_there_is_none():
    case = slab_with_contacts((0.0, 0.0))
    fit = wallid.estimate(case)
    assert fit.thermal.contact_resistances == {} and abs(fit.value - DIFFUSIVITY) < 3 * fit.std
    window = wallid.Window(0, case.record.rows)
    model = full_order_model_with_plates(case)
    of_window = fit_generalised_least_squares(case, window, window_data(case, window), model, 5e-7, eta=1e-8)
    assert all(abs(score) < 3.5 for score in contact_scores(case, of_window).values())
