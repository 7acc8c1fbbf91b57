"""The large model with effects in: both solvers, the start, and what sensors and their logger make of a course."""

from typing import NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.linalg import expm

from wallid.discrepancy.effects.equation_terms import ForcingData, Terms
from wallid.discrepancy.effects.faces import FaceDepth, FaceLag, SurfaceFilm
from wallid.discrepancy.effects.heat_sources import AirFlow, HourlySource, LateralLoss, PlacedSource, UniformSource
from wallid.discrepancy.effects.material import (
    ContactResistance,
    DiffusivityDrift,
    LayeredCapacity,
    LayeredConductivity,
    PhaseChange,
    TemperatureDependentCapacity,
    TemperatureDependentConductivity,
    WettingByRain,
)
from wallid.discrepancy.effects.sensors import ClockShift, SensorGain, SensorLag
from wallid.discrepancy.forward.cells import build_cells, initial_state
from wallid.discrepancy.forward.instrument_readings import apply_sensor_effects
from wallid.discrepancy.forward.linear_wall import simulate_linear_wall
from wallid.discrepancy.forward.response import simulate_readings
from wallid.discrepancy.forward.time_stepping import simulate_nonlinear_wall

DAY, HOUR = 86400.0, 3600.0
L, ALPHA = 0.2, jnp.asarray(8e-7)
NODES, ROWS, STEP = 21, 25, HOUR
POSITION = np.array([0.03, 0.11])
TIME = np.arange(ROWS) * STEP


def cubics(values):
    """Smooth courses through values at the rows, as powers of s between rows."""
    pieces = CubicSpline(TIME, values).c[::-1]  # powers of t, from low to high
    return np.moveaxis(pieces * STEP ** np.arange(4).reshape(4, *[1] * (pieces.ndim - 1)), 0, 1)


def drive(left, right, *, outdoor=4.0, indoor=19.0):
    """A campaign of a day of hours, its columns given at the rows or as constants."""
    faces = np.stack([np.broadcast_to(left, ROWS), np.broadcast_to(right, ROWS)], axis=1).astype(float)
    zero = np.zeros((ROWS - 1, 4))
    width = np.full(NODES, L / (NODES - 1))
    width[[0, -1]] *= 0.5
    inner = np.linspace(0.0, 1.0, NODES)[1:-1]
    return ForcingData(
        step=jnp.asarray(STEP),
        faces=jnp.asarray(cubics(faces)),
        irradiance=jnp.asarray(zero),
        outdoor=jnp.asarray(cubics(np.broadcast_to(outdoor, ROWS).astype(float))),
        indoor=jnp.asarray(cubics(np.broadcast_to(indoor, ROWS).astype(float))),
        heating=jnp.asarray(zero),
        hour=jnp.asarray(TIME[:-1] / HOUR),
        initial=jnp.asarray(faces[0, 0] + (faces[0, 1] - faces[0, 0]) * inner),
        profile_modes=jnp.sin(jnp.pi * inner[:, None] * jnp.arange(1, 4)),
        common_noise=jnp.zeros((ROWS, 2)),
        reference=jnp.asarray(12.0),
        node_positions=jnp.linspace(0.0, L, NODES),
        resistance=jnp.full(NODES - 1, L / (NODES - 1)),
        capacity=jnp.asarray(width),
        layer_nodes=jnp.asarray([0, NODES - 1]),
        sensor_positions=jnp.asarray(POSITION),
        length=jnp.asarray(L),
    )


def wave(period, size=1.0, phase=0.0):
    return size * np.sin(2 * np.pi * TIME / period + phase)


@pytest.fixture(scope="module")
def campaign():
    """Weather on the left, a warm room on the right."""
    return drive(
        6.0 + wave(DAY, 5.0) + wave(5 * HOUR, 0.5), 18.0 + wave(DAY, 1.0, 1.0), outdoor=4.0 + wave(DAY, 3.0, 0.2)
    )


def extended(campaign, *effects):
    terms = Terms.plain(campaign)
    for effect in effects:
        terms = effect.apply(terms, campaign)
    return terms


LINEAR = (
    LayeredConductivity(0.5, 0.074),
    LayeredCapacity(-0.4, 0.126),
    ContactResistance(0.02, 0.09),
    SurfaceFilm(side="right", film_length=0.02),
    FaceDepth(side="left", depth=0.004),
    FaceLag(side="left", time_constant=600.0),
    UniformSource(1e-5),
    PlacedSource(5e-5, 0.07),
    HourlySource(3e-5, 7.25, 13.5),
    LateralLoss(air="outdoor", rate=4e-6),
    AirFlow(6e-7),
)


class Numbers(NamedTuple):
    """The wall's equation written out for SciPy: `T' = A T + B q`, readings `S T + F q`."""

    A: np.ndarray
    B: np.ndarray
    wall: object


def written_out(terms, campaign):
    """From cells to matrices, cell by cell."""
    wall = jax.tree.map(np.asarray, build_cells(terms, campaign))
    n = len(wall.capacity)
    A, B = np.zeros((n, n)), np.zeros((n, wall.inputs.shape[2]))
    B[:, 2:] = wall.heat_input_matrix
    for i in range(n):
        for cell, neighbour, wind in ((i, i - 1, 1.0), (i + 1, i + 1, -1.0)):
            flow = float(ALPHA) / wall.resistance[cell] / wall.capacity[i]
            A[i, i] -= flow
            taken = flow + wind * float(terms.velocity) / (wall.positions[i + 2] - wall.positions[i])
            if 0 <= neighbour < n:
                A[i, neighbour] += taken
            else:
                B[i, 0 if neighbour < 0 else 1] += taken
        A[i, i] -= wall.loss
    return Numbers(A, B, wall)


# ------------------------------------------------------------------------------------------------ the linear wall


def test_the_linear_course_is_the_matrix_exponential(campaign):
    """With every linear effect in: the inputs' polynomials go into the exponential as more states."""
    terms = extended(campaign, *LINEAR)
    profile = jnp.asarray([0.5, -0.3, 0.2])
    A, B, wall = written_out(terms, campaign)
    n, m = B.shape
    whole = np.zeros((n + 4 * m, n + 4 * m))  # T, then the inputs and three derivatives by s
    whole[:n, :n], whole[:n, n : n + m] = STEP * A, STEP * B
    whole[n : n + 3 * m, n + m :] = np.eye(3 * m)
    advance = expm(whole)
    T = np.asarray(initial_state(campaign, profile))
    states = [T]
    factorial = np.array([1.0, 1.0, 2.0, 6.0])[:, None]
    for piece in wall.inputs:
        T = (advance @ np.concatenate([T, (piece * factorial).ravel()]))[:n]
        states.append(T)
    states = np.array(states)
    q = np.concatenate([wall.inputs[:, 0], wall.inputs[-1:].sum(axis=1)])
    slope = np.concatenate([wall.inputs[:, 1], np.arange(4) @ wall.inputs[-1:]]) / STEP
    rates = states @ A.T + q @ B.T
    value, rate = simulate_linear_wall(build_cells(terms, campaign), campaign, ALPHA, jnp.asarray(states[0]))
    # round-off times the ratio of the fastest to the slowest rate
    assert_allclose(value, states @ wall.state_to_readings.T + q[:, :2] @ wall.faces_to_readings.T, rtol=0, atol=1e-9)
    assert_allclose(
        rate, rates @ wall.state_to_readings.T + slope[:, :2] @ wall.faces_to_readings.T, rtol=0, atol=1e-12
    )
    assert np.ptp(np.asarray(value), axis=0).min() > 0.5


def test_layers_and_joints_leave_the_effective_diffusivity(campaign):
    """`L^2 / (R C)` is the one parameter: both sums are the modelled length."""
    wall = build_cells(extended(campaign, *LINEAR[:3], LINEAR[4]), campaign)
    assert_allclose(wall.resistance.sum(), L - 0.004, rtol=1e-14)
    half_cells = build_cells(extended(campaign, LayeredCapacity(-0.4, 0.126)), campaign)
    # the faces' half cells store nothing that shows; the step is e^-0.2 on the left of 0.126 m, e^0.2 on the right
    total = 0.126 * np.exp(0.2) + (L - 0.126) * np.exp(-0.2)
    assert_allclose(half_cells.capacity[0] / half_cells.capacity[-1], np.exp(0.4), rtol=1e-12)
    assert_allclose(half_cells.capacity[0], L / (NODES - 1) * np.exp(0.2) * L / total, rtol=1e-12)


def test_a_mode_of_the_initial_profile_decays_by_itself():
    """`sin(k pi x/L) exp(-alpha (k pi/L)^2 t)` between faces at 0; the mesh's own eigenvalue is known too."""
    cold = drive(0.0, 0.0)
    for k in (1, 2):
        profile = jnp.zeros(3).at[k - 1].set(2.0)
        got = np.asarray(simulate_readings(Terms.plain(cold), cold, ALPHA, profile, linear=True))
        dx = L / (NODES - 1)
        pole = -float(ALPHA) * (2 / dx * np.sin(k * np.pi * dx / (2 * L))) ** 2
        shape = 2.0 * np.sin(k * np.pi * POSITION / L)
        # a cubic through four nodes 1 cm apart misses a sine by (k pi dx / L)^4 / 40 at most
        assert_allclose(got, np.exp(pole * TIME)[:, None] * shape, rtol=0, atol=2.0 * (k * np.pi * dx / L) ** 4 / 40)


@pytest.mark.parametrize(
    ("effects", "profile"),
    [
        ((SurfaceFilm(side="left", film_length=0.05),), lambda x: 20.0 * (x + 0.05) / (L + 0.05)),
        ((ContactResistance(0.05, 0.07),), lambda x: 20.0 * (x + 0.05 * (x > 0.07)) / (L + 0.05)),
        ((LayeredConductivity(np.log(3.0), 0.07),), lambda x: 20.0 * np.where(x < 0.07, 3 * x, 0.14 + x) / 0.34),
        ((AirFlow(4e-6),), lambda x: 20.0 * np.expm1(5.0 * x) / np.expm1(5.0 * L)),
        (
            (LateralLoss(air="outdoor", rate=2e-5),),
            lambda x: 5 - 5 * np.cosh(5 * (x - L / 2)) / np.cosh(5 * L / 2) + 20 * np.sinh(5 * x) / np.sinh(5 * L),
        ),
        ((UniformSource(4e-5),), lambda x: 20.0 * x / L + 25.0 * x * (L - x)),
    ],
)  # fmt: skip
def test_the_steady_wall_is_the_closed_solution(effects, profile):
    """Faces at 0 and 20 degC, outdoor air at 5: what is left after a day is the steady state (tau 1.4 h)."""
    still = drive(0.0, 20.0, outdoor=5.0)
    got = simulate_readings(extended(still, *effects), still, ALPHA, jnp.zeros(3), linear=True)[-1]
    # second order: (dx/L)^2 of 20 K times the profile's bend, under 1/4; a film's wall takes 3 h
    assert_allclose(got, profile(POSITION), rtol=0, atol=20.0 / (NODES - 1) ** 2 / 4 + 20.0 * np.exp(-8.0))


# -------------------------------------------------------------------------------------------- coefficients that change

NONLINEAR = (
    TemperatureDependentConductivity(0.01),
    TemperatureDependentCapacity(-0.006),
    PhaseChange(4.0, 10.0),
    DiffusivityDrift(0.2),
    WettingByRain(0.4, 0.5 * DAY, 6 * HOUR),
)
SURROUNDING = (LateralLoss(air="outdoor", rate=4e-6), AirFlow(6e-7))


@pytest.fixture(scope="module")
def changing(campaign):
    """A wall with everything that is not linear; its course by SciPy, the equation written out once more."""
    terms = extended(campaign, *NONLINEAR, *SURROUNDING)
    _, _, wall = written_out(terms, campaign)
    spacing = wall.positions[2:] - wall.positions[:-2]

    def inputs(t):
        row = min(int(t / STEP), ROWS - 2)
        return (t / STEP - row) ** np.arange(4) @ wall.inputs[row]

    def rate(t, T):
        q = inputs(t)
        padded = np.concatenate([q[:1], T, q[1:2]])
        k = 1 + 0.01 * ((padded[1:] + padded[:-1]) / 2 - 12.0)
        bump = 4.0 * np.exp(-0.5 * ((T - 10.0) / 0.5) ** 2) / (0.5 * np.sqrt(2 * np.pi))
        c = wall.capacity * (1 - 0.006 * (T - 12.0) + bump)
        pace = 1 + 0.2 * t / DAY
        onset = np.clip(0.5 + (t - 6 * HOUR) / (0.5 * HOUR), 0.0, 1.0)  # half an hour, as the package states
        pace *= 1 + 0.4 * onset * np.exp(-max(t - 6 * HOUR, 0.0) / (0.5 * DAY))
        flux = float(ALPHA) * pace * k * np.diff(padded) / wall.resistance
        wind = 6e-7 * (padded[2:] - padded[:-2]) / spacing
        return np.diff(flux) / c - wind + 4e-6 * (q[2] - T)

    T = np.asarray(initial_state(campaign, jnp.zeros(3)))
    part = solve_ivp(rate, TIME[[0, -1]], T, "LSODA", TIME, rtol=1e-9, atol=1e-9, max_step=STEP / 8)
    field = part.y.T
    q = np.concatenate([wall.inputs[:, 0], wall.inputs[-1:].sum(axis=1)])
    return terms, field @ wall.state_to_readings.T + q[:, :2] @ wall.faces_to_readings.T


@eqx.filter_jit
def stepped(terms, campaign, substeps, controller=None):
    wall = build_cells(terms, campaign)
    more = {} if controller is None else {"solver": diffrax.Tsit5(), "controller": controller}
    return simulate_nonlinear_wall(
        wall, terms, campaign, ALPHA, initial_state(campaign, jnp.zeros(3)), substeps=substeps, **more
    )  # fmt: skip


def test_the_stepped_course_converges_with_order_two(campaign, changing):
    terms, want = changing
    errors = [np.sqrt(np.mean((stepped(terms, campaign, parts)[0] - want) ** 2)) for parts in (8, 16, 32)]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert errors[0] < 1e-3
    # the matrix leaves out how the coefficients bend with temperature: a stiff wall takes some of the order
    assert_allclose(orders, 2.0, atol=0.25)
    assert_allclose(orders.mean(), 2.0, atol=0.1)


def freezing(campaign, terms):
    """The same wall's field by SciPy, for terms with a phase change alone, in the nodes' heat content."""
    wall = build_cells(terms, campaign)
    (bump,) = terms.latent

    def rate(t, T):
        row = min(int(t / STEP), ROWS - 2)
        q = (t / STEP - row) ** np.arange(4) @ np.asarray(wall.inputs[row])
        padded = np.concatenate([q[:1], T, q[1:2]])
        peak = float(bump.area) / (0.5 * np.sqrt(2 * np.pi))
        c = wall.capacity * (1 + peak * np.exp(-0.5 * ((T - float(bump.temperature)) / 0.5) ** 2))
        return np.diff(float(ALPHA) * np.diff(padded) / wall.resistance) / c

    T = np.asarray(initial_state(campaign, jnp.zeros(3)))
    part = solve_ivp(rate, TIME[[0, -1]], T, "BDF", TIME, rtol=1e-8, atol=1e-8, max_step=STEP / 4)
    q = np.concatenate([wall.inputs[:, 0], wall.inputs[-1:].sum(axis=1)])
    return part.y.T @ wall.state_to_readings.T + q[:, :2] @ wall.faces_to_readings.T


@pytest.mark.parametrize("area", [3.0, 15.0, 80.0])
def test_no_heat_is_lost_while_water_freezes(campaign, area):
    """A bump that a node crosses in one step: with the account in temperature the course went astray by 50 K."""
    terms = extended(campaign, PhaseChange(area=area, temperature=10.0))
    want = freezing(campaign, terms)
    coarse, fine = (np.abs(stepped(terms, campaign, parts)[0] - want).max() for parts in (3, 12))
    moved = np.abs(stepped(extended(campaign), campaign, 3)[0] - want).max()
    assert moved > 0.3, "the bump matters"
    assert coarse < 0.03 * moved
    assert fine < 0.2 * coarse


def test_an_adaptive_solver_of_diffrax_gives_the_same_wall(campaign, changing):
    terms, want = changing
    value, rate = stepped(
        terms, campaign, 1, diffrax.PIDController(rtol=1e-7, atol=1e-7, jump_ts=[5.75 * HOUR, 6.25 * HOUR])
    )
    assert_allclose(value, want, rtol=0, atol=2e-5)
    # the rate is the course's own derivative: central differences of hours miss a quarter of the 5-hour wave's
    within = slice(8, -1)
    slopes = (np.asarray(value)[2:] - np.asarray(value)[:-2]) / (2 * STEP)
    error = np.asarray(rate)[1:-1][within] - slopes[within]
    assert np.sqrt(np.mean(error**2)) < 0.12 * np.sqrt(np.mean(slopes[within] ** 2))


def test_at_neutral_values_the_stepped_course_is_the_linear_one_within_its_time_error(campaign):
    neutral = [type(effect)() for effect in NONLINEAR]
    terms = extended(campaign, *neutral, *SURROUNDING)
    wall = build_cells(terms, campaign)
    value, rate = simulate_linear_wall(wall, campaign, ALPHA, initial_state(campaign, jnp.zeros(3)))
    errors = []
    for parts in (16, 64):
        course, slope = stepped(terms, campaign, parts)
        errors.append([np.abs(course - value).max(), np.abs(slope - rate).max() * HOUR])
    assert np.max(errors[0]) < 5e-4
    assert np.all(np.divide(*errors) > 3.5**2), "order two: a sixteenth from a quarter of the step"


# ------------------------------------------------------------------------------------------------- sensors and logger


def sine(period=DAY):
    """A course and its rate, of a period, at both sensors."""
    omega = 2 * np.pi / period
    value = 10.0 + np.stack([np.sin(omega * TIME + phase) for phase in (0.3, 1.2)], axis=1)
    rate = omega * np.stack([np.cos(omega * TIME + phase) for phase in (0.3, 1.2)], axis=1)
    return jnp.asarray(value), jnp.asarray(rate), omega


def lagged(campaign, lag):
    value, rate, _ = sine()
    terms = eqx.tree_at(lambda t: t.lag, Terms.plain(campaign), jnp.full(2, lag))
    return np.asarray(apply_sensor_effects(terms, campaign, value, rate))


def test_a_sensor_without_lag_reads_the_temperature(campaign):
    assert_allclose(lagged(campaign, 0.0), sine()[0], rtol=4 * np.finfo(float).eps)


@pytest.mark.parametrize("lag", [20.0, 900.0, 0.999 * HOUR, 1.001 * HOUR, 6 * HOUR, 4 * DAY])
def test_a_lag_is_exact_for_the_cubics_between_rows(campaign, lag):
    """Against the closed response to a sine, to which the cubics are close to (omega h)^4 / 384."""
    value, _, omega = sine()
    bound = (omega * STEP) ** 4 / 384
    gain = 1.0 / (1.0 + 1j * omega * lag)
    phases = np.array([0.3, 1.2])
    steady = 10.0 + np.imag(gain * np.exp(1j * (omega * TIME[:, None] + phases)))
    want = steady + (value[0] - steady[0]) * np.exp(-TIME / lag)[:, None]
    assert_allclose(lagged(campaign, lag), want, rtol=0, atol=1.01 * bound)


def test_a_lag_goes_on_smoothly_through_a_step(campaign):
    """Below a step by a recurrence, above by phi-functions: the same value and slope on both sides."""

    def at(lag):
        value, rate, _ = sine()
        return apply_sensor_effects(
            eqx.tree_at(lambda t: t.lag, Terms.plain(campaign), jnp.full(2, lag)), campaign, value, rate
        )

    below, above = STEP * (1 - 1e-12), STEP * (1 + 1e-12)
    results = [jax.jvp(at, (jnp.asarray(lag),), (jnp.ones(()),)) for lag in (below, above)]
    assert_allclose(results[0][0], results[1][0], rtol=0, atol=1e-12)
    assert_allclose(results[0][1], results[1][1], rtol=0, atol=1e-14)
    # and at a thousandth of it, where the memory ends
    assert_allclose(lagged(campaign, 1e-3 * STEP * (1 - 1e-9)), lagged(campaign, 1e-3 * STEP * (1 + 1e-9)), atol=1e-10)


def test_the_slope_by_the_lag_at_none_is_that_of_the_equation(campaign):
    """`y = T - tau T' + ..`: also the first row, from which a sensor starts in equilibrium, aside."""
    value, rate, _ = sine()

    def at(lag):
        return apply_sensor_effects(
            eqx.tree_at(lambda t: t.lag, Terms.plain(campaign), jnp.full(2, lag)), campaign, value, rate
        )

    slope = jax.jvp(at, (jnp.zeros(()),), (jnp.ones(()),))[1]
    assert_allclose(slope[1:], -rate[1:], rtol=0, atol=1e-15)


@pytest.mark.parametrize("rows", [3, -2, 0])
def test_a_clock_wrong_by_whole_rows_moves_the_rows(campaign, rows):
    value, rate, _ = sine()
    late = apply_sensor_effects(extended(campaign, ClockShift(rows * STEP)), campaign, value, rate)
    moved = slice(max(rows, 0), ROWS + min(rows, 0))
    assert_allclose(late[moved], np.roll(value, rows, axis=0)[moved], rtol=0, atol=1e-12)
    # beyond the record on straight lines
    for row in set(range(ROWS)) - set(range(*moved.indices(ROWS))):
        end = 0 if rows > 0 else -1
        gap = (row - rows - (0 if rows > 0 else ROWS - 1)) * STEP
        assert_allclose(late[row], value[end] + gap * rate[end], rtol=0, atol=1e-12)


def test_a_clock_wrong_by_part_of_a_row_reads_between_rows(campaign):
    value, rate, omega = sine()
    delay = 0.37 * STEP
    late = apply_sensor_effects(extended(campaign, ClockShift(delay)), campaign, value, rate)
    want = 10.0 + np.sin(omega * (TIME[:, None] - delay) + np.array([0.3, 1.2]))
    assert_allclose(late[1:], want[1:], rtol=0, atol=1.01 * (omega * STEP) ** 4 / 384)


def test_a_late_slow_sensor_with_a_gain_reads_all_in_turn(campaign):
    """First the clock, then the lag, then the gain about T0."""
    value, rate, _ = sine()
    terms = extended(campaign, SensorGain(sensor=1, gain=0.1), SensorLag(sensor=1, time_constant=900.0))
    got = np.asarray(apply_sensor_effects(terms, campaign, value, rate))
    assert_allclose(got[:, 0], value[:, 0], rtol=4 * np.finfo(float).eps)
    slow = lagged(campaign, 900.0)[:, 1]
    assert_allclose(got[:, 1], 12.0 + 1.1 * (slow - 12.0), rtol=1e-14)
