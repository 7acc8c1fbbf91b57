"""The benchmark's own parts: its rivals give the right answer, its tables say what was measured."""

import shutil
from contextlib import contextmanager

import numpy as np
import pytest
from benchmarks import __main__ as program
from benchmarks.__main__ import WORKS
from benchmarks.measure import FEWEST, AbsentError, Measured, measuring
from benchmarks.rivals.integrators import by_lsim
from benchmarks.rivals.recurrence import compiled
from benchmarks.table import as_markdown, seconds
from benchmarks.works import learn, scaling, simulate
from benchmarks.works.ratio import Asked
from rich.console import Console
from scipy.signal import lsim

import wallid


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


def test_lsim_with_theta_is_lsims_own_difference():
    system = wallid.lom(wallid.Wall(length=0.4, diffusivity_prior=5e-7), [wallid.Output(0.1)], nodes=15)
    time = np.arange(50) / 24
    inputs = np.cumsum(np.random.default_rng(3).standard_normal((50, 2)), axis=0)
    run = by_lsim(system, time, inputs, np.array([1.0, 0.5, 0.0]))
    u, theta = run(0.2)
    near = [run(0.2 + s)[0] for s in (-1e-5, 1e-5)]
    np.testing.assert_allclose(theta, (near[1] - near[0]) / 2e-5, atol=1e-5 * np.abs(theta).max())
    assert u.shape == theta.shape == (50, 1)


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
    assert reached["MIM 5, times faster than exact LOM"] == pytest.approx(10)
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
        def ask():
            said.append(name)
            if name == "MIM 5":
                raise AbsentError("not here")
            return measured(work, name, taken[name].pop(0))

        said.append(f"{name} begins")
        yield ask
        said.append(f"{name} ends")

    monkeypatch.setattr(program, "measuring", measuring)
    monkeypatch.setattr(program, "TURNS", 3)
    found, absent = program.measured(["estimate"], Console(quiet=True))
    turns = ["LOM begins", "LOM", "MIM 5 begins", "MIM 5", "LOM", "LOM", "MIM 5 ends", "LOM ends"]
    assert said == [*turns, *(f"least_squares on lsim{what}" for what in (" begins", "", " ends"))]
    assert {name: one.seconds for name, one in found["estimate"].items()} == {
        "LOM": 4.0,
        "least_squares on lsim": 500.0,
    }
    assert absent == {"estimate": {"MIM 5": "not here"}}


def test_a_contender_is_measured_in_a_process_of_its_own_as_often_as_it_is_asked():
    with measuring("scaling", "steps 1000") as ask:
        once, again = ask(), ask()
    assert (once.work, once.contender) == (again.work, again.contender) == ("scaling", "steps 1000")
    assert once.first == again.first and min(once.runs, again.runs) >= FEWEST
    with measuring("scaling", "steps 1001") as ask, pytest.raises(RuntimeError, match="KeyError: 'steps 1001'"):
        ask()


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


@pytest.mark.parametrize(("value", "text"), [(2.0, "2 s"), (0.0123, "12.3 ms"), (4.2e-5, "42 µs"), (3e-8, "0.03 µs")])
def test_seconds_have_a_fitting_unit(value, text):
    assert seconds(value) == text


def test_every_work_has_its_module():
    import importlib

    for work in WORKS:
        module = importlib.import_module(f"benchmarks.works.{work}")
        assert module.TITLE and module.CONTENDERS and isinstance(module.asked({}), list)
