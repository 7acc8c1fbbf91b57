"""Where a model and its record part, which effect is missing, and how far the gap shrinks with it in."""

from .findings import Explanation, Named, Row, Trial
from .problem import compile_together, study
from .search_for_effects import explain

__all__ = ["Explanation", "Named", "Row", "Trial", "compile_together", "explain", "study"]
