"""Figures of a model: its sensitivity to the diffusivity, and the error of reduced-order models."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from ..case.case_definition import Case
from ..models.flux_plates import fluxes_of, wall_conductance
from ..reduction.modal_identification import LearnedModel
from .house_style import BLUE, DAYS_LABEL, ORANGE, line_style
from .legends import legend_above, shortened
from .logged_record import downsampled


def sensitivity(ax: Axes, case: Case, days: np.ndarray, values: np.ndarray) -> None:
    """Sensitivity `dT/d(ln alpha)` at each sensor.

    Args:
        days: since the start of the record, `(time,)`.
        values: sensitivity, K, `(time, sensor)`.
    """
    for s, sensor in enumerate(case.sensors):
        ax.plot(*downsampled(days, values[:, s]), **line_style(s), lw=0.9, label=shortened(sensor.name))
    ax.set(xlabel=DAYS_LABEL, ylabel=r"$\partial T / \partial \ln \alpha$ (K)", title="Sensitivity to the diffusivity")
    legend_above(ax)


def flux_sensitivity(ax: Axes, case: Case, days: np.ndarray, values: np.ndarray) -> None:
    """Sensitivity `dq/d(ln alpha)` at each flux plate, for the conductivity that the design assumes.

    Args:
        days: since the start of the record, `(time,)`.
        values: sensitivity divided by the conductance, K, `(time, plate)`.
    """
    for p, face in enumerate(fluxes_of(case)):
        ax.plot(
            *downsampled(days, wall_conductance(case) * values[:, p]), **line_style(p), lw=0.9, label=f"{face} plate"
        )
    ax.set(
        xlabel=DAYS_LABEL,
        ylabel=r"$\partial q / \partial \ln \alpha$ (W/m²)",
        title="Sensitivity of the fluxes to the diffusivity",
    )
    legend_above(ax)


def error_by_order(ax: Axes, learned: Sequence[LearnedModel]) -> None:
    """Errors of reduced-order models over the training signals, against their order.

    Args:
        learned: models of several orders.
    """
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
