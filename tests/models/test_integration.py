import decimal
import inspect
import os
import pickle
from dataclasses import replace
from types import SimpleNamespace

import diffrax
import equinox as eqx
import hypothesis
import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.reference.make_examples import slab_response
from numpy.testing import assert_allclose
from scipy.interpolate import PchipInterpolator
from systems import (
    DAY,
    LENGTH,
    POINTS,
    T_REF,
    faces,
    fourier,
    half_minutes,
    scipy_field_and_sensitivity,
    scipy_field_and_sensitivity_of_cubics,
    slab,
)

import wallid
from wallid._internal.arrays import index_array, on_device
from wallid._internal.xla_options import has_small_loops, known_flags
from wallid.models.exponential_solver import phi_functions, step_map
from wallid.models.integration import _as_array
from wallid.models.recurrence import single_kernel
from wallid.models.recurrence.blocks import run_in_blocks
from wallid.models.recurrence.row_by_row import run_row_by_row
from wallid.models.state_space import StateSpace


def phi_by_decimals(z):
    if z == 0:
        return [1.0, 1.0, 0.5, 1 / 6]
    z = decimal.Decimal(z)
    # each of the three divisions by z costs its digits
    with decimal.localcontext(prec=60 + 3 * max(0, -z.adjusted())):
        phi = [z.exp()]
        for factorial in (1, 1, 2):
            phi.append((phi[-1] - 1 / decimal.Decimal(factorial)) / z)
        return [float(value) for value in phi]


@hypothesis.given(st.floats(-1e6, 50.0))
def test_phi_functions_keep_their_digits_everywhere(z):
    got = phi_functions(jnp.asarray(z))
    # exp of a large z turns the rounding of z itself into |z| eps
    tolerance = 1e-14 * max(1.0, abs(z) if z > 0 else 1.0)
    for have, want in zip(got[1:], phi_by_decimals(z)[1:], strict=True):
        assert have == pytest.approx(want, rel=tolerance)


@pytest.mark.parametrize("z", [-1.0, -1.0 + 1e-12, -1.0 - 1e-12, -1e-300, 0.0, -1e-8, 0.999999999999])
def test_phi_functions_at_the_seam_and_near_zero(z):
    got = phi_functions(jnp.asarray(z))
    np.testing.assert_allclose(got, phi_by_decimals(z), rtol=3e-15)


def random_walk(rows, columns, seed):
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.normal(0, 0.02, (rows, columns)), axis=0)


def test_exact_solver_against_lsim_on_the_validation_case():
    """The issue's figure: 1e-10 for field and sensitivity. Both are exact for straight-line inputs."""
    time = half_minutes()
    system = slab()
    inputs = faces(5 * np.sin(2 * np.pi * time) / T_REF)
    fo = fourier(5.21e-7)
    want = scipy_field_and_sensitivity(system, fo, time, inputs, np.zeros(1))
    got = wallid.models.propagate(system.modal(), fo, time[1], inputs, jnp.zeros(1), sensitivity=True)
    for have, reference in zip(got, want, strict=True):
        assert np.abs(have - reference).max() < 1e-10


@pytest.mark.parametrize("modal", [True, False])
def test_a_jump_between_profile_and_faces_is_solved(modal):
    """Faces that do not meet the initial profile: a jump at t = 0, the same as lsim's."""
    time = np.arange(49) / 24.0
    system = slab(21, degree=2)
    inputs = random_walk(49, 2, 1) + np.array([0.7, -0.4])
    initial = jnp.asarray([0.1, 0.5, -0.8])
    want = scipy_field_and_sensitivity(system, 0.3, time, inputs, np.asarray(initial))
    used = system.modal() if modal else system
    got = wallid.models.propagate(used, 0.3, time[1], inputs, initial, sensitivity=True)
    for have, reference in zip(got, want, strict=True):
        assert np.abs(have - reference).max() < 1e-12 * max(1.0, np.abs(reference).max())


@pytest.mark.parametrize("modal", [True, False])
def test_fast_path_and_diffrax_give_the_same_numbers(modal):
    """The issue's figure: 1e-12."""
    time = np.arange(200) / 24.0
    system = slab(31, degree=2)
    system = system.modal() if modal else system
    inputs, initial = random_walk(200, 2, 2), jnp.asarray([0.0, 0.3, 0.1])
    fast = wallid.models.propagate(system, 0.4, 1 / 24.0, inputs, initial, sensitivity=True)
    slow = wallid.simulate(system, 0.4, jnp.asarray(time), inputs, initial, sensitivity=True)
    for have, want in zip(slow, fast, strict=True):
        assert np.abs(have - want).max() < 1e-12 * max(1.0, np.abs(want).max())


def test_numpys_arrays_are_copied_to_the_device_and_nothing_is_compiled(caplog):
    given = np.zeros((3, 7))
    with jax.log_compiles():
        held = on_device(given)
        part = index_array(held, slice(2))
    given[:] = 1.0
    assert np.all(np.asarray(held) == 0.0) and part.shape == (2, 7)
    assert "Compiling" not in caplog.text


@pytest.mark.skipif(jax.__version_info__ < (0, 10), reason="JAX gives an array the first float64 that it saw")
def test_a_float64_that_came_through_pickle_is_one():
    """Its dtype is another object than NumPy's own; converting it anew took longer than a reduced model's run."""
    given = jnp.asarray(pickle.loads(pickle.dumps(np.ones((3, 101, 7)))))
    assert given.dtype is not np.dtype(float)
    assert _as_array(given) is given


def test_times_must_increase():
    system, inputs, time = slab(9), random_walk(20, 2, 3), np.arange(20) / 24.0
    time[7] = time[6]
    with pytest.raises(ValueError, match="increase from row to row"):
        wallid.simulate(system, 0.4, time, inputs, jnp.zeros(1))
    u, _ = jax.jit(lambda time: wallid.simulate(system, 0.4, time, inputs, jnp.zeros(1)))(jnp.asarray(time))
    assert np.all(np.isnan(u))


@pytest.mark.parametrize("solver", [wallid.models.Exponential(), diffrax.Heun()])
def test_the_compilation_cache_takes_what_diffrax_steps(solver):
    """JAX keeps no program that calls back into Python."""
    system, inputs = slab(9), jnp.asarray(random_walk(20, 2, 3))

    def of(time):
        return wallid.simulate(system, 0.4, time, inputs, jnp.zeros(1), sensitivity=True, solver=solver)

    assert "callback" not in str(jax.make_jaxpr(of)(jnp.arange(20) / 24.0))


@pytest.mark.parametrize(
    ("nodes", "sensitivity", "free"),  # order 7 within one vector, 8 filling it, 21 in several
    [(9, True, False), (9, True, True), (9, False, False), (10, True, False), (23, True, False)],
)
def test_every_recurrence_gives_what_lsim_gives(nodes, sensitivity, free):
    system = slab(nodes, degree=2).modal()
    factor = 2.0 if free else 1.0
    if free:
        system = replace(system, C_theta=factor * system.C)
    time, inputs = np.arange(152) / 24.0, jnp.asarray(random_walk(152, 2, 6) + 0.3)
    initial = jnp.asarray([0.1, 0.5, -0.8])
    exact = step_map(system, jnp.asarray(0.4), jnp.asarray(time[1]), sensitivity=sensitivity)
    x = system.P @ initial
    start = x, jnp.zeros_like(x) if sensitivity else None
    want = scipy_field_and_sensitivity(slab(nodes, degree=2), 0.4, time, np.asarray(inputs), np.asarray(initial))

    _, by_row = eqx.filter_jit(run_row_by_row)(system, exact, start, inputs)  # the plain reference
    assert_allclose(by_row[0], want[0][1:], atol=1e-12)
    if sensitivity:
        assert_allclose(by_row[1], factor * want[1][1:], atol=1e-12)

    _, blocks = eqx.filter_jit(run_in_blocks)(system, exact, start, inputs)
    kernel = eqx.filter_jit(single_kernel.run_in_one_kernel)(system, exact, start, inputs)
    assert_allclose(blocks[0], by_row[0], atol=1e-13)
    assert_allclose(kernel[0][1:], by_row[0], atol=1e-13)
    assert_allclose(kernel[0][0], want[0][0], atol=1e-12)
    if sensitivity:
        assert_allclose(blocks[1], by_row[1], atol=1e-13)
        assert_allclose(kernel[1][1:], by_row[1], atol=1e-13)
    else:
        assert blocks[1] is None and kernel[1] is None


@pytest.mark.parametrize("nodes", [10, 23, 60])
def test_cubic_inputs_in_every_recurrence_and_by_diffrax(nodes):
    """Against SciPy's `expm` of the matrices with the powers of s as states; nodal and modal, row by row and fast."""
    nodal = slab(nodes, degree=2)
    system, rows, step, initial = nodal.modal(), 152, 1 / 24.0, jnp.asarray([0.1, 0.5, -0.8])
    values = random_walk(rows, 2, 6) + 0.3
    record = SimpleNamespace(time=np.arange(rows) * step * DAY, faces=values)
    still = SimpleNamespace(temperature=1.0, temperature_min=0.0)
    want = scipy_field_and_sensitivity_of_cubics(nodal, 0.4, record, 0, rows, still, np.asarray(initial))
    slopes = PchipInterpolator(np.arange(rows), values).derivative()(np.arange(rows)) / step
    inputs = jnp.asarray(np.hstack([values, slopes]))

    exact = step_map(system, jnp.asarray(0.4), jnp.asarray(step), sensitivity=True, cubic=True)
    x = system.P @ initial
    start = x, jnp.zeros_like(x)
    _, by_row = eqx.filter_jit(run_row_by_row)(system, exact, start, inputs)
    _, blocks = eqx.filter_jit(run_in_blocks)(system, exact, start, inputs)
    kernel = eqx.filter_jit(single_kernel.run_in_one_kernel)(system, exact, start, inputs)
    time = step * np.arange(rows)
    for model in (system, nodal):
        assert_allclose(wallid.models.propagate(model, 0.4, step, inputs, initial, sensitivity=True), want, atol=1e-11)
    by_diffrax = wallid.models.simulate(system, 0.4, time, inputs, initial, sensitivity=True)
    for k in (0, 1):
        assert_allclose(by_row[k], want[k][1:], atol=1e-11)
        assert_allclose(blocks[k], by_row[k], atol=1e-13)
        assert_allclose(kernel[k][1:], by_row[k], atol=1e-13)
        assert_allclose(by_diffrax[k], want[k], atol=1e-10)


@pytest.mark.parametrize(("nodes", "rows"), [(9, 61), pytest.param(20, 300, marks=pytest.mark.slow)])
def test_the_single_kernel_goes_through_every_transformation(monkeypatch, nodes, rows):
    """Closed over, mapped over models and inputs, forward and reverse, once and twice: nothing that XLA cannot make."""
    monkeypatch.setattr(single_kernel, "has_small_loops", lambda: True)
    system, inputs = slab(nodes).modal(), jnp.asarray(random_walk(rows, 2, 7))
    assert single_kernel.fits_single_kernel(system) and not single_kernel.fits_single_kernel(slab(40).modal())

    @jax.jit
    def of(fo, q=inputs, model=system):
        u, theta = wallid.models.propagate(model, fo, 0.04, q, jnp.zeros(1), sensitivity=True)
        return jnp.sum(u**2) + jnp.sum(theta**3)

    fos = jnp.asarray([0.3, 0.5, 0.8])
    one, each = float(of(0.5)), jax.vmap(of)(fos)
    step = 1e-5
    slope = float(of(0.5 + step) - of(0.5 - step)) / (2 * step)
    assert_allclose(jax.jit(lambda: of(0.5))(), one, rtol=1e-12)
    assert_allclose([each[1], jax.lax.map(of, fos)[1]], one, rtol=1e-12)
    assert_allclose([jax.grad(of)(0.5), jax.jacfwd(of)(0.5)], slope, rtol=1e-7)
    curved = (jax.grad(of)(0.5 + step) - jax.grad(of)(0.5 - step)) / (2 * step)
    assert_allclose(jax.hessian(of)(0.5), curved, rtol=1e-6)
    models = jax.tree.map(lambda *leaves: jnp.stack(leaves), system, system)
    together = jax.vmap(of, (0, 0, 0))(fos[:2], jnp.stack([2.0 * inputs, inputs]), models)
    assert_allclose(together[1], one, rtol=1e-12)
    way = jax.grad(lambda q: of(0.5, q))(inputs)
    assert_allclose(jnp.sum(way * inputs), jax.jvp(lambda q: of(0.5, q), (inputs,), (inputs,))[1], rtol=1e-10)


def test_what_xla_is_asked_holds():
    """The tests ask before JAX's first computation, as the commands do."""
    assert has_small_loops()
    assert not jax.config.read("jax_cpu_enable_async_dispatch")


@pytest.mark.parametrize(
    ("jaxlib", "known"), [("0.6.2", True), ("0.10.2", True), ("0.11.2", False), ("0.12.0.1", False), ("1.0.0", False)]
)
def test_a_flag_that_xla_does_not_know_is_not_set(jaxlib, known):
    flags = " ".join(known_flags(jaxlib))
    assert ("xla_cpu_use_fusion_emitters" in flags) == known
    assert "xla_cpu_small_while_loop_byte_threshold" in flags


def test_what_comes_too_late_for_xla_is_not_asked(monkeypatch):
    jnp.zeros(1).block_until_ready()
    monkeypatch.setenv("XLA_FLAGS", "--xla_cpu_use_fusion_emitters=true")
    with pytest.warns(UserWarning, match="prepare_xla: no effect, JAX has already started"):
        wallid.models.prepare_xla()
    assert os.environ["XLA_FLAGS"] == "--xla_cpu_use_fusion_emitters=true"


def test_uneven_rows_are_exact_too():
    """Rows at uneven times, cut out of a fine run whose inputs are straight lines between them."""
    rng = np.random.default_rng(3)
    keep = np.unique(np.concatenate([[0, 240], rng.choice(240, 40, replace=False)]))
    knots = random_walk(len(keep), 2, 4)
    fine = np.stack([np.interp(np.arange(241), keep, knots[:, side]) for side in (0, 1)], axis=1)
    system = slab(21).modal()
    want, _ = wallid.models.propagate(system, 0.5, 0.01, fine, jnp.zeros(1))
    got, _ = wallid.simulate(system, 0.5, jnp.asarray(keep * 0.01), knots, jnp.zeros(1))
    np.testing.assert_allclose(got, want[keep], atol=1e-13)


@hypothesis.given(fo=st.floats(1e-3, 50.0), step=st.floats(1e-3, 3.0), pieces=st.sampled_from([2, 5]))
@hypothesis.settings(max_examples=20)
def test_a_step_is_the_sum_of_its_parts(fo, step, pieces):
    """Cutting every step along its straight line changes nothing: what exactness means."""
    coarse = random_walk(6, 2, 5)
    fine = np.stack([np.interp(np.arange(5 * pieces + 1) / pieces, np.arange(6), coarse[:, s]) for s in (0, 1)], axis=1)
    system = slab(12, degree=1).modal()
    initial = jnp.asarray([0.2, 0.1])
    one = wallid.models.propagate(system, fo, step, coarse, initial, sensitivity=True)
    many = wallid.models.propagate(system, fo, step / pieces, fine, initial, sensitivity=True)
    for have, want in zip(many, one, strict=True):
        assert np.abs(have[::pieces] - want).max() < 1e-12 * max(1.0, np.abs(want).max())


@hypothesis.given(a=st.floats(-5, 5), b=st.floats(-5, 5), seed=st.integers(0, 50))
@hypothesis.settings(max_examples=20)
def test_superposition(a, b, seed):
    system = slab(12, degree=2).modal()
    one, two = random_walk(30, 2, seed), random_walk(30, 2, seed + 100)
    start_one, start_two = jnp.asarray([0.3, 0.1, 0.0]), jnp.asarray([0.0, -0.2, 0.5])

    def u(inputs, initial):
        return wallid.models.propagate(system, 0.7, 0.05, inputs, initial)[0]

    combined = u(a * one + b * two, a * start_one + b * start_two)
    parts = a * u(one, start_one) + b * u(two, start_two)
    np.testing.assert_allclose(combined, parts, atol=1e-12 * (1 + abs(a) + abs(b)))


def test_a_wall_in_steady_state_stays_there_without_sensitivity():
    system = slab(41, degree=1).modal()
    u, theta = wallid.models.propagate(
        system, 1.0, 0.1, faces(np.full(50, 0.2), 0.8), jnp.asarray([0.2, 0.6]), sensitivity=True
    )
    np.testing.assert_allclose(u, np.tile(0.2 + 0.6 * np.array(POINTS) / LENGTH, (50, 1)), atol=1e-13)
    np.testing.assert_allclose(theta, 0.0, atol=1e-13)


def test_a_model_goes_through_its_file_and_back(tmp_path):
    """Every array comes to its own place, also where there are more inputs than faces."""
    shapes = {"A": (4, 4), "B": (4, 3), "C": (2, 4), "D": (2, 3), "P": (4, 1), "A0": (4, 4), "B0": (4, 3)}
    shapes |= {"C_theta": (2, 4), "capacity": (4,)}
    given = {name: jnp.full(shape, float(k)) for k, (name, shape) in enumerate(shapes.items())}
    for absent in ((), ("A0", "C_theta")):
        kept = {name: value for name, value in given.items() if name not in absent}
        StateSpace(**kept, driven=(True, False, True)).save(tmp_path / "model.npz")
        again = StateSpace.load(tmp_path / "model.npz")
        assert again.driven == (True, False, True)
        for name in given:
            value = getattr(again, name)
            assert (value is None) == (name not in kept)
            assert value is None or np.array_equal(value, kept[name])


@pytest.mark.parametrize("other", [wallid.Window(0, 3), np.eye(2)])
def test_what_is_no_model_is_refused_by_name(other):
    """By the function itself; in these tests a checker of types would come first."""
    with pytest.raises(TypeError, match=rf"must be a StateSpace, not a {type(other).__name__}"):
        inspect.unwrap(wallid.models.propagate)(other, 1.0, 0.1, np.zeros((3, 2)), np.zeros(1))


def lagging(system, tau):
    """The same wall with a sensor that lags its first output by tau: no weights symmetrise it."""
    n = system.order
    A0 = np.zeros((n + 1, n + 1))
    A0[n, :n], A0[n, n] = np.asarray(system.C)[0] / tau, -1 / tau
    return wallid.StateSpace(
        A=np.pad(np.asarray(system.A), ((0, 1), (0, 1))),
        B=np.pad(np.asarray(system.B), ((0, 1), (0, 0))),
        C=np.eye(n + 1)[[n]],
        D=np.zeros((1, 2)),
        P=np.concatenate([np.asarray(system.P), np.asarray(system.C @ system.P)[:1]]),
        A0=jnp.asarray(A0),
        B0=jnp.zeros((n + 1, 2)),
    )


def test_a_model_without_symmetry_goes_through_a_dense_exponential():
    """A lagging sensor against lsim, field and sensitivity, and it refuses to be modal."""
    system = lagging(slab(21, degree=1), 0.02)
    assert not system.is_symmetrisable
    with pytest.raises(ValueError, match="cannot be symmetrised"):
        system.modal()
    time, inputs, fo = np.arange(60) / 48.0, random_walk(60, 2, 6), 0.6
    A, A0, B = (np.asarray(part) for part in (system.A, system.A0, system.B))
    n = len(A)
    stacked = (
        np.block([[fo * A + A0, np.zeros_like(A)], [A, fo * A + A0]]),
        np.vstack([fo * B, B]),
        np.pad(np.asarray(system.C), ((0, 1), (0, n))) + np.pad(np.asarray(system.C), ((1, 0), (n, 0))),
        np.zeros((2, 2)),
    )
    from scipy.signal import lsim

    start = np.concatenate([np.asarray(system.P) @ [0.1, 0.4], np.zeros(n)])
    _, want, _ = lsim(stacked, inputs, time, X0=start, interp=True)
    got = wallid.models.propagate(system, fo, time[1], inputs, jnp.asarray([0.1, 0.4]), sensitivity=True)
    np.testing.assert_allclose(got[0][:, 0], want[:, 0], atol=1e-12)
    np.testing.assert_allclose(got[1][:, 0], want[:, 1], atol=1e-12)


def test_heun_converges_with_order_two():
    system = slab(11, degree=1).modal()
    inputs, initial = random_walk(13, 2, 7), jnp.asarray([0.0, 0.5])
    exact, _ = wallid.models.propagate(system, 0.3, 1 / 12.0, inputs, initial)
    time = jnp.arange(13) / 12.0
    least = wallid.models.stable_substeps(system, 0.3, 1 / 12.0)
    errors = []
    for factor in (4, 8, 16):
        u, _ = wallid.simulate(system, 0.3, time, inputs, initial, solver=diffrax.Heun(), substeps=factor * least)
        errors.append(np.abs(u - exact).max())
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert orders == pytest.approx(2.0, abs=0.15)


def test_heun_is_stable_where_stable_substeps_says_so():
    system = slab(31).modal()
    inputs = random_walk(25, 2, 8)
    exact, _ = wallid.models.propagate(system, 1.0, 1 / 24.0, inputs, jnp.zeros(1))
    least = wallid.models.stable_substeps(system, 1.0, 1 / 24.0)
    assert least > 10
    time = jnp.arange(25) / 24.0
    u, _ = wallid.simulate(system, 1.0, time, inputs, jnp.zeros(1), solver=diffrax.Midpoint(), substeps=least)
    assert np.abs(u - exact).max() < 1e-3


def test_an_implicit_solver_agrees_within_its_tolerance():
    system = slab(21, degree=1)
    inputs, initial = random_walk(13, 2, 9), jnp.asarray([0.0, 0.5])
    time = jnp.arange(13) / 12.0
    exact = wallid.models.propagate(system.modal(), 0.8, 1 / 12.0, inputs, initial, sensitivity=True)
    got = wallid.simulate(
        system,
        0.8,
        time,
        inputs,
        initial,
        sensitivity=True,
        solver=diffrax.Kvaerno5(),
        controller=diffrax.PIDController(rtol=1e-8, atol=1e-10),
    )
    for have, want in zip(got, exact, strict=True):
        assert np.abs(have - want).max() < 1e-6


def test_reverse_mode_through_diffrax():
    system = slab(11).modal()
    inputs, time = random_walk(13, 2, 10), jnp.arange(13) / 12.0

    def cost(fo, adjoint):
        return jnp.sum(wallid.simulate(system, fo, time, inputs, jnp.zeros(1), adjoint=adjoint)[0] ** 2)

    reverse = jax.grad(cost)(0.5, diffrax.RecursiveCheckpointAdjoint())
    forward = jax.jvp(lambda fo: cost(fo, diffrax.ForwardMode()), (0.5,), (1.0,))[1]
    assert reverse == pytest.approx(float(forward), rel=1e-11)


def test_theta_against_finite_differences_of_the_analytic_slab():
    """A slab with sinusoidal face, its analytic solution differentiated by finite differences."""
    t = np.arange(1441) * 60.0
    omega = 2 * np.pi / DAY
    alpha, change = 5.21e-7, 5.21e-7 * 1e-4
    harmonics = ((omega, 0.0, 1.0),)

    def analytic(value):
        return slab_response(np.array(POINTS), t, length=LENGTH, diffusivity=value, harmonics=harmonics)[0]

    slope = (analytic(alpha + change) - analytic(alpha - change)) / (2 * change)
    system = slab(201).modal()
    _, theta = wallid.models.propagate(
        system, fourier(alpha), 60 / DAY, faces(np.sin(omega * t)), jnp.zeros(1), sensitivity=True
    )
    theta_per_alpha = np.asarray(theta) * DAY / LENGTH**2
    # second order in space (dx = 1/200) and in the inputs' straight lines (60 s)
    assert np.abs(theta_per_alpha - slope).max() < 2e-4 * np.abs(slope).max()


@pytest.mark.parametrize("integrator", ["propagator", "diffrax"])
def test_explicit_theta_equals_autodiff_of_the_large_model(integrator):
    """The issue's figure: 1e-9 relative."""
    case = wallid.load("validation")
    system = wallid.full_order_model(case)
    data = wallid.models.window_data(case)
    explicit = wallid.models.explicit(system, fourier(4e-7), data, integrator=integrator)
    autodiff = wallid.models.autodiff(system, fourier(4e-7), data, integrator=integrator)
    for one, two in zip(explicit, autodiff, strict=True):
        assert np.abs(one - two).max() < 1e-9 * np.abs(two).max()


def test_vmap_over_diffusivities_equals_a_loop():
    system = slab(21).modal()
    inputs = random_walk(40, 2, 11)
    fos = jnp.geomspace(0.05, 5.0, 7)
    together = jax.vmap(lambda fo: wallid.models.propagate(system, fo, 0.02, inputs, jnp.zeros(1))[0])(fos)
    for fo, have in zip(fos, together, strict=True):
        np.testing.assert_allclose(have, wallid.models.propagate(system, fo, 0.02, inputs, jnp.zeros(1))[0], atol=1e-14)


def test_no_new_trace_for_new_values():
    traced = eqx.debug.assert_max_traces(
        lambda s, fo, q: wallid.models.propagate(s, fo, 0.1, q, jnp.zeros(1))[0], max_traces=1
    )
    compiled = eqx.filter_jit(traced)
    for k in range(3):
        compiled(slab(11, length=0.5 + 0.1 * k).modal(), jnp.asarray(0.1 + k), jnp.asarray(random_walk(9, 2, k)))


@pytest.mark.parametrize("way", ["propagate", "simulate"])
def test_plain_numbers_are_not_compiled_anew(way, caplog):
    """A Python float for Fo or the step is an argument like any other."""
    system, inputs, time = slab(9).modal(), random_walk(7, 2, 1), np.arange(7) / 10

    def call(fo):
        if way == "propagate":
            return wallid.models.propagate(system, fo, 0.1 * fo, inputs, np.zeros(1))
        return wallid.simulate(system, fo, time * fo, inputs, np.zeros(1))

    call(0.3)
    with jax.log_compiles(), caplog.at_level("WARNING"):
        call(0.4)
        call(0.5)
    assert not [record for record in caplog.records if "Compiling" in record.message]


@pytest.mark.parametrize(
    ("inputs", "initial", "message"),
    [
        (np.zeros((5, 3)), np.zeros(1), "inputs: shape"),
        (np.zeros((1, 2)), np.zeros(1), "at least two rows"),
        (np.zeros((5, 2)), np.zeros(2), "initial: shape"),
    ],
)
def test_wrong_shapes_are_named(inputs, initial, message):
    with pytest.raises(ValueError, match=message):
        wallid.models.propagate(slab(11).modal(), 1.0, 0.1, jnp.asarray(inputs), jnp.asarray(initial))


def test_the_exact_solver_takes_no_adaptive_controller():
    with pytest.raises(ValueError, match="gives no error estimate"):
        wallid.simulate(
            slab(11).modal(),
            1.0,
            jnp.arange(5.0),
            jnp.zeros((5, 2)),
            jnp.zeros(1),
            controller=diffrax.PIDController(rtol=1e-3, atol=1e-3),
        )


def test_single_precision_is_refused():
    enable_x64 = jax.enable_x64 if hasattr(jax, "enable_x64") else jax.experimental.enable_x64  # the older name
    with enable_x64(False), pytest.raises(RuntimeError, match="jax_enable_x64"):
        slab(11)
