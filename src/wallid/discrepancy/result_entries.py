"""What `result.json` says of a diagnosis: the verdict with its effects, and what it rests on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..inference.quantity import Quantity
from ..records.uniform_record import Record
from .effect_fit import Fit
from .effects.catalogue import untestable

if TYPE_CHECKING:
    from .findings import Diagnosis, NamedEffect


def result(found: Diagnosis) -> dict[str, Any]:
    """Diffusivity, verdict, effects and gap."""
    study = found.study
    verdict = found.verdict
    told = found.effects if verdict in ("named", "confusable") else ()
    gap = found.gap
    return {
        "diffusivity": _diffusivity(found.after, found.interval_95),
        "diffusivity_before": _diffusivity(found.before, found.before.interval_95),
        "verdict": verdict,
        "effects": [
            {
                "name": named.slot.effect.name,
                "target": study.target_name(named.slot.effect),
                "parameters": _parameters(named, study.record),
                "alternatives": [
                    {"name": slot.effect.name, "target": study.target_name(slot.effect)} for slot in named.alternatives
                ],
                "expected_gain": named.expected,
                "gain": named.gain,
                "p_value": named.p_value,
                "windows": {
                    "days": named.windows.days,
                    "size": named.windows.size,
                    "std": named.windows.std,
                    "p_value": named.windows.p_value if named.windows.told > 1 else None,
                },
            }
            for named in told
        ],
        "gap": {
            "before_K": gap.before,
            "after_K": gap.after,
            "floor_K": gap.floor,
            "held_out_before_K": gap.held_out_before,
            "held_out_after_K": gap.held_out_after,
        },
    }


def evidence(found: Diagnosis) -> dict[str, Any]:
    """What the diagnosis rests on: beyond the verdict, every effect of the library and why it is in or not."""
    study, noise = found.study, found.after.noise
    told: dict[str, Any] = {
        "noise": {
            "over_stated": np.sqrt(noise.white + noise.autocorrelated),
            "lasting_share": noise.autocorrelated / (noise.white + noise.autocorrelated),
            "correlation": noise.correlation,
        },
        "left_over": {"p_before": found.left_before.p_value, "p_after": found.left_after.p_value},
        "ranked": [
            {
                "name": row.slot.effect.name,
                "target": study.target_name(row.slot.effect),
                "label": row.label,
                "expected_gain": row.expected,
                "gain": row.gain,
                "size": {"value": row.size, "std": row.std, "unit": row.unit},
                "diffusivity_shift": row.shift,
                "alike": row.rivals,
                "reason": row.reason,
            }
            for row in found.table
        ],
        "untestable": untestable(study.sensors, study.record.regressors),
    }
    if found.verdict == "adequate":
        units = {row.label: row.unit for row in found.table}
        told["smallest"] = {label: {"value": size, "unit": units[label]} for label, size in found.smallest().items()}
    return told


def _diffusivity(fit: Fit, interval: tuple[float, float]) -> dict[str, Any]:
    return Quantity(fit.diffusivity, fit.diffusivity * fit.log_std, interval, "m2/s").result()


def _parameters(named: NamedEffect, record: Record) -> dict[str, Any]:
    """An effect's parameters as result.json says them: hours as one pair, a time in the record's format."""
    effect = named.slot.effect
    found: dict[str, Any] = {}
    for parameter in effect.parameters:
        value, std = named.values[parameter.name]
        found[parameter.name] = {"value": value, "std": std, "unit": parameter.unit}
    if effect.name == "heat_source":
        hours = [found.pop(key, None) for key in ("start", "end")]
        found.setdefault("place", None)
        found["hours"] = None if hours[0] is None else [hour["value"] % 24.0 for hour in hours if hour]
    if effect.name == "wetting":
        found["time"] = record.stamp_at(named.values["time"][0])
    return found
