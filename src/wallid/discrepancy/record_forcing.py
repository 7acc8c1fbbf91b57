"""The forcing data of a record."""

from __future__ import annotations

import numpy as np
import scipy

from .._internal.arrays import on_device
from .._internal.units import DAY
from ..case.case_definition import Case
from ..models.finite_volume_wall import wall_cells
from ..records.uniform_record import Record
from .effects.equation_terms import ForcingData

_NODES = 61


def forcing_of_record(case: Case, record: Record) -> ForcingData:
    """The forcing data of a record: monotone cubics between its rows, and the cells of the wall.

    Args:
        case: the wall and its sensors.
        record: the rows used.
    """
    rows = np.arange(record.rows)

    def cubic(values: np.ndarray) -> np.ndarray:
        present = np.isfinite(values)
        filled = values if present.all() else np.interp(rows, rows[present], values[present])
        return scipy.interpolate.PchipInterpolator(rows, filled).c[::-1].T  # powers of s, (interval, power)

    zeros = np.zeros(record.rows)

    def regressor(key: str) -> np.ndarray:
        values = record.regressors.get(key)
        return cubic(zeros if values is None or not np.isfinite(values).any() else values)

    heating = record.regressors.get("heating", zeros)
    largest = np.nanmax(np.abs(heating)) if np.isfinite(heating).any() else 0.0
    positions, resistance, capacity = (case.wall.length * part for part in wall_cells(case.wall, _NODES))
    temperatures = np.concatenate([record.faces.ravel(), record.sensors.ravel()])
    return ForcingData(
        step=on_device(record.step),
        faces=on_device(np.stack([cubic(record.faces[:, side]) for side in (0, 1)], axis=-1)),
        irradiance=on_device(regressor("irradiance")),
        outdoor=on_device(regressor("air_outdoor")),
        indoor=on_device(regressor("air_indoor")),
        heating=on_device(regressor("heating") / (largest or 1.0)),
        hour=on_device(_hours(record)[:-1]),
        start_profile=on_device(record.faces[0]),
        reference=on_device(np.nanmean(temperatures)),
        node_positions=on_device(positions),
        resistance=on_device(resistance),
        capacity=on_device(capacity),
        sensor_positions=on_device(np.array([sensor.position for sensor in case.sensors])),
        length=on_device(case.wall.length),
    )


def _hours(record: Record) -> np.ndarray:
    """Hour of the day of each row by the clock of the record; hours since the first row where it has only seconds."""
    stamps = record.stamps
    if np.issubdtype(stamps.dtype, np.datetime64):
        since = (stamps - stamps.astype("datetime64[D]")) / np.timedelta64(1, "s")
        return np.asarray(since, float) / 3600.0
    return np.mod(np.asarray(stamps, float), DAY) / 3600.0
