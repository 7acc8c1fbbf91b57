"""Mix-ups of columns, units, places and clocks, each with the readings as they are without it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ...case.case_definition import Case
from ...case.mixups import FACE_COLUMNS, Mixup, MixupKind
from ...records.uniform_record import Record

_HOUR = 3600.0


@dataclass(frozen=True, eq=False)
class Correction:
    """A mix-up, and the readings without it.

    Args:
        mixup: what was mixed up.
        record: the rows used, corrected; NaN where the correction leaves no reading of a sensor or plate.
    """

    mixup: Mixup
    record: Record

    def applied_to(self, case: Case) -> Case:
        """The case with the corrected readings of the rows used."""
        return replace(case, record=self.record, choices=replace(case.choices, diagnose_days=None))


@dataclass(frozen=True, eq=False)
class ClockCorrection(Correction):
    """A correction of a clock: the column, the hours and the first row at which it is wrong."""

    target: str
    hours: int
    row: int


def rearranged(case: Case, record: Record) -> Iterator[Correction]:
    """Faces or sensors in another order."""
    sensors, names, plates = record.sensors, record.names, _plates(record)
    mirrored = "all positions are counted from the right face: count them from the left one"
    exchanged = "the two faces are exchanged: exchange [record] left and right"
    kind, first, second = _faces_or_positions(case, record, exchanged, mirrored)
    words = f"{first} (or, which gives the same readings, {second})" if names and not plates else exchanged
    kind = kind if names and not plates else "faces"
    yield Correction(Mixup(kind, ("left", "right"), words), replace(record, faces=record.faces[:, ::-1]))
    if len(plates) == 2:
        words = "the two plates are exchanged: exchange [record] flux_left and flux_right"
        left, right = (record.regressors[name] for name in plates)
        exchanged_plates = with_column(with_column(record, plates[0], right), plates[1], left)
        yield Correction(Mixup("exchanged", tuple(plates), words), exchanged_plates)
    if len(names) > 2:
        words = "the sensors are stated in the reverse order: reverse their columns, or their positions"
        yield Correction(Mixup("order", names, words), replace(record, sensors=sensors[:, ::-1]))
    for one, other in combinations(range(len(names)), 2):
        swapped = sensors.copy()
        swapped[:, [one, other]] = swapped[:, [other, one]]
        pair = (names[one], names[other])
        words = f"{pair[0]} and {pair[1]} are exchanged: exchange their columns, or their positions"
        yield Correction(Mixup("exchanged", pair, words), replace(record, sensors=swapped))


def _faces_or_positions(case: Case, record: Record, exchanged: str, mirrored: str) -> tuple[MixupKind, str, str]:
    """Which of the two is more likely: the outer face has the larger daily range where an outer face is known."""
    outside = ("left", "right").index(case.wall.outside)
    ranges = np.ptp(np.diff(record.faces, axis=0), axis=0)
    if ranges[1 - outside] > ranges[outside]:
        return "faces", exchanged, mirrored
    return "mirrored", mirrored, exchanged


def other_units(record: Record) -> Iterator[Correction]:
    """One column in degrees Fahrenheit or in kelvin."""
    for unit, scale, offset in (("degF", 1.8, 32.0), ("K", 1.0, 273.15)):
        for name in (*FACE_COLUMNS, *record.names):
            corrected = with_column(record, name, (_column(record, name) - offset) / scale)
            yield Correction(Mixup("unit", (name,), f"{name} is in {unit}: convert the column to degC"), corrected)


def _column(record: Record, name: str) -> np.ndarray:
    """The readings of a face or of an inner sensor, degC, or of a plate, W/m2, `(time,)`."""
    if name in FACE_COLUMNS:
        return record.faces[:, FACE_COLUMNS.index(name)]
    if name in record.regressors:
        return record.regressors[name]
    return record.sensors[:, record.names.index(name)]


def with_column(record: Record, name: str, values: np.ndarray) -> Record:
    """The record with other values in one column."""
    if name in record.regressors:
        return replace(record, regressors={**record.regressors, name: values})
    faces, sensors = record.faces.copy(), record.sensors.copy()
    if name in FACE_COLUMNS:
        faces[:, FACE_COLUMNS.index(name)] = values
    else:
        sensors[:, record.names.index(name)] = values
    return replace(record, faces=faces, sensors=sensors)


def other_clock(record: Record, target: str, hours: int, row: int) -> ClockCorrection:
    """A column whose clock is some hours late from a row on; with no target every inner sensor's.

    Where the record ends before the corrected time, a face keeps its nearest value and the other instruments have no
    readings.
    """
    rows, shift = np.arange(record.rows), hours * _HOUR / record.step
    source = np.where(rows >= row, rows + shift, rows)
    inside = (source <= record.rows - 1) & (source >= np.where(rows >= row, row, 0))
    corrected = record
    for name in (target,) if target else record.names:
        values = _column(record, name)
        present = np.isfinite(values)
        if not present.any():
            continue
        shifted = np.interp(source, rows[present], values[present])
        if name not in FACE_COLUMNS:
            shifted[~inside | (np.interp(source, rows, present.astype(float)) < 1.0)] = np.nan
        corrected = with_column(corrected, name, shifted)
    if target in FACE_COLUMNS:
        sensors = np.where(inside[:, None], record.sensors, np.nan)
        plates = {name: np.where(inside, record.regressors[name], np.nan) for name in _plates(record)}
        corrected = replace(corrected, sensors=sensors, regressors={**record.regressors, **plates})
    late = f"{abs(hours)} h {'late' if hours > 0 else 'early'}"
    since = "" if row == 0 else f" from {record.stamp(row)} on"
    whose = f"the clock of {target} is" if target else "the clock of every inner sensor is"
    words = f"{whose} {late}{since}: correct its times"
    return ClockCorrection(Mixup("clock", (target,) if target else record.names, words), corrected, target, hours, row)


def _plates(record: Record) -> list[str]:
    """The columns of the record's heat flux plates."""
    return [name for name in record.regressors if name.startswith("flux_")]


def lengths_in(case: Case, metres: float) -> Case:
    """The case with its lengths taken in another unit."""
    wall = replace(
        case.wall,
        length=metres * case.wall.length,
        layers=tuple(replace(layer, thickness=metres * layer.thickness) for layer in case.wall.layers),
    )
    sensors = tuple(
        replace(sensor, position=metres * sensor.position, position_std=metres * sensor.position_std)
        for sensor in case.sensors
    )
    return replace(case, wall=wall, sensors=sensors)
