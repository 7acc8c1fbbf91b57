import os
import socket
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from many_walls import ALPHAS, NOISE, ROWS, STEP, walls, without_reading
from scipy.integrate import cumulative_trapezoid

import wallid
from wallid.models.batching import sweep

ROOT = Path(__file__).parents[2]


def growth(item, rate):
    """A function of an item and of what all share, with two answers of other shapes."""
    return {"sum": jnp.sum(item["x"] * rate), "row": item["x"] ** 2}


@pytest.mark.parametrize("options", [{}, {"chunk": 3}, {"chunk": 50}, {"way": "vmap"}, {"mesh": True}])
def test_every_way_gives_numpys_answer(options):
    x = np.random.default_rng(0).standard_normal((7, 4))
    if options.pop("mesh", False):
        options["mesh"] = jax.make_mesh((1,), ("device",))
    found = sweep(growth, {"x": x}, jnp.asarray(2.0), **options)
    np.testing.assert_allclose(found["sum"], 2.0 * x.sum(axis=1), rtol=1e-14)
    np.testing.assert_allclose(found["row"], x**2, rtol=1e-14)


@pytest.mark.parametrize(
    ("items", "options", "words"),
    [
        ({"x": np.zeros((3, 2)), "y": np.zeros(4)}, {}, "one common first axis"),
        ({}, {}, "found none"),
        ({"x": np.zeros((0, 2))}, {}, "one row or more"),
        ({"x": np.zeros((3, 2))}, {"chunk": 0}, "at least 1"),
    ],
)
def test_what_cannot_be_swept_is_refused(items, options, words):
    with pytest.raises(ValueError, match=words):
        sweep(growth, items, jnp.asarray(1.0), **options)


def test_walls_of_other_shapes_cannot_be_stacked():
    with pytest.raises(ValueError, match="no items"):
        wallid.models.stack([])
    systems = [
        wallid.models.finite_volume_model(
            wallid.Wall(length=0.5, diffusivity_prior=5e-7), [wallid.models.Output(0.2)], nodes=nodes
        )
        for nodes in (11, 13)
    ]
    with pytest.raises(ValueError, match="must differ in their numbers only"):
        wallid.models.stack(systems)


def test_many_walls_end_at_their_truths():
    """The readings are the analytic slab's; straight lines between rows and 41 nodes leave some parts in 1e4."""
    found = wallid.estimate_walls(*walls())
    np.testing.assert_allclose(found.diffusivity, ALPHAS, rtol=1e-3)
    assert bool(found.converged.all())
    assert "5 walls, 5 estimated" in str(found)


def test_their_errors_are_those_of_the_noise():
    """60 noise seeds of one wall: pulls have a root mean square of 1 within its own standard error of 9 %."""
    found = wallid.estimate_walls(*walls(NOISE, alphas=np.full(60, 5.21e-7)), chunk=20)
    pulls = np.log(np.asarray(found.diffusivity) / 5.21e-7) / np.asarray(found.relative_std)
    assert 0.7 < np.sqrt(np.mean(pulls**2)) < 1.3
    assert np.asarray(found.reduced_chi_square).mean() == pytest.approx(1.0, abs=0.05)


def test_an_offset_is_projected_out():
    """One over the information that a free constant leaves is the variance: from the analytic derivative."""
    from benchmarks.reference.synthetic_twins import slab_response
    from many_walls import DAY, LENGTH, PLACES

    found = wallid.estimate_walls(*walls(offset_std=1e4))
    omega, time = 2 * np.pi / DAY, STEP * np.arange(ROWS)
    _, slope = slab_response(
        np.array(PLACES), time, length=LENGTH, diffusivity=ALPHAS[0], harmonics=((omega, 0.0, 5.0),)
    )
    free = ALPHAS[0] * (slope - slope.mean(axis=0)) / NOISE
    assert float(found.relative_std[0]) == pytest.approx(1 / np.sqrt(np.sum(free**2)), rel=3e-3)


def test_a_missing_reading_counts_for_nothing():
    full, gap = walls(), without_reading(walls(), 2, 40, 1)
    before, after = wallid.estimate_walls(*full), wallid.estimate_walls(*gap)
    np.testing.assert_allclose(after.diffusivity, before.diffusivity, rtol=1e-5)
    assert after.relative_std[2] > before.relative_std[2]
    np.testing.assert_array_equal(after.relative_std[:2], before.relative_std[:2])


def _surroundings(devices):
    flags = os.environ.get("XLA_FLAGS", "")  # the same code as in this process
    forced = {"XLA_FLAGS": f"{flags} --xla_force_host_platform_device_count={devices}", "JAX_ENABLE_X64": "1"}
    return os.environ | forced | {"PYTHONPATH": str(ROOT)}


def _process(out, devices, *job):
    command = [sys.executable, "tests/many_walls.py", str(out), *map(str, job)]
    return subprocess.Popen(command, cwd=ROOT, env=_surroundings(devices), stderr=subprocess.PIPE, text=True)


def _done(process):
    _, said = process.communicate(timeout=240)
    assert process.returncode == 0, said[-2000:]


def test_eight_devices_give_one_devices_numbers(tmp_path):
    _done(_process(tmp_path / "eight.npz", 8))
    found, alone = np.load(tmp_path / "eight.npz"), wallid.estimate_walls(*walls(NOISE))
    assert found["devices"] == 8
    np.testing.assert_allclose(found["diffusivity"], alone.diffusivity, rtol=1e-12)
    np.testing.assert_allclose(found["std"], alone.relative_std, rtol=1e-12)
    design = wallid.design(wallid.load("saint_julien"))
    np.testing.assert_allclose(found["windows"], design.information, rtol=1e-12)


@pytest.mark.slow
def test_two_processes_give_one_processs_numbers(tmp_path):
    """Over loopback, two devices each; both hold the whole answer."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    outs = [tmp_path / f"{number}.npz" for number in range(2)]
    processes = [_process(out, 2, address, 2, number) for number, out in enumerate(outs)]
    for process in processes:
        _done(process)
    alone = wallid.estimate_walls(*walls(NOISE))
    for out in outs:
        found = np.load(out)
        assert found["devices"] == 4
        np.testing.assert_allclose(found["diffusivity"], alone.diffusivity, rtol=1e-12)


def test_lanes_of_any_number_of_rows_give_the_integral():
    """A pole near 0 makes the state the integral of its input: the trapezoid rule, for lengths about squares."""
    for rows in (2, 3, 4, 5, 16, 17, 18, 4096, 4097, 4098, 8195):
        q = np.cumsum(np.random.default_rng(rows).standard_normal((rows, 2)), axis=0)
        system = wallid.StateSpace(
            A=np.array([-1e-17]), B=np.array([[1.0, -0.5]]), C=np.ones((1, 1)), D=np.zeros((1, 2)), P=np.ones((1, 1))
        )
        u, _ = wallid.models.propagate(system, 1.0, 0.1, q, np.array([3.0]))
        want = 3.0 + cumulative_trapezoid(q @ np.array([1.0, -0.5]), dx=0.1, initial=0)
        np.testing.assert_allclose(u[:, 0], want, rtol=1e-9, atol=1e-9)
