"""Ranking against explicit least squares; where the remainder sits; what is compared on days held out."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks.reference.simulator_with_effects import DAY
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.stats import kstest
from studies import SPEC, prepare, slot_of, trimmed

from wallid.discrepancy.cross_validation import cross_validate, effect_by_window, held_out
from wallid.discrepancy.effect_fit import refit
from wallid.discrepancy.problem import DiagnosisProblem
from wallid.discrepancy.residual_tests import chi_square_p_value, run_residual_tests
from wallid.discrepancy.selection.score_test import Candidate, CandidateJacobian, candidate_jacobian, score_candidates

OFFSET = 0.25
HOURLY = replace(
    SPEC,
    step=3600.0,
    days=8.0,
    positions=(0.04, 0.13),
    noise_std=0.05,
    boundary_noise_std=0.03,
    noise_seed=4,
    effects=(("sensor_offset", "T2", {"offset": OFFSET}),),
)


class Ranked:
    """A record with an offset in one sensor, the plain model fitted to it, and the screen of the library."""

    def __init__(self, folder):
        whole, _ = prepare(folder, HOURLY)
        self.study = trimmed(whole, lambda effect: effect.target in (None, 1, "left", "outdoor"))
        start = self.study.parameters
        self.noise = self.study.noise_shape(start).stated_covariance()
        self.base = refit(self.study, (), start, self.noise)
        self.outlook = candidate_jacobian(self.study, self.base)
        self.screen = score_candidates(self.base, self.outlook, np.random.default_rng(0))

    def white(self, place):
        """The whitened derivative of a candidate of the screen, priors' rows below."""
        (column,) = (
            z
            for candidate, z in zip(self.outlook.candidates, self.outlook.columns, strict=True)
            if candidate is self.screen.candidates[place]
        )
        return np.concatenate([self.noise.whitening @ column, np.zeros(len(self.base.residual) - len(column))])

    def least_squares(self, places):
        """The drop by these candidates with everything free refitted, their sizes and the moves of the others."""
        J, r = self.base.jacobian, self.base.residual
        scale = np.linalg.norm(J, axis=0)

        def solve(columns):
            x = np.linalg.lstsq(columns, r, rcond=1e-13)[0]
            return x, np.sum((r - columns @ x) ** 2)

        _, before = solve(J / scale)
        z = np.stack([self.white(place) for place in places], axis=1)
        size = np.linalg.norm(z, axis=0)
        x, after = solve(np.concatenate([J / scale, z / size], axis=1))
        return before - after, x[len(scale) :] / size, x[: len(scale)] / scale

    def place(self, name, target=None):
        """Of the best candidate of an effect."""
        slot = slot_of(self.study, name, target)
        return int(max(self.screen.by_effect[slot], key=lambda place: self.screen.gain[place]))


@pytest.fixture(scope="module")
def ranked(tmp_path_factory):
    return Ranked(tmp_path_factory.mktemp("ranked"))


def test_the_plain_fit_ends_at_its_minimum(ranked):
    """The residual stands on every free column; diffusivity and profile take up what they can of the offset."""
    fit = ranked.base
    assert fit.converged
    slope = fit.jacobian.T @ fit.residual / np.linalg.norm(fit.jacobian, axis=0)
    assert np.linalg.norm(slope) < 0.1  # the square is what a step would still bring: under 0.01
    free = fit.parameters.estimated_names
    assert len(free) == 1 + 8 + 2 + 2 and not fit.at_bound
    assert_allclose(
        fit.residual[-len(free) :],
        -fit.parameters.flatten() / fit.parameters.prior_std[fit.parameters.indices(free)],
    )


def test_expected_gain_and_size_are_those_of_least_squares(ranked):
    found = ranked.screen
    for place in [*found.best(10), *range(0, len(found.candidates), 7)]:
        gain, size, _ = ranked.least_squares([place])
        label = ranked.study.label(found.candidates[place].effect_parameters.effect)
        assert_allclose(found.score[place] ** 2, gain, rtol=1e-6, atol=1e-6, err_msg=label)
        assert_allclose(found.size[place], size[0], rtol=1e-5, atol=1e-9 / found.norm[place], err_msg=label)
        assert_allclose(found.joint_prediction((place,))[0][0], found.size[place], rtol=1e-8)


def test_the_gain_of_an_offset_is_that_of_the_refit(ranked):
    """An offset is exactly linear; what else moves is nearly so, to second order in its step."""
    slot = slot_of(ranked.study, "sensor_offset", "T2")
    place = ranked.place("sensor_offset", "T2")
    size, moves = ranked.screen.joint_prediction((place,))
    (name,) = slot.names
    start = ranked.base.parameters.with_values({name: size[0]})
    fit = refit(ranked.study, (slot,), start, ranked.noise, step=moves)
    drop = ranked.base.cost - fit.cost
    assert fit.converged and drop > 100
    assert_allclose(drop, ranked.screen.gain[place], rtol=0.02)
    assert abs(fit.parameters[name] - OFFSET) < 4 * fit.std(name)
    assert abs(fit.parameters[name] - ranked.screen.size[place]) < fit.std(name)
    assert abs(np.log(fit.diffusivity / HOURLY.diffusivity)) < 4 * fit.log_std
    low, high = fit.interval_95
    assert_allclose([low * high, np.log(high / low)], [fit.diffusivity**2, 2 * 1.959964 * fit.log_std], rtol=1e-6)
    assert ranked.screen.best(1) == [place] or ranked.screen.gain[ranked.screen.best(1)[0]] >= drop


def test_pair_gains_are_those_of_least_squares(ranked):
    found = ranked.screen
    rng = np.random.default_rng(5)
    tried = 0
    for i, j in rng.integers(len(found.candidates), size=(60, 2)).tolist():
        one, other = (found.candidates[k].effect_parameters.effect for k in (i, j))
        if (one.name, one.target) == (other.name, other.target):
            assert found.pair_gain[i, j] == 0.0, "forms of one effect are no pair"
            continue
        if abs(found.cosine[i, j]) > 0.999:
            continue
        gain, sizes, _ = ranked.least_squares([i, j])
        signs = found.required_signs[[i, j]]
        if np.any(signs * sizes < 0):
            assert found.pair_gain[i, j] == 0.0, "a size of the wrong sign"
        else:
            assert_allclose(found.pair_gain[i, j], gain, rtol=1e-5, atol=1e-5)
            assert_allclose(found.joint_prediction((i, j))[0], sizes, rtol=1e-4, atol=1e-6 / found.norm[[i, j]].min())
            tried += 1
    assert tried > 10
    best = found.best_pairs(5)
    gains = [found.pair_gain[pair] for pair in best]
    assert gains == sorted(gains, reverse=True) and gains[0] == found.pair_gain.max()
    kinds = [frozenset(found.candidates[k].effect_parameters for k in pair) for pair in best]
    assert len(set(kinds)) == len(best)


def made_up(ranked, columns, names=("sensor_offset", "sensor_gain", "sensor_drift", "clock_shift")):
    """A screen of given derivatives in the readings."""
    targets = ("T2", "T2", "T2", None)
    slots = [slot_of(ranked.study, name, target) for name, target in zip(names, targets, strict=True)]
    candidates = tuple(Candidate(slot, {}) for slot, _ in zip(slots, columns, strict=False))
    return score_candidates(ranked.base, CandidateJacobian(candidates, np.array(columns)), np.random.default_rng(1))


def test_what_the_record_cannot_tell_apart_is_no_pair(ranked):
    rng = np.random.default_rng(2)
    first, second = rng.standard_normal((2, len(ranked.noise.whitening)))
    found = made_up(ranked, [first, -2.5 * first, second])
    assert_allclose(found.cosine[0, 1], -1.0)
    assert_allclose(found.gain[0], found.gain[1], rtol=1e-9)
    assert_allclose(found.size[0], -2.5 * found.size[1], rtol=1e-9)
    assert found.pair_gain[0, 1] == 0.0
    assert found.pair_gain[0, 2] > found.gain[0] and found.pair_gain[1, 2] > 0
    assert not np.diag(found.pair_gain).any()


def test_what_is_free_already_is_not_seen(ranked):
    """A derivative that the free parameters without a prior make up is left out."""
    seen = np.random.default_rng(3).standard_normal(len(ranked.noise.whitening))
    own = np.linalg.solve(ranked.noise.whitening, ranked.base.jacobian[: len(seen), 0])
    found = made_up(ranked, [own, seen, np.zeros_like(seen)])
    assert [c.effect_parameters.effect.name for c in found.candidates] == ["sensor_gain"]


def test_a_size_of_the_wrong_sign_gains_nothing(ranked):
    found = ranked.screen
    bounded = {
        c.effect_parameters.effect.name for c, sign in zip(found.candidates, found.required_signs, strict=True) if sign
    }
    assert bounded == {
        "sensor_lag", "face_lag", "face_depth", "surface_film", "contact_resistance", "phase_change", "lateral_loss",
    }  # fmt: skip
    wrong = found.required_signs * found.size < 0
    assert wrong.any() and not found.gain[wrong].any()
    assert_allclose(found.gain[~wrong], found.score[~wrong] ** 2)


def test_p_values_fall_with_the_gain_and_know_the_largest_of_many(ranked):
    found = ranked.screen
    gains = np.linspace(0.0, 60.0, 40)
    p = [found.p_value(gain) for gain in gains]
    assert p == sorted(p, reverse=True)
    assert p[0] == 1.0 and p[-1] == pytest.approx(1 / 2001)
    for level in (0.05, 0.01):
        assert found.p_value(found.threshold(level)) == pytest.approx(level, abs=2e-3)
    assert found.pair_threshold(0.05) > found.threshold(0.05) > 3.84, "more than a single test's"
    alone = made_up(ranked, [np.random.default_rng(3).standard_normal(len(ranked.noise.whitening))])
    assert alone.threshold(0.05) == pytest.approx(3.84, abs=0.6)  # chi-square of one; 4 sigma of 2000 draws


# ------------------------------------------------------------------------------------------------------- the remainder


def drawn(ranked, rng):
    """The residual of a fit whose readings have the noise's own covariance and nothing else."""
    fit, noise = ranked.base, ranked.noise
    error = noise.whitening @ (np.linalg.cholesky(noise.covariance) @ rng.standard_normal(len(noise.whitening)))
    whole = np.concatenate([error, rng.standard_normal(fit.jacobian.shape[1])])
    J = fit.jacobian / np.linalg.norm(fit.jacobian, axis=0)
    return whole - J @ np.linalg.lstsq(J, whole, rcond=None)[0]


def test_the_omnibus_test_is_fair_and_sees_a_slow_wave(ranked):
    rng = np.random.default_rng(7)
    found = [run_residual_tests(replace(ranked.base, residual=drawn(ranked, rng))) for _ in range(120)]
    p = [rest.p_value for rest in found]
    assert kstest(p, "uniform").pvalue > 1e-3
    bins = len(ranked.noise.whitening) // 2
    wave = np.concatenate([0.05 * np.sin(4 * np.pi * np.arange(bins) / bins), np.zeros(bins)])
    residual = drawn(ranked, rng)
    residual[: 2 * bins] += ranked.noise.whitening @ wave
    slow = run_residual_tests(replace(ranked.base, residual=residual))
    assert slow.p_value < 1e-4
    assert np.corrcoef(slow.smooth_residual[:, 0], wave[:bins])[0, 1] > 0.8, "the wave itself"


def test_the_omnibus_tests_see_a_diffusivity_that_comes_and_goes(ranked):
    """Every two days, in both sensors at once, and in none of the slow shapes of one sensor."""
    rng, bins = np.random.default_rng(8), len(ranked.noise.whitening) // 2
    sensitivity = ranked.base.unwhitened()[0][:, 0]
    days = np.tile((np.arange(bins) + 0.5) / 24, 2)
    residual = drawn(ranked, rng)
    residual[: 2 * bins] += ranked.noise.whitening @ (0.15 * sensitivity * np.sin(np.pi * days))
    assert run_residual_tests(replace(ranked.base, residual=residual)).p_value < 1e-3


@pytest.mark.parametrize("spread", [0.0, 0.1, 0.4])
@pytest.mark.parametrize("noncentrality", [0.0, 10.0])
def test_chance_counts_that_the_power_of_the_noise_is_an_estimate(spread, noncentrality):
    """Against draws of a sum of squares, with a mean in one of them, times a lognormal."""
    rng = np.random.default_rng(5)
    squares = rng.chisquare(49, 100_000) + (np.sqrt(noncentrality) + rng.standard_normal(100_000)) ** 2
    drawn_values = squares * np.exp(spread * rng.standard_normal(100_000))
    for value in (45.0, 60.0, 75.0):
        rate = np.mean(drawn_values > value)
        assert chi_square_p_value(value, 50, spread, noncentrality) == pytest.approx(
            rate, abs=4 * np.sqrt(rate * (1 - rate) / 100_000)
        )


def test_the_omnibus_test_allows_for_the_model_error_of_a_large_effect(ranked):
    """A remainder whose squared length is that of the allowance is no reason to reject; four times of it is one."""
    rng, bins = np.random.default_rng(9), len(ranked.noise.whitening) // 2
    wave = ranked.noise.whitening @ np.tile(np.sin(4 * np.pi * np.arange(bins) / bins), 2)
    wave *= np.sqrt(150.0) / np.linalg.norm(wave)
    residual = drawn(ranked, rng)
    for size, allowed in ((1.0, True), (2.0, False)):
        moved = residual.copy()
        moved[: 2 * bins] += size * wave
        fit = replace(ranked.base, residual=moved)
        assert run_residual_tests(fit).p_value < 1e-3
        assert (run_residual_tests(fit, allowance=150.0).p_value > 1e-2) == allowed


def test_where_the_remainder_sits(ranked):
    """By sensor, hour of the day and day, of a remainder that is known."""
    fit, rows = ranked.base, ranked.study.record.rows
    hour, day = np.arange(rows) % 24, np.arange(rows) // 24
    rest = np.stack([0.1 * (hour == 7), 0.2 * (day == 3)], axis=1)
    rest[30, 0] = np.nan
    placed = replace(fit)
    placed.__dict__["residual_at_rows"] = rest
    found = run_residual_tests(placed)
    assert list(found.by_instrument) == ["T1", "T2"]
    assert found.by_instrument["T2"] == pytest.approx(0.2 / np.sqrt(8))
    assert_allclose(found.by_hour[:, 0], 0.1 * (np.arange(24) == 7), atol=1e-15)
    assert_allclose(found.by_hour[:, 1], 0.2 / 8)
    assert_allclose(found.by_day[:, 1], 0.2 * (np.arange(8) == 3))
    assert_allclose(found.by_day[[0, 5], 0], 0.1 / np.sqrt(24))


# ------------------------------------------------------------------------------------------ days not used, windows


def lasting(days, step):
    """A study of which only the record's rows are there."""
    time = np.arange(round(days * DAY / step)) * step
    study = object.__new__(DiagnosisProblem)
    object.__setattr__(study, "record", SimpleNamespace(time=time, span=len(time) * float(time[1])))
    return study


@given(days=st.floats(3.1, 70), step=st.sampled_from([600.0, 1800.0, 3600.0]))
@settings(max_examples=40)
def test_whole_days_are_held_out_and_at_least_a_fifth(days, step):
    study = lasting(days, step)
    held = held_out(study)
    assert 0.2 <= held.mean() <= 0.5
    day = (study.record.time // DAY).astype(int)
    for one in range(day[-1] + 1):
        assert len(set(held[day == one].tolist())) == 1, "a day is held out or not"


@given(
    days=st.floats(4.5, 70),
    when=st.floats(0.02, 0.85),
    lasts=st.floats(0.5, 2.0),
)
@settings(max_examples=40)
def test_days_that_tell_of_an_event_are_not_held_out(days, when, lasts):
    study = lasting(days, 1800.0)
    time, begin = study.record.time, when * days * DAY
    held = held_out(study, [(begin, lasts * DAY)])
    assert 0.2 <= held.mean() <= 0.5
    told = np.where(time >= begin, np.exp(-np.maximum(time - begin, 0.0) / (lasts * DAY)), 0.0)
    assert told[held].sum() <= 0.5 * told.sum()
    assert not held[time < DAY].any(), "the first day's profile is nobody's"


def test_a_short_record_holds_nothing_out():
    assert held_out(lasting(2.5, 600.0)) is None


def test_the_gap_on_days_held_out_shrinks_with_the_offset_in(ranked):
    slot = slot_of(ranked.study, "sensor_offset", "T2")
    after = refit(ranked.study, (slot,), ranked.base.parameters, ranked.noise)
    gap = cross_validate(ranked.base, after)
    assert gap.before > gap.after and gap.held_out_before > 1.2 * gap.held_out_after
    # readings 0.05 K each, and what passes of the faces' 0.03 K; 384 of them, 4 sigma
    assert_allclose([gap.after, gap.held_out_after], gap.noise_floor, rtol=0.15)
    assert 0.05 < gap.noise_floor < np.hypot(0.05, 0.03)
    assert gap.remaining_share < 0.5
    same = cross_validate(ranked.base, ranked.base)
    assert same.held_out_before == same.held_out_after and same.before == same.after == gap.before
    found = effect_by_window(after, slot)
    assert_allclose(found.days, [1, 3, 5, 7])
    assert found.p_value > 1e-3, "a constant offset is constant"
    pulls = (found.size - OFFSET) / found.std
    assert np.abs(pulls).max() < 4


def test_an_effect_that_comes_and_goes_shows_by_window(ranked):
    slot = slot_of(ranked.study, "sensor_offset", "T2")
    after = refit(ranked.study, (slot,), ranked.base.parameters, ranked.noise)
    bins = len(ranked.noise.whitening) // 2
    half = np.concatenate([np.zeros(bins), 0.2 * (np.arange(bins) > bins / 2) - 0.1])
    residual = after.residual.copy()
    residual[: 2 * bins] += ranked.noise.whitening @ half
    found = effect_by_window(replace(after, residual=residual), slot)
    assert found.p_value < 1e-4
    assert found.size[2:].mean() - found.size[:2].mean() > 0.1
