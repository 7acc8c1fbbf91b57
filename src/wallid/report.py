"""What a run leaves behind: `result.json` and its figures, written all or not at all."""

from __future__ import annotations

import json
import math
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .estimate import Estimate
from .experiment import scales
from .wall import InputError
from .workflow import Run

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCHEMA = 1
_FIGURES = ("record", "design", "orders", "estimate", "reliability", "uncertainty", "loads")
_WRITTEN = {"result.json", "model.npz", *(f"{stem}.png" for stem in _FIGURES)}
"""What a run may write: what an earlier one left of these and this one did not write is not its result."""


def result(run: Run) -> dict[str, Any]:
    """The contents of result.json. Every number is finite or null."""
    case, fit = run.case, run.fit
    window = run.design.best if fit is None and run.design is not None else fit.window if fit else None
    found: dict[str, Any] = {"schema": SCHEMA, "case": case.name}
    if window is not None:
        criterion = None
        if run.design is not None and window.row in run.design.starts:
            criterion = run.design.criterion[0][list(run.design.starts).index(window.row)]
        record = case.record
        found["window"] = {
            "start": record.stamp(window.row),
            "end": record.stamp(window.row + window.rows),
            "criterion": criterion,
        }
    diffusivity = None if fit is None else _quantity(fit)
    found |= {"diffusivity": diffusivity, "diffusivity_before": diffusivity}
    found["verdict"] = "uninformative" if run.unreliable else None
    found |= {"effects": [], "gap": None, "iterations": None, "reason": run.unreliable or None}
    if fit is not None:
        gap = float(np.sqrt(np.nanmean(fit.residual**2)))
        found["gap"] = {
            "before_K": gap,
            "after_K": gap,
            "floor_K": _floor(run, fit),
            "held_out_before_K": None,
            "held_out_after_K": None,
        }
        found["iterations"] = fit.iterations
        profile = fit.profile
        found["initial_profile"] = {"coefficients_degC": profile.coefficients, "eps_2_K": profile.eps_2}
        found["model_shift"] = fit.model_shift
        found["offsets"] = {
            name: {"value": value, "std": std, "unit": "K"} for name, (value, std) in fit.offsets.items()
        }
    if run.learned is not None:
        found["reduced_model"] = {
            "order": run.learned.system.order,
            "eps_inf_u": run.learned.eps_inf[0],
            "eps_inf_theta": run.learned.eps_inf[1],
            "reference_temperature_K": scales(case).temperature,
        }
    if run.reliability is not None:
        found["reliability"] = _reliability(run)
    found["seconds"] = run.seconds
    return _finite(found)


def _quantity(fit: Estimate) -> dict[str, Any]:
    return {"value": fit.value, "std": fit.std, "interval_95": list(fit.interval_95), "unit": "m2/s"}


def _floor(run: Run, fit: Estimate) -> float:
    """The root mean square that the stated noise alone would leave in the rows used."""
    noise = np.array([sensor.noise_std for sensor in run.case.sensors])
    present = np.isfinite(fit.residual)
    return float(np.sqrt(np.sum(present * noise**2) / present.sum()))


def _reliability(run: Run) -> dict[str, Any]:
    found = run.reliability
    assert found is not None
    per_sensor = {
        name: dict(zip(("rms_prior_K", "rms_K", "sigma_K"), found.sizes(s), strict=True))
        for s, name in enumerate(found.names)
    }
    loads = None
    if found.loads is not None:
        loads = {
            "conductivity": found.loads.conductivity,
            "diffusivity_factor": found.loads.factors,
            "energy_J_per_m2": found.loads.energy,
        }
    return {"sensors": per_sensor, "loads": loads}


def _finite(value: Any) -> Any:
    """Plain JSON: arrays as lists, NaN and infinities as null."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_finite(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def dumps(run: Run) -> str:
    """result.json as text."""
    return json.dumps(result(run), indent=2, allow_nan=False)


def figures(run: Run) -> Iterator[tuple[str, Figure]]:
    """Every figure that a run has the numbers for, with its file's stem."""
    from . import plot

    with plot.style():
        yield "record", _record_figure(run)
        if run.design is not None:
            yield "design", _design_figure(run)
        if run.orders:
            made, ax = plot.figure(height=3.2)
            plot.orders(ax, run.orders)
            yield "orders", made
        if run.fit is not None:
            yield "estimate", _estimate_figure(run)
        if run.reliability is not None:
            yield "reliability", _reliability_figure(run)
            yield "uncertainty", _uncertainty_figure(run)
        if run.reliability is not None and run.reliability.loads is not None:
            made, axes = plot.figure(1, 2, height=2.8)
            plot.flux(axes[0], run.reliability.days, run.reliability.loads)
            plot.loads(axes[1], run.reliability.loads)
            yield "loads", made


def _record_figure(run: Run) -> Figure:
    from . import plot

    made, ax = plot.figure(height=3.2)
    window = run.fit.window if run.fit else run.design.best if run.design else None
    plot.record(ax, run.case, window)
    return made


def _design_figure(run: Run) -> Figure:
    from . import plot
    from .estimate import theta_kelvin
    from .experiment import Window, large_model

    assert run.design is not None
    made, axes = plot.figure(2 if run.lengths is None else 3, height=2.4)
    whole = Window(0, run.case.record.rows)
    sensitivity = theta_kelvin(large_model(run.case), run.case, whole, run.design.diffusivities[0])
    plot.theta(axes[0], run.case, np.asarray(run.case.record.time) / 86400.0, sensitivity)
    plot.criterion(axes[1], run.design)
    if run.lengths is not None:
        plot.compromise(axes[2], run.lengths)
    return made


def _estimate_figure(run: Run) -> Figure:
    from . import plot

    assert run.fit is not None
    made, axes = plot.figure(2, 2, width=9.0, height=2.8)
    plot.convergence(axes[0, 0], axes[0, 1], run.fit)
    plot.measured_against_simulated(axes[1, 0], run.case, run.fit)
    plot.residual(axes[1, 1], run.case, run.fit)
    return made


def _reliability_figure(run: Run) -> Figure:
    from . import plot

    found = run.reliability
    assert found is not None
    made, axes = plot.figure(len(found.names), 2, width=9.0, height=2.4)
    for s, row in enumerate(np.atleast_2d(axes)):
        plot.last_week(row[0], found, s)
        plot.density(row[1], found, s)
    return made


def _uncertainty_figure(run: Run) -> Figure:
    from . import plot

    assert run.reliability is not None and run.fit is not None
    made, axes = plot.figure(1, 2, height=2.8)
    plot.uncertainty(axes[0], run.reliability)
    plot.initial_profile(axes[1], run.case, run.fit.window)
    return made


def write(run: Run, out: str | Path) -> list[Path]:
    """Write result.json, the figures and the reduced model into a folder: all of them, or none.

    Raises:
        InputError: the folder cannot be made or written.
    """
    out = Path(out)
    with _folder(out) as made:
        names = _fill(run, made)
        for name in names:
            os.replace(made / name, out / name)
    for stale in _WRITTEN - set(names):
        (out / stale).unlink(missing_ok=True)
    return [out / name for name in names]


def check_out(out: str | Path) -> None:
    """Refuse a folder that cannot be written before anything long begins, and leave no trace.

    Raises:
        InputError: the folder cannot be made or written.
    """
    out = Path(out)
    missing = [folder for folder in (out, *out.parents) if not folder.exists()]
    with _folder(out):
        pass
    for folder in missing:
        folder.rmdir()


@contextmanager
def _folder(out: Path) -> Iterator[Path]:
    """A folder for work in progress, inside `out`: each move out of it is one step of the file system."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=out, prefix=".wallid-") as made:
            yield Path(made)
    except OSError as error:
        raise InputError(f"--out {out}: cannot write there ({error.strerror or error})") from error


def _fill(run: Run, folder: Path) -> list[str]:
    names = []
    for stem, made in figures(run):
        names.append(f"{stem}.png")
        made.savefig(folder / names[-1])
    if run.learned is not None:
        names.append("model.npz")
        run.learned.system.save(folder / names[-1])
    names.append("result.json")
    (folder / names[-1]).write_text(dumps(run) + "\n", encoding="utf-8")
    return names
