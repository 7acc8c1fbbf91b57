"""The result object of `wallid.diagnose`."""

from __future__ import annotations

from typing import Any

from .._internal.html import html_table
from .findings import Findings
from .result_entries import diagnosis_entries
from .summary import diagnosis_summary, verdict_sentence


class Diagnosis(Findings):
    """What the plain model misses in a record: verdict, named effects, and the diffusivity with them in the model.

    The fields are those of `Findings`.
    """

    @property
    def sentence(self) -> str:
        """The verdict in one sentence."""
        return verdict_sentence(self)

    def summary(self) -> str:
        """The verdict, the sizes of the named effects and the ranked table, as text."""
        return diagnosis_summary(self)

    def to_dict(self) -> dict[str, Any]:
        """The entries of result.json for the diffusivity, the verdict, the effects and the gap."""
        return diagnosis_entries(self)

    __str__ = summary

    def _repr_html_(self) -> str:
        low, high = self.interval_95
        rows = [("diffusivity", f"{self.final.diffusivity:.4g}", f"95 %: {low:.4g} to {high:.4g}", "m2/s")]
        for named in self.effects:
            size = named.effect_parameters.effect.parameters[0]
            value, std = named.values[size.name]
            label = self.problem.label(named.effect_parameters.effect)
            rows.append((label, f"{value:.4g}", f"standard deviation {std:.2g}", size.unit))
        return html_table(f"Diagnosis: {self.verdict}", rows)
