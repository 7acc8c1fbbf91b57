"""Optimal experiment design: every start of a three-day window in 2670 hourly rows, theta from rest in each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

import wallid
from benchmarks.reference.integrators import by_lsim
from benchmarks.speed.measure import Prepared
from benchmarks.speed.works.ratio import Asked, Results, faster, seconds_of
from wallid.case.initial_profile import dimensionless_profile, fit_profile

TITLE = "OED: every start of a three-day window (73 rows) in 2670 hourly rows, 101 nodes (seconds of one window)"
ROWS, SCIPY = 73, 26


def _case(times: int = 1) -> wallid.Case:
    """The twin, its record so many times one after the other."""
    case = wallid.load("saint_julien")
    record = case.record
    regressors = {name: np.tile(column, times) for name, column in record.regressors.items()}
    longer = replace(
        record,
        faces=np.tile(record.faces, (times, 1)),
        sensors=np.tile(record.sensors, (times, 1)),
        regressors=regressors,
    )
    return replace(case, record=longer) if times > 1 else case


def _lsim_information(case: wallid.Case, starts: np.ndarray) -> np.ndarray:
    """The information on the diffusivity of windows, one after the other, (m2/s)^-2."""
    outputs = [wallid.models.Output(sensor.position) for sensor in case.sensors]
    nodal, scale = (
        wallid.models.finite_volume_model(case.wall, outputs, nodes=case.choices.nodes),
        wallid.case.scales(case),
    )
    time = np.arange(ROWS) * case.record.step / scale.time
    fourier, found = scale.fourier_number(case.wall.diffusivity_prior), []
    noise = np.array([sensor.noise_std for sensor in case.sensors])
    for start in starts:
        inputs = np.asarray(scale.dimensionless(case.record.faces[start : start + ROWS]))
        initial = dimensionless_profile(fit_profile(case, int(start)).coefficients, scale)
        theta = by_lsim(nodal, time, inputs, initial)(fourier)[1]
        slope = theta * scale.temperature * scale.fourier_number(1.0) / noise
        found.append(np.sum(slope[np.isfinite(case.record.sensors[start : start + ROWS])] ** 2))
    return np.array(found)


def _error(found: np.ndarray) -> dict[str, float]:
    """Largest relative difference from lsim's on some windows."""
    case = _case()
    some = np.linspace(0, case.record.rows - ROWS, 5).astype(int)
    want = _lsim_information(case, some)
    return {"information": float(np.abs(found[some] / want - 1).max())}


def _ours(times: int = 1, **options: Any) -> Prepared:
    case = _case(times)
    model = wallid.full_order_model(case)
    windows = case.record.rows - ROWS + 1

    def run() -> np.ndarray:
        return wallid.design(case, window_days=ROWS / 24, every_rows=1, model=model, **options).information[0]

    return Prepared(run, _error if times == 1 else lambda found: {}, units=windows)


def _scipy() -> Prepared:
    case = _case()
    starts = np.linspace(0, case.record.rows - ROWS, SCIPY).astype(int)
    return Prepared(lambda: _lsim_information(case, starts), lambda found: {}, units=SCIPY, once=True)


CONTENDERS: dict[str, Callable[[], Prepared]] = {
    "design, lax.map": _ours,
    "design, vmap": lambda: _ours(sweep="vmap"),
    f"loop of lsim ({SCIPY} windows)": _scipy,
    **{f"design, record {times} times": partial(_ours, times) for times in (2, 4, 8)},
}


def asked(results: Results) -> list[Asked]:
    """What the issue asks."""
    once, eight = (seconds_of(results, name) for name in ("design, lax.map", "design, record 8 times"))
    growth = None if once is None or eight is None else eight / once
    return [
        faster(results, "design, lax.map", f"loop of lsim ({SCIPY} windows)", 50),
        Asked("a window of a record of 8 times the length, time over one of the record", growth, 1.2, at_least=False),
    ]
