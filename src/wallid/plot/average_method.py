"""The figure of the average method of ISO 9869-1: the resistance against the days averaged, and its stopping rules."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from .._internal.units import DAY
from ..case.case_definition import Case
from ..estimation.iso_9869 import MIN_DAYS, TOLERANCE, AverageMethod, resistance_over_time
from ..estimation.result_objects import Estimate
from .house_style import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SKY, axes_or_new
from .legends import legend_below, use_constrained_layout
from .logged_record import downsampled

_FIRST_DAYS = 1.0  # R of a shorter time does not set the ordinate: it is dominated by stored heat
_MARGIN = 0.15  # of the range, above and below


def average_resistance(case: Case, fit: Estimate, plate: int, *, legend: bool = True, ax: Axes | None = None) -> Axes:
    """The resistance by the average method against the time averaged over, with the stopping rules of ISO 9869-1.

    A vertical line is the shortest measurement, three days. A band is 5 % about the result: R of a day before must lie
    in it. Dashed lines are R of the first and of the last two thirds. The title says which rules are not met. The
    resistance of the estimate is drawn with its 95 % interval.

    Args:
        fit: an estimate from heat fluxes.
        plate: index of the plate.
        legend: False where the panel shares the legend of another.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.

    Raises:
        ValueError: the estimate has no heat fluxes.

    Source: ISO 9869-1:2014, 7.1.
    """
    if fit.thermal is None:
        raise ValueError("fit: it has no thermal properties; state flux_left or flux_right in [record] of the case")
    ax = axes_or_new(ax)
    average = fit.thermal.average_methods[plate]
    part = case.record.window(fit.window.row, fit.window.rows)
    course = resistance_over_time(part.faces, part.regressors[f"flux_{average.face}"])
    days = (np.arange(part.rows) + 1.0) * part.step / DAY
    ax.plot(*downsampled(days, course), color=BLUE, lw=1.2, label="average method, R")
    estimated = fit.thermal.resistance
    ax.axhline(estimated.value, color=SKY, ls="-.", lw=1.0, label="R of the estimate")
    ax.axhspan(*estimated.interval_95, color=SKY, alpha=0.2, lw=0, label="its 95 % interval")
    if average.resistance is not None:
        _draw_rules(ax, average, average.resistance)
    ax.axvline(MIN_DAYS, color=GREY, ls=":", lw=1.0, label=f"{MIN_DAYS:g} days, the least that is required")
    _limit_ordinate(ax, days, course, average, estimated.interval_95)
    ax.set(xlim=(0.0, max(days[-1], MIN_DAYS) * 1.02), xlabel="days averaged over", ylabel="resistance (m² K/W)")
    ax.set_title(_title(average), wrap=True)
    if legend:
        legend_below(ax)
    use_constrained_layout(ax)
    return ax


def _draw_rules(ax: Axes, average: AverageMethod, resistance: float) -> None:
    """Draw the result, the band about it, R of a day before, and R of the first and last two thirds."""
    end, band = average.averaged_days, f"± {100 * TOLERANCE:g} %"
    ax.fill_between(
        [0.0, end],
        resistance * (1 - TOLERANCE),
        resistance * (1 + TOLERANCE),
        color=ORANGE,
        alpha=0.25,
        lw=0,
        label=f"result {band}",
    )
    ax.plot([end], [resistance], "o", ms=7, color=ORANGE, label="result")
    if average.resistance_day_before is not None:
        ax.plot([end - 1.0], [average.resistance_day_before], "D", ms=6, mfc="none", color=RED, label="R a day before")
    parts = zip(
        ("first", "last"), (0.0, end - average.part_days), average.resistances_of_parts, (GREEN, PURPLE), strict=True
    )
    for name, begin, value, colour in parts:
        if value is not None:
            label = f"R of the {name} two thirds"
            ax.plot([begin, begin + average.part_days], [value, value], "--", lw=1.8, color=colour, label=label)


def _limit_ordinate(
    ax: Axes, days: np.ndarray, course: np.ndarray, average: AverageMethod, interval: tuple[float, float]
) -> None:
    """Limit the ordinate to R after the first hours, the rules and the estimate."""
    late = course[(days >= min(_FIRST_DAYS, 0.5 * days[-1])) & np.isfinite(course)]
    rules = [average.resistance_day_before, *average.resistances_of_parts]
    if average.resistance is not None:
        rules += [average.resistance * (1 - TOLERANCE), average.resistance * (1 + TOLERANCE)]
    shown = np.concatenate([late, interval, [value for value in rules if value is not None]])
    low, high = float(shown.min()), float(shown.max())
    margin = _MARGIN * max(high - low, 1e-3)
    ax.set_ylim(low - margin, high + margin)


def _title(average: AverageMethod) -> str:
    """The plate, and whether its measurement may end, with each rule that is not met."""
    plate = f"{average.face.capitalize()} plate"
    if average.resistance is None:
        return f"{plate}: the mean flux is zero, there is no resistance"
    result = f"{plate}, average of {average.averaged_days:.3g} days: R = {average.resistance:.3f} m² K/W"
    if average.complete:
        return f"{result}\nAll three stopping rules of ISO 9869-1 are met"
    return "\n".join([f"{result}\nStopping rules of ISO 9869-1 that are not met:", *average.unmet_rules])
