"""The ranges in which positions, times and temperatures of effects are searched."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...records.uniform_record import Record


@dataclass(frozen=True)
class SearchRange:
    """The ranges of the positions, times and temperatures of effects in a record.

    Args:
        length: length of the wall, m.
        face_clearance: distance from each face to the nearest inner sensor, m.
        interface_positions: candidate positions of interfaces, m, between the outermost instruments.
        duration: duration of the record, s.
        rain: starts of the largest rain events, s since the first row; empty where no rain was logged.
        coldest: lowest temperature of all readings, degC.
        warmest: highest temperature of all readings, degC.
    """

    length: float
    face_clearance: tuple[float, float]
    interface_positions: tuple[float, ...]
    duration: float
    rain: tuple[float, ...]
    coldest: float
    warmest: float


def search_range_of_record(
    record: Record, positions: tuple[float, ...], length: float, plates: tuple[float, ...] = (), count: int = 9
) -> SearchRange:
    """The search ranges for a record.

    Interfaces are searched between the outermost sensors and plates, because nearer to a face without a plate they act
    as a surface film. With one instrument they are searched in the middle half of the wall.

    Args:
        record: the rows used.
        positions: of the inner sensors, m.
        length: of the wall, m.
        plates: positions of the faces with a heat flux plate, m.
        count: number of candidate positions of interfaces.
    """
    instruments = (*positions, *plates)
    low, high = (min(instruments), max(instruments)) if len(instruments) > 1 else (0.25 * length, 0.75 * length)
    margin = 0.04 * (high - low)
    candidates = [low + margin + (high - low - 2 * margin) * i / (count - 1) for i in range(count)]
    present = np.isfinite(record.sensors)
    inner = record.sensors[present] if present.any() else record.faces.ravel()
    return SearchRange(
        length=length,
        face_clearance=(float(min(positions, default=length)), float(length - max(positions, default=0.0))),
        interface_positions=tuple(float(position) for position in candidates),
        duration=record.duration,
        rain=_rain_onsets(record),
        coldest=float(min(record.faces.min(), inner.min())),
        warmest=float(max(record.faces.max(), inner.max())),
    )


def _rain_onsets(record: Record, most: int = 8, pause: float = 3 * 3600.0) -> tuple[float, ...]:
    """Starts of the largest rain events, s since the first row; at least `pause` seconds without rain lie between."""
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
