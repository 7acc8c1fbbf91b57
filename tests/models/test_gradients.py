"""Derivatives in forward and reverse mode against central finite differences, by the propagator and by diffrax."""

import re
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from refusals import refuses

import wallid
from wallid.case.options import Choices
from wallid.case.scaling import Scales
from wallid.models.state_space import symmetric_modes

ROWS, STEP, NODES = 40, 3600.0, 16
LAYERS = {"thickness": [0.03, 0.25, 0.08], "conductivity": [0.8, 0.5, 0.2], "heat_capacity": [1.4e6, 1.2e6, 4e5]}
LENGTH = sum(LAYERS["thickness"])
POSITIONS = [0.02, 0.2]  # the first in the first layer, the second in the middle of the second

FORWARD, REVERSE, BOTH = diffrax.ForwardMode(), diffrax.RecursiveCheckpointAdjoint(), diffrax.DirectAdjoint()


@cache
def case_of(layered=True):
    rng = np.random.default_rng(3)
    time = STEP * np.arange(ROWS)
    readings = 12.0 + np.cumsum(rng.normal(0, 0.4, (ROWS, 4)), axis=0)
    record = wallid.Record(time, time, None, readings[:, :2], readings[:, 2:], ("T1", "T2"))
    sensors = tuple(
        wallid.Sensor(name, place, noise_std=0.05) for name, place in zip(record.names, POSITIONS, strict=True)
    )
    wall = wall_of({}) if layered else wallid.Wall(LENGTH, 5e-7)
    return wallid.Case(
        "case", Path("case.toml"), wall, sensors, record, Choices(nodes=NODES, model="lom", window_days=1.0)
    )


def wall_of(values):
    """The layered wall with other values of its layers; its length is the sum of their thicknesses."""
    columns = [values.get(name, stated) for name, stated in LAYERS.items()]
    layers = tuple(wallid.Layer(*(column[i] for column in columns)) for i in range(len(columns[0])))
    return wallid.Wall(sum(layer.thickness for layer in layers), layers=layers)


def outputs_of(values, *, layered=True, cells=None, **how):
    """The outputs at the sensors, with the named values in the place of the case's."""
    case = case_of(layered)
    wall = wall_of(values) if layered else replace(case.wall, length=values.get("length", case.wall.length))
    places = values.get("position", POSITIONS)
    sensors = tuple(replace(sensor, position=place) for sensor, place in zip(case.sensors, places, strict=True))
    case = replace(case, wall=wall, sensors=sensors)
    data = wallid.models.window_data(case)
    for name in ("inputs", "initial"):
        if name in values:
            data = eqx.tree_at(lambda data, name=name: getattr(data, name), data, values[name])
    fourier = Scales.of(wall).fourier_number(values.get("diffusivity", wall.diffusivity_prior))
    model = wallid.full_order_model(case, cells=cells)
    return wallid.sensitivity(model, fourier, data, **how)[0]


def loss(values, **how):
    """A number that depends on every output at every row."""
    u = outputs_of(values, **how)
    return jnp.sum(u * jnp.asarray(np.random.default_rng(0).normal(1.0, 0.5, u.shape)))


def stated(layered):
    """The values of the case: those of the wall, or those of its one layer and of the window."""
    if layered:
        values = LAYERS | {"position": POSITIONS}
    else:
        data = wallid.models.window_data(case_of(False))
        values = {"diffusivity": 4e-7, "length": LENGTH, "inputs": data.inputs, "initial": data.initial}
    return {name: jnp.asarray(value, float) for name, value in values.items()}


def directions(value):
    """Each number of a value by its largest, or one random direction where there are many."""
    value = np.asarray(value)
    size = np.abs(value).max()
    if value.size > 8:
        return size * np.random.default_rng(1).normal(size=(1, *value.shape))
    return size * np.eye(value.size).reshape(-1, *value.shape)


def by_central_differences(of, at):
    """The derivatives along the directions of each value, by name."""
    slopes, step = {}, 1e-5
    for name, value in at.items():
        ends = [[float(of(at | {name: value + sign * step * way})) for sign in (1, -1)] for way in directions(value)]
        slopes[name] = np.array([(high - low) / (2 * step) for high, low in ends])
    return slopes


@cache
def expected(layered):
    """By finite differences of the propagator; its values are diffrax's to 1e-12."""
    return by_central_differences(partial(loss, layered=layered), stated(layered))


def agree(derivatives, at, want):
    for name, value in at.items():
        got = np.array([np.sum(np.asarray(derivatives[name]) * way) for way in directions(value)])
        assert np.any(want[name] != 0.0)
        assert_allclose(got, want[name], rtol=1e-6, atol=1e-7 * np.abs(want[name]).max(), err_msg=name)


@pytest.mark.parametrize(
    ("derivative", "how"),
    [
        (jax.jacfwd, {}),
        (jax.grad, {}),
        (jax.jacfwd, {"integrator": "diffrax"}),
        (jax.grad, {"integrator": "diffrax", "adjoint": REVERSE}),
        (jax.grad, {"integrator": "diffrax", "adjoint": BOTH}),
    ],
)
@pytest.mark.parametrize("layered", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_every_quantity_against_finite_differences(layered, derivative, how):
    """Conductivities, heat capacities, thicknesses, positions; diffusivity, length, face temperatures, profile."""
    at = stated(layered)
    agree(derivative(partial(loss, layered=layered, **how))(at), at, expected(layered))


def test_compiled_and_vectorised():
    at, cells = stated(True), wallid.models.layer_cells(case_of().wall, NODES)
    of = partial(loss, cells=cells)
    agree(jax.jit(jax.grad(of))(at), at, expected(True))
    many = jax.tree.map(lambda value: jnp.stack([value, 1.01 * value]), at)
    agree(jax.tree.map(lambda rows: rows[0], jax.vmap(jax.grad(of))(many)), at, expected(True))


def test_the_traced_model_gives_what_the_model_of_known_values_gives():
    """In its nodes, against the modes; the cells are those of the known values."""
    at = stated(True)
    want = outputs_of({name: np.asarray(value).tolist() for name, value in at.items()})
    assert_allclose(jax.jvp(outputs_of, (at,), (at,))[0], want, atol=1e-11)
    assert wallid.full_order_model(case_of()).is_diagonal


def test_compiled_layers_need_their_cells():
    at = stated(True)
    with pytest.raises(ValueError, match=r"cells: the layers' values are traced.*layer_cells\(wall, 16\)"):
        jax.jit(loss)(at)
    for cells in ((5, 5), (5, 5, 6), (2, 8, 5)):
        with pytest.raises(ValueError, match="number of at least 3 for each of 3"):
            loss(at, cells=cells)
    assert np.isfinite(jax.jit(partial(loss, layered=False))(stated(False)))  # one layer needs none


@pytest.mark.parametrize(
    ("values", "part"),
    [
        ({"thickness": [0.03, -0.25, 0.08]}, "thickness = -0.25; it must be a finite number above 0"),
        ({"conductivity": [0.8, np.nan, 0.2]}, "conductivity = nan"),
        ({"position": [0.02, 0.6]}, "position = 0.6 m is not inside the wall"),
        ({"position": [0.02, 0.02]}, "position = 0.02 m is that of [[sensor]] 1"),
    ],
)
def test_known_values_are_checked_while_they_are_differentiated(values, part):
    at = {name: jnp.asarray(value) for name, value in values.items()}
    refuses(lambda: jax.grad(loss)(at), part)


def test_an_array_is_no_number_of_a_wall():
    refuses(lambda: jax.grad(lambda k: wallid.Layer(0.1, k, 1e6).conductivity.sum())(jnp.ones(2)), "conductivity = ")


def test_a_record_holds_measured_numbers():
    """The temperatures to differentiate by are inputs of the model."""
    refuses(lambda: jax.grad(lambda faces: replace(case_of().record, faces=faces).faces.sum())(jnp.ones((ROWS, 2))),
            "faces is traced by JAX", "window_data")  # fmt: skip


def test_films():
    outputs = [wallid.models.Output(0.0), wallid.models.Output(0.2, "flux")]
    inputs = jnp.asarray(np.random.default_rng(0).normal(size=(ROWS, 2)))

    def of(at):
        model = wallid.models.finite_volume_model(wall_of({}), outputs, nodes=NODES, film=tuple(at["film"]))
        return jnp.sum(wallid.models.propagate(model, 0.3, 0.04, inputs, jnp.zeros(3))[0] ** 2)

    at = {"film": jnp.asarray([0.05, 0.02])}
    want = by_central_differences(lambda at: of({"film": at["film"].tolist()}), at)
    agree(jax.jacfwd(of)(at), at, want)
    agree(jax.grad(of)(at), at, want)


def test_the_second_derivative():
    of = partial(loss, cells=wallid.models.layer_cells(case_of().wall, NODES))
    at = {name: stated(True)[name] for name in ("conductivity", "position")}
    along = {name: 0.1 * value for name, value in at.items()}

    def slope(at):
        return jax.jvp(of, (at,), (along,))[1]

    want = by_central_differences(jax.jit(slope), at)
    agree(jax.jit(jax.grad(slope))(at), at, want)


# ---------------------------------------------------------------------------- diffrax's adjoints


def steps_by_diffrax(fourier, adjoint):
    data = wallid.models.window_data(case_of(False))
    model = wallid.full_order_model(case_of(False))
    return jnp.sum(wallid.simulate(model, fourier, data.time, data.inputs, data.initial, adjoint=adjoint)[0] ** 2)


@pytest.mark.parametrize("compiled", [lambda of: of, jax.jit])
def test_the_error_names_the_adjoint_to_choose(compiled):
    with pytest.raises(RuntimeError, match=r"adjoint=diffrax.RecursiveCheckpointAdjoint\(\).*propagate"):
        compiled(jax.grad(lambda fo: steps_by_diffrax(fo, FORWARD)))(0.3)
    with pytest.raises(TypeError, match=r"adjoint=diffrax.ForwardMode\(\)`, for both.*DirectAdjoint\(\).*propagate"):
        compiled(jax.jacfwd(lambda fo: steps_by_diffrax(fo, REVERSE)))(0.3)


def test_the_propagator_takes_no_adjoint():
    with pytest.raises(ValueError, match="the propagator needs none"):
        loss(stated(False), layered=False, adjoint=REVERSE)


@pytest.mark.slow
def test_forward_over_reverse_by_diffrax():
    slope = jax.grad(lambda fo: steps_by_diffrax(fo, BOTH))
    want = float(slope(0.3 + 1e-5) - slope(0.3 - 1e-5)) / 2e-5
    assert_allclose(jax.jacfwd(slope)(0.3), want, rtol=1e-7)
    assert_allclose(jax.jacfwd(jax.grad(lambda fo: steps_by_diffrax(fo, REVERSE)))(0.3), want, rtol=1e-7)


# ---------------------------------------------------------------------------- modes


def test_modes_of_one_eigenvalue_have_a_derivative_without_nan():
    """`sum(f(S))` of a symmetric matrix whose eigenvalues are equal: JAX's own rule gives NaN."""

    def of(matrix):
        f, Q = symmetric_modes(matrix)
        return jnp.sum((Q * jnp.exp(f)) @ Q.T * jnp.arange(9.0).reshape(3, 3))

    change = jnp.diag(jnp.asarray([0.3, -0.2, 0.5]))  # keeps the vectors
    got = jax.jvp(of, (2.0 * jnp.eye(3),), (change,))[1]
    want = jnp.sum(jnp.exp(2.0) * change * jnp.arange(9.0).reshape(3, 3))
    assert_allclose(got, want, rtol=1e-12)
    apart = jnp.diag(jnp.asarray([1.0, 2.0, 4.0]))
    change = jnp.asarray([[0.1, 0.3, -0.2], [0.3, 0.5, 0.7], [-0.2, 0.7, 0.4]])
    for_both = [jax.jvp(one, (apart,), (change,))[1] for one in (symmetric_modes, lambda S: tuple(jnp.linalg.eigh(S)))]
    for mine, jaxs in zip(*for_both, strict=True):
        assert_allclose(mine, jaxs, atol=1e-13)


def test_a_symmetric_sandwich():
    """Plaster on both sides: pairs of modes, each in both plasters, with equal eigenvalues to round-off."""
    outputs = [wallid.models.Output(x) for x in (0.015, 0.2)]
    inputs = jnp.asarray(np.random.default_rng(0).normal(size=(ROWS, 2)))
    plaster, brick = (0.02, 0.7, 1.4e6), (0.36, 0.3, 1.1e6)

    def of(k, modal=False):
        layers = (wallid.Layer(plaster[0], k, plaster[2]), wallid.Layer(*brick), wallid.Layer(*plaster))
        wall = wallid.Wall(0.4, layers=layers)
        model = wallid.models.finite_volume_model(wall, outputs, nodes=101, cells=(30, 40, 30))
        fo = Scales.of(wall).fourier_number(wall.diffusivity_prior)
        return wallid.models.propagate(model.modal() if modal else model, fo, 0.04, inputs, jnp.zeros(3))[0]

    step = 1e-5 * plaster[1]
    want = (of(plaster[1] + step) - of(plaster[1] - step)) / (2 * step)
    for modal in (False, True):
        got = jax.jvp(partial(of, modal=modal), (plaster[1],), (1.0,))[1]
        assert_allclose(got, want, atol=1e-7 * np.abs(want).max())
    layers = tuple(wallid.Layer(*one) for one in (plaster, brick, plaster))
    model = wallid.models.finite_volume_model(wallid.Wall(0.4, layers=layers), outputs, nodes=101, cells=(30, 40, 30))
    f = np.sort(model.modal().A)
    assert np.min(np.diff(f)) < 1e-13 * np.abs(f).max()  # JAX's own rule divides by it


def test_the_examples_of_the_manual_run(capsys):
    page = (Path(__file__).parents[2] / "docs/how-to/derivatives.md").read_text("utf-8")
    for example in re.findall(r"```python\n(.*?)```", page, re.DOTALL)[:2]:
        exec(example, globals().copy())
    assert len(capsys.readouterr().out.splitlines()) == 2
