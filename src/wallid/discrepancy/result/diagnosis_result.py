"""The result object of `wallid.diagnose`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..._internal.html import html_table, html_text, interval_row
from ..._internal.result_object import ResultObject, plain_value
from .findings import Findings
from .result_entries import diagnosis_entries
from .summary import diagnosis_summary, verdict_sentence

if TYPE_CHECKING:
    from pandas import DataFrame


class Diagnosis(Findings, ResultObject):
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
        return plain_value(diagnosis_entries(self))

    __str__ = summary

    def to_frame(self) -> DataFrame:
        """Every effect of the library against the plain model, the largest expected gain first.

        Columns: `expected_gain` and `gain` (drop of -2 log L by the linear prediction and by a refit), `size` and `std`
        in `unit`, `diffusivity_shift` (relative), `named`, and the `reason`. The index is the effect with its target.
        """
        import pandas as pd

        named = [one.effect_parameters for one in self.effects] if self.verdict in ("named", "confusable") else []
        rows = [
            {
                "expected_gain": row.expected_gain,
                "gain": row.gain,
                "size": row.size,
                "std": row.std,
                "unit": row.unit,
                "diffusivity_shift": row.shift,
                "named": row.effect_parameters in named,
                "reason": row.reason,
            }
            for row in self.table
        ]
        index = pd.Index([row.label for row in self.table], name="effect")
        return pd.DataFrame(rows, index=index).astype({"gain": float})

    def _repr_html_(self) -> str:
        rows = [interval_row(name.replace("_", " "), one) for name, one in self.quantities.items()]
        for named in self.effects:
            size = named.effect_parameters.effect.parameters[0]
            value, std = named.values[size.name]
            label = self.problem.label(named.effect_parameters.effect)
            rows.append((label, f"{value:.4g}", f"standard deviation {std:.2g}", size.unit))
        return html_table(f"Diagnosis: {self.verdict}", rows) + html_text(self.sentence)
