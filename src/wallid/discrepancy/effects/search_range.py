"""Where and when in a record effects are looked for: places inside the wall, times of rain, temperatures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...records.uniform_record import Record


@dataclass(frozen=True)
class Search:
    """What bounds a search for places, times and temperatures.

    Args:
        length: of the wall, m.
        clear: from each face to the sensor nearest to it, m.
        places: candidates for interfaces, m, between the outermost sensors.
        duration: of the record, s.
        rain: when the largest rains began, s since the first row; empty where no rain was logged.
        coldest, warmest: of all readings, degC.
    """

    length: float
    clear: tuple[float, float]
    places: tuple[float, ...]
    duration: float
    rain: tuple[float, ...]
    coldest: float
    warmest: float


def record_search(record: Record, positions: tuple[float, ...], length: float, count: int = 9) -> Search:
    """Where and when to look in this record.

    Interfaces are looked for between the outermost sensors; nearer to a face they are a film by another name. With
    a single sensor the middle half of the wall serves.
    """
    low, high = (min(positions), max(positions)) if len(positions) > 1 else (0.25 * length, 0.75 * length)
    margin = 0.04 * (high - low)
    places = [low + margin + (high - low - 2 * margin) * i / (count - 1) for i in range(count)]
    inner = record.sensors[~np.isnan(record.sensors)] if record.sensors.size else record.faces.ravel()
    return Search(
        length=length,
        clear=(float(min(positions)), float(length - max(positions))),
        places=tuple(float(place) for place in places),
        duration=record.duration,
        rain=_rain_onsets(record),
        coldest=float(min(record.faces.min(), inner.min())),
        warmest=float(max(record.faces.max(), inner.max())),
    )


def _rain_onsets(record: Record, most: int = 8, pause: float = 3 * 3600.0) -> tuple[float, ...]:
    """When the largest rain events began, s since the first row: rain after hours without."""
    rain = record.regressors.get("rain")
    if rain is None:
        return ()
    wet = np.flatnonzero(np.nan_to_num(rain) > 0.05)
    if not len(wet):
        return ()
    time = record.time
    starts = np.concatenate([[True], np.diff(time[wet]) > pause])
    event = np.cumsum(starts) - 1
    amount = np.bincount(event, weights=rain[wet])
    onsets = time[wet[starts]]
    largest = np.sort(np.argsort(-amount)[:most])
    return tuple(float(onset) for onset in onsets[largest])
