"""The demo goes through the solvers it names. The last file, as it clears what others have compiled."""

import importlib

import jax
import pytest
from typer.testing import CliRunner

from wallid import workflow
from wallid.cli import app


@pytest.mark.parametrize("module, name", [("optimistix", "least_squares"), ("diffrax", "diffeqsolve")])
def test_demo_goes_through_optimistix_and_diffrax(monkeypatch, tmp_path, module, name):
    """Taken away, the demo cannot end well: both are on its path."""

    def gone(*args, **kwargs):
        raise ZeroDivisionError(f"{module}.{name} was called")

    monkeypatch.setattr(importlib.import_module(module), name, gone)
    monkeypatch.setattr(workflow, "_compile_beside", lambda case: None)  # the stage that it serves is not reached
    # traces that earlier tests compiled would hide the call
    jax.clear_caches()
    ended = CliRunner().invoke(app, ["demo", "--quiet", "--out", str(tmp_path / "out")])
    assert isinstance(ended.exception, ZeroDivisionError), ended.output
