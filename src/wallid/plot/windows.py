"""Forest plots of a campaign: the interval of each window, and the interval from all windows together."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator, NullLocator, ScalarFormatter

from ..estimation.many_windows import CampaignEstimate
from ..estimation.pooled_mean import PooledMean
from ..estimation.result_objects import Estimate
from ..inference.quantity import Quantity
from .house_style import BLUE, GREY, ORANGE, axes_or_new
from .legends import legend_below

_RANGE = 10.0  # intervals are cut at this factor above and below the pooled value


def forest(campaign: CampaignEstimate, *, legend: bool = True, ax: Axes | None = None) -> Axes:
    """The 95 % interval of the diffusivity from each window and from all windows together.

    Grey intervals are not in the mean.

    Args:
        legend: False where the panel shares the legend of another.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    windows = [None if fit is None else _diffusivity(fit) for fit in campaign.fits]
    pooled = None if campaign.mean is None else _diffusivity(campaign)
    _intervals(ax, campaign, windows, pooled, campaign.mean)
    ax.set(xlabel="diffusivity (m²/s)", title="Diffusivity by window")
    if legend:
        legend_below(ax)
    return ax


def resistance_forest(campaign: CampaignEstimate, *, legend: bool = True, ax: Axes | None = None) -> Axes:
    """The 95 % interval of the thermal resistance from each window and from all windows together; see `forest`.

    Args:
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    windows = [None if fit is None or not fit.has_flux else _resistance(fit) for fit in campaign.fits]
    _intervals(ax, campaign, windows, _resistance(campaign), campaign.conductivity_mean)
    ax.set(xlabel="resistance (m² K/W)", title="Resistance by window")
    if legend:
        legend_below(ax)
    return ax


def _diffusivity(estimate: Estimate | CampaignEstimate) -> Quantity:
    return Quantity(estimate.value, estimate.std, estimate.interval_95, "m2/s")


def _resistance(estimate: Estimate | CampaignEstimate) -> Quantity | None:
    return None if estimate.thermal is None else estimate.thermal.resistance


def _intervals(
    ax: Axes,
    campaign: CampaignEstimate,
    windows: list[Quantity | None],
    pooled: Quantity | None,
    mean: PooledMean | None,
) -> None:
    """Draw a line for each window, thick where it is in the mean."""
    estimated = [(k, quantity) for k, quantity in enumerate(windows) if quantity is not None]
    median = float(np.median([quantity.value for _, quantity in estimated] or [1e-6]))
    middle = median if pooled is None else pooled.value
    low, high = middle / _RANGE, middle * _RANGE
    used = [k for k, _ in estimated if k in campaign.used]
    weights = {} if mean is None else dict(zip(used, mean.weights, strict=True))
    for k, quantity in estimated:
        colour = BLUE if k in weights else GREY
        ax.plot(np.clip(quantity.interval_95, low, high), [k, k], "-", color=colour, lw=2.2 if k in weights else 1.0)
        if low < quantity.value < high:
            ax.plot([quantity.value], [k], "o", ms=4 + 6 * abs(weights.get(k, 0.0)), color=colour)
    if pooled is not None:
        ax.axvspan(*pooled.interval_95, color=ORANGE, alpha=0.25, lw=0, label="all windows, 95 %")
        ax.axvline(pooled.value, color=ORANGE)
    ax.plot([], [], "o-", color=BLUE, label="informative window, 95 %")
    if len(weights) < len(windows):
        ax.plot([], [], "o-", color=GREY, label="uninformative window, 95 %")
    most_labels = ax.get_window_extent().height / ax.figure.dpi * 72.0 / (1.4 * float(ax.yaxis.label.get_fontsize()))
    labelled = range(0, len(campaign.labels), max(1, math.ceil(len(campaign.labels) / most_labels)))
    ax.set_yticks(list(labelled), [str(campaign.labels[k])[:10] for k in labelled])
    ax.invert_yaxis()
    ax.set(xscale="log", ylabel="start of the window")
    first, last = ax.get_xlim()
    if last < _RANGE * first:  # less than a decade: labels of powers of ten would overlap
        ax.xaxis.set_major_locator(MaxNLocator(5))
        ax.xaxis.set_major_formatter(ScalarFormatter())
        ax.xaxis.set_minor_locator(NullLocator())
