"""Reading a case from its TOML file."""

from __future__ import annotations

import os
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .._internal.errors import InputError
from .._internal.validation import (
    array_of_tables,
    checked_table,
    dataclass_from_table,
    error_context,
    number,
    number_tuple,
    spelling_hint,
    text,
)
from ..records.table_columns import read_uniform_table
from .case_definition import Case, LearningSignal
from .case_tables import parse_choices, parse_record, parse_sensors, parse_wall
from .planned_campaign import CampaignSettings, PlannedCampaign, first_or_typical
from .section.section_definition import Section
from .section.section_tables import SectionCase, check_heights, parse_section
from .wall_and_sensors import Sensor, Wall, check_sensors

_EXAMPLES = Path(__file__).parents[1] / "examples"


def load(path_or_name: str | os.PathLike[str]) -> Case:
    """Load a case from a TOML file, from a folder with a case.toml, or from the packaged cases by name.

    Args:
        path_or_name: a file, a folder, or the name of a packaged case. An existing path has priority.

    Raises:
        InputError: a field of the case or a cell of the record is missing or invalid.
    """
    return case_of(*_content_and_path(path_or_name))


def case_of(content: bytes, path: Path) -> Case:
    """The case that a TOML file with this content would be.

    Args:
        content: of the file, UTF-8.
        path: of the file, which need not exist; the record's file is relative to its folder.

    Raises:
        InputError: as from `load`.
    """
    with error_context(str(path)):
        document = _parse(content)
        if "plan" in document and "record" not in document:
            raise InputError("has no [record]: `wallid plan` plans a campaign; the other commands need its record")
        if "section" in document and "record" not in document:
            raise InputError("has no [record]: `wallid section` solves its section; the other commands need its record")
        optional = ("sensor", "choices", "learning", "case", "description", "plan", "section")
        document = checked_table(document, ("wall", "record"), optional)
        name, description = _name_and_description(document, path)
        wall, section, sensors = _parse_wall_section_sensors(document, path.parent)
        choices = parse_choices(document.get("choices", {}), sensors)
        table = parse_record(document["record"], ("file", "time", "left", "right"))
        learning_table = _parse_learning(document["learning"]) if "learning" in document else None
        plan = _parse_plan(document["plan"]) if "plan" in document else None
    # errors in a CSV file begin with the name of that file, not of the case file
    record = table.read(path.parent / table.columns["file"], sensors)
    learning = _read_learning(learning_table, path.parent) if learning_table else ()
    with error_context(str(path)):
        record = table.with_noise(record, sensors)
        return Case(name, path, wall, sensors, record, choices, learning, description, plan, section)


def _parse_wall_section_sensors(
    document: dict[str, Any], folder: Path
) -> tuple[Wall, Section | None, tuple[Sensor, ...]]:
    """The wall, its section where there is one, and the sensors, checked against each other."""
    section = parse_section(document["section"], document["wall"], folder) if "section" in document else None
    wall = parse_wall(document["wall"], None if section is None else section.diffusivity_prior)
    sensors = parse_sensors(document.get("sensor", []))
    # before the record is read: it must have a column for each sensor
    check_sensors(wall, sensors, section is not None)
    check_heights(section, sensors)
    return wall, section, sensors


def load_section(path_or_name: str | os.PathLike[str]) -> SectionCase:
    """Load the section of a case file; its record is neither needed nor read.

    Args:
        path_or_name: a file, or a folder with a case.toml.

    Raises:
        InputError: the file cannot be read, has no `[section]`, or a field is invalid.
    """
    content, path = _content_and_path(path_or_name)
    with error_context(str(path)):
        document = _parse(content)
        if "section" not in document:
            raise InputError("has no [section]: the materials through the wall and where they are")
        optional = ("record", "sensor", "choices", "learning", "case", "description", "plan")
        checked_table(document, ("wall", "section"), optional)
        name, description = _name_and_description(document, path)
        wall, section, sensors = _parse_wall_section_sensors(document, path.parent)
        assert section is not None
        return SectionCase(name, path, wall, section, sensors, description)


def load_campaign(path_or_name: str | os.PathLike[str]) -> PlannedCampaign:
    """Load the campaign that a case file plans: its `[plan]`, without a record.

    Args:
        path_or_name: a file, or a folder with a case.toml.

    Raises:
        InputError: the file cannot be read, has no `[plan]`, or a field is invalid.
    """
    return campaign_of(*_content_and_path(path_or_name))


def campaign_of(content: bytes, path: Path) -> PlannedCampaign:
    """The campaign that a TOML file with this content would plan.

    Args:
        content: of the file, UTF-8.
        path: of the file, which need not exist; the weather file is relative to its folder.

    Raises:
        InputError: as from `load_campaign`.
    """
    with error_context(str(path)):
        document = _parse(content)
        if "plan" not in document:
            raise InputError("has no [plan]; `wallid new --plan` writes one by questions")
        optional = ("record", "sensor", "choices", "learning", "case", "description")
        if "section" in document:
            raise InputError("has a [section]: a plan is for a wall in one dimension; leave [section] out")
        checked_table(document, ("wall", "plan"), optional)
        name, description = _name_and_description(document, path)
        wall, sensors = parse_wall(document["wall"]), parse_sensors(document.get("sensor", []))
        check_sensors(wall, sensors)
        return PlannedCampaign(
            name=name,
            path=path,
            wall=wall,
            settings=_parse_plan(document["plan"]),
            sensor=first_or_typical(sensors),
            choices=parse_choices(document.get("choices", {}), sensors),
            description=description,
        )


def packaged() -> tuple[str, ...]:
    """The names of the packaged cases."""
    return tuple(sorted(path.parent.name for path in _EXAMPLES.glob("*/case.toml")))


def _content_and_path(path_or_name: str | os.PathLike[str]) -> tuple[bytes, Path]:
    """The content of a case file, and its path."""
    path = _find(path_or_name)
    with error_context(str(path)):
        try:
            return path.read_bytes(), path
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror or error}") from error


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
            f"{', '.join(packaged())}{spelling_hint(name, packaged())}"
        )
    return _EXAMPLES / name / "case.toml"


def _parse(content: bytes) -> dict[str, Any]:
    try:
        return tomllib.loads(content.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise InputError("not UTF-8; the file must be saved as UTF-8") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"not valid TOML: {error}") from error


def _name_and_description(document: dict[str, Any], path: Path) -> tuple[str, str]:
    """The name and description of a case."""
    path = path.resolve()
    default = path.parent.name if path.name == "case.toml" else path.stem
    with error_context("[case]"):
        about = checked_table(document.get("case", {}), (), ("name", "description"))
        name = text("name", about.get("name", default))
    description = about.get("description", document.get("description"))
    return name, "" if description is None else text("description", description)


def _parse_plan(table: object) -> CampaignSettings:
    with error_context("[plan]"):
        return dataclass_from_table(CampaignSettings, table)


@dataclass(frozen=True)
class _LearningTable:
    """The table `[learning]`; each signal is (diffusivity, left column, right column)."""

    file: str
    time: str
    coefficients: tuple[float, ...]
    signals: tuple[tuple[float, str, str], ...]


def _parse_learning(table: object) -> _LearningTable:
    with error_context("[learning]"):
        values = checked_table(table, ("file", "time", "initial_coefficients", "signal"))
        file, time = text("file", values["file"]), text("time", values["time"])
        coefficients = number_tuple("initial_coefficients", values["initial_coefficients"], "degC")
    signals = []
    for count, signal in enumerate(array_of_tables("learning.signal", values["signal"]), start=1):
        with error_context(f"[[learning.signal]] {count}"):
            one = checked_table(signal, ("diffusivity", "left", "right"))
            diffusivity = number("diffusivity", one["diffusivity"], "m2/s", above=0.0)
            signals.append((diffusivity, text("left", one["left"]), text("right", one["right"])))
    if not signals:
        raise InputError("[learning] has no [[learning.signal]]; list at least one, or leave the table out")
    return _LearningTable(file, time, coefficients, tuple(signals))


def _read_learning(plan: _LearningTable, folder: Path) -> tuple[LearningSignal, ...]:
    columns = [column for _, left, right in plan.signals for column in (left, right)]
    table = read_uniform_table(folder / plan.file, plan.time, columns)
    return tuple(
        LearningSignal(
            diffusivity,
            table.time,
            np.stack([table.values[left], table.values[right]], axis=1),
            plan.coefficients,
        )
        for diffusivity, left, right in plan.signals
    )
