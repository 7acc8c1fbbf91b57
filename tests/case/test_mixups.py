"""Mix-ups that are visible in a record without a model, and what `check` says of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from benchmarks.reference.analytic_slab import fluxes
from scipy.special import erfc

import wallid
from wallid.case.mixups import doubtful_places, visible_mixups
from wallid.case.options import Choices
from wallid.case.record_check import check

DAY = 86400.0


def case_of(days=14, step=1800.0, period=DAY, flux=None, **changes):
    """A wall whose left face has a daily cycle; damped waves inside, as in a half space."""
    time = step * np.arange(int(days * DAY / step))
    depth = np.sqrt(2 * 7e-7 * DAY / (2 * np.pi))  # m, of the damped wave
    rng = np.random.default_rng(1)

    def wave(x):
        return 12 + 8 * x / 0.4 + 8 * np.exp(-x / depth) * np.sin(2 * np.pi * time / period - x / depth)

    columns = {"left": wave(0.0), "right": 20 + 0.3 * rng.standard_normal(len(time))}
    columns |= {"T1": wave(0.05), "T2": wave(0.15), "T3": wave(0.3)}
    columns = {name: values + 0.02 * rng.standard_normal(len(time)) for name, values in columns.items()}
    regressors = {}
    if flux is not None:
        columns["q"] = flux * (columns["left"] - columns["right"])
        regressors = {"flux_left": "q"}
    columns |= {name: change(columns) for name, change in changes.items()}
    return wallid.Case.from_dataframe(
        pd.DataFrame({"time": time, **columns}),
        time="time",
        left="left",
        right="right",
        sensors={"T1": 0.05, "T2": 0.15, "T3": 0.3},
        noise_std=0.02,
        length=0.4,
        diffusivity_prior=7e-7,
        regressors=regressors,
        clean=False,
        window_days=min(3.0, days / 2),
    )


def kinds(case):
    return [(mixup.kind, mixup.targets) for mixup in visible_mixups(case)]


def test_a_sound_record_has_none():
    assert kinds(case_of()) == [] and doubtful_places(case_of()) == []
    assert kinds(case_of(flux=2.0)) == []


@pytest.mark.parametrize(
    ("changes", "kind", "target"),
    [
        ({"T2": lambda c: c["T1"]}, "copy", "T2"),
        ({"T2": lambda c: 32 + 1.8 * c["T2"]}, "unit", "T2"),
        ({"right": lambda c: 32 + 1.8 * c["right"]}, "unit", "right face"),
        ({"left": lambda c: 273.15 + c["left"]}, "unit", "left face"),
    ],
)
def test_a_column_that_cannot_be_what_it_is_said_to_be(changes, kind, target):
    case = case_of(**changes) if "left" not in changes else None
    if case is None:  # a reader refuses kelvin at once; a case from arrays comes here
        sound = case_of()
        faces = sound.record.faces + np.array([273.15, 0.0])
        case = replace(sound, record=replace(sound.record, faces=faces))
    assert [(one, targets[0]) for one, targets in kinds(case)] == [(kind, target)]
    assert any(target in note for note in check(case).notes)


def test_a_flux_against_the_temperature_difference():
    assert kinds(case_of(flux=-2.0)) == [("flux_sign", ("flux_left",))]
    assert "sign" in visible_mixups(case_of(flux=-2.0))[0].words


@pytest.mark.parametrize(("sign", "found"), [(1.0, []), (-1.0, [("flux_sign", ("flux_right",))])])
def test_a_flux_into_a_wall_that_follows_the_weather_is_no_mixup(sign, found):
    """An unheated house: the plate sees what the wall stores, against the temperature difference; by a sine series."""
    step, rate = 1800.0, 6e-7 / 0.5**2
    phase = 2 * np.pi * step * np.arange(40 * 48) / (8 * DAY)
    faces = 10.0 + np.stack([5.0 * np.sin(phase), 4.5 * np.sin(phase - 0.6)], axis=1)
    flux = 1.6e6 * 6e-7 / 0.5 * fluxes(faces, step, rate)[:, 1]
    rows = slice(-12 * 48, None)
    difference = (faces[:, 0] - faces[:, 1])[rows]
    assert np.corrcoef(flux[rows], difference)[0, 1] < -0.6
    time = step * np.arange(12 * 48)
    inside = np.empty((len(time), 0))
    plate = {"flux_right": sign * flux[rows]}
    record = wallid.Record(time, time, None, faces[rows], inside, (), regressors=plate)
    wall = wallid.Wall(length=0.5, diffusivity_prior=6e-7)
    choices = Choices(model="lom", initial_profile=1)
    assert kinds(wallid.Case("house", Path("case.toml"), wall, (), record, choices)) == found


@pytest.mark.parametrize(("factor", "word"), [(0.5, "12 hours"), (2.0, "48 hours"), (1 / 60, "minutes")])
def test_a_record_whose_times_run_wrongly(factor, word):
    """The day's cycle has another period in it; a wave of a day is left alone."""
    step = 1800.0 if factor > 0.1 else 30.0
    (mixup,) = visible_mixups(case_of(days=28 * factor, step=step, period=factor * DAY))
    assert mixup.kind == "clock" and word in mixup.words


def test_places_that_the_readings_contradict():
    swapped = case_of(T1=lambda c: c["T3"].copy(), T3=lambda c: c["T1"].copy())
    notes = " ".join(doubtful_places(swapped))
    assert "T3 has a larger daily cycle than T1" in notes and "left face" in notes
    warm = case_of(T2=lambda c: np.maximum(c["left"], c["right"]) + 2.0)
    assert any("T2 is warmer than both faces" in note for note in check(warm).notes)


def test_the_test_wave_is_a_solution_at_depth():
    """The damped wave of the half space (Carslaw and Jaeger, 2.6): amplitude falls by e in its depth."""
    case = case_of()
    amplitudes = np.ptp(case.record.sensors, axis=0) / 2
    assert np.all(np.diff(amplitudes) < 0) and erfc(0.0) == 1.0
