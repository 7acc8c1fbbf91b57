"""The C recurrence as a function: compiled by gcc for one order and number of sensors."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from benchmarks.speed.measure import AbsentError
from wallid import StateSpace
from wallid.models.exponential_solver import step_map

FLAGS = ("-O3", "-march=native")  # what the issue names; -ffast-math gains nothing here


def compiled(system: StateSpace, step: float, inputs: np.ndarray, initial: np.ndarray) -> Callable[[np.ndarray], tuple]:
    """`run(fouriers)`: u and theta at each Fourier number, `(number, time, sensor)`, in memory that is there already.

    Raises:
        AbsentError: no gcc.
    """
    if shutil.which("gcc") is None:
        raise AbsentError("no gcc on this machine")
    order, sensors = system.order, system.C.shape[0]
    source = Path(__file__).with_suffix(".c")
    shape = (f"-DORDER={order}", f"-DSENSORS={sensors}")
    with tempfile.TemporaryDirectory() as folder:
        library = f"{folder}/recurrence.so"
        subprocess.run(["gcc", *FLAGS, *shape, "-shared", "-fPIC", "-o", library, str(source)], check=True)
        function = ctypes.CDLL(library).recurrence  # stays in memory when its file is gone
    q = np.ascontiguousarray(inputs)
    start = np.ascontiguousarray(system.P @ initial)
    held: dict[float, list[np.ndarray]] = {}  # or the arrays under the pointers would go
    kept: dict[float, list[ctypes.c_void_p]] = {}

    def arguments(fourier: float) -> list[ctypes.c_void_p]:
        if fourier not in kept:
            exact = step_map(system, jnp.asarray(fourier), jnp.asarray(step), sensitivity=True)
            parts = (exact.E, exact.W0, exact.W1, exact.E_theta, exact.V0, exact.V1, system.C, system.D)
            kept[fourier] = [
                _pointer(array) for array in held.setdefault(fourier, list(map(np.ascontiguousarray, parts)))
            ]
        return kept[fourier]

    @cache
    def room(count: int) -> np.ndarray:
        return np.zeros((2, count, len(q), sensors))

    def run(fouriers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        u, theta = room(len(fouriers))
        for k, fourier in enumerate(fouriers):
            fixed = arguments(float(fourier))
            function(ctypes.c_long(len(q)), _pointer(q), *fixed, _pointer(start), _pointer(u[k]), _pointer(theta[k]))
        return u, theta

    return run


def _pointer(array: np.ndarray) -> ctypes.c_void_p:
    return array.ctypes.data_as(ctypes.c_void_p)
