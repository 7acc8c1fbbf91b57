"""Caption and alternative text of the figures of the wall and of the record."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .._internal.units import DAY
from ..models.flux_plates import fluxes_of
from ..plot.regressors import regressor_quantities
from ..records.uniform_record import REGRESSOR_UNITS
from .figures import shaded_window

if TYPE_CHECKING:
    from ..workflow import Run

_QUANTITIES = {
    "flux": "heat fluxes",
    "irradiance": "irradiance",
    "air": "air temperatures",
    "wind": "wind",
    "rain": "rain",
    "heating": "heating",
}


def wall_text(run: Run) -> str:
    """Alternative text of the figure of the wall."""
    wall = run.case.wall
    layers = f"{len(wall.layers)} layers" if wall.layers else "one material"
    if run.case.section is not None:
        layers = " and ".join(material.name for material in run.case.section.materials)
    sensors = ", ".join(f"{sensor.name} at {1e3 * sensor.position:.4g} mm" for sensor in run.case.sensors) or "none"
    plates = " and ".join(fluxes_of(run.case))
    return (
        f"Section of the wall, {wall.length:g} m of {layers}, outside on the {wall.outside}; sensors: {sensors}"
        + (f"; heat flux plates on the {plates}" if plates else "")
        + "."
    )


def wall_caption(run: Run) -> str:
    """Caption of the figure of the wall."""
    plates = "; heat flux plates are drawn thicker than they are" if fluxes_of(run.case) else ""
    scale = "to scale" if run.case.section is not None else "to scale along x"
    return f"The wall in section, {scale}, with the positions of the sensors{plates}."


def record_text(run: Run) -> str:
    """Alternative text of the figure of the record."""
    record = run.case.record
    faces = record.faces[~record.broken]
    low, high = faces.min(axis=0), faces.max(axis=0)
    begin = f" from {record.stamp(0)}" if record.start.stamp is not None else ""
    days = f"{record.duration / DAY:.3g} days{begin}"
    sensors = f"{len(record.names)} inner sensor{'' if len(record.names) == 1 else 's'}"
    return (
        f"Temperatures over {days}: left face {low[0]:.1f} to {high[0]:.1f} degC, right face "
        f"{low[1]:.1f} to {high[1]:.1f} degC, {sensors}{_regressor_ranges(run)}{_removed_spikes(run)}"
        + ("; below, the available readings of each." if run.check is not None else _window_text(run))
    )


def _regressor_ranges(run: Run) -> str:
    """The range of each further column, as text."""
    texts = []
    for name, values in run.case.record.regressors.items():
        if np.isfinite(values).any():
            unit = "" if REGRESSOR_UNITS[name] is None else f" {REGRESSOR_UNITS[name]}"
            texts.append(f"; {name.replace('_', ' ')} {np.nanmin(values):.3g} to {np.nanmax(values):.3g}{unit}")
    return "".join(texts)


def _removed_spikes(run: Run) -> str:
    """The number of marked spikes, as text; empty where the figure marks none."""
    count = sum(len(spikes) for spikes in run.case.record.cleaning.spikes.values())
    return f"; {count} removed spike{'' if count == 1 else 's'}" if run.check is not None and count else ""


def _window_text(run: Run) -> str:
    return "." if shaded_window(run) is None else "; the window used is shaded."


def record_caption(run: Run) -> str:
    """Caption of the figure of the record."""
    if run.check is not None:
        spikes = (
            " Crosses and triangles: removed spikes; a triangle points to a value that is farther away."
            if _removed_spikes(run)
            else ""
        )
        return (
            f"Logged temperatures{_regressor_names(run)}, and the available readings of each column. Orange: "
            "interpolated face temperatures. Black marks: missing or masked readings. Grey: breaks of the record."
            f"{spikes}"
        )
    window = "" if shaded_window(run) is None else " The yellow band is the window used."
    broken = (
        " A grey band is a break of the record, where a face has no readings for too long to interpolate."
        if len(run.case.record.unbroken_parts) > 1
        else ""
    )
    return f"Logged temperatures{_regressor_names(run)}.{window}{broken}"


def _regressor_names(run: Run) -> str:
    """The quantities below the temperatures, as text."""
    names = [_QUANTITIES[quantity] for quantity in regressor_quantities(run.case)]
    return f"; below, {', '.join(names)}" if names else ""
