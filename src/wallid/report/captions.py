"""What each figure shows: a caption that says how to read it, and its text alternative with this run's numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from .._internal.number_formats import prose
from .._internal.units import DAY
from .figures import shaded

if TYPE_CHECKING:
    from ..discrepancy.findings import Diagnosis
    from ..estimation.many_windows import CampaignEstimate
    from ..estimation.prediction import Prediction
    from ..estimation.result_objects import Estimate
    from ..experiment_design.sensor_placement import SensorPlacement
    from ..experiment_design.window_selection import Design
    from ..workflow import Run

Words = Callable[["Run"], str]


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
        f"Temperatures over {record.duration / DAY:.3g} days: left face {low[0]:.1f} to {high[0]:.1f} degC, right "
        f"face {low[1]:.1f} to {high[1]:.1f} degC, {len(record.names)} inner sensors"
        + ("; below, when each has readings." if run.check is not None else _used(run))
    )


def _used(run: Run) -> str:
    return "." if shaded(run) is None else "; the window used is shaded."


def _record_caption(run: Run) -> str:
    if run.check is not None:
        return (
            "What was logged, and when each face and sensor has readings: orange where a face was interpolated, black "
            "marks where a reading was masked, grey where the record is broken."
        )
    window = "" if shaded(run) is None else " The yellow band is the window used."
    broken = " A grey band is a break of the record." if len(run.case.record.unbroken) > 1 else ""
    return f"What was logged.{window}{broken}"


def _design(run: Run, found: Design) -> str:
    best = found.best
    return (
        f"Sensitivity of each reading to the diffusivity, and the criterion over start days; best are {best.rows} "
        f"rows from {run.case.record.stamp(best.row)}."
    )


def _places(run: Run, found: SensorPlacement) -> str:
    return (
        f"Expected standard error with one more sensor at each of {len(found.places)} places, least at "
        f"{found.best:.3g} m from the left face, and at other sampling steps."
    )


def _campaign(run: Run, found: CampaignEstimate) -> str:
    through = "" if found.thermal is None else f" and {found.thermal.resistance.value:.3g} m2 K/W"
    return (
        f"Intervals of {len(found.windows)} windows, {len(found.used)} of them informative; all together "
        f"{found.value:.4g} m2/s{through}."
    )


def _campaign_caption(run: Run) -> str:
    through = "" if run.campaign is None or run.campaign.thermal is None else " On the right, of the resistance."
    return (
        "The 95 % interval of each window (blue: informative, larger dots weigh more; grey: not in the mean), and of "
        f"all of them together.{through}"
    )


def _estimate(run: Run, fit: Estimate) -> str:
    steps = f"The estimate goes to {fit.value:.4g} m2/s in {len(fit.history['diffusivity']) - 1} steps"
    if not fit.sensors:
        return f"{steps}, and its changes fall below the stopping criterion."
    gap = float(np.sqrt(np.nanmean(fit.residual[:, : fit.sensors] ** 2)))
    return f"{steps}; simulated and measured temperatures differ by {gap:.2g} K root mean square."


def _estimate_caption(run: Run) -> str:
    if not run.case.sensors:
        return "Convergence of the estimate."
    return (
        "Convergence of the estimate, and the temperatures measured against those simulated with it. Shaded: where 95 "
        "of 100 readings would lie by the sensors' stated noise and the diffusivity's standard error."
    )


def _orders(run: Run) -> str:
    errors = "; ".join(
        f"order {one.system.order}: {one.eps_inf[0]:.1e} (temperature), {one.eps_inf[1]:.1e} (sensitivity)"
        for one in run.orders
    )
    return f"Largest errors of reduced models over their learning signals, dimensionless, by order. {errors}."


def _loads(run: Run, found: Prediction) -> str:
    if (loads := found.loads) is None:
        return ""
    return (
        f"Heat flux through the inner face, {np.nanmin(loads.flux):.3g} to {np.nanmax(loads.flux):.3g} W/m2; its "
        f"energy moves by {loads.change[0]:+.1%} to {loads.change[-1]:+.1%} for {loads.factors[0] - 1:+.0%} to "
        f"{loads.factors[-1] - 1:+.0%} of the diffusivity."
    )


def _flux(run: Run, fit: Estimate) -> str:
    if (told := fit.thermal) is None:
        return ""
    left = fit.residual[:, fit.sensors :]
    return (
        f"Measured and simulated heat flux of {len(told.gains)} plate(s), {np.sqrt(np.nanmean(left**2)):.2g} W/m2 root "
        f"mean square apart; resistance {told.resistance.value:.3g} m2 K/W."
    )


def _reliability(run: Run, found: Prediction) -> str:
    sizes = [found.sizes(s) for s in range(len(found.names))]
    told = ", ".join(
        f"{name} {after:.2g} K ({before:.2g} K with the prior)"
        for name, (before, after, _) in zip(found.names, sizes, strict=True)
    )
    return (
        "The record's last week against the prediction, and the residuals' densities over the whole record, root mean "
        f"square: {told}."
    )


def _refused(found: Diagnosis) -> str:
    """What the later model is, where it may not stand."""
    return " The nearest known effect is shown although it was refused." if found.effects and found.incomplete else ""


def _missing(run: Run, found: Diagnosis) -> str:
    first = found.table[0] if found.table else None
    most = f"; {first.label} explains most by itself" if first else ""
    return (
        f"The gap goes from {found.gap.before:.2g} K to {found.gap.after:.2g} K, the noise floor is "
        f"{found.gap.floor:.2g} K{most}.{_refused(found)}"
    )


def _residuals(run: Run, found: Diagnosis) -> str:
    before, after = found.left_before.by_sensor, found.left_after.by_sensor
    if not found.after.active:
        sizes = ", ".join(f"{name} {size:.2g} K" for name, size in before.items())
        return f"Measured minus simulated by sensor over time and by hour of the day, root mean square: {sizes}."
    sizes = ", ".join(f"{name} {size:.2g} to {after[name]:.2g} K" for name, size in before.items())
    return (
        f"Measured minus simulated by sensor over time and by hour of the day, root mean square before and after: "
        f"{sizes}.{_refused(found)}"
    )


def _residuals_caption(run: Run) -> str:
    models = "models leave" if run.diagnosis is not None and run.diagnosis.after.active else "plain model leaves"
    return f"What the {models}, by sensor and time, and by sensor and hour of the day."


def _missing_caption(run: Run) -> str:
    shrinks = (
        "How far the gap between model and readings is from the noise floor"
        if run.diagnosis is None or not run.diagnosis.after.active
        else "How the gap between model and readings shrinks with each effect towards the noise floor"
    )
    refused = "" if run.diagnosis is None else _refused(run.diagnosis)
    return f"{shrinks}, and what each effect of the library would explain beside the plain model.{refused}"


def _windows_caption(run: Run) -> str:
    refused = "" if run.diagnosis is None else _refused(run.diagnosis)
    return f"The size of what was found, quarter by quarter of the record: a true effect is the same in each.{refused}"


def _about(part: str, tell: Callable[[Run, Any], str]) -> Words:
    """Told of a part of the run; nothing where the run did not get there."""
    return lambda run: "" if getattr(run, part) is None else tell(run, getattr(run, part))


def _said(text: str) -> Words:
    return lambda run: text


_CAPTIONS: dict[str, tuple[str | Words, Words]] = {
    "wall": ("The wall in section, to scale across, with the places of its sensors.", _wall),
    "record": (
        _record_caption,
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
        _campaign_caption,
        _about("campaign", _campaign),
    ),
    "orders": (
        "Error of the reduced model against its order.",
        _orders,
    ),
    "estimate": (
        _estimate_caption,
        _about("fit", _estimate),
    ),
    "reliability": (
        "Left: the record's last week, measured and predicted with prior and estimate. Right: the residuals' density "
        "over the whole record, of which the estimate saw only a window, and that of the measurement's own "
        "uncertainty.",
        _about("reliability", _reliability),
    ),
    "uncertainty": (
        "How uncertain single readings are: sensor noise, and what an error of position makes of the gradient; beside "
        "it the profile at the window's start.",
        _said("Combined measurement uncertainty of each sensor over the record, and the initial profile."),
    ),
    "flux": (
        "Heat flux at the faces: measured (dots) and simulated, what is left, and its density beside the stated "
        "noise's. Shaded: where 95 of 100 readings would lie by that noise, on the left with the conductivity's "
        "standard error too. The first readings are left out: they follow from the initial profile's short waves, "
        "which nothing tells.",
        _about("fit", _flux),
    ),
    "loads": (
        "Heat flux through the inner face, and how the energy that passes moves with the diffusivity.",
        _about("reliability", _loads),
    ),
    "missing": (
        _missing_caption,
        _about("explanation", _missing),
    ),
    "residuals": (
        _residuals_caption,
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
        "Which effects leave the same trace in this record: a pair near 1 cannot be told apart.",
        _said("Matrix of the likeness, 0 to 1, of the traces that the effects of the library leave in this record."),
    ),
    "windows": (
        _windows_caption,
        _said("Size of each effect found, with its uncertainty, in four quarters of the record."),
    ),
    "periodogram": (
        "Share of the residual's power below each frequency, beside what the noise model expects.",
        _said("Cumulative periodogram of the residual of each sensor with the band that noise alone would keep."),
    ),
}


def caption(stem: str, run: Run) -> str:
    """How to read the figure of a stem."""
    text = _CAPTIONS[stem][0]
    return text if isinstance(text, str) else text(run)


def alternative(stem: str, run: Run) -> str:
    """What the figure of a stem shows, in words."""
    return prose(_CAPTIONS[stem][1](run))
