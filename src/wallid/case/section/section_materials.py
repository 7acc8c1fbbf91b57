"""The materials of a section."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import no_type_check

from matplotlib.colors import is_color_like, to_hex

from ..._internal.errors import InputError
from ..._internal.validation import format_value, number, set_fields, text


@no_type_check
@dataclass(frozen=True)
class SectionMaterial:
    """A material of a section.

    Args:
        name: such as "stone".
        conductivity: along x, from the left to the right face, W/m/K.
        heat_capacity: per volume, J/m3/K.
        conductivity_y: along y, up the wall, W/m/K; None for that along x.
        uncertainty: prior standard deviation of the logarithm of the conductivity, and of that of the heat capacity, 1;
            0 where both are known.
        color: of its pixels in a picture: "#rrggbb" or a name of CSS. Figures draw the material in it.

    Raises:
        InputError: a value is outside its limits, or the colour is not one.
    """

    name: str
    conductivity: float
    heat_capacity: float
    _: KW_ONLY
    conductivity_y: float | None = None
    uncertainty: float = 0.3
    color: str | None = None

    def __post_init__(self) -> None:
        text("name", self.name)
        set_fields(
            self,
            conductivity=number("conductivity", self.conductivity, "W/m/K", above=0.0),
            heat_capacity=number("heat_capacity", self.heat_capacity, "J/m3/K", above=0.0),
            uncertainty=number("uncertainty", self.uncertainty, minimum=0.0, maximum=2.0),
        )
        if self.conductivity_y is not None:
            along_y = number("conductivity_y", self.conductivity_y, "W/m/K", above=0.0)
            set_fields(self, conductivity_y=along_y)
        if self.color is not None:
            if not isinstance(self.color, str) or not is_color_like(self.color):
                raise InputError(
                    f'color = {format_value(self.color)}; it must be a colour such as "#c8b090" or "brown"'
                )
            set_fields(self, color=to_hex(self.color))

    @property
    def anisotropy(self) -> float:
        """The conductivity along y over that along x."""
        return 1.0 if self.conductivity_y is None else self.conductivity_y / self.conductivity
