"""The entries of result.json for a diagnosis."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..._internal.result_object import plain_value
from ...records.uniform_record import Record
from ..cross_validation import Gap
from ..effects.catalogue import untestable
from ..selection.effect_results import NamedEffect
from .findings import Findings
from .wall_properties import DIFFUSIVITY


def diagnosis_entries(findings: Findings) -> dict[str, Any]:
    """Diffusivity, verdict, effects (where the verdict is `named` or `confusable`), what to measure next, and gap."""
    problem = findings.problem
    verdict = findings.verdict
    effects = findings.effects if verdict in ("named", "confusable") else ()
    return {
        **{name: one.result() for name, one in findings.quantities.items()},
        "diffusivity_before": DIFFUSIVITY.of(findings.estimate_before).result(),
        "verdict": verdict,
        "mixups": [mixup.to_dict() for mixup in findings.mixups],
        "effects": [
            {
                "name": named.effect_parameters.effect.name,
                "target": problem.target_name(named.effect_parameters.effect),
                "parameters": _parameters(named, problem.record),
                "alternatives": [
                    {"name": effect_parameters.effect.name, "target": problem.target_name(effect_parameters.effect)}
                    for effect_parameters in named.alternatives
                ],
                "expected_gain": named.expected_gain,
                "gain": named.gain,
                "p_value": named.p_value,
                "windows": {
                    "days": named.windows.days,
                    "size": named.windows.size,
                    "std": named.windows.std,
                    "p_value": named.windows.p_value if named.windows.informative_windows > 1 else None,
                },
            }
            for named in effects
        ]
        + _heterogeneity(findings),
        "unknown_heat": None if findings.unknown_heat is None else findings.unknown_heat.to_dict(),
        "heterogeneity": None if findings.heterogeneity is None else plain_value(vars(findings.heterogeneity)),
        "next": [one.to_dict(lambda effect: problem.target_name(effect.effect)) for one in findings.prescriptions],
        **_gap(findings.gap),
    }


def _heterogeneity(findings: Findings) -> list[dict[str, Any]]:
    """The entry of the pattern of a section, where the record shows it."""
    if not findings.shows_heterogeneity or findings.verdict not in ("named", "confusable"):
        return []
    found = findings.heterogeneity
    assert found is not None
    return [
        {
            "name": "heterogeneity",
            "target": None,
            "parameters": {"size": {"value": found.size, "std": found.std, "unit": ""}},
            "alternatives": [],
            "expected_gain": found.evidence,
            "gain": found.evidence,
            "p_value": found.p_value,
            "windows": None,
        }
    ]


def _gap(gap: Gap) -> dict[str, Any]:
    """The entry `gap` of inner sensors; without one it is None, and `flux_gap` is that of the plates."""
    unit = gap.unit.replace("/", "_per_")
    entries = {
        f"before_{unit}": gap.before,
        f"after_{unit}": gap.after,
        f"floor_{unit}": gap.noise_floor,
        f"held_out_before_{unit}": gap.held_out_before,
        f"held_out_after_{unit}": gap.held_out_after,
    }
    return {"gap": entries} if gap.unit == "K" else {"gap": None, "flux_gap": entries}


def evidence_entries(findings: Findings) -> dict[str, Any]:
    """Noise, residual tests, and the ranked table of the entire library with the reason for each effect."""
    problem, noise = findings.problem, findings.after.noise
    entries: dict[str, Any] = {
        "noise": {
            "over_stated": np.sqrt(noise.white + noise.autocorrelated),
            "lasting_share": noise.autocorrelated / (noise.white + noise.autocorrelated),
            "correlation": noise.correlation,
        },
        "left_over": {
            "p_before": findings.residual_tests_before.p_value,
            "p_after": findings.residual_tests_after.p_value,
        },
        "ranked": [
            {
                "name": row.effect_parameters.effect.name,
                "target": problem.target_name(row.effect_parameters.effect),
                "label": row.label,
                "expected_gain": row.expected_gain,
                "gain": row.gain,
                "size": {"value": row.size, "std": row.std, "unit": row.unit},
                "diffusivity_shift": row.shift,
                "alike": row.rivals,
                "reason": row.reason,
            }
            for row in findings.table
        ],
        "untestable": untestable(problem.sensor_count, problem.record.regressors),
    }
    if findings.verdict == "adequate":
        units = {row.label: row.unit for row in findings.table}
        entries["smallest"] = {
            label: {"value": size, "unit": units[label]} for label, size in findings.smallest_detectable().items()
        }
    return entries


def _parameters(named: NamedEffect, record: Record) -> dict[str, Any]:
    """The parameters of an effect in the format of result.json: hours as a pair, a time in the record's format."""
    effect = named.effect_parameters.effect
    entries: dict[str, Any] = {}
    for parameter in effect.parameters:
        value, std = named.values[parameter.name]
        entries[parameter.name] = {"value": value, "std": std, "unit": parameter.unit}
    if effect.name == "heat_source":
        hours = [entries.pop(key, None) for key in ("start", "end")]
        entries.setdefault("place", None)
        entries["hours"] = None if hours[0] is None else [hour["value"] % 24.0 for hour in hours if hour]
    if effect.name == "wetting":
        entries["time"] = record.stamp_at(named.values["time"][0])
    return entries
