"""The mesh of a section: a graded tensor grid whose lines lie on the joints."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..._internal.errors import InputError
from ...case.section.section_definition import Section

GROWTH = 1.25
"""Ratio of neighbouring cells inside a material."""
_LARGEST = 4.0  # cell over the step beside a joint
_ACROSS = 3  # cells across the thinnest part, where no step is stated
_FEWEST_ACROSS = 2
_FEWEST = 40  # steps along the shorter side, where no step is stated
MOST_CELLS = 400_000
"""Cells of a mesh."""


@dataclass(frozen=True, eq=False)
class TensorMesh:
    """Nodes at the crossings of lines; each cell between them has one material.

    Args:
        x, y: the lines, m from the left face and from the bottom.
        cells: index of each cell's material, `(y, x)`.
    """

    x: np.ndarray
    y: np.ndarray
    cells: np.ndarray

    @property
    def shape(self) -> tuple[int, int]:
        """The number of nodes along y and along x."""
        return len(self.y), len(self.x)

    def refined(self) -> TensorMesh:
        """The mesh with each cell cut into four."""
        x, y = (
            np.insert(lines, np.arange(1, len(lines)), 0.5 * (lines[1:] + lines[:-1])) for lines in (self.x, self.y)
        )
        return TensorMesh(x, y, self.cells.repeat(2, axis=0).repeat(2, axis=1))


def section_mesh(section: Section, step: float | None = None) -> TensorMesh:
    """The mesh of a section.

    Args:
        section: the section.
        step: size of the cells beside a joint, m; None for that of the section, or a third of its thinnest part.

    Raises:
        InputError: a step too coarse for the thinnest part, or a mesh of too many cells.
    """
    step = section.step if step is None else step
    material, thinnest = section.thinnest_part()
    if step is None:
        step = min(thinnest / _ACROSS, min(section.length, section.height) / _FEWEST)
    elif step > thinnest / _FEWEST_ACROSS * (1.0 + 1e-9):
        raise InputError(
            f"step = {step:g} m is too coarse for parts of {material.name} that are {thinnest:.3g} m thick: at least "
            f"{_FEWEST_ACROSS} cells must lie across them; state at most {thinnest / _FEWEST_ACROSS:.3g} m, or none"
        )
    (x, x_part), (y, y_part) = (graded_lines(lines, step) for lines in (section.x_lines, section.y_lines))
    count = (len(x) - 1) * (len(y) - 1)
    if count > MOST_CELLS:
        raise InputError(
            f"step = {step:.3g} m needs {count} cells, more than {MOST_CELLS}: state a larger step, or a section of "
            "fewer and thicker parts"
        )
    return TensorMesh(x, y, section.cells[np.ix_(y_part, x_part)])


def graded_lines(lines: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Lines between given ones: cells of about a step beside each, growing to four steps in the middle between two.

    Args:
        lines: given, m, increasing.
        step: m.

    Returns:
        All lines, and for each cell the index of the given interval that it lies in.
    """
    ends, part = [lines[:1]], []
    for number, (begin, end) in enumerate(pairwise(lines)):
        sizes = _graded_sizes(end - begin, step)
        ends.append(np.append(begin + np.cumsum(sizes)[:-1], end))
        part += [number] * len(sizes)
    return np.concatenate(ends), np.array(part)


def _graded_sizes(width: float, step: float) -> np.ndarray:
    """Sizes of the cells of one interval: symmetric, of sum `width`, none larger than four steps."""
    count = 1
    while True:
        from_end = np.minimum(np.arange(count), np.arange(count)[::-1])
        sizes = step * np.minimum(GROWTH**from_end, _LARGEST)
        if sizes.sum() >= width * (1.0 - 1e-9):
            return sizes * width / sizes.sum()
        count += 1
