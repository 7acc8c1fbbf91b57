"""A wall in the weather of a typical year, as a case whose record was simulated.

The air on each side drives the wall through the surface resistances of ISO 6946. The outer side has the sol-air
temperature

    T_sa = T_air + R_se (a I - e F dL)

with the irradiance I on the wall, its absorptance a = 0.6, its emissivity e = 0.9, the part F of the sky that it sees,
and the infrared deficit dL of the sky. A heated room has its set temperature, or in warm weather the mean of the last
days outdoors, with a small daily cycle; an unheated one follows the mean of the last days.

Source: ISO 6946:2017 (surface resistances); ASHRAE Handbook of Fundamentals (2021), 18 (sol-air temperature).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy
from jaxtyping import Float

from ..._internal.units import DAY
from ...case.case_definition import Case
from ...case.options import Choices
from ...case.planned_campaign import UNHEATED, PlannedCampaign
from ...case.wall_and_sensors import SIDES, Wall
from ...models.finite_volume_wall import Output, finite_volume_model
from ...models.flux_plates import FLUX_NOISE_STD
from ...models.integration import propagate
from ...models.wall_parameters import R_INSIDE, R_OUTSIDE
from ...records.uniform_record import Record
from ...records.weather_year import HOURS, WeatherYear

CAPACITY_OF_MASONRY = 1.6e6
"""Volumetric heat capacity where neither it nor the conductivity is stated, J/m3/K."""
_HOUR = 3600.0
_ABSORPTANCE, _EMISSIVITY = 0.6, 0.9
_MEMORY = 2.5 * 24  # h, of the mean of the last days
_WARM = 2.0  # K, by which a room in warm weather exceeds that mean
_SWING = {True: 0.75, False: 0.3}  # K, amplitude of the daily cycle in a heated and in an unheated room
_STEPS = (60.0, 120.0, 300.0, 600.0, 900.0, 1800.0, 3600.0)  # s, of loggers
_ROWS_PER_TIME_CONSTANT = 20.0
_SPIN_UP = 60 * 24  # h, of the end of the year before its beginning


def conductivity_of(wall: Wall, diffusivity: float) -> float:
    """The conductivity of a wall with some diffusivity: as stated, or by its heat capacity, W/m/K."""
    if wall.effective_conductivity is not None:
        return float(wall.effective_conductivity)
    return float(wall.heat_capacity or CAPACITY_OF_MASONRY) * diffusivity


def sampling_step(campaign: PlannedCampaign) -> float:
    """The longest usual step with twenty rows in the wall's slowest time constant, at most an hour, s."""
    constant = (campaign.wall.length / math.pi) ** 2 / campaign.wall.diffusivity_prior
    return max(step for step in _STEPS if step <= max(constant / _ROWS_PER_TIME_CONSTANT, _STEPS[0]))


def campaign_irradiance(campaign: PlannedCampaign, weather: WeatherYear) -> Float[np.ndarray, " hour"]:
    """The irradiance on the outer face, W/m2."""
    settings = campaign.settings
    return weather.irradiance_on(settings.azimuth, settings.tilt, settings.latitude, settings.longitude)


def sol_air_temperature(campaign: PlannedCampaign, weather: WeatherYear) -> Float[np.ndarray, " hour"]:
    """The sol-air temperature of the outer side, degC."""
    settings, sun = campaign.settings, campaign_irradiance(campaign, weather)
    sky = 0.5 * (1.0 + math.cos(math.radians(settings.tilt)))
    return weather.air + R_OUTSIDE * (_ABSORPTANCE * sun - _EMISSIVITY * sky * weather.sky_deficit)


def indoor_temperature(campaign: PlannedCampaign, weather: WeatherYear) -> Float[np.ndarray, " hour"]:
    """The temperature of the room, degC."""
    last_days = _mean_of_last_days(weather.air)
    heated = campaign.settings.indoor != UNHEATED
    level = np.maximum(float(campaign.settings.indoor), last_days + _WARM) if heated else last_days
    hour = np.arange(HOURS) % 24 + 0.5
    return level + _SWING[heated] * np.cos(2.0 * np.pi * (hour - 18.0) / 24.0)


def _mean_of_last_days(air: Float[np.ndarray, " hour"]) -> Float[np.ndarray, " hour"]:
    """An exponential mean over the last days; the year is periodic."""
    twice = np.concatenate([air, air])
    decay = math.exp(-1.0 / _MEMORY)
    return np.asarray(scipy.signal.lfilter([1.0 - decay], [1.0, -decay], twice)[len(air) :])


def typical_case(
    campaign: PlannedCampaign,
    weather: WeatherYear,
    diffusivity: float,
    positions: Sequence[float],
    plates: Sequence[str],
) -> Case:
    """The case of a typical year, without noise.

    Args:
        campaign: the wall and its place.
        weather: of the typical year.
        diffusivity: of the wall, m2/s.
        positions: of its sensors, m from the left face.
        plates: the faces with a heat flux plate.

    Returns:
        A case with a record of each hour of the year, and then of its beginning again for as long as the longest
        campaign. Its noise is that of the mean of an hour of rows at the `sampling_step`.
    """
    wall = campaign.wall
    conductivity = conductivity_of(wall, diffusivity)
    air = np.stack([sol_air_temperature(campaign, weather), indoor_temperature(campaign, weather)], axis=1)
    if wall.outside == "right":
        air = air[:, ::-1]
    film = tuple(conductivity * (R_OUTSIDE if side == wall.outside else R_INSIDE) for side in SIDES)
    ends = (0.0, wall.length)
    outputs = [
        *(Output(x) for x in (*ends, *positions)),
        *(Output(ends[SIDES.index(plate)], "flux") for plate in plates),
    ]
    system = finite_volume_model(wall, outputs, nodes=campaign.choices.nodes, profile_degree=1, film=(film[0], film[1]))
    rows = HOURS + math.ceil(campaign.settings.days * DAY / _HOUR)
    inputs = np.take(air, np.arange(-_SPIN_UP, rows), axis=0, mode="wrap")
    initial = np.array([inputs[0, 0], inputs[0, 1] - inputs[0, 0]])
    fourier = _HOUR * diffusivity / wall.length**2
    values, _ = propagate(system.modal(), fourier, 1.0, inputs, initial)
    readings, columns = np.asarray(values)[_SPIN_UP:], 2 + len(positions)
    share = math.sqrt(sampling_step(campaign) / _HOUR)  # of the noise of a row in the mean of an hour
    noise = share * campaign.sensor.noise_std
    sensors = tuple(
        replace(campaign.sensor, name=f"T{k}", position=float(x), noise_std=noise)
        for k, x in enumerate(positions, start=1)
    )
    fluxes = {f"flux_{plate}": conductivity / wall.length * readings[:, columns + k] for k, plate in enumerate(plates)}
    record = Record(
        time=_HOUR * np.arange(rows),
        stamps=np.datetime64("2023-01-01T00:30:00", "ns") + np.arange(rows) * np.timedelta64(3600, "s"),
        zone=None,
        faces=readings[:, :2],
        sensors=readings[:, 2:columns],
        names=tuple(sensor.name for sensor in sensors),
        regressors=fluxes,
        boundary_noise_std=noise,
        face_position_std=0.0,
        flux_noise_std=share * FLUX_NOISE_STD,
        flux_gain_std=None,
        file=weather.file,
    )
    choices: Choices = replace(
        campaign.choices,
        initial_profile=min(2, len(positions) + 1),
        # of a record that was logged: a window of it may be too short for rows of an hour
        window_days=Choices.window_days,
        diagnose_days=None,
    )
    of_this_wall = replace(wall, diffusivity_prior=diffusivity, conductivity=conductivity)
    return Case(campaign.name, campaign.path, of_this_wall, sensors, record, choices, (), campaign.description)


def day_of_year(row: int) -> int:
    """The day of the year of a row, 1 to 365."""
    return int(row * _HOUR // DAY) + 1
