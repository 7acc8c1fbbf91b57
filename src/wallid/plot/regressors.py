"""Figures of the further columns of a record: heat fluxes, irradiance, air temperatures, wind, rain and heating."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ..case.case_definition import Case
from ..case.wall_and_sensors import SIDES
from ..records.reading_pipeline import PLATES
from .house_style import FACE_COLOURS, ORANGE, PURPLE, SKY, axes_or_new
from .legends import legend_above
from .logged_record import downsampled, is_sparse
from .time_axis import TimeAxis

_COLUMNS = {
    "flux": PLATES,
    "irradiance": ("irradiance",),
    "air": ("air_outdoor", "air_indoor"),
    "wind": ("wind",),
    "rain": ("rain",),
    "heating": ("heating",),
}
_LABELS = {
    "flux": "heat flux\n(W/m²)",
    "irradiance": "irradiance\n(W/m²)",
    "air": "air (°C)",
    "wind": "wind (m/s)",
    "rain": "rain (mm/h)",
    "heating": "heating (W)",
}
_NAMES = {
    "flux_left": "left plate, positive along +x",
    "flux_right": "right plate, positive along +x",
    "irradiance": "irradiance on the outer face",
    "air_outdoor": "outdoor air",
    "air_indoor": "indoor air",
}
_COLOURS = {"irradiance": ORANGE, "wind": SKY, "rain": SKY, "heating": PURPLE}


def regressor_quantities(case: Case) -> list[str]:
    """The quantities that `regressors` can draw: of "flux", "irradiance", "air", "wind", "rain" and "heating"."""
    return [quantity for quantity, columns in _COLUMNS.items() if set(columns) & set(case.record.regressors)]


def regressors(case: Case, quantity: str, *, ax: Axes | None = None) -> Axes:
    """The columns of one quantity over the entire record.

    Args:
        quantity: one of `regressor_quantities(case)`.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.

    Raises:
        ValueError: the record has no column of this quantity.
    """
    if quantity not in (known := regressor_quantities(case)):
        raise ValueError(f"quantity {quantity!r}: the record has {', '.join(known) or 'no further columns'}")
    ax = axes_or_new(ax)
    axis, label = TimeAxis(case.record.start), _LABELS[quantity]
    days = axis.at(case.record.days)
    for column in _COLUMNS[quantity]:
        if (values := case.record.regressors.get(column)) is None:
            continue
        sparse = is_sparse(values)
        rows = np.isfinite(values) if sparse else slice(None)  # a missing value breaks the line
        shown: dict[str, Any] = {"marker": "o", "ms": 2.5, "mew": 0, "ls": "none"} if sparse else {"lw": 0.8}
        line = _line(case, column) | shown
        ax.plot(*downsampled(days[rows], np.asarray(values)[rows]), label=_NAMES.get(column, column), **line)
        if column == "heating" and not np.nanmax(values, initial=0.0) > 1.0:
            label = "heating (0 to 1)"
    ax.set(ylabel=label)
    axis.apply(ax)
    legend_above(ax)
    return ax


def _line(case: Case, column: str) -> dict[str, Any]:
    """Colour and line style of a column: fluxes and air temperatures have the colour of their face."""
    if column in _COLOURS:
        return {"color": _COLOURS[column]}
    side = {
        "flux_left": "left",
        "flux_right": "right",
        "air_outdoor": case.wall.outside,
        "air_indoor": case.wall.inside,
    }
    return {"color": FACE_COLOURS[SIDES.index(side[column])], "ls": "-" if column.startswith("flux") else "--"}
