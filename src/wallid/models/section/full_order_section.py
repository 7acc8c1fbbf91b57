"""The full-order model of a section: two-dimensional conduction by finite volumes about the nodes of its mesh.

    c dT/dt = d/dx (k_x dT/dx) + d/dy (k_y dT/dy)

A node's volume is a quarter of each of the cells about it. Between two neighbours the conductance is the width of the
volumes' common side, which lies in the cell below and in the cell above it, times `k` of each, over the distance. So
the model is conservative and symmetric, affine in `k` and `c` of each material, and of second order where the joints
are lines of the mesh. A section that varies in x only has the equations of the one-dimensional wall on these lines.

Source: S. V. Patankar, Numerical Heat Transfer and Fluid Flow (1980), 4.2 (control volumes, harmonic means).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from ..._internal.errors import InputError
from ...case.section.section_definition import Section
from ...case.wall_and_sensors import SIDES
from ..finite_volume_wall import lagrange_weights
from .affine_model import AffineModel
from .tensor_mesh import TensorMesh, section_mesh


@dataclass(frozen=True)
class SectionPoint:
    """A point of a section at which the temperature is read.

    Args:
        x: m from the left face.
        y: m from the bottom; None for the mean over the section's height.
        name: of the sensor.
    """

    x: float
    y: float | None = None
    name: str = ""


@dataclass(frozen=True, eq=False)
class SectionModel:
    """A section on its mesh, as a model of the temperatures of its nodes.

    Args:
        section: the section. mesh: its mesh.
        model: of the nodes whose temperature is not given.
        unknown: these nodes' numbers, x fastest.
        given: for each node the input that it is held at, 0 (left) or 1 (right); -1 for the unknown ones.
    """

    section: Section
    mesh: TensorMesh
    model: AffineModel
    unknown: np.ndarray
    given: np.ndarray

    @property
    def conductivity(self) -> np.ndarray:
        """The stated conductivity of each material, W/m/K."""
        return np.array([material.conductivity for material in self.section.materials])

    @property
    def heat_capacity(self) -> np.ndarray:
        """The stated heat capacity of each material, J/m3/K."""
        return np.array([material.heat_capacity for material in self.section.materials])

    def field(self, state: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        """The temperature of all nodes, `(y, x)`.

        Args:
            state: of the model. inputs: the temperatures given at the left and at the right.
        """
        values = np.asarray(inputs, float)[np.maximum(self.given, 0)]
        values[self.unknown] = state
        return values.reshape(self.mesh.shape)


def full_order_section(
    section: Section,
    points: Sequence[SectionPoint] = (),
    *,
    mesh: TensorMesh | None = None,
    profile_degree: int = 2,
) -> SectionModel:
    """The full-order model of a section.

    Args:
        section: the section.
        points: whose temperatures are the outputs.
        mesh: of the section; None for that of `section_mesh`.
        profile_degree: of the initial profile's polynomial in x / length.

    Raises:
        InputError: a point outside the section, or a step that does not fit it.
    """
    mesh = section_mesh(section) if mesh is None else mesh
    given = _given_inputs(section, mesh)
    unknown = np.flatnonzero(given < 0)
    held = [scipy.sparse.csr_array(given == side, dtype=float) for side in range(2)]
    hold = scipy.sparse.vstack(held).T.tocsr()  # (node, input)
    capacity, conduction, drive = [], [], []
    for index, material in enumerate(section.materials):
        own = mesh.cells == index
        coupling = _coupling(mesh, own, material.anisotropy)
        capacity.append(scipy.sparse.diags_array(_volumes(mesh, own)[unknown], format="csr"))
        conduction.append(coupling[unknown][:, unknown])
        drive.append((coupling[unknown] @ hold).toarray())
    film, film_drive = _films(section, mesh, given)
    rows = output_rows(section, mesh, points)
    model = AffineModel(
        capacity=tuple(capacity),
        conduction=tuple(conduction),
        drive=tuple(drive),
        film=film[unknown][:, unknown],
        film_drive=film_drive[unknown],
        C=rows[:, unknown],
        D=(rows @ hold).toarray(),
        P=np.vander(np.tile(mesh.x / section.length, len(mesh.y))[unknown], profile_degree + 1, increasing=True),
        output_names=tuple(point.name for point in points),
    )
    return SectionModel(section, mesh, model, unknown, given)


def node_coupling(section: Section, mesh: TensorMesh, conductivity: np.ndarray) -> scipy.sparse.csr_array:
    """The coupling of all nodes, `(node, node)`, W/m/K: times their temperatures the heat that each one gains."""
    parts = [
        k * _coupling(mesh, mesh.cells == index, material.anisotropy)
        for index, (material, k) in enumerate(zip(section.materials, conductivity, strict=True))
    ]
    return sum(parts[1:], parts[0])


def output_rows(
    section: Section,
    mesh: TensorMesh,
    points: Sequence[SectionPoint],
    kind: Literal["temperature", "gradient"] = "temperature",
) -> scipy.sparse.csr_array:
    """The weights of all nodes for an output at some points, `(point, node)`.

    The temperature, or `du/dx*`, is interpolated by up to a cubic in x and in y, on nodes between which all is of the
    material of the point's cell: never across a joint. On a line the cell before it is taken.

    Raises:
        InputError: a point outside the section.
    """
    rows, columns, weights = [], [], []
    for row, point, height, share in _of_single_heights(section, points):
        if not (0.0 <= point.x <= section.length and 0.0 <= height <= section.height):
            raise InputError(
                f"{point.name or 'point'}: x = {point.x:g} m, y = {height:g} m is outside the section of "
                f"{section.length:g} x {section.height:g} m"
            )
        below, above, left, right = _uniform_block(mesh, _cell(mesh.y, height), _cell(mesh.x, point.x))
        along_y = lagrange_weights(mesh.y[below : above + 2], height, 0)
        along_x = lagrange_weights(mesh.x[left : right + 2], point.x, int(kind == "gradient"))
        along_x = along_x * (section.length if kind == "gradient" else 1.0)
        nodes = np.arange(below, above + 2)[:, None] * len(mesh.x) + np.arange(left, right + 2)
        rows += [row] * nodes.size
        columns += nodes.ravel().tolist()
        weights += (share * np.outer(along_y, along_x)).ravel().tolist()
    return scipy.sparse.csr_array((weights, (rows, columns)), shape=(len(points), mesh.shape[0] * mesh.shape[1]))


def _of_single_heights(
    section: Section, points: Sequence[SectionPoint]
) -> Iterator[tuple[int, SectionPoint, float, float]]:
    """Each point with its number, a height and its weight; a point without a height is at many of them."""
    for number, point in enumerate(points):
        if point.y is not None:
            yield number, point, point.y, 1.0
            continue
        heights, lengths = section.heights_at(point.x)
        for height, length in zip(heights.tolist(), lengths.tolist(), strict=True):
            yield number, point, height, length / section.height


def _cell(lines: np.ndarray, value: float) -> int:
    """The cell between lines that a coordinate lies in."""
    return int(np.clip(np.searchsorted(lines, value, side="left") - 1, 0, len(lines) - 2))


def _uniform_block(mesh: TensorMesh, row: int, column: int) -> tuple[int, int, int, int]:
    """The cell and its neighbours that are all of one material: first and last row, first and last column of cells."""
    block = [row, row, column, column]
    for end, step, limit in ((2, -1, 0), (3, 1, len(mesh.x) - 2), (0, -1, 0), (1, 1, len(mesh.y) - 2)):
        wider = list(block)
        wider[end] += step
        cells = mesh.cells[wider[0] : wider[1] + 1, wider[2] : wider[3] + 1]
        if step * block[end] < step * limit and (cells == mesh.cells[row, column]).all():
            block = wider
    return block[0], block[1], block[2], block[3]


def _given_inputs(section: Section, mesh: TensorMesh) -> np.ndarray:
    """For each node the input that it is held at; -1 where its temperature is not given."""
    given = np.full(mesh.shape, -1)
    for edge, row in ((section.bottom, 0), (section.top, -1)):
        if edge != "adiabatic":
            given[row] = SIDES.index(edge)
    for number, (side, column) in enumerate(zip(SIDES, (0, -1), strict=True)):
        if section.surface_resistance(side) == 0.0:
            given[:, column] = number
    return given.ravel()


def _volumes(mesh: TensorMesh, own: np.ndarray) -> np.ndarray:
    """The area of each node's volume that lies in some cells, m2."""
    quarter = 0.25 * own * np.diff(mesh.y)[:, None] * np.diff(mesh.x)
    volumes = np.zeros(mesh.shape)
    for rows in (slice(None, -1), slice(1, None)):
        for columns in (slice(None, -1), slice(1, None)):
            volumes[rows, columns] += quarter
    return volumes.ravel()


def _coupling(mesh: TensorMesh, own: np.ndarray, anisotropy: float) -> scipy.sparse.csr_array:
    """The coupling of all nodes by some cells of a conductivity of 1 along x, `(node, node)`; its rows sum to 0."""
    dx, dy = np.diff(mesh.x), np.diff(mesh.y)
    numbers = np.arange(mesh.shape[0] * mesh.shape[1]).reshape(mesh.shape)
    along_x, along_y = np.zeros((len(dy) + 1, len(dx))), np.zeros((len(dy), len(dx) + 1))
    for half in (slice(None, -1), slice(1, None)):
        along_x[half] += 0.5 * own * dy[:, None] / dx
        along_y[:, half] += 0.5 * own * dx / dy[:, None] * anisotropy
    first = np.concatenate([numbers[:, :-1].ravel(), numbers[:-1].ravel()])
    second = np.concatenate([numbers[:, 1:].ravel(), numbers[1:].ravel()])
    values = np.concatenate([along_x.ravel(), along_y.ravel()])
    present = values > 0.0
    first, second, values = first[present], second[present], values[present]
    entries = np.concatenate([values, values, -values, -values])
    places = np.concatenate([first, second, first, second]), np.concatenate([second, first, first, second])
    return scipy.sparse.csr_array((entries, places), shape=(numbers.size, numbers.size))


def _films(section: Section, mesh: TensorMesh, given: np.ndarray) -> tuple[scipy.sparse.csr_array, np.ndarray]:
    """The heat through the surface resistances: the part of K and that of B, over all nodes."""
    widths = np.zeros(len(mesh.y))
    for half in (slice(None, -1), slice(1, None)):
        widths[half] += 0.5 * np.diff(mesh.y)
    drive = np.zeros((*mesh.shape, 2))
    for number, (side, column) in enumerate(zip(SIDES, (0, -1), strict=True)):
        if section.surface_resistance(side) > 0.0:
            drive[:, column, number] = widths / section.surface_resistance(side)
    drive = drive.reshape(-1, 2)
    drive[given >= 0] = 0.0
    return scipy.sparse.diags_array(-drive.sum(axis=1), format="csr"), drive
