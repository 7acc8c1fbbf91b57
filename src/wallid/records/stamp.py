"""The times of a record's rows, as they stand in its file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

STEP_TOLERANCE = 1e-3  # of the step: stamps rounded by the logger


@dataclass(frozen=True, eq=False)
class Stamps:
    """The rows' times, in the file's order.

    Args:
        seconds: since the first row, (time,).
        stamps: datetime64[ns] by the clock of `zone`, or s as in the file, (time,).
        zone: fixed offset of the stamps from UTC; None where none is given.
    """

    seconds: np.ndarray
    stamps: np.ndarray
    zone: str | None

    @property
    def may_jump(self) -> bool:
        """Whether this is a wall clock that may follow daylight saving."""
        return self.zone is None and np.issubdtype(self.stamps.dtype, np.datetime64)

    def __getitem__(self, rows: Any) -> Stamps:
        """Some rows; the seconds count from where they did."""
        return Stamps(self.seconds[rows], self.stamps[rows], self.zone)

    def show(self, row: int) -> str:
        """A row's time as a message shows it."""
        return show_stamp(self.stamps[row], self.zone)


def show_stamp(stamp: np.generic, zone: str | None) -> str:
    """A time as a message shows it: to the second where it has no fraction."""
    if not isinstance(stamp, np.datetime64):
        return f"{float(stamp):.15g} s"  # pyright: ignore[reportArgumentType]
    return str(stamp).removesuffix(".000000000") + (zone or "")
