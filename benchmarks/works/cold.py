"""What a person waits for: the import, the demo in a fresh process, and again with a warm compilation cache."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..measure import Prepared, timed
from .ratio import Asked, Results, seconds_of

TITLE = "cold start: import, `wallid demo` with its diagnosis in a fresh process, again with a warm cache"


def _once(program: str) -> Callable[[], float]:
    """Seconds of a fresh interpreter that runs a line."""
    return lambda: timed(lambda: subprocess.run([sys.executable, "-c", program], check=True))[0]


def _importing(program: str) -> Prepared:
    run = _once(program)
    run()  # the file system's cache

    def several() -> float:
        return float(np.median([run() for _ in range(5)]))

    return Prepared(several, lambda seconds: {"median of 5": seconds}, units=5, once=True)


def _demo(*, warm: bool) -> Prepared:
    folder = Path(tempfile.mkdtemp())
    surroundings = os.environ | ({"JAX_COMPILATION_CACHE_DIR": str(folder / "cache")} if warm else {})

    def run() -> None:
        command = [sys.executable, "-m", "wallid.cli", "demo", "--quiet", "--out", str(folder / "out")]
        subprocess.run(command, check=True, env=surroundings, stdout=subprocess.DEVNULL)

    if warm:
        run()
    return Prepared(run, lambda _: {}, once=True)


CONTENDERS = {
    "import jax": lambda: _importing("import jax, jax.numpy"),
    "import wallid": lambda: _importing("import wallid"),
    "wallid demo, fresh": lambda: _demo(warm=False),
    "wallid demo, warm cache": lambda: _demo(warm=True),
}


def asked(results: Results) -> list[Asked]:
    """What the issue asks."""
    jax, ours = (seconds_of(results, name) for name in ("import jax", "import wallid"))
    more = None if jax is None or ours is None else ours - jax
    fresh, warm = (seconds_of(results, f"wallid demo, {name}") for name in ("fresh", "warm cache"))
    return [
        Asked("import wallid, over the import of jax", more, 1.5, at_least=False, unit="s"),
        Asked("wallid demo with its diagnosis, fresh", fresh, 60, at_least=False, unit="s"),
        Asked("the same with a warm cache", warm, 20, at_least=False, unit="s"),
    ]
