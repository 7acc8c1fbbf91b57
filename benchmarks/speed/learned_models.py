"""Reduced models that contenders start from: learned in a process of their own, once for all who ask for the same."""

from __future__ import annotations

import os
import tempfile
from multiprocessing import get_context
from pathlib import Path

import wallid

MODELS = "WALLID_BENCHMARK_MODELS"  # the folder where they are kept, if there is one


def learned(case: wallid.Case, window: wallid.Window, order: int) -> wallid.StateSpace:
    """The model of this order for the case's sensors.

    From another process, so that nothing that learning compiles or allocates is a contender's gain.

    Raises:
        RuntimeError: that process failed.
    """
    with tempfile.TemporaryDirectory() as own:
        name = f"{case.name}-{len(case.sensors)}-{window.row}-{window.rows}-{order}.npz"
        path = Path(os.environ.get(MODELS, own), name)
        if not path.exists():
            process = get_context("spawn").Process(target=_learn, args=(case, window, order, path))
            process.start()
            process.join()
            if process.exitcode != 0:
                raise RuntimeError(f"learning order {order} of {case.name} ended with status {process.exitcode}")
        return wallid.StateSpace.load(path)


def _learn(case: wallid.Case, window: wallid.Window, order: int, path: Path) -> None:
    import jax

    jax.config.update("jax_enable_x64", True)
    wallid.learn(case, window, order).system.save(path)
