"""Parallel compilation of the functions that every diagnosis needs."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from threading import Lock

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
        problem.model.substeps,
        problem.model.forcing.plates,
        problem.parameters.names,
    )
    with _compiling:
        if shape in _compiled:
            return
        parameters, model, bins = problem.parameters, problem.model, problem.bins
        calls = (
            lambda: linearise(model, bins, parameters, (), linear=True),
            lambda: first_order_columns(model, bins, parameters, [(problem.library[0].names[0], {})]),
            lambda: face_impulse_response(model, parameters),
        )
        with ThreadPoolExecutor(min(len(calls), os.cpu_count() or 1)) as pool:
            for future in [pool.submit(call) for call in calls]:
                future.result()
        _compiled.add(shape)
