"""A campaign that is to be planned: the wall as it is guessed, where it stands, and what may be measured ([plan])."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, no_type_check

from .._internal.errors import InputError
from .._internal.validation import integer, number, set_fields, some_of, text
from ..records.weather_year import WeatherYear, read_weather_year
from .options import Choices
from .wall_and_sensors import SIDES, Sensor, Side, Wall

UNHEATED = "unheated"
TYPICAL_SENSOR = Sensor("sensor", 0.0, noise_std=0.05, position_std=0.002, offset_std=0.05)
"""The standard deviations of a sensor where the case states none: a Pt1000 in a drilled hole."""
_LONGEST = 365.0  # days, of the typical year
_MOST_SENSORS = 6


@no_type_check
@dataclass(frozen=True)
class CampaignSettings:
    """What `[plan]` states.

    Args:
        weather: file of a typical year, EPW or TMY3.
        azimuth: of the outer face's normal, degrees clockwise from north: 0 north, 90 east, 180 south, 270 west.
        latitude, longitude: degrees, north and east positive; None for those of the weather file.
        tilt: of the wall from the horizontal, degrees; 90 for a vertical wall.
        indoor: temperature to which the room is heated, degC, or "unheated".
        sensors: the largest number of sensors inside the wall.
        plates: the faces on which a heat flux plate can be put.
        days: the longest campaign, days.
        uncertainty: factor by which the diffusivity may differ from its prior, one standard deviation either way.

    Raises:
        InputError: a value is outside its limits; neither a sensor nor a plate is allowed.
    """

    weather: str
    azimuth: float
    latitude: float | None = None
    longitude: float | None = None
    tilt: float = 90.0
    indoor: float | Literal["unheated"] = 20.0
    sensors: int = 3
    plates: tuple[Side, ...] = ()
    days: float = 30.0
    uncertainty: float = 1.5

    def __post_init__(self) -> None:
        indoor = self.indoor
        if indoor != UNHEATED:
            indoor = number("indoor", indoor, "degC", minimum=-60.0, alternative=f'or "{UNHEATED}"')
        set_fields(
            self,
            weather=text("weather", self.weather),
            azimuth=number("azimuth", self.azimuth, "degrees", minimum=0.0, maximum=360.0),
            tilt=number("tilt", self.tilt, "degrees", minimum=0.0, maximum=180.0),
            indoor=indoor,
            sensors=integer("sensors", self.sensors, 0, _MOST_SENSORS),
            plates=some_of("plates", self.plates, SIDES),
            days=number("days", self.days, "days", minimum=1.0, maximum=_LONGEST),
            uncertainty=number("uncertainty", self.uncertainty, above=1.0, maximum=10.0),
        )
        for name, limit in (("latitude", 90.0), ("longitude", 180.0)):
            if getattr(self, name) is not None:
                checked = number(name, getattr(self, name), "degrees", minimum=-limit, maximum=limit)
                set_fields(self, **{name: checked})
        if self.sensors == 0 and not self.plates:
            raise InputError("sensors = 0 and no plates: allow at least one sensor inside the wall, or a plate")

    @property
    def log_std(self) -> float:
        """Standard deviation of ln(diffusivity / prior)."""
        return math.log(self.uncertainty)


def first_or_typical(sensors: Sequence[Sensor]) -> Sensor:
    """The sensor whose standard deviations a campaign takes: the first that is stated, else `TYPICAL_SENSOR`."""
    return sensors[0] if sensors else TYPICAL_SENSOR


@dataclass(frozen=True)
class PlannedCampaign:
    """A campaign that is to be planned.

    Args:
        name, description: title of tables and reports, and one line.
        path: of the TOML file, for messages.
        wall: as it is guessed.
        settings: what `[plan]` states.
        sensor: the standard deviations of a sensor.
        choices: the options.
    """

    name: str
    path: Path
    wall: Wall
    settings: CampaignSettings
    sensor: Sensor = TYPICAL_SENSOR
    choices: Choices = field(default_factory=Choices)
    description: str = ""

    @property
    def weather_file(self) -> Path:
        """The weather file; a relative path is relative to the case file."""
        return self.path.parent / self.settings.weather

    def read_weather(self) -> WeatherYear:
        """Read the weather of a typical year.

        Raises:
            InputError: the file cannot be read, or pvlib is not installed.
        """
        try:
            return read_weather_year(self.weather_file)
        except InputError as error:
            raise InputError(f"{self.path}: [plan] weather: {error}") from error
