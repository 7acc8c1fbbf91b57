"""Figures of a model: its sensitivity, and what a reduced one errs by at each order."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from ..case.case_definition import Case
from ..models.flux_plates import conductance_of, fluxes_of
from ..reduction.modal_identification import LearnedModel
from .house_style import BLUE, DAYS, ORANGE, line
from .legends import legend_above, shortened
from .logged_record import thinned


def theta(ax: Axes, case: Case, days: np.ndarray, sensitivity: np.ndarray) -> None:
    """The sensitivity dT/d ln(alpha) at each sensor."""
    for s, sensor in enumerate(case.sensors):
        ax.plot(*thinned(days, sensitivity[:, s]), **line(s), lw=0.9, label=shortened(sensor.name))
    ax.set(
        xlabel=DAYS,
        ylabel=r"$\partial T / \partial \ln \alpha$ (K)",
        title="Sensitivity to the diffusivity",
    )
    legend_above(ax)


def flux_theta(ax: Axes, case: Case, days: np.ndarray, sensitivity: np.ndarray) -> None:
    """The sensitivity dq/d ln(alpha) at each plate, W/m2, at the conductivity that a design takes."""
    for p, face in enumerate(fluxes_of(case)):
        ax.plot(*thinned(days, conductance_of(case) * sensitivity[:, p]), **line(p), lw=0.9, label=f"{face} plate")
    ax.set(
        xlabel=DAYS,
        ylabel=r"$\partial q / \partial \ln \alpha$ (W/m²)",
        title="Sensitivity of the fluxes to the diffusivity",
    )
    legend_above(ax)


def orders(ax: Axes, learned: Sequence[LearnedModel]) -> None:
    """Errors of the reduced model over its learning signals, against its order."""
    order = [one.system.order for one in learned]
    names = ((r"$u$", BLUE), (r"$\theta$", ORANGE))
    for k, (name, tint) in enumerate(names):
        ax.semilogy(order, [one.eps_inf[k] for one in learned], "o-", color=tint, label=rf"$\epsilon_\infty$ {name}")
        ax.semilogy(order, [one.eps_2[k] for one in learned], "s--", color=tint, ms=4, label=rf"$\epsilon_2$ {name}")
    ax.set(xlabel="order of the reduced model", ylabel="error (-)", title="Error against order")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    legend_above(ax)
