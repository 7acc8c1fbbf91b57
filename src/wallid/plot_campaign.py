"""The figure of a campaign: every window's interval beside the one of all of them."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes

from ._legend import legend_below
from ._style import BLUE, GREY, ORANGE
from .campaign import Pooled

_FAR = 10.0  # times the pooled value: intervals beyond are cut


def forest(ax: Axes, found: Pooled) -> None:
    """Each window's 95 % interval, grey where it is not in the mean, with the pooled band."""
    fits = [(k, fit) for k, fit in enumerate(found.fits) if fit is not None]
    middle = found.value if found.mean is not None else float(np.median([fit.value for _, fit in fits] or [1e-6]))
    low, high = middle / _FAR, middle * _FAR
    for k, fit in fits:
        ends = np.clip(fit.interval_95, low, high)
        tint = BLUE if k in found.used else GREY
        ax.plot(ends, [k, k], "-", color=tint, lw=2.2 if k in found.used else 1.0)
        if low < fit.value < high:
            ax.plot([fit.value], [k], "o", ms=4 + 6 * abs(found.weight(k)), color=tint)
    if found.mean is not None:
        ax.axvspan(*found.interval_95, color=ORANGE, alpha=0.25, lw=0, label="all windows, 95 %")
        ax.axvline(found.value, color=ORANGE)
    ax.plot([], [], "o-", color=BLUE, label="informative, 95 %")
    if len(found.used) < len(found.fits):
        ax.plot([], [], "o-", color=GREY, label="uninformative")
    room = ax.get_window_extent().height / ax.figure.dpi * 72.0 / (1.4 * float(ax.yaxis.label.get_fontsize()))
    shown = range(0, len(found.labels), max(1, math.ceil(len(found.labels) / room)))
    ax.set_yticks(list(shown), [str(found.labels[k])[:10] for k in shown])
    ax.invert_yaxis()
    ax.set(xscale="log", xlabel="diffusivity (m²/s)", ylabel="window from", title="Every window, and all of them")
    legend_below(ax)
