"""Figures of a diagnosis, each drawn on Axes that the caller gives: where model and record part, and what closes it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh

from .._internal.number_formats import unit
from .._internal.units import DAY
from ..discrepancy.effect_fit import Fit
from ..discrepancy.findings import CHANCE, Diagnosis, NamedEffect
from ..discrepancy.problem import EffectParameters
from ..inference.quantity import NORMAL_95
from .house_style import BLUE, DAYS, GREEN, GREY, KEEP, ORANGE, RED, SKY, ink_on
from .legends import legend_above, legend_below, make_room
from .residuals import days_of, names_of, short

_WEEK = 7 * DAY
_CLIPPED = 98.0  # percentile of the residuals that the map's colours reach: single outliers would bleach it
_KOLMOGOROV_95 = 1.358
_SHOWN = 12


def worst_week(fit: Fit) -> slice:
    """The rows of the seven days in which a model misses most."""
    rest = fit.residual_at_rows
    count = np.isfinite(rest).sum(axis=1)
    squares = np.where(np.isfinite(rest), rest, 0.0)
    rows = min(len(rest), max(2, round(_WEEK / fit.study.record.step)))
    total = np.convolve((squares**2).sum(axis=1), np.ones(rows), "valid")
    readings = np.convolve(count, np.ones(rows), "valid")
    # a week with hardly a reading says little, however far off it is
    mean = np.where(readings >= 0.5 * readings.max(), total / np.maximum(readings, 1.0), 0.0)
    first = int(np.argmax(mean))
    return slice(first, first + rows)


def week_temperatures(ax: Axes, explanation: Diagnosis, sensor: int, *, legend: bool = True) -> None:
    """Measured against simulated over the plain model's worst week, before and after.

    Args:
        legend: False where another panel's tells.
    """
    week, days = worst_week(explanation.before), days_of(explanation.before)
    before, after = explanation.before, explanation.after
    ax.plot(days[week], before.study.record.sensors[week, sensor], ".", ms=3.5, color=GREY, label="measured")
    ax.plot(days[week], before.predicted[week, sensor], "--", color=ORANGE, label="plain model")
    if after.active:
        ax.plot(days[week], after.predicted[week, sensor], color=BLUE, label=_with(explanation))
    ax.set(xlabel=DAYS, ylabel="temperature (°C)", title=f"{names_of(before)[sensor]}: the plain model's worst week")
    if not after.active:
        ax.set_title(f"{names_of(before)[sensor]}: the worst week")
    if legend:
        legend_above(ax)
    make_room(ax)


def week_residuals(ax: Axes, explanation: Diagnosis, sensor: int, *, legend: bool = True) -> None:
    """Measured minus simulated over that week, before and after.

    Args:
        legend: False where another panel's tells.
    """
    week, days = worst_week(explanation.before), days_of(explanation.before)
    shown = [(explanation.before, ORANGE, ".--", "plain model")]
    if explanation.after.active:
        shown.append((explanation.after, BLUE, ".-", _with(explanation)))
    for fit, tint, line, label in shown:
        rest = fit.residual_at_rows[week, sensor]
        there = np.isfinite(rest)
        ax.plot(days[week][there], rest[there], line, ms=2.5, lw=0.8, color=tint, label=label)
    ax.axhline(0.0, color=GREY, lw=0.8)
    name = names_of(explanation.before)[sensor]
    ax.set(xlabel=DAYS, ylabel="residual (K)", title=f"{name}: measured minus simulated")
    if legend:
        legend_above(ax)
    make_room(ax)


def waterfall_steps(explanation: Diagnosis) -> list[tuple[str, float]]:
    """Gaps from the plain model to the last, K, each with what was added.

    The effects come in by what they explain, the largest first. A model with only the first of them is
    shown where the search has fitted it; where it has not, they come in together.
    """
    study, gap = explanation.study, explanation.gap
    steps, waiting = [("plain model", gap.before)], []
    for count, named in enumerate(explanation.effects, start=1):
        waiting.append(study.label(named.slot.effect))
        value = gap.after
        if count < len(explanation.effects):
            found = _tried(explanation, {other.slot for other in explanation.effects[:count]})
            if found is None:
                continue
            value = found.gap
        steps.append((" and ".join(waiting), value))
        waiting = []
    return steps


def _tried(explanation: Diagnosis, slots: set[EffectParameters]) -> Fit | None:
    """The best fit that the search has made with just these effects."""
    fits = [trial.fit for trial in explanation.trials if set(trial.fit.active) == slots]
    return min(fits, key=lambda fit: fit.cost, default=None)


def waterfall(ax: Axes, explanation: Diagnosis) -> None:
    """The gap from the plain model through each effect to what is left, beside what noise alone would leave."""
    gap, steps = explanation.gap, waterfall_steps(explanation)
    bars = [("plain model", 0.0, gap.before, GREY)]
    refused = _refused(explanation)
    bars += [
        (f"+ {label}{refused}", gap_before, gap_after, SKY) for (_, gap_before), (label, gap_after) in pairwise(steps)
    ]
    held = [(0, gap.held_out_before)]
    if explanation.after.active:
        bars.append(("after", 0.0, gap.after, BLUE))
        held.append((len(bars) - 1, gap.held_out_after))
    for place, (_, low, high, tint) in enumerate(bars):
        ax.bar(place, high - low, bottom=low, width=0.6, color=tint)
        words = f"{short(high)}" if low == 0.0 else f"{high - low:+.3g}".replace("-", "\N{MINUS SIGN}")
        ax.annotate(
            words, (place, max(low, high)), (0, 2), textcoords="offset points", ha="center", va="bottom", fontsize=8
        )
    for place, (_, value) in enumerate(steps):  # a bar's end carried on to the next one
        if place + 1 < len(bars):
            ax.plot([place + 0.3, place + 0.7], [value, value], color=GREY, lw=0.8)
    ax.axhline(gap.floor, color=RED, ls="--", lw=1.0, label=f"noise alone: {short(gap.floor)} K")
    seen = [(place + 0.2, value) for place, value in held if value is not None]
    if seen:
        # beside the number that stands above the bar's middle
        ax.plot(*zip(*seen, strict=True), "D", ms=5, mfc="white", color=ORANGE, ls="none", label="days held out")
    ax.set_xticks(range(len(bars)), [_folded(label) for label, *_ in bars])
    highest = max([gap.before, gap.after, gap.floor, *(value for _, value in seen)])
    beside = max(0.6, 1.5 - 0.5 * (len(bars) - 1))  # one bar alone would be a wall
    ax.set(
        ylabel="rms of measured minus simulated (K)", ylim=(0, 1.35 * highest), xlim=(-beside, len(bars) - 1 + beside)
    )
    if explanation.verdict == "unnamed":
        ax.set_title("No known effect closes the gap")
    else:
        ax.set_title("How far the gap shrinks" if explanation.after.active else "The gap")
    ax.grid(False, axis="x")
    ax.legend(loc="upper right", ncols=2)
    make_room(ax)


def ranked_gains(ax: Axes, explanation: Diagnosis, count: int = _SHOWN) -> None:
    """What each effect alone would explain beside the plain model: expected, and after a refit where one was made."""
    rows = [row for row in explanation.table[:count] if row.expected > 0]
    named = {effect.slot for effect in explanation.effects}
    rivals = {slot for effect in explanation.effects for slot in effect.alternatives}
    tints = [GREEN if row.slot in named else ORANGE if row.slot in rivals else GREY for row in rows]
    places = np.arange(len(rows))
    expected = np.array([row.expected for row in rows])
    standing = f"nearest effect{_refused(explanation)}" if explanation.incomplete else "in the model"
    for tint, words in ((GREEN, standing), (ORANGE, "cannot be told from it"), (GREY, "not taken")):
        chosen = [place for place, own in zip(places, tints, strict=True) if own == tint]
        if chosen:
            ax.plot(expected[chosen], chosen, "o", color=tint, label=words)
    tried = [(row.gain, place) for place, row in enumerate(rows) if row.gain is not None and row.gain > 0]
    if tried:
        ax.plot(*zip(*tried, strict=True), "|", ms=12, mew=1.5, color="black", ls="none", label="after a refit")
    chance = explanation.screen.threshold(CHANCE)
    ax.axvline(chance, color=RED, ls="--", lw=1.0, label=f"chance, {100 * CHANCE:g} %")
    ax.set_yticks(places, [row.label for row in rows])
    ax.set(
        xscale="log", xlabel=r"drop of $-2 \log L$ (-); dots: expected", title="What each effect alone would explain"
    )
    ax.invert_yaxis()
    legend_below(ax)


def confusable_places(explanation: Diagnosis, count: int = _SHOWN) -> list[int]:
    """The effects that would explain most, each at its best place, by their place in the screen."""
    return explanation.screen.best(count)


def confusability(ax: Axes, explanation: Diagnosis, count: int = _SHOWN, *, colour_bar: bool = True) -> QuadMesh:
    """How alike the traces of the leading effects are in this record: 1, and it cannot tell them apart.

    Args:
        count: of effects. colour_bar: False leaves it to the caller.
    """
    make_room(ax)
    screen = explanation.screen
    places = confusable_places(explanation, count)
    alike = np.abs(screen.cosine[np.ix_(places, places)])
    mesh = ax.pcolormesh(alike, cmap="cividis", vmin=0.0, vmax=1.0, edgecolors="white", linewidth=0.5)
    for i, j in np.ndindex(alike.shape):
        # never 1.00 for what is not the same
        words = f"{min(alike[i, j], 0.99):.2f}"[1:] if i != j else "1"
        tint = ink_on(mesh.to_rgba(alike[i, j]))
        ax.text(j + 0.5, i + 0.5, words, ha="center", va="center", fontsize=6.5, color=tint, gid=KEEP)
    labels = [explanation.study.label(screen.candidates[place].slot.effect) for place in places]
    ticks = np.arange(len(places)) + 0.5
    ax.set_xticks(ticks, labels, rotation=40, ha="right", rotation_mode="anchor")
    ax.set_yticks(ticks, labels)
    named = {effect.slot for effect in explanation.effects}
    for tick, place in zip((*ax.get_xticklabels(), *ax.get_yticklabels()), (*places, *places), strict=True):
        if screen.candidates[place].slot in named:
            tick.set_fontweight("bold")
    ax.set_aspect("equal")
    ax.invert_yaxis()
    ax.grid(False)
    ax.set_title("How alike the effects' traces are")
    if colour_bar:
        made = ax.get_figure(root=True)
        assert made is not None
        made.colorbar(mesh, ax=ax, label="|cosine| (-); 1: not to be told apart")
    return mesh


def size_by_window(ax: Axes, explanation: Diagnosis, named: NamedEffect) -> None:
    """An effect's size from each quarter of the record, beside that of the whole."""
    size = named.slot.effect.parameters[0]
    value, std = named.values[size.name]
    windows = named.windows
    ax.axhspan(value - NORMAL_95 * std, value + NORMAL_95 * std, color=SKY, alpha=0.35, lw=0, label="whole record")
    ax.axhline(value, color=BLUE, lw=1.0)
    ax.errorbar(
        windows.days, windows.size, NORMAL_95 * windows.std, fmt="o", color=GREY, capsize=3, label="each quarter"
    )
    ax.axhline(0.0, color=RED, ls="--", lw=1.0, label="none")
    record = explanation.study.record
    ax.set(
        xlabel=DAYS,
        ylabel=f"{size.name.replace('_', ' ')} ({unit(size.unit) or '-'})",
        xlim=(0, record.rows * record.step / DAY),
    )
    told = f"; {windows.told} of {len(windows.size)} quarters tell of it"
    if windows.told > 1:
        told = f"; all the same: p = {windows.p_value:.2g}"
    ax.set_title(f"{explanation.study.label(named.slot.effect)}, 95 %{told}", wrap=True)
    legend_above(ax)


def _with(explanation: Diagnosis) -> str:
    """The name of the later model."""
    which = "nearest " if explanation.incomplete else ""
    return f"with the {which}effect{'s' if len(explanation.effects) > 1 else ''}{_refused(explanation)}"


def _refused(explanation: Diagnosis) -> str:
    """Said of effects that may not stand; empty where they do."""
    return ", refused" if explanation.incomplete else ""


def _folded(label: str, width: int = 16) -> str:
    """A label in lines of about so many characters."""
    lines = [""]
    for word in label.replace(" of ", " of\N{NO-BREAK SPACE}").split(" "):  # a target stays with its "of"
        if lines[-1] and len(lines[-1]) + len(word) > width:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return "\n".join(lines)


__all__ = [
    "confusability",
    "confusable_places",
    "ranked_gains",
    "size_by_window",
    "waterfall",
    "waterfall_steps",
    "week_residuals",
    "week_temperatures",
    "worst_week",
]
