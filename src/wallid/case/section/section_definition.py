"""A section through a wall: which material is where, and what happens at its edges.

x goes from the left to the right face, y up the wall. Between the lines of a tensor grid each cell has one material, so
that every joint lies on a line.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Literal, no_type_check

import numpy as np

from ..._internal.errors import InputError
from ..._internal.validation import number, one_of, set_fields
from ..wall_and_sensors import SIDES, Side
from .section_materials import SectionMaterial

Edge = Literal["adiabatic", "left", "right"]
_HEIGHTS = 64  # that a section's height is divided into at least
_THIN_SHARE = 0.1  # of a material's area that may be thinner than its thinnest part: tips and corners


@no_type_check
@dataclass(frozen=True, eq=False)
class Section:
    """A section through a wall, a rectangle of cells with one material each.

    `section_of_regions` and `section_of_picture` make one.

    Args:
        materials: of the cells.
        x_lines, y_lines: lines between the cells, m from the left face and from the bottom, increasing.
        cells: index of each cell's material, `(y, x)`.
        step: size of the mesh beside a joint, m; None for a third of the thinnest part, and at most a fortieth of the
            shorter side.
        surface_resistance_left, surface_resistance_right: between the given temperature and the face, m2 K/W; 0 where
            the face's own temperature is given.
        bottom, top: "adiabatic" (a plane of mirror symmetry), or the face at whose given temperature the edge is held.

    Raises:
        InputError: a value is outside its limits.
        ValueError: arrays that do not fit each other.
    """

    materials: tuple[SectionMaterial, ...]
    x_lines: np.ndarray
    y_lines: np.ndarray
    cells: np.ndarray
    _: KW_ONLY
    step: float | None = None
    surface_resistance_left: float = 0.0
    surface_resistance_right: float = 0.0
    bottom: Edge = "adiabatic"
    top: Edge = "adiabatic"

    def __post_init__(self) -> None:
        arrays = {name: np.asarray(getattr(self, name), float) for name in ("x_lines", "y_lines")}
        set_fields(self, materials=tuple(self.materials), cells=np.asarray(self.cells, int), **arrays)
        shape = len(self.y_lines) - 1, len(self.x_lines) - 1
        if self.cells.shape != shape:
            raise ValueError(f"cells has shape {self.cells.shape}; the lines need {shape}")
        if not (np.all(np.diff(self.x_lines) > 0) and np.all(np.diff(self.y_lines) > 0)):
            raise ValueError("x_lines and y_lines must increase")
        if self.cells.min() < 0 or self.cells.max() >= len(self.materials):
            raise ValueError(f"cells must be indices of the {len(self.materials)} materials")
        names = [material.name for material in self.materials]
        if len(set(names)) < len(names):
            raise InputError(f"the materials are {', '.join(names)}; names must differ")
        if self.step is not None:
            set_fields(self, step=number("step", self.step, "m", above=0.0))
        for name in ("surface_resistance_left", "surface_resistance_right"):
            set_fields(self, **{name: number(name, getattr(self, name), "m2 K/W", minimum=0.0)})
        for name in ("bottom", "top"):
            one_of(name, getattr(self, name), ("adiabatic", *SIDES))

    @property
    def length(self) -> float:
        """From the left to the right face, m."""
        return float(self.x_lines[-1] - self.x_lines[0])

    @property
    def height(self) -> float:
        """From the bottom to the top, m."""
        return float(self.y_lines[-1] - self.y_lines[0])

    @property
    def is_adiabatic(self) -> bool:
        """Whether heat enters and leaves through the two faces only."""
        return self.bottom == self.top == "adiabatic"

    @property
    def is_homogeneous(self) -> bool:
        """Whether all is of one material."""
        return len(np.unique(self.cells)) == 1

    @property
    def why_not_estimated(self) -> str:
        """Why an estimate does not take this section; empty where it does."""
        if not self.is_adiabatic:
            return 'an estimate needs bottom = "adiabatic" and top = "adiabatic"'
        if self.surface_resistance_left or self.surface_resistance_right:
            return (
                "an estimate takes the temperatures of the faces themselves; surface_resistance_left and "
                "surface_resistance_right are for `wallid section` and must be 0"
            )
        return ""

    def surface_resistance(self, face: Side) -> float:
        """Between the given temperature of a face and the face itself, m2 K/W."""
        return self.surface_resistance_left if face == "left" else self.surface_resistance_right

    @property
    def areas(self) -> np.ndarray:
        """The share of each material in the section's area, 1."""
        cell = np.diff(self.y_lines)[:, None] * np.diff(self.x_lines)
        areas = np.bincount(self.cells.ravel(), cell.ravel(), minlength=len(self.materials))
        return areas / areas.sum()

    @property
    def mean_heat_capacity(self) -> float:
        """J/m3/K."""
        return float(self.areas @ [material.heat_capacity for material in self.materials])

    @property
    def conductivity_bounds(self) -> tuple[float, float]:
        """The bounds of Wiener of the effective conductivity along x, W/m/K: all in series, and all in parallel."""
        conductivity = np.array([material.conductivity for material in self.materials])
        return float(1.0 / (self.areas @ (1.0 / conductivity))), float(self.areas @ conductivity)

    @property
    def diffusivity_prior(self) -> float:
        """A first value of the effective diffusivity, m2/s: the geometric mean of the bounds over the mean capacity."""
        low, high = self.conductivity_bounds
        return float(np.sqrt(low * high)) / self.mean_heat_capacity

    def material_at(self, x: float, y: float) -> SectionMaterial:
        """The material at a point, m; on a joint that to the left of it or below it, as readings are interpolated."""
        row = int(np.clip(np.searchsorted(self.y_lines, y, side="left") - 1, 0, self.cells.shape[0] - 1))
        return self.materials[self.cells[row, self._column(x)]]

    def heights_at(self, x: float) -> tuple[np.ndarray, np.ndarray]:
        """Heights at a distance from the left face, m, and the length of wall that each stands for, m.

        Each run of one material has at least one, in the middle of its part, and none stands for more than 1/64 of the
        section's height.
        """
        column = self._column(x)
        starts = np.flatnonzero(np.diff(self.cells[:, column], prepend=-1))
        ends = np.append(starts[1:], len(self.cells))
        heights, lengths = [], []
        for begin, end in zip(self.y_lines[starts], self.y_lines[ends], strict=True):
            count = math.ceil((end - begin) / self.height * _HEIGHTS - 1e-9)
            heights.append(begin + (end - begin) * (np.arange(count) + 0.5) / count)
            lengths.append(np.full(count, (end - begin) / count))
        return np.concatenate(heights), np.concatenate(lengths)

    def _column(self, x: float) -> int:
        """The column of cells that a distance from the left face lies in; on a joint the one before it."""
        return int(np.clip(np.searchsorted(self.x_lines, x, side="left") - 1, 0, self.cells.shape[1] - 1))

    def thinnest_part(self) -> tuple[SectionMaterial, float]:
        """The material with the thinnest part, and the thickness of that part, m.

        A point is as thick as the shorter of the two lines through it, along x and along y, that stay in its material.
        A tenth of each material may be thinner: tips and corners are not what the heat must pass.
        """
        thickness = np.minimum(
            _run_lengths(self.cells, np.diff(self.x_lines), (False, False)),
            _run_lengths(self.cells.T, np.diff(self.y_lines), (self.bottom == "adiabatic", self.top == "adiabatic")).T,
        )
        area = np.diff(self.y_lines)[:, None] * np.diff(self.x_lines)
        found = []
        for number_of, material in enumerate(self.materials):
            own = self.cells == number_of
            if own.any():
                order = np.argsort(thickness[own])
                share = np.cumsum(area[own][order]) / area[own].sum()
                found.append((float(thickness[own][order][np.searchsorted(share, _THIN_SHARE)]), material))
        thinnest, material = min(found, key=lambda one: one[0])
        return material, thinnest


def _run_lengths(cells: np.ndarray, widths: np.ndarray, mirrored: Sequence[bool]) -> np.ndarray:
    """The length of the unbroken run of one material along the last axis through each cell, m.

    Args:
        cells: index of the material, `(other, along)`.
        widths: of the cells, m.
        mirrored: whether the first and the last end are planes of symmetry, behind which the run goes on.
    """
    result = np.empty(cells.shape)
    for row, lengths in zip(cells, result, strict=True):
        starts = np.flatnonzero(np.diff(row, prepend=-1))
        runs = np.add.reduceat(widths, starts)
        for end, is_mirrored in zip((0, -1), mirrored, strict=True):
            runs[end] *= 2.0 if is_mirrored else 1.0
        lengths[:] = np.repeat(runs, np.diff(starts, append=len(row)))
    return result
