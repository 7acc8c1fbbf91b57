"""One estimate from many windows: against SciPy's statistics, and records of the sine series (no part of wallid)."""

import json
from dataclasses import replace

import jax.monitoring
import numpy as np
import pytest
from benchmarks.accuracy import interval
from benchmarks.reference.analytic_slab import refined, temperatures, weather
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from own_case import write_own
from pages import check
from scipy.optimize import minimize
from scipy.stats import chi2, norm
from typer.testing import CliRunner

import wallid
from wallid.cli.commands import app
from wallid.estimation.many_windows import pooled_mean

ROWS, WINDOWS = interval.ROWS, 4
ERRORS = interval.Errors(0.03, 0.01, position=0.005)


def case_of(diffusivities, *, offset=(0.0, 0.0, 0.0), seed=2, noise=1.0, errors=ERRORS):
    """A record of so many windows; each begins where the one before ended, its diffusivity is its own."""
    rng = np.random.default_rng(seed)
    faces = weather(interval.BEFORE + ROWS * len(diffusivities), interval.STEP, rng)
    x = np.array(interval.PLACES) / interval.LENGTH
    fine, step = refined(faces, interval.PARTS), interval.STEP / interval.PARTS
    every = [interval.at_rows(temperatures(fine, step, x, alpha / interval.LENGTH**2)) for alpha in diffusivities]
    part = [slice(interval.BEFORE + k * ROWS, interval.BEFORE + (k + 1) * ROWS) for k in range(len(diffusivities))]
    readings = np.concatenate([one[rows] for one, rows in zip(every, part, strict=True)])
    readings = readings + np.array(offset)
    measured = faces[interval.BEFORE :]
    case = interval.case_of(errors, measured[:ROWS], readings[:ROWS])
    record = replace(
        case.record,
        time=interval.STEP * np.arange(len(readings)),
        stamps=interval.STEP * np.arange(len(readings)),
        faces=measured + noise * errors.face * rng.standard_normal(measured.shape),
        sensors=readings + noise * errors.sensor * rng.standard_normal(readings.shape),
    )
    return replace(case, record=record, choices=replace(case.choices, noise="stated"))


@pytest.fixture(scope="module")
def found():
    return wallid.campaign(case_of([interval.DIFFUSIVITY] * WINDOWS))


def test_all_windows_say_more_than_one(found):
    low, high = found.interval_95
    assert found.reliable and len(found.used) == WINDOWS and low < interval.DIFFUSIVITY < high
    assert found.std < min(fit.std for fit in found.fits)
    assert found.mean.p_value > 0.01 and found.mean.between_std == 0.0
    assert sum(found.weight(k) for k in range(WINDOWS)) == pytest.approx(1.0)
    assert "the windows agree" in str(found)


def test_what_an_offset_makes_of_each_window_is_shared():
    """An offset in the truth, without noise: each estimate moves by its own share of the covariance.

    The noise that is stated is large, so that no window finds the offsets out by itself.
    """
    errors = interval.Errors(0.4, 0.01, offset=0.05)
    still = wallid.campaign(case_of([interval.DIFFUSIVITY] * WINDOWS, noise=0.0, errors=errors))
    moves = []
    for offset in 0.02 * np.eye(3):
        moved = wallid.campaign(case_of([interval.DIFFUSIVITY] * WINDOWS, noise=0.0, errors=errors, offset=offset))
        moves.append([np.log(a.value / b.value) for a, b in zip(moved.fits, still.fits, strict=True)])
    shared = np.array(moves).T * errors.offset / 0.02
    apart = ~np.eye(WINDOWS, dtype=bool)
    want = (shared @ shared.T)[apart]
    assert np.abs(want).max() > 1e-6, "0.1 % of the diffusivity: far over round-off and the search's end"
    assert_allclose(still.covariance[apart], want, atol=0.05 * np.abs(want).max())


def test_windows_that_disagree_are_told_apart():
    one, other = interval.DIFFUSIVITY, 1.5 * interval.DIFFUSIVITY
    found = wallid.campaign(case_of([one, one, other, other]))
    assert found.mean.p_value < 1e-3 and found.mean.between_std > 0.1
    assert found.interval_95[0] < 1.03 * one and found.interval_95[1] > 0.97 * other
    assert "DISAGREE" in str(found)


def test_one_compilation_serves_all_windows(found):
    """With what the first campaign compiled, twice as many windows of the same length compile nothing."""
    compiled = []

    def count(event, duration, **_):
        if "backend_compile" in event:
            compiled.append(event)

    jax.monitoring.register_event_duration_secs_listener(count)
    longer = case_of([interval.DIFFUSIVITY] * 6, seed=9)
    seen = []
    pooled = wallid.campaign(longer, progress=lambda text, share: seen.append((text, share)))
    jax.monitoring.clear_event_listeners()
    windows = [(f"estimate: window {k + 1} of 6", k / 6) for k in range(6)]
    assert len(pooled.windows) == 6 and seen == [*windows, ("done", 1.0)]
    assert not compiled


@settings(max_examples=50)
@given(st.integers(0, 10**6), st.integers(2, 7))
def test_the_mean_is_scipys(seed, count):
    """The minimum of the chi-square, its curvature, its p-value; between windows what makes the chi-square right."""
    rng = np.random.default_rng(seed)
    B = 0.05 * rng.standard_normal((count, 2))
    C = B @ B.T + np.diag(0.1 + 0.2 * rng.uniform(size=count)) ** 2
    y = rng.normal(0, rng.choice([0.1, 1.0]), count)
    found = pooled_mean(y, C)

    def cost(m, V):
        return float((y - m) @ np.linalg.solve(V, y - m))

    least = minimize(lambda m: cost(m[0], C), [0.0], tol=1e-14)
    assert found.chi_square == pytest.approx(least.fun, rel=1e-6, abs=1e-9)
    assert found.p_value == pytest.approx(chi2.sf(least.fun, count - 1), rel=1e-5)
    V = C + found.between_std**2 * np.eye(count)
    assert cost(found.value + found.std, V) - cost(found.value, V) == pytest.approx(1.0, rel=1e-6)
    if found.p_value < 0.05:
        assert cost(found.value, V) == pytest.approx(count - 1, rel=1e-6)
        assert found.quantile > norm.ppf(0.975)
    else:
        assert found.between_std == 0.0 and found.value == pytest.approx(least.x[0], abs=1e-5)


def test_a_record_that_tells_nothing_and_windows_by_hand(found):
    case = case_of([interval.DIFFUSIVITY] * WINDOWS)
    sensors = case.record.sensors.copy()
    sensors[:] = np.nan
    nothing = wallid.campaign(replace(case, record=replace(case.record, sensors=sensors)))
    assert not nothing.reliable and "none of 4 windows" in nothing.reason and "no reading" in str(nothing)
    alone = wallid.campaign(case, windows=[wallid.Window(0, ROWS)])
    assert alone.value == pytest.approx(found.fits[0].value) and np.isnan(alone.mean.p_value)
    with pytest.raises(wallid.InputError, match="share readings"):
        wallid.campaign(case, windows=[wallid.Window(0, ROWS), wallid.Window(ROWS - 1, ROWS)])


@pytest.mark.slow
def test_all_windows_on_the_command_line(tmp_path):
    words = ["estimate", str(write_own(tmp_path)), "--all-windows", "--out", str(tmp_path / "out")]
    ended = CliRunner().invoke(app, [*words, "--json"])
    assert ended.exit_code == 0, ended.stderr
    result = json.loads(ended.stdout)
    assert result["windows"]["informative"] == 3 and result["windows"]["degrees_of_freedom"] == 2
    assert result["window"]["end"] == "2020-03-10T00:00:00"
    low, high = result["diffusivity"]["interval_95"]
    assert low < result["diffusivity"]["value"] < high
    assert (tmp_path / "out" / "campaign.png").exists()
    assert "windows: single windows" in check((tmp_path / "out" / "report.html").read_text("utf-8")).text
    refused = CliRunner().invoke(app, [*words, "--bootstrap", "40"])
    assert refused.exit_code == 2 and "--bootstrap" in refused.stderr


def test_a_campaign_as_text_dict_and_html(found):
    assert found.summary() == str(found)
    result = json.loads(json.dumps(found.to_dict()))
    assert result["value"] == found.value and result["p_value"] == found.mean.p_value
    assert [one["start"] for one in result["windows"]] == list(found.labels)
    assert sum(one["weight"] for one in result["windows"]) == pytest.approx(1.0)
    assert found._repr_html_().count("window from") == len(found.windows)
