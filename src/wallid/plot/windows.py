"""The figures of a campaign: every window's interval beside the one of all of them."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator, NullLocator, ScalarFormatter

from ..estimation.many_windows import CampaignEstimate
from ..estimation.pooled_mean import PooledMean
from ..estimation.result_objects import Estimate
from ..inference.quantity import Quantity
from .house_style import BLUE, GREY, ORANGE
from .legends import legend_below

_FAR = 10.0  # times the pooled value: intervals beyond are cut


def forest(ax: Axes, found: CampaignEstimate, *, legend: bool = True) -> None:
    """Each window's 95 % interval of the diffusivity, grey where it is not in the mean, with the pooled band."""
    windows = [None if fit is None else _diffusivity(fit) for fit in found.fits]
    pooled = None if found.mean is None else _diffusivity(found)
    _intervals(ax, found, windows, pooled, found.mean)
    ax.set(xlabel="diffusivity (m²/s)", title="Every window, and all of them")
    if legend:
        legend_below(ax)


def resistance_forest(ax: Axes, found: CampaignEstimate, *, legend: bool = True) -> None:
    """The same of the resistance that the fluxes of each window told, and those of all of them."""
    windows = [None if fit is None or not fit.has_flux else _resistance(fit) for fit in found.fits]
    _intervals(ax, found, windows, _resistance(found), found.conduction)
    ax.set(xlabel="resistance (m² K/W)", title="The resistance of every window, and of all of them")
    if legend:
        legend_below(ax)


def _diffusivity(found: Estimate | CampaignEstimate) -> Quantity:
    return Quantity(found.value, found.std, found.interval_95, "m2/s")


def _resistance(found: Estimate | CampaignEstimate) -> Quantity | None:
    return None if found.thermal is None else found.thermal.resistance


def _intervals(
    ax: Axes, found: CampaignEstimate, windows: list[Quantity | None], pooled: Quantity | None, mean: PooledMean | None
) -> None:
    """A line for each window, thick where it is in the mean; intervals far from the pooled value are cut."""
    told = [(k, one) for k, one in enumerate(windows) if one is not None]
    middle = pooled.value if pooled is not None else float(np.median([one.value for _, one in told] or [1e-6]))
    low, high = middle / _FAR, middle * _FAR
    weights = {} if mean is None else dict(zip([k for k, _ in told if k in found.used], mean.weights, strict=True))
    for k, one in told:
        tint = BLUE if k in weights else GREY
        ax.plot(np.clip(one.interval_95, low, high), [k, k], "-", color=tint, lw=2.2 if k in weights else 1.0)
        if low < one.value < high:
            ax.plot([one.value], [k], "o", ms=4 + 6 * abs(weights.get(k, 0.0)), color=tint)
    if pooled is not None:
        ax.axvspan(*pooled.interval_95, color=ORANGE, alpha=0.25, lw=0, label="all windows, 95 %")
        ax.axvline(pooled.value, color=ORANGE)
    ax.plot([], [], "o-", color=BLUE, label="informative, 95 %")
    if len(weights) < len(windows):
        ax.plot([], [], "o-", color=GREY, label="uninformative")
    room = ax.get_window_extent().height / ax.figure.dpi * 72.0 / (1.4 * float(ax.yaxis.label.get_fontsize()))
    shown = range(0, len(found.labels), max(1, math.ceil(len(found.labels) / room)))
    ax.set_yticks(list(shown), [str(found.labels[k])[:10] for k in shown])
    ax.invert_yaxis()
    ax.set(xscale="log", ylabel="window from")
    first, last = ax.get_xlim()
    if last < _FAR * first:  # less than a decade: its powers of ten would stand over one another
        ax.xaxis.set_major_locator(MaxNLocator(5))
        ax.xaxis.set_major_formatter(ScalarFormatter())
        ax.xaxis.set_minor_locator(NullLocator())
