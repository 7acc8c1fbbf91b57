"""A section's reduced models: over the priors of its materials, and in modes for one diffusivity."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from wallid import Layer, Wall, simulate
from wallid.case.section import Region, SectionMaterial, coursed_rubble, section_of_regions
from wallid.models.finite_volume_wall import HeatProfile, Output, finite_volume_model
from wallid.models.section import SectionPoint, full_order_section, section_mesh
from wallid.models.section.material_range import MaterialRange
from wallid.models.section.material_sensitivity import material_sensitivity
from wallid.models.section.reduced_section import reduce_section
from wallid.models.section.section_response import section_response
from wallid.models.section.section_state_space import section_modes

STONE, MORTAR = SectionMaterial("stone", 1.5, 2.0e6), SectionMaterial("mortar", 0.5, 1.5e6)


def weather(rows, seed):
    """Hourly faces that no reduced model has seen: daily cycles and red noise, degC."""
    rng, time = np.random.default_rng(seed), np.arange(rows) / 24.0
    noise = np.zeros((rows, 2))
    for row in range(1, rows):
        noise[row] = 0.9 * noise[row - 1] + rng.standard_normal(2)
    daily = np.stack([8 + 6 * np.sin(2 * np.pi * time + 1), 19 + 2 * np.sin(2 * np.pi * time)], axis=1)
    return daily + noise


@pytest.fixture(scope="module")
def rubble():
    section = section_of_regions(0.5, 0.4, [STONE, MORTAR], coursed_rubble(0.5, 0.4, seed=1))
    points = [SectionPoint(0.1, 0.25, "T1"), SectionPoint(0.25, 0.21, "T2"), SectionPoint(0.42, None, "T3")]
    return section, full_order_section(section, points, mesh=section_mesh(section, 0.006))


@pytest.fixture(scope="module")
def reduced(rubble):
    section, full = rubble
    return reduce_section(full.model, MaterialRange.of(section), order=60)


@pytest.mark.parametrize("seed", [5, pytest.param(6, marks=pytest.mark.slow)])
def test_a_reduced_model_of_order_60_holds_over_the_priors_for_unseen_faces(rubble, reduced, seed):
    _, full = rubble
    materials, faces = reduced.materials, weather(24 * 8, seed)
    point = materials.points(4, 100 + seed)[-1]

    def response(model, z):
        return section_response(model, *materials.at(z), faces, 3600.0)

    exact = response(full.model, point)
    assert np.abs(response(reduced.model, point) - exact).max() / np.ptp(faces) < 1e-4
    for k in range(4):
        step = np.eye(4)[k] * 1e-3
        theta, own = (
            (response(model, point + step) - response(model, point - step)) / 2e-3
            for model in (full.model, reduced.model)
        )
        assert (np.abs(own - theta).max(axis=0) < 1e-2 * np.sqrt(np.mean(theta**2, axis=0))).all()


def test_a_reduced_model_is_symmetric_stable_and_keeps_a_constant(reduced):
    for z in reduced.materials.points(5, 7):
        E, K, B = reduced.model.at(*reduced.materials.at(z))
        assert np.abs(K - K.T).max() < 1e-12 * np.abs(K).max()
        assert np.linalg.eigvalsh(K).max() < 0.0 < np.linalg.eigvalsh(E).min()
        steady = np.linalg.solve(-K, B @ np.ones(2))
        assert reduced.model.C @ steady + reduced.model.D @ np.ones(2) == pytest.approx(1.0, abs=1e-10)


@pytest.mark.parametrize("profile", [None, (9.0, 4.0, -2.0)], ids=["steady start", "given profile"])
def test_the_explicit_sensitivities_are_those_of_finite_differences(reduced, profile):
    materials, faces = reduced.materials, weather(24 * 4, 8)
    point = materials.points(3, 9)[-1]

    def response(z):
        return section_response(reduced.model, *materials.at(z), faces, 3600.0, profile=profile, tolerance=1e-12)

    outputs, theta = material_sensitivity(reduced.model, *materials.at(point), faces, 3600.0, profile=profile)
    assert outputs == pytest.approx(response(point), abs=1e-8)
    assert theta.shape == (*outputs.shape[:1], 4, 3)
    for k in range(4):
        step = np.eye(4)[k] * 1e-3
        difference = (response(point + step) - response(point - step)) / (2e-3 * 0.3)
        assert theta[:, k] == pytest.approx(difference, abs=2e-5 * np.abs(difference).max())


def test_modes_of_one_rate_have_a_sensitivity():
    """A square between equal faces has pairs of modes with the same rate."""
    section = section_of_regions(0.2, 0.2, [STONE], [Region("stone", (0, 0.2), (0, 0.2))], step=0.02)
    full = full_order_section(section, [SectionPoint(0.05, 0.03)]).model
    dense = full.projected(np.eye(full.order))
    faces = weather(24, 3)
    k, c = np.array([1.5]), np.array([2e6])
    outputs, theta = material_sensitivity(dense, k, c, faces, 3600.0, profile=(10.0, 2.0, 0.0))
    assert np.isfinite(theta).all()
    low, high = (
        section_response(dense, k * np.exp(h), c, faces, 3600.0, profile=(10.0, 2.0, 0.0), tolerance=1e-12)
        for h in (-1e-4, 1e-4)
    )
    assert theta[:, 0] == pytest.approx((high - low) / 2e-4, abs=1e-6)
    # only the ratio of conductivity and capacity counts
    assert theta[:, 1] == pytest.approx(-theta[:, 0], abs=1e-9)
    assert outputs.shape == (24, 1)


def test_the_full_order_model_is_not_taken(rubble):
    _, full = rubble
    with pytest.raises(ValueError, match="reduced model"):
        material_sensitivity(full.model, np.ones(2), np.ones(2), np.zeros((3, 2)), 60.0)


def test_the_order_follows_from_the_tolerance(rubble):
    section, full = rubble
    coarse, fine = (
        reduce_section(full.model, MaterialRange.of(section), tolerance=tolerance) for tolerance in (3e-2, 3e-4)
    )
    assert coarse.error < 3e-2 and fine.error < 3e-4 and coarse.order < fine.order


def test_known_materials_need_fewer_states(rubble):
    section, full = rubble
    known = replace(MaterialRange.of(section), log_std=(0.0, 0.0))
    assert reduce_section(full.model, known).order < reduce_section(full.model, MaterialRange.of(section)).order


def test_a_section_that_varies_in_x_only_is_the_one_dimensional_wall():
    """The eigenvalues and the response on the same lines, by the wall's own model."""
    a, b = SectionMaterial("a", 1.5, 2e6), SectionMaterial("b", 0.4, 1.2e6)
    section = section_of_regions(
        0.3, 0.2, [a, b], [Region("a", (0, 0.3), (0, 0.2)), Region("b", (0.1, 0.22), (0, 0.2))]
    )
    wall = Wall(0.3, layers=(Layer(0.1, 1.5, 2e6), Layer(0.12, 0.4, 1.2e6), Layer(0.08, 1.5, 2e6)))
    full = full_order_section(section, [SectionPoint(0.07, 0.05), SectionPoint(0.15, 0.11), SectionPoint(0.25, None)])
    nodes = full.mesh.x / 0.3
    outputs = [Output(0.07), Output(0.15), Output(0.25)]
    plain = finite_volume_model(wall, outputs, nodes=len(nodes), node_positions=nodes)
    E, K, B = full.model.at(full.conductivity, full.heat_capacity)
    alpha = 0.3 / (0.1 / 1.5 + 0.12 / 0.4 + 0.08 / 1.5) / (0.6 * 2e6 + 0.4 * 1.2e6)
    rate, rows = alpha / 0.3**2, len(full.mesh.y)
    one_row = slice(3 * (len(nodes) - 2), 4 * (len(nodes) - 2))  # a row of nodes inside
    field = np.tile(np.sin(np.pi * nodes[1:-1]) + nodes[1:-1] ** 2, rows)
    own = ((K @ field) / E.diagonal())[one_row]
    assert own == pytest.approx(rate * np.asarray(plain.A) @ field[one_row], rel=1e-9, abs=1e-9 * np.abs(own).max())
    assert (B / E.diagonal()[:, None])[one_row] == pytest.approx(rate * np.asarray(plain.B), rel=1e-9, abs=1e-18)
    state = np.random.default_rng(0).normal(size=len(nodes) - 2)
    found = full.model.C @ np.tile(state, rows) + full.model.D @ np.array([1.0, 2.0])
    expected = np.asarray(plain.C) @ state + np.asarray(plain.D) @ np.array([1.0, 2.0])
    assert found == pytest.approx(expected, rel=1e-9)


@pytest.fixture(scope="module")
def layered():
    a, b = SectionMaterial("a", 1.5, 2e6), SectionMaterial("b", 0.4, 1.2e6)
    section = section_of_regions(
        0.3, 0.2, [a, b], [Region("a", (0, 0.3), (0, 0.2)), Region("b", (0.1, 0.22), (0, 0.2))], step=0.002
    )
    wall = Wall(0.3, layers=(Layer(0.1, 1.5, 2e6), Layer(0.12, 0.4, 1.2e6), Layer(0.08, 1.5, 2e6)))
    return section_modes(section), wall


def test_the_state_space_in_modes_is_that_of_the_layered_wall(layered):
    """Temperatures, gradient, fluxes at both faces, and heat inside, through a steady start."""
    modes, wall = layered
    nodes = modes.section.mesh.x / 0.3
    outputs = [
        Output(0.05, height=0.1), Output(0.15), Output(0.2, "gradient", height=0.05), Output(0.0, "flux"),
        Output(0.3, "flux"),
    ]  # fmt: skip
    heat = HeatProfile("wall"), HeatProfile("right", 0.2)
    own = modes.state_space(outputs, heat=heat)
    plain = finite_volume_model(wall, outputs, nodes=len(nodes), node_positions=nodes, heat=heat).modal()
    assert np.asarray(own.A)[-4:] == pytest.approx(np.asarray(plain.A)[-4:], rel=1e-8)
    time = jnp.arange(24 * 6) / 24.0
    inputs = jnp.stack(
        [jnp.sin(2 * jnp.pi * time) ** 2, 0.3 * jnp.sin(4 * jnp.pi * time), 0.2 * jnp.sin(7 * time),
         0.1 * jnp.sin(3 * time)], axis=1,
    )  # fmt: skip
    fourier = 86400.0 * modes.equivalent.diffusivity / 0.3**2
    found, expected = (
        np.asarray(simulate(model, fourier, time, inputs, jnp.array([0.0, 0.0, 0.0]))[0]) for model in (own, plain)
    )
    assert (np.abs(found - expected).max(axis=0) < 1e-3 * np.abs(expected).max(axis=0)).all()


def test_the_initial_profiles_of_a_homogeneous_section_are_powers():
    section = section_of_regions(0.3, 0.2, [STONE], [Region("stone", (0, 0.3), (0, 0.2))])
    modes = section_modes(section)
    outputs = [Output(x, height=0.1) for x in (0.06, 0.15, 0.24)]
    model = modes.state_space(outputs, profile_degree=2)
    start = np.asarray(model.C @ model.P) + np.asarray(model.D) @ np.array([[1.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    assert start == pytest.approx(np.vander([0.2, 0.5, 0.8], 3, increasing=True), abs=2e-3)
