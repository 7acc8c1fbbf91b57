"""Where a model and its record part, which effect is missing, and how far the gap shrinks with it in."""

from .explain import explain
from .explanation import Explanation, Named, Row, Trial
from .study import compile_together, study

__all__ = ["Explanation", "Named", "Row", "Trial", "compile_together", "explain", "study"]
