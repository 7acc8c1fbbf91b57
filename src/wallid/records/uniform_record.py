"""The record of a measurement: times, face temperatures, inner sensors and regressors at a uniform step."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, no_type_check

import numpy as np
import scipy

from .._internal.errors import InputError
from .._internal.html import html_frame
from .._internal.result_object import ResultObject
from .._internal.units import DAY
from .._internal.validation import number, set_fields
from .array_checks import checked_columns, checked_names, checked_regressors, checked_stamps, checked_times
from .cleaning_log import CleaningLog
from .dataframe_table import source_name
from .face_filter import FaceFilter, face_filter
from .face_spectrum import WHITE, NoiseMemory
from .face_variation import FaceErrors, cubic_errors
from .file_format import FileFormat, check_unit
from .reading_pipeline import read_record_arrays
from .row_times import RecordStart, time_index

if TYPE_CHECKING:
    from pandas import DataFrame

__all__ = ["REGRESSORS", "REGRESSOR_UNITS", "FileFormat", "Record", "read_record"]

REGRESSOR_UNITS = {
    "irradiance": "W/m2",  # on the outer face
    "air_outdoor": "degC",
    "air_indoor": "degC",
    "wind": "m/s",
    "rain": "mm/h",
    "heating": None,  # 0..1, or W
    "flux_left": "W/m2",  # positive along +x
    "flux_right": "W/m2",  # positive along +x
}
"""Unit of each regressor; None where a file may use one of two."""
REGRESSORS = tuple(REGRESSOR_UNITS)


@no_type_check
@dataclass(frozen=True, eq=False)
class Record(ResultObject):
    """The readings in and on a wall at a uniform step.

    Args:
        time: s since the first row, (time,).
        stamps: the rows' times as in the file: datetime64[ns] in local time of `zone`, or s, (time,).
        zone: fixed offset of the stamps from UTC, such as "+01:00" or "Z"; None where the file states none.
        faces: left and right face temperature, degC, (time, 2); interpolated where `fill_std` is not 0. In broken rows
            the values are placeholders (linear interpolation over the whole gap).
        sensors: inner temperatures, degC, NaN where missing, (time, sensor).
        names: of the sensors.
        regressors: other columns, keys from `REGRESSORS`, NaN where missing, (time,) each.
        boundary_noise_std: standard deviation of the faces' readings, K.
        face_position_std: standard deviation of the positions of the faces' sensors along x, m, symmetric about the
            face.
        flux_noise_std: standard deviation of the flux readings, W/m2; None where not stated.
        flux_gain_std: relative standard deviation of the flux plates' gain; None where not stated.
        file: path of the file, for messages.
        fill_std: standard error of interpolated faces, K: 0 where a face was read, infinite in broken rows,
            (time, 2); None where every row was read. Within one gap the errors are fully correlated.
        cleaning: what was changed while the file was read.
        timezone: IANA name of the time zone of the file's clock where it follows daylight saving; else None.
        noise_memory: shape of the noise of the faces, as a fit has found it; white in a record that is read.

    Raises:
        InputError: an array whose shape does not fit the others, times that do not increase or have no uniform step,
            faces that are not finite, an unknown regressor, or a standard deviation that is negative or not a number.
    """

    time: np.ndarray = field(repr=False)
    stamps: np.ndarray = field(repr=False)
    zone: str | None
    faces: np.ndarray = field(repr=False)
    sensors: np.ndarray = field(repr=False)
    names: tuple[str, ...]
    regressors: Mapping[str, np.ndarray] = field(default_factory=dict, repr=False)
    boundary_noise_std: float = 0.1
    face_position_std: float = 0.0
    flux_noise_std: float | None = None
    flux_gain_std: float | None = None
    file: str = "record"
    fill_std: np.ndarray | None = field(default=None, repr=False)
    cleaning: CleaningLog = field(default_factory=CleaningLog)
    timezone: str | None = None
    noise_memory: NoiseMemory = field(default=WHITE, repr=False)

    def __post_init__(self) -> None:
        self._check_arrays()
        set_fields(self, boundary_noise_std=number("boundary_noise_std", self.boundary_noise_std, "K", minimum=0.0))
        set_fields(self, face_position_std=number("face_position_std", self.face_position_std, "m", minimum=0.0))
        if self.flux_noise_std is not None:
            set_fields(self, flux_noise_std=number("flux_noise_std", self.flux_noise_std, "W/m2", above=0.0))
        if self.flux_gain_std is not None:
            set_fields(self, flux_gain_std=number("flux_gain_std", self.flux_gain_std, minimum=0.0))

    def _check_arrays(self) -> None:
        set_fields(self, time=checked_times(self.time), names=checked_names(self.names))
        rows, faces = len(self.time), "face: left, right"
        set_fields(
            self,
            stamps=checked_stamps(self.stamps, rows),
            faces=checked_columns("faces", self.faces, rows, 2, faces, finite=True),
            sensors=checked_columns("sensors", self.sensors, rows, len(self.names), "name in `names`", finite=False),
            regressors=checked_regressors(self.regressors, rows, REGRESSORS),
        )
        if self.fill_std is not None:
            set_fields(self, fill_std=checked_columns("fill_std", self.fill_std, rows, 2, faces, finite=False))

    @cached_property
    def step(self) -> float:
        """Time from row to row, s."""
        return float(np.median(np.diff(self.time)))

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.time)

    @property
    def duration(self) -> float:
        """From the first row to the last, s."""
        return float(self.time[-1] - self.time[0])

    @property
    def span(self) -> float:
        """From the first row to the end of the last, s: the rows times the step."""
        return self.duration + self.step

    @property
    def start(self) -> RecordStart:
        """When the record begins."""
        first = self.stamps[0]
        return RecordStart(first if isinstance(first, np.datetime64) else None, self.zone)

    @property
    def days(self) -> np.ndarray:
        """Time of each row, days since the first, (time,)."""
        return np.asarray(self.time) / DAY

    def rows_in_days(self, days: float) -> int:
        """Number of rows in a number of days, at least 1."""
        return max(1, round(days * DAY / self.step))

    @cached_property
    def face_slopes(self) -> np.ndarray:
        """The faces' rates of change at the rows, K/s, (time, 2), by which they are cubics between the rows."""
        return cubic_slopes(self.faces, self.step)

    @property
    def face_errors(self) -> FaceErrors:
        """The errors of each face's cubics between the rows."""
        return self.face_errors_at(1)

    def face_errors_at(self, stride: int) -> FaceErrors:
        """`face_errors` of a record with only every so many of the rows."""
        if stride not in self._face_errors:
            self._face_errors[stride] = cubic_errors(
                self._unbroken_faces[::stride], stride * self.step, self.boundary_noise_std, self.noise_memory
            )
        return self._face_errors[stride]

    @cached_property
    def face_filter(self) -> FaceFilter:
        """The filter that takes the noise out of the faces' readings."""
        return face_filter(self._unbroken_faces, self.step, self.boundary_noise_std, self.noise_memory)

    @property
    def _unbroken_faces(self) -> np.ndarray:
        """The faces of the longest part without a break, degC, (time, 2)."""
        first, rows = self.longest_part
        return self.faces[first : first + rows]

    @cached_property
    def _face_errors(self) -> dict[int, FaceErrors]:
        """The errors that were computed, by stride: each takes some tenths of a second."""
        return {}

    @cached_property
    def broken(self) -> np.ndarray:
        """Which rows are in a gap of a face that is too long for interpolation, (time,)."""
        if self.fill_std is None:
            return np.zeros(self.rows, bool)
        return np.asarray(np.isinf(self.fill_std).any(axis=1))

    @cached_property
    def unbroken_parts(self) -> tuple[tuple[int, int], ...]:
        """The record's parts between its breaks: (first row, rows) of each; one where there is no break."""
        edges = np.flatnonzero(np.diff(np.concatenate([[0], (~self.broken).astype(int), [0]])))
        return tuple((int(a), int(b - a)) for a, b in zip(edges[::2], edges[1::2], strict=True))

    @property
    def longest_part(self) -> tuple[int, int]:
        """The longest of `unbroken_parts`: (first row, rows); of equal ones the first."""
        return max(self.unbroken_parts, key=lambda part: part[1])

    def first_unbroken_row(self, last: int) -> int:
        """The first of the rows without a break that end at a row; the row after it where that row is broken."""
        broken = np.flatnonzero(self.broken[: last + 1])
        return int(broken[-1]) + 1 if len(broken) else 0

    def contains_windows(self, start_rows: np.ndarray | int, rows: int) -> np.ndarray:
        """Whether windows of `rows` rows lie within the record and contain no broken row.

        Args:
            start_rows: first row of each window.
            rows: number of rows.
        """
        start = np.asarray(start_rows)
        broken = np.concatenate([[0], np.cumsum(self.broken)])
        end = np.minimum(start + rows, self.rows)
        return (start >= 0) & (start + rows <= self.rows) & (broken[end] == broken[np.maximum(start, 0)])

    def window(self, start_row: int, rows: int) -> Record:
        """A window as a record; its time restarts at 0.

        Args:
            start_row: first row.
            rows: number of rows.

        Raises:
            InputError: fewer than two rows, or rows outside the record.
        """
        if start_row < 0 or rows < 2 or start_row + rows > self.rows:
            raise InputError(
                f"{self.file}: a window of {rows} rows from row {start_row}; it must have at least 2 rows "
                f"and lie within the record's {self.rows}"
            )
        part = slice(start_row, start_row + rows)
        return self._with_rows(
            time=self.time[part] - self.time[start_row],
            stamps=self.stamps[part],
            faces=self.faces[part],
            sensors=self.sensors[part],
            regressors={key: values[part] for key, values in self.regressors.items()},
            fill_std=None if self.fill_std is None else self.fill_std[part],
            cleaning=self.cleaning if rows == self.rows else CleaningLog(),
        )

    def with_noise_memory(self, memory: NoiseMemory) -> Record:
        """The same record, with the noise of its faces of this shape."""
        return self._with_rows(noise_memory=memory)

    def _with_rows(self, **arrays: object) -> Record:
        """The same record with other values, without a check: rows of a checked record fit each other."""
        part = object.__new__(Record)
        set_fields(part, **{field.name: getattr(self, field.name) for field in fields(self)})
        set_fields(part, **arrays)
        return part

    def stamp(self, row: int) -> str | float:
        """The time of a row in the record's own format; of the row after the last, one step later.

        Returns:
            ISO 8601 to the second, with the zone where one is stated; or s where the file has s.

        Raises:
            InputError: a row outside the record.
        """
        if not 0 <= row <= self.rows:
            raise InputError(f"{self.file}: row {row}; it must lie between 0 and {self.rows}")
        beyond = row == self.rows
        return self._later(self.stamps[row - beyond], beyond * self.step)

    def stamp_at(self, seconds: float) -> str | float:
        """A time in the record's own format.

        Args:
            seconds: since the first row; also between rows.
        """
        return self._later(self.stamps[0], seconds)

    def _later(self, stamp: np.generic, seconds: float) -> str | float:
        """The time some seconds after a stamp, in the record's own format."""
        if not isinstance(stamp, np.datetime64):
            return float(stamp) + seconds
        half_second = np.timedelta64(500_000_000, "ns")  # so that truncation to seconds rounds
        time = stamp + np.timedelta64(round(seconds * 1e9), "ns") + half_second
        return f"{np.datetime_as_string(time, unit='s')}{self.zone or ''}"

    def summary(self) -> str:
        """A few lines of text: rows, step, duration, missing values, range of each face, changes while reading."""
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
        if changes := self.cleaning.lines():
            lines += ["  changes while reading:", *(f"    {line}" for line in changes)]
        if len(self.unbroken_parts) > 1:
            row, rows = self.longest_part
            lines.append(f"  longest unbroken part: {rows} rows from {self.stamp(row)}, {rows * self.step / DAY:.4g} d")
        return "\n".join(lines)

    __str__ = summary

    def to_dict(self) -> dict[str, Any]:
        """Rows, step, start, end, and readings and range of each column, as plain values; no time series."""
        columns = self._columns_frame().reset_index().to_dict("records")
        return {
            "file": self.file,
            "rows": self.rows,
            "step": self.step,
            "start": self.stamp(0),
            "end": self.stamp(self.rows),
            "columns": columns,
            "cleaning": self.cleaning.to_dict(),
        }

    def to_frame(self) -> DataFrame:
        """All columns, one row for each time: `left`, `right`, the inner sensors, and the regressors by their key.

        A missing value is NaN, also of a face in a gap that was too long to interpolate. The index holds datetimes,
        with the zone where the file states one, or s. `Case.from_dataframe` takes such a frame.
        """
        import pandas as pd

        faces = np.where(self.broken[:, None], np.nan, self.faces)
        columns = dict(zip(("left", "right"), faces.T, strict=True))
        columns |= dict(zip(self.names, self.sensors.T, strict=True)) | dict(self.regressors)
        return pd.DataFrame(columns, index=time_index(self.stamps, self.zone))

    def _columns_frame(self) -> DataFrame:
        """One row for each column: number of values, smallest and largest one, unit."""
        import pandas as pd

        frame = self.to_frame()
        units = [REGRESSOR_UNITS.get(str(name), "degC") or "-" for name in frame.columns]
        index = pd.Index(list(frame.columns), name="column")
        values = {"values": frame.count().to_numpy(), "missing": frame.isna().sum().to_numpy()}
        ends = {"smallest": frame.min().to_numpy(), "largest": frame.max().to_numpy()}
        return pd.DataFrame(values | ends | {"unit": units}, index=index)

    def _repr_html_(self) -> str:
        first, last = self.stamp(0), self.stamp(self.rows - 1)
        title = f"{Path(self.file).name}: {self.rows} rows, one every {self.step:g} s, from {first} to {last}"
        return html_frame(title, self._columns_frame())


def cubic_slopes(values: np.ndarray, step: float) -> np.ndarray:
    """The slopes at uniform rows by which values, (time,) or (time, column), are monotone cubics between the rows.

    The cubics do not overshoot where a value changes suddenly.

    Source: F. N. Fritsch, J. Butland, SIAM J. Sci. Stat. Comput. 5 (1984), 300.
    """
    rows = np.arange(len(values))
    return np.asarray(scipy.interpolate.PchipInterpolator(rows, values).derivative()(rows)) / step


def spline_slopes(values: np.ndarray, step: float) -> np.ndarray:
    """The slopes at uniform rows of the cubic spline through values, (time,) or (time, column).

    Of a smooth course without noise they are right up to the fourth power of the step. Monotone cubics have no slope at
    the highest and the lowest value, so their error near these is as large as the step squared.

    Source: C. de Boor, A Practical Guide to Splines (2001), IV.
    """
    rows = np.arange(len(values))
    return np.asarray(scipy.interpolate.CubicSpline(rows, values)(rows, 1)) / step


def cubic_coefficients(values: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """The cubics between uniform rows with these values, (time,), and slopes for each row, (time,): (interval, power).

    Coefficients of the powers of s, from 0 at a row to 1 at the next.
    """
    return np.asarray(scipy.interpolate.CubicHermiteSpline(np.arange(len(values)), values, slopes).c)[::-1].T


def read_record(
    path: str | os.PathLike[str] | DataFrame,
    *,
    time: str,
    left: str,
    right: str,
    sensors: Sequence[str] = (),
    regressors: Mapping[str, str] | None = None,
    boundary_noise_std: float = 0.1,
    face_position_std: float = 0.0,
    flux_noise_std: float | None = None,
    flux_gain_std: float | None = None,
    file_format: FileFormat | None = None,
    units: Mapping[str, str] | None = None,
) -> Record:
    """Read a record from a logger's CSV file or a DataFrame and resample it to a uniform grid.

    Rows that are already uniform are not changed. Others are resampled to a grid with the typical step of the faces:
    face temperatures are interpolated linearly between their readings; each reading of an inner sensor or a flux plate
    is interpolated linearly to the time of its closest row. A gap in a face is interpolated and its standard error is
    in `fill_std`. A gap longer than the format's `longest_gap` breaks the record. Missing readings of sensors and
    plates stay NaN.

    Args:
        path: of the CSV file, or a pandas DataFrame.
        time: the column of times: ISO 8601 (with or without a zone), dates in the order of `day_first`, or s.
        left, right: the columns of the face temperatures at x = 0 and x = length.
        sensors: the inner sensors' columns; empty cells are missing values.
        regressors: a column for any of the keys in `REGRESSORS`.
        boundary_noise_std: K. face_position_std: m. flux_noise_std: W/m2. flux_gain_std: relative.
        file_format: of the file, and how its readings are processed; None: detected.
        units: "degC", "degF" or "K" for columns whose unit differs from the format's.

    Raises:
        InputError: the file is invalid; the message gives line and column, and what to change.
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
                f'{source_name(path)}: column "{name}" is used {count} times; time, both faces and every sensor need a '
                "column of their own"
            )
    arrays = read_record_arrays(path, time, (left, right), sensors, regressors, file_format or FileFormat(), units)
    return Record(
        **arrays,
        names=tuple(sensors),
        boundary_noise_std=boundary_noise_std,
        face_position_std=face_position_std,
        flux_noise_std=flux_noise_std,
        flux_gain_std=flux_gain_std,
        file=source_name(path),
    )
