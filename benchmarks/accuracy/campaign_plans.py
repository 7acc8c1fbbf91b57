"""Whether a planned campaign gives what its plan says, and what a plan is worth.

`python -m benchmarks.accuracy.campaign_plans`

Each wall is planned in one of the two typical years that pvlib brings along. The campaign then takes place in another
year: blocks of some days of the typical one, from other days of the same season, with gusts and clouds within the hour.
The true wall is drawn from what the plan was told, its films and its absorptance about their usual values. It is
simulated by finite volumes in their modes with SciPy, every minute: no part of wallid. Sensors, plates and faces have
the errors that the case states. `estimate` has the whole record.

Each wall is measured as planned; with the places of the plan from a random day on; with sensors at equal distances from
the planned day on; and with both, the usual habit; the last three for every second wall. Three poor campaigns of each
wall, of 96 rows from a random day on with one noisy sensor anywhere, show whether the stated chance of an uninformative
record is right.

Each campaign's outcome is appended to a log of JSON lines, so that a long run goes on where it ended.
"""

import argparse
import math
import os
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.linalg import eigh
from scipy.signal import lfilter

from benchmarks.accuracy.discrepancy.score import interval
from benchmarks.accuracy.resumed_log import resumed

SEED = 2807  # fixed before the first wall was planned
WEATHER = ("723170TYA.CSV", "703165TY.csv")  # Greensboro, North Carolina; Sand Point, Alaska
FINE, HOUR, DAY = 60.0, 3600.0, 86400.0  # s
CELLS, SPIN_UP = 120, 30  # days before the first row
BLOCK, WITHIN = (2, 7), 15  # days that stay together; how far from their date they are taken
POOR, POOR_ROWS, POOR_NOISE = 3, 96, (0.1, 5.0)  # campaigns of each wall, their rows, the noise of their sensor in K
NOISE = 0.05  # K, of a reading
R_INSIDE, R_OUTSIDE, FLUX_STD, GAIN_STD = 0.13, 0.04, 0.3, 0.05


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


def house(number: int) -> House:
    """One house."""
    rng = np.random.default_rng([SEED, number])
    prior = math.exp(rng.uniform(math.log(3e-7), math.log(7e-7)))
    return House(
        weather=number % len(WEATHER),
        azimuth=float(rng.uniform(0.0, 360.0)),
        heated=bool(rng.uniform() < 0.7),
        length=round(float(rng.uniform(0.35, 0.6)), 3),
        prior=float(f"{prior:.3g}"),
        diffusivity=prior * 1.5 ** float(rng.standard_normal()),
        capacity=1.6e6,
        films=(float(rng.uniform(0.8, 1.25)), float(rng.uniform(0.8, 1.25))),
        absorptance=float(rng.uniform(0.45, 0.75)),
        sensors=int(rng.integers(1, 4)),
        plates=("right",) if rng.uniform() < 0.3 else (),
        days=float(rng.choice([7.0, 14.0, 21.0])),
        offset_std=float(rng.choice([0.02, 0.05, 0.1])),
        position_std=float(rng.choice([0.001, 0.002, 0.005])),
    )


# ----------------------------------------------------------------------------------------------- the independent year


def another_year(days: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Which day of the typical year each day is like, in blocks from about the same season."""
    found: list[int] = []
    while len(found) < len(days):
        first, length = int(days[len(found)]), int(rng.integers(*BLOCK))
        shift = int(rng.integers(-WITHIN, WITHIN + 1))
        found += [(first + shift + k) % 365 for k in range(length)]
    return np.array(found[: len(days)])


def by_minute(hourly: np.ndarray, minutes: int) -> np.ndarray:
    """Values of the middles of hours as monotone cubics, held at the ends."""
    time = np.clip((np.arange(minutes) + 0.5) / 60.0 - 0.5, 0.0, len(hourly) - 1.0)
    return np.asarray(PchipInterpolator(np.arange(len(hourly)), hourly)(time))


def _noise(count: int, memory: float, rng: np.random.Generator) -> np.ndarray:
    """An autoregression of variance 1 every `FINE` seconds, its memory in s."""
    keep = math.exp(-FINE / memory)
    return np.asarray(lfilter([math.sqrt(1.0 - keep**2)], [1.0, -keep], rng.standard_normal(count)))


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
    clouds = np.clip(1.0 + 0.25 * _noise(count, 900.0, rng), 0.0, 2.0)
    resistance = R_OUTSIDE * one.films[1]
    outdoors = air + 0.2 * _noise(count, 600.0, rng) + resistance * (one.absorptance * sun * clouds - 0.45 * deficit)
    slow = lfilter([FINE / (2.5 * DAY)], [1.0, FINE / (2.5 * DAY) - 1.0], air - air[0]) + air[0]
    level = np.maximum(20.0, slow + 2.0) if one.heated else slow
    hour = np.arange(count) * FINE / HOUR
    swing = 0.75 if one.heated else 0.3
    indoors = level + swing * np.cos(2 * np.pi * (hour - 18.0) / 24.0) + 0.2 * _noise(count, 2 * HOUR, rng)
    return np.stack([outdoors, indoors], axis=1)


def simulated(one: House, air: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Faces, temperatures at some places and the flux into the wall at its right face, every minute.

    Finite volumes between films, in their modes: exact for air temperatures that are straight lines over a minute.

    Args:
        air: outdoors (left) and indoors (right), `(time, 2)`. places: over the length.
    """
    conductivity, width = one.diffusivity * one.capacity, one.length / CELLS
    films = np.array([R_OUTSIDE * one.films[1], R_INSIDE * one.films[0]])
    half = 0.5 * width / conductivity
    outer = 1.0 / (films + half)  # W/m2/K, from the air to the middle of the first and the last cell
    inner = conductivity / width
    between = np.full(CELLS - 1, inner)
    into = np.zeros(CELLS)
    into[:-1] += between
    into[1:] += between
    into[[0, -1]] += outer
    matrix = (np.diag(into) - np.diag(between, 1) - np.diag(between, -1)) / (one.capacity * width)
    rate, modes = eigh(matrix)
    enter = modes[[0, -1]].T * outer / (one.capacity * width)  # (mode, air)
    z = rate * FINE
    at_end = (z + np.expm1(-z)) / (rate * z)
    at_start = (-np.expm1(-z) - z * np.exp(-z)) / (rate * z)
    drive = (air - air[0]) @ enter.T
    course = np.stack(
        [lfilter([e, a], [1.0, -math.exp(-d)], g) for g, e, a, d in zip(drive.T, at_end, at_start, z, strict=True)],
        axis=1,
    )
    cells = course @ modes.T + np.linalg.solve(matrix, modes @ (enter @ air[0]))
    flux = outer * (air - cells[:, [0, -1]])  # into the wall
    faces = air - flux * films
    ends = np.concatenate([[0.0], (np.arange(CELLS) + 0.5) / CELLS, [1.0]])
    field = np.concatenate([faces[:, :1], cells, faces[:, 1:]], axis=1)
    inside = np.stack([_at(field, ends, place) for place in places], axis=1) if len(places) else field[:, :0]
    return faces, inside, flux[:, 1]


def _at(field: np.ndarray, ends: np.ndarray, place: float) -> np.ndarray:
    """The temperature on the parabola through the three nearest points."""
    first = int(np.clip(np.searchsorted(ends, place) - 2, 0, len(ends) - 3))
    x = ends[first : first + 3]
    weights = [np.prod([(place - x[j]) / (x[k] - x[j]) for j in range(3) if j != k]) for k in range(3)]
    return field[:, first : first + 3] @ np.array(weights)


# --------------------------------------------------------------------------------------------------------- campaigns


def campaign_of(one: House) -> Any:
    """What `plan` is told of a house."""
    import pvlib

    import wallid
    from wallid.case.options import Choices
    from wallid.case.planned_campaign import CampaignSettings, PlannedCampaign

    path = Path(pvlib.__file__).parent / "data" / "case.toml"
    wall = wallid.Wall(length=one.length, diffusivity_prior=one.prior, heat_capacity=one.capacity, outside="left")
    settings = CampaignSettings(
        weather=WEATHER[one.weather], azimuth=one.azimuth, indoor=20.0 if one.heated else "unheated",
        sensors=one.sensors, plates=one.plates, days=one.days,
    )  # fmt: skip
    sensor = wallid.Sensor("sensor", 0.0, noise_std=NOISE, offset_std=one.offset_std, position_std=one.position_std)
    return PlannedCampaign("house", path, wall, settings, sensor, Choices(model="lom"))


def measured(
    one: House, number: int, kind: str, places: list[float], start: int, days: float, step: float, noise: float = NOISE
) -> dict:
    """What `estimate` says of one campaign.

    Args:
        places: of the sensors, m. start: day of the year. days: its length. step: of the rows, s. noise: of sensors, K.
    """
    import wallid
    from wallid.case.options import Choices
    from wallid.case.time_window import entire_record

    rng = np.random.default_rng([SEED, number, *kind.encode()])
    air = air_temperatures(one, start, math.ceil(days), rng)
    true = np.array(places) + one.position_std * rng.standard_normal(len(places))
    faces, inside, flux = simulated(one, air, true / one.length)
    rows = slice(round(SPIN_UP * DAY / FINE), None, round(step / FINE))
    count = round(days * DAY / step)
    faces, inside, flux = (part[rows][:count] for part in (faces, inside, flux))
    offsets = one.offset_std * rng.standard_normal(len(places))
    names = tuple(f"T{k + 1}" for k in range(len(places)))
    time = step * np.arange(count)
    gain = 1.0 + GAIN_STD * rng.standard_normal()
    plate = {"flux_right": gain * -flux + FLUX_STD * rng.standard_normal(count)} if one.plates else {}
    record = wallid.Record(
        time, time, None, faces + NOISE * rng.standard_normal(faces.shape),
        inside + offsets + noise * rng.standard_normal(inside.shape), names,
        regressors=plate, boundary_noise_std=NOISE, flux_noise_std=FLUX_STD, flux_gain_std=GAIN_STD,
    )  # fmt: skip
    sensors = tuple(
        wallid.Sensor(name, x, noise_std=noise, offset_std=one.offset_std, position_std=one.position_std)
        for name, x in zip(names, places, strict=True)
    )
    wall = wallid.Wall(length=one.length, diffusivity_prior=one.prior, outside="left")
    choices = Choices(model="lom", initial_profile=min(2, len(places) + 1), window_days=0.5)
    case = wallid.Case("house", Path("case.toml"), wall, sensors, record, choices)
    fit = wallid.estimate(case, entire_record(case))
    low, high = fit.interval_95
    return {
        "number": number,
        "kind": kind,
        "start": start,
        "days": days,
        "places": places,
        "error": math.log(fit.value / one.diffusivity),
        "half_width": math.log(high / low) / 2.0,
        "holds": bool(low <= one.diffusivity <= high),
        "uninformative": bool(high > choices.largest_interval_factor * low),
        "reliable": fit.reliable,
        "reason": fit.reason[:80],
    }


def outcomes_of(number: int) -> dict:
    """Plan and campaigns of one house."""
    import jax

    jax.config.update("jax_enable_x64", True)
    from wallid._internal.progress import no_progress
    from wallid.experiment_design.campaign_plan.expected_intervals import Instruments, chance_of_uninformative
    from wallid.experiment_design.campaign_plan.plan_search import PlanSearch, plan_campaign
    from wallid.records.weather_year import read_weather_year

    one, rng = house(number), np.random.default_rng([SEED, number, 1])
    campaign = campaign_of(one)
    weather = read_weather_year(campaign.weather_file)
    found = plan_campaign(campaign, weather, no_progress)
    planned = [float(x) for x in found.positions]
    equal = [one.length * (k + 1) / (len(planned) + 1) for k in range(len(planned))]
    any_day = int(rng.integers(1, 366 - math.ceil(found.days)))
    log_alpha = np.log(found.diffusivities)

    def stated(errors: list) -> dict:
        each = [error.diffusivity for error in errors]
        return {
            "std": float(np.exp(np.interp(math.log(one.diffusivity), log_alpha, np.log(each)))),
            "chance": chance_of_uninformative(each, campaign.choices.largest_interval_factor),
        }

    kinds = [("planned", planned, found.start)]
    if number % 2 == 0:
        kinds += [
            ("planned places", planned, any_day), ("planned day", equal, found.start), ("habit", equal, any_day),
        ]  # fmt: skip
    campaigns = [measured(one, number, *kind, found.days, found.step) for kind in kinds]
    campaigns[0] |= stated(list(found.errors))
    search, days = PlanSearch(campaign, weather, no_progress), POOR_ROWS * found.step / DAY
    without_plates = replace(one, plates=())
    for poor in range(POOR):
        start, place = int(rng.integers(len(search.starts))), int(rng.integers(9))
        noise = math.exp(rng.uniform(*np.log(POOR_NOISE)))
        in_an_hour = replace(campaign.sensor, noise_std=noise * math.sqrt(found.step / HOUR))
        errors = [year.errors(start, days, Instruments((place,)), in_an_hour) for year in search.years]
        where = [float(0.1 * (place + 1) * one.length)]
        first = int(search.starts[start]) // 24 + 1
        outcome = measured(without_plates, number, f"poor {poor}", where, first, days, found.step, noise)
        campaigns.append(outcome | stated(errors))
    return {"number": number, "days": found.days, "sensors": len(planned), "campaigns": campaigns}


def summary(houses: list[dict]) -> str:
    """Standardised errors, chances and half widths."""
    planned = [each["campaigns"][0] for each in houses]
    z = np.array([one["error"] / one["std"] for one in planned if not one["uninformative"]])
    lines = [
        f"{len(houses)} houses; planned: standardised error of the diffusivity: mean {z.mean():+.2f}, "
        f"scatter {z.std():.2f}, by the interquartile range {np.subtract(*np.quantile(z, [0.75, 0.25])) / 1.349:.2f}",
        "half width over the expected one, median "
        f"{np.median([one['half_width'] / (1.96 * one['std']) for one in planned]):.2f}",
    ]
    told = [one for each in houses for one in each["campaigns"] if "chance" in one]
    for low, high in pairwise((0.0, 0.05, 0.35, 0.65, 0.95, 1.01)):
        own = [one for one in told if low <= one["chance"] < high]
        if own:
            hits = sum(one["uninformative"] for one in own)
            band = interval(hits, len(own))
            stated = np.mean([one["chance"] for one in own])
            lines.append(
                f"uninformative, stated {low:.2f} to {high:.2f}: {stated:.3f} in the mean; "
                f"{hits} of {len(own)} ({band[0]:.3f} to {band[1]:.3f})"
            )
    hits = sum(one["uninformative"] for one in told)
    lines.append(f"all: stated {np.mean([one['chance'] for one in told]):.3f}, {hits / len(told):.3f} of {len(told)}")
    beside = [each for each in houses if each["number"] % 2 == 0]
    of = {
        kind: [one for each in beside for one in each["campaigns"] if one["kind"] == kind]
        for kind in ("planned", "planned places", "planned day", "habit")
    }
    for kind, own in of.items():
        ratio = [a["half_width"] / b["half_width"] for a, b in zip(own, of["habit"], strict=True)]
        holds = sum(one["holds"] for one in own)
        lines.append(
            f"{kind}: half width over habit's {np.median(ratio):.2f} in the median; "
            f"{100 * np.median([one['half_width'] for one in own]):.2g} %; {holds} of {len(own)} hold the truth"
        )
    return "\n".join(lines)


def main() -> None:
    """Run what the log does not have yet, and print the summary."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--records", type=int, default=100, help="houses")
    parser.add_argument("--log", type=Path, default=Path("campaign_plans.jsonl"))
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    given = parser.parse_args()
    tasks = [(number,) for number in range(given.records)]
    print(summary(resumed(given.log, tasks, outcomes_of, lambda number: (number,), ("number",), given.workers)))


if __name__ == "__main__":
    main()
