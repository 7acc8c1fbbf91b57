"""The times of a record's rows, as in its file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from pandas import Index

STEP_TOLERANCE = 1e-3  # of the step: loggers round their times


@dataclass(frozen=True, eq=False)
class RowTimes:
    """The times of rows.

    Args:
        seconds: since the file's first row, (time,).
        stamps: datetime64[ns] in local time of `zone`, or s as in the file, (time,).
        zone: fixed offset of the stamps from UTC; None where the file states none.
    """

    seconds: np.ndarray
    stamps: np.ndarray
    zone: str | None

    @property
    def may_have_daylight_saving(self) -> bool:
        """Whether these are local times without a zone, which may follow daylight saving."""
        return self.zone is None and np.issubdtype(self.stamps.dtype, np.datetime64)

    def __getitem__(self, rows: Any) -> RowTimes:
        """The times of some rows; `seconds` keep their origin."""
        return RowTimes(self.seconds[rows], self.stamps[rows], self.zone)

    def format(self, row: int) -> str:
        """A row's time as text, for messages."""
        return format_time(self.stamps[row], self.zone)


@dataclass(frozen=True)
class RecordStart:
    """When a record begins: the origin of times that count from its first row.

    Args:
        stamp: time of the first row, in local time of `zone`; None where the times are plain seconds.
        zone: fixed offset of the stamp from UTC, such as "+01:00" or "Z"; None where the file states none.
    """

    stamp: np.datetime64 | None = None
    zone: str | None = None

    def index_after(self, seconds: np.ndarray) -> Index:
        """The index of a DataFrame whose rows are these seconds after the start; the seconds where no date is known."""
        if self.stamp is None:
            return time_index(seconds, None)
        stamps = self.stamp.astype("datetime64[ns]") + np.round(seconds * 1e9).astype("timedelta64[ns]")
        return time_index(stamps, self.zone)


def time_index(stamps: np.ndarray, zone: str | None) -> Index:
    """The index of a DataFrame with one row for each time.

    Args:
        stamps: datetime64 in local time of `zone`, or s, (time,).
        zone: fixed offset of the stamps from UTC; None where the file states none.
    """
    import pandas as pd

    if not np.issubdtype(stamps.dtype, np.datetime64):
        return pd.Index(stamps, name="time (s)")
    index = pd.DatetimeIndex(stamps, name="time")
    return index if zone is None else index.tz_localize("UTC" if zone == "Z" else zone)


def format_time(stamp: np.generic, zone: str | None) -> str:
    """A time as text; without a fraction of a second where it is zero."""
    if not isinstance(stamp, np.datetime64):
        return f"{float(stamp):.15g} s"  # pyright: ignore[reportArgumentType]
    return str(stamp).removesuffix(".000000000") + (zone or "")
