"""The tables of a case ([wall], [record], [[sensor]], [choices]), each checked and turned into an object."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

from .._internal.validation import (
    array_of_tables,
    checked_table,
    dataclass_from_table,
    error_context,
    number,
    text,
)
from ..records.file_format import FileFormat
from ..records.uniform_record import REGRESSORS, Record, read_record
from .options import Choices
from .wall_and_sensors import Layer, Sensor, Wall, sensor_label

if TYPE_CHECKING:
    from pandas import DataFrame

_BOUNDARY_NOISE_STD = 0.1  # K, for a case without a sensor inside the wall
_NOISE_KEYS = ("boundary_noise_std", "face_position_std", "flux_noise_std", "flux_gain_std")
_FORMAT_KEYS = tuple(f.name for f in fields(FileFormat))
RECORD_OPTIONS = (*_NOISE_KEYS, *_FORMAT_KEYS)
"""Keys of `[record]` that are no columns."""


@dataclass(frozen=True)
class RecordTable:
    """The checked table `[record]`.

    Args:
        columns: name of the column for "time", "left", "right", for each regressor, and "file" where it is required.
        file_format: how the file is written.
        noise: standard deviations, by the names of the fields of `Record`.
    """

    columns: dict[str, str]
    file_format: FileFormat
    noise: dict[str, Any]

    def read(self, data: str | os.PathLike[str] | DataFrame, sensors: Sequence[Sensor]) -> Record:
        """The record from a CSV file or a DataFrame; the standard deviations are not yet set."""
        columns = {key: column for key, column in self.columns.items() if key != "file"}
        return read_record(
            data,
            time=columns.pop("time"),
            left=columns.pop("left"),
            right=columns.pop("right"),
            sensors=[sensor.name for sensor in sensors],
            regressors=columns,
            file_format=self.file_format,
            units={sensor.name: sensor.unit for sensor in sensors if sensor.unit is not None},
        )

    def with_noise(self, record: Record, sensors: Sequence[Sensor]) -> Record:
        """The record with its standard deviations; the default for the faces is the smallest of the sensors."""
        default = min((sensor.noise_std for sensor in sensors), default=_BOUNDARY_NOISE_STD)
        with error_context("[record]"):
            return replace(record, **{"boundary_noise_std": default, **self.noise})


def parse_record(table: object, required: Sequence[str] = ("time", "left", "right")) -> RecordTable:
    """The table `[record]` after a check of its keys, its column names and its file format."""
    with error_context("[record]"):
        values = checked_table(table, required, (*RECORD_OPTIONS, *REGRESSORS))
        file_format = FileFormat(**{key: value for key, value in values.items() if key in _FORMAT_KEYS})
        columns = {key: text(key, value) for key, value in values.items() if key not in RECORD_OPTIONS}
        return RecordTable(columns, file_format, {key: values[key] for key in _NOISE_KEYS if key in values})


def parse_wall(table: object, diffusivity_prior: float | None = None) -> Wall:
    """The wall from the table `[wall]` with its `[[wall.layer]]`.

    Args:
        table: `[wall]`.
        diffusivity_prior: m2/s, where the table says nothing from which it follows.
    """
    with error_context("[wall]"):
        known = {f.name for f in fields(Wall)} - {"length", "layers"}
        values = dict(checked_table(table, ("length",), (*sorted(known), "layer")))
        if "diffusivity_prior" in values:  # NaN in the file is an error; Wall takes it for a missing value
            number("diffusivity_prior", values["diffusivity_prior"], "m2/s")
        elif diffusivity_prior is not None and not {"conductivity", "heat_capacity"} <= set(values):
            values["diffusivity_prior"] = diffusivity_prior
        layer_tables = values.pop("layer", [])
    layers = []
    for count, layer in enumerate(array_of_tables("wall.layer", layer_tables), start=1):
        with error_context(f"[[wall.layer]] {count}"):
            layers.append(dataclass_from_table(Layer, layer))
    with error_context("[wall]"):
        return Wall(**values, layers=tuple(layers))


def parse_sensors(value: object) -> tuple[Sensor, ...]:
    """The sensors from the tables `[[sensor]]`."""
    sensors = []
    for count, table in enumerate(array_of_tables("sensor", value), start=1):
        with error_context(sensor_label(count, table.get("name") if isinstance(table, dict) else None)):
            sensors.append(dataclass_from_table(Sensor, table))
    return tuple(sensors)


def parse_choices(table: object, sensors: Sequence[Sensor]) -> Choices:
    """The options from the table `[choices]`; the default initial profile follows from the number of sensors."""
    with error_context("[choices]"):
        choices = dataclass_from_table(Choices, table)
        if isinstance(table, dict) and "initial_profile" in table:
            return choices
        return replace(choices, initial_profile=min(choices.initial_profile, len(sensors) + 1))


def sensor_tables(sensors: Mapping[str, float], noise_std: float | None) -> list[dict[str, Any]]:
    """One table `[[sensor]]` for each column and position."""
    noise = {} if noise_std is None else {"noise_std": noise_std}
    return [{"name": name, "position": position, **noise} for name, position in sensors.items()]
