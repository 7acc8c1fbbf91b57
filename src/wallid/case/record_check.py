"""What a case's record holds, and what would stop a run, before anything is computed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .._internal.errors import InputError
from ..records.uniform_record import Record
from .case_definition import Case
from .time_window import STILL, whole, window_rows

_EARLY = 0.05  # of the record: a sensor whose last reading is so long before its end has died
_FEW = 0.5  # of a sensor's readings
_MANY_MASKED = 0.02
_WEAK = 5.0  # times the sensors' noise


@dataclass(frozen=True)
class Check:
    """What would stop a run on a case, and what a person may want to know before it.

    Args:
        stops: a sentence each, with the way out; none where a run can go ahead.
        notes: what does not stop it.
    """

    stops: tuple[str, ...]
    notes: tuple[str, ...]

    def __str__(self) -> str:
        lines = [f"note         {note}" for note in self.notes]
        lines += [f"STOPS A RUN  {stop}" for stop in self.stops]
        return "\n".join([*lines, *([] if self.stops else ["check        nothing would stop a run"])])


def check(case: Case) -> Check:
    """Look through a case's record without computing anything."""
    return Check(tuple(_stops(case)), tuple(_notes(case)))


def _stops(case: Case) -> list[str]:
    record, found = case.record, []
    try:
        rows = window_rows(case, case.choices.window_days)
    except InputError as error:
        found.append(f"[choices] {error}")
    else:
        if case.sensors and not _has_readings(record, rows):
            found.append(
                f"no unbroken window of {case.choices.window_days:g} days holds a reading of an inner sensor: "
                f"log the sensors and the faces together, or take another [choices] window_days"
            )
    if not case.sensors and not {"flux_left", "flux_right"} & set(record.regressors):
        found.append("no [[sensor]] and no flux: a temperature inside the wall or a heat flux is needed")
    if all(np.ptp(face) < STILL for face in record.faces[~record.broken].T):
        found.append("neither face moves, so nothing can be told about the wall: log it over days with weather")
    return found


def _has_readings(record: Record, rows: int) -> bool:
    """Whether an inner sensor has a reading in any window of so many rows."""
    count = np.concatenate([[0], np.cumsum(np.isfinite(record.sensors).any(axis=1))])
    starts = np.arange(record.rows - rows + 1)
    return bool(np.any(record.holds(starts, rows) & (count[starts + rows] > count[starts])))


def _notes(case: Case) -> list[str]:
    record, found = case.record, []
    there = np.isfinite(record.sensors)
    for s, sensor in enumerate(case.sensors):
        seen = np.flatnonzero(there[:, s])
        if not len(seen):
            found.append(f"{sensor.name} has no reading on the record's rows: it adds nothing")
            continue
        if record.rows - seen[-1] > 2 * np.median(np.diff(seen, prepend=0)) + _EARLY * record.rows:
            found.append(f"{sensor.name} has its last reading at {_word(record, int(seen[-1]))}")
        spacing = np.median(np.diff(seen)) if len(seen) > 1 else 1.0
        if len(seen) * spacing < _FEW * record.rows:
            found.append(f"{sensor.name} has readings in {len(seen)} of {record.rows} rows")
    done = record.cleaning
    for column, times in done.masked.items():
        if len(times) > _MANY_MASKED * record.rows:
            found.append(f"{column}: {len(times)} values were masked; look at them in the figure of the record")
    if case.sensors:
        moves = max(float(np.ptp(face)) for face in record.faces[~record.broken].T)
        noise = min(sensor.noise_std for sensor in case.sensors)
        if moves < _WEAK * noise:
            found.append(
                f"the faces move by {moves:.3g} K in all, and the sensors' noise is {noise:g} K: a run may find no "
                "number to rely on"
            )
    else:
        found.append("no sensor inside the wall: what is found must come from the heat flux")
    if len(record.unbroken) > 1:
        part = whole(case)
        found.append(
            f"the record is broken {len(done.breaks)} time(s): windows lie between the breaks, and the whole record "
            f"means the longest part, {part.rows} rows from {_word(record, part.row)}"
        )
    return found


def _word(record: Record, row: int) -> str:
    stamp = record.stamp(row)
    return stamp if isinstance(stamp, str) else f"{stamp:.15g} s"


def describe(record: Record) -> dict[str, Any]:
    """A record for result.json: its rows, what is missing, and what was done to it."""
    missing = np.isnan(record.sensors).sum(axis=0)
    return {
        "rows": record.rows,
        "step_s": record.step,
        "start": record.stamp(0),
        "end": record.stamp(record.rows),
        "parts": [
            {"start": record.stamp(row), "end": record.stamp(row + rows), "rows": rows} for row, rows in record.unbroken
        ],
        "missing": {name: int(count) for name, count in zip(record.names, missing, strict=True)},
        **record.cleaning.as_dict(),
    }
