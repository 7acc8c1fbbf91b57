"""Materials of a diffusivity, and the slip of units that an impossible one suggests."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wallid.estimation.materials import implausible, materials_like


@pytest.mark.parametrize(
    ("conductivity", "capacity", "name"),
    [  # W/m/K and J/m3/K of EN ISO 10456, table 3
        (0.13, 500 * 1600.0, "wood"),
        (1.15, 1800 * 1000.0, "concrete"),
        (1.7, 2200 * 1000.0, "limestone or marble"),
        (2.8, 2600 * 1000.0, "granite or gneiss"),
        (2.2, 917 * 2050.0, "ice"),
        (17.0, 7900 * 460.0, "stainless steel"),
        (50.0, 7800 * 450.0, "steel or lead"),
        (160.0, 2800 * 880.0, "aluminium or copper"),
    ],
)
def test_a_material_of_the_norm_is_among_those_of_its_diffusivity(conductivity, capacity, name):
    value = conductivity / capacity
    assert name in materials_like(0.97 * value, 1.03 * value)


@pytest.mark.parametrize(
    ("factor", "slip"),
    [
        (1 / 0.3048**2, "lengths in feet"),
        (1 / 0.0254**2, "lengths in inches"),
        (1e4, "lengths in cm"),
        (60.0, "times in minutes"),
        (3600.0, "times in hours"),
    ],
)
def test_the_slip_of_units_is_named_with_the_value_without_it(factor, slip):
    text = implausible(7e-7 * factor, prior=6e-7)
    assert slip in text and "7e-07" in text


@given(st.floats(1e-7, 3e-6), st.floats(1e-7, 3e-6))
def test_no_usual_value_is_doubted(value, prior):
    assert implausible(value, prior) == ""


@given(st.floats(1e-9, 2e-4))
def test_no_value_near_the_stated_prior_is_doubted(value):
    assert implausible(value, value) == ""


def test_what_is_no_interval_has_no_material():
    assert materials_like(np.nan, 1.0) == () and materials_like(0.0, 1.0) == () and implausible(np.nan, 1e-6) == ""
