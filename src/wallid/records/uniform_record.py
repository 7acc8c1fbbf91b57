"""What was logged: times, face temperatures, inner sensors, regressors."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import no_type_check

import numpy as np

from .._internal.errors import InputError
from .._internal.units import DAY
from .._internal.validation import number, settle
from .cleaning_log import Cleaning
from .file_format import Format, check_unit
from .reading_pipeline import read_parts

__all__ = ["REGRESSORS", "Format", "Record", "read_record"]

REGRESSORS = (
    "irradiance",  # W/m2, on the outer face
    "air_outdoor",  # degC
    "air_indoor",  # degC
    "wind",  # m/s
    "rain",  # mm/h
    "heating",  # 0..1, or W
    "flux_left",  # W/m2, positive along +x
    "flux_right",  # W/m2, positive along +x
)


@no_type_check
@dataclass(frozen=True, eq=False)
class Record:
    """What was logged at and in a wall, at a uniform step.

    Args:
        time: s since the first row, (time,).
        stamps: the rows' times as in the file: datetime64[ns] by the clock of `zone`, or s, (time,).
        zone: fixed offset of the stamps from UTC, such as "+01:00" or "Z"; None where none is given.
        faces: left and right face temperature, degC, (time, 2); interpolated where `fill_std` is not 0, and
            in broken rows no more than a placeholder, the straight line across.
        sensors: inner temperatures, degC, NaN where missing, (time, sensor).
        names: of the sensors.
        regressors: other columns by their keys in `REGRESSORS`, NaN where missing, (time,) each.
        boundary_noise_std: of the faces' readings, K.
        face_position_std: of the places where the faces' sensors sit, along x, m: one left of 0 by as much as another
            of the same kind may sit right of it.
        flux_noise_std: of the flux readings, W/m2; None where not stated.
        flux_gain_std: relative standard deviation of the flux sensors' gain; None where not stated.
        file: where it was read from, for messages.
        fill_std: standard error of interpolated faces, K: 0 where a face was read, infinite in broken rows,
            (time, 2); None where every row was read. Within one gap the errors go together: they are
            a bow, not noise.
        cleaning: what was done to the values while they were read.

    Raises:
        InputError: a standard deviation that is negative or not a number.
    """

    time: np.ndarray
    stamps: np.ndarray
    zone: str | None
    faces: np.ndarray
    sensors: np.ndarray
    names: tuple[str, ...]
    regressors: Mapping[str, np.ndarray] = field(default_factory=dict)
    boundary_noise_std: float = 0.1
    face_position_std: float = 0.0
    flux_noise_std: float | None = None
    flux_gain_std: float | None = None
    file: str = "record"
    fill_std: np.ndarray | None = None
    cleaning: Cleaning = field(default_factory=Cleaning)

    def __post_init__(self) -> None:
        settle(self, boundary_noise_std=number("boundary_noise_std", self.boundary_noise_std, "K", least=0.0))
        settle(self, face_position_std=number("face_position_std", self.face_position_std, "m", least=0.0))
        if self.flux_noise_std is not None:
            settle(self, flux_noise_std=number("flux_noise_std", self.flux_noise_std, "W/m2", above=0.0))
        if self.flux_gain_std is not None:
            settle(self, flux_gain_std=number("flux_gain_std", self.flux_gain_std, least=0.0))

    @cached_property
    def step(self) -> float:
        """Time from row to row, s."""
        return float(np.median(np.diff(self.time)))

    @property
    def rows(self) -> int:
        """How many rows."""
        return len(self.time)

    @property
    def duration(self) -> float:
        """From the first row to the last, s."""
        return float(self.time[-1] - self.time[0])

    @property
    def days(self) -> np.ndarray:
        """When each row was logged, days since the first, (time,)."""
        return np.asarray(self.time) / DAY

    def rows_per(self, days: float) -> int:
        """How many rows make so many days."""
        return max(1, round(days * DAY / self.step))

    @cached_property
    def faces_std(self) -> np.ndarray:
        """Standard deviation of the faces in each row, K, (time, 2): `boundary_noise_std`, or more where filled."""
        plain = np.full(self.faces.shape, self.boundary_noise_std)
        return plain if self.fill_std is None else np.maximum(plain, self.fill_std)

    @cached_property
    def broken(self) -> np.ndarray:
        """In which rows a face is missing for too long to be interpolated, (time,)."""
        if self.fill_std is None:
            return np.zeros(self.rows, bool)
        return np.asarray(np.isinf(self.fill_std).any(axis=1))

    @cached_property
    def unbroken(self) -> tuple[tuple[int, int], ...]:
        """The record's parts between its breaks: (first row, rows) of each; one where there is no break."""
        edges = np.flatnonzero(np.diff(np.concatenate([[0], (~self.broken).astype(int), [0]])))
        return tuple((int(a), int(b - a)) for a, b in zip(edges[::2], edges[1::2], strict=True))

    @property
    def longest_part(self) -> tuple[int, int]:
        """The longest of `unbroken`: (first row, rows); the earliest of equals."""
        return max(self.unbroken, key=lambda part: part[1])

    def holds(self, start_rows: np.ndarray | int, rows: int) -> np.ndarray:
        """Whether windows of so many rows lie in the record, no break in them."""
        start = np.asarray(start_rows)
        broken = np.concatenate([[0], np.cumsum(self.broken)])
        end = np.minimum(start + rows, self.rows)
        return (start >= 0) & (start + rows <= self.rows) & (broken[end] == broken[np.maximum(start, 0)])

    def window(self, start_row: int, rows: int) -> Record:
        """Consecutive rows as a record of their own, whose time restarts at 0.

        Raises:
            InputError: fewer than two rows, or rows that are not there.
        """
        if start_row < 0 or rows < 2 or start_row + rows > self.rows:
            raise InputError(
                f"{self.file}: a window of {rows} rows from row {start_row}; it must have at least 2 rows "
                f"and lie within the record's {self.rows}"
            )
        part = slice(start_row, start_row + rows)
        return replace(
            self,
            time=self.time[part] - self.time[start_row],
            stamps=self.stamps[part],
            faces=self.faces[part],
            sensors=self.sensors[part],
            regressors={key: values[part] for key, values in self.regressors.items()},
            fill_std=None if self.fill_std is None else self.fill_std[part],
            cleaning=self.cleaning if rows == self.rows else Cleaning(),
        )

    def stamp(self, row: int) -> str | float:
        """The time of a row in the record's own format; of the row after the last, one step later.

        Returns:
            ISO 8601 to the second, with the zone where there is one; or s where the file has s.

        Raises:
            InputError: a row that is not there.
        """
        if not 0 <= row <= self.rows:
            raise InputError(f"{self.file}: row {row}; it must lie between 0 and {self.rows}")
        beyond = row == self.rows
        stamp = self.stamps[row - beyond]
        if not isinstance(stamp, np.datetime64):
            return float(stamp) + beyond * self.step
        half_second = np.timedelta64(500_000_000, "ns")  # so that the cut to seconds rounds
        stamp = stamp + beyond * np.timedelta64(round(self.step * 1e9), "ns") + half_second
        return f"{np.datetime_as_string(stamp, unit='s')}{self.zone or ''}"

    def stamp_at(self, seconds: float) -> str | float:
        """A moment between rows in the record's own format, given in s since the first row."""
        first = self.stamps[0]
        if not isinstance(first, np.datetime64):
            return float(first) + seconds
        moment = first + np.timedelta64(round(seconds * 1e9), "ns") + np.timedelta64(500_000_000, "ns")
        return f"{np.datetime_as_string(moment, unit='s')}{self.zone or ''}"

    def summary(self) -> str:
        """A few lines: span, step, rows, missing values, range of each face."""
        faces = self.faces[~self.broken]
        low, high = faces.min(axis=0), faces.max(axis=0)
        first, last = (s if isinstance(s := self.stamp(row), str) else f"{s:.15g} s" for row in (0, self.rows - 1))
        missing = np.isnan(self.sensors).sum(axis=0)
        gaps = ", ".join(f"{name} {count}" for name, count in zip(self.names, missing, strict=True) if count)
        lines = [
            f"{Path(self.file).name}: {self.rows} rows, one every {self.step:g} s, {self.duration / DAY:.4g} d",
            f"  from {first} to {last}",
            f"  faces: left {low[0]:.1f} to {high[0]:.1f} degC, right {low[1]:.1f} to {high[1]:.1f} degC",
            f"  inner sensors: {', '.join(self.names) or 'none'}; missing values: {gaps or 'none'}",
        ]
        if self.regressors:
            lines.append(f"  also: {', '.join(self.regressors)}")
        if done := self.cleaning.lines():
            lines += ["  what was done to it:", *(f"    {line}" for line in done)]
        if len(self.unbroken) > 1:
            row, rows = self.longest_part
            lines.append(f"  longest unbroken part: {rows} rows from {self.stamp(row)}, {rows * self.step / DAY:.4g} d")
        return "\n".join(lines)

    __str__ = summary


def read_record(
    path: str | os.PathLike[str],
    *,
    time: str,
    left: str,
    right: str,
    sensors: Sequence[str] = (),
    regressors: Mapping[str, str] | None = None,
    boundary_noise_std: float = 0.1,
    flux_noise_std: float | None = None,
    flux_gain_std: float | None = None,
    form: Format | None = None,
    units: Mapping[str, str] | None = None,
) -> Record:
    """A record from a CSV file as a logger writes it, on a uniform grid.

    Rows that are uniform already are taken as they are. Others are put on a grid of the faces' usual
    step: faces along straight lines between their readings, each inner reading on its nearest row along
    the line to its neighbour. A gap in a face is interpolated, its error counted in `fill_std`, or breaks
    the record where it is longer than the format's `longest_gap`. Inner readings that are missing stay so.

    Args:
        time: the column of times: ISO 8601 (with or without zone), dates as the format says, or s.
        left, right: the columns of the face temperatures at x = 0 and x = length.
        sensors: the inner sensors' columns; empty cells are missing values.
        regressors: a column for any of the keys in `REGRESSORS`.
        boundary_noise_std: K. flux_noise_std: W/m2. flux_gain_std: relative.
        form: how the file is written and what may be made of it; None for what can be seen from the file.
        units: "degC", "degF" or "K" of columns that are not in the format's unit.

    Raises:
        InputError: what is wrong with the file, with its line and column, and the way out.
    """
    regressors, units = dict(regressors or {}), dict(units or {})
    for key in regressors:
        if key not in REGRESSORS:
            raise InputError(f'unknown regressor "{key}"; known are {", ".join(REGRESSORS)}')
    for name, unit in units.items():
        check_unit(f'unit of "{name}"', unit)
    for name, count in Counter([time, left, right, *sensors]).items():
        if count > 1:
            raise InputError(
                f'{path}: column "{name}" is used {count} times; time, both faces and every sensor need a '
                "column of their own"
            )
    parts = read_parts(path, time, (left, right), sensors, regressors, form or Format(), units)
    return Record(
        time=parts.time,
        stamps=parts.stamps,
        zone=parts.zone,
        faces=parts.faces,
        sensors=parts.sensors,
        names=tuple(sensors),
        regressors=parts.regressors,
        boundary_noise_std=boundary_noise_std,
        flux_noise_std=flux_noise_std,
        flux_gain_std=flux_gain_std,
        file=str(path),
        fill_std=parts.fill_std,
        cleaning=parts.cleaning,
    )
