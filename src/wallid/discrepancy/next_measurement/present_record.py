"""The record of a diagnosis, as several fits explain it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..._internal.units import DAY
from ...inference.likelihood import LOG_DIFFUSIVITY
from ..effect_fit import EffectFit
from ..effects.material import DiffusivityDrift
from ..effects.sensors import SensorDrift
from ..problem import DiagnosisProblem
from ..selection.acceptance import bic_penalty
from .separation import Explanation, Growth


@dataclass(frozen=True, eq=False)
class PresentRecord:
    """The record of a diagnosis, and what some fits predict for its readings.

    Args:
        fits: of one problem, with one noise.
    """

    fits: tuple[EffectFit, ...] = field(repr=False)

    @property
    def problem(self) -> DiagnosisProblem:
        """The case prepared for the search."""
        return self.fits[0].problem

    @property
    def whitening(self) -> np.ndarray:
        """W of the readings."""
        return self.fits[0].noise.whitening

    @property
    def days(self) -> float:
        """Length of the record, days."""
        return self.problem.record.span / DAY

    @property
    def diffusivity(self) -> float:
        """Of the wall, the median over the fits, m2/s."""
        return float(np.median([fit.diffusivity for fit in self.fits]))

    @cached_property
    def explanations(self) -> tuple[Explanation, ...]:
        """The readings by each fit."""
        return tuple(explanation_of(fit) for fit in self.fits)

    @cached_property
    def whitened_explanations(self) -> tuple[Explanation, ...]:
        """The same, whitened."""
        return tuple(one.whitened(self.whitening) for one in self.explanations)


def explanation_of(fit: EffectFit) -> Explanation:
    """The binned readings by a fit, linear about it."""
    parameters = fit.parameters
    mask = np.asarray(parameters.estimated)
    jacobian, _ = fit.unwhitened()
    return Explanation(
        parameters.estimated_names,
        fit.problem.binned(fit.predicted),
        jacobian,
        np.asarray(parameters.values)[mask],
        np.asarray(parameters.prior_std)[mask],
        bic_penalty(fit, fit.active),
        _growth(fit, jacobian),
    )


def _growth(fit: EffectFit, jacobian: np.ndarray) -> Growth | None:
    """What the drifts of a fit add from one length of the record to the next, to first order."""
    problem, growth = fit.problem, None
    days = problem.record.span / DAY
    for one in fit.active:
        rate, per_unit = one.names[0], None
        if isinstance(one.effect, SensorDrift):
            per_unit = np.repeat(
                np.arange(problem.instrument_count) == one.effect.sensor, len(jacobian) // problem.instrument_count
            )
        elif isinstance(one.effect, DiffusivityDrift):
            per_unit = jacobian[:, fit.index(LOG_DIFFUSIVITY)]
        if per_unit is None:
            continue
        column = np.zeros_like(jacobian)
        column[:, fit.index(rate)] = days * per_unit
        own = Growth(days * per_unit * float(fit.parameters[rate]), column)
        growth = own if growth is None else Growth(*(a + b for a, b in zip(growth, own, strict=True)))
    return growth
