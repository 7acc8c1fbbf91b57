"""Caption and alternative text of each figure; the alternative text gives the numbers of the run."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from .._internal.number_formats import format_text
from .record_captions import record_caption, record_text, wall_caption, wall_text

if TYPE_CHECKING:
    from ..discrepancy.result.diagnosis_result import Diagnosis
    from ..estimation.many_windows import CampaignEstimate
    from ..estimation.prediction import Prediction
    from ..estimation.result_objects import Estimate
    from ..experiment_design.sensor_placement import SensorPlacement
    from ..experiment_design.window_selection import Design
    from ..workflow import Run

Text = Callable[["Run"], str]


def _design(run: Run, design: Design) -> str:
    best = design.best
    return (
        "Sensitivity of each reading to the diffusivity, and the design criterion against the start of the window; "
        f"the best window has {best.rows} rows from {run.case.record.stamp(best.row)}."
    )


def _sensor_placement(run: Run, placement: SensorPlacement) -> str:
    return (
        f"Expected standard error of the diffusivity with a further sensor at each of {len(placement.candidates)} "
        f"positions, smallest at {placement.best:.3g} m from the left face, and at other sampling steps."
    )


def _campaign(run: Run, campaign: CampaignEstimate) -> str:
    resistance = "" if campaign.thermal is None else f" and {campaign.thermal.resistance.value:.3g} m2 K/W"
    return (
        f"Intervals of {len(campaign.windows)} windows, {len(campaign.used)} of them informative; all windows together "
        f"give {campaign.value:.4g} m2/s{resistance}."
    )


def _campaign_caption(run: Run) -> str:
    resistance = "" if run.campaign is None or run.campaign.thermal is None else " Right: thermal resistance."
    return (
        "The 95 % interval of the diffusivity from each window, and from all windows together (orange). Blue: "
        "informative windows, with dots the larger, the larger their weight in the mean. Grey: windows not in the "
        f"mean.{resistance}"
    )


def _estimate(run: Run, fit: Estimate) -> str:
    steps = f"The estimate converges to {fit.value:.4g} m2/s in {len(fit.history['diffusivity']) - 1} steps"
    if not fit.sensor_count:
        return f"{steps}."
    rms = float(np.sqrt(np.nanmean(fit.residual[:, : fit.sensor_count] ** 2)))
    return f"{steps}; the residual of the temperatures has a root mean square of {rms:.2g} K."


def _estimate_caption(run: Run) -> str:
    if not run.case.sensors:
        return "Convergence of the estimate, and the relative changes of cost and diffusivity that stop the iteration."
    return (
        "Top: measured and simulated temperatures in the window (the few days that were used), and the residual. "
        "Shaded: 95 % interval of a reading, from the stated sensor noise and the standard error of the diffusivity. "
        "Bottom: convergence of the diffusivity, and the relative changes of cost and diffusivity that stop the "
        "iteration; the dotted line is the start of the generalised least-squares (GLS) fit."
    )


def _orders(run: Run) -> str:
    errors = "; ".join(
        f"order {model.system.order}: {model.eps_inf[0]:.1e} (temperature), {model.eps_inf[1]:.1e} (sensitivity)"
        for model in run.orders
    )
    return f"Largest dimensionless errors of reduced-order models over the training signals. {errors}."


def _loads(run: Run, prediction: Prediction) -> str:
    if (loads := prediction.loads) is None:
        return ""
    return (
        f"Heat flux through the inner face, {np.nanmin(loads.flux):.3g} to {np.nanmax(loads.flux):.3g} W/m2; the "
        f"heat load changes by {loads.relative_change[0]:+.1%} to {loads.relative_change[-1]:+.1%} for "
        f"{loads.factors[0] - 1:+.0%} to {loads.factors[-1] - 1:+.0%} change of the diffusivity."
    )


def _flux(run: Run, fit: Estimate) -> str:
    if (thermal := fit.thermal) is None:
        return ""
    residual = fit.residual[:, fit.sensor_count :]
    return (
        f"Measured and simulated heat flux of {len(thermal.plate_gains)} plate(s), root mean square of the residual "
        f"{np.sqrt(np.nanmean(residual**2)):.2g} W/m2; resistance {thermal.resistance.value:.3g} m2 K/W."
    )


def _average(run: Run, fit: Estimate) -> str:
    if (thermal := fit.thermal) is None:
        return ""
    texts = []
    for one in thermal.average_methods:
        if one.resistance is None:
            texts.append(f"{one.face.capitalize()} plate: no mean flux")
            continue
        state = "all rules met" if one.complete else f"not met: {'; '.join(one.unmet_rules)}"
        texts.append(
            f"{one.face.capitalize()} plate: {one.resistance:.3f} m2 K/W over {one.averaged_days:.3g} days, {state}"
        )
    return (
        f"Resistance by the average method against the days averaged over, with the stopping rules of ISO 9869-1. "
        f"{'. '.join(texts)}. The estimate gives {thermal.resistance.value:.3f} m2 K/W."
    )


def _prediction(run: Run, prediction: Prediction) -> str:
    rms = [prediction.rms_of_sensor(s) for s in range(len(prediction.sensor_names))]
    residuals = ", ".join(
        f"{name} {after:.2g} K ({before:.2g} K with the prior)"
        for name, (before, after, _) in zip(prediction.sensor_names, rms, strict=True)
    )
    return (
        "Measured and predicted temperatures in the last week of the record, and densities of the residual over the "
        f"entire record. Root mean square of the residual: {residuals}."
    )


def _refused(diagnosis: Diagnosis | None) -> str:
    """Note on the effects of the model where the search refused them."""
    refused = diagnosis is not None and diagnosis.effects and diagnosis.incomplete
    return " The nearest known effect is shown although the search refused it." if refused else ""


def _missing(run: Run, diagnosis: Diagnosis) -> str:
    gap, unit, first = diagnosis.gap, diagnosis.gap.unit, diagnosis.table[0] if diagnosis.table else None
    largest = f"; {first.label} alone has the largest expected gain" if first else ""
    return (
        f"Root mean square of the residual: {gap.before:.2g} {unit} with the plain model, "
        f"{gap.after:.2g} {unit} with the final model, {gap.noise_floor:.2g} {unit} expected from noise "
        f"alone{largest}.{_refused(diagnosis)}"
    )


def _residuals(run: Run, diagnosis: Diagnosis) -> str:
    before, after = (diagnosis.shown_models[end].tests.by_instrument for end in (0, -1))
    units = dict(zip(before, diagnosis.problem.units, strict=True))
    if len(diagnosis.shown_models) == 1:
        sizes = ", ".join(f"{name} {size:.2g} {units[name]}" for name, size in before.items())
        return f"Residual by instrument over time and by hour of the day, root mean square: {sizes}."
    sizes = ", ".join(f"{name} {size:.2g} to {after[name]:.2g} {units[name]}" for name, size in before.items())
    return (
        f"Residual by instrument over time and by hour of the day, root mean square before and after: "
        f"{sizes}.{_refused(diagnosis)}"
    )


def _residuals_caption(run: Run) -> str:
    both = run.diagnosis is not None and len(run.diagnosis.shown_models) > 1
    models = "of both models" if both else "of the plain model"
    return (
        f"Residual (measured minus simulated) {models}. Top: by instrument and time; grey cells have no reading. "
        "Bottom: mean by hour of the day."
    )


def _missing_caption(run: Run) -> str:
    model, effects = "plain model", ""
    if run.diagnosis is not None:
        model = run.diagnosis.shown_models[0].label
        effects = ", and its decrease with each effect" if len(run.diagnosis.shown_models) > 1 else ""
    if run.diagnosis is not None and run.diagnosis.verdict == "adequate":
        return (
            "Root mean square of the residual of the plain model; the dashed line is the value expected from noise "
            "alone, the diamond the value on days that the fit did not use."
        )
    return (
        f"Top: root mean square of the residual of the {model}{effects}; the dashed line is the value expected "
        "from noise alone, diamonds are values on days that the fit did not use. Bottom: gain (decrease of −2 "
        "log L) of each effect added alone to the plain model; effects left of the dashed line are not significant."
        f"{_refused(run.diagnosis)}"
    )


def _heat_text(run: Run) -> str:
    heat = None if run.diagnosis is None else run.diagnosis.unknown_heat
    return "" if heat is None else heat.sentence


def _next_text(run: Run) -> str:
    return "" if run.diagnosis is None else " ".join(one.sentence for one in run.diagnosis.prescriptions)


def _next_caption(run: Run) -> str:
    asked = () if run.diagnosis is None else run.diagnosis.prescriptions
    text = (
        "Probability that the next diagnosis names the right effect and has no alternative to it (for a record that "
        "does not determine the diffusivity: that the next one does)"
    )
    if any(one.curve for one in asked):
        text += ". Left: with one more temperature sensor, by its place. Right: with each proposed action"
    elif not all(one.column for one in asked):
        text += ", with each proposed action"
    if any(one.column and one.actions for one in asked):
        text += ". For a column that was not logged: if an effect of typical size is there, and the column is logged"
    return f"{text}. It is averaged over which of the effects is the true one, over its size, and over the noise."


def _windows_caption(run: Run) -> str:
    return (
        "Size of each effect of the model, estimated from each quarter of the record: an effect that exists has the "
        f"same size in all quarters.{_refused(run.diagnosis)}"
    )


def _for_stage(attribute: str, describe: Callable[[Run, Any], str]) -> Text:
    """A text on the result of a stage; empty where the run has none."""
    return lambda run: "" if getattr(run, attribute) is None else describe(run, getattr(run, attribute))


def _fixed(text: str) -> Text:
    return lambda run: text


def _design_caption(run: Run) -> str:
    text = (
        "Sensitivity of the readings to the diffusivity, ∂T/∂(ln α), and the design criterion for a window from each "
        "start day: a scalar measure of the Fisher information, divided by its value for the best window."
    )
    if run.lengths is None:
        return text
    return f"{text} Bottom: the criterion by window length, divided by its value for the longest window."


_CAPTIONS: dict[str, tuple[str | Text, Text]] = {
    "wall": (wall_caption, wall_text),
    "record": (record_caption, record_text),
    "design": (
        _design_caption,
        _for_stage("design", _design),
    ),
    "places": (
        "Left: expected standard error of the diffusivity with a further sensor, by its position (dotted: without it). "
        "Right: expected standard error with other sampling steps.",
        _for_stage("sensor_placement", _sensor_placement),
    ),
    "campaign": (_campaign_caption, _for_stage("campaign", _campaign)),
    "orders": (
        "Error of the reduced-order model over its training signals, for temperature and sensitivity, against its "
        "order.",
        _orders,
    ),
    "estimate": (_estimate_caption, _for_stage("fit", _estimate)),
    "reliability": (
        "Left: last week of the record, measured, and predicted with the prior and the estimated diffusivity. Right: "
        "density of the residual over the entire record, of which the estimate used one window, and density of the "
        "measurement uncertainty.",
        _for_stage("prediction", _prediction),
    ),
    "uncertainty": (
        "Left: standard uncertainty of the readings, from sensor noise and position error; the position error acts "
        "through the temperature gradient. Right: temperature profile at the start of the window.",
        _fixed("Standard uncertainty of the readings of each sensor over the record, and the initial profile."),
    ),
    "flux": (
        "Heat flux at the faces: measured (dots) and simulated (line), residual, and density of the residual and of "
        "the stated noise. Shaded: 95 % interval of a reading from that noise; on the left also from the standard "
        "error of the conductivity. The first readings are left out: they depend on details of the initial profile "
        "that no reading determines.",
        _for_stage("fit", _flux),
    ),
    "average": (
        "The average method of ISO 9869-1: temperature difference over heat flux, both averaged from the start of the "
        "window to each time. The result (dot) is that of the largest whole number of days. The standard lets a "
        "measurement end where it has three days (dotted), R of a day before (diamond) lies in the band of 5 % "
        "about the result, and R of the first and of the last two thirds (dashed) differ by 5 % at most. Light blue: "
        "resistance of the estimate, 95 %; it also uses the heat that the wall stores.",
        _for_stage("fit", _average),
    ),
    "loads": (
        "Heat flux through the inner face over the entire record, and change of its sum, the heat load, with the "
        "diffusivity.",
        _for_stage("prediction", _loads),
    ),
    "missing": (_missing_caption, _for_stage("diagnosis", _missing)),
    "residuals": (_residuals_caption, _for_stage("diagnosis", _residuals)),
    "remainder": (
        "Smooth part of the residual that none of the known effects explains; it is orthogonal to the Jacobian of all "
        "parameters of the model.",
        _fixed("Smooth part of the residual, by sensor over the record, with the mean residual of each day."),
    ),
    "fit": (
        "Measured and simulated temperatures, and their residuals, in the week with the largest residual of the plain "
        "model.",
        _fixed("Measured and simulated temperatures, and residuals, in the worst week of the plain model."),
    ),
    "confusable": (
        "Similarity of the effects in this record: cosine between the changes of the residual that they cause. A pair "
        "near 1 cannot be distinguished. Names in bold: effects of the model.",
        _fixed("Matrix of the absolute cosine, 0 to 1, between the residual changes of each two effects."),
    ),
    "heat": (
        "The heat that would explain what no known effect does, given all readings, with its 95 % band; below, its "
        "spectrum and its mean day. A Kalman smoother separates it from noise and from all parameters of the model.",
        _heat_text,
    ),
    "next": (
        _next_caption,
        _next_text,
    ),
    "windows": (
        _windows_caption,
        _fixed("Size of each effect of the model, with its 95 % interval, in four quarters of the record."),
    ),
    "periodogram": (
        "Cumulative periodogram: share of the variance of the residual below each frequency, with the expectation of "
        "the fitted noise model (dashed) and the 95 % band of white noise (shaded).",
        _fixed("Cumulative periodogram of the residual of each sensor, with the 95 % band of white noise."),
    ),
}


def figure_caption(stem: str, run: Run) -> str:
    """Caption of a figure.

    Args:
        stem: name of its file without extension.
        run: with the results that it shows.
    """
    text = _CAPTIONS[stem][0]
    return text if isinstance(text, str) else text(run)


def alternative_text(stem: str, run: Run) -> str:
    """Description of what a figure shows, for readers who cannot see it; arguments as for `figure_caption`."""
    return format_text(_CAPTIONS[stem][1](run))
