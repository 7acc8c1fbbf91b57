"""Figures of a model: its sensitivity to the diffusivity, and the error of reduced-order models."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from ..case.case_definition import Case
from ..models.flux_plates import fluxes_of, wall_conductance
from ..reduction.modal_identification import LearnedModel
from .house_style import BLUE, ORANGE, axes_or_new, line_style
from .legends import legend_above, shortened
from .logged_record import downsampled
from .time_axis import TimeAxis


def sensitivity(case: Case, days: np.ndarray, values: np.ndarray, *, ax: Axes | None = None) -> Axes:
    """Sensitivity `dT/d(ln alpha)` at each sensor.

    Args:
        days: since the start of the record, `(time,)`.
        values: sensitivity, K, `(time, sensor)`.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    axis = TimeAxis(case.record.start)
    for s, sensor in enumerate(case.sensors):
        ax.plot(*downsampled(axis.at(days), values[:, s]), **line_style(s), lw=0.9, label=shortened(sensor.name))
    axis.apply(ax)
    ax.set(ylabel=r"$\partial T / \partial \ln \alpha$ (K)", title="Sensitivity to the diffusivity")
    legend_above(ax)
    return ax


def flux_sensitivity(case: Case, days: np.ndarray, values: np.ndarray, *, ax: Axes | None = None) -> Axes:
    """Sensitivity `dq/d(ln alpha)` at each flux plate, for the conductivity that the design assumes.

    Args:
        days: since the start of the record, `(time,)`.
        values: sensitivity divided by the conductance, K, `(time, plate)`.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    axis = TimeAxis(case.record.start)
    for p, face in enumerate(fluxes_of(case)):
        curve = downsampled(axis.at(days), wall_conductance(case) * values[:, p])
        ax.plot(*curve, **line_style(p), lw=0.9, label=f"{face} plate")
    axis.apply(ax)
    ax.set(
        ylabel=r"$\partial q / \partial \ln \alpha$ (W/m²)",
        title="Sensitivity of the fluxes to the diffusivity",
    )
    legend_above(ax)
    return ax


def error_by_order(learned: Sequence[LearnedModel], *, ax: Axes | None = None) -> Axes:
    """Errors of reduced-order models over the training signals, against their order.

    Args:
        learned: models of several orders.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    order = [model.system.order for model in learned]
    for k, (name, colour) in enumerate((("temperature", BLUE), ("sensitivity", ORANGE))):
        largest, rms = [model.eps_inf[k] for model in learned], [model.eps_2[k] for model in learned]
        ax.semilogy(order, largest, "o-", color=colour, label=f"{name}, largest")
        ax.semilogy(order, rms, "s--", color=colour, ms=4, label=f"{name}, root mean square")
    ax.set(
        xlabel="order of the reduced-order model",
        ylabel="dimensionless error (-)",
        title="Error of the reduced-order model",
    )
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    legend_above(ax)
    return ax
