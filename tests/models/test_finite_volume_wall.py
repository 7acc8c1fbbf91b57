import hypothesis
import hypothesis.strategies as st
import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.reference.make_examples import slab_response
from scipy.integrate import solve_ivp
from systems import DAY, LENGTH, faces, fourier, slab

import wallid
from wallid.models.finite_volume_wall import grid, lagrange_weights

OMEGA = 2 * np.pi / (DAY / 2)
ALPHA = 5.21e-7


def space_error(nodes, points):
    """Largest error over 12 h; rows so fine that the inputs' straight lines do not show."""
    t = np.arange(0, 43201, 5.0)
    want, _ = slab_response(np.array(points), t, length=LENGTH, diffusivity=ALPHA, harmonics=((OMEGA, 0.0, 1.0),))
    got, _ = wallid.models.propagate(
        slab(nodes, points=points).modal(), fourier(ALPHA), 5 / DAY, faces(np.sin(OMEGA * t)), jnp.zeros(1)
    )
    return np.abs(got - want).max()


def observed_orders(points):
    """Over four refinements."""
    errors = np.array([space_error(nodes, points) for nodes in (21, 41, 81, 161, 321)])
    return np.log2(errors[:-1] / errors[1:])


def test_second_order_in_space_on_nodes():
    assert observed_orders((0.1, 0.25, 0.4)) == pytest.approx(2.0, abs=0.1)


def test_second_order_in_space_between_nodes():
    orders = observed_orders((0.0137, 0.1113, 0.2719, 0.4877))
    assert orders.min() > 1.9


def test_the_papers_matrices():
    system = slab(7)
    dx = 1 / 6
    want = (np.diag([-2.0] * 5) + np.diag([1.0] * 4, 1) + np.diag([1.0] * 4, -1)) / dx**2
    np.testing.assert_allclose(system.A, want, rtol=1e-13)
    np.testing.assert_allclose(system.B, np.eye(5)[:, [0, 4]] / dx**2, rtol=1e-13)


def test_modal_form_is_the_same_model():
    system = slab(25, degree=2)
    modal = system.modal()
    assert modal.is_diagonal
    np.testing.assert_allclose(modal.static_gain(), system.static_gain(), atol=1e-12)
    # analytic eigenvalues of the central difference
    k = np.arange(1, 24)
    want = -4 * 24**2 * np.sin(k * np.pi / 48) ** 2
    np.testing.assert_allclose(np.sort(modal.A), np.sort(want), rtol=1e-12)
    np.testing.assert_allclose(modal.C @ modal.P, system.C @ system.P, atol=1e-12)


@hypothesis.given(st.lists(st.floats(0.05, 1.0), min_size=1, max_size=4), st.integers(20, 90))
@hypothesis.settings(max_examples=30)
def test_grid_puts_a_node_on_every_joint(thickness, nodes):
    layers = tuple(wallid.Layer(d, 0.5 + i, 1e6 * (1 + i)) for i, d in enumerate(thickness))
    wall = wallid.Wall(length=sum(thickness), diffusivity_prior=5e-7, layers=layers)
    places = grid(wall, nodes)
    assert len(places) == nodes and places[0] == 0.0 and places[-1] == 1.0
    assert np.all(np.diff(places) > 0)
    for joint in np.cumsum(thickness)[:-1] / wall.length:
        assert np.abs(places - joint).min() < 1e-12


@hypothesis.given(st.floats(0.0, 3.0), st.sampled_from([0, 1]))
def test_weights_are_exact_for_cubics(x, derivative):
    nodes = np.array([0.0, 1.0, 2.0, 3.0])
    cubic = np.polynomial.Polynomial([0.3, -1.0, 0.7, 0.2])
    want = cubic.deriv()(x) if derivative else cubic(x)
    assert lagrange_weights(nodes, x, derivative) @ cubic(nodes) == pytest.approx(want, abs=1e-11)


LAYERS = (wallid.Layer(0.1, 0.04, 6e4), wallid.Layer(0.2, 1.4, 2e6), wallid.Layer(0.05, 0.3, 9e5))


def layered_by_scipy(points, t, left):
    """An independent fine solution of a layered wall: cells of 0.5 mm that meet at the joints, LSODA's BDF."""
    h = 5e-4
    cells = np.concatenate([np.full(round(layer.thickness / h), i) for i, layer in enumerate(LAYERS)])
    k = np.array([layer.conductivity for layer in LAYERS])[cells]
    c = np.array([layer.heat_capacity for layer in LAYERS])[cells]
    between = 1 / (h / 2 / k[1:] + h / 2 / k[:-1])
    first, last = 2 * k[0] / h, 2 * k[-1] / h

    def rate(time, T):
        flow = np.concatenate([[first * (left(time) - T[0])], between * (T[:-1] - T[1:]), [last * (T[-1] - 0.0)]])
        return (flow[:-1] - flow[1:]) / (c * h)

    from scipy.sparse import diags_array

    pattern = diags_array([np.ones(len(c) - 1), np.ones(len(c)), np.ones(len(c) - 1)], offsets=[-1, 0, 1])
    solved = solve_ivp(
        rate, (0, t[-1]), np.zeros(len(c)), t_eval=t, method="BDF", rtol=1e-7, atol=1e-9, jac_sparsity=pattern,
        max_step=900,
    )  # fmt: skip
    middles = (np.arange(len(c)) + 0.5) * h
    temperatures = np.stack([np.interp(points, middles, row) for row in solved.y.T])
    flux_left = first * (left(t) - solved.y[0])
    return temperatures, flux_left


def test_layered_wall_against_an_independent_solution():
    points = (0.05, 0.099, 0.2, 0.32)
    t = np.arange(0, 2 * DAY + 1, 600.0)

    def left(time):
        return np.sin(2 * np.pi * np.asarray(time) / DAY)

    want, want_flux = layered_by_scipy(points, t, left)
    wall = wallid.Wall(length=0.35, diffusivity_prior=1e-6, layers=LAYERS)
    outputs = [*(wallid.models.Output(x) for x in points), wallid.models.Output(0.0, "flux")]
    resistance = sum(layer.thickness / layer.conductivity for layer in LAYERS)
    capacity = sum(layer.thickness * layer.heat_capacity for layer in LAYERS)
    system = wallid.models.finite_volume_model(wall, outputs, nodes=181, profile_degree=0).modal()
    got, _ = wallid.models.propagate(system, DAY / (resistance * capacity), 600 / DAY, faces(left(t)), jnp.zeros(1))
    assert np.abs(got[:, :4] - want).max() < 5e-4
    # the first hours hold the jump in the face's slope, which both meshes see differently
    flux = np.asarray(got[:, 4]) / resistance
    assert np.abs(flux - want_flux)[6:].max() < 5e-3 * np.abs(want_flux).max()


def test_equal_layers_are_the_homogeneous_wall():
    layers = (wallid.Layer(0.2, 1.2, 1.5e6), wallid.Layer(0.3, 1.2, 1.5e6))
    one, two = slab(31, degree=2), slab(31, degree=2, layers=layers)
    np.testing.assert_allclose(one.static_gain(), two.static_gain(), atol=1e-12)
    inputs = faces(np.sin(np.arange(60) / 5.0), np.cos(np.arange(60) / 7.0))
    initial = jnp.asarray([0.5, -0.2, 0.4])
    first, second = (wallid.models.propagate(s.modal(), 0.3, 0.04, inputs, initial)[0] for s in (one, two))
    # the grids share cells differently, so they agree to their own error
    assert np.abs(first - second).max() < 2e-3


def test_steady_flux_is_conductance_times_difference_in_every_layer():
    wall = wallid.Wall(length=0.35, diffusivity_prior=1e-6, layers=LAYERS)
    places = (0.0, 0.05, 0.1, 0.2, 0.33, 0.35)
    system = wallid.models.finite_volume_model(
        wall, [wallid.models.Output(x, "flux") for x in places], nodes=61, profile_degree=0
    )
    # k_eff/L times the difference: 1 in the flux's own unit, the same everywhere
    np.testing.assert_allclose(system.static_gain() @ np.array([1.0, 0.0]), 1.0, rtol=1e-10)


def test_heat_is_conserved():
    """What enters through both faces is stored: the integral of the fluxes is the change of the mean."""
    rows = np.arange(0, 3.0001, 1 / 480)
    outputs = [wallid.models.Output(0.0, "flux"), wallid.models.Output(LENGTH, "flux")]
    inner = [wallid.models.Output(x) for x in np.linspace(0, LENGTH, 201)]
    wall = wallid.Wall(length=LENGTH, diffusivity_prior=5e-7)
    system = wallid.models.finite_volume_model(wall, [*outputs, *inner], nodes=201, profile_degree=0).modal()
    fo = 0.4
    u, _ = wallid.models.propagate(system, fo, rows[1], faces(1 - np.cos(rows), np.sin(rows) ** 2), jnp.zeros(1))
    u = np.asarray(u)
    stored = np.trapezoid(u[:, 2:], dx=1 / 200, axis=1)
    entered = fo * np.concatenate(
        [[0], np.cumsum(0.5 * np.diff(rows) * ((u[1:, 0] - u[1:, 1]) + (u[:-1, 0] - u[:-1, 1])))]
    )
    assert np.abs(stored - entered).max() < 1e-4 * np.abs(stored).max()


def test_mirror_symmetry():
    points = (0.06, 0.22)
    mirrored = tuple(LENGTH - x for x in points)
    q = faces(np.sin(np.arange(40) / 3.0), 0.3)
    one, _ = wallid.models.propagate(slab(30, points=points).modal(), 0.5, 0.03, q, jnp.zeros(1))
    two, _ = wallid.models.propagate(slab(30, points=mirrored).modal(), 0.5, 0.03, q[:, ::-1].copy(), jnp.zeros(1))
    np.testing.assert_allclose(one, two, atol=1e-12)


def test_maximum_principle():
    """Inside never warmer than the warmest face or start so far."""
    rng = np.random.default_rng(0)
    q = rng.uniform(0, 1, (80, 2))
    u, _ = wallid.models.propagate(slab(40).modal(), 0.5, 0.05, q, jnp.asarray([0.5]))
    assert u.max() <= 1.0 and u.min() >= 0.0


def test_sensors_in_the_first_cell_see_the_face_directly():
    system = slab(11, points=(0.01, LENGTH))
    assert np.asarray(system.D)[0, 0] > 0.5
    np.testing.assert_allclose(system.D[1], [0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(system.C[1], 0.0, atol=1e-12)


def test_errors_name_the_argument():
    with pytest.raises(ValueError, match="outside the wall"):
        slab(21, points=(0.7,))
    with pytest.raises(ValueError, match="nodes: 3"):
        slab(3)


def test_a_given_profile_of_any_degree():
    """A cubic start: the value at t = 0 is the profile itself."""
    system = slab(41, degree=3).modal()
    a = jnp.asarray([0.1, 0.4, -0.3, 0.8])
    u, _ = wallid.models.propagate(system, 0.5, 0.01, faces(np.full(3, 0.1), 1.0), a)
    x = np.array([0.1, 0.15, 0.25, 0.3, 0.45]) / LENGTH
    np.testing.assert_allclose(u[0], np.polynomial.polynomial.polyval(x, np.asarray(a)), atol=1e-12)
