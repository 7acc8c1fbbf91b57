"""One section of random coursed rubble, conductivities 3 to 1, with three sensors: for the benchmarks of sections."""

from __future__ import annotations

import numpy as np

from benchmarks.reference.section_by_finite_elements import ElementSection, Rectangle
from wallid.case.section import Section, SectionMaterial, coursed_rubble, section_of_regions
from wallid.models.section import SectionPoint

LENGTH, HEIGHT = 0.5, 0.4  # m
MATERIALS = SectionMaterial("stone", 1.5, 2.0e6), SectionMaterial("mortar", 0.5, 1.5e6)
POINTS = SectionPoint(0.1, 0.25, "T1"), SectionPoint(0.25, 0.21, "T2"), SectionPoint(0.42, 0.33, "T3")
_REGIONS = coursed_rubble(LENGTH, HEIGHT, seed=1)


def stone_section(step: float | None = None) -> Section:
    """The section; `step` is the size of the mesh beside a joint, m."""
    return section_of_regions(LENGTH, HEIGHT, MATERIALS, _REGIONS, step=step)


def in_elements(size: float, factor: float = 1.0) -> ElementSection:
    """The same section in finite elements of a size in m, all conductivities times a factor."""
    values = {one.name: (factor * one.conductivity, one.heat_capacity) for one in MATERIALS}
    return ElementSection(LENGTH, HEIGHT, [Rectangle(one.x, one.y, *values[one.material]) for one in _REGIONS], size)


def hourly_faces(days: float, seed: int) -> np.ndarray:
    """Faces that no reduced model has been made from: daily cycles and red noise, degC, `(time, 2)`."""
    rows, rng = round(24 * days), np.random.default_rng(seed)
    noise, time = np.zeros((rows, 2)), np.arange(rows) / 24.0
    for row in range(1, rows):
        noise[row] = 0.9 * noise[row - 1] + rng.standard_normal(2)
    daily = np.stack([8 + 6 * np.sin(2 * np.pi * time + 1), 19 + 2 * np.sin(2 * np.pi * time)], axis=1)
    return daily + noise
