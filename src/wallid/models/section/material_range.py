"""Values of a section's materials over which a reduced-order model is to hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from ...case.section.section_definition import Section

RANGE = 2.0
"""Standard deviations of each material's logarithms that a range covers, either way."""


@dataclass(frozen=True)
class MaterialRange:
    """The materials' values about the stated ones, within two prior standard deviations.

    Args:
        conductivity: of each material, W/m/K. heat_capacity: J/m3/K.
        log_std: prior standard deviation of the logarithm of both, of each material.
    """

    conductivity: tuple[float, ...]
    heat_capacity: tuple[float, ...]
    log_std: tuple[float, ...]

    @classmethod
    def of(cls, section: Section) -> MaterialRange:
        """The range of the materials of a section."""
        values = [(one.conductivity, one.heat_capacity, one.uncertainty) for one in section.materials]
        conductivity, heat_capacity, log_std = zip(*values, strict=True)
        return cls(conductivity, heat_capacity, log_std)

    def at(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Conductivities and heat capacities at a point: those of the conductivities, then of the capacities.

        Args:
            z: in prior standard deviations of the logarithms, `(2 material,)`.
        """
        z, std = np.asarray(z).reshape(2, -1), np.array(self.log_std)
        return self.conductivity * np.exp(std * z[0]), self.heat_capacity * np.exp(std * z[1])

    @property
    def slowest(self) -> np.ndarray:
        """The corner of the range with the lowest conductivities and the highest heat capacities, as in `at`."""
        free = np.array(self.log_std) > 0.0
        return RANGE * np.concatenate([-1.0 * free, 1.0 * free])

    def points(self, count: int, seed: int) -> np.ndarray:
        """Points that fill the range evenly, `(count, 2 material)`; 0 where a material is known."""
        free = np.tile(np.array(self.log_std) > 0.0, 2)
        points = np.zeros((count, len(free)))
        if free.any():
            power = (count - 1).bit_length()
            unit = qmc.Sobol(int(free.sum()), rng=np.random.default_rng(seed)).random_base2(power)[:count]
            points[:, free] = RANGE * (2.0 * unit - 1.0)
        return points
