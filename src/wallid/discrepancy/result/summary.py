"""The text of a diagnosis: the sentence of the verdict, and the summary."""

from __future__ import annotations

import numpy as np

from ..._internal.number_formats import p_value_text, value_and_std
from ...estimation.materials import implausible
from ...inference.quantity import Quantity
from ...models.flux_plates import fluxes_of
from ..effects.catalogue import untestable
from ..problem import DiagnosisProblem, EffectParameters
from ..selection.acceptance import RIVAL
from ..selection.effect_results import NamedEffect
from .findings import Findings
from .wall_properties import RESISTANCE

_TABLE_ROWS = 8
_WIDE_INTERVAL = 1.5  # upper over lower end, from which an interval says little
_WITH_PLATES = {"resistance": "resistance", "transmittance": "U-value", "areal_heat_capacity": "capacity"}
_COMMON_EFFECTS = (  # name, factor to the unit of the text, text
    ("solar_gain", 1.0, "a solar gain of {:g} K m2/W"),
    ("sensor_position", 1e3, "a sensor misplaced by {:g} mm"),
    ("sensor_gain", 100.0, "a sensor's gain wrong by {:g} %"),
    ("layered_conductivity", 100.0, "layers whose conductivities differ by {:g} %"),
)


def verdict_sentence(findings: Findings) -> str:
    """The verdict in one or a few sentences: what was mixed up, if anything, then what the corrected record shows."""
    mixups = [f"{mixup.words[:1].upper()}{mixup.words[1:]}." for mixup in findings.mixups]
    pattern = _pattern_of_section(findings)
    return " ".join([*mixups, *pattern, _sentence(findings), *_gain_of_single_plate(findings)])


def _pattern_of_section(findings: Findings) -> list[str]:
    """What the record shows of stones and mortar."""
    found, before, plain = findings.heterogeneity, findings.estimate_before, findings.plain
    if found is None:
        return []
    if found.is_contradicted:
        return [
            "The record contradicts the section of the case: a homogeneous wall explains it better "
            f"(-2 log L by {-found.evidence:.1f}), and is used here; check the materials, the joints and the heights."
        ]
    if not found.is_clear:
        other = findings.other_wall
        named = " and ".join(_label_with_size(one, other.problem) for one in other.effects) if other is not None else ""
        beside = f" with {named}" if named else ""
        reason = (
            f"(-2 log L drops by {found.evidence:.1f})"
            if abs(found.evidence) <= RIVAL
            else f"(it would have {found.label}, where the section says 1)"
        )
        return [
            f"The record cannot distinguish the section of the case from a homogeneous wall{beside} {reason}; the "
            "interval spans both."
        ]
    return [
        f"The wall is not homogeneous: the record shows {found.label} (1 is the section as stated). A homogeneous wall "
        f"would have {before.diffusivity:.4g} m2/s, with the section it is {plain.diffusivity:.4g} m2/s."
    ]


def _sentence(findings: Findings) -> str:
    gap, final, plain, problem = findings.gap, findings.final, findings.plain, findings.problem
    verdict = findings.verdict
    low, high = findings.interval_95
    if verdict == "uninformative":
        missing = f" Something is missing from the model too: {findings.incomplete}." if findings.incomplete else ""
        slip = implausible(final.diffusivity, problem.case.wall.diffusivity_prior)
        slip = f" {slip[:1].upper()}{slip[1:]}." if slip else ""
        return f"This record does not determine the diffusivity: {findings.uninformative}.{missing}{slip}"
    noise = f"noise alone gives {gap.noise_floor:.3g} {gap.unit}"
    residual = f"{_values(findings)} and the rms residual {gap.after:.3g} {gap.unit}, where {noise}."
    if verdict == "adequate":
        text = f"This record shows no missing effect: {residual}"
        return text + _would_have_been_seen(findings) + _rejected(findings)
    if verdict == "unnamed":
        rms, floors = findings.residual_tests_after.by_instrument, findings.after.noise.rms_of_outputs
        ratios = {name: rms[name] / floor for name, floor in zip(rms, floors, strict=True) if np.isfinite(floor)}
        resistance = findings.quantities.get("resistance")
        of_resistance = "" if resistance is None else f", the resistance {_range(resistance)}"
        lies = f"The diffusivity lies between {low:.4g} and {high:.4g} m2/s{of_resistance}."
        if findings.heat_left is not None:
            return f"An effect is missing that is none of the known effects: {findings.incomplete}. {lies}"
        return (
            f"An effect is missing that is none of the known effects: the rms residual is {gap.after:.3g} {gap.unit}, "
            f"where {noise}, largest at {max(ratios, key=ratios.__getitem__)}; {findings.incomplete}. {lies}"
        )
    if findings.mixups and not findings.effects:
        return f"With that corrected, the record shows no missing effect: {residual}"
    if not findings.effects and not findings.shows_heterogeneity:
        return residual[:1].upper() + residual[1:]
    if not findings.effects:
        return f"Beside that, the record shows no missing effect: {residual}"
    named = " and ".join(_label_with_size(effect, problem) for effect in findings.effects)
    verb, pronoun = ("is", "it") if len(findings.effects) == 1 else ("are", "them")
    held_out = (
        ""
        if gap.held_out_before is None or gap.held_out_after is None
        else f", and the rms residual on days that the fit did not use from {gap.held_out_before:.3g} to "
        f"{gap.held_out_after:.3g} {gap.unit}"
    )
    found = findings.quantities.get("resistance")
    resistance = "" if found is None else f", the resistance from {RESISTANCE.value(plain):.3g} to {_with_std(found)}"
    text = (
        f"{named[:1].upper()}{named[1:]} {verb} missing; with {pronoun} the diffusivity goes from "
        f"{plain.diffusivity:.4g} to {final.diffusivity:.4g} m2/s{resistance}{held_out}; {noise}."
    )
    if verdict == "confusable":
        text += " " + " ".join(_ambiguity(effect, problem) for effect in findings.effects if effect.alternatives)
    return text


def _gain_of_single_plate(findings: Findings) -> list[str]:
    """What one plate alone cannot tell."""
    plates = fluxes_of(findings.problem.case)
    if len(plates) != 1:
        return []
    return [
        f"This record cannot distinguish a gain of the {plates[0]} plate from another conductivity: the resistance "
        "holds if the plate is calibrated as stated."
    ]


def _values(findings: Findings) -> str:
    """The diffusivity, with plates the resistance too, as the beginning of a sentence."""
    resistance = findings.quantities.get("resistance")
    text = f"the diffusivity is {findings.final.diffusivity:.4g} m2/s"
    return text if resistance is None else f"{text}, the resistance {_with_std(resistance)}"


def _with_std(quantity: Quantity) -> str:
    return value_and_std(quantity.value, quantity.std, quantity.unit)


def _range(quantity: Quantity) -> str:
    low, high = quantity.interval_95
    return f"between {low:.3g} and {high:.3g} {quantity.unit}"


def _would_have_been_seen(findings: Findings) -> str:
    """From which size on some common effects would have been seen, and whether the interval is too wide to say much."""
    (low, high), sizes, seen = findings.interval_95, findings.smallest_detectable(), []
    for name, factor, text in _COMMON_EFFECTS:
        own = [sizes[label] for label, one in _by_label(findings).items() if one.effect.name == name and label in sizes]
        if own:
            seen.append(text.format(float(f"{max(own) * factor:.2g}")))
    text = f" It would have shown {', '.join(seen)}; what is smaller may be there." if seen else ""
    if high / low > _WIDE_INTERVAL:
        text += f" The interval is wide, {low:.2g} to {high:.2g} m2/s: this record could have shown little."
    return text


def _by_label(findings: Findings) -> dict[str, EffectParameters]:
    """The effects of the library by their labels."""
    return {findings.problem.label(one.effect): one for one in findings.problem.library}


def _rejected(findings: Findings) -> str:
    """The effect that gains more than chance gives but was rejected."""
    tried = [row for row in findings.table if row.gain is not None]
    return f" {tried[0].label} gains more than chance gives but was rejected: {tried[0].reason}." if tried else ""


def _label_with_size(named: NamedEffect, problem: DiagnosisProblem) -> str:
    size = named.effect_parameters.effect.parameters[0]
    value, std = named.values[size.name]
    return f"{problem.label(named.effect_parameters.effect)} of {value_and_std(value, std, size.unit)}"


def _ambiguity(named: NamedEffect, problem: DiagnosisProblem) -> str:
    """The alternatives of an effect."""
    labels = " or ".join(problem.label(other.effect) for other in named.alternatives)
    return (
        f"This record cannot distinguish {problem.label(named.effect_parameters.effect)} from {labels}; "
        f"the interval spans them."
    )


def diagnosis_summary(findings: Findings) -> str:
    """The verdict, the sizes of the named effects and the ranked table, as text for a terminal."""
    problem, tests = findings.problem, (findings.residual_tests_before, findings.residual_tests_after)
    (low, high), quantities = findings.interval_95, findings.quantities
    lines = [
        f"verdict      {findings.verdict}: {verdict_sentence(findings)}",
        f"diffusivity  {findings.final.diffusivity:.4g} m2/s   (95 %: {low:.4g} to {high:.4g}); "
        f"plain model {findings.plain.diffusivity:.4g}",
        *(f"{label:<12} {quantities[name]}" for name, label in _WITH_PLATES.items() if name in quantities),
        f"readings     {problem.record.rows} rows, {findings.after.noise}",
        f"residual     omnibus test {p_value_text(tests[0].p_value)} before, {p_value_text(tests[1].p_value)} after",
    ]
    if findings.unknown_heat is not None:
        lines.append(f"what is left {findings.unknown_heat.sentence}")
    if findings.heterogeneity is not None:
        lines.append(f"section      {findings.heterogeneity}")
    for named in findings.effects:
        windows, effect = named.windows, named.effect_parameters.effect
        values = ", ".join(f"{p.name} {value_and_std(*named.values[p.name], p.unit)}" for p in effect.parameters)
        count = windows.informative_windows
        equal = f"equal: p = {windows.p_value:.2g}" if count > 1 else f"{count} of {len(windows.size)} are informative"
        lines.append(f"effect       {problem.label(effect)}: {values}")
        lines.append(
            f"             -2 log L drops by {named.gain:.1f} ({named.expected_gain:.1f} expected), "
            f"{p_value_text(named.p_value, 1e-3)}; by windows {_list(windows.size)} ({equal})"
        )
    lines += [f"next         {one.sentence}" for one in findings.prescriptions]
    lines.append("ranked       expected gain, gain, size, change of the diffusivity, reason, similar effects")
    lines += [f"             {row}" for row in findings.table[:_TABLE_ROWS]]
    if missing := untestable(problem.sensor_count, problem.record.regressors):
        text = "; ".join(f"{name} (needs {', '.join(needs)})" for name, needs in missing.items())
        lines.append(f"not testable {text}")
    if findings.verdict == "adequate":
        lines.append("detectable   the smallest size of each effect that this record would have shown:")
        sizes = findings.smallest_detectable()
        rows = sorted(findings.table, key=lambda row: row.label)
        lines += [f"             {row.label}: {sizes[row.label]:.2g} {row.unit}".rstrip() for row in rows]
    return "\n".join(lines)


def _list(values: np.ndarray) -> str:
    return ", ".join(f"{value:.3g}" for value in values)
