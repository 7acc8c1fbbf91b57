"""Effects at the two faces: errors of the face sensors and heat transfer at the surface."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from ..._internal.units import DAY
from ...case.wall_and_sensors import SIDES, Side
from .base import AbstractEffect, Parameter, lower_bounded, parameter_field
from .equation_terms import CONSTANT, DERIVATIVE, ForcingData, Terms


class OneFace(AbstractEffect):
    """An effect at one face."""

    side: eqx.AbstractVar[Side]

    @property
    def target(self) -> Side:
        """The face."""
        return self.side

    @property
    def mask(self) -> np.ndarray:
        """1 at this face, 0 at the other."""
        return np.array([float(side == self.side) for side in SIDES])


class FaceOffset(OneFace):
    """Offset of a face sensor: `T_face = reading - offset`."""

    name: ClassVar[str] = "face_offset"
    parameters: ClassVar = (Parameter("offset", "K", 0.2, smallest_reported=0.05),)
    side: Side = eqx.field(static=True, default="left")
    offset: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(faces=-self.offset * (CONSTANT[:, None] * self.mask))


class FaceLag(OneFace):
    """Lag of a face sensor: `T_face = reading + time_constant d(reading)/dt`, by the cubic between rows."""

    name: ClassVar[str] = "face_lag"
    parameters: ClassVar = (Parameter("time_constant", "s", 600.0, smallest_reported=120.0, lower=0.0, upper=2 * DAY),)
    side: Side = eqx.field(static=True, default="left")
    time_constant: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        reading = forcing.faces[:, :, SIDES.index(self.side)]
        slope = reading @ DERIVATIVE / forcing.step
        return terms.add(faces=lower_bounded(self.time_constant, 0.0) * slope[:, :, None] * self.mask)


class FaceDepth(OneFace):
    """A face sensor at `depth` inside the wall: the modelled wall begins at `x = depth`, of length `L - depth`."""

    name: ClassVar[str] = "face_depth"
    parameters: ClassVar = (Parameter("depth", "m", 5e-3, smallest_reported=2e-3, lower=0.0),)
    side: Side = eqx.field(static=True, default="left")
    depth: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(depth=lower_bounded(self.depth, 0.0) * self.mask)

    def bounds(self, parameter, search_range):
        """Depths less than that of the nearest inner sensor."""
        return 0.0, 0.9 * search_range.face_clearance[SIDES.index(self.side)]


class SolarGain(OneFace):
    """Solar gain of a face: `T_face = reading + gain G`, with the irradiance G on the outer face in W/m2."""

    name: ClassVar[str] = "solar_gain"
    parameters: ClassVar = (Parameter("gain", "K m2/W", 2e-3, smallest_reported=2e-4),)
    needs: ClassVar[tuple[str, ...]] = ("irradiance",)
    side: Side = eqx.field(static=True, default="left")
    gain: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(faces=self.gain * forcing.irradiance[:, :, None] * self.mask)


class SurfaceFilm(OneFace):
    """Surface film: `k dT/dn = h (reading - T_face)`, n outward; the reading is that of the air, film_length = k/h."""

    name: ClassVar[str] = "surface_film"
    parameters: ClassVar = (Parameter("film_length", "m", 0.02, smallest_reported=2e-3, lower=0.0, upper=10.0),)
    side: Side = eqx.field(static=True, default="left")
    film_length: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(film=lower_bounded(self.film_length, 0.0) * self.mask)
