"""Reduced models that contenders start from: learned in a process of their own, once for all who ask for the same."""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import wallid

MODELS = "WALLID_BENCHMARK_MODELS"  # the folder where they are kept, if there is one


def learned(case: wallid.Case, window: wallid.Window, order: int) -> wallid.StateSpace:
    """The model of this order for the case's sensors.

    In another process, so that nothing that learning compiles or allocates is a contender's gain.
    """
    folder = os.environ.get(MODELS)
    path = folder and Path(folder) / f"{case.name}-{len(case.sensors)}-{window.row}-{window.rows}-{order}.npz"
    if path and path.exists():
        return wallid.StateSpace.load(path)
    with ProcessPoolExecutor(1, get_context("spawn")) as process:
        system = process.submit(_learn, case, window, order).result()
    if path:
        system.save(path)
    return system


def _learn(case: wallid.Case, window: wallid.Window, order: int) -> wallid.StateSpace:
    import jax

    jax.config.update("jax_enable_x64", True)
    return wallid.learn(case, window, order).system
