"""A section of rectangles, and patterns of them: coursed rubble, brick with joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, no_type_check

import numpy as np

from ..._internal.errors import InputError
from ..._internal.validation import error_context, integer, number, number_tuple, set_fields, spelling_hint, text
from .section_definition import Section
from .section_materials import SectionMaterial

_ROUNDING = 1e-9  # of the section's size: lines that are closer are one


@no_type_check
@dataclass(frozen=True)
class Region:
    """A rectangle of one material.

    Args:
        material: its name.
        x: from, to, m from the left face.
        y: from, to, m from the bottom.

    Raises:
        InputError: a value is not a number, or a range does not increase.
    """

    material: str
    x: tuple[float, float]
    y: tuple[float, float]

    def __post_init__(self) -> None:
        text("material", self.material)
        for name in ("x", "y"):
            values = number_tuple(name, getattr(self, name), "m", min_count=2)
            if len(values) != 2 or not values[0] < values[1]:
                raise InputError(f"{name} = {list(values)}; it must be [from, to] in m, with from below to")
            set_fields(self, **{name: values})


def section_of_regions(
    length: float, height: float, materials: Sequence[SectionMaterial], regions: Sequence[Region], **edges: Any
) -> Section:
    """A section of rectangles; later ones lie over earlier ones.

    Args:
        length, height: of the section, m.
        materials: of the regions.
        regions: they must cover the section; what is outside it is cut off.
        edges: `step`, `surface_resistance_left`, `surface_resistance_right`, `bottom`, `top` of `Section`.

    Raises:
        InputError: a region of an unknown material, or outside the section; a part without a material.
    """
    length, height = number("length", length, "m", above=0.0), number("height", height, "m", above=0.0)
    names = [material.name for material in materials]
    x_lines = _lines([end for region in regions for end in region.x], length)
    y_lines = _lines([end for region in regions for end in region.y], height)
    cells = np.full((len(y_lines) - 1, len(x_lines) - 1), -1)
    for count, region in enumerate(regions, start=1):
        with error_context(f"[[section.region]] {count}"):
            if region.material not in names:
                hint = spelling_hint(region.material, names)
                raise InputError(f'material = "{region.material}"; known are {", ".join(names) or "none"}{hint}')
            rows, columns = _between(y_lines, region.y), _between(x_lines, region.x)
            if not rows.any() or not columns.any():
                raise InputError(
                    f"x = {list(region.x)}, y = {list(region.y)}: outside the section, {length:g} x {height:g} m"
                )
            cells[np.ix_(rows, columns)] = names.index(region.material)
    if (cells < 0).any():
        row, column = np.argwhere(cells < 0)[0]
        raise InputError(
            f"there is no material at x = {0.5 * (x_lines[column] + x_lines[column + 1]):.4g} m, "
            f"y = {0.5 * (y_lines[row] + y_lines[row + 1]):.4g} m; begin with a [[section.region]] that covers all"
        )
    return Section(tuple(materials), x_lines, y_lines, cells, **edges)


def _lines(ends: Sequence[float], size: float) -> np.ndarray:
    """The distinct lines inside a section, its two ends included."""
    inside = np.sort([0.0, size, *(end for end in ends if 0.0 < end < size)])
    inside = inside[np.diff(inside, prepend=-size) > _ROUNDING * size]
    if size - inside[-1] < _ROUNDING * size:
        inside[-1] = size
    return inside


def _between(lines: np.ndarray, ends: tuple[float, float]) -> np.ndarray:
    """The cells whose middle lies in a range."""
    middle = 0.5 * (lines[1:] + lines[:-1])
    return (middle > ends[0]) & (middle < ends[1])


def coursed_rubble(
    length: float,
    height: float,
    *,
    stone: str = "stone",
    mortar: str = "mortar",
    courses: int = 4,
    stone_length: float = 0.2,
    joint: float = 0.015,
    irregularity: float = 0.3,
    grid: float = 0.005,
    seed: int = 0,
) -> tuple[Region, ...]:
    """Stones of random sizes in courses, with joints of mortar between them.

    Args:
        length, height: of the section, m.
        stone, mortar: names of the materials.
        courses: number of courses.
        stone_length: mean length of a stone with its joint, m.
        joint: thickness of the joints, m.
        irregularity: standard deviation of the sizes over their mean, 1.
        grid: stones end on multiples of it, m: a mesh then needs no slivers.
        seed: of the random sizes.

    Returns:
        A region of mortar, and one for each stone. Half a joint is at the bottom and at the top.

    Raises:
        InputError: a value is outside its limits.
    """
    for name, value in (("stone_length", stone_length), ("joint", joint), ("grid", grid)):
        number(name, value, "m", above=0.0)
    integer("courses", courses, 1)
    number("irregularity", irregularity, minimum=0.0, maximum=1.0)
    rng = np.random.default_rng(seed)
    regions = [Region(mortar, (0.0, length), (0.0, height))]
    y_ends = _random_ends(rng, height, courses, irregularity, grid)
    for low, high in pairwise(y_ends):
        count = max(1, round(length / stone_length + rng.uniform(-0.5, 0.5)))
        x_ends = _random_ends(rng, length, count, irregularity, grid)
        y = low + 0.5 * joint, high - 0.5 * joint
        for number_of, (left, right) in enumerate(pairwise(x_ends)):
            # stones reach the faces: joints are between stones
            is_last = number_of == len(x_ends) - 2
            x = left + (0.5 * joint if number_of else 0.0), right - (0.0 if is_last else 0.5 * joint)
            if x[1] - x[0] > 0.0 and y[1] - y[0] > 0.0:
                regions.append(Region(stone, x, y))
    return tuple(regions)


def _random_ends(rng: np.random.Generator, size: float, count: int, irregularity: float, grid: float) -> np.ndarray:
    """The ends of some parts of random sizes that fill a length, on multiples of a grid."""
    parts = np.maximum(1.0 + irregularity * rng.standard_normal(count), 0.3)
    ends = np.concatenate([[0.0], np.cumsum(parts)]) * size / parts.sum()
    inside = np.unique(np.round(ends[1:-1] / grid)) * grid
    return np.concatenate([[0.0], inside[(inside > 0.0) & (inside < size)], [size]])


def brick_with_joints(
    length: float,
    height: float,
    *,
    brick: str = "brick",
    mortar: str = "mortar",
    brick_length: float = 0.24,
    brick_height: float = 0.071,
    joint: float = 0.012,
) -> tuple[Region, ...]:
    """Bricks in running bond, each course half a brick beside the last, with joints of mortar.

    Args:
        length, height: of the section, m.
        brick, mortar: names of the materials.
        brick_length, brick_height: of a brick without its joints, m.
        joint: thickness of the joints, m.

    Returns:
        A region of mortar, and one for each brick. Half a joint is at the bottom.

    Raises:
        InputError: a value is outside its limits.
    """
    for name, value in (("brick_length", brick_length), ("brick_height", brick_height), ("joint", joint)):
        number(name, value, "m", above=0.0)
    regions = [Region(mortar, (0.0, length), (0.0, height))]
    for course in range(int(np.ceil(height / (brick_height + joint)))):
        low = course * (brick_height + joint) + 0.5 * joint
        begin = -0.5 * (course % 2) * (brick_length + joint)
        while begin < length:
            ends = max(begin, 0.0), min(begin + brick_length, length)
            if ends[1] > ends[0] and low < height:
                regions.append(Region(brick, ends, (low, min(low + brick_height, height))))
            begin += brick_length + joint
    return tuple(regions)
