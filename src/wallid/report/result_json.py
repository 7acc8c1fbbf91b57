"""Contents of `result.json`: every number of a run, finite or null, under fixed keys."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .._internal.result_object import plain_value
from ..case.initial_profile import scales
from ..case.record_check import describe_record
from ..case.time_window import diagnosis_window
from ..discrepancy.result.result_entries import evidence_entries
from ..estimation.heat_flux import ThermalProperties
from ..estimation.many_windows import CampaignEstimate
from ..estimation.pooled_mean import PooledMean
from ..estimation.result_objects import Estimate
from ..experiment_design.window_selection import ExpectedErrors
from ..inference.identifiability import COLLINEAR
from ..inference.quantity import Quantity
from ..models.flux_plates import flux_noise_std
from ..reduction.modal_identification import LearnedModel
from ..workflow import Run

SCHEMA = 1
"""Version of the format of result.json; it changes with the meaning of a key."""


def result_entries(run: Run) -> dict[str, Any]:
    """Contents of result.json for a run."""
    entries: dict[str, Any] = {"schema": SCHEMA, "case": run.case.name}
    if (window := _window(run)) is not None:
        entries["window"] = window
    final = run.fit or run.campaign
    diffusivity = None if final is None else diffusivity_entry(final)
    entries |= {"diffusivity": diffusivity, "diffusivity_before": diffusivity}
    entries["verdict"] = "uninformative" if run.unreliable_reason else None
    entries |= {"effects": [], "gap": None, "iterations": None, "reason": run.unreliable_reason or None}
    if run.visible_mixups:
        entries["mixups"] = [mixup.to_dict() for mixup in run.visible_mixups]
    if run.fit is not None:
        entries |= _fit(run, run.fit)
    if run.campaign is not None:
        entries["windows"] = _campaign(run.campaign)
        if run.campaign.thermal is not None:
            entries |= _thermal(run.campaign.thermal)
    if run.design is not None:
        entries["design"] = _design(run)
    if run.learned is not None:
        entries["reduced_model"] = _errors(run.learned) | {"reference_temperature_K": scales(run.case).temperature}
    if run.lengths is not None:
        entries["lengths"] = {
            "days": run.lengths.days,
            "criterion": run.lengths.criterion,
            "seconds_per_estimate": run.lengths.seconds,
        }
    if run.orders:
        entries["orders"] = [_errors(learned) for learned in run.orders]
    if run.prediction is not None:
        entries["reliability"] = _reliability(run)
    if run.screening is not None:
        entries["screening"] = run.screening.to_dict()
    if run.diagnosis is not None:
        entries |= run.diagnosis.to_dict() | evidence_entries(run.diagnosis)
    entries["record"] = describe_record(run.case.record)
    if run.check is not None:
        entries["stops"], entries["notes"] = list(run.check.stops), list(run.check.notes)
    entries["seconds"] = run.seconds
    return _finite(entries)


def _window(run: Run) -> dict[str, Any] | None:
    """The window of the estimate; without an estimate of the design; without both of the campaign or the diagnosis."""
    record, criterion = run.case.record, None
    if run.fit is not None:
        window = run.fit.window
    elif run.design is not None:
        window = run.design.best
    elif run.campaign is not None:
        window = run.campaign.span
    elif run.diagnosis is not None:
        window = diagnosis_window(run.case)
    else:
        return None
    if run.design is not None and window.row in run.design.starts:
        criterion = run.design.relative_criterion[list(run.design.starts).index(window.row)]
    return {
        "start": record.stamp(window.row),
        "end": record.stamp(window.row + window.rows),
        "criterion": criterion,
    }


def _fit(run: Run, fit: Estimate) -> dict[str, Any]:
    """Entries of the estimate from one window."""
    profile = fit.profile
    entries: dict[str, Any] = {
        "gap": _gap(run, fit),
        "iterations": fit.iterations,
        "initial_profile": {"coefficients_degC": profile.coefficients, "eps_2_K": profile.eps_2},
        "model_shift": fit.model_shift,
        "history": fit.history,
    }
    errors = (
        ("offsets", fit.offsets, "K"),
        ("positions", fit.positions, "m"),
        ("face_positions", fit.face_positions, "m"),
    )
    for key, values, unit in errors:
        entries[key] = {name: {"value": value, "std": std, "unit": unit} for name, (value, std) in values.items()}
    entries["interval"], entries["advice"] = _interval(fit), list(fit.advice)
    entries["disturbance"] = plain_value(fit.disturbance)
    if fit.sensor_places:
        entries["sensor_places"] = {name: place.to_dict() for name, place in fit.sensor_places.items()}
    if fit.materials is not None:
        entries["materials"] = fit.materials.to_dict()
    entries |= _identifiability(fit)
    if fit.thermal is not None:
        floor = fit.expected_rms(flux=True) if fit.noise_rms else flux_noise_std(run.case)
        entries |= _thermal(fit.thermal)
        entries["flux_gap"] = {"after_W_per_m2": fit.rms(flux=True), "floor_W_per_m2": floor}
    return entries


def _gap(run: Run, fit: Estimate) -> dict[str, Any] | None:
    """Root mean square of the residual at the inner sensors and of their noise; None without such a sensor."""
    residual = fit.residual[:, : fit.sensor_count]
    if not residual.size:
        return None
    rms = float(np.sqrt(np.nanmean(residual**2)))
    return {
        "before_K": rms,
        "after_K": rms,
        "floor_K": fit.expected_rms() if fit.noise_rms else _noise_rms(run, residual),
        "held_out_before_K": None,
        "held_out_after_K": None,
    }


def _noise_rms(run: Run, residual: np.ndarray) -> float:
    """Expected root mean square of the stated noise over the readings that are present, K."""
    noise = np.array([sensor.noise_std for sensor in run.case.sensors])
    present = np.isfinite(residual)
    return float(np.sqrt(np.sum(present * noise**2) / present.sum()))


def _identifiability(fit: Estimate) -> dict[str, Any]:
    """Entries of the further wall parameters, and of the identifiability of all parameters."""
    entries: dict[str, Any] = {}
    if fit.wall_parameters:
        entries["structure"] = {name: one.result() for name, one in fit.wall_parameters.items()}
    analysis = fit.identifiability
    if analysis is not None:
        entries["identifiability"] = {
            "parameters": analysis.names,
            "singular_values": analysis.singular_values,
            "correlations": analysis.correlations,
            "collinearity": [
                {"parameters": [analysis.names[k] for k in subset], "index": index}
                for subset, index in analysis.collinearity.items()
                if len(subset) == 2 or index > COLLINEAR or len(subset) == len(analysis.names)
            ],
            "sentence": str(analysis),
        }
    return entries


def _interval(fit: Estimate) -> dict[str, Any]:
    """Entries of the interval: method, noise, shares of the variance, and bootstrap."""
    bootstrap = fit.bootstrap
    return {
        "kind": fit.interval_kind,
        "noise": fit.noise_description,
        "noise_over_stated": fit.noise_ratio,
        "variance_shares": fit.variance_shares,
        "reduced_chi_square": fit.reduced_chi_square,
        "bootstrap": None
        if bootstrap is None
        else {
            "draws": bootstrap.draws,
            "seed": bootstrap.seed,
            "std": bootstrap.std,
            "interval_95": list(bootstrap.interval_95),
            "bias_in_standard_errors": bootstrap.bias,
            "unit": "m2/s",
        },
    }


def _thermal(thermal: ThermalProperties) -> dict[str, Any]:
    """Entries of the thermal properties from the fluxes, and of the average method of ISO 9869-1."""
    names = ("conductivity", "heat_capacity", "resistance", "areal_heat_capacity", "transmittance")
    entries: dict[str, Any] = {name: getattr(thermal, name).result() for name in names}
    entries["contact_resistances"] = {face: one.result() for face, one in thermal.contact_resistances.items()}
    entries["plate_gains"] = {
        f"flux_{face}": {"value": value, "std": std, "unit": "-"} for face, (value, std) in thermal.plate_gains.items()
    }
    if thermal.resistance_shares:
        entries["mean_residuals_W_per_m2"] = {f"flux_{face}": mean for face, mean in thermal.mean_residuals.items()}
        entries["resistance_shares"] = thermal.resistance_shares
    entries["iso_9869"] = {
        f"flux_{one.face}": {
            "resistance": one.resistance,
            "resistance_without_stored_heat": one.corrected_resistance,
            "unit": "m2 K/W",
            "days": one.days,
            "averaged_days": one.averaged_days,
            "three_days": one.three_days,
            "within_5_percent_of_a_day_before": one.day_before,
            "first_and_last_two_thirds_within_5_percent": one.two_thirds,
            "change_of_a_day": one.change_of_a_day,
            "first_to_last": one.first_to_last,
            "complete": one.complete,
            "unmet_rules": list(one.unmet_rules),
        }
        for one in thermal.average_methods
    }
    held_out = thermal.held_out
    entries["held_out_flux"] = (
        None
        if held_out is None
        else {
            "coverage_95": held_out.coverage,
            "rms_W_per_m2": held_out.rms,
            "hours": held_out.hours,
            "readings": held_out.readings,
        }
    )
    return entries


def _campaign(campaign: CampaignEstimate) -> dict[str, Any]:
    """Entries of all windows, and of the test that they agree."""
    entries: dict[str, Any] = {"informative": len(campaign.used)} | _agreement(campaign.mean)
    if campaign.conductivity_mean is not None:
        entries["conductivities"] = _agreement(campaign.conductivity_mean)
    return entries | {"each": [_one_window(campaign, k) for k in range(len(campaign.windows))]}


def _agreement(mean: PooledMean | None) -> dict[str, Any]:
    """Entries of the test that the windows have one mean."""
    return {
        "chi_square": None if mean is None else mean.chi_square,
        "degrees_of_freedom": None if mean is None else mean.degrees_of_freedom,
        "p_value": None if mean is None else mean.p_value,
        "relative_std_between": None if mean is None else mean.between_std,
    }


def _one_window(campaign: CampaignEstimate, k: int) -> dict[str, Any]:
    """Entries of one window."""
    fit = campaign.fits[k]
    resistance = None if fit is None or fit.thermal is None else fit.thermal.resistance.result()
    return {
        "start": campaign.labels[k],
        "diffusivity": None if fit is None else diffusivity_entry(fit),
        **({} if campaign.thermal is None else {"resistance": resistance}),
        "disturbance": None if fit is None else plain_value(fit.disturbance),
        "informative": k in campaign.used,
        "weight": campaign.weight(k),
        "reason": "no reading" if fit is None else fit.reason or None,
    }


def _design(run: Run) -> dict[str, Any]:
    """Entries of the design: criterion, windows, placement of further sensors, and sampling steps."""
    design, placement, sampling = run.design, run.sensor_placement, run.sampling
    assert design is not None
    errors = design.errors or ExpectedErrors(design.expected_relative_std)
    entries: dict[str, Any] = {
        "criterion": design.criterion_name,
        "of": design.of,
        "robust": design.robust,
        "full": design.full,
        "diffusivities": design.diffusivities,
        "expected_relative_std": errors.diffusivity,
        **({"expected_relative_std_of_resistance": errors.resistance} if math.isfinite(errors.resistance) else {}),
        "starts": {
            "start": [run.case.record.stamp(row) for row in design.starts],
            "criterion": design.relative_criterion,
        },
    }
    if len(design.diffusivities) > 1:
        entries["starts"] |= {
            f"criterion at {alpha:.3g} m2/s": sizes
            for alpha, sizes in zip(design.diffusivities, design.criterion, strict=True)
        }
    if placement is not None:
        entries["further_sensors"] = [
            {
                "place": position,
                "relative_std": placement.std[k, 0, i],
                "criterion_gain": placement.criterion_gain[k, i],
                "unit": "m",
            }
            for k, position in enumerate(placement.chosen)
            for i in [int(np.argmin(np.abs(placement.candidates - position)))]
        ]
        entries["relative_std_without"] = placement.std_before[0]
        entries["places"] = {
            "m": placement.candidates,
            "relative_std": placement.std[0, 0],
            "criterion_gain": placement.criterion_gain[0],
        }
    if sampling is not None:
        entries["sampling"] = {
            "step_s": sampling.steps,
            "relative_std": sampling.std,
            "interval_95_span": sampling.interval_ratio,
            "shift_by_straight_faces": sampling.interpolation_bias,
        }
    return entries


def _errors(learned: LearnedModel) -> dict[str, Any]:
    """Entries of the errors of a reduced-order model over its training signals, dimensionless."""
    entries: dict[str, Any] = {"order": learned.system.order}
    for name, errors in (("eps_inf", learned.eps_inf), ("eps_2", learned.eps_2)):
        entries |= {f"{name}_u": errors[0], f"{name}_theta": errors[1]}
    return entries


def _reliability(run: Run) -> dict[str, Any]:
    """Entries of the prediction over the entire record: residual of each sensor, and heat load."""
    prediction = run.prediction
    assert prediction is not None
    per_sensor = {
        name: dict(zip(("rms_prior_K", "rms_K", "sigma_K"), prediction.rms_of_sensor(s), strict=True))
        for s, name in enumerate(prediction.sensor_names)
    }
    loads = None
    if prediction.loads is not None:
        loads = {
            "conductivity": prediction.loads.conductivity,
            "diffusivity_factor": prediction.loads.factors,
            "energy_J_per_m2": prediction.loads.energy,
        }
    return {
        "sensors": per_sensor,
        "rms_K": np.sqrt(np.nanmean(prediction.residual**2)),
        "noise_K": _noise_rms(run, prediction.residual),
        "loads": loads,
    }


def diffusivity_entry(estimate: Estimate | CampaignEstimate) -> dict[str, Any]:
    """Value, standard error and 95 % interval of a diffusivity, finite or null."""
    return _finite(Quantity(estimate.value, estimate.std, estimate.interval_95, "m2/s").result())


def _finite(value: Any) -> Any:
    """Values as JSON has them: arrays as lists, NaN and infinities as null."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_finite(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
