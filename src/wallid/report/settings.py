"""Tables of the settings of a case, defaults included."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields

from .._internal.number_formats import format_number
from ..case.case_definition import Case
from ..case.section.section_definition import Section
from ..case.wall_and_sensors import Sensor
from ..models.flux_plates import flux_gain_std, flux_noise_std, fluxes_of
from .tables import Table

_HEAD = ("setting", "value used")


def settings_tables(case: Case) -> list[Table]:
    """A table for each table of the case file, with the same names."""
    tables = [Table("[wall]", _HEAD, [*_wall(case)])]
    if case.wall.layers:
        head = ("thickness (m)", "conductivity (W/m/K)", "heat_capacity (J/m³/K)")
        rows = [
            (format_number(layer.thickness), format_number(layer.conductivity), format_number(layer.heat_capacity))
            for layer in case.wall.layers
        ]
        tables.append(Table("[[wall.layer]]", head, [*rows]))
    if case.section is not None:
        tables += _section(case.section)
    tables.append(Table("[record]", _HEAD, [*_record(case)]))
    if case.sensors:
        with_height = case.section is not None
        head = ("name", "position (m)", "position_std (m)", "noise_std (K)", "offset_std (K)")
        head += ("height (m)", "height_std (m)") if with_height else ()
        rows = [
            (
                one.name,
                format_number(one.position),
                format_number(one.position_std),
                format_number(one.noise_std),
                format_number(one.offset_std),
                *(_height(one) if with_height else ()),
            )
            for one in case.sensors
        ]
        tables.append(Table("[[sensor]]", head, [*rows]))
    return [*tables, Table("[choices]", _HEAD, [*_choices(case)])]


def _height(sensor: Sensor) -> tuple[str, str]:
    """A sensor's height and its standard deviation."""
    if sensor.height is None:
        return "not known", ""
    return format_number(sensor.height), format_number(sensor.height_std)


def _section(section: Section) -> list[Table]:
    """The tables of a section and of its materials."""
    settings = [
        ("height (m)", format_number(section.height)),
        ("step (m)", "by the thinnest part" if section.step is None else format_number(section.step)),
        ("bottom", section.bottom),
        ("top", section.top),
    ]
    head = ("name", "conductivity (W/m/K)", "conductivity_y (W/m/K)", "heat_capacity (J/m³/K)", "uncertainty", "area")
    rows = [
        (
            one.name,
            format_number(one.conductivity),
            format_number(one.anisotropy * one.conductivity),
            format_number(one.heat_capacity),
            format_number(one.uncertainty),
            f"{100 * share:.1f} %",
        )
        for one, share in zip(section.materials, section.areas.tolist(), strict=True)
    ]
    return [Table("[section]", _HEAD, settings), Table("[[section.material]]", head, rows)]


def _wall(case: Case) -> Iterator[tuple[str, str]]:
    wall = case.wall
    yield "length (m)", format_number(wall.length)
    yield "diffusivity_prior (m²/s)", format_number(wall.diffusivity_prior)
    yield "conductivity (W/m/K)", format_number(wall.conductivity)
    yield "heat_capacity (J/m³/K)", format_number(wall.heat_capacity)
    yield "outside", wall.outside


def _record(case: Case) -> Iterator[tuple[str, str]]:
    record = case.record
    yield "file", record.file
    yield "step (s)", format_number(record.step)
    yield "boundary_noise_std (K)", format_number(record.boundary_noise_std)
    yield "face_position_std (m)", format_number(record.face_position_std)
    if fluxes_of(case):
        yield "flux_noise_std (W/m²)", format_number(flux_noise_std(case))
        yield "flux_gain_std", format_number(flux_gain_std(case))
    yield "further columns", ", ".join(record.regressors) or "none"


def _choices(case: Case) -> Iterator[tuple[str, str]]:
    defaults = {
        "noise": "estimated",
        "disturbance": "auto" if fluxes_of(case) else "none",
        "diagnose_days": "the entire record",
        "initial_coefficients": "fitted to the readings",
    }
    for field in fields(case.choices):
        value = getattr(case.choices, field.name)
        yield field.name, defaults[field.name] if value is None and field.name in defaults else format_number(value)
