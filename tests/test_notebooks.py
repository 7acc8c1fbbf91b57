"""The notebooks run, hold what they assert, and are kept without their outputs."""

import ast
import sys
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from tests.conftest import DATA

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))
MEASURED = "06_measured_data"
NOT_SLOW = "00_first_lesson"
OPTIMISED = {"05_missing_effect"}  # more running than compiling, as in the tests marked `runs_long`


def execute(path, folder):
    """A notebook after all its cells, in a kernel of its own, from an empty folder: it needs the package alone."""
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(folder)}}).execute()
    return notebook


def printed(notebook):
    return "".join(
        out.text for cell in notebook.cells for out in cell.get("outputs", ()) if out.output_type == "stream"
    )


def test_there_are_ten():
    assert [path.stem[:2] for path in NOTEBOOKS] == [f"0{k}" for k in range(10)]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_imports_nothing_from_beside_the_package(path):
    code = [cell.source for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
    tree = ast.parse("\n".join(line for source in code for line in source.splitlines() if not line.startswith("%")))
    modules = {
        alias.name.split(".")[0] for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names
    }
    modules |= {str(node.module).split(".")[0] for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    known = {"jax", "matplotlib", "numpy", "pandas", "pvlib", "scipy", "wallid"}  # dependencies of the package
    assert modules - known <= set(sys.stdlib_module_names) - {"sys", "subprocess"}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_is_a_lesson_without_outputs(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert not any(cell.outputs for cell in code), "strip the outputs before committing"
    assert all(cell.execution_count is None for cell in code)
    assert notebook.cells[0].cell_type == "markdown" and notebook.cells[0].source.startswith("# ")
    assert any("assert" in cell.source and "key number" in cell.source.lower() for cell in code)
    assert set(notebook.metadata) == {"kernelspec", "language_info"}


@pytest.mark.parametrize(
    "path",
    [pytest.param(path, marks=() if path.stem == NOT_SLOW else pytest.mark.slow) for path in NOTEBOOKS],
    ids=lambda path: path.stem,
)
def test_it_runs_and_its_key_numbers_hold(path, tmp_path, monkeypatch):
    monkeypatch.setenv("WALLID_DATA", str(DATA))
    if path.stem in OPTIMISED:
        monkeypatch.setenv("JAX_DISABLE_MOST_OPTIMIZATIONS", "false")
    notebook = execute(path, tmp_path)
    figures = [out for cell in notebook.cells for out in cell.get("outputs", ()) if "image/png" in out.get("data", {})]
    assert len(figures) >= 2 or (path.stem == MEASURED and "skipped" in printed(notebook))


@pytest.mark.parametrize("folders", [(), ("london_wall",)], ids=["nothing", "one folder, empty"])
def test_without_measured_records_it_says_so_and_does_nothing(monkeypatch, tmp_path, folders):
    for folder in folders:
        (tmp_path / folder).mkdir()
    if folders:
        monkeypatch.setenv("WALLID_DATA", str(tmp_path))
    else:
        monkeypatch.delenv("WALLID_DATA", raising=False)
    said = printed(execute(next(path for path in NOTEBOOKS if path.stem == MEASURED), tmp_path))
    assert said.count("skipped") == 2 and said.count("WALLID_DATA") == 2
    assert said.endswith("without borehole_248.csv and owall.csv: nothing was computed from them.\n")


def test_measured_records_have_a_source_and_a_licence():
    path = next(path for path in NOTEBOOKS if path.stem == MEASURED)
    text = nbformat.read(path, as_version=4).cells[0].source
    assert text.count("Source: ") == 2 and "Licence: CC BY 4.0" in text and "We do not know its licence" in text
