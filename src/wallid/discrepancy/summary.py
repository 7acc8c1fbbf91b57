"""A diagnosis in words: the verdict's sentence, what would tell rivals apart, the summary in a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .effects.catalogue import untestable
from .problem import DiagnosisProblem

if TYPE_CHECKING:
    from .findings import Diagnosis, NamedEffect

_TOP = 8  # rows of the ranked table
_SEPARATIONS = (
    (
        {"clock_shift", "sensor_lag", "face_lag"},
        "Swapping two loggers, or setting all clocks anew, would tell them apart.",
    ),
    (
        {"sensor_offset", "face_offset", "sensor_gain", "sensor_drift", "heat_source"},
        "A night with all sensors at one temperature, or swapping two of them, would tell them apart.",
    ),
    (
        {"sensor_position", "face_depth", "surface_film", "contact_resistance", "layered_conductivity"},
        "Measuring the sensors' depths anew, or one more sensor near that face, would tell them apart.",
    ),
    (
        {"solar_gain", "lateral_loss", "air_flow"},
        "Days with other sun and wind, or shading the face for a week, would tell them apart.",
    ),
    (
        {
            "diffusivity_drift",
            "wetting",
            "phase_change",
            "temperature_dependent_conductivity",
            "temperature_dependent_capacity",
        },
        "A longer record over another season would tell them apart.",
    ),
)


def sentence(found: Diagnosis) -> str:
    """The verdict in one sentence."""
    gap, after, before = found.gap, found.after, found.before
    verdict = found.verdict
    low, high = found.interval_95
    if verdict == "uninformative":
        return f"This record does not give the diffusivity: its 95 % interval goes from {low:.2g} to {high:.2g} m2/s."
    if verdict == "adequate":
        return (
            f"Nothing is missing that this record could show: the diffusivity is {after.diffusivity:.4g} m2/s and "
            f"the gap {gap.after:.3g} K, where noise alone would leave {gap.floor:.3g} K.{_refused(found)}"
        )
    if verdict == "unnamed":
        worst = max(found.left_after.by_sensor, key=lambda name: found.left_after.by_sensor[name])
        return (
            f"Something is missing that is none of the known effects: {gap.after:.3g} K are left where noise alone "
            f"would leave {gap.floor:.3g} K, most at {worst}; {found.incomplete}. The diffusivity lies between "
            f"{low:.4g} and {high:.4g} m2/s at best."
        )
    named = " and ".join(_worded(effect, found.study) for effect in found.effects)
    verb = "is" if len(found.effects) == 1 else "are"
    held = (
        ""
        if gap.held_out_before is None or gap.held_out_after is None
        else f" and the held-out gap from {gap.held_out_before:.3g} to {gap.held_out_after:.3g} K"
    )
    text = (
        f"{named[:1].upper()}{named[1:]} {verb} missing; with it the diffusivity goes from "
        f"{before.diffusivity:.4g} to {after.diffusivity:.4g} m2/s{held}, floor {gap.floor:.3g} K."
    )
    if len(found.effects) > 1:
        text = text.replace("; with it ", "; with them ")
    if verdict == "confusable":
        text += " " + " ".join(_doubt(effect, found.study) for effect in found.effects if effect.alternatives)
    return text


def _refused(found: Diagnosis) -> str:
    """What stood above chance and was refused all the same."""
    tried = [row for row in found.table if row.gain is not None]
    return f" Above chance, and refused, was {tried[0].label}: {tried[0].reason}." if tried else ""


def _worded(named: NamedEffect, study: DiagnosisProblem) -> str:
    size = named.slot.effect.parameters[0]
    value, std = named.values[size.name]
    unit = f" {size.unit}" if size.unit else ""
    return f"{study.label(named.slot.effect)} of {value:.3g} +- {std:.1g}{unit}"


def _doubt(named: NamedEffect, study: DiagnosisProblem) -> str:
    labels = [study.label(slot.effect) for slot in named.alternatives]
    return (
        f"This record cannot tell {study.label(named.slot.effect)} from {' or '.join(labels)}; "
        f"the interval spans them. {separation(named, study)}"
    )


def summary(found: Diagnosis) -> str:
    """What a terminal shows: verdict, sizes, the ranked table."""
    study = found.study
    low, high = found.interval_95
    lines = [
        f"verdict      {found.verdict}: {sentence(found)}",
        f"diffusivity  {found.after.diffusivity:.4g} m2/s   (95 %: {low:.4g} to {high:.4g}); "
        f"plain model {found.before.diffusivity:.4g}",
        f"readings     {study.record.rows} rows, {found.after.noise}",
        f"left over    omnibus test p = {found.left_before.p_value:.2g} before, {found.left_after.p_value:.2g} after",
    ]
    for named in found.effects:
        values = ", ".join(
            f"{p.name} {named.values[p.name][0]:.4g} +- {named.values[p.name][1]:.1g} {p.unit}".rstrip()
            for p in named.slot.effect.parameters
        )
        told = named.windows.told
        same = (
            f"same: p = {named.windows.p_value:.2g}" if told > 1 else f"{told} of {len(named.windows.size)} tell of it"
        )
        lines.append(f"effect       {study.label(named.slot.effect)}: {values}")
        lines.append(
            f"             -2 log L drops by {named.gain:.1f} ({named.expected:.1f} expected), "
            f"p <= {named.p_value:.2g}; by windows {_list(named.windows.size)} ({same})"
        )
    lines.append("ranked       expected gain, gain, size, shift of the diffusivity, what looks like it")
    for row in found.table[:_TOP]:
        lines.append(f"             {row}")
    if missing := untestable(study.sensors, study.record.regressors):
        words = "; ".join(f"{name} (needs {', '.join(needs)})" for name, needs in missing.items())
        lines.append(f"not testable {words}")
    if found.verdict == "adequate":
        smallest = sorted(found.table, key=lambda row: row.label)
        lines.append("would show   the smallest size of each effect that this record would have shown:")
        sizes = found.smallest()
        lines += [f"             {row.label}: {sizes[row.label]:.2g} {row.unit}".rstrip() for row in smallest]
    return "\n".join(lines)


def separation(named: NamedEffect, study: DiagnosisProblem) -> str:
    """Which experiment would tell an effect from its alternatives."""
    names = {named.slot.effect.name, *(slot.effect.name for slot in named.alternatives)}
    for group, advice in _SEPARATIONS:
        if names & group:
            return advice
    return "A record with other weather, or one more sensor between the others, would tell them apart."


def _list(values: np.ndarray) -> str:
    return ", ".join(f"{value:.3g}" for value in values)
