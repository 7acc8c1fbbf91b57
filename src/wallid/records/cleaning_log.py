"""The log of what was changed in a record while it was read: how many values, in which column, from which line on."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from .._internal.result_object import ResultObject

if TYPE_CHECKING:
    from pandas import DataFrame

_DESCRIPTIONS = {
    "converted": "{count} values converted from {example}",
    "marked": "{count} cells with a missing-value marker ({example} in line {line})",
    "text": "{count} cells of text masked ({example} in line {line})",
    "infinite": "{count} infinite values masked (line {line})",
    "impossible": "{count} impossible values masked ({example} in line {line})",
    "spike": "{count} spikes masked (from {example} in line {line})",
    "stuck": "{count} stuck readings masked ({example} from line {line})",
    "repeated": "{count} duplicate rows removed (line {line})",
    "averaged": "{count} rows averaged with other rows of the same time (line {line})",
    "dropped": "{count} rows without a time and a reading removed (line {line})",
    "sorted": "{count} rows sorted by time (line {line})",
    "snapped": "{count} readings assigned to a row up to {example} away, without interpolation",
    "binned": "{count} readings averaged, several to a row",
    "carried": "{count} readings interpolated to the time of their row, up to {example} away",
    "stranded": "{count} readings between rows masked: the next reading is too far away (line {line})",
    "between": "{count} rows between the column's own readings interpolated",
    "filled": "{count} rows in {example} interpolated",
    "trimmed": "{count} rows at the ends removed, where a face has no reading",
}
"""Kinds of `CleaningStep`, and their text."""


@dataclass(frozen=True)
class CleaningStep:
    """One change of a column's values.

    Args:
        column: its name; empty for all columns.
        kind: a key such as "spike".
        count: number of values or rows.
        line: line of the first one in the file; None where a line has no meaning.
        example: the first value as in the file, or another detail of the kind.
        masked_lines: lines of the values that were masked; None where no value was masked.
        masked_values: these values, degC; None where they are not kept.
    """

    column: str
    kind: str
    count: int
    line: int | None = None
    example: str = ""
    masked_lines: np.ndarray | None = field(default=None, repr=False, compare=False)
    masked_values: np.ndarray | None = field(default=None, repr=False, compare=False)

    @classmethod
    def masking(cls, column: str, kind: str, lines: np.ndarray, masked: np.ndarray, example: str = "") -> CleaningStep:
        """A step that masks the values of a column in some rows.

        Args:
            lines: of all rows in the file, (time,).
            masked: which rows, (time,).
        """
        return cls(column, kind, int(masked.sum()), int(lines[masked.argmax()]), example, lines[masked])

    def __str__(self) -> str:
        text = _DESCRIPTIONS[self.kind].format(count=self.count, line=self.line, example=self.example)
        text = re.sub(r"^(1 (?:\w+ )?(?:value|cell|spike|reading|row))s\b", r"\1", text)
        return f"{self.column}: {text}" if self.column else text


@dataclass(frozen=True)
class RecordBreak:
    """A gap in a face that is too long for interpolation and splits the record.

    Args:
        row: first row of the gap.
        rows: its number of rows.
        start, end: times of the readings before and after it, in the record's format.
        hours: between these readings.
        columns: the faces without a reading.
    """

    row: int
    rows: int
    start: str
    end: str
    hours: float
    columns: tuple[str, ...]

    def __str__(self) -> str:
        return f"{' and '.join(self.columns)}: no reading from {self.start} to {self.end} ({self.hours:.4g} h)"


@dataclass(frozen=True, eq=False)
class CleaningLog(ResultObject):
    """What was changed in a record while it was read.

    Args:
        read_as: the file's format in words; empty for plain CSV.
        steps: the changes of values and rows.
        breaks: where the record is split.
        faces: the columns of the left and the right face.
        regressors: the column of each further key.
        masked: for each column the times of its masked values, s since the record's first row, sorted.
        spikes: for each column with spikes their times, s since the record's first row, and their values in the
            column's unit after conversion (degC), (spike, 2).
    """

    read_as: str = ""
    steps: tuple[CleaningStep, ...] = ()
    breaks: tuple[RecordBreak, ...] = ()
    faces: tuple[str, str] = ("left", "right")
    regressors: Mapping[str, str] = field(default_factory=dict, repr=False)
    masked: Mapping[str, np.ndarray] = field(default_factory=dict, repr=False)
    spikes: Mapping[str, np.ndarray] = field(default_factory=dict, repr=False)

    def count(self, kind: str, column: str | None = None) -> int:
        """Number of values or rows changed by one kind of step, in a column (None: in all)."""
        return sum(step.count for step in self.steps if step.kind == kind and column in (None, step.column))

    @property
    def unchanged(self) -> bool:
        """Whether the record holds exactly the file's values."""
        return not self.steps and not self.breaks

    def lines(self) -> list[str]:
        """One line of text for each step, those of all columns first."""
        lines = [f"read as {self.read_as}"] if self.read_as else []
        lines += [str(step) for step in sorted(self.steps, key=lambda step: step.column != "")]
        if self.breaks:
            lines.append(f"split into {len(self.breaks) + 1} parts:")
            lines += [f"  {record_break}" for record_break in self.breaks]
        return lines

    def __str__(self) -> str:
        return "\n".join(self.lines()) or "nothing was changed"

    def to_frame(self) -> DataFrame:
        """One row for each change: `column` (empty for all), `kind`, `count`, `line` of the first one, and `text`."""
        import pandas as pd

        rows = [(step.column, step.kind, step.count, step.line, str(step)) for step in self.steps]
        rows += [(" and ".join(gap.columns), "break", gap.rows, None, str(gap)) for gap in self.breaks]
        frame = pd.DataFrame(rows, columns=["column", "kind", "count", "line", "text"])
        return frame.astype({"count": int, "line": "Int64"})

    def _html_title(self) -> str:
        return f"Read as {self.read_as}" if self.read_as else "Changes while reading"

    def to_dict(self) -> dict[str, Any]:
        """The entries of result.json."""
        return {
            "read_as": self.read_as or None,
            "done": [
                {
                    "column": step.column or None,
                    "kind": step.kind,
                    "count": step.count,
                    "line": step.line,
                    "example": step.example or None,
                }
                for step in self.steps
            ],
            "breaks": [
                {"start": gap.start, "end": gap.end, "hours": gap.hours, "columns": list(gap.columns)}
                for gap in self.breaks
            ],
        }
