"""The plan of a campaign, with the columns that it should log, and where ISO 9869-1 would let it end."""

from __future__ import annotations

import math
from dataclasses import replace

from ..._internal.blas_threads import one_blas_thread
from ..._internal.progress import Progress, part_of, shown_progress
from ..._internal.units import DAY
from ...case.planned_campaign import PlannedCampaign
from ...estimation.iso_9869 import MIN_DAYS, average_method
from ...experiment_design.campaign_plan.plan_result import CampaignPlan
from ...experiment_design.campaign_plan.plan_search import plan_campaign
from ...experiment_design.campaign_plan.typical_case import campaign_irradiance, indoor_temperature
from .columns_of_plan import columns_to_log


@one_blas_thread
def plan(campaign: PlannedCampaign, *, progress: Progress | None = None) -> CampaignPlan:
    """How to instrument a wall before there is a record.

    The wall is put into the weather of a typical year. Of each campaign the interval of an estimate is expected from
    the Fisher information, over the diffusivities that the wall may have: for up to the stated number of sensors,
    placed one after the other, beside the plates that are allowed, for first days around the year and for each length.
    Columns are those without which an effect of typical size would be seen but not named.

    Args:
        campaign: from `wallid.load_campaign`.
        progress: called as `progress(text, share)` with the step that begins and the completed share, 0 to 1;
            None for a bar in a notebook, and nothing elsewhere.

    Returns:
        Sensors, plates, columns, sampling step, days and first day, each with what it would give.

    Raises:
        InputError: the weather file cannot be read, or pvlib is not installed.
        RuntimeError: 64-bit floats are switched off.

    Example:
        >>> found = wallid.plan(wallid.load_campaign("case.toml"))
        >>> print(found.positions, found.days, found.expected["diffusivity"])
    """
    with shown_progress(progress) as report:
        report("plan: reading the weather", 0.0)
        weather = campaign.read_weather()
        found = plan_campaign(campaign, weather, part_of(report, 0.0, 0.6))
        report("plan: the columns to log", 0.6)
        logged = {
            "irradiance": campaign_irradiance(campaign, weather),
            "air_outdoor": weather.air,
            "air_indoor": indoor_temperature(campaign, weather),
        }
        columns = columns_to_log(found.case, found.window, logged)
        return replace(found, columns=columns, average_method_days=_average_method_days(found))


def _average_method_days(found: CampaignPlan) -> dict[str, float | None]:
    """The days after which ISO 9869-1 would let each plate end, within the longest campaign."""
    record, ends = found.case.record, {}
    for face in found.plates:
        ends[face] = None
        for days in range(math.ceil(MIN_DAYS), int(found.campaign.settings.days) + 1):
            part = slice(found.window.row, found.window.row + round(days * DAY / record.step))
            rows = record.faces[part], record.regressors[f"flux_{face}"][part]
            if average_method(*rows, record.step, face).complete:
                ends[face] = float(days)
                break
    return ends
