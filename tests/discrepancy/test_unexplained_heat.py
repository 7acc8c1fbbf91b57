"""The shape of what no effect explains: the smoothed heat of a diagnosis against the hidden one of the simulator."""

import json
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.accuracy.disturbance import CAPACITY, DIFFUSIVITY, FINE, LENGTH, SENSOR_STD, STEP, Kind
from benchmarks.reference.analytic_slab import random_process
from heated_walls import case_of, hidden_heat
from scipy.signal import lfilter

from wallid import plot
from wallid.discrepancy.problem import diagnosis_problem
from wallid.discrepancy.result.wall_properties import DIFFUSIVITY as DIFFUSIVITY_PROPERTY
from wallid.discrepancy.selection.candidate_fits import CandidateFits
from wallid.discrepancy.unexplained_heat import UnexplainedHeat

KIND, NUMBER = Kind("sensors", "wall", 3.0), 5000


def hidden():
    """The heat of the record at its rows, K a day."""
    return 86400.0 * hidden_heat(KIND, NUMBER)[:: round(STEP["sensors"] / FINE)]


@pytest.fixture(scope="module")
def unexplained():
    case = case_of(KIND, NUMBER)
    missing = case.record.sensors.copy()
    missing[100:110, 0] = np.nan
    record = replace(case.record, sensors=missing, regressors={"wind": hidden() + 20.0})
    case = replace(case, wall=replace(case.wall, heat_capacity=CAPACITY), record=record)
    return UnexplainedHeat(CandidateFits(diagnosis_problem(case)).fit_plain_model())


@pytest.fixture(scope="module")
def left(unexplained):
    return unexplained.course()


def test_it_explains_more_than_noise_with_a_memory(unexplained):
    """The residual alone is described by autocorrelated noise as well; through both sensors it is heat."""
    assert unexplained.fit.noise.autocorrelated > 0.3 and unexplained.is_clear
    allowed = UnexplainedHeat(unexplained.fit, allowance=1e5)
    assert not allowed.is_clear


def test_the_fit_beside_it_holds_the_diffusivity(unexplained):
    low, high = DIFFUSIVITY_PROPERTY.of(unexplained.fit_beside).interval_95
    assert low < DIFFUSIVITY < high
    assert unexplained.fit_beside.noise.autocorrelated == 0.0


def test_noise_with_a_memory_is_not_taken_for_heat():
    """The same wall without heat, the sensors' noise with a correlation of 0.9 from row to row."""
    case = case_of(Kind("sensors", "nothing", 3.0), NUMBER)
    rows, rng = case.record.rows, np.random.default_rng(3)
    noise = lfilter([np.sqrt(1 - 0.9**2)], [1.0, -0.9], rng.standard_normal((rows + 100, 2)), axis=0)[100:]
    case = replace(case, record=replace(case.record, sensors=case.record.sensors + 2.0 * SENSOR_STD * noise))
    found = UnexplainedHeat(CandidateFits(diagnosis_problem(case)).fit_plain_model())
    assert found.fit.noise.autocorrelated > 1.0 and found.disturbance.evidence < 3.0 and not found.is_clear


def test_it_is_like_the_hidden_heat(left):
    assert np.corrcoef(left.course, hidden())[0, 1] > 0.9
    assert left.disturbance.place == "wall" and left.disturbance.evidence > 50
    inside = np.abs(left.course - hidden()) < 2 * left.std
    assert inside.mean() > 0.85


def test_it_says_how_large_in_flux_and_what_it_follows(left):
    assert left.flux == pytest.approx(CAPACITY * LENGTH / 86400.0)
    assert left.follows.column == "wind" and left.follows.lag <= 1800.0 and left.follows.p_value < 0.01
    assert "W/m2" in left.sentence and "wind" in left.sentence
    assert json.dumps(left.to_dict(), allow_nan=False)


def test_its_spectrum_is_that_of_a_process(left):
    """A year of a process of its size and memory, at steps of half an hour; then a daily cycle."""
    memory = left.disturbance.time_constant / 3600.0
    assert left.disturbance.smoothness == "matern-1/2"
    course = left.disturbance.std * random_process(365 * 48, 1800.0, memory, np.random.default_rng(4))
    year = replace(left, days=np.arange(365 * 48) / 48.0, course=course)
    periods, power, of_process = year.spectrum
    slow = periods > 8.0  # at a step of half an hour the faster ones are folded
    assert np.mean(power[slow] / of_process[slow]) == pytest.approx(1.0, abs=0.1)
    assert np.sum(power) * (1.0 / periods[0]) == pytest.approx(np.var(course), rel=0.1)
    daily = replace(left, course=np.sin(2.0 * np.pi * left.days))
    assert daily.spectrum[0][np.argmax(daily.spectrum[1])] == pytest.approx(24.0, rel=0.01)


def test_its_figures(left):
    ax = plot.heat_course(left)
    assert len(ax.lines[0].get_ydata()) == KIND.rows and "K a day" in ax.get_ylabel()
    hours, mean = left.mean_day
    day = plot.heat_of_day(left)
    assert day.lines[0].get_ydata()[:-1] == pytest.approx(mean) and len(hours) == 48
    spectrum = plot.heat_spectrum(left)
    assert spectrum.lines[-1].get_xdata() == pytest.approx(left.spectrum[0]) and "K²" in spectrum.get_ylabel()
    short = replace(left, days=left.days[:40], course=left.course[:40], std=left.std[:40])
    with pytest.raises(ValueError, match="at least two days"):
        plot.heat_of_day(short)
