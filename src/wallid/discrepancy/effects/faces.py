"""Effects at the two faces: what their sensors read, and what reaches the wall."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from ..._internal.units import DAY
from ...case.wall_and_sensors import SIDES, Side
from .base import AbstractEffect, Parameter, not_below, number
from .equation_terms import CONSTANT, DERIVATIVE, ForcingData, Terms


class _OneFace(AbstractEffect):
    """An effect at one face."""

    side: eqx.AbstractVar[Side]

    @property
    def target(self) -> Side:
        """The face."""
        return self.side

    @property
    def _here(self) -> np.ndarray:
        """1 at this face, 0 at the other."""
        return np.array([float(side == self.side) for side in SIDES])


class FaceOffset(_OneFace):
    """`T_face = reading - offset`."""

    name: ClassVar[str] = "face_offset"
    parameters: ClassVar = (Parameter("offset", "K", 0.2, worth=0.05),)
    side: Side = eqx.field(static=True, default="left")
    offset: Float[Array, ""] = number()

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return terms.add(faces=-self.offset * (CONSTANT[:, None] * self._here))


class FaceLag(_OneFace):
    """`T_face = reading + time_constant d(reading)/dt`, of the monotone cubic through the readings."""

    name: ClassVar[str] = "face_lag"
    parameters: ClassVar = (Parameter("time_constant", "s", 600.0, worth=120.0, least=0.0, most=2 * DAY),)
    side: Side = eqx.field(static=True, default="left")
    time_constant: Float[Array, ""] = number()

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        reading = campaign.faces[:, :, SIDES.index(self.side)]
        slope = reading @ DERIVATIVE / campaign.step
        return terms.add(faces=not_below(self.time_constant, 0.0) * slope[:, :, None] * self._here)


class FaceDepth(_OneFace):
    """The face's sensor sits `depth` inside the wall: the modelled wall begins there."""

    name: ClassVar[str] = "face_depth"
    parameters: ClassVar = (Parameter("depth", "m", 5e-3, worth=2e-3, least=0.0),)
    side: Side = eqx.field(static=True, default="left")
    depth: Float[Array, ""] = number()

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return terms.add(depth=not_below(self.depth, 0.0) * self._here)

    def bounds(self, parameter, search):
        """Not as deep as the nearest sensor."""
        return 0.0, 0.9 * search.clear[SIDES.index(self.side)]


class SolarGain(_OneFace):
    """`T_face = reading + gain G`, G the irradiance on the outer face."""

    name: ClassVar[str] = "solar_gain"
    parameters: ClassVar = (Parameter("gain", "K m2/W", 2e-3, worth=2e-4),)
    needs: ClassVar[tuple[str, ...]] = ("irradiance",)
    side: Side = eqx.field(static=True, default="left")
    gain: Float[Array, ""] = number()

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return terms.add(faces=self.gain * campaign.irradiance[:, :, None] * self._here)


class SurfaceFilm(_OneFace):
    """`k dT/dn = h (T_read - T_face)`, n outward: the reading is the air's; film_length = k/h."""

    name: ClassVar[str] = "surface_film"
    parameters: ClassVar = (Parameter("film_length", "m", 0.02, worth=2e-3, least=0.0, most=10.0),)
    side: Side = eqx.field(static=True, default="left")
    film_length: Float[Array, ""] = number()

    def extend(self, terms: Terms, campaign: ForcingData) -> Terms:
        """The terms with this effect in."""
        return terms.add(film=not_below(self.film_length, 0.0) * self._here)
