"""Conversion to and from the dimensionless form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, no_type_check

from .._internal.units import DAY
from .._internal.validation import number, set_fields
from .wall_and_sensors import Wall


@no_type_check
@dataclass(frozen=True)
class Scales:
    """The reference values of the dimensionless form.

    `u = (T - T_min)/T_ref`, `t* = t/t_ref`, `x* = x/L`, `Fo = t_ref alpha/L^2`. The methods accept numbers and arrays
    of NumPy and JAX.

    Args:
        length: L, m.
        time: t_ref, s.
        temperature: T_ref, K.
        temperature_min: T_min, degC.

    Raises:
        InputError: a reference value that is not above 0.
    """

    length: float
    time: float
    temperature: float
    temperature_min: float

    def __post_init__(self) -> None:
        for name, unit in (("length", "m"), ("time", "s"), ("temperature", "K")):
            set_fields(self, **{name: number(name, getattr(self, name), unit, above=0.0)})
        set_fields(self, temperature_min=number("temperature_min", self.temperature_min, "degC"))

    @classmethod
    def of(cls, wall: Wall, time: float = DAY, temperature: float = 20.0, temperature_min: float = 0.0) -> Scales:
        """The reference values for a wall: by default a day (86 400 s), 20 K and 0 degC."""
        return cls(wall.length, time, temperature, temperature_min)

    def fourier_number(self, diffusivity: Any) -> Any:
        """The Fourier number of a diffusivity in m2/s."""
        return self.time * diffusivity / self.length**2

    def diffusivity(self, fourier: Any) -> Any:
        """The diffusivity in m2/s of a Fourier number."""
        return fourier * self.length**2 / self.time

    def dimensionless(self, temperature: Any) -> Any:
        """The dimensionless temperature u of a temperature in degC."""
        return (temperature - self.temperature_min) / self.temperature

    def celsius(self, u: Any) -> Any:
        """The temperature in degC of a dimensionless temperature u."""
        return self.temperature_min + self.temperature * u
