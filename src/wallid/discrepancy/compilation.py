"""Parallel compilation of the functions that every diagnosis needs."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from threading import Lock

import numpy as np

from .model_with_effects import face_impulse_response, first_order_columns, linearise
from .problem import DiagnosisProblem

_compiled: set[tuple[object, ...]] = set()
_compiling = Lock()


def compile_together(problem: DiagnosisProblem) -> None:
    """Compile the functions of a diagnosis in parallel threads; a user would wait longer for one after the other.

    Does nothing where a problem of the same shape has been compiled, and waits where this is under way.
    """
    shape = (
        problem.record.rows,
        problem.sensor_count,
        problem.model.substeps,
        tuple(type(effect_parameters.effect) for effect_parameters in problem.library),
    )
    with _compiling:
        if shape in _compiled:
            return
        theta, model, bins = problem.neutral, problem.model, problem.bins
        zeros = np.zeros((problem.max_estimated, problem.parameter_count))
        calls = (
            lambda: linearise(model, bins, theta, zeros, linear=True),
            lambda: first_order_columns(model, bins, theta, theta[None], zeros[:1]),
            lambda: face_impulse_response(model, theta),
        )
        with ThreadPoolExecutor(min(len(calls), os.cpu_count() or 1)) as pool:
            for future in [pool.submit(call) for call in calls]:
                future.result()
        _compiled.add(shape)
