import math
import re
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from refusals import refuses

from wallid.case.scaling import Scales
from wallid.case.wall_and_sensors import Layer, Sensor, Wall

STONE, WOOL = Layer(0.3, 1.5, 2e6), Layer(0.1, 0.04, 6e4)
WALL = Wall(0.4, layers=(STONE, WOOL))

positive = st.floats(1e-3, 1e3)
layers = st.lists(
    st.builds(
        Layer,
        thickness=st.floats(0.01, 1.0),
        conductivity=st.floats(0.02, 3.0),
        heat_capacity=st.floats(3e4, 3e6),
    ),
    min_size=1,
    max_size=5,
).map(tuple)


@pytest.mark.parametrize("value", [0.0, -0.1, math.nan, math.inf, "0.3", True, None, np.ones(2), [0.3]])
@pytest.mark.parametrize("name", ["thickness", "conductivity", "heat_capacity"])
def test_layer_needs_positive_numbers(name, value):
    fields = {"thickness": 0.3, "conductivity": 1.5, "heat_capacity": 2e6, name: value}
    refuses(lambda: Layer(**fields), f"{name} = ", "it must be a finite number above 0")


def test_numbers_of_any_kind_become_plain_floats():
    wall = Wall(length=np.float32(0.5), diffusivity_prior=jnp.asarray(5e-7), conductivity=1)
    assert (type(wall.length), type(wall.diffusivity_prior), type(wall.conductivity)) == (float, float, float)
    assert wall == Wall(0.5, 5e-7, conductivity=1.0)


def test_prior_follows_from_what_is_given():
    assert Wall(0.4, conductivity=1.5, heat_capacity=2e6).diffusivity_prior == 1.5 / 2e6
    resistance, capacity = 0.3 / 1.5 + 0.1 / 0.04, 0.3 * 2e6 + 0.1 * 6e4
    assert WALL.diffusivity_prior == pytest.approx(0.4**2 / (resistance * capacity), rel=1e-14)
    assert Wall(0.4, 3e-7, 1.5, 2e6, layers=(STONE, WOOL)).diffusivity_prior == 3e-7


def test_prior_cannot_follow_from_too_little():
    refuses(lambda: Wall(0.4, conductivity=1.5), "diffusivity_prior is missing", "conductivity and heat_capacity")


@pytest.mark.parametrize("value", [0.28, 1.001e-3, 9.9e-10, -3e-7, 0.0, math.inf])
def test_prior_must_be_plausible(value):
    refuses(lambda: Wall(0.4, value), f"diffusivity_prior = {value!r}", "at least 1e-09 and at most 0.001 (m2/s)")


def test_implausible_prior_hints_at_units():
    refuses(lambda: Wall(0.4, 0.28), "mm2/s", "m2/h")
    refuses(lambda: Wall(0.4, conductivity=1.0, heat_capacity=840.0), "per volume", "density x specific heat")


def test_wall_refuses_what_cannot_be():
    refuses(lambda: Wall(-0.4, 3e-7), "length = -0.4; it must be a finite number above 0 (m)")
    refuses(lambda: Wall(0.4, 3e-7, conductivity=0.0), "conductivity = 0.0", "above 0 (W/m/K)")
    refuses(lambda: Wall(0.4, 3e-7, outside="north"), 'outside = "north"; it must be "left" or "right"')
    refuses(lambda: replace(WALL, length=0.41), "thicknesses sum to 0.4 m", "length = 0.41 m")


def test_faces_are_named_by_where_outside_is():
    assert (Wall(0.4, 3e-7).inside, Wall(0.4, 3e-7, outside="right").inside) == ("right", "left")


def test_homogeneous_wall_is_one_relative_layer():
    wall = Wall(0.4, 3e-7)
    assert (wall.relative_layers(), wall.interfaces, wall.effective_conductivity) == (
        ((0.4, 1.0, 1.0),),
        (),
        None,
    )


def test_stated_conductivity_goes_before_the_layers():
    assert replace(WALL, conductivity=0.2).effective_conductivity == 0.2
    assert WALL.effective_conductivity == pytest.approx(0.4 / (0.3 / 1.5 + 0.1 / 0.04))


@given(layers)
def test_relative_layers_have_effective_values_of_one(parts):
    length = sum(layer.thickness for layer in parts)
    wall = Wall(length, 5e-7, layers=parts)
    relative = wall.relative_layers()
    assert sum(d / k for d, k, _ in relative) == pytest.approx(length, rel=1e-12)
    assert sum(d * c for d, _, c in relative) == pytest.approx(length, rel=1e-12)
    assert len(wall.interfaces) == len(parts) - 1
    assert all(0 < place < length for place in wall.interfaces)


@given(layers, st.sampled_from([1e-3, 0.1, 10.0, 1e3]))
def test_relative_layers_do_not_depend_on_the_unit_of_conductivity(parts, factor):
    length = sum(layer.thickness for layer in parts)
    scaled = tuple(replace(layer, conductivity=factor * layer.conductivity) for layer in parts)
    one, other = (Wall(length, 5e-7, layers=group).relative_layers() for group in (parts, scaled))
    np.testing.assert_allclose(one, other, rtol=1e-12)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"name": " "}, "name = "),
        ({"name": 3}, "name = 3; it must be a text"),
        ({"position": math.nan}, "position = nan; it must be a finite number (m)"),
        ({"position": "5 cm"}, 'position = "5 cm"; it must be a finite number (m)'),
        ({"noise_std": 0.0}, "noise_std = 0.0; it must be a finite number above 0 (K)"),
        ({"position_std": -1.0}, "position_std = -1.0; it must be a finite number at least 0 (m)"),
        ({"offset_std": -1.0}, "offset_std = -1.0; it must be a finite number at least 0 (K)"),
    ],
)
def test_sensor_refuses_what_cannot_be(fields, message):
    refuses(lambda: Sensor(**{"name": "T1", "position": 0.05, "noise_std": 0.1} | fields), message)


def test_scales_refuse_what_cannot_be():
    refuses(lambda: Scales(0.5, 0.0, 20.0, 0.0), "time = 0.0; it must be a finite number above 0 (s)")
    refuses(lambda: Scales(0.5, 1.0, 20.0, math.nan), "temperature_min = nan")


def test_scales_of_a_wall():
    assert Scales.of(WALL) == Scales(length=0.4, time=86400.0, temperature=20.0, temperature_min=0.0)


scales = st.builds(Scales, positive, positive, positive, st.floats(-50, 50))


@given(scales, st.lists(st.floats(-100, 100), min_size=1), st.sampled_from([np.asarray, jnp.asarray]))
def test_scales_go_there_and_back(scale, values, array):
    values = array(values)
    there = scale.dimensionless(values)
    assert type(there) is type(values)
    roundoff = 4 * np.finfo(float).eps * (100 + abs(scale.temperature_min))
    np.testing.assert_allclose(scale.celsius(there), values, rtol=0, atol=roundoff)
    np.testing.assert_allclose(scale.diffusivity(scale.fourier_number(values)), values, rtol=1e-14, atol=1e-300)


@given(scales, positive, st.floats(1e-9, 1e-3))
def test_fourier_number_does_not_depend_on_the_unit_of_length(scale, factor, diffusivity):
    other = replace(scale, length=scale.length * factor)
    assert other.fourier_number(diffusivity * factor**2) == pytest.approx(scale.fourier_number(diffusivity), rel=1e-13)


@given(scales, positive, st.floats(1e-9, 1e-3))
def test_fourier_number_does_not_depend_on_the_unit_of_time(scale, factor, diffusivity):
    other = replace(scale, time=scale.time * factor)
    assert other.fourier_number(diffusivity / factor) == pytest.approx(scale.fourier_number(diffusivity), rel=1e-13)


@given(scales, st.floats(-100, 100))
def test_dimensionless_temperature_does_not_depend_on_the_unit_of_temperature(scale, value):
    fahrenheit = Scales(scale.length, scale.time, 1.8 * scale.temperature, 32 + 1.8 * scale.temperature_min)
    found, wanted = fahrenheit.dimensionless(32 + 1.8 * value), scale.dimensionless(value)
    assert found == pytest.approx(wanted, abs=1e-12 * (1 + 200 / scale.temperature))


def test_importing_the_rooms_does_not_import_pandas():
    import subprocess
    import sys

    code = "import sys, wallid.case.case_file; print('pandas' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert re.fullmatch(r"False\s*", done.stdout)
