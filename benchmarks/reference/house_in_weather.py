"""A wall between the air of a room and the weather of another year than the typical one: no part of wallid.

The year is made of blocks of some days of a typical year, from other days of the same season, with gusts and clouds
within the hour. The wall is simulated by finite volumes in their modes, every minute.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.linalg import eigh
from scipy.signal import lfilter

from benchmarks.reference.analytic_slab import driven_modes, random_process

WEATHER = ("723170TYA.CSV", "703165TY.csv")
"""Files of typical years that pvlib brings along: Greensboro, North Carolina; Sand Point, Alaska."""
FINE, HOUR, DAY = 60.0, 3600.0, 86400.0  # s
SPIN_UP = 30  # days before the first row
_CELLS = 120
_BLOCK, _WITHIN = (2, 7), 15  # days that stay together; how far from their date they are taken
_R_INSIDE, _R_OUTSIDE = 0.13, 0.04  # m2 K/W


@dataclass(frozen=True)
class House:
    """A wall as it is guessed, and as it is.

    Args:
        weather: which of `WEATHER`. azimuth: degrees. heated: whether the room is.
        length: m. prior, diffusivity: guessed and true, m2/s. capacity: J/m3/K, true and stated.
        films: of the true surface resistances, over the usual ones. absorptance: of the outer face.
        sensors: at most. plates: faces. days: at most. offset_std: K. position_std: m.
    """

    weather: int
    azimuth: float
    heated: bool
    length: float
    prior: float
    diffusivity: float
    capacity: float
    films: tuple[float, float]
    absorptance: float
    sensors: int
    plates: tuple[str, ...]
    days: float
    offset_std: float
    position_std: float


def another_year(days: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Which day of the typical year each day is like, in blocks from about the same season."""
    found: list[int] = []
    while len(found) < len(days):
        first, length = int(days[len(found)]), int(rng.integers(*_BLOCK))
        shift = int(rng.integers(-_WITHIN, _WITHIN + 1))
        found += [(first + shift + k) % 365 for k in range(length)]
    return np.array(found[: len(days)])


def by_minute(hourly: np.ndarray, minutes: int) -> np.ndarray:
    """Values of the middles of hours as monotone cubics, held at the ends."""
    time = np.clip((np.arange(minutes) + 0.5) / 60.0 - 0.5, 0.0, len(hourly) - 1.0)
    return np.asarray(PchipInterpolator(np.arange(len(hourly)), hourly)(time))


def air_temperatures(one: House, start: int, days: int, rng: np.random.Generator) -> np.ndarray:
    """Sol-air temperature outdoors and air indoors, every minute, `(time, 2)`, from `SPIN_UP` days before the start."""
    import pvlib

    from wallid.records.weather_year import read_weather_year

    typical = read_weather_year(Path(pvlib.__file__).parent / "data" / WEATHER[one.weather])
    dates = (start - 1 - SPIN_UP + np.arange(SPIN_UP + days + 1)) % 365
    like = another_year(dates, rng)
    hours = (24 * like[:, None] + np.arange(24)).reshape(-1)
    count = round(len(dates) * DAY / FINE)
    air = by_minute(typical.air[hours], count)
    sun = by_minute(typical.irradiance_on(one.azimuth, 90.0)[hours], count)
    deficit = by_minute(typical.sky_deficit[hours], count)
    clouds = np.clip(1.0 + 0.25 * random_process(count, FINE, 0.25, rng), 0.0, 2.0)
    resistance = _R_OUTSIDE * one.films[1]
    gusts = 0.2 * random_process(count, FINE, 1.0 / 6.0, rng)
    outdoors = air + gusts + resistance * (one.absorptance * sun * clouds - 0.45 * deficit)
    slow = lfilter([FINE / (2.5 * DAY)], [1.0, FINE / (2.5 * DAY) - 1.0], air - air[0]) + air[0]
    level = np.maximum(20.0, slow + 2.0) if one.heated else slow
    hour = np.arange(count) * FINE / HOUR
    swing = 0.75 if one.heated else 0.3
    indoors = level + swing * np.cos(2 * np.pi * (hour - 18.0) / 24.0) + 0.2 * random_process(count, FINE, 2.0, rng)
    return np.stack([outdoors, indoors], axis=1)


def simulated(one: House, air: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Faces, temperatures at some places and the flux into the wall at its right face, every minute.

    Finite volumes between films, in their modes: exact for air temperatures that are straight lines over a minute.

    Args:
        air: outdoors (left) and indoors (right), `(time, 2)`. places: over the length.
    """
    conductivity, width = one.diffusivity * one.capacity, one.length / _CELLS
    films = np.array([_R_OUTSIDE * one.films[1], _R_INSIDE * one.films[0]])
    half = 0.5 * width / conductivity
    outer = 1.0 / (films + half)  # W/m2/K, from the air to the middle of the first and the last cell
    inner = conductivity / width
    between = np.full(_CELLS - 1, inner)
    into = np.zeros(_CELLS)
    into[:-1] += between
    into[1:] += between
    into[[0, -1]] += outer
    matrix = (np.diag(into) - np.diag(between, 1) - np.diag(between, -1)) / (one.capacity * width)
    rate, modes = eigh(matrix)
    enter = modes[[0, -1]].T * outer / (one.capacity * width)  # (mode, air)
    course = driven_modes(rate, enter @ (air - air[0]).T, FINE).T
    cells = course @ modes.T + np.linalg.solve(matrix, modes @ (enter @ air[0]))
    flux = outer * (air - cells[:, [0, -1]])  # into the wall
    faces = air - flux * films
    ends = np.concatenate([[0.0], (np.arange(_CELLS) + 0.5) / _CELLS, [1.0]])
    field = np.concatenate([faces[:, :1], cells, faces[:, 1:]], axis=1)
    inside = np.stack([_at(field, ends, place) for place in places], axis=1) if len(places) else field[:, :0]
    return faces, inside, flux[:, 1]


def _at(field: np.ndarray, ends: np.ndarray, place: float) -> np.ndarray:
    """The temperature on the parabola through the three nearest points."""
    first = int(np.clip(np.searchsorted(ends, place) - 2, 0, len(ends) - 3))
    x = ends[first : first + 3]
    weights = [np.prod([(place - x[j]) / (x[k] - x[j]) for j in range(3) if j != k]) for k in range(3)]
    return field[:, first : first + 3] @ np.array(weights)
