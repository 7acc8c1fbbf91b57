"""A section in a steady state, and the homogeneous wall that is equivalent to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..._internal.result_object import ResultObject
from ...case.wall_and_sensors import Side
from .affine_model import Factorised
from .full_order_section import SectionModel, node_coupling


@dataclass(frozen=True, eq=False)
class SteadySection(ResultObject):
    """A section in a steady state.

    Args:
        left, right: the given temperatures, degC.
        field: temperature of the nodes, degC, `(y, x)`.
        temperatures: of the model's outputs by name, degC.
        heat_flow: through the left face, W for each metre of depth, positive along +x; None where the face meets an
            edge of another temperature: there it has no limit.
        heat_flow_right: the same through the right face.
    """

    left: float
    right: float
    field: np.ndarray
    temperatures: dict[str, float]
    heat_flow: float | None
    heat_flow_right: float | None


@dataclass(frozen=True)
class EquivalentWall(ResultObject):
    """The homogeneous wall with the steady heat flow and the heat capacity of a section.

    Args:
        conductivity: W/m/K. heat_capacity: J/m3/K.
        resistance: from face to face, m2 K/W.
    """

    conductivity: float
    heat_capacity: float
    resistance: float

    @property
    def diffusivity(self) -> float:
        """m2/s."""
        return self.conductivity / self.heat_capacity


def steady_section(
    section: SectionModel, left: float, right: float, conductivity: np.ndarray | None = None
) -> SteadySection:
    """A section between two temperatures that do not change.

    `0 = K x + B q`

    Args:
        section: its model.
        left, right: the temperatures given at the faces (behind the surface resistances where there are any), degC.
        conductivity: of the materials, W/m/K; None for the stated ones.
    """
    conductivity = section.conductivity if conductivity is None else conductivity
    _, K, B = section.model.at(conductivity, section.heat_capacity)
    inputs = np.array([left, right])
    state = Factorised(-K).solve(B @ inputs)
    field = section.field(state, inputs)
    outputs = section.model.C @ state + section.model.D @ inputs
    return SteadySection(
        left=left,
        right=right,
        field=field,
        temperatures=dict(zip(section.model.output_names, outputs.tolist(), strict=True)),
        heat_flow=_heat_into(section, field, "left", left, conductivity),
        heat_flow_right=_negative(_heat_into(section, field, "right", right, conductivity)),
    )


def _negative(value: float | None) -> float | None:
    return None if value is None else -value


def _heat_into(
    section: SectionModel, field: np.ndarray, face: Side, given: float, conductivity: np.ndarray
) -> float | None:
    """The heat that enters through a face, W for each metre of depth; None where it has no limit."""
    own = section.section
    if any(edge not in ("adiabatic", face) for edge in (own.bottom, own.top)) and not own.surface_resistance(face):
        return None
    column = 0 if face == "left" else -1
    resistance = own.surface_resistance(face)
    if resistance > 0.0:
        on_face = field[:, column]
        return float(np.trapezoid(given - on_face, section.mesh.y) / resistance)
    gained = (node_coupling(section.section, section.mesh, conductivity) @ field.ravel()).reshape(field.shape)
    return float(-gained[:, column].sum())


def equivalent_wall(section: SectionModel, conductivity: np.ndarray | None = None) -> EquivalentWall | None:
    """The equivalent homogeneous wall of a section; None where an edge is not adiabatic.

    `R = H (T_left - T_right) / Q` less the surface resistances, `k = L / R`, and the mean heat capacity by area.

    Args:
        section: its model.
        conductivity: of the materials, W/m/K; None for the stated ones.
    """
    own = section.section
    if not own.is_adiabatic:
        return None
    flow = steady_section(section, 1.0, 0.0, conductivity).heat_flow
    assert flow is not None
    resistance = own.height / flow - own.surface_resistance_left - own.surface_resistance_right
    return EquivalentWall(own.length / resistance, own.mean_heat_capacity, resistance)


def heat_flux(
    section: SectionModel, field: np.ndarray, conductivity: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The heat flux along x and along y in the middle of each cell, W/m2, `(y, x)`.

    Args:
        section: its model.
        field: temperature of the nodes, degC, `(y, x)`.
        conductivity: of the materials along x, W/m/K; None for the stated ones.
    """
    mesh, materials = section.mesh, section.section.materials
    k = section.conductivity if conductivity is None else conductivity
    ratio = np.array([material.anisotropy for material in materials])
    across, up = np.diff(field, axis=1), np.diff(field, axis=0)
    gradient_x = 0.5 * (across[1:] + across[:-1]) / np.diff(mesh.x)
    gradient_y = 0.5 * (up[:, 1:] + up[:, :-1]) / np.diff(mesh.y)[:, None]
    return -k[mesh.cells] * gradient_x, -(k * ratio)[mesh.cells] * gradient_y
