"""The table [section] of a case, checked and turned into a `Section`; and a section without a record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..._internal.errors import InputError
from ..._internal.validation import array_of_tables, checked_table, dataclass_from_table, error_context, number, text
from ..wall_and_sensors import Sensor, Wall, sensor_label
from .picture import section_of_picture
from .rectangles import Region, section_of_regions
from .section_definition import Section
from .section_materials import SectionMaterial

_EDGES = ("step", "surface_resistance_left", "surface_resistance_right", "bottom", "top")


@dataclass(frozen=True)
class SectionCase:
    """A section with its sensors, without a record: what `wallid section` needs of a case.

    Args:
        name: title in tables and reports.
        path: of the TOML file, for messages.
        wall: the wall.
        section: through the wall.
        sensors: inside the wall.
        description: one line.
    """

    name: str
    path: Path
    wall: Wall
    section: Section = field(repr=False)
    sensors: tuple[Sensor, ...] = ()
    description: str = ""


def parse_section(table: object, wall_table: object, folder: Path) -> Section:
    """The section from the table `[section]`.

    Args:
        table: `[section]`. wall_table: `[wall]`, which has the length.
        folder: of the case file; the picture is relative to it.

    Raises:
        InputError: a key or a value that does not fit.
    """
    with error_context("[wall]"):
        if not isinstance(wall_table, dict) or "length" not in wall_table:
            raise InputError("length is missing")
        length = number("length", wall_table["length"], "m", above=0.0)
        if "layer" in wall_table:
            raise InputError("has layers, and there is a [section]; its materials and regions say what is where")
    with error_context("[section]"):
        values = checked_table(table, ("height", "material"), ("image", "region", *_EDGES))
        height = number("height", values["height"], "m", above=0.0)
        edges: dict[str, Any] = {key: values[key] for key in _EDGES if key in values}
        if ("image" in values) == ("region" in values):
            raise InputError("needs either image (a picture whose colours are materials) or [[section.region]]")
    materials = _each(SectionMaterial, "section.material", values["material"])
    if "image" in values:
        with error_context("[section]"):
            return section_of_picture(length, height, materials, folder / text("image", values["image"]), **edges)
    regions = _each(Region, "section.region", values["region"])
    with error_context("[section]"):
        return section_of_regions(length, height, materials, regions, **edges)


def _each(kind: type, name: str, tables: object) -> list[Any]:
    """An object from each table of an array."""
    found = []
    for count, table in enumerate(array_of_tables(name, tables), start=1):
        label = table.get("name") if isinstance(table, dict) else None
        with error_context(f"[[{name}]] {count}" + (f' "{label}"' if isinstance(label, str) else "")):
            found.append(dataclass_from_table(kind, table))
    return found


def check_heights(section: Section | None, sensors: Sequence[Sensor]) -> None:
    """Check the heights of sensors.

    Raises:
        InputError: a height outside the section, or without one.
    """
    for count, sensor in enumerate(sensors, start=1):
        with error_context(sensor_label(count, sensor.name)):
            if sensor.height is None:
                continue
            if section is None:
                raise InputError("height is given, but the case has no [section]; a wall in one dimension has none")
            if sensor.height > section.height:
                raise InputError(
                    f"height = {sensor.height:g} m is outside the section; it must be at most {section.height:g} m"
                )
