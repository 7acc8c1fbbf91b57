import ast
import filecmp
from pathlib import Path

import numpy as np
import pytest
from benchmarks.reference import make_examples
from benchmarks.reference.make_examples import EXAMPLES, numerical_errors, saint_julien, slab_response, write_examples

import wallid


def test_the_generator_gives_the_packaged_bytes_twice(tmp_path):
    for out in (tmp_path / "one", tmp_path / "two"):
        write_examples(out)
    for file in sorted(path.relative_to(tmp_path / "one") for path in (tmp_path / "one").rglob("*.*")):
        assert filecmp.cmp(tmp_path / "one" / file, tmp_path / "two" / file, shallow=False)
        assert filecmp.cmp(tmp_path / "one" / file, EXAMPLES / file, shallow=False), file


def test_the_generator_knows_nothing_of_the_package():
    for name in ("make_examples.py", "synthetic_twins.py"):
        tree = ast.parse((Path(make_examples.__file__).parent / name).read_text())
        imported = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        imported |= {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
        assert not [module for module in imported if str(module).startswith("wallid")]


@pytest.mark.parametrize("name", wallid.case.packaged())
def test_every_packaged_case_loads_and_says_that_it_is_synthetic(name):
    assert "ynthetic" in str(wallid.load(name))


def test_the_truths_own_errors():
    """The independent solver against finer meshes, the analytic slab and SciPy's BDF, K."""
    for name, error in numerical_errors(days=4.0).items():
        assert error < 1e-3, name


def test_the_analytic_slab_starts_at_rest_and_follows_its_face():
    x, t = np.array([0.0, 0.2, 0.5]), np.array([0.0, 3600.0, 40_000.0])
    T, slope = slab_response(x, t, length=0.5, diffusivity=5e-7, initial=20.0, harmonics=((1e-4, 0.0, 2.0),))
    np.testing.assert_allclose(T[0], 20.0, atol=1e-8)
    np.testing.assert_allclose(T[:, 0], 20.0 + 2 * np.sin(1e-4 * t), atol=1e-12)
    np.testing.assert_allclose(T[:, 2], 20.0, atol=1e-9)
    np.testing.assert_allclose(slope[:, [0, 2]], 0.0, atol=1e-3)


def test_seeds_give_other_weather_and_other_noise():
    one, two = saint_julien(1), saint_julien(2)
    assert np.std(one["T_right"] - two["T_right"]) > 1.0
    again = saint_julien(1, noise_seed=99)
    assert 0.1 < np.std(one["T2"] - again["T2"]) < 0.2
