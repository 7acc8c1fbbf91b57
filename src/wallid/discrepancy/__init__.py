"""Diagnosis of model error: which physical effect the plain model misses, its size, and the diffusivity with it."""

from .diagnosis_result import Diagnosis
from .effect_results import NamedEffect, RankedEffect, Trial
from .problem import diagnosis_problem
from .search_for_effects import diagnose

__all__ = ["Diagnosis", "NamedEffect", "RankedEffect", "Trial", "diagnose", "diagnosis_problem"]
