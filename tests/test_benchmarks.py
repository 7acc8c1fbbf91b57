"""The benchmark's own parts: its rivals give the right answer, its tables say what was measured."""

import json
import os
import shutil
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from benchmarks.accuracy.campaign_plans import house as house_of_plan
from benchmarks.accuracy.discrepancy.scenarios import noise_covariance
from benchmarks.accuracy.disturbance import SEED
from benchmarks.accuracy.forecasts import kinds as kinds_of_forecasts
from benchmarks.accuracy.next_measurement import fixed_advice
from benchmarks.accuracy.plate_visibility import Visibility, with_signal_to_noise
from benchmarks.reference.analytic_slab import fluxes, temperatures
from benchmarks.reference.c_recurrence import compiled
from benchmarks.reference.house_in_weather import FINE, simulated
from benchmarks.reference.integrators import by_lsim
from benchmarks.reference.model_reduction import response_of_rows, section_by_pymor
from benchmarks.reference.section_full_order import FullOrderModel
from benchmarks.reference.simulator_with_effects import Spec
from benchmarks.speed import __main__ as program
from benchmarks.speed.__main__ import WORKS
from benchmarks.speed.measure import FEWEST, AbsentError, Measured, Prepared, measuring, prepared_here
from benchmarks.speed.table import as_markdown, seconds
from benchmarks.speed.works import learn, scaling, simulate
from benchmarks.speed.works.ratio import Asked
from rich.console import Console
from scipy.signal import lsim

import wallid
from wallid.case.section import SectionMaterial, coursed_rubble, section_of_regions
from wallid.models.section import section_response


def test_the_kinds_of_forecasts_have_the_seed_of_the_records_and_their_days():
    assert {(kind.seed, kind.days) for kind in kinds_of_forecasts(4.0)} == {(SEED, 4.0)}


@pytest.mark.parametrize(
    ("effects", "action"),
    [
        ({("sensor_lag", "T2"), ("clock_shift", None)}, {"kind": "swap", "sensors": ["T2", "T3"]}),
        ({("face_offset", "right"), ("heat_source", None)}, {"kind": "swap", "sensors": ["T1", "T3"]}),
        ({("surface_film", "left"), ("sensor_position", "T1")}, {"kind": "sensor", "share": 0.1}),
        ({("face_depth", "right"), ("contact_resistance", None)}, {"kind": "sensor", "share": 0.95}),
        ({("sensor_position", "T3"), ("layered_conductivity", None)}, {"kind": "sensor", "share": 0.95}),
        ({("air_flow", None), ("lateral_loss", "outdoor")}, {"kind": "shade"}),
        ({("wetting", None), ("phase_change", None)}, {"kind": "longer", "times": 3.0}),
        ({("layered_capacity", None)}, {"kind": "sensor", "share": 0.65}),
    ],
)
def test_the_fixed_sentence_is_taken_at_its_word(effects, action):
    found = fixed_advice(Spec(length=0.5, positions=(0.1, 0.2, 0.45)), effects)
    assert found == {key: pytest.approx(value) if key == "share" else value for key, value in action.items()}


def test_one_sensor_cannot_be_swapped_so_another_is_added():
    """In the widest gap."""
    found = fixed_advice(Spec(length=0.5, positions=(0.1,)), {("sensor_lag", "T1")})
    assert found["kind"] == "sensor" and found["share"] == pytest.approx(0.6)


def measured(work, contender, taken, units=1, **error):
    return Measured(work, contender, taken, (taken, taken), 5, units, 1.0, 10.0, 1.0, error)


def three_modes():
    return wallid.StateSpace(
        A=np.array([-3.0, -20.0, -70.0]),
        B=np.array([[1.0, 0.4], [-2.0, 3.0], [5.0, 1.0]]),
        C=np.array([[1.0, 0.5, -0.2], [0.3, -1.0, 0.7]]),
        D=np.array([[0.1, 0.0], [0.0, 0.2]]),
        P=np.array([[1.0], [0.5], [-0.3]]),
    )


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc")
def test_the_c_recurrence_is_scipys_lsim():
    time, fouriers = np.arange(200) / 24, np.array([0.9, 0.3])
    inputs = np.cumsum(np.random.default_rng(2).standard_normal((200, 2)), axis=0)
    system, start = three_modes(), np.array([2.0])
    u, theta = compiled(system, 1 / 24, inputs, start)(fouriers)
    A, B, C, D = (np.asarray(part) for part in (np.diag(system.A), system.B, system.C, system.D))

    def at(fo):
        return lsim((fo * A, fo * B, C, D), inputs, time, X0=np.asarray(system.P)[:, 0] * 2.0)[1]

    for fourier, field, slope in zip(fouriers, u, theta, strict=True):
        np.testing.assert_allclose(field, at(fourier), atol=1e-11)
        near = at(fourier + 1e-5) - at(fourier - 1e-5)
        np.testing.assert_allclose(slope, near / 2e-5, atol=1e-5 * np.abs(slope).max())


def test_the_noise_of_plates_is_that_of_noisy_faces():
    """Variance and correlations over 40000 rows of faces with noise, by the sine series."""
    spec = replace(
        Spec(length=0.2, step=1800.0, days=3.0, positions=(0.05,), rounding=0.0),
        plates=("right", "left"), noise_std=1e-3, flux_noise_std=0.5,
    )  # fmt: skip
    covariance, rows, rng = noise_covariance(spec, spec.diffusivity, 2), spec.rows // 2, np.random.default_rng(0)
    faces = spec.boundary_noise_std * rng.standard_normal((40000, 2))
    rate = spec.diffusivity / spec.length**2
    by_faces = spec.conductivity / spec.length * fluxes(faces, spec.step, rate)[:, ::-1]
    inside = temperatures(faces, spec.step, np.array([0.25]), rate)
    readings = np.hstack([inside, by_faces + 0.5 * rng.standard_normal(by_faces.shape)])[4000:]
    means = readings.reshape(-1, 2, 3).mean(axis=1)
    for lag in range(3):
        found = means[lag:].T @ means[: len(means) - lag] / (len(means) - lag)
        expected = covariance.reshape(3, rows, 3, rows)[:, lag, :, 0]
        size = np.sqrt(np.diag(covariance.reshape(3, rows, 3, rows)[:, 0, :, 0]))
        np.testing.assert_allclose(found / np.outer(size, size), expected / np.outer(size, size), atol=0.03)


def test_a_hidden_offset_of_a_plate_is_as_clear_as_asked():
    """Its signal-to-noise is in proportion to it; without other unknowns it would be the offset over its noise."""
    spec = Spec(
        days=4.0,
        step=1800.0,
        positions=(),
        plates=("left", "right"),
        effects=[("plate_offset", "left", {"offset": -1})],
    )
    sized = with_signal_to_noise(spec, "offset", 400.0)
    offset = sized.effects[0].parameters["offset"]
    visibility = Visibility(spec)
    assert visibility.of(sized) == pytest.approx(400.0, rel=1e-2) and offset < 0
    assert visibility.of(spec) == pytest.approx(visibility.of(sized) / offset**2, rel=1e-3)
    assert visibility.of(spec) < (1.0 / spec.flux_noise_std) ** 2 * spec.rows


def test_lsim_with_theta_is_lsims_own_difference():
    system = wallid.models.finite_volume_model(
        wallid.Wall(length=0.4, diffusivity_prior=5e-7), [wallid.models.Output(0.1)], nodes=15
    )
    time = np.arange(50) / 24
    inputs = np.cumsum(np.random.default_rng(3).standard_normal((50, 2)), axis=0)
    run = by_lsim(system, time, inputs, np.array([1.0, 0.5, 0.0]))
    u, theta = run(0.2)
    near = [run(0.2 + s)[0] for s in (-1e-5, 1e-5)]
    np.testing.assert_allclose(theta, (near[1] - near[0]) / 2e-5, atol=1e-5 * np.abs(theta).max())
    assert u.shape == theta.shape == (50, 1)


def test_the_simulated_house_is_damped_as_by_transmission_matrices():
    """ISO 13786: films and slab as complex matrices, for a daily cycle outdoors."""
    house = replace(house_of_plan(0), length=0.4, diffusivity=5e-7, films=(1.1, 0.9))
    seconds, omega = FINE * np.arange(30 * 1440), 2j * np.pi / 86400.0
    air = np.stack([10.0 + 8.0 * np.cos(omega.imag * seconds), np.full(len(seconds), 20.0)], axis=1)
    faces, inside, flux = simulated(house, air, np.array([0.3]))
    conductivity, (inner, outer) = 5e-7 * house.capacity, np.array([0.13, 0.04]) * house.films

    def slab(share):
        q = np.sqrt(omega / 5e-7) * 0.4 * share
        resistance = 0.4 * share / conductivity
        return np.array([[np.cosh(q), -resistance * np.sinh(q) / q], [-q / resistance * np.sinh(q), np.cosh(q)]])

    films = [np.array([[1.0, -one], [0.0, 1.0]]) for one in (outer, inner)]
    whole = films[1] @ slab(1.0) @ films[0]
    at_outer = films[0] @ [1.0, -whole[0, 0] / whole[0, 1]]
    expected = 8.0 * np.array([at_outer[0], (slab(1.0) @ at_outer)[0], (slab(0.3) @ at_outer)[0]])
    last = slice(-5 * 1440, None)
    found = np.column_stack([faces, inside])[last]
    amplitude = np.exp(-omega * seconds[last]) @ found * 2 / (5 * 1440)
    np.testing.assert_allclose(amplitude, expected, atol=5e-4)
    into_wall = -8.0 * (slab(1.0) @ at_outer)[1]
    assert np.exp(-omega * seconds[last]) @ flux[last] * 2 / (5 * 1440) == pytest.approx(into_wall, abs=5e-3)
    steady = 10.0 / (0.4 / conductivity + inner + outer)
    assert flux[last].mean() == pytest.approx(steady, rel=1e-3)


@pytest.fixture(scope="module")
def section_case():
    """Three days of hours between smooth faces, a section of 200 nodes, its readings of no account."""
    materials = SectionMaterial("stone", 1.5, 2.0e6), SectionMaterial("mortar", 0.5, 1.5e6)
    regions = coursed_rubble(0.2, 0.15, courses=2, stone_length=0.1, joint=0.03, seed=1)
    section = section_of_regions(0.2, 0.15, materials, regions, step=0.015)
    hours = np.arange(72.0)
    columns = {"left": 6 + 4 * np.sin(hours / 4), "right": 19 + np.sin(hours / 5), "T": 12 + np.sin(hours / 4 - 1)}
    return wallid.Case.from_dataframe(
        pd.DataFrame({"time": 3600 * hours, **columns}), time="time", left="left", right="right",
        wall=wallid.Wall(0.2, section.diffusivity_prior), section=section, model="lom",
        sensors=[wallid.Sensor("T", 0.07, noise_std=0.05, height=0.06)],
    )  # fmt: skip


def test_a_section_in_steps_is_the_section_in_all_its_modes(section_case):
    full, data = FullOrderModel(section_case), wallid.models.window_data(section_case)
    alpha = 1.3 * full.diffusivity
    u, by_log = full.response(alpha, data)
    fourier, modes = wallid.case.scales(section_case).fourier_number(alpha), full.in_modes()
    assert modes.order == len(full.section.unknown)
    expected, theta = wallid.models.propagate(
        modes, fourier, data.step, data.inputs, data.initial, sensitivity=True
    )  # exact in time
    # 1 is 20 K; the first hour has the initial profile's fast modes
    np.testing.assert_allclose(u[2:], expected[2:], atol=1e-5)
    np.testing.assert_allclose(u[1], expected[1], atol=1e-4)
    np.testing.assert_allclose(by_log[2:], fourier * theta[2:], atol=1e-3 * np.abs(by_log).max())
    later, earlier = (full.response(alpha * np.exp(h), data)[0] for h in (1e-4, -1e-4))
    np.testing.assert_allclose(by_log, (later - earlier) / 2e-4, atol=1e-6)


def test_balanced_truncation_of_a_section_is_its_model_again(section_case):
    pytest.importorskip("pymor")
    section = FullOrderModel(section_case).section
    k, c = section.conductivity * [1.2, 0.8], section.heat_capacity * [0.9, 1.1]
    faces = np.random.default_rng(1).normal(10.0, 5.0, (48, 2)).cumsum(axis=0) / 7
    expected = section_response(section.model, k, c, faces, 3600.0)
    found = response_of_rows(section_by_pymor(section.model, k, c, 20), faces, 3600.0)
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.ptp(faces))


def test_a_target_is_met_or_missed():
    assert Asked("a", 30.0, 30.0, at_least=True).met
    assert Asked("a", 29.9, 30.0, at_least=True).met is False
    assert Asked("a", 3.1, 3.0, at_least=False).texts()[3] == "**missed**"
    assert Asked("a", None, 3.0, at_least=False).texts()[2:] == ("not measured", "-")


def test_ratios_are_of_one_unit():
    results = {
        "exact LOM": measured("simulate", "exact LOM", 0.002),
        "MIM 5": measured("simulate", "MIM 5", 0.001, units=5),
        "lsim": measured("simulate", "lsim", 0.1),
        "C recurrence of order 5": measured("simulate", "C recurrence of order 5", 1e-4),
    }
    reached = {row.what: row.value for row in simulate.asked(results)}
    assert reached["exact LOM, times faster than lsim"] == pytest.approx(50)
    assert reached["MIM 5, time over C recurrence of order 5"] == pytest.approx(2)
    assert reached["exact LOM, times faster than diffrax Heun 30 s"] is None


def test_the_worst_error_counts():
    names = dict.fromkeys(learn.LEARNED + learn.NEVER, 1e-5)
    ours = measured("learn", "variable projection, order 5", 0.1, **names | {"theta": 1e-3})
    swarm = measured("learn", "particle swarm, order 5", 1.0, **dict.fromkeys(names, 1e-2))
    rows = learn.asked({ours.contender: ours, swarm.contender: swarm})
    assert rows[0].value == pytest.approx(0.1) and rows[0].met is False
    assert rows[1].value == pytest.approx(1e-3) and rows[1].met
    assert rows[2].value == pytest.approx(0.1) and rows[2].met


def test_short_contenders_take_turns_and_the_middle_one_counts(monkeypatch):
    said, taken = [], {"LOM": [3.0, 9.0, 4.0], "least_squares on lsim": [500.0]}

    @contextmanager
    def measuring(work, name):
        def measure(longest):
            said.append((name, longest))
            if name == "MIM 5":
                raise AbsentError("not here")
            return measured(work, name, taken[name].pop(0))

        said.append(f"{name} begins")
        yield measure
        said.append(f"{name} ends")

    monkeypatch.setattr(program, "measuring", measuring)
    monkeypatch.setattr(program, "TURNS", 3)
    ((work, found, absent),) = program.measured(["estimate"], Console(quiet=True))
    turn, alone = program.TURN, program.ALONE
    assert said == [
        *("LOM begins", ("LOM", turn), "MIM 5 begins", ("MIM 5", turn), ("LOM", turn), ("LOM", turn)),
        *("MIM 5 ends", "LOM ends"),
        *("least_squares on lsim begins", ("least_squares on lsim", alone), "least_squares on lsim ends"),
    ]
    assert work == "estimate" and absent == {"MIM 5": "not here"}
    assert {name: one.seconds for name, one in found.items()} == {"LOM": 4.0, "least_squares on lsim": 500.0}


def test_results_are_written_after_each_work(monkeypatch, tmp_path):
    def measuring(works, console):
        yield "estimate", {"LOM": measured("estimate", "LOM", 0.002)}, {"MIM 5": "not here"}
        raise KeyboardInterrupt

    monkeypatch.setattr(program, "measured", measuring)
    monkeypatch.setattr("sys.argv", ["benchmarks", "estimate", "scaling", "--out", str(tmp_path)])
    with pytest.raises(KeyboardInterrupt):
        program.main()
    assert "| LOM | 2 ms |" in (tmp_path / "results.md").read_text(encoding="utf-8")
    kept = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    assert kept["results"]["estimate"][0]["seconds"] == 0.002 and kept["absent"] == {"estimate": {"MIM 5": "not here"}}


def test_a_contender_is_measured_in_a_process_of_its_own_as_often_as_it_is_asked():
    with measuring("scaling", "steps 1000") as measure:
        once, again = measure(0.01), measure(0.0)
    assert (once.work, once.contender) == (again.work, again.contender) == ("scaling", "steps 1000")
    assert once.first == again.first and once.runs >= FEWEST == again.runs
    with measuring("scaling", "steps 1001") as measure, pytest.raises(RuntimeError, match="KeyError: 'steps 1001'"):
        measure(0.0)


def test_a_rival_that_is_not_installed_is_absent_whatever_it_prints(monkeypatch, tmp_path):
    (tmp_path / "pymor").mkdir()
    (tmp_path / "pymor" / "__init__.py").write_text("import os\nos.write(1, b'noise\\n')\nraise ImportError")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    contender = measuring("learn", "balanced truncation, order 5")
    with contender as measure, pytest.raises(AbsentError, match="pyMOR is not installed"):
        measure(0.0)


def test_an_interrupted_benchmark_leaves_nothing_running(monkeypatch):
    started = []

    class Recording(subprocess.Popen):
        def __init__(self, *args, **kwargs):
            super().__init__(*args, **kwargs)
            started.append(self)

    monkeypatch.setattr(subprocess, "Popen", Recording)
    with pytest.raises(KeyboardInterrupt), measuring("campaign", "BDF"):
        raise KeyboardInterrupt
    assert started[0].returncode is not None


def test_what_computes_the_errors_is_not_counted_as_memory(monkeypatch):
    """64 MiB, and the work itself next to nothing."""
    contender = Prepared(lambda: 0.0, lambda answer: {"error": float(np.ones(2**23).min()) - 1.0})
    fake = SimpleNamespace(CONTENDERS={"one": lambda: contender}, PLAIN=("one",))
    monkeypatch.setitem(sys.modules, "benchmarks.speed.works.fake", fake)
    measure = prepared_here("fake", "one")
    memory = [measure(0.0).memory for _ in range(3)]
    assert memory == [memory[0]] * 3 and (memory[0] is None or memory[0] < 32)


def test_exponents_of_a_power_law():
    results = {
        f"{name} {size}": measured("scaling", f"{name} {size}", 1e-6 * size**power)
        for power, (name, sizes) in enumerate(scaling.SIZES.items())
        for size in sizes
    }
    found = scaling.exponents(results)
    for power, name in enumerate(scaling.SIZES):
        assert found[name] == pytest.approx(power, abs=1e-9)


def test_the_table_says_what_was_measured_and_what_was_not():
    ground = {"processor": "P", "cores": 2, "load_at_start": 0.0, "python": "3.11", "versions": {"jax": "0"}}
    found = {"simulate": {"exact LOM": measured("simulate", "exact LOM", 0.00123, u=2e-14)}}
    text = as_markdown(found, {"simulate": {"lsim": "gone\nno lsim here"}}, ground)
    assert "| exact LOM | 1.23 ms | 1.23 ms to 1.23 ms | 1 s | 10 MiB | u 2.0e-14 |" in text
    assert "| lsim | - | - | - | - | no lsim here |" in text
    assert "not measured" in text
    untold = {"simulate": {"exact LOM": replace(found["simulate"]["exact LOM"], memory=None)}}
    assert "| 1 s | - | u 2.0e-14 |" in as_markdown(untold, {}, ground)


@pytest.mark.parametrize(("value", "text"), [(2.0, "2 s"), (0.0123, "12.3 ms"), (4.2e-5, "42 µs"), (3e-8, "0.03 µs")])
def test_seconds_have_a_fitting_unit(value, text):
    assert seconds(value) == text


def test_every_work_has_its_module():
    import importlib

    for work in WORKS:
        module = importlib.import_module(f"benchmarks.speed.works.{work}")
        assert module.TITLE and module.CONTENDERS and isinstance(module.asked({}), list)
