"""What was done to a record while it was read: how many values of which column, and where the first one stands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

_WORDS = {
    "converted": "{count} values converted from {example}",
    "marked": "{count} cells with a sign for a missing value ({example} in line {line})",
    "text": "{count} cells of text masked ({example} in line {line})",
    "infinite": "{count} values over range masked (line {line})",
    "impossible": "{count} impossible values masked ({example} in line {line})",
    "spike": "{count} spikes masked (from {example} in line {line})",
    "stuck": "{count} stuck readings masked ({example} from line {line})",
    "repeated": "{count} rows given twice left out (line {line})",
    "averaged": "{count} rows averaged with others of the same time (line {line})",
    "dropped": "{count} rows without a time and a reading left out (line {line})",
    "sorted": "{count} rows put in order (line {line})",
    "snapped": "{count} rows moved by up to {example} onto the grid",
    "binned": "{count} readings averaged, several to a row",
    "carried": "{count} readings carried by up to {example} onto their row",
    "stranded": "{count} readings between rows masked: no neighbour near enough (line {line})",
    "between": "{count} rows between the column's own readings interpolated",
    "filled": "{count} rows in {example} interpolated",
    "trimmed": "{count} rows at the ends left out, where not both faces have a reading",
}
"""Kinds of `Noted`, and how a person is told."""
_MANY = ("values", "cells", "spikes", "stuck readings", "rows", "readings")


@dataclass(frozen=True)
class Noted:
    """One thing that was done to a column.

    Args:
        column: its name; empty for the whole record.
        kind: a key such as "spike".
        count: of values or rows.
        line: of the first one in the file; None where that says nothing.
        example: the first one as it stands there, or what else belongs to the kind.
    """

    column: str
    kind: str
    count: int
    line: int | None = None
    example: str = ""

    def __str__(self) -> str:
        words = _WORDS[self.kind].format(count=self.count, line=self.line, example=self.example)
        if self.count == 1:
            for many in _MANY:
                words = words.replace(f"1 {many}", f"1 {many[:-1]}", 1)
        return f"{self.column}: {words}" if self.column else words


@dataclass(frozen=True)
class Break:
    """A stretch without a face: the record goes on in another part after it.

    Args:
        row, rows: the broken rows.
        start, end: the readings at its ends, in the record's format.
        hours: between them.
        columns: the faces that have no reading.
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
class Cleaning:
    """What was done to a record while it was read.

    Args:
        file: how the file is written, in words; empty where it is plain.
        noted: what was done to which column.
        breaks: where the record was split.
        faces: the columns of the left and the right face.
        masked: when each column's masked values were logged, s since the record's first row.
    """

    file: str = ""
    noted: tuple[Noted, ...] = ()
    breaks: tuple[Break, ...] = ()
    faces: tuple[str, str] = ("left", "right")
    masked: Mapping[str, np.ndarray] = field(default_factory=dict, repr=False)

    def count(self, kind: str, column: str | None = None) -> int:
        """How many values of a column (None: of all) something was done to."""
        return sum(one.count for one in self.noted if one.kind == kind and column in (None, one.column))

    @property
    def untouched(self) -> bool:
        """Whether the record is as the file has it."""
        return not self.noted and not self.breaks

    def lines(self) -> list[str]:
        """One line for each thing that was done, the whole record's first."""
        found = [f"read as {self.file}"] if self.file else []
        found += [str(one) for one in sorted(self.noted, key=lambda one: one.column != "")]
        if self.breaks:
            found.append(f"split into {len(self.breaks) + 1} parts:")
            found += [f"  {one}" for one in self.breaks]
        return found

    def __str__(self) -> str:
        return "\n".join(self.lines()) or "nothing was changed"

    def as_dict(self) -> dict[str, Any]:
        """For result.json."""
        return {
            "read_as": self.file or None,
            "done": [
                {
                    "column": one.column or None,
                    "kind": one.kind,
                    "count": one.count,
                    "line": one.line,
                    "example": one.example or None,
                }
                for one in self.noted
            ],
            "breaks": [
                {"start": one.start, "end": one.end, "hours": one.hours, "columns": list(one.columns)}
                for one in self.breaks
            ],
        }


class Notes:
    """Collects what is done to a record while it is read.

    Args:
        seconds: of the rows that masks are given for, (time,).
    """

    def __init__(self, seconds: np.ndarray):
        self.seconds = seconds
        self.noted: list[Noted] = []
        self.masked: dict[str, list[np.ndarray]] = {}

    def note(self, noted: Noted, masked: np.ndarray | None = None) -> None:
        """Remember one thing, and which rows lost their value by it."""
        self.noted.append(noted)
        if masked is not None:
            self.masked.setdefault(noted.column, []).append(self.seconds[masked])

    def cleaning(self, file: str, breaks: tuple[Break, ...], faces: tuple[str, str], origin: float) -> Cleaning:
        """All of it; times count from `origin`."""
        masked = {column: np.sort(np.concatenate(times)) - origin for column, times in self.masked.items()}
        return Cleaning(file, tuple(self.noted), breaks, faces, masked)
