"""What `result.json` says of a run: every number, finite or null, under the keys that scripts rely on."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..case.initial_profile import scales
from ..case.record_check import describe
from ..case.time_window import diagnosed
from ..discrepancy.result_entries import evidence
from ..estimation.heat_flux import ThermalProperties
from ..estimation.many_windows import CampaignEstimate
from ..estimation.pooled_mean import PooledMean
from ..estimation.result_objects import Estimate
from ..inference.identifiability import COLLINEAR
from ..inference.quantity import Quantity
from ..models.flux_plates import flux_noise_std
from ..reduction.modal_identification import LearnedModel
from ..workflow import Run

SCHEMA = 1
"""Of the format: another number where a key changed its meaning."""


def result(run: Run) -> dict[str, Any]:
    """The contents of result.json."""
    found: dict[str, Any] = {"schema": SCHEMA, "case": run.case.name}
    if (window := _window(run)) is not None:
        found["window"] = window
    final = run.fit or run.campaign
    diffusivity = None if final is None else _diffusivity(final)
    found |= {"diffusivity": diffusivity, "diffusivity_before": diffusivity}
    found["verdict"] = "uninformative" if run.unreliable else None
    found |= {"effects": [], "gap": None, "iterations": None, "reason": run.unreliable or None}
    if run.fit is not None:
        found |= _fit(run, run.fit)
    if run.campaign is not None:
        found["windows"] = _campaign(run.campaign)
        if run.campaign.thermal is not None:
            found |= _thermal(run.campaign.thermal)
    if run.design is not None:
        found["design"] = _design(run)
    if run.learned is not None:
        found["reduced_model"] = _errors(run.learned) | {"reference_temperature_K": scales(run.case).temperature}
    if run.lengths is not None:
        found["lengths"] = {
            "days": run.lengths.days,
            "criterion": run.lengths.criterion,
            "seconds_per_estimate": run.lengths.seconds,
        }
    if run.orders:
        found["orders"] = [_errors(learned) for learned in run.orders]
    if run.prediction is not None:
        found["reliability"] = _reliability(run)
    if run.diagnosis is not None:
        found |= run.diagnosis.result() | evidence(run.diagnosis)
    found["record"] = describe(run.case.record)
    if run.check is not None:
        found["stops"], found["notes"] = list(run.check.stops), list(run.check.notes)
    found["seconds"] = run.seconds
    return _finite(found)


def _window(run: Run) -> dict[str, Any] | None:
    """The rows of the estimate; of the design where nothing was estimated; of the diagnosis where there is neither."""
    record, criterion = run.case.record, None
    if run.fit is not None:
        window = run.fit.window
    elif run.design is not None:
        window = run.design.best
    elif run.campaign is not None:
        window = run.campaign.span
    elif run.diagnosis is not None:
        window = diagnosed(run.case)
    else:
        return None
    if run.design is not None and window.row in run.design.starts:
        criterion = run.design.merit[list(run.design.starts).index(window.row)]
    return {
        "start": record.stamp(window.row),
        "end": record.stamp(window.row + window.rows),
        "criterion": criterion,
    }


def _fit(run: Run, fit: Estimate) -> dict[str, Any]:
    """What the estimate from one window gave, and what it rests on."""
    profile = fit.profile
    found: dict[str, Any] = {
        "gap": _gap(run, fit),
        "iterations": fit.iterations,
        "initial_profile": {"coefficients_degC": profile.coefficients, "eps_2_K": profile.eps_2},
        "model_shift": fit.model_shift,
        "history": fit.history,
    }
    constants = (
        ("offsets", fit.offsets, "K"),
        ("positions", fit.positions, "m"),
        ("face_positions", fit.face_positions, "m"),
    )
    for key, errors, unit in constants:
        found[key] = {name: {"value": value, "std": std, "unit": unit} for name, (value, std) in errors.items()}
    found["interval"] = _interval(fit)
    found |= _told_apart(fit)
    if fit.thermal is not None:
        left = np.sqrt(np.nanmean(fit.residual[:, fit.sensors :] ** 2))
        found |= _thermal(fit.thermal)
        found["flux_gap"] = {"after_W_per_m2": left, "floor_W_per_m2": flux_noise_std(run.case)}
    return found


def _gap(run: Run, fit: Estimate) -> dict[str, Any] | None:
    """How far the inner sensors' readings are from the model in the window; None without such a sensor."""
    inside = fit.residual[:, : fit.sensors]
    if not inside.size:
        return None
    gap = float(np.sqrt(np.nanmean(inside**2)))
    return {
        "before_K": gap,
        "after_K": gap,
        "floor_K": _noise_alone(run, inside),
        "held_out_before_K": None,
        "held_out_after_K": None,
    }


def _noise_alone(run: Run, residual: np.ndarray) -> float:
    """The root mean square that the stated noise alone would leave in the readings that are there."""
    noise = np.array([sensor.noise_std for sensor in run.case.sensors])
    present = np.isfinite(residual)
    return float(np.sqrt(np.sum(present * noise**2) / present.sum()))


def _told_apart(fit: Estimate) -> dict[str, Any]:
    """What else of the wall was free, and which parameters the record tells apart."""
    found: dict[str, Any] = {}
    if fit.structure:
        found["structure"] = {name: one.result() for name, one in fit.structure.items()}
    apart = fit.identifiability
    if apart is not None:
        found["identifiability"] = {
            "parameters": apart.names,
            "singular_values": apart.singular_values,
            "correlations": apart.correlations,
            "collinearity": [
                {"parameters": [apart.names[k] for k in subset], "index": index}
                for subset, index in apart.collinearity.items()
                if len(subset) == 2 or index > COLLINEAR or len(subset) == len(apart.names)
            ],
            "sentence": str(apart),
        }
    return found


def _interval(fit: Estimate) -> dict[str, Any]:
    """How the interval was found, and what checked it."""
    drawn = fit.bootstrap
    return {
        "kind": fit.interval_kind,
        "noise": fit.noise,
        "variance_shares": fit.shares,
        "reduced_chi_square": fit.reduced_chi_square,
        "bootstrap": None
        if drawn is None
        else {
            "draws": drawn.draws,
            "seed": drawn.seed,
            "std": drawn.std,
            "interval_95": list(drawn.interval_95),
            "bias_in_standard_errors": drawn.bias,
            "unit": "m2/s",
        },
    }


def _thermal(told: ThermalProperties) -> dict[str, Any]:
    """What the fluxes told, and the average method beside it."""
    names = ("conductivity", "heat_capacity", "resistance", "areal_heat_capacity", "transmittance")
    found: dict[str, Any] = {name: getattr(told, name).result() for name in names}
    found["plate_gains"] = {
        f"flux_{face}": {"value": value, "std": std, "unit": "-"} for face, (value, std) in told.gains.items()
    }
    found["iso_9869"] = {
        f"flux_{one.face}": {
            "resistance": one.resistance,
            "resistance_without_stored_heat": one.corrected,
            "unit": "m2 K/W",
            "days": one.days,
            "three_days": one.three_days,
            "within_5_percent_of_a_day_before": one.day_before,
            "first_and_last_two_thirds_within_5_percent": one.two_thirds,
            "change_of_a_day": one.change_of_a_day,
            "first_to_last": one.first_to_last,
            "complete": one.complete,
        }
        for one in told.averages
    }
    held = told.held_out
    found["held_out_flux"] = (
        None
        if held is None
        else {"coverage_95": held.coverage, "rms_W_per_m2": held.rms, "hours": held.hours, "readings": held.readings}
    )
    return found


def _campaign(pooled: CampaignEstimate) -> dict[str, Any]:
    """Every window's estimate, and whether they agree."""
    found: dict[str, Any] = {"informative": len(pooled.used)} | _agreement(pooled.mean)
    if pooled.conduction is not None:
        found["conductivities"] = _agreement(pooled.conduction)
    return found | {"each": [_one_window(pooled, k) for k in range(len(pooled.windows))]}


def _agreement(mean: PooledMean | None) -> dict[str, Any]:
    """Of a mean of the windows."""
    return {
        "chi_square": None if mean is None else mean.chi_square,
        "degrees_of_freedom": None if mean is None else mean.freedom,
        "p_value": None if mean is None else mean.p_value,
        "relative_std_between": None if mean is None else mean.between,
    }


def _one_window(pooled: CampaignEstimate, k: int) -> dict[str, Any]:
    """A window's own estimate."""
    fit = pooled.fits[k]
    through = None if fit is None or fit.thermal is None else fit.thermal.resistance.result()
    return {
        "start": pooled.labels[k],
        "diffusivity": None if fit is None else _diffusivity(fit),
        **({} if pooled.thermal is None else {"resistance": through}),
        "informative": k in pooled.used,
        "weight": pooled.weight(k),
        "reason": "no reading" if fit is None else fit.reason or None,
    }


def _design(run: Run) -> dict[str, Any]:
    """By which criterion the days were chosen, where a further sensor would help, and what other steps would give."""
    design, places, sampling = run.design, run.places, run.sampling
    assert design is not None
    found: dict[str, Any] = {
        "criterion": design.kind,
        "of": design.of,
        "robust": design.robust,
        "full": design.full,
        "diffusivities": design.diffusivities,
        "expected_relative_std": design.expected_error,
        "starts": {"start": [run.case.record.stamp(row) for row in design.starts], "criterion": design.merit},
    }
    if len(design.diffusivities) > 1:
        found["starts"] |= {
            f"criterion at {alpha:.3g} m2/s": sizes
            for alpha, sizes in zip(design.diffusivities, design.criterion, strict=True)
        }
    if places is not None:
        found["further_sensors"] = [
            {"place": place, "relative_std": places.std[k, 0, i], "criterion_gain": places.gain[k, i], "unit": "m"}
            for k, place in enumerate(places.chosen)
            for i in [int(np.argmin(np.abs(places.places - place)))]
        ]
        found["relative_std_without"] = places.std_before[0]
        found["places"] = {"m": places.places, "relative_std": places.std[0, 0], "criterion_gain": places.gain[0]}
    if sampling is not None:
        found["sampling"] = {
            "step_s": sampling.steps,
            "relative_std": sampling.std,
            "interval_95_span": sampling.spans,
            "shift_by_straight_faces": sampling.shift,
        }
    return found


def _errors(learned: LearnedModel) -> dict[str, Any]:
    """What a reduced model errs by over its learning signals, dimensionless."""
    found: dict[str, Any] = {"order": learned.system.order}
    for name, errors in (("eps_inf", learned.eps_inf), ("eps_2", learned.eps_2)):
        found |= {f"{name}_u": errors[0], f"{name}_theta": errors[1]}
    return found


def _reliability(run: Run) -> dict[str, Any]:
    """How far the whole record is from the prediction, sensor by sensor, and the loads."""
    found = run.prediction
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
    return {
        "sensors": per_sensor,
        "rms_K": np.sqrt(np.nanmean(found.residual**2)),
        "noise_K": _noise_alone(run, found.residual),
        "loads": loads,
    }


def _diffusivity(found: Estimate | CampaignEstimate) -> dict[str, Any]:
    return Quantity(found.value, found.std, found.interval_95, "m2/s").result()


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
