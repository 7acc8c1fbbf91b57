"""Derivatives that are shortened for speed, against the plain ones."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from studies import SPEC, prepare, slot_of

from wallid.discrepancy.forward import instrument_readings, linear_wall
from wallid.discrepancy.forward.phi_derivatives import phi_functions_by_identity
from wallid.discrepancy.forward.unchanged_arguments import without_idle_derivatives
from wallid.discrepancy.least_squares import LeastSquares
from wallid.discrepancy.model_with_effects import linearise
from wallid.discrepancy.problem import diagnosis_problem
from wallid.models.exponential_solver import phi_functions

HIGHEST = 4


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    spec = replace(SPEC, step=3600.0, days=3.0 + 1.0 / 24.0, noise_std=0.05, boundary_noise_std=0.03)
    return prepare(tmp_path_factory.mktemp("short"), spec)[0]


def test_the_identity_gives_the_phi_functions_and_their_derivatives():
    z = jnp.asarray(-np.concatenate([[0.0], np.geomspace(1e-8, 1e4, 121)]))

    def by_logarithm(functions):
        """The values, and the derivatives by ln |z|."""
        return jax.jvp(lambda z: jnp.stack(functions(z, HIGHEST)), (z,), (z,))

    value, slope = by_logarithm(phi_functions_by_identity)
    plain_value, plain_slope = by_logarithm(phi_functions)
    assert_allclose(value, plain_value, rtol=1e-14)
    # the recurrence takes two differences per order, each of them with a rounding
    rounding = 2 * HIGHEST * np.finfo(float).eps * (1.0 + np.abs(z))
    assert np.all(np.abs(slope - plain_slope) <= rounding * plain_value)


def test_a_derivative_along_a_zero_direction_is_zero_and_along_others_that_of_the_function():
    def function(parts, factor):
        return parts["a"] * factor, jnp.sin(parts["b"])

    quick = without_idle_derivatives(function)
    primals = {"a": jnp.arange(3.0), "b": jnp.ones(2)}, jnp.asarray(2.0)
    for size in (0.0, 1.0):
        tangents = jax.tree.map(lambda leaf, size=size: size * jnp.cos(leaf + 1.0), primals)
        for derivative in (jax.jvp, jax.jit(jax.jvp, static_argnums=0)):
            got, plain = derivative(quick, primals, tangents), derivative(function, primals, tangents)
            assert jax.tree.all(jax.tree.map(lambda a, b: np.array_equal(a, b), got, plain))


def test_the_derivatives_of_a_wall_are_those_of_its_plain_functions(study, monkeypatch):
    parameters = study.parameters.with_values(
        {slot_of(study, "sensor_lag", "T1").names[0]: 900.0, slot_of(study, "face_depth", "left").names[0]: 0.004}
    )
    names = [name for name in parameters.names if not name.startswith("effect.")]
    names += [name for kind in ("sensor_lag", "face_depth", "solar_gain") for name in parameters.names if kind in name]
    got = [linearise(study.model, study.bins, parameters, some, linear=True) for some in (names[:20], names[20:])]
    for module in (linear_wall, instrument_readings):
        monkeypatch.setattr(module, "phi_functions_by_identity", phi_functions)
    for name in ("modal_decomposition", "_driven", "_modes_and_rates"):
        monkeypatch.setattr(linear_wall, name, getattr(linear_wall, name).fun)
    directions = np.eye(len(parameters))[parameters.indices(names)]

    @eqx.filter_jit
    def plain(model, parameters, directions):
        def readings(values):
            return model.predict(parameters.with_values(values), linear=True)

        return jax.vmap(lambda one: jax.jvp(readings, (parameters.values,), (one,)), out_axes=(None, 0))(directions)

    value, slopes = plain(study.model, parameters, jnp.asarray(directions))
    means = np.stack([study.bins.mean(slope) for slope in slopes])
    assert_allclose(got[0][0], value, rtol=1e-12)
    scale = np.abs(means).max(axis=1, keepdims=True)
    assert np.all(scale > 0)
    assert_allclose(np.concatenate([slope for _, slope in got]) / scale, means / scale, rtol=0, atol=1e-10)


def test_a_trial_with_a_lower_cost_is_linearised_and_no_other(study):
    noise = study.noise_shape(study.parameters).stated_covariance()
    least_squares = LeastSquares(study, (), study.parameters, noise.whitening)
    x = study.parameters.flatten()
    here = least_squares.at(x)
    cost = here.residual @ here.residual
    assert least_squares.better(x, cost) is None
    again = least_squares.better(x, 1.001 * cost)
    for got, right in zip(again, here, strict=True):
        assert_array_equal(got, right)
    assert least_squares.better(np.full_like(x, np.nan), np.inf) is None


def test_a_record_and_the_same_with_the_columns_that_were_not_logged_share_one_compilation(study):
    def compiled_for(problem):
        arguments = problem.model, problem.bins, problem.parameters
        return jax.tree.structure(arguments), [leaf.shape for leaf in jax.tree.leaves(arguments)]

    record = study.case.record
    few = {key: values for key, values in record.regressors.items() if key == "heating"}
    fewer = diagnosis_problem(replace(study.case, record=replace(record, regressors=few)))
    assert compiled_for(fewer) == compiled_for(study)
    kinds, fewer_kinds = ({slot.effect.name for slot in problem.library} for problem in (study, fewer))
    assert kinds - fewer_kinds == {"solar_gain", "lateral_loss"}
