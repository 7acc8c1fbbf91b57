"""A disturbance as further states: against SciPy's matrix exponential, quadrature, and the balance of heat."""

import hypothesis
import hypothesis.strategies as st
import jax.numpy as jnp
import numpy as np
import pytest
import scipy
from numpy.testing import assert_allclose

import wallid
from wallid.models.disturbance import MaternProcess, gaussian_step, with_disturbance, with_slow_modes, without_heat
from wallid.models.exponential_solver import step_map
from wallid.models.finite_volume_wall import HeatProfile, Output, finite_volume_model
from wallid.models.integration import propagate

LENGTH = 0.3
LAYERS = (
    wallid.Layer(0.1, conductivity=0.5, heat_capacity=1.0e6),
    wallid.Layer(0.2, conductivity=1.5, heat_capacity=2.0e6),
)
SMOOTHNESS = ("matern-1/2", "matern-3/2")


PROFILES = (HeatProfile("wall"), HeatProfile("left", 1 / 6), HeatProfile("right", 1 / 6))


def wall_model(nodes=41, layers=(), profiles=PROFILES):
    wall = wallid.Wall(length=LENGTH, diffusivity_prior=5e-7, layers=layers)
    outputs = [Output(0.1), Output(0.0, "flux"), Output(LENGTH, "flux")]
    return finite_volume_model(wall, outputs, nodes=nodes, heat=profiles)


def dense(step, time):
    """Transition by SciPy's exponential, and noise by its solution of Lyapunov's equation."""
    F, L = step
    transition = scipy.linalg.expm(time * F)
    stationary = scipy.linalg.solve_continuous_lyapunov(F, -L @ L.T)
    return transition, stationary - transition @ stationary @ transition.T


@pytest.mark.parametrize("smoothness", SMOOTHNESS)
def test_the_states_have_the_covariance_of_the_process(smoothness):
    process = MaternProcess(2.0, 0.3, smoothness)
    lag = np.linspace(0.0, 2.0, 21)
    by_states = [(process.transition(t) @ process.stationary_covariance)[0, 0] for t in lag]
    assert_allclose(by_states, process.covariance(jnp.asarray(lag)), rtol=1e-12)
    for t in (0.01, 0.7):
        assert_allclose(process.transition(t), scipy.linalg.expm(t * np.asarray(process.rate_matrix)), atol=1e-13)
    F, P = np.asarray(process.rate_matrix), np.asarray(process.stationary_covariance)
    white = F @ P + P @ F.T
    assert_allclose(white.ravel()[:-1], 0.0, atol=1e-12)
    assert white[-1, -1] < 0.0


@pytest.mark.parametrize("smoothness", SMOOTHNESS)
def test_the_spectral_density_is_the_transform_of_the_covariance(smoothness):
    """By SciPy's quadrature; its integral over positive frequencies is the variance."""
    process = MaternProcess(2.0, 0.3, smoothness)

    def covariance(time):
        return float(process.covariance(jnp.asarray(time)))

    frequencies = np.array([0.1, 1.0, 3.0])
    found = process.spectral_density(frequencies)
    for one, frequency in zip(found, frequencies, strict=True):
        by_quadrature, _ = scipy.integrate.quad(covariance, 0.0, 12.0, weight="cos", wvar=2.0 * np.pi * frequency)
        assert float(one) == pytest.approx(4.0 * by_quadrature, rel=1e-6)
    fine = np.geomspace(1e-5, 1e5, 20_001)
    assert scipy.integrate.simpson(process.spectral_density(fine), x=fine) == pytest.approx(4.0, rel=1e-3)


@pytest.mark.parametrize("layers", [(), LAYERS])
@pytest.mark.parametrize("profile", range(3))
def test_steady_heat_leaves_through_the_faces(profile, layers):
    """All of it; of a homogeneous wall each part in proportion to its distance from the other face."""
    system = wall_model(201, layers).modal()
    gain = -np.asarray(system.C) @ (np.asarray(system.B0)[:, 2 + profile] / np.asarray(system.A))
    assert gain[2] - gain[1] == pytest.approx(1.0, rel=0.02)
    if not layers:
        x, depth = np.linspace(0, 1, 20001), 1 / 6
        density = [np.ones_like(x), np.exp(-x / depth), np.exp(-(1 - x) / depth)][profile]
        to_left = np.trapezoid(density * (1 - x), x) / np.trapezoid(density, x)
        assert -gain[1] == pytest.approx(to_left, rel=0.02)


@pytest.mark.parametrize("place", ["left", "right"])
def test_a_profile_decays_from_its_face(place):
    """By quadrature of its density, and to 1 over the wall."""
    profile, x = HeatProfile(place, 0.2), np.linspace(0, 1, 4001)
    density = np.exp(-(x if place == "left" else 1 - x) / 0.2)
    want = scipy.integrate.cumulative_trapezoid(density, x, initial=0.0)
    assert_allclose(profile.released_up_to(x), want / want[-1], atol=1e-6)


def test_a_unit_of_heat_warms_the_wall_by_one():
    """Before heat flows, the mean temperature rises by one per unit of time."""
    system = wall_model(301)
    rise = np.asarray(system.B0)[:, 2:]
    x = np.linspace(0, 1, 301)[1:-1]
    assert_allclose(rise[:, 0], 1.0, rtol=1e-12)
    depth = 1 / 6
    want = np.exp(-x / depth) / (depth * -np.expm1(-1 / depth))
    assert_allclose(rise[:, 1], want, rtol=1e-3)
    assert_allclose(rise[:, 2], want[::-1], rtol=1e-3)


@hypothesis.settings(deadline=None, max_examples=25)
@hypothesis.given(
    smoothness=st.sampled_from(SMOOTHNESS),
    profile=st.integers(0, 2),
    log_time_constant=st.floats(-5.0, 2.0),
    log_step=st.floats(-6.0, -1.0),
)
def test_the_step_is_exact(smoothness, profile, log_time_constant, log_step):
    """Against the exponential of the whole matrix, and the noise against Lyapunov's equation."""
    system, fourier, step = wall_model(9).modal(), 1.3, float(np.exp(log_step))
    process = MaternProcess(0.7, float(np.exp(log_time_constant)), smoothness)
    one = gaussian_step(system, fourier, step, process, 2 + profile)
    whole = with_disturbance(system, process, 2 + profile)
    rate = fourier * np.asarray(whole.A) + np.asarray(whole.A0)
    P = np.asarray(process.stationary_covariance)
    white = -(np.asarray(process.rate_matrix) @ P + P @ np.asarray(process.rate_matrix).T)[-1, -1]
    L = np.zeros((len(rate), 1))
    L[-1] = np.sqrt(white)
    transition, noise = dense((rate, L), step)
    assert_allclose(one.transition, transition, atol=1e-11, rtol=1e-9)
    scale = np.sqrt(np.diag(np.asarray(one.initial)[-process.order :, -process.order :]).max())
    assert_allclose(one.noise, noise, atol=1e-10 * max(1.0, scale**2))
    by_expm = step_map(whole, jnp.asarray(fourier), jnp.asarray(step), sensitivity=False, cubic=True)
    assert_allclose(one.W0, by_expm.W0, atol=1e-10)
    assert_allclose(one.W1, by_expm.W1, atol=1e-10)


def test_a_mode_as_slow_as_the_disturbance():
    """The step at equal rates is the limit of those beside them."""
    system = wall_model(9).modal()
    slowest = -float(np.max(np.asarray(system.A)))
    steps = [
        gaussian_step(system, 1.0, 0.05, MaternProcess(1.0, factor / slowest), 2)
        for factor in (1.0 - 1e-5, 1.0, 1.0 + 1e-5)
    ]
    for part in ("transition", "noise"):
        before, equal, after = (np.asarray(getattr(one, part)) for one in steps)
        assert_allclose(equal, 0.5 * (before + after), atol=1e-9)


def test_the_model_with_a_disturbance_is_the_same_wall():
    """Without heat its outputs are those of the wall; it is integrated by the same functions."""
    system = wall_model(21).modal()
    whole = with_disturbance(system, MaternProcess(1.0, 0.1), 3)
    inputs = np.random.default_rng(0).standard_normal((50, 2)).cumsum(axis=0)
    outputs = [
        propagate(one, 0.8, 0.02, inputs, jnp.array([1.0, 0.5, -0.2]))[0] for one in (whole, without_heat(system))
    ]
    assert_allclose(outputs[0], outputs[1], atol=1e-10)


def test_a_model_without_inputs_of_heat_is_refused():
    system = wall_model(9, profiles=()).modal()
    assert system.B0 is None and system.driven == (True, True)
    with pytest.raises(ValueError, match="inputs of heat"):
        gaussian_step(system, 1.0, 0.1, MaternProcess(1.0, 0.1), 2)
    with pytest.raises(ValueError, match="in its modes"):
        with_disturbance(wall_model(9), MaternProcess(1.0, 0.1), 2)


def test_fast_modes_follow_at_once():
    """Without the modes that decay within a row, the response to slow heat is that of the whole model."""
    system, fourier, step = wall_model(101).modal(), 1.0, 0.02
    slow = with_slow_modes(system, fourier, step)
    assert slow.order % 8 == 0 and slow.order < system.order
    process = MaternProcess(1.0, 0.5, "matern-3/2")
    for profile in (2, 3, 4):
        steps = [gaussian_step(one, fourier, step, process, profile) for one in (system, slow)]
        of_outputs = []
        for one in steps:
            stationary = np.asarray(one.initial)
            for _ in range(300):
                stationary = one.transition @ stationary @ one.transition.T + one.noise
            of_outputs.append(np.asarray(one.C @ stationary @ one.C.T))
        assert_allclose(of_outputs[1], of_outputs[0], atol=1e-3 * np.abs(of_outputs[0]).max())
    assert with_slow_modes(system, fourier, 1e-5) is system
