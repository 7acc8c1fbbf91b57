"""The result of planning a campaign."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from ..._internal.html import html_table
from ..._internal.number_formats import counted, date_of, value_and_std
from ..._internal.result_object import ResultObject, plain_value
from ...case.case_definition import Case
from ...case.planned_campaign import PlannedCampaign
from ...case.time_window import Window
from ...models.wall_parameters import R_INSIDE, R_OUTSIDE
from .expected_intervals import CampaignErrors, chance_of_uninformative, half_width, times_as_wide
from .typical_case import conductivity_of

if TYPE_CHECKING:
    from pandas import DataFrame

_WORTH_TELLING = 1.2  # ratio of two intervals from which another season is mentioned
_FEWEST = 3.0  # days, since no day is like another
_TOLERATED = 1.1  # ratio to the narrowest interval that an accuracy may cost


@dataclass(frozen=True, eq=False)
class Curve:
    """The standard error against the days, for one number of sensors, each length from its best first day on.

    Args:
        sensors: their number.
        days: lengths of the campaign.
        errors: standard errors of ln(diffusivity), `(length, diffusivity)`.
    """

    sensors: int
    days: tuple[float, ...]
    errors: np.ndarray = field(repr=False)

    @property
    def median(self) -> Float[np.ndarray, " length"]:
        """The median over the diffusivities."""
        return np.asarray(np.median(self.errors, axis=1))

    def enough(self, ratio: float, fine: float) -> float:
        """The shortest campaign past which more days buy nothing, days.

        Args:
            ratio: of its interval to that of the longest campaign, at most; or
            fine: a standard error of ln(diffusivity) that needs not be smaller.
        """
        enough = (self.median <= max(ratio * self.median[-1], fine)) & (np.array(self.days) >= _FEWEST)
        return self.days[int(np.argmax(enough))] if enough.any() else self.days[-1]


@dataclass(frozen=True, eq=False)
class Season:
    """The standard error against the first day.

    Args:
        days: of the year, 1 to 365.
        errors: standard errors of ln(diffusivity), the median over the weather of the days around, `(first day,
            diffusivity)`.
    """

    days: tuple[int, ...]
    errors: np.ndarray = field(repr=False)

    @property
    def median(self) -> Float[np.ndarray, " day"]:
        """The median over the diffusivities."""
        return np.asarray(np.median(self.errors, axis=1))


@dataclass(frozen=True, eq=False)
class Tolerance:
    """How the standard error depends on the accuracy of the sensors.

    Args:
        name: "position_std" (m) or "offset_std" (K).
        values: of the standard deviation.
        errors: standard errors of ln(diffusivity), `(value,)`.
    """

    name: str
    values: tuple[float, ...]
    errors: np.ndarray = field(repr=False)

    @property
    def allowed(self) -> float:
        """The largest standard deviation that costs little."""
        return max(v for v, e in zip(self.values, self.errors, strict=True) if e <= _TOLERATED * self.errors.min())


@dataclass(frozen=True, eq=False)
class CampaignPlan(ResultObject):
    """How to instrument a wall, how long, and from when on.

    Args:
        campaign: the wall and what may be measured.
        positions: of the sensors, m from the left face.
        plates: the faces with a heat flux plate.
        step: of the rows, s.
        days: length of the campaign.
        start: its first day, day of the year.
        errors: expected standard errors of the logarithms, in the weather of several years, at each of `diffusivities`.
        diffusivities: that the wall may have with equal probability, m2/s.
        curves: the interval against the days, for the best set of each number of sensors beside these plates.
        season: the interval against the first day.
        tolerances: the interval against the accuracy of positions and offsets; empty without a sensor.
        case, window: the planned campaign in the typical year, at the prior diffusivity, without noise. The record
            goes on with the beginning of the year, where the campaign goes past its end.
        columns: further columns to log, each with the reason.
        average_method_days: days after which ISO 9869-1 would let a measurement end, by plate; None where not at all.
    """

    campaign: PlannedCampaign = field(repr=False)
    positions: tuple[float, ...]
    plates: tuple[str, ...]
    step: float
    days: float
    start: int
    errors: CampaignErrors = field(repr=False)
    diffusivities: tuple[float, ...]
    curves: tuple[Curve, ...] = field(repr=False)
    season: Season = field(repr=False)
    tolerances: tuple[Tolerance, ...] = field(repr=False)
    case: Case = field(repr=False)
    window: Window = field(repr=False)
    columns: dict[str, str] = field(default_factory=dict)
    average_method_days: dict[str, float | None] = field(default_factory=dict)

    @property
    def expected(self) -> dict[str, float]:
        """The expected relative half width of the 95 % interval of each quantity, the median over the diffusivities."""
        typical = self.errors.typical
        stds = {"diffusivity": [one.diffusivity for one in typical]}
        if self.plates:
            stds["resistance"] = [one.resistance for one in typical]
            stds["transmittance"] = [
                one.resistance * self._share_of_wall(alpha)
                for one, alpha in zip(typical, self.diffusivities, strict=True)
            ]
            stds["capacity"] = [one.capacity for one in typical]
        return {name: half_width(float(np.median(values))) for name, values in stds.items()}

    def _share_of_wall(self, diffusivity: float) -> float:
        """The share of the wall in its resistance from air to air."""
        wall = self.campaign.wall
        resistance = wall.length / conductivity_of(wall, diffusivity)
        return resistance / (resistance + R_INSIDE + R_OUTSIDE)

    @property
    def uninformative(self) -> float:
        """The chance that the record will not determine the diffusivity."""
        largest = self.campaign.choices.largest_interval_factor
        return chance_of_uninformative(self.errors.diffusivity, self.diffusivities, largest)

    @property
    def worst_start(self) -> int:
        """The first day of the year with the widest interval."""
        return self.season.days[int(np.argmax(self.season.median))]

    @property
    def season_ratio(self) -> float:
        """The widest interval over that of the chosen first day; infinite where it determines nothing."""
        return times_as_wide(float(self.season.median.max()), self._std_from_start)

    @property
    def _std_from_start(self) -> float:
        """The standard error of ln(diffusivity) from the chosen first day on."""
        return float(self.season.median[self.season.days.index(self.start)])

    def to_dict(self) -> dict[str, Any]:
        """The entries of result.json under "plan"."""
        return plain_value(
            {
                "sensors": [{"position": position} for position in self.positions],
                "plates": list(self.plates),
                "columns": list(self.columns),
                "step": self.step,
                "days": self.days,
                "start": self.start,
                "expected": self.expected,
                "uninformative": self.uninformative,
                "accuracy": {one.name: one.allowed for one in self.tolerances},
                "curves": [
                    {"sensors": one.sensors, "days": one.days, "half_width": [half_width(e) for e in one.median]}
                    for one in self.curves
                ],
                "season": {"start": self.season.days, "half_width": [half_width(e) for e in self.season.median]},
                "average_method_days": self.average_method_days,
            }
        )

    def to_frame(self) -> DataFrame:
        """One row for each number of sensors and length: `half_width` of the 95 % interval, relative."""
        import pandas as pd

        rows = [
            {"sensors": curve.sensors, "days": days, "half_width": half_width(error)}
            for curve in self.curves
            for days, error in zip(curve.days, curve.median, strict=True)
        ]
        return pd.DataFrame(rows)

    def summary(self) -> str:
        """The plan as text."""
        lines = [
            f"sensors      {self._sensors_text}",
            f"plates       {', '.join(self.plates) or 'none'}",
            f"columns      {'; '.join(f'{name}: {why}' for name, why in self.columns.items()) or 'faces only'}",
            f"step         a row every {self.step:g} s",
            f"days         {self.days:g} days from {date_of(self.start)} on",
        ]
        lines += [f"expected     {name}: +-{100 * value:.2g} % (95 %)" for name, value in self.expected.items()]
        lines.append(f"risk         the record will not determine the diffusivity: {100 * self.uninformative:.0f} %")
        lines.append(f"season       {self.season_sentence}")
        lines += [f"accuracy     {text}" for text in self.accuracy_sentences]
        for face, days in self.average_method_days.items():
            end = "not within the campaign" if days is None else f"after {days:g} days"
            lines.append(f"ISO 9869-1   the {face} plate could end {end}")
        lines += [f"days         {self._curve_text(curve)}" for curve in self.curves]
        return "\n".join(lines)

    __str__ = summary

    @property
    def _sensors_text(self) -> str:
        if not self.positions:
            return "none inside the wall"
        return ", ".join(f"{position:.3g} m" for position in self.positions) + " from the left face"

    def _curve_text(self, curve: Curve) -> str:
        points = ", ".join(
            f"{days:g} d +-{100 * half_width(error):.2g} %"
            for days, error in zip(curve.days, curve.median, strict=True)
        )
        return f"{counted(curve.sensors, 'sensor')}: {points}"

    @property
    def season_sentence(self) -> str:
        """What another season would give."""
        best, worst = half_width(self._std_from_start), half_width(float(self.season.median.max()))
        if self.season_ratio < _WORTH_TELLING:
            return f"the first day matters little (+-{100 * best:.2g} to {100 * worst:.2g} %)"
        return (
            f"from {date_of(self.start)} on the interval of the diffusivity is +-{100 * best:.2g} %, "
            f"from {date_of(self.worst_start)} on +-{100 * worst:.2g} %, {self.season_ratio:.1f} times as wide"
        )

    @property
    def accuracy_sentences(self) -> tuple[str, ...]:
        """How accurate the sensors have to be."""
        units = {"position_std": ("positions known to", "m"), "offset_std": ("offsets known to", "K")}
        texts = []
        for one in self.tolerances:
            words, unit = units[one.name]
            worst = times_as_wide(float(one.errors[-1]), float(one.errors.min()))
            coarsest = value_and_std(one.values[-1], 0.0, unit)
            if worst <= _TOLERATED:
                texts.append(f"{words} {coarsest} are accurate enough: the record determines them")
                continue
            texts.append(
                f"{words} {value_and_std(one.allowed, 0.0, unit)} (one standard deviation) widen the interval by less "
                f"than {100 * (_TOLERATED - 1):.0f} %; {coarsest} would make it {worst:.1f} times as wide"
            )
        return tuple(texts)

    def _repr_html_(self) -> str:
        rows = [
            ("sensors", self._sensors_text, "", ""),
            ("plates", ", ".join(self.plates) or "none", "", ""),
            ("days", f"{self.days:g}", f"from {date_of(self.start)} on", "d"),
            *((name, f"{100 * value:.2g}", "expected half width, 95 %", "%") for name, value in self.expected.items()),
        ]
        return html_table(f"Plan of {self.campaign.name}", rows)
