"""What each figure shows: a caption that says how to read it, and its text alternative with this run's numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from .campaign import Pooled
    from .design import Design
    from .discrepancy import Explanation
    from .estimated import Estimate
    from .places import Places
    from .reliability import Reliability
    from .workflow import Run

Alternative = Callable[["Run"], str]


def _wall(run: Run) -> str:
    wall = run.case.wall
    layers = f"{len(wall.layers)} layers" if wall.layers else "one material"
    sensors = ", ".join(f"{sensor.name} at {1e3 * sensor.position:.4g} mm" for sensor in run.case.sensors) or "none"
    return f"Section of the wall, {wall.length:g} m of {layers}, outside on the {wall.outside}; sensors: {sensors}."


def _record(run: Run) -> str:
    record = run.case.record
    faces = record.faces[~record.broken]
    low, high = faces.min(axis=0), faces.max(axis=0)
    return (
        f"Temperatures over {record.duration / 86400:.3g} days: left face {low[0]:.1f} to {high[0]:.1f} degC, right "
        f"face {low[1]:.1f} to {high[1]:.1f} degC, {len(record.names)} inner sensors"
        + ("; below, when each has readings." if run.check is not None else "; the window used is shaded.")
    )


def _design(run: Run, found: Design) -> str:
    best = found.best
    return (
        f"Sensitivity of each sensor to the diffusivity, and the criterion over start days; best are {best.rows} "
        f"rows from {run.case.record.stamp(best.row)}."
    )


def _places(run: Run, found: Places) -> str:
    return (
        f"Expected standard error with one more sensor at each of {len(found.places)} places, least at "
        f"{found.best:.3g} m from the left face, and at other sampling steps."
    )


def _campaign(run: Run, found: Pooled) -> str:
    return (
        f"Intervals of {len(found.windows)} windows, {len(found.used)} of them informative; all together "
        f"{found.value:.4g} m2/s."
    )


def _estimate(run: Run, fit: Estimate) -> str:
    gap = float(np.sqrt(np.nanmean(fit.residual[:, : fit.sensors] ** 2)))
    return (
        f"The estimate goes to {fit.value:.4g} m2/s in {fit.iterations} steps; simulated and measured "
        f"temperatures differ by {gap:.2g} K root mean square."
    )


def _flux(run: Run, fit: Estimate) -> str:
    if (told := fit.thermal) is None:
        return ""
    left = fit.residual[:, fit.sensors :]
    return (
        f"Measured and simulated heat flux of {len(told.gains)} plate(s), {np.sqrt(np.nanmean(left**2)):.2g} W/m2 root "
        f"mean square apart; resistance {told.resistance.value:.3g} m2 K/W."
    )


def _reliability(run: Run, found: Reliability) -> str:
    sizes = [found.sizes(s) for s in range(len(found.names))]
    told = ", ".join(
        f"{name} {after:.2g} K ({before:.2g} K with the prior)"
        for name, (before, after, _) in zip(found.names, sizes, strict=True)
    )
    return f"The record's last week against the prediction, and the residuals' densities: {told}."


def _missing(run: Run, found: Explanation) -> str:
    first = found.table[0] if found.table else None
    most = f"; {first.label} explains most by itself" if first else ""
    return (
        f"The gap goes from {found.gap.before:.2g} K to {found.gap.after:.2g} K, the noise floor is "
        f"{found.gap.floor:.2g} K{most}."
    )


def _residuals(run: Run, found: Explanation) -> str:
    sizes = ", ".join(
        f"{name} {before:.2g} to {after:.2g} K"
        for (name, before), after in zip(
            found.left_before.by_sensor.items(), found.left_after.by_sensor.values(), strict=True
        )
    )
    return f"Measured minus simulated by sensor over time and by hour of the day, before and after: {sizes}."


def _about(part: str, tell: Callable[[Run, Any], str]) -> Alternative:
    """Told of a part of the run; nothing where the run did not get there."""
    return lambda run: "" if getattr(run, part) is None else tell(run, getattr(run, part))


def _said(text: str) -> Alternative:
    return lambda run: text


CAPTIONS: dict[str, tuple[str, Alternative]] = {
    "wall": ("The wall in section, to scale across, with the places of its sensors.", _wall),
    "record": (
        "What was logged. A yellow band is the window that an estimate uses, a grey one a break of the record.",
        _record,
    ),
    "design": (
        "Which days tell most: how far each reading would move with the diffusivity, and what a window from each "
        "start day would tell, over the best.",
        _about("design", _design),
    ),
    "places": (
        "What one more sensor would do to the diffusivity's standard error, by its place (dotted: without it), and "
        "what a row more often or more rarely would.",
        _about("places", _places),
    ),
    "campaign": (
        "The 95 % interval of each window (blue: informative, larger dots weigh more; grey: not in the mean), and of "
        "all of them together.",
        _about("campaign", _campaign),
    ),
    "orders": (
        "Error of the reduced model against its order.",
        _said("Largest errors of reduced models fall with their order; the numbers are in result.json."),
    ),
    "estimate": (
        "Convergence of the estimate, and the temperatures measured against those simulated with it. Shaded: where 95 "
        "of 100 readings would lie by the sensors' stated noise and the diffusivity's standard error.",
        _about("fit", _estimate),
    ),
    "reliability": (
        "The whole record, of which the estimate saw only a window, against the prediction; beside it the residuals' "
        "density and that of the measurement's own uncertainty.",
        _about("reliability", _reliability),
    ),
    "uncertainty": (
        "How uncertain single readings are: sensor noise, and what an error of position makes of the gradient; beside "
        "it the profile at the window's start.",
        _said("Combined measurement uncertainty of each sensor over the record, and the initial profile."),
    ),
    "flux": (
        "Heat flux at the faces, measured (dots) and simulated. The first readings are left out: they follow from the "
        "initial profile's short waves, which nothing tells.",
        _about("fit", _flux),
    ),
    "loads": (
        "Heat flux through the inner face, and how the energy that passes moves with the diffusivity.",
        _said("Heat flux through the inner face, and its energy for several diffusivities; the numbers are below."),
    ),
    "missing": (
        "How the gap between model and readings shrinks with each effect towards the noise floor, and what each "
        "effect of the library would explain beside the plain model.",
        _about("explanation", _missing),
    ),
    "residuals": (
        "What the models leave, by sensor and time, and by sensor and hour of the day.",
        _about("explanation", _residuals),
    ),
    "remainder": (
        "What none of the known effects explains: the smooth part of the residual, orthogonal to all that the model "
        "could still adapt.",
        _said("Smooth part of what is left, by sensor over the record's days, with the mean residual of each day."),
    ),
    "fit": (
        "The week in which the plain model fails most.",
        _said("Measured and simulated temperatures in the plain model's worst week, and their differences."),
    ),
    "confusable": (
        "Which effects leave the same trace in this record: dark cells are pairs that it cannot tell apart.",
        _said("Matrix of the likeness, 0 to 1, of the traces that the effects of the library leave in this record."),
    ),
    "windows": (
        "The size of what was found, quarter by quarter of the record: a true effect is the same in each.",
        _said("Size of each effect found, with its uncertainty, in four quarters of the record."),
    ),
    "periodogram": (
        "Share of the residual's power below each frequency, beside what the noise model expects.",
        _said("Cumulative periodogram of the residual of each sensor with the band that noise alone would keep."),
    ),
}
"""By the stem of each figure's file."""
