"""The check of a case before a run: what makes a run impossible, and what is unusual in the record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .._internal.errors import InputError
from .._internal.result_object import ResultObject
from ..records.reading_pipeline import PLATES
from ..records.uniform_record import Record
from .case_definition import Case
from .mixups import doubtful_places, visible_mixups
from .time_window import MIN_FACE_RANGE, entire_record, window_rows

if TYPE_CHECKING:
    from pandas import DataFrame

_EARLY_END = 0.05  # share of the record; a sensor without a reading in so long a last part has failed
_FEW_READINGS = 0.5  # share of the readings that a sensor would have at its usual step
_MANY_MASKED = 0.02  # share of the rows
_MIN_SIGNAL_TO_NOISE = 5.0  # range of the face temperatures over the noise of the sensors


@dataclass(frozen=True)
class RecordCheck(ResultObject):
    """Result of the check of a case.

    Args:
        stops: reasons why a run is impossible, each with a remedy; empty where a run is possible.
        notes: unusual properties of the record with which a run is still possible.
    """

    stops: tuple[str, ...]
    notes: tuple[str, ...]

    def to_frame(self) -> DataFrame:
        """One row for each stop and note: `kind`, "stop" or "note", and `text`."""
        import pandas as pd

        rows = [("stop", stop) for stop in self.stops] + [("note", note) for note in self.notes]
        return pd.DataFrame(rows, columns=["kind", "text"])

    def _html_title(self) -> str:
        return f"Check: {len(self.stops)} reasons stop a run" if self.stops else "Check: nothing would stop a run"

    def __str__(self) -> str:
        lines = [f"note         {note}" for note in self.notes]
        lines += [f"STOPS A RUN  {stop}" for stop in self.stops]
        return "\n".join([*lines, *([] if self.stops else ["check        nothing would stop a run"])])


def check(case: Case) -> RecordCheck:
    """Check a case without a simulation."""
    return RecordCheck(tuple(_stops(case)), tuple(_notes(case)))


def _stops(case: Case) -> list[str]:
    record, stops = case.record, []
    try:
        rows = window_rows(case, case.choices.window_days)
    except InputError as error:
        stops.append(f"[choices] {error}")
    else:
        if case.sensors and not _has_readings(record, rows):
            stops.append(
                f"no unbroken window of {case.choices.window_days:g} days holds a reading of an inner sensor: "
                f"log the sensors and the faces at the same time, or change [choices] window_days"
            )
    if all(np.ptp(face) < MIN_FACE_RANGE for face in record.faces[~record.broken].T):
        stops.append("both face temperatures are constant, so the record has no information: log days with weather")
    if case.section is not None and (reason := case.section.why_not_estimated):
        stops.append(f"[section]: {reason}")
    return stops


def _has_readings(record: Record, rows: int) -> bool:
    """Whether any unbroken window with this number of rows has a reading of an inner sensor."""
    count = np.concatenate([[0], np.cumsum(np.isfinite(record.sensors).any(axis=1))])
    starts = np.arange(record.rows - rows + 1)
    return bool(np.any(record.contains_windows(starts, rows) & (count[starts + rows] > count[starts])))


def _notes(case: Case) -> list[str]:
    record, notes = case.record, []
    readings = dict(zip(record.names, record.sensors.T, strict=True))
    readings |= {key: flux for key, flux in record.regressors.items() if key in PLATES}
    for name, values in readings.items():
        rows = np.flatnonzero(np.isfinite(values))
        if not len(rows):
            notes.append(f"{name} has no reading in any row: it is not used")
            continue
        if record.rows - rows[-1] > 2 * np.median(np.diff(rows, prepend=0)) + _EARLY_END * record.rows:
            notes.append(f"{name} has its last reading at {_time_text(record, int(rows[-1]))}")
        spacing = np.median(np.diff(rows)) if len(rows) > 1 else 1.0
        if len(rows) * spacing < _FEW_READINGS * record.rows:
            notes.append(f"{name} has readings in {len(rows)} of {record.rows} rows")
    notes += [mixup.words for mixup in visible_mixups(case)] + doubtful_places(case)
    for column, times in record.cleaning.masked.items():
        if len(times) > _MANY_MASKED * record.rows:
            notes.append(f"{column}: {len(times)} values were masked; see the figure of the record")
    if case.sensors:
        face_range = max(float(np.ptp(face)) for face in record.faces[~record.broken].T)
        noise = min(sensor.noise_std for sensor in case.sensors)
        if face_range < _MIN_SIGNAL_TO_NOISE * noise:
            notes.append(
                f"the face temperatures vary by {face_range:.3g} K only, and the noise of the sensors is {noise:g} K: "
                "the estimate may be unreliable"
            )
    else:
        notes.append("no sensor inside the wall: the estimate uses the heat flux only")
    if len(record.unbroken_parts) > 1:
        longest = entire_record(case)
        notes.append(
            f"the record has {len(record.cleaning.breaks)} break(s): no window contains a break, and the longest "
            f"unbroken part ({longest.rows} rows from {_time_text(record, longest.row)}) is used as the entire record"
        )
    return notes


def _time_text(record: Record, row: int) -> str:
    stamp = record.stamp(row)
    return stamp if isinstance(stamp, str) else f"{stamp:.15g} s"


def describe_record(record: Record) -> dict[str, Any]:
    """The record in result.json: its rows, missing values and cleaning steps."""
    missing = np.isnan(record.sensors).sum(axis=0)
    return {
        "rows": record.rows,
        "step_s": record.step,
        "start": record.stamp(0),
        "end": record.stamp(record.rows),
        "parts": [
            {"start": record.stamp(row), "end": record.stamp(row + rows), "rows": rows}
            for row, rows in record.unbroken_parts
        ],
        "missing": {name: int(count) for name, count in zip(record.names, missing, strict=True)},
        **record.cleaning.to_dict(),
    }
