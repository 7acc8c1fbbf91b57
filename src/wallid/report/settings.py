"""What was used of a case's file, defaults filled in, as tables."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields

from .._internal.number_formats import number
from ..case.case_definition import Case
from ..models.flux_plates import flux_gain_std, flux_noise_std, fluxes_of
from .tables import Table

_HEAD = ("setting", "as used")


def settings(case: Case) -> list[Table]:
    """A table for each of the file's, named as it is."""
    found = [Table("[wall]", _HEAD, [*_wall(case)])]
    if case.wall.layers:
        head = ("thickness (m)", "conductivity (W/m/K)", "heat_capacity (J/m³/K)")
        rows = [
            (number(layer.thickness), number(layer.conductivity), number(layer.heat_capacity))
            for layer in case.wall.layers
        ]
        found.append(Table("[[wall.layer]]", head, [*rows]))
    found.append(Table("[record]", _HEAD, [*_record(case)]))
    if case.sensors:
        head = ("name", "position (m)", "position_std (m)", "noise_std (K)", "offset_std (K)")
        rows = [
            (one.name, number(one.position), number(one.position_std), number(one.noise_std), number(one.offset_std))
            for one in case.sensors
        ]
        found.append(Table("[[sensor]]", head, [*rows]))
    return [*found, Table("[choices]", _HEAD, [*_choices(case)])]


def _wall(case: Case) -> Iterator[tuple[str, str]]:
    wall = case.wall
    yield "length (m)", number(wall.length)
    yield "diffusivity_prior (m²/s)", number(wall.diffusivity_prior)
    yield "conductivity (W/m/K)", number(wall.conductivity)
    yield "heat_capacity (J/m³/K)", number(wall.heat_capacity)
    yield "outside", wall.outside


def _record(case: Case) -> Iterator[tuple[str, str]]:
    record = case.record
    yield "file", record.file
    yield "step (s)", number(record.step)
    yield "boundary_noise_std (K)", number(record.boundary_noise_std)
    yield "face_position_std (m)", number(record.face_position_std)
    if fluxes_of(case):
        yield "flux_noise_std (W/m²)", number(flux_noise_std(case))
        yield "flux_gain_std", number(flux_gain_std(case))
    yield "further columns", ", ".join(record.regressors) or "none"


def _choices(case: Case) -> Iterator[tuple[str, str]]:
    unsaid = {
        "noise": "robust" if fluxes_of(case) else "estimated",
        "diagnose_days": "the whole record",
        "initial_coefficients": "fitted through the readings",
    }
    for field in fields(case.choices):
        value = getattr(case.choices, field.name)
        yield field.name, unsaid[field.name] if value is None and field.name in unsaid else number(value)
