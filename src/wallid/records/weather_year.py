"""The weather of a typical year, from an EPW or TMY3 file.

pvlib reads the file and gives the sun's position and the irradiance on the wall; it is the extra `plan` of the package.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from .._internal.errors import InputError

HOURS = 8760
"""Rows of a typical year, one for the middle of each hour, in local standard time."""
_LEAP_YEAR = 2024  # into which the months of a file are put: each date of a file has a place in it
_LIMITS = {
    "temp_air": (-80.0, 60.0, "degC"),
    "ghi": (0.0, 1500.0, "W/m2"),
    "dni": (0.0, 1500.0, "W/m2"),
    "dhi": (0.0, 1500.0, "W/m2"),
}
"""Of each column: the limits, outside which are the codes of missing values, such as 99.9, 9999 and -9900."""
_STEFAN_BOLTZMANN = 5.670374419e-8  # W/m2/K4
_CLEAR_SKY_DEFICIT = (
    63.0  # W/m2, by which the sky radiates less than air, where the file has no infrared (ISO 6946: 4 K)
)


@dataclass(frozen=True, eq=False)
class WeatherYear:
    """The hourly weather of a typical year.

    Args:
        air: temperature, degC, `(hour,)`.
        global_horizontal, direct_normal, diffuse_horizontal: irradiance, W/m2, `(hour,)`.
        sky_deficit: infrared that a horizontal surface at air temperature loses to the sky, W/m2, `(hour,)`.
        latitude, longitude: degrees, north and east positive.
        utc_offset: of its local standard time, h.
        file: path, for messages.
    """

    air: np.ndarray = field(repr=False)
    global_horizontal: np.ndarray = field(repr=False)
    direct_normal: np.ndarray = field(repr=False)
    diffuse_horizontal: np.ndarray = field(repr=False)
    sky_deficit: np.ndarray = field(repr=False)
    latitude: float
    longitude: float
    utc_offset: float
    file: str

    def irradiance_on(
        self, azimuth: float, tilt: float, latitude: float | None = None, longitude: float | None = None
    ) -> Float[np.ndarray, " hour"]:
        """The irradiance on a plane, W/m2: beam, the sky's diffuse light (isotropic), and what the ground reflects.

        Args:
            azimuth: of the plane's normal, degrees clockwise from north.
            tilt: from the horizontal, degrees; 90 for a wall.
            latitude, longitude: degrees; None for those of the file.
        """
        import pandas as pd
        from pvlib.irradiance import get_total_irradiance
        from pvlib.solarposition import get_solarposition

        first = pd.Timestamp("2023-01-01T00:30") - pd.Timedelta(hours=self.utc_offset)
        times = pd.date_range(first, periods=HOURS, freq="h", tz="UTC")
        place = (self.latitude if latitude is None else latitude, self.longitude if longitude is None else longitude)
        sun = get_solarposition(times, *place)
        total = get_total_irradiance(
            tilt,
            azimuth,
            np.asarray(sun["apparent_zenith"], float),
            np.asarray(sun["azimuth"], float),
            self.direct_normal,
            self.global_horizontal,
            self.diffuse_horizontal,
        )
        return np.maximum(np.nan_to_num(np.asarray(total["poa_global"], float)), 0.0)


def read_weather_year(file: str | os.PathLike[str]) -> WeatherYear:
    """Read a typical year from an EPW file, or from a TMY3 file (CSV).

    Raises:
        InputError: pvlib is not installed; the file cannot be read, is of neither kind, has no full year, or lacks
            values.
    """
    path = Path(file)
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; weather is an EPW or TMY3 file of a typical year")
    try:
        from pvlib.iotools import read_epw, read_tmy3
    except ImportError as error:
        raise InputError("weather files are read by pvlib; install it with `pip install wallid[plan]`") from error
    try:
        data, about = (
            read_epw(path, coerce_year=_LEAP_YEAR)
            if path.suffix.lower() == ".epw"
            else read_tmy3(path, coerce_year=_LEAP_YEAR, map_variables=True)
        )
    except Exception as error:  # pvlib raises whatever its parsers raise
        raise InputError(
            f"{path}: cannot be read as {'EPW' if path.suffix.lower() == '.epw' else 'TMY3'} ({error})"
        ) from error
    return _weather_year(data, about, str(path))


def _weather_year(data: Any, about: dict[str, Any], file: str) -> WeatherYear:
    """The columns that pvlib gives, checked."""
    if len(data) == HOURS + 24:  # the file is of a leap year
        data = data[~((data.index.month == 2) & (data.index.day == 29))]
    if len(data) != HOURS:
        raise InputError(f"{file}: {len(data)} rows; a typical year has {HOURS}, one for each hour")
    columns = {name: np.asarray(data[name], float) for name in _LIMITS}
    for name, values in columns.items():
        lowest, highest, unit = _LIMITS[name]
        missing = ~((values >= lowest) & (values <= highest))  # NaN too
        if missing.any():
            first = int(np.argmax(missing))
            raise InputError(
                f"{file}: {name} is missing or impossible in {int(missing.sum())} of {HOURS} hours, first "
                f"{values[first]:g} in hour {first + 1}; it must be {lowest:g} to {highest:g} {unit}. Fill these "
                f"hours, or take another file"
            )
    air = columns["temp_air"]
    infrared = np.asarray(data["ghi_infrared"], float) if "ghi_infrared" in data else np.full(HOURS, np.nan)
    blackbody = _STEFAN_BOLTZMANN * (air + 273.15) ** 4
    known = np.isfinite(infrared) & (infrared > 50.0) & (infrared < 700.0)
    return WeatherYear(
        air=air,
        global_horizontal=columns["ghi"],
        direct_normal=columns["dni"],
        diffuse_horizontal=columns["dhi"],
        sky_deficit=np.where(known, blackbody - infrared, _CLEAR_SKY_DEFICIT),
        latitude=float(about["latitude"]),
        longitude=float(about["longitude"]),
        utc_offset=float(about["TZ"]),
        file=file,
    )
