"""Where a model and its record part, which effect is missing, and how far the gap shrinks with it in the model."""

from .findings import Diagnosis, NamedEffect, RankedEffect, Trial
from .problem import diagnosis_problem
from .search_for_effects import diagnose

__all__ = ["Diagnosis", "NamedEffect", "RankedEffect", "Trial", "diagnose", "diagnosis_problem"]
