"""What a section is before it is measured: its mesh, its equivalent wall, its reduced model, its steady state."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..._internal.progress import Progress, part_of, shown_progress
from ..._internal.result_object import ResultObject, plain_value
from ...case.section.section_tables import SectionCase
from .affine_model import AffineModel
from .full_order_section import SectionModel, SectionPoint, full_order_section
from .krylov_basis import generalised_modes
from .material_range import MaterialRange
from .reduced_section import reduce_section
from .steady_section import EquivalentWall, SteadySection, equivalent_wall, steady_section

_PLACES = 0.25, 0.5, 0.75  # over the length: outputs of a case without sensors, to measure the reduced model's error


@dataclass(frozen=True, eq=False)
class SectionSolution(ResultObject):
    """A section, solved.

    Args:
        case: with the section and the sensors.
        model: full-order, with the sensors as outputs.
        equivalent: the homogeneous wall; None where an edge is held at a temperature.
        dynamic_diffusivity: of the homogeneous wall whose slowest mode between its faces decays as the section's does,
            `L^2 |f_1| / pi^2`, m2/s; None where there is no equivalent wall, or with a surface resistance.
        order: of the reduced model.
        error: of its outputs, K for each K of a face that varies by the day.
        theta_error: of its sensitivities, relative.
        mesh_error: relative change of the equivalent wall's conductivity where each cell of the mesh is cut into four.
        steady: the steady state, where two temperatures were given.
        temperatures: of the nodes at a time of the record, where one was chosen, degC, `(y, x)`.
        one_dimension: what an estimate in one dimension would be off by, where it was asked for.
    """

    case: SectionCase = field(repr=False)
    model: SectionModel = field(repr=False)
    equivalent: EquivalentWall | None
    dynamic_diffusivity: float | None
    order: int
    error: float
    theta_error: float
    mesh_error: float | None
    steady: SteadySection | None = None
    temperatures: np.ndarray | None = field(default=None, repr=False)
    one_dimension: ResultObject | None = field(default=None, repr=False)

    @property
    def cells(self) -> int:
        """Of the mesh."""
        return self.model.mesh.cells.size

    def to_dict(self) -> dict[str, Any]:
        """The entry "section" of result.json."""
        entries: dict[str, Any] = {"cells": self.cells, "order": self.order, "error": self.error}
        entries |= {"theta_error": self.theta_error, "mesh_error": self.mesh_error}
        for name in ("conductivity", "heat_capacity", "diffusivity", "resistance"):
            entries[name] = None if self.equivalent is None else getattr(self.equivalent, name)
        entries["dynamic_diffusivity"] = self.dynamic_diffusivity
        areas = self.case.section.areas.tolist()
        entries["areas"] = {one.name: area for one, area in zip(self.case.section.materials, areas, strict=True)}
        if self.steady is not None:
            names = ("left", "right", "temperatures", "heat_flow")
            entries["steady"] = {name: getattr(self.steady, name) for name in names}
        if self.one_dimension is not None:
            entries["one_dimension"] = self.one_dimension.to_dict()
        return plain_value(entries)

    def __str__(self) -> str:
        own = self.case.section
        shares = ", ".join(
            f"{one.name} {100 * area:.3g} %" for one, area in zip(own.materials, own.areas.tolist(), strict=True)
        )
        lines = [
            f"section      {own.length:g} m x {own.height:g} m: {shares}; {self.cells} cells",
            f"reduced      order {self.order}: error {self.error:.1e} K per K, of sensitivities {self.theta_error:.1e}",
        ]
        if self.equivalent is not None:
            wall = self.equivalent
            lines += [
                f"equivalent   conductivity {wall.conductivity:.4g} W/m/K, capacity {wall.heat_capacity:.4g} J/m3/K",
                f"             to {self.mesh_error:.1e} by the mesh's change when its cells are halved",
                f"             diffusivity {wall.diffusivity:.4g} m2/s, resistance {wall.resistance:.4g} m2 K/W",
            ]
        if self.dynamic_diffusivity is not None:
            lines.append(f"dynamic      diffusivity {self.dynamic_diffusivity:.4g} m2/s, by the slowest mode")
        if self.steady is not None:
            flow = "the heat flow has no limit, at a corner of two temperatures"
            if self.steady.heat_flow is not None:
                flow = f"{self.steady.heat_flow:.4g} W for each metre of depth"
            lines.append(f"steady       {self.steady.left:g} degC left, {self.steady.right:g} degC right: "
                         f"{flow}")  # fmt: skip
            lines += [f"             {name} {value:.2f} degC" for name, value in self.steady.temperatures.items()]
        if self.one_dimension is not None:
            lines.append(str(self.one_dimension))
        return "\n".join(lines)


def solve_section(
    case: SectionCase, left: float | None = None, right: float | None = None, *, progress: Progress | None = None
) -> SectionSolution:
    """The mesh, the equivalent wall and the reduced model of a section, and its steady state.

    Args:
        case: with the section and the sensors; a sensor without a height is the mean over the section's height.
        left, right: temperatures given at the faces, degC; None for no steady state.
        progress: called as `progress(text, share)`; None for a bar in a notebook, and nothing elsewhere.

    Raises:
        InputError: a step that does not fit the section, or a sensor outside it.
    """
    points = [SectionPoint(one.position, one.height, one.name) for one in case.sensors]
    with shown_progress(progress) as report:
        report("section: mesh", 0.0)
        model = full_order_section(case.section, points)
        tested = model if points else full_order_section(
            case.section, [SectionPoint(share * case.section.length) for share in _PLACES], mesh=model.mesh
        )  # fmt: skip
        materials = MaterialRange.of(case.section)
        reduced = reduce_section(tested.model, materials, progress=part_of(report, 0.1, 0.9))
        report("section: steady state", 0.9)
        steady = None if left is None or right is None else steady_section(model, left, right)
        equivalent, dynamic, mesh_error = equivalent_wall(model), None, None
        if equivalent is not None:
            finer = equivalent_wall(full_order_section(case.section, mesh=model.mesh.refined()))
            assert finer is not None
            mesh_error = abs(finer.conductivity / equivalent.conductivity - 1.0)
            if not (case.section.surface_resistance_left or case.section.surface_resistance_right):
                dynamic = _dynamic_diffusivity(model, reduced.model)
    return SectionSolution(
        case, model, equivalent, dynamic, reduced.order, reduced.error, reduced.theta_error, mesh_error, steady
    )


def _dynamic_diffusivity(section: SectionModel, reduced: AffineModel) -> float:
    """The diffusivity of the homogeneous wall with the slowest mode of a section, m2/s."""
    E, K, _ = reduced.at(section.conductivity, section.heat_capacity)
    rates, _ = generalised_modes(E, K)
    return float(-rates.max()) * section.section.length**2 / math.pi**2
