"""Programs kept between processes: the same numbers, found only where the trace would be the same."""

import operator
import os
import subprocess
import sys
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wallid import _programs
from wallid._programs import compiled
from wallid.effects import UniformSource


class Pair(eqx.Module):
    """A result with an array, and with what is none."""

    values: jax.Array
    name: str = eqx.field(static=True)
    count: int


class OwnSource(UniformSource):
    """An effect of a user's own."""


@pytest.fixture
def folder(tmp_path):
    """A cache of the test's own."""
    before = jax.config.values["jax_compilation_cache_dir"]
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    yield tmp_path / "wallid"
    jax.config.update("jax_compilation_cache_dir", before)


@pytest.fixture
def traces():
    """A function that notes each of its traces, and what it noted."""
    seen = []

    def scaled(values, by=2.0, name="x"):
        seen.append(name)
        return Pair(jnp.cumsum(by * values), name, len(name))

    return scaled, seen


def kept(folder):
    return sorted(path.name for path in folder.glob("*")) if folder.exists() else []


def test_a_later_process_does_not_trace_again(folder, traces):
    function, seen = traces
    values = jnp.arange(5.0)
    results = [compiled(function)(values, name="long") for _ in range(3)]  # each a process as far as this knows
    assert seen == ["long"]
    assert len(kept(folder)) == 1
    for result in results:
        np.testing.assert_array_equal(result.values, [0.0, 2.0, 6.0, 12.0, 20.0])
        assert (result.name, result.count) == ("long", 4)


ESTIMATE = """
import jax

jax.config.update("jax_enable_x64", True)
import wallid
from wallid import _programs
from wallid.experiment import Window, large_model

traced, lower = [], _programs._Call.lower
_programs._Call.lower = lambda call: traced.append(call.function.__name__) or lower(call)
case = wallid.load("saint_julien")
fit = wallid.estimate(case, Window(0, 73), large_model(case))
print(fit.value, fit.std, *traced)
"""


def test_the_next_process_traces_nothing_and_estimates_the_same(folder):
    surroundings = os.environ | {"JAX_COMPILATION_CACHE_DIR": str(folder.parent)}

    def said():
        done = subprocess.run([sys.executable, "-c", ESTIMATE], capture_output=True, text=True, env=surroundings)
        assert done.returncode == 0, done.stderr
        return done.stdout.split()

    first, names = said(), kept(folder)
    assert {"_to_modes", "fit_experiment"} < set(first)
    assert said() == first[:2]
    assert kept(folder) == names


@pytest.mark.parametrize(
    "other",
    [
        lambda f: f(jnp.arange(6.0)),
        lambda f: f(jnp.arange(5)),
        lambda f: f(jnp.arange(5.0), by=3.0),
        lambda f: f(jnp.arange(5.0), by=True),
        lambda f: f(jnp.arange(5.0), by=jnp.asarray(1)),
        lambda f: f(jnp.arange(5.0), name="other"),
    ],
    ids=["shape", "dtype", "number", "type", "array", "word"],
)
def test_what_is_traced_otherwise_is_another_program(folder, traces, other):
    function, seen = traces
    call = compiled(function)
    call(jnp.arange(5.0), by=1)
    other(call)
    assert len(seen) == 2
    assert len(kept(folder)) == 2


def test_other_numbers_are_the_same_program(folder, traces):
    function, seen = traces
    call = compiled(function)
    for start in (0.0, 1.0):
        for values in (jnp.arange(5.0) + start, np.arange(5.0) + start):
            np.testing.assert_array_equal(call(values).values, np.cumsum(2.0 * values))
    assert len(seen) == 1


@pytest.mark.parametrize("what", ["_made_by", "XLA_FLAGS", "option"])
def test_another_source_or_option_is_another_program(folder, traces, monkeypatch, what):
    function, seen = traces
    compiled(function)(jnp.arange(5.0))
    if what == "_made_by":
        monkeypatch.setattr(_programs, "_made_by", lambda: ("another source",))
    elif what == "XLA_FLAGS":
        monkeypatch.setenv("XLA_FLAGS", "--another")
    else:
        with jax.numpy_rank_promotion("raise"):
            compiled(function)(jnp.arange(5.0))
    compiled(function)(jnp.arange(5.0))
    assert len(seen) == 2
    assert len(kept(folder)) == 2


def test_the_digest_is_of_every_source_file(tmp_path, monkeypatch):
    source, *versions = _programs._made_by()
    assert len(source) == 64
    assert jax.__version__ in versions
    (tmp_path / "room").mkdir()
    monkeypatch.setattr(_programs, "__file__", str(tmp_path / "_programs.py"))
    digests = set()
    for path, text in (("a.py", "1"), ("room/b.py", "1"), ("a.py", "2"), ("room/b.py", "2")):
        (tmp_path / path).write_text(text)
        digests.add(_programs._made_by.__wrapped__()[0])
    assert len(digests) == 4


def test_an_effect_of_ones_own_is_not_kept(folder):
    def count(effect, values):
        return values + len(effect.parameters)

    for effect, files in ((OwnSource(), 0), (UniformSource(), 1)):
        np.testing.assert_array_equal(compiled(count)(effect, jnp.zeros(2)), [1.0, 1.0])
        assert len(kept(folder)) == files


def test_a_function_as_an_argument_is_kept_where_its_code_is_known(folder):
    def called(function, values):
        return function(values)

    for _ in range(2):
        for function in (operator.neg, lambda x: -x):
            np.testing.assert_array_equal(compiled(called)(function, jnp.arange(3.0)), [0.0, -1.0, -2.0])
    assert len(kept(folder)) == 1


def test_a_call_back_to_python_is_not_kept(folder):
    def doubled(values):
        shape = jax.ShapeDtypeStruct(values.shape, values.dtype)
        return jax.pure_callback(lambda x: 2.0 * x, shape, values)

    for _ in range(2):
        np.testing.assert_array_equal(compiled(doubled)(jnp.arange(3.0)), [0.0, 2.0, 4.0])
    assert not kept(folder)


def test_within_other_transformations(folder, traces):
    function, _ = traces
    call = compiled(lambda values: function(values).values)
    values = jnp.arange(1.0, 4.0)
    np.testing.assert_array_equal(jax.jacfwd(call)(values), 2.0 * np.tril(np.ones((3, 3))))
    np.testing.assert_array_equal(jax.vmap(call)(jnp.eye(3)), 2.0 * np.triu(np.ones((3, 3))))
    np.testing.assert_array_equal(jax.jit(call)(values), np.cumsum(2.0 * values))
    assert not kept(folder)


def test_lapack_and_its_derivatives_are_kept(folder):
    def mixed(matrix):
        Q, _ = jnp.linalg.qr(matrix)
        whole = matrix.T @ matrix
        through = jax.jacfwd(lambda M: Q @ jnp.linalg.qr(M)[1])(matrix)
        return jnp.linalg.eigvalsh(whole), jnp.linalg.cholesky(whole), jnp.linalg.lstsq(matrix, Q[:, 0])[0], through

    matrix = jnp.asarray(np.random.default_rng(0).normal(size=(5, 3)))
    wanted = eqx.filter_jit(mixed)(matrix)
    for _ in range(2):
        for one, other in zip(compiled(mixed)(matrix), wanted, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-14)
    assert len(kept(folder)) == 1


@pytest.mark.parametrize("content", [b"", b"nothing of ours", b"\x80\x05K\x01."], ids=["empty", "text", "pickle"])
def test_a_file_that_is_none_of_ours_is_made_anew(folder, traces, content):
    function, seen = traces
    compiled(function)(jnp.arange(5.0))
    (path,) = folder.iterdir()
    path.write_bytes(content)
    for _ in range(2):
        np.testing.assert_array_equal(compiled(function)(jnp.arange(5.0)).values, [0.0, 2.0, 6.0, 12.0, 20.0])
    assert len(seen) == 2


def test_where_nothing_can_be_written_nothing_is_kept(folder, traces):
    function, seen = traces
    folder.write_text("a file where the folder would be")
    for _ in range(2):
        compiled(function)(jnp.arange(5.0))
    assert len(seen) == 2


def test_without_a_folder_nothing_is_kept(folder, traces):
    function, seen = traces
    jax.config.update("jax_compilation_cache_dir", None)
    compiled(function)(jnp.arange(5.0))
    assert len(seen) == 1
    assert not kept(folder)


def test_as_a_method_and_by_another_compiler(folder):
    class Line(eqx.Module):
        slope: jax.Array

        @partial(compiled, by=partial(jax.jit, static_argnames="squared"))
        def at(self, x, squared=False):
            return self.slope * (x**2 if squared else x)

    line = Line(jnp.asarray(3.0))
    assert float(line.at(jnp.asarray(2.0))) == 6.0
    assert float(line.at(jnp.asarray(2.0), squared=True)) == 12.0


def test_what_is_wrong_in_a_call_is_said(folder):
    with pytest.raises(TypeError, match="add got incompatible shapes"):
        compiled(lambda a, b: a + b)(jnp.ones(2), jnp.ones(3))
