"""Windows of a record: consecutive rows without a break."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from .._internal.errors import InputError
from .._internal.units import DAY
from ..records.table_columns import FEWEST_ROWS
from .case_definition import Case

STILL = 1e-6  # K: a face that moves less did not move


@dataclass(frozen=True)
class Window:
    """Consecutive rows of a record.

    Args:
        row: the first.
        rows: how many.
    """

    row: int
    rows: int

    @property
    def part(self) -> slice:
        """These rows of the record's arrays."""
        return slice(self.row, self.row + self.rows)


@runtime_checkable
class HasBest(Protocol):
    """A design: what chose a window."""

    @property
    def best(self) -> Window:
        """The chosen window."""
        ...


def as_window(window: Window | HasBest) -> Window:
    """The window itself, or a design's best one."""
    return window if isinstance(window, Window) else window.best


def whole(case: Case) -> Window:
    """The whole record, or the longest of its parts where it is broken."""
    return Window(*case.record.longest_part)


def diagnosed(case: Case) -> Window:
    """The rows that a diagnosis uses: `diagnose_days` from the beginning of the whole record (see `whole`)."""
    part, days = whole(case), case.choices.diagnose_days
    return part if days is None else Window(part.row, min(case.record.rows_per(days), part.rows))


def check_unbroken(case: Case, window: Window) -> None:
    """Refuse a window across a break of the record.

    Raises:
        InputError: one of its rows is broken.
    """
    record = case.record
    inside = window.row >= 0 and window.row + window.rows <= record.rows  # or else Record.window will say so
    if inside and not record.holds(window.row, window.rows):
        first = next(b for b in record.cleaning.breaks if b.row + b.rows > window.row)
        raise InputError(
            f"{record.file}: a window of {window.rows} rows from {record.stamp(window.row)} lies across a break of the "
            f"record ({first}); take another window, or state a longer [record] longest_gap (hours)"
        )


def window_rows(case: Case, days: float) -> int:
    """How many rows a window of so many days has; all of a record that holds one row more.

    Raises:
        InputError: more than the record holds without a break, or too few to tell anything.
    """
    rows, most = case.record.rows_per(days), whole(case).rows
    if not FEWEST_ROWS <= rows <= most:
        own = (
            "the record's own"
            if most == case.record.rows
            else (
                f"those of its longest unbroken part ({most * case.record.step / DAY:.4g} days; a longer [record] "
                "longest_gap breaks it less)"
            )
        )
        raise InputError(
            f"window_days = {days:g} makes {rows} rows of {case.record.step:g} s; it must make {FEWEST_ROWS} to "
            f"{most}, {own}"
        )
    return case.record.rows if case.record.rows - rows == 1 else rows
