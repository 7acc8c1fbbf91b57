"""The abscissa of a record's rows: dates where the record has them, days since its start where its times are s."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter, date2num

from ..records.row_times import RecordStart
from .legends import root_figure

_FEWEST_TICKS, _MOST_TICKS = 5, 9  # with fewer than five, the locator has no interval for some lengths
_TICK_WIDTH = 0.55  # inches, of a label such as "12:00" with its distance to the next


@dataclass(frozen=True)
class TimeAxis:
    """The abscissa of times that count from the start of a record.

    Args:
        start: when the record begins.
    """

    start: RecordStart

    def at(self, days: np.ndarray | float) -> np.ndarray:
        """Abscissae, days: matplotlib's date numbers, or the given days where the record has no dates.

        Args:
            days: since the start of the record.
        """
        origin = 0.0 if self.start.stamp is None else float(date2num(self.start.stamp))
        return origin + np.asarray(days, float)

    @property
    def label(self) -> str:
        """The label of the axis, with the zone where the record states one."""
        if self.start.stamp is None:
            return "days since the start of the record"
        if self.start.zone is None:
            return "time"
        return f"time (UTC{self.start.zone.removeprefix('Z')})"

    def apply(self, ax: Axes) -> None:
        """Set label and ticks of the abscissa; dates are in the record's own zone, whatever the reader's settings."""
        ax.set_xlabel(self.label)
        if self.start.stamp is None:
            return
        inches = ax.get_window_extent().width / root_figure(ax).dpi
        most = int(np.clip(inches / _TICK_WIDTH, _FEWEST_TICKS, _MOST_TICKS))
        locator = AutoDateLocator(tz=UTC, minticks=2, maxticks=most)
        ax.xaxis.set_major_locator(locator)
        ax.xaxis.set_major_formatter(ConciseDateFormatter(locator, tz=UTC))
