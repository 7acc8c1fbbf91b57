"""What to do after a run, what the diffusivity implies, and how several diffusivities of a page are related."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from ..estimation.heat_flux import R_SURFACES, SURFACES_TEXT
from ..estimation.materials import materials_like

if TYPE_CHECKING:
    from ..discrepancy.result.diagnosis_result import Diagnosis
    from ..workflow import Run

_REMEDIES = {
    "sensor_position": "measure the position of {target} again, and state it in the case",
    "sensor_offset": "compare {target} with the other sensors at one temperature, or state its offset_std",
    "sensor_gain": "calibrate {target} at two temperatures, or replace it",
    "sensor_drift": "replace {target}, or use only the days before its drift",
    "sensor_lag": "check how {target} is in contact with the wall; a lag comes from a tube or a coating",
    "clock_shift": "synchronise the clocks of the loggers, and correct the times",
    "face_offset": "check the sensor of the {target} face: a bad contact or the air's temperature shifts it",
    "face_lag": "check the contact of the sensor of the {target} face",
    "face_depth": "check how deep the sensor of the {target} face is, and state it as an inner sensor",
    "solar_gain": "shade the sensor of the {target} face, or keep irradiance in the record",
    "surface_film": "the {target} column is rather the air's temperature: state the film ([choices] free)",
    "layered_conductivity": "state the layers of the wall ([[wall.layer]])",
    "layered_capacity": "state the layers of the wall ([[wall.layer]])",
    "contact_resistance": "look for an air gap or a detached render in the wall",
    "heat_source": "look for heat in the wall: a pipe, a flue, a heated floor",
    "lateral_loss": "look for heat that leaves sideways: a corner, a slab, a neighbouring wall",
    "air_flow": "look for air that moves through the wall: cracks, open joints",
    "plate_gain": "calibrate the {target} plate, or exchange the two plates and record again",
    "plate_offset": "read the {target} plate at zero flux, between two equal temperatures, and correct its offset",
    "plate_lag": "check how the {target} plate is in contact with the wall",
    "plate_resistance": "look for air under the {target} plate, and put the face's sensor under it, on the wall",
    "wetting": "look for water: rain, a leak, rising damp",
    "diffusivity_drift": "look for a wall that dries or gets wet",
}


def next_steps(run: Run) -> list[str]:
    """What to do next, the most important first."""
    if run.check is not None:
        return [*run.check.stops, *(() if run.check.stops else ("Run `wallid run` on the case.",))]
    if run.diagnosis is not None:
        return _after_diagnosis(run.diagnosis)
    steps = [mixup.words for mixup in run.visible_mixups]
    steps += run.fit.advice if run.fit is not None else ()
    if run.campaign is not None and run.campaign.thermal is not None and run.campaign.thermal.disagreement:
        steps.append(run.campaign.thermal.disagreement)
    missing = run.screening is not None and run.screening.missing
    if run.fit is not None and run.fit.reason and "wallid diagnose" not in run.fit.reason:
        steps.append("take days with larger variations of the face temperatures, a longer window, or a further sensor")
    if missing or (run.fit is not None and "wallid diagnose" in run.fit.reason):
        steps.append(
            "run `wallid diagnose` on the case: it fits the effects, says which one is missing, and corrects the "
            "diffusivity for it"
        )
    elif run.fit is not None and run.fit.disturbance is not None:
        known = "; `wallid diagnose` says whether a known effect explains it"
        steps.append(
            f"look for the {run.fit.disturbance.heat}, and log what may cause it: irradiance, the air's temperature, a "
            f"heater{known}"
        )
    elif run.fit is not None and run.case.sensors and not run.unreliable_reason:
        steps.append("use the value; `wallid diagnose` tests each effect of the library more closely")
    if run.fit is not None and run.fit.thermal is not None:
        if not run.case.sensors and not run.unreliable_reason:
            use = "use R and U with their intervals; stored heat is allowed for, so days need not be steady"
            doubt = run.fit.thermal.disagreement
            steps.insert(len(run.fit.advice), "until then take R and U as first values" if doubt else use)
        steps += [text for one in run.fit.thermal.average_methods for text in _unmet(one)]
    if run.fit is None and run.campaign is None and run.design is not None:
        steps.append("measure on the days of the design, or run `wallid estimate` on them")
    return steps


def _unmet(average: Any) -> list[str]:
    """What the average method of ISO 9869-1 still asks for."""
    if average.complete:
        return []
    rules = "; ".join(average.unmet_rules) or "the mean flux is zero"
    return [
        f"where a result by the average method of ISO 9869-1 is required, record more days: at the {average.face} "
        f"plate its rules are not met ({rules})"
    ]


def _after_diagnosis(found: Diagnosis) -> list[str]:
    steps = [mixup.words for mixup in found.mixups]
    if found.verdict in ("named", "confusable"):
        if found.effects:
            effects = "effect" if len(found.effects) == 1 else "effects"
            steps.append(f"use the diffusivity with the {effects} in the model; that of the plain model is biased")
        else:
            model = "of the section" if found.shows_heterogeneity else "of the corrected record"
            steps.append(f"use the diffusivity, which is that {model}")
        for named in found.effects:
            effect = named.effect_parameters.effect
            if remedy := _REMEDIES.get(effect.name):
                steps.append(f"on the wall: {remedy.format(target=found.problem.target_name(effect) or '')}")
    elif found.verdict == "adequate":
        steps.append("use the value, with its interval")
    elif found.verdict == "unnamed":
        steps.append("look at the figure of what is left: at which sensor or plate, hour and days it is largest")
        steps.append("do not rely on the diffusivity beyond its interval")
    elif not any(one.actions for one in found.prescriptions):
        steps.append("record days with larger variations of the face temperatures, longer, or with a further sensor")
    # a column that was not logged is needed where something unknown is left
    asked = (one for one in found.prescriptions if not one.column or found.verdict == "unnamed")
    return [*steps, *(one.step for one in asked if one.actions)]


def _sun_on_faces(found: Diagnosis) -> Iterator[str]:
    """What a solar gain means in kelvin."""
    for named in found.effects:
        effect = named.effect_parameters.effect
        if effect.name == "solar_gain":
            ((gain, _),) = named.values.values()
            face = found.problem.target_name(effect)
            yield f"With this solar gain the {face} face is {500 * gain:.2g} K warmer at 500 W/m2 of sun than in shade."


def relation_of_diffusivities(run: Run) -> str:
    """How the diffusivities of a page are related; empty where there is only one."""
    if run.diagnosis is None or (run.fit is None and run.campaign is None and not run.diagnosis.effects):
        return ""
    text = "All these values are of the same wall. "
    if run.fit is not None:
        text += "The value of the best window uses its few days only, that of the entire record all of them. "
    if run.diagnosis.effects:
        text += (
            "The plain model does not contain the missing effect, so each of its values is biased, and by an amount "
            "that depends on the days. The first value, with the effects in the model, is the one to use."
        )
    else:
        text += "They agree within their intervals where nothing is missing; use the first."
    return text


def implications(run: Run, entry: dict[str, Any] | None) -> list[str]:
    """What follows from a diffusivity: the materials that have it, and with a known property the other one and U.

    Args:
        run: with the wall.
        entry: the diffusivity of result.json; None or without a value for none.
    """
    if entry is None or entry["value"] is None or entry["interval_95"][0] is None:
        return []
    (low, high), wall, lines = entry["interval_95"], run.case.wall, []
    if not run.case.sensors:
        return []
    if run.diagnosis is not None:
        lines += _sun_on_faces(run.diagnosis)
    k, c = wall.conductivity, wall.heat_capacity
    if k is None and (names := materials_like(low, high)):
        lines.append(f"Materials with such a diffusivity: {', '.join(names)}.")
    if c is not None and k is None:
        ends = [c * alpha for alpha in (low, entry["value"], high)]
        u = [1.0 / (wall.length / one + R_SURFACES) for one in ends]
        lines.append(
            f"With the stated heat capacity of {c:.3g} J/m3/K the conductivity is {ends[1]:.3g} W/m/K ({ends[0]:.3g} "
            f"to {ends[2]:.3g}), and U is {u[1]:.3g} W/m2/K ({u[0]:.3g} to {u[2]:.3g})."
        )
    if k is not None and (run.fit is None or run.fit.thermal is None):
        u_value = 1.0 / (wall.length / k + R_SURFACES)
        lines.append(
            f"With the stated conductivity of {k:.3g} W/m/K the heat capacity is {k / entry['value']:.3g} J/m3/K "
            f"({k / high:.3g} to {k / low:.3g}); U is {u_value:.3g} W/m2/K, {SURFACES_TEXT}."
        )
    return lines
