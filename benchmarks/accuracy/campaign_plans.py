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

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy.discrepancy.score import interval
from benchmarks.accuracy.resumed_log import count_options, resumed
from benchmarks.reference.house_in_weather import (
    DAY,
    FINE,
    HOUR,
    SPIN_UP,
    WEATHER,
    House,
    air_temperatures,
    simulated,
)

SEED = 2808  # fixed before the first wall was planned; 2807 is spent
POOR, POOR_ROWS, POOR_NOISE = 3, 96, (0.1, 5.0)  # campaigns of each wall, their rows, the noise of their sensor in K
NOISE = 0.05  # K, of a reading
FLUX_STD, GAIN_STD = 0.3, 0.05  # W/m2; of a plate's calibration


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
    from wallid.experiment_design.campaign_plan.expected_intervals import (
        CampaignErrors,
        Instruments,
        chance_of_uninformative,
    )
    from wallid.experiment_design.campaign_plan.plan_search import PlanSearch, plan_campaign

    one, rng = house(number), np.random.default_rng([SEED, number, 1])
    campaign = campaign_of(one)
    weather = campaign.read_weather()
    found = plan_campaign(campaign, weather, no_progress)
    planned = [float(x) for x in found.positions]
    equal = [one.length * (k + 1) / (len(planned) + 1) for k in range(len(planned))]
    any_day = int(rng.integers(1, 366 - math.ceil(found.days)))
    log_alpha = np.log(found.diffusivities)

    def stated(errors: CampaignErrors) -> dict:
        typical = [error.diffusivity for error in errors.typical]
        largest = campaign.choices.largest_interval_factor
        return {
            "std": float(np.exp(np.interp(math.log(one.diffusivity), log_alpha, np.log(typical)))),
            "chance": chance_of_uninformative(errors.diffusivity, found.diffusivities, largest),
        }

    kinds = [("planned", planned, found.start)]
    if number % 2 == 0:
        kinds += [
            ("planned places", planned, any_day), ("planned day", equal, found.start), ("habit", equal, any_day),
        ]  # fmt: skip
    campaigns = [measured(one, number, *kind, found.days, found.step) for kind in kinds]
    campaigns[0] |= stated(found.errors)
    search, days = PlanSearch(campaign, weather, no_progress), POOR_ROWS * found.step / DAY
    without_plates = replace(one, plates=())
    for poor in range(POOR):
        start, place = int(rng.integers(len(search.starts))), int(rng.integers(9))
        noise = math.exp(rng.uniform(*np.log(POOR_NOISE)))
        in_an_hour = replace(campaign.sensor, noise_std=noise * math.sqrt(found.step / HOUR))
        errors = search.errors(start, days, Instruments((place,)), in_an_hour)
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
    given = count_options(__doc__, "campaign_plans.jsonl", 100, "houses").parse_args()
    tasks = [(number,) for number in range(given.first, given.first + given.records)]
    print(summary(resumed(given.log, tasks, outcomes_of, lambda number: (number,), ("number",), given.workers)))


if __name__ == "__main__":
    main()
