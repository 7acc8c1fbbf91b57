"""Named parameters: names and vectors, masks and bounds, and that neither compiles anything anew."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wallid.inference.parameters import Parameter, Parameters, kind_of, target_of

OFFSET, SHIFT = (
    Parameter("sensor_offset[T1]", "K", prior_std=0.1),
    Parameter("sensor_position[T1]", "m", prior_std=0.002),
)
ALPHA = Parameter("log_diffusivity", value=0.3)


def some():
    return Parameters.of([ALPHA, OFFSET, SHIFT])


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=20), st.randoms())
def test_what_goes_in_by_name_comes_out_by_name(values, random):
    names = [f"p[{k}]" for k in range(len(values))]
    parameters = Parameters.of(Parameter(name) for name in names)
    order = names.copy()
    random.shuffle(order)
    again = parameters.with_values({name: values[int(name[2:-1])] for name in order})
    assert again.to_dict() == dict(zip(names, values, strict=True))
    assert np.array_equal(again.vector(order), [again.to_dict()[name] for name in order])
    assert again.names == parameters.names


@given(st.text(min_size=1))
def test_a_target_may_have_any_name(column):
    """Loggers write names such as "T12 [°C]"."""
    for name, kind in ((f"sensor_offset[{column}]", "sensor_offset"), (f"effect.gain[{column}].size", "effect.gain")):
        assert (kind_of(name), target_of(name)) == (kind, column)


def test_a_parameter_is_estimated_unless_it_is_known_exactly():
    parameters = Parameters.of([ALPHA, OFFSET, Parameter("sensor_position[T2]", "m", prior_std=0.0)])
    assert parameters.estimated.tolist() == [True, True, False]
    assert parameters.estimating(["sensor_position[T2]"]).estimated.tolist() == [False, False, True]


def test_a_typical_size_is_the_priors_where_none_is_said():
    parameters = Parameters.of([ALPHA, OFFSET, Parameter("rate", scale=3.0)])
    assert parameters.scale.tolist() == [1.0, 0.1, 3.0]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ([OFFSET, OFFSET], "occurs twice"),
        ([Parameter("a", value=2.0, upper=1.0)], "outside"),
        ([Parameter("a", prior_std=-1.0)], "must be 0 or above"),
        ([Parameter("a", prior_std=float("nan"))], "must be 0 or above"),
    ],
)
def test_what_makes_no_sense_is_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        Parameters.of(wrong)


def test_an_unknown_name_is_refused_with_those_of_its_kind():
    with pytest.raises(KeyError, match=r"sensor_offset\[T9\]; there are sensor_offset\[T1\]"):
        some()["sensor_offset[T9]"]


def test_masks_values_priors_and_bounds_compile_nothing_anew():
    """One compilation serves every choice of what is estimated."""

    @eqx.filter_jit
    @eqx.debug.assert_max_traces(max_traces=1)
    def cost(parameters):
        free = jnp.where(parameters.estimated, parameters.values, 0.0)
        return jnp.sum((free / parameters.prior_std) ** 2) + parameters["sensor_offset[T1]"]

    start = some()
    for names in (["log_diffusivity"], ["sensor_offset[T1]", "sensor_position[T1]"], []):
        assert np.isfinite(cost(start.estimating(names)))
    assert np.isfinite(cost(start.with_values({"sensor_offset[T1]": 0.05})))
    wider = Parameters.of([ALPHA, Parameter("sensor_offset[T1]", "K", prior_std=0.5), SHIFT])
    assert np.isfinite(cost(wider))


def test_a_derivative_by_name_is_that_of_the_value():
    slope = jax.grad(lambda x: some().with_values({"sensor_offset[T1]": x})["sensor_offset[T1]"] ** 2)(3.0)
    assert slope == 6.0
