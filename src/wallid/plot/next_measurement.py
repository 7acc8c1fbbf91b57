"""Figures of what to measure next: the probability of each action, and that of a sensor by its place."""

from __future__ import annotations

from matplotlib.axes import Axes

from ..discrepancy.next_measurement.actions import HELPFUL, Prescription
from .house_style import BLUE, GREY, ORANGE, axes_or_new
from .legends import legend_below, use_constrained_layout


def sensor_probability(prescription: Prescription, *, legend: bool = True, ax: Axes | None = None) -> Axes:
    """Probability that the next diagnosis is right with one more sensor, by its place in the wall.

    Args:
        prescription: with the places that were tried.
        legend: False where the panel shares the legend of another.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    positions, probabilities = zip(*prescription.curve, strict=True)
    ax.plot([100 * x for x in positions], probabilities, "o-", color=BLUE, label="with one more sensor")
    _reference_lines(prescription, ax.axhline)
    ax.set(xlabel="position of the sensor (cm from the left face)", ylabel="probability", ylim=(0.0, 1.02))
    ax.set_title("One more temperature sensor")
    if legend:
        legend_below(ax)
    use_constrained_layout(ax)
    return ax


def action_probabilities(prescription: Prescription, *, legend: bool = True, ax: Axes | None = None) -> Axes:
    """Probability that the next diagnosis is right with each proposed action, the best on top.

    For columns that were not logged: that an effect of typical size is named.

    Args:
        prescription: with its actions.
        legend: False where the panel shares the legend of another.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    names = [action.short_words for action in prescription.actions]
    values = [action.probability for action in prescription.actions]
    bars = ax.barh(range(len(names)), values, height=0.6, color=BLUE)
    ax.bar_label(bars, [f"{value:.2f}" for value in values], padding=3)
    _reference_lines(prescription, ax.axvline)
    ax.set_yticks(range(len(names)), names)
    ax.invert_yaxis()
    event = "an effect of typical size is named" if prescription.column else "the next diagnosis is right"
    ax.set(xlabel=f"probability that {event}", xlim=(0.0, 1.12))
    ax.set_title("Columns that were not logged" if prescription.column else "Actions")
    ax.grid(visible=False, axis="y")
    if legend:
        legend_below(ax)
    use_constrained_layout(ax)
    return ax


def _reference_lines(prescription: Prescription, line: object) -> None:
    """The probability of a repeat, and that from which an action is proposed."""
    assert callable(line)
    if not prescription.column:  # no repeat answers the question without the column
        line(prescription.now, color=ORANGE, ls="--", label="a repeat of this record")
    line(HELPFUL, color=GREY, ls=":", label="least probability of a proposal")
