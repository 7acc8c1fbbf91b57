"""The top level of the package: what `import wallid` gives, and what it does not do."""

import ast
import subprocess
import sys
from pathlib import Path

import wallid


def test_every_public_name_is_there_and_known_to_type_checkers():
    """The table of lazy names against `__all__` and against the imports that type checkers read."""
    tree = ast.parse(Path(wallid.__file__).read_text("utf-8"))
    typed = {
        (node.module, alias.name)
        for block in tree.body
        if isinstance(block, ast.If)
        for node in block.body
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    }
    assert typed == {(module, name) for name, module in wallid._HOMES.items()}
    assert {name for _, name in typed} | {"plot"} == set(wallid.__all__)
    for name in wallid.__all__:
        assert getattr(wallid, name) is not None and name in dir(wallid)


def test_the_import_is_light_and_changes_nothing_of_the_process():
    """A library leaves signals and threads alone; the command line must be able to come before JAX."""
    script = """
import signal, sys, threading
def state():
    handlers = [signal.getsignal(number) for number in signal.valid_signals()]
    return handlers, signal.pthread_sigmask(signal.SIG_BLOCK, []), threading.enumerate()
before = state()
import wallid.cli
assert not {"jax", "numpy", "pandas", "typer"} & set(sys.modules), "slow imports"
import wallid
wallid.load, wallid.diagnose, wallid.report
assert state() == before
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
