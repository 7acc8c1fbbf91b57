"""A case: a wall, what was logged of it, and what to do with it; read from TOML, every field checked."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from .._internal.errors import InputError
from .._internal.validation import build, keys, nearest, number, series, tables, text, within
from ..records.file_format import Format
from ..records.table_columns import read_columns
from ..records.uniform_record import REGRESSORS, read_record
from .case_definition import Case, LearningSignal, _check_sensors, _place
from .options import Choices
from .wall_and_sensors import Layer, Sensor, Wall

_EXAMPLES = Path(__file__).parents[1] / "examples"
_BOUNDARY_NOISE_STD = 0.1  # K, where no inner sensor tells how well was measured
_FORMAT = tuple(f.name for f in fields(Format))


def load(path_or_name: str | os.PathLike[str]) -> Case:
    """A case from its TOML file, from the folder that holds its case.toml, or a packaged one by name.

    Args:
        path_or_name: what exists as a path is not looked for among the packaged cases.

    Raises:
        InputError: what is wrong, with file and field, or file, line and column.
    """
    path = _find(path_or_name)
    with within(str(path)):
        document = keys(_parse(path), ("wall", "record"), ("sensor", "choices", "learning", "case", "description"))
        name, description = _about(document, path)
        wall = _wall(document["wall"])
        sensors = _sensors(document.get("sensor", []))
        _check_sensors(wall, sensors)  # before the record, whose columns they name
        choices = _choices(document.get("choices", {}), sensors)
        with within("[record]"):
            source = keys(
                document["record"],
                ("file", "time", "left", "right"),
                ("boundary_noise_std", "face_position_std", "flux_noise_std", "flux_gain_std", *REGRESSORS, *_FORMAT),
            )
            form = Format(**{key: value for key, value in source.items() if key in _FORMAT})
            plain = {key: value for key, value in source.items() if not key.endswith("_std") and key not in _FORMAT}
            columns = {key: text(key, value) for key, value in plain.items()}
        plan = _plan_learning(document["learning"]) if "learning" in document else None
    # what is wrong in a CSV file is told with that file's name
    record = read_record(
        path.parent / columns.pop("file"),
        time=columns.pop("time"),
        left=columns.pop("left"),
        right=columns.pop("right"),
        sensors=[sensor.name for sensor in sensors],
        regressors=columns,
        form=form,
        units={sensor.name: sensor.unit for sensor in sensors if sensor.unit is not None},
    )
    learning = _read_learning(plan, path.parent) if plan else ()
    with within(str(path)):
        noise = {key: value for key, value in source.items() if key.endswith("_std")}
        default = min((sensor.noise_std for sensor in sensors), default=_BOUNDARY_NOISE_STD)
        with within("[record]"):
            record = replace(record, **{"boundary_noise_std": default, **noise})
        return Case(name, path, wall, sensors, record, choices, learning, description)


def packaged() -> tuple[str, ...]:
    """The names of the cases that come with the package."""
    return tuple(sorted(path.parent.name for path in _EXAMPLES.glob("*/case.toml")))


def _find(path_or_name: str | os.PathLike[str]) -> Path:
    path, name = Path(path_or_name), str(path_or_name)
    if path.is_dir():
        if not (path / "case.toml").is_file():
            raise InputError(f"{name}: the folder holds no case.toml")
        return path / "case.toml"
    if path.exists():
        return path
    if name not in packaged():
        raise InputError(
            f"{name}: there is no such file or folder, nor a packaged case of that name; packaged are "
            f"{', '.join(packaged())}{nearest(name, packaged())}"
        )
    return _EXAMPLES / name / "case.toml"


def _parse(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise InputError("not UTF-8; the file must be saved as UTF-8") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"not valid TOML: {error}") from error


def _about(document: dict[str, Any], path: Path) -> tuple[str, str]:
    """A case's name and description."""
    path = path.resolve()
    default = path.parent.name if path.name == "case.toml" else path.stem
    with within("[case]"):
        about = keys(document.get("case", {}), (), ("name", "description"))
        name = text("name", about.get("name", default))
    description = about.get("description", document.get("description"))
    return name, "" if description is None else text("description", description)


def _wall(table: object) -> Wall:
    with within("[wall]"):
        known = {f.name for f in fields(Wall)} - {"length", "layers"}
        values = dict(keys(table, ("length",), (*sorted(known), "layer")))
        if "diffusivity_prior" in values:  # a NaN would mean that it was left out
            number("diffusivity_prior", values["diffusivity_prior"], "m2/s")
        layers = values.pop("layer", [])
    parts = []
    for count, layer in enumerate(tables("wall.layer", layers), start=1):
        with within(f"[[wall.layer]] {count}"):
            parts.append(build(Layer, layer))
    with within("[wall]"):
        return Wall(**values, layers=tuple(parts))


def _sensors(value: object) -> tuple[Sensor, ...]:
    sensors = []
    for count, table in enumerate(tables("sensor", value), start=1):
        with within(_place(count, table.get("name") if isinstance(table, dict) else None)):
            sensors.append(build(Sensor, table))
    return tuple(sensors)


def _choices(table: object, sensors: Sequence[Sensor]) -> Choices:
    with within("[choices]"):
        choices = build(Choices, table)
        if isinstance(table, dict) and "initial_profile" in table:
            return choices
        return replace(choices, initial_profile=min(choices.initial_profile, len(sensors) + 1))


@dataclass(frozen=True)
class _LearningPlan:
    """The `[learning]` table, its signals as (diffusivity, left column, right column)."""

    file: str
    time: str
    coefficients: tuple[float, ...]
    signals: tuple[tuple[float, str, str], ...]


def _plan_learning(table: object) -> _LearningPlan:
    with within("[learning]"):
        values = keys(table, ("file", "time", "initial_coefficients", "signal"))
        file, time = text("file", values["file"]), text("time", values["time"])
        coefficients = series("initial_coefficients", values["initial_coefficients"], "degC")
    signals = []
    for count, signal in enumerate(tables("learning.signal", values["signal"]), start=1):
        with within(f"[[learning.signal]] {count}"):
            one = keys(signal, ("diffusivity", "left", "right"))
            diffusivity = number("diffusivity", one["diffusivity"], "m2/s", above=0.0)
            signals.append((diffusivity, text("left", one["left"]), text("right", one["right"])))
    if not signals:
        raise InputError("[learning] has no [[learning.signal]]; list at least one, or leave the table out")
    return _LearningPlan(file, time, coefficients, tuple(signals))


def _read_learning(plan: _LearningPlan, folder: Path) -> tuple[LearningSignal, ...]:
    columns = [column for _, left, right in plan.signals for column in (left, right)]
    table = read_columns(folder / plan.file, plan.time, columns)
    return tuple(
        LearningSignal(
            diffusivity,
            table.time,
            np.stack([table.values[left], table.values[right]], axis=1),
            plan.coefficients,
        )
        for diffusivity, left, right in plan.signals
    )
