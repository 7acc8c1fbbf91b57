"""The properties of a wall by a fit with effects: diffusivity, and with plates conductivity, capacity and resistance.

Each is a product of powers of the estimated diffusivity alpha and conductivity k and of the length L, so its logarithm
is a linear combination of two parameters. The resistance is that of the wall between its faces; films and the
resistances of plates are effects beside it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...inference.likelihood import LOG_CONDUCTIVITY, LOG_DIFFUSIVITY
from ...inference.quantity import Quantity
from ..effect_fit import EffectFit


@dataclass(frozen=True)
class WallProperty:
    """A property `alpha^a k^b L^c` of a wall.

    Args:
        name: as in result.json. unit: of the property.
        of_diffusivity, of_conductivity, of_length: the powers a, b and c.
    """

    name: str
    unit: str
    of_diffusivity: int
    of_conductivity: int
    of_length: int

    def of(self, fit: EffectFit) -> Quantity:
        """The property by a fit, with an interval that is symmetric in its logarithm, within the physical bounds."""
        return fit.quantity(self.value(fit), self.log_std(fit), self.unit)

    def value(self, fit: EffectFit) -> float:
        """The value by a fit."""
        powers = (self.of_diffusivity, self.of_conductivity, self.of_length)
        parts = (fit.diffusivity, fit.conductivity, fit.problem.case.wall.length)
        return math.prod(part**power for part, power in zip(parts, powers, strict=True) if power)

    def log_std(self, fit: EffectFit) -> float:
        """Standard deviation of its logarithm, by the noise of the fit."""
        powers = {LOG_DIFFUSIVITY: self.of_diffusivity, LOG_CONDUCTIVITY: self.of_conductivity}
        weights = np.array([float(powers.get(name, 0)) for name in fit.parameters.estimated_names])
        return math.sqrt(max(float(weights @ fit.covariance @ weights), 0.0))


DIFFUSIVITY = WallProperty("diffusivity", "m2/s", 1, 0, 0)
RESISTANCE = WallProperty("resistance", "m2 K/W", 0, -1, 1)
_WITH_PLATES = (
    WallProperty("conductivity", "W/m/K", 0, 1, 0),
    WallProperty("heat_capacity", "J/m3/K", -1, 1, 0),
    RESISTANCE,
    WallProperty("areal_heat_capacity", "J/m2/K", -1, 1, 1),
)


def wall_properties(fit: EffectFit) -> tuple[WallProperty, ...]:
    """The properties that a fit determines."""
    return (DIFFUSIVITY, *(_WITH_PLATES if LOG_CONDUCTIVITY in fit.parameters.estimated_names else ()))
