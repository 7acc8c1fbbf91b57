"""Effects in the heat flux plates on the faces: gain, offset, lag, and the resistance between the face and its reading.

The conductivity of the wall is estimated beside them. So the gain of a single plate has no trace in its readings, and
of two plates the readings show the ratio of the gains only.
"""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from ...case.wall_and_sensors import Side
from ...records.reading_pipeline import PLATES
from .base import Parameter, lower_bounded, parameter_field
from .equation_terms import ForcingData, Terms
from .faces import OneFace

_HOUR = 3600.0


class OnePlate(OneFace):
    """An effect in the plate of one face."""

    @property
    def column(self) -> str:
        """The regressor with the plate's readings."""
        return f"flux_{self.side}"

    def required_regressors(self) -> tuple[str, ...]:
        """The plate's readings, and what the effect needs beside them."""
        return tuple(dict.fromkeys((self.column, *self.needs)))


class PlateGain(OnePlate):
    """Calibration error of a plate: `reading = (1 + gain) q`, with a plate at the other face too."""

    name: ClassVar[str] = "plate_gain"
    parameters: ClassVar = (Parameter("gain", "", 0.1, smallest_reported=0.02, lower=-0.9),)
    needs: ClassVar[tuple[str, ...]] = PLATES
    side: Side = eqx.field(static=True, default="left")
    gain: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(plate_gain=self.gain * self.mask)


class PlateOffset(OnePlate):
    """Offset of a plate: `reading = q + offset`."""

    name: ClassVar[str] = "plate_offset"
    parameters: ClassVar = (Parameter("offset", "W/m2", 1.0, smallest_reported=0.2),)
    side: Side = eqx.field(static=True, default="left")
    offset: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(plate_offset=self.offset * self.mask)


class PlateLag(OnePlate):
    """Lag of a plate: `time_constant dy/dt + y = q`, with the cubic between rows."""

    name: ClassVar[str] = "plate_lag"
    parameters: ClassVar = (
        Parameter("time_constant", "s", 600.0, smallest_reported=60.0, lower=0.0, upper=12 * _HOUR),
    )
    side: Side = eqx.field(static=True, default="left")
    time_constant: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(plate_lag=lower_bounded(self.time_constant, 0.0) * self.mask)


class PlateResistance(OnePlate):
    """Resistance of a plate and its contact, between the face's reading and the wall: `q = (reading - T_face) / r`.

    A surface film of the length `k r` gives the same readings. A film of air has more than 0.03 m2 K/W, a plate with
    its adhesive less.
    """

    name: ClassVar[str] = "plate_resistance"
    parameters: ClassVar = (Parameter("resistance", "m2 K/W", 5e-3, smallest_reported=5e-4, lower=0.0, upper=0.03),)
    special_case_of: ClassVar[str] = "surface_film"
    side: Side = eqx.field(static=True, default="left")
    resistance: Float[Array, ""] = parameter_field()

    def apply(self, terms: Terms, forcing: ForcingData) -> Terms:
        """The terms with this effect added."""
        return terms.add(plate_resistance=lower_bounded(self.resistance, 0.0) * self.mask)
