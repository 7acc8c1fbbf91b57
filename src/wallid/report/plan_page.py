"""The page of a planned campaign and its figures."""

from __future__ import annotations

from matplotlib.figure import Figure

from .. import plot
from .._internal.number_formats import counted, date_of, format_text
from ..experiment_design.campaign_plan.plan_result import CampaignPlan
from .single_page import SinglePage

_NAMES = {
    "diffusivity": "diffusivity",
    "resistance": "thermal resistance R",
    "transmittance": "U-value",
    "capacity": "areal heat capacity",
}
_CAPTIONS = {
    "days": "Expected half width of the 95 % interval of the diffusivity against the length of the campaign, for the "
    "best set of each number of sensors, each length from its best first day on. Bands: over the diffusivities that "
    "the wall may have. Days past the dashed line buy little.",
    "season": "The same against the first day, for the planned sensors and days: the median over the weather of the "
    "two weeks before and after it in a typical year.",
    "accuracy": "The same against the accuracy of the positions and of the offsets of the sensors inside the wall.",
    "section": "The wall with the planned sensors and plates.",
}


def plan_page(plan: CampaignPlan) -> SinglePage:
    """What `wallid plan` writes."""
    return SinglePage(
        case=plan.campaign.name,
        template="plan.html",
        context={
            "plan": plan,
            "campaign": plan.campaign,
            "first": date_of(plan.start),
            "expected": [(_NAMES[name], f"± {100 * value:.2g} %") for name, value in plan.expected.items()],
            "steps": [format_text(step) for step in plan_steps(plan)],
            "summary": format_text(str(plan)),
            "badge": f"{counted(len(plan.positions), 'sensor')}, {counted(len(plan.plates), 'plate')}",
            "season": format_text(f"{plan.season_sentence[:1].upper()}{plan.season_sentence[1:]}."),
        },
        entries={"plan": plan.to_dict()},
        draw=lambda: _figures(plan),
        captions=_CAPTIONS,
    )


def _figures(plan: CampaignPlan) -> list[tuple[str, Figure]]:
    with plot.style():
        section, ax = plot.figure(height=2.4)
        plot.wall(plan.case, ax=ax)
        days, ax = plot.figure(height=3.6)
        plot.interval_by_days(plan, ax=ax)
        season, ax = plot.figure(height=3.0)
        plot.interval_by_start(plan, ax=ax)
        figures = [("section", section), ("days", days), ("season", season)]
        if plan.tolerances:
            accuracy, axes = plot.figure(1, len(plan.tolerances), height=2.8)
            for ax, one in zip(axes, plan.tolerances, strict=True):
                plot.interval_by_accuracy(plan, one.name, ax=ax)
            figures.append(("accuracy", accuracy))
    return figures


def plan_steps(plan: CampaignPlan) -> list[str]:
    """What to do, in the order of the work."""
    steps = []
    if plan.positions:
        places = ", ".join(f"{100 * position:.3g} cm" for position in plan.positions)
        steps.append(
            f"Put {counted(len(plan.positions), 'temperature sensor')} into the wall, {places} from the left face."
        )
    steps.append("Put a temperature sensor on each face.")
    steps += [f"Put a heat flux plate on the {face} face." for face in plan.plates]
    steps += [f"Log {name.replace('_', ' ')}: {reason}." for name, reason in plan.columns.items()]
    steps.append(f"Log a row every {plan.step:g} s for {plan.days:g} days, from about {date_of(plan.start)} on.")
    steps += [f"{text[:1].upper()}{text[1:]}." for text in plan.accuracy_sentences]
    return steps
