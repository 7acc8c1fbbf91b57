"""Small cases from the independent simulator, as the search for a missing effect sees them; shared by its tests."""

from dataclasses import replace

import equinox as eqx
import numpy as np
from benchmarks.reference import simulator_with_effects as truth
from benchmarks.reference.simulator_with_effects import Spec

from wallid.case.case_file import load
from wallid.discrepancy.problem import diagnosis_problem

# a wall that forgets how it began within hours: L^2 / (pi^2 alpha) = 1.4 h
SPEC = Spec(
    length=0.2,
    diffusivity=8e-7,
    positions=(0.04, 0.1, 0.15),
    step=600.0,
    days=3.0,
    noise_std=1e-6,
    boundary_noise_std=1e-6,
    rounding=0.0,
    misplaced=False,
)


def prepare(folder, spec=SPEC):
    """The study of a simulated record, and what is true of it."""
    record = truth.write_case(spec, folder)
    return diagnosis_problem(load(folder)), record["truth"]


def slot_of(study, name, target=None, parameters=()):
    """The slot of an effect that has at least these parameters; the simplest of several forms."""
    found = [
        slot
        for slot in study.library
        if slot.effect.name == name
        and study.target_name(slot.effect) == target
        and set(parameters) <= {parameter.name for parameter in slot.effect.parameters}
    ]
    return min(found, key=lambda slot: len(slot.names))


def parameters_at(study, diffusivity, effects=()):
    """The parameters with a diffusivity (m2/s) and effects in, as (name, target, parameters)."""
    values = {"log_diffusivity": np.log(diffusivity / study.case.wall.diffusivity_prior)}
    for name, target, parameters in effects:
        parameters = {key: value for key, value in parameters.items() if value is not None}
        if "hours" in parameters:
            parameters["start"], parameters["end"] = parameters.pop("hours")
        slot = slot_of(study, name, target, parameters)
        values |= {slot.full_names[key]: value for key, value in parameters.items()}
    return study.parameters.with_values(values)


def trimmed(study, keep):
    """The study with a part of the library, which is compiled in a part of the time."""
    slots = tuple(slot for slot in study.library if keep(slot.effect))
    effects = tuple(slot.effect for slot in slots)
    return replace(study, model=eqx.tree_at(lambda m: m.effects, study.model, effects), library=slots)
