"""The full-order model of a section, against norms, means of laminates, finite elements and SciPy."""

from itertools import pairwise

import numpy as np
import pytest
import scipy
from benchmarks.reference.section_by_finite_elements import ElementSection, Rectangle
from hypothesis import given, settings
from hypothesis import strategies as st

from wallid import InputError
from wallid.case.section import (
    Region,
    SectionMaterial,
    brick_with_joints,
    coursed_rubble,
    section_of_regions,
)
from wallid.models.section import SectionPoint, TensorMesh, full_order_section, section_mesh
from wallid.models.section.section_response import section_response
from wallid.models.section.steady_section import equivalent_wall, heat_flux, steady_section

STONE, MORTAR = SectionMaterial("stone", 1.5, 2.0e6), SectionMaterial("mortar", 0.5, 1.5e6)


def half_square_column(x, y):
    """A square column of side 2 at 0, its top at 20: the temperature a distance x below the top, y from its middle.

    By separation of variables: `80/pi sum (-1)^k/(2k+1) cos(l y) sinh(l (2 - x)) / sinh(2 l)`, `l = (2k+1) pi/2`.
    """
    order = 2 * np.arange(200) + 1
    rate = order * np.pi / 2
    ratio = np.exp(-rate * x) * (1 - np.exp(-2 * rate * (2 - x))) / (1 - np.exp(-4 * rate))
    return 80 / np.pi * np.sum((-1.0) ** np.arange(200) / order * np.cos(rate * y) * ratio)


def test_case_1_of_iso_10211():
    column = section_of_regions(
        2.0, 1.0, [SectionMaterial("column", 1.0, 1e6)], [Region("column", (0, 2), (0, 1))], top="right", step=0.02
    )
    places = [(0.25 * i, 0.25 * j) for i in range(1, 8) for j in range(4)]
    model = full_order_section(column, [SectionPoint(x, y, f"{x}, {y}") for x, y in places])
    found = list(steady_section(model, 20.0, 0.0).temperatures.values())
    expected = [half_square_column(x, y) for x, y in places]
    assert expected[0] == pytest.approx(15.1, abs=0.05) and expected[3] == pytest.approx(9.7, abs=0.05)  # the norm's
    assert np.abs(np.subtract(found, expected)).max() < 0.1


def test_case_2_of_iso_10211():
    """Concrete 6 mm, wood 5 x 15 mm, insulation, and an aluminium channel of 1.5 mm; 500 mm wide, 47.5 mm thick."""
    mm = 1e-3
    values = (("concrete", 1.15), ("wood", 0.12), ("insulation", 0.029), ("aluminium", 230.0))
    regions = [
        Region("insulation", (0.0, 47.5 * mm), (0.0, 0.5)),
        Region("concrete", (41.5 * mm, 47.5 * mm), (0.0, 0.5)),
        Region("wood", (36.5 * mm, 41.5 * mm), (0.485, 0.5)),
        Region("aluminium", (0.0, 1.5 * mm), (0.0, 0.5)),
        Region("aluminium", (0.0, 36.5 * mm), (0.4985, 0.5)),
        Region("aluminium", (35.0 * mm, 36.5 * mm), (0.485, 0.5)),
    ]
    section = section_of_regions(
        47.5 * mm, 0.5, [SectionMaterial(name, k, 1e6) for name, k in values], regions,
        surface_resistance_left=0.11, surface_resistance_right=0.06,
    )  # fmt: skip
    expected = {
        "A": (47.5, 500, 7.1), "B": (47.5, 0, 0.8), "C": (41.5, 500, 7.9), "D": (41.5, 485, 6.3), "E": (41.5, 0, 0.8),
        "F": (36.5, 500, 16.4), "G": (36.5, 485, 16.3), "H": (0, 500, 16.8), "I": (0, 0, 18.3),
    }  # fmt: skip
    model = full_order_section(section, [SectionPoint(x * mm, y * mm, name) for name, (x, y, _) in expected.items()])
    steady = steady_section(model, 20.0, 0.0)
    for name, (_, _, value) in expected.items():
        assert steady.temperatures[name] == pytest.approx(value, abs=0.1), name
    assert steady.heat_flow == pytest.approx(9.5, abs=0.1)
    assert steady.heat_flow_right == pytest.approx(steady.heat_flow, rel=1e-9)  # nothing is lost on the way


@given(
    st.lists(st.floats(0.05, 20.0), min_size=2, max_size=4),
    st.lists(st.floats(0.02, 0.2), min_size=4, max_size=4),
)
@settings(max_examples=15)
def test_laminates_have_the_means_of_their_conductivities(conductivities, widths):
    widths = np.array(widths[: len(conductivities)])
    ends = np.concatenate([[0.0], np.cumsum(widths)])
    materials = [SectionMaterial(f"m{k}", value, 1e6) for k, value in enumerate(conductivities)]
    pieces = list(pairwise(ends))
    across = [Region(f"m{k}", piece, (0.0, 0.3)) for k, piece in enumerate(pieces)]
    along = [Region(f"m{k}", (0.0, 0.3), piece) for k, piece in enumerate(pieces)]
    share = widths / widths.sum()
    harmonic, arithmetic = 1.0 / (share @ (1.0 / np.array(conductivities))), share @ conductivities
    series = section_of_regions(float(ends[-1]), 0.3, materials, across)
    parallel = section_of_regions(0.3, float(ends[-1]), materials, along)
    assert equivalent_wall(full_order_section(series)).conductivity == pytest.approx(harmonic, rel=1e-8)
    assert equivalent_wall(full_order_section(parallel)).conductivity == pytest.approx(arithmetic, rel=1e-8)


def test_a_checkerboard_has_the_geometric_mean():
    a, b = SectionMaterial("a", 1.0, 1e6), SectionMaterial("b", 3.0, 1e6)
    section = section_of_regions(
        1.0, 1.0, [a, b],
        [Region("a", (0, 1), (0, 1)), Region("b", (0, 0.5), (0, 0.5)), Region("b", (0.5, 1), (0.5, 1))],
    )  # fmt: skip
    lines = np.linspace(0.0, 1.0, 129)
    mesh = TensorMesh(lines, lines, section.cells.repeat(64, axis=0).repeat(64, axis=1))
    assert equivalent_wall(full_order_section(section, mesh=mesh)).conductivity == pytest.approx(3**0.5, rel=1e-3)


def test_a_material_may_conduct_otherwise_along_y():
    """With `y` stretched by the root of the anisotropy the material is isotropic: a column of other height."""
    ratio = 4.0
    wood = SectionMaterial("wood", 0.2, 1e6, conductivity_y=0.2 * ratio)
    plain = SectionMaterial("plain", 0.2, 1e6)
    tall = section_of_regions(2.0, 2.0, [wood], [Region("wood", (0, 2), (0, 2))], top="right", step=0.04)
    low = section_of_regions(2.0, 1.0, [plain], [Region("plain", (0, 2), (0, 1))], top="right", step=0.02)
    places = [(0.3, 0.2), (0.8, 0.5)]
    found = steady_section(full_order_section(tall, [SectionPoint(x, 2 * y, f"{x}") for x, y in places]), 1.0, 0.0)
    expected = [half_square_column(x, y) / 20 for x, y in places]
    assert list(found.temperatures.values()) == pytest.approx(expected, abs=2e-3)
    isotropic = steady_section(full_order_section(low, [SectionPoint(x, y, f"{x}") for x, y in places]), 1.0, 0.0)
    assert list(found.temperatures.values()) == pytest.approx(list(isotropic.temperatures.values()), abs=3e-3)


def test_the_model_is_symmetric_conservative_and_affine():
    section = section_of_regions(0.4, 0.3, [STONE, MORTAR], brick_with_joints(0.4, 0.3, brick="stone"))
    model = full_order_section(section).model
    for K, B in zip(model.conduction, model.drive, strict=True):
        assert abs(K - K.T).max() == 0.0
        assert np.abs(K.sum(axis=1) + B.sum(axis=1)).max() < 1e-12  # a temperature that is the same everywhere stays
    areas = [part.diagonal().sum() for part in model.capacity]
    assert sum(areas) < 0.4 * 0.3  # the faces' half volumes are at given temperatures
    E, K, B = model.at(np.array([1.0, 2.0]), np.array([3.0, 4.0]))
    assert abs(K - model.conduction[0] - 2 * model.conduction[1]).max() < 1e-12
    assert abs(E - 3 * model.capacity[0] - 4 * model.capacity[1]).max() < 1e-12


def test_the_flux_is_what_flows():
    section = section_of_regions(0.4, 0.3, [STONE, MORTAR], coursed_rubble(0.4, 0.3, seed=2))
    model = full_order_section(section)
    steady = steady_section(model, 20.0, 0.0)
    along_x, _ = heat_flux(model, steady.field)
    through = along_x.T @ np.diff(model.mesh.y)
    assert through == pytest.approx(steady.heat_flow, rel=1e-9)  # the same through every column of cells


@pytest.mark.parametrize("rows", [1.0, 6.0])
def test_the_response_is_that_of_an_integrator_with_error_control(rows):
    section = section_of_regions(0.3, 0.2, [STONE, MORTAR], coursed_rubble(0.3, 0.2, joint=0.03, grid=0.01, seed=1))
    full = full_order_section(
        section, [SectionPoint(0.1, 0.05), SectionPoint(0.2, 0.1)], mesh=section_mesh(section, 0.01)
    )
    step, count = 3600.0 * rows, 13
    faces = np.random.default_rng(0).normal(10.0, 5.0, (count, 2))
    found = section_response(full.model, full.conductivity, full.heat_capacity, faces, step, profile=(10.0, 2.0, -1.0))
    E, K, B = full.model.at(full.conductivity, full.heat_capacity)
    A, heat = scipy.sparse.diags_array(1.0 / E.diagonal()) @ K, B / E.diagonal()[:, None]
    state, expected = full.model.P @ np.array([10.0, 2.0, -1.0]), [None]
    for before, after in pairwise(faces):
        solved = scipy.integrate.solve_ivp(
            lambda t, x, q=before, dq=(after - before) / step: A @ x + heat @ (q + t * dq),
            (0.0, step), state, method="Radau", jac=A, rtol=1e-9, atol=1e-9,
        )  # fmt: skip
        state = solved.y[:, -1]
        expected.append(full.model.C @ state + full.model.D @ after)
    assert found[1:] == pytest.approx(np.array(expected[1:]), abs=1e-6)


def test_random_rubble_agrees_with_finite_elements_and_is_of_second_order():
    values = {"stone": STONE, "mortar": MORTAR}
    regions = coursed_rubble(0.5, 0.4, seed=1)
    rectangles = [
        Rectangle(one.x, one.y, values[one.material].conductivity, values[one.material].heat_capacity)
        for one in regions
    ]
    places = np.array([[0.1, 0.25], [0.25, 0.21], [0.42, 0.33]])
    time = 1800.0 * np.arange(2 * 24 * 4)
    faces = np.stack(
        [5 + 6 * np.sin(2 * np.pi * time / 86400) + np.sin(2 * np.pi * time / 3e5), 20 + np.sin(time / 13e3)], axis=1
    )
    expected = ElementSection(0.5, 0.4, rectangles, 0.012).temperatures(faces, 1800.0, places)
    section = section_of_regions(0.5, 0.4, [STONE, MORTAR], regions)
    mesh, errors = section_mesh(section, 0.006), []
    for _ in range(2):
        full = full_order_section(section, [SectionPoint(x, y) for x, y in places], mesh=mesh)
        found = section_response(full.model, full.conductivity, full.heat_capacity, faces, 1800.0)
        errors.append(np.abs(found - expected).max(axis=0))
        mesh = mesh.refined()
    assert errors[0].max() < 0.01
    assert (errors[0] / errors[1] > 3.0).all()  # 4 for second order


@pytest.mark.parametrize(
    ("step", "message"),
    [(0.01, "too coarse for parts of mortar that are 0.015 m thick"), (2e-5, "cells, more than 400000")],
)
def test_a_step_that_does_not_fit_is_refused(step, message):
    section = section_of_regions(0.5, 0.4, [STONE, MORTAR], coursed_rubble(0.5, 0.4, seed=1), step=step)
    with pytest.raises(InputError) as refused:
        full_order_section(section)
    assert message in str(refused.value)


def test_a_point_outside_is_refused():
    section = section_of_regions(0.5, 0.4, [STONE], [Region("stone", (0, 0.5), (0, 0.4))])
    with pytest.raises(InputError, match=r"T9: x = 0\.6 m"):
        full_order_section(section, [SectionPoint(0.6, 0.1, "T9")])


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
@settings(max_examples=30)
def test_readings_do_not_interpolate_across_a_joint(x, y):
    """In a laminate between two temperatures the steady field has a kink at each joint, and is straight between."""
    widths, conductivity = np.array([0.1, 0.03, 0.17]), np.array([1.5, 0.1, 0.8])
    ends = np.concatenate([[0.0], np.cumsum(widths)])
    materials = [SectionMaterial(f"m{k}", value, 1e6) for k, value in enumerate(conductivity)]
    pieces = [Region(f"m{k}", (ends[k], ends[k + 1]), (0.0, 0.2)) for k in range(3)]
    section = section_of_regions(0.3, 0.2, materials, pieces)
    model = full_order_section(section, [SectionPoint(0.3 * x, 0.2 * y, "T")])
    resistance = np.concatenate([[0.0], np.cumsum(widths / conductivity)])
    expected = 20.0 * (1.0 - np.interp(0.3 * x, ends, resistance) / resistance[-1])
    assert steady_section(model, 20.0, 0.0).temperatures["T"] == pytest.approx(expected, abs=1e-8)
