"""Figures of a diagnosis: residuals of the plain model and of the model with effects, and the effects themselves."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from .._internal.number_formats import format_unit
from .._internal.units import DAY
from ..discrepancy.effect_fit import EffectFit
from ..discrepancy.problem import EffectParameters
from ..discrepancy.result.diagnosis_result import Diagnosis
from ..discrepancy.selection.acceptance import FIRST_EFFECT_LEVEL
from ..discrepancy.selection.effect_results import NamedEffect
from ..inference.quantity import NORMAL_95
from .house_style import BLUE, GREEN, GREY, KEEP_COLOUR, ORANGE, RED, SKY, axes_or_new, text_colour_on
from .legends import as_drawn, legend_above, legend_below, root_figure, use_constrained_layout
from .residuals import instrument_names, shown_residual
from .time_axis import TimeAxis

_WEEK = 7 * DAY
_MOST_EFFECTS = 12
_WATERFALL_ROOM = 1.15  # highest ordinate over the highest bar: room for its number
_LABEL_POINTS = 14.0  # height of a bar's number, with its distance to the bar
_LAYOUT_SHARE = 0.6  # of the height of the Axes that remains when title, labels and legend have their room


def worst_week(fit: EffectFit) -> slice:
    """Rows of the seven days in which the root mean square of the residual is largest."""
    residual = shown_residual(fit)
    present = np.isfinite(residual)
    squares = np.where(present, residual, 0.0) ** 2
    rows = min(len(residual), max(2, round(_WEEK / fit.problem.record.step)))
    total = np.convolve(squares.sum(axis=1), np.ones(rows), "valid")
    readings = np.convolve(present.sum(axis=1), np.ones(rows), "valid")
    # a week with few readings is left out: its mean is uncertain
    mean = np.where(readings >= 0.5 * readings.max(), total / np.maximum(readings, 1.0), 0.0)
    first = int(np.argmax(mean))
    return slice(first, first + rows)


def week_readings(diagnosis: Diagnosis, instrument: int, *, legend: bool = True, ax: Axes | None = None) -> Axes:
    """Readings of a sensor or plate over the worst week of the plain model: measured, plain model, model with effects.

    Args:
        instrument: its index, the sensors first.
        legend: False where the panel shares the legend of another.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    week, axis = worst_week(diagnosis.before), TimeAxis(diagnosis.problem.record.start)
    days = axis.at(diagnosis.problem.record.days)
    before = diagnosis.before
    ax.plot(days[week], before.problem.readings[week, instrument], ".", ms=3.5, color=GREY, label="measured")
    used = np.logical_or.accumulate(
        np.isfinite(before.problem.readings[:, instrument])
    )  # without rows before the first
    for (label, fit, _), line, colour in zip(diagnosis.shown_models, ("--", "-"), (ORANGE, BLUE), strict=False):
        predicted = np.where(used, fit.predicted[:, instrument], np.nan)
        ax.plot(days[week], predicted[week], line, color=colour, label=label)
    axis.apply(ax)
    ax.set(
        ylabel="temperature (°C)" if instrument < diagnosis.problem.sensor_count else "heat flux (W/m²)",
        title=f"{instrument_names(before)[instrument]}: worst week of the plain model",
    )
    if legend:
        legend_above(ax)
    use_constrained_layout(ax)
    return ax


def week_residuals(diagnosis: Diagnosis, instrument: int, *, legend: bool = True, ax: Axes | None = None) -> Axes:
    """Residual of a sensor or plate over the worst week of the plain model, without and with effects.

    Args:
        instrument: its index, the sensors first.
        legend: False where the panel shares the legend of another.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    week, axis = worst_week(diagnosis.before), TimeAxis(diagnosis.problem.record.start)
    days = axis.at(diagnosis.problem.record.days)
    for (label, fit, _), line, colour in zip(diagnosis.shown_models, (".--", ".-"), (ORANGE, BLUE), strict=False):
        residual = fit.residual_at_rows[week, instrument]
        present = np.isfinite(residual)
        ax.plot(days[week][present], residual[present], line, ms=2.5, lw=0.8, color=colour, label=label)
    ax.axhline(0.0, color=GREY, lw=0.8)
    name = instrument_names(diagnosis.before)[instrument]
    axis.apply(ax)
    unit = "K" if instrument < diagnosis.problem.sensor_count else "W/m²"
    ax.set(ylabel=f"residual ({unit})", title=f"{name}: measured minus simulated")
    if legend:
        legend_above(ax)
    use_constrained_layout(ax)
    return ax


def waterfall_steps(diagnosis: Diagnosis) -> list[tuple[str, float]]:
    """Root mean square of the residual, in the unit of the gap, of the plain model and after each added effect.

    The effects are added in the order of their gain, the largest first. Where the search has not fitted the model
    with the first of them alone, they are added together.

    Returns:
        Label of what was added, and root mean square, for each step.
    """
    gap, first = diagnosis.gap, diagnosis.shown_models[0].label
    steps, added = [(first, gap.before)], []
    if diagnosis.shows_heterogeneity:
        steps.append(("section", diagnosis.before.gap))
    for count, named in enumerate(diagnosis.effects, start=1):
        added.append(as_drawn(diagnosis.problem.label(named.effect_parameters.effect)))
        value = gap.after
        if count < len(diagnosis.effects):
            fit = _best_fit(diagnosis, {other.effect_parameters for other in diagnosis.effects[:count]})
            if fit is None:
                continue
            value = fit.gap
        steps.append((" and ".join(added), value))
        added = []
    return steps


def _best_fit(diagnosis: Diagnosis, effects: set[EffectParameters]) -> EffectFit | None:
    """The best fit of the search with exactly these effects; None where there is none."""
    fits = [trial.fit for trial in diagnosis.trials if set(trial.fit.active) == effects]
    return min(fits, key=lambda fit: fit.cost, default=None)


def waterfall(diagnosis: Diagnosis, *, ax: Axes | None = None) -> Axes:
    """Waterfall chart of the residual (root mean square): plain model, change by each effect, model with effects.

    A dashed line is the value that the noise alone would give. Diamonds are the values on days that the fit did
    not use.

    Args:
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    gap, steps = diagnosis.gap, waterfall_steps(diagnosis)
    bars = [(steps[0][0], 0.0, gap.before, GREY)]
    bars += [(f"+ {label}{_refused(diagnosis)}", above, below, SKY) for (_, above), (label, below) in pairwise(steps)]
    held_out = [(0, gap.held_out_before)]
    if len(diagnosis.shown_models) > 1:
        bars.append((diagnosis.shown_models[-1].label, 0.0, gap.after, BLUE))
        held_out.append((len(bars) - 1, gap.held_out_after))
    highest = max([gap.before, gap.after, gap.noise_floor, *(value for _, value in held_out if value is not None)])
    top = _WATERFALL_ROOM * highest
    for bar, (_, low, high, colour) in enumerate(bars):
        ax.bar(bar, high - low, bottom=low, width=0.6, color=colour)
        text = f"{high:.3g}" if low == 0.0 else f"{high - low:+.3g}".replace("-", "\N{MINUS SIGN}")
        end = max(low, high)
        above = gap.noise_floor if 0.0 <= gap.noise_floor - end < _label_height(ax, top) else end  # not across the line
        ax.annotate(text, (bar, above), (0, 2), textcoords="offset points", ha="center", va="bottom", fontsize=8)
    for bar, (_, value) in enumerate(steps):  # connects the end of a bar with the next bar
        if bar + 1 < len(bars):
            ax.plot([bar + 0.3, bar + 0.7], [value, value], color=GREY, lw=0.8)
    ax.axhline(
        gap.noise_floor, color=RED, ls="--", lw=1.0, label=f"noise alone: {gap.noise_floor:.3g} {format_unit(gap.unit)}"
    )
    markers = [(bar + 0.2, value) for bar, value in held_out if value is not None]
    if markers:
        # right of the number above the middle of the bar
        ax.plot(
            *zip(*markers, strict=True),
            "D",
            ms=5,
            mfc="white",
            color=ORANGE,
            ls="none",
            label="on days left out of the fit",
        )
    ax.set_xticks(range(len(bars)), [_wrapped(label) for label, *_ in bars])
    margin = max(0.6, 1.5 - 0.5 * (len(bars) - 1))  # keeps a single bar narrow
    ax.set(
        ylabel=f"residual, root mean square ({format_unit(gap.unit)})",
        ylim=(0, top),
        xlim=(-margin, len(bars) - 1 + margin),
    )
    unexplained = ", not explained by a known effect" if diagnosis.verdict == "unnamed" else ""
    ax.set_title(f"Residual of the models{unexplained}")
    ax.grid(False, axis="x")
    legend_above(ax)
    return ax


def _label_height(ax: Axes, top: float) -> float:
    """Height of a bar's number with its distance to the bar, K; the layout makes the Axes lower than they are now.

    Args:
        top: upper limit of the ordinate, K.
    """
    inches = _LAYOUT_SHARE * ax.get_window_extent().height / root_figure(ax).dpi
    return _LABEL_POINTS / 72.0 / inches * top


def ranked_gains(diagnosis: Diagnosis, count: int = _MOST_EFFECTS, *, ax: Axes | None = None) -> Axes:
    """Gain of each effect when it alone is added to the plain model: expected, and after a refit where present is one.

    The gain is the decrease of -2 log L. The expected gain is that of the score test.

    Args:
        count: number of effects, those of the largest expected gain.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    rows = [row for row in diagnosis.table[:count] if row.expected_gain > 0]
    named = {effect.effect_parameters for effect in diagnosis.effects}
    rivals = {rival for effect in diagnosis.effects for rival in effect.alternatives}
    colours = [
        GREEN if row.effect_parameters in named else ORANGE if row.effect_parameters in rivals else GREY for row in rows
    ]
    expected = np.array([row.expected_gain for row in rows])
    selected = f"nearest effect{_refused(diagnosis)}" if diagnosis.incomplete else "in the model"
    for colour, label in ((GREEN, selected), (ORANGE, "indistinguishable from it"), (GREY, "not selected")):
        ranks = [rank for rank, own in enumerate(colours) if own == colour]
        if ranks:
            ax.plot(expected[ranks], ranks, "o", color=colour, label=label)
    refitted = [(row.gain, rank) for rank, row in enumerate(rows) if row.gain is not None and row.gain > 0]
    if refitted:
        ax.plot(*zip(*refitted, strict=True), "|", ms=12, mew=1.5, color="black", ls="none", label="after a refit")
    threshold = diagnosis.scores.threshold(FIRST_EFFECT_LEVEL)
    false_alarms = f"{100 * FIRST_EFFECT_LEVEL:g} % false-alarm rate"
    ax.axvline(threshold, color=RED, ls="--", lw=1.0, label=f"threshold, {false_alarms}")
    ax.set_yticks(range(len(rows)), [as_drawn(row.label) for row in rows])
    ax.set(
        xscale="log",
        xlabel=r"gain: decrease of $-2 \log L$ (-); dots: expected",
        title="Gain of each effect added alone",
    )
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.invert_yaxis()
    legend_below(ax)
    return ax


def cosine_similarity(
    diagnosis: Diagnosis, count: int = _MOST_EFFECTS, *, colour_bar: bool = True, ax: Axes | None = None
) -> Axes:
    """Cosine between the residual changes that the effects cause, for the effects of the largest expected gain.

    The changes are whitened and orthogonal to the estimated and nuisance parameters. At 1, two effects change the
    residual in proportion: this record cannot distinguish them.

    Args:
        count: number of effects.
        colour_bar: False where the caller draws it.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    use_constrained_layout(ax)
    scores = diagnosis.scores
    candidates = scores.best(count)
    cosine = np.abs(scores.cosine[np.ix_(candidates, candidates)])
    mesh = ax.pcolormesh(cosine, cmap="cividis", vmin=0.0, vmax=1.0, edgecolors="white", linewidth=0.5)
    for i, j in np.ndindex(cosine.shape):
        # 1 on the diagonal only
        text = f"{min(cosine[i, j], 0.99):.2f}"[1:] if i != j else "1"
        colour = text_colour_on(mesh.to_rgba(cosine[i, j]))
        ax.text(j + 0.5, i + 0.5, text, ha="center", va="center", fontsize=6.5, color=colour, gid=KEEP_COLOUR)
    labels = [as_drawn(diagnosis.problem.label(scores.candidates[k].effect_parameters.effect)) for k in candidates]
    ticks = np.arange(len(candidates)) + 0.5
    ax.set_xticks(ticks, labels, rotation=40, ha="right", rotation_mode="anchor")
    ax.set_yticks(ticks, labels)
    named = {effect.effect_parameters for effect in diagnosis.effects}
    for tick, k in zip((*ax.get_xticklabels(), *ax.get_yticklabels()), (*candidates, *candidates), strict=True):
        if scores.candidates[k].effect_parameters in named:
            tick.set_fontweight("bold")
    ax.set_aspect("equal")
    ax.invert_yaxis()
    ax.grid(False)
    ax.set_title("Similarity of the effects in this record")
    if colour_bar:
        root_figure(ax).colorbar(mesh, ax=ax, label="|cosine| (-); 1: indistinguishable")
    return ax


def size_by_window(diagnosis: Diagnosis, named: NamedEffect, *, ax: Axes | None = None) -> Axes:
    """Size of an effect with its 95 % interval, from each quarter of the record and from the entire record.

    Args:
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    size = named.effect_parameters.effect.parameters[0]
    value, std = named.values[size.name]
    windows = named.windows
    ax.axhspan(value - NORMAL_95 * std, value + NORMAL_95 * std, color=SKY, alpha=0.35, lw=0, label="entire record")
    ax.axhline(value, color=BLUE, lw=1.0)
    record = diagnosis.problem.record
    axis = TimeAxis(record.start)
    days, half = axis.at(windows.days), NORMAL_95 * windows.std
    ax.errorbar(days, windows.size, half, fmt="o", color=GREY, capsize=3, label="one quarter")
    ax.axhline(0.0, color=RED, ls="--", lw=1.0, label="no effect")
    axis.apply(ax)
    ax.set(
        ylabel=f"{size.name.replace('_', ' ')} ({format_unit(size.unit) or '-'})",
        xlim=tuple(axis.at(np.array([0.0, record.rows * record.step / DAY]))),
    )
    agreement = f"; {windows.informative_windows} of {len(windows.size)} quarters are informative"
    if windows.informative_windows > 1:
        agreement = f"; equal in all quarters: p = {windows.p_value:.2g}"
    ax.set_title(f"{as_drawn(diagnosis.problem.label(named.effect_parameters.effect))}, 95 %{agreement}", wrap=True)
    legend_above(ax)
    return ax


def _refused(diagnosis: Diagnosis) -> str:
    """Addition to the label of effects that the search refused; empty where it accepted them."""
    return ", refused" if diagnosis.incomplete else ""


def _wrapped(label: str, width: int = 16) -> str:
    """A label in lines of about `width` characters."""
    lines = [""]
    for word in label.replace(" of ", " of\N{NO-BREAK SPACE}").split(" "):  # keeps "of" and the target in one line
        if lines[-1] and len(lines[-1]) + len(word) > width:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return "\n".join(lines)


__all__ = [
    "cosine_similarity",
    "ranked_gains",
    "size_by_window",
    "waterfall",
    "waterfall_steps",
    "week_readings",
    "week_residuals",
    "worst_week",
]
