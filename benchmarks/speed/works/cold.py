"""What a person waits for: the import, the demo in a fresh process, and again with a warm compilation cache."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile

from benchmarks.speed.measure import Prepared
from benchmarks.speed.works.ratio import Asked, Results, seconds_of

TITLE = "cold start: import, `wallid demo` with its diagnosis in a fresh process, again with a warm cache"


def _importing(program: str) -> Prepared:
    def run() -> None:
        subprocess.run([sys.executable, "-c", program], check=True)

    run()  # the file system's cache
    return Prepared(run, lambda _: {}, by_children=True)


def _demo(*, warm: bool) -> Prepared:
    folder = tempfile.TemporaryDirectory()
    surroundings = os.environ | ({"JAX_COMPILATION_CACHE_DIR": f"{folder.name}/cache"} if warm else {})

    def run() -> None:
        command = [sys.executable, "-m", "wallid", "demo", "--quiet", "--out", f"{folder.name}/out"]
        subprocess.run(command, check=True, env=surroundings)

    if warm:
        run()
    return Prepared(run, lambda _: {}, once=True, by_children=True)


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
        Asked("wallid demo with its diagnosis, fresh", fresh, 75, at_least=False, unit="s"),
        Asked("the same with a warm cache", warm, 35, at_least=False, unit="s"),
    ]
