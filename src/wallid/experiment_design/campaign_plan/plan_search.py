"""The search for the plan of a campaign: places, plates, first day and length."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ..._internal.progress import Progress
from ..._internal.units import DAY
from ...case.planned_campaign import PlannedCampaign
from ...case.time_window import Window
from ...case.wall_and_sensors import Sensor
from ...records.weather_year import HOURS, WeatherYear
from .expected_intervals import EQUAL_CHANCES, CampaignErrors, Instruments, TypicalYear
from .plan_result import CampaignPlan, Curve, Season, Tolerance
from .typical_case import day_of_year, sampling_step, typical_case

_MIDDLE = 2
_SHARES = np.linspace(0.1, 0.9, 9)  # of the wall's length, at which a sensor may be
_STARTS = 53  # first days that are compared
_NEARBY = 15.0  # days around the first one, whose weather another year may have
_LENGTHS = (1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 14.0, 21.0, 30.0, 45.0, 60.0, 90.0, 120.0, 180.0, 270.0)  # days
_PLACES_FROM = 6  # first days at which the places are compared
_PLACED_WITH = 7.0  # days, length of a campaign for which they are
_ENOUGH = 1.1  # an interval that is at most so many times the narrowest needs nothing more
_FINE_ENOUGH = 0.005  # standard error of ln(diffusivity), +-1 %: no wall is a homogeneous slab to better than that
_STDS = {"position_std": (0.0005, 0.001, 0.002, 0.005, 0.01), "offset_std": (0.01, 0.02, 0.05, 0.1, 0.2)}


class PlanSearch:
    """The typical years of a wall, over the diffusivities that it may have, and the campaigns in them.

    Args:
        campaign: the wall and what may be measured.
        weather: of the typical year.
        report: of the progress.
    """

    def __init__(self, campaign: PlannedCampaign, weather: WeatherYear, report: Progress):
        self.campaign, self.wall, self.weather = campaign, campaign.wall, weather
        self.report, self.days = report, campaign.settings.days
        positions = (_SHARES * self.wall.length).tolist()
        self.starts = 24 * np.linspace(0, HOURS / 24, _STARTS, endpoint=False).astype(int)
        self.years: list[TypicalYear] = []
        step = sampling_step(campaign)
        for count, quantile in enumerate(EQUAL_CHANCES):
            report("plan: simulating the typical year", 0.05 + 0.2 * count / len(EQUAL_CHANCES))
            diffusivity = self.wall.diffusivity_prior * math.exp(quantile * campaign.settings.log_std)
            case = typical_case(campaign, self.weather, diffusivity, positions, campaign.settings.plates)
            self.years.append(TypicalYear(case, self.starts.tolist(), self.days, step))

    @property
    def diffusivities(self) -> tuple[float, ...]:
        """That the wall may have with equal probability, m2/s."""
        return tuple(year.diffusivity for year in self.years)

    def nearby(self, start: int) -> list[int]:
        """The first days within two weeks of one: another year has the weather of any of them."""
        apart = np.abs(self.starts - self.starts[start])
        return np.flatnonzero(np.minimum(apart, HOURS - apart) <= 24 * _NEARBY).tolist()

    def errors(self, start: int, days: float, instruments: Instruments, sensor: Sensor | None = None) -> CampaignErrors:
        """The expected standard errors at each diffusivity, in the weather from each nearby day on.

        Args:
            start: index of the first day. days: length of the campaign. instruments: what is measured.
            sensor: with other standard deviations than those of the campaign; None for those.
        """
        nearby = self.nearby(start)
        return CampaignErrors(
            tuple(tuple(year.errors(one, days, instruments, sensor) for year in self.years) for one in nearby)
        )

    def season(
        self, days: float, instruments: Instruments, years: Sequence[TypicalYear]
    ) -> Float[np.ndarray, "start diffusivity"]:
        """The standard error of ln(diffusivity) from each first day on, the median over the nearby days."""
        each = np.array(
            [[year.errors(one, days, instruments).diffusivity for year in years] for one in range(len(self.starts))]
        )
        return np.array([np.median(each[self.nearby(one)], axis=0) for one in range(len(self.starts))])

    def places(self) -> list[Instruments]:
        """The best set of each number of sensors, with all plates: each adds a sensor to the one before."""
        plates = tuple(range(len(self.campaign.settings.plates)))
        sets = [Instruments((), plates)]
        starts = np.linspace(0, len(self.starts) - 1, _PLACES_FROM).astype(int).tolist()
        days = min(_PLACED_WITH, self.days)
        for count in range(self.campaign.settings.sensors):
            self.report("plan: placing sensors", 0.3 + 0.3 * count / self.campaign.settings.sensors)
            unused = [k for k in range(len(_SHARES)) if k not in sets[-1].sensors]
            added = [Instruments((*sets[-1].sensors, k), plates) for k in unused]
            # the geometric mean over the first days and the middle diffusivities: none dominates
            scores = [
                sum(math.log(min(self.years[y].errors(s, days, one).diffusivity, 1e6)) for s in starts for y in (1, 3))
                for one in added
            ]
            sets.append(added[int(np.argmin(scores))])
        return sets if plates else sets[1:]

    def best_start(self, days: float, instruments: Instruments) -> int:
        """The index of the first day with the smallest standard error at the middle diffusivity."""
        return int(np.argmin(self.season(days, instruments, [self.years[_MIDDLE]])))

    def curve(self, instruments: Instruments) -> Curve:
        """The interval against the days, for one set, each length from its best first day on."""
        lengths = [*(days for days in _LENGTHS if days < self.days), self.days]
        errors = [
            np.median(self.errors(self.best_start(days, instruments), days, instruments).diffusivity, axis=0)
            for days in lengths
        ]
        return Curve(len(instruments.sensors), tuple(lengths), np.array(errors))


def plan_campaign(campaign: PlannedCampaign, weather: WeatherYear, report: Progress) -> CampaignPlan:
    """How to instrument a wall before there is a record.

    The wall is put into the weather of a typical year. Of each campaign the interval of an estimate is expected from
    the Fisher information, over the diffusivities that the wall may have: for up to the stated number of sensors,
    placed one after the other, beside the plates that are allowed, for first days around the year and for each length.

    Args:
        campaign: from `wallid.load_campaign`.
        weather: of the typical year.
        report: called as `report(text, share)` with the step that begins and the completed share, 0 to 1.

    Returns:
        sensors, plates, sampling step, days and first day, each with what it would give.
    """
    search = PlanSearch(campaign, weather, report)
    sets = search.places()
    report("plan: choosing the length", 0.6)
    curves = [search.curve(one) for one in sets]
    longest = np.array([curve.median[-1] for curve in curves])
    chosen = int(np.argmax(longest <= max(_ENOUGH * longest.min(), _FINE_ENOUGH)))
    instruments = _with_fewest_plates(search, sets[chosen])
    if instruments != sets[chosen]:
        curves = [search.curve(replace(one, plates=instruments.plates)) for one in sets]
    days = curves[chosen].enough(_ENOUGH, _FINE_ENOUGH)
    report("plan: comparing seasons", 0.9)
    return _result(search, instruments, days, curves)


def _with_fewest_plates(search: PlanSearch, instruments: Instruments) -> Instruments:
    """The set with the fewest plates that determine the resistance about as well as all; one is needed for it."""
    plates = instruments.plates
    if len(plates) < 2:
        return instruments
    year, start = search.years[_MIDDLE], search.best_start(search.days, instruments)
    both = year.errors(start, search.days, instruments).resistance
    single = [replace(instruments, plates=(k,)) for k in plates]
    errors = [year.errors(start, search.days, one).resistance for one in single]
    best = int(np.argmin(errors))
    return single[best] if errors[best] <= _ENOUGH * both else instruments


def _result(search: PlanSearch, instruments: Instruments, days: float, curves: Sequence[Curve]) -> CampaignPlan:
    """The plan of the chosen instruments and length, from the best first day on."""
    campaign, settings = search.campaign, search.campaign.settings
    positions = tuple(float(_SHARES[k] * search.wall.length) for k in sorted(instruments.sensors))
    plates = tuple(settings.plates[k] for k in instruments.plates)
    season = Season(
        tuple(day_of_year(int(row)) for row in search.starts), search.season(days, instruments, search.years)
    )
    start = int(np.argmin(season.errors[:, _MIDDLE]))
    case = typical_case(campaign, search.weather, search.wall.diffusivity_prior, positions, plates)
    window = Window(int(search.starts[start]), round(days * DAY / case.record.step))
    return CampaignPlan(
        campaign=campaign,
        positions=positions,
        plates=plates,
        step=sampling_step(campaign),
        days=days,
        start=day_of_year(int(search.starts[start])),
        errors=search.errors(start, days, instruments),
        diffusivities=search.diffusivities,
        curves=tuple(curves),
        season=season,
        tolerances=_tolerances(search, instruments, start, days) if positions else (),
        case=case,
        window=window,
    )


def _tolerances(search: PlanSearch, instruments: Instruments, start: int, days: float) -> tuple[Tolerance, ...]:
    """How the interval depends on the errors of positions and offsets."""
    year = search.years[_MIDDLE]
    sensor = year.case.sensors[0]  # with the noise of an hour's mean, as everywhere in the plan

    def error(name: str, value: float) -> float:
        changed = replace(sensor, **{name: value})
        each = [year.errors(one, days, instruments, changed).diffusivity for one in search.nearby(start)]
        return float(np.median(each))

    return tuple(
        Tolerance(name, values, np.array([error(name, value) for value in values])) for name, values in _STDS.items()
    )
