"""Diagnosis of model error: which physical effect the plain model misses, its size, and the diffusivity with it."""

from .next_measurement.actions import Action, Prescription
from .next_measurement.plan_with_columns import plan
from .problem import diagnosis_problem
from .result.diagnosis_result import Diagnosis
from .search_for_effects import diagnose
from .selection.effect_results import NamedEffect, RankedEffect, Trial

__all__ = [
    "Action",
    "Diagnosis",
    "NamedEffect",
    "Prescription",
    "RankedEffect",
    "Trial",
    "diagnose",
    "diagnosis_problem",
    "plan",
]
