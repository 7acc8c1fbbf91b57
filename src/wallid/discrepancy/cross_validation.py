"""Cross-validation of two models on days held out, and the size of an effect in each quarter of the record."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from .._internal.units import DAY
from .effect_fit import EffectFit, refit, rms_over, whitening_block, whitening_of_subset
from .problem import DiagnosisProblem, EffectParameters

_BLOCKS = 9  # of whole days, of which a third is held out
_MIN_HELD_OUT = 0.2  # share of the rows
_WINDOWS = 4
_MAX_STD_RATIO = 100.0  # std of a size in a window over that in the entire record, from which it is not informative
_PRIOR_RATIO = 2.0  # prior std of the other parameters in a window over their std in the entire record


@dataclass(frozen=True)
class Gap:
    """Root mean squares of measured minus predicted: over the inner sensors, or over the plates without a sensor.

    Args:
        before: of the plain model, all rows used.
        after: of the model with effects, all rows used.
        noise_floor: expected of the noise alone.
        held_out_before: of the plain model on the rows held out, with parameters fitted without them; None where the
            record is too short to hold out a day.
        held_out_after: the same of the model with effects.
        unit: K of sensors, W/m2 of plates.
    """

    before: float
    after: float
    noise_floor: float
    held_out_before: float | None
    held_out_after: float | None
    unit: str = "K"

    @property
    def remaining_share(self) -> float | None:
        """Share of the held-out error above the noise that remains with the effects; None where there was none."""
        if self.held_out_before is None or self.held_out_after is None:
            return None
        before, after = (
            max(rms**2 - self.noise_floor**2, 0.0) ** 0.5 for rms in (self.held_out_before, self.held_out_after)
        )
        return after / before if before > 0 else None


def cross_validate(before: EffectFit, after: EffectFit) -> Gap:
    """The gaps of two models, on all rows and on days held out.

    Args:
        before: fit of the plain model.
        after: fit of the model with effects.
    """
    rows, floor, unit = held_out(after.problem, after.events), after.noise_floor, after.problem.unit_of_gap
    if rows is None:
        return Gap(before.gap, after.gap, floor, None, None, unit)
    held_out_before = _held_out_gap(before, rows)
    held_out_after = held_out_before if after is before else _held_out_gap(after, rows)
    return Gap(before.gap, after.gap, floor, held_out_before, held_out_after, unit)


def held_out(problem: DiagnosisProblem, events: Iterable[tuple[float, float]] = ()) -> np.ndarray | None:
    """Mask of the rows held out: every third block of whole days; None where the record has under three days.

    Args:
        problem: the case prepared for the search.
        events: start and duration of each single event, s. Only the days after an event are informative about it, so
            the blocks least affected are held out.
    """
    time = problem.record.time
    if problem.record.span < 3 * DAY:
        return None
    days = (time // DAY).astype(int)
    block = days // max(1, (days[-1] + 1) // _BLOCKS)
    affected = sum(np.where(time >= t0, np.exp(-np.maximum(time - t0, 0.0) / duration), 0.0) for t0, duration in events)
    # never the first block, which determines the initial profile
    thirds = [(block % 3 == third) & (block > 0) for third in (1, 2, 0)]
    large_enough = [rows for rows in thirds if np.mean(rows) >= _MIN_HELD_OUT]
    return min(large_enough, key=lambda rows: float(np.sum(rows * affected)))


def _held_out_gap(fit: EffectFit, rows: np.ndarray) -> float:
    """Root mean square on the rows held out, with parameters fitted without them, as `rms_over`."""
    return rms_over(fit.problem, _training_fit(fit, rows).residual_at_rows[rows])


def _training_fit(fit: EffectFit, rows: np.ndarray) -> EffectFit:
    """The same model fitted without the rows held out; computed once."""
    key = rows.tobytes()
    if key not in fit.training_fits:
        used = ~_bins_with(fit.problem, rows)
        fit.training_fits[key] = refit(fit.problem, fit.active, fit.parameters, fit.noise, used=used)
    return fit.training_fits[key]


def held_out_cost(fit: EffectFit, rows: np.ndarray) -> float:
    """`-2 log L` of the rows held out with parameters fitted without them, plus the squared prior residuals.

    The priors count because a position error of many standard deviations predicts the held-out days as well as the
    effect that it replaces.
    """
    problem = fit.problem
    training_fit = _training_fit(fit, rows)
    binned = problem.binned(training_fit.residual_at_rows)
    chosen = np.flatnonzero(_bins_with(problem, rows))
    return float(
        np.sum((whitening_of_subset(fit.noise, chosen) @ binned) ** 2) + np.sum(training_fit.prior_residual**2)
    )


def _bins_with(problem: DiagnosisProblem, rows: np.ndarray) -> np.ndarray:
    """Mask of the binned readings that contain any of these rows."""
    size = problem.bins.rows_per_bin
    padded = np.pad(rows, (0, -len(rows) % size)).reshape(-1, size).any(axis=1)
    return np.tile(padded, problem.instrument_count)


@dataclass(frozen=True)
class EffectByWindow:
    """The size of an effect in each window of the record.

    Args:
        days: middle of each window, days from the start of the record, `(window,)`.
        size: in the unit of the effect, `(window,)`; NaN where a window is not informative.
        std: standard deviation of the size, `(window,)`; NaN likewise.
        p_value: chi-square test of equal sizes; 1 where fewer than two windows are informative.
    """

    days: np.ndarray
    size: np.ndarray
    std: np.ndarray
    p_value: float

    @property
    def informative_windows(self) -> int:
        """Number of windows that are informative about the size."""
        return int(np.isfinite(self.size).sum())


def effect_by_window(fit: EffectFit, effect_parameters: EffectParameters) -> EffectByWindow:
    """The size of an effect in each quarter of the record, to first order about the fit.

    The other estimated parameters have priors: their values and twice their uncertainty from the entire record.
    """
    problem, noise = fit.problem, fit.noise
    size_name = effect_parameters.names[0]
    k = fit.index(size_name)
    bins = len(noise.whitening) // problem.instrument_count
    J, r = fit.unwhitened()
    prior = 1.0 / (_PRIOR_RATIO * np.sqrt(np.diag(fit.covariance)))
    prior[k] = 0.0
    edges = np.linspace(0, bins, _WINDOWS + 1).astype(int)
    sizes, stds = [], []
    for first, last in pairwise(edges):
        used = np.tile((np.arange(bins) >= first) & (np.arange(bins) < last), problem.instrument_count)
        chosen = np.flatnonzero(used)
        W = whitening_block(noise, chosen)
        system = np.concatenate([W @ J[chosen], np.diag(prior)])
        right = np.concatenate([W @ r[chosen], np.zeros(len(prior))])
        scale = np.maximum(np.linalg.norm(system, axis=0), 1e-300)
        inverse = np.linalg.pinv(system / scale, rcond=1e-12)
        sizes.append(float(fit.parameters[size_name]) + (inverse @ right)[k] / scale[k])
        stds.append(np.linalg.norm(inverse[k]) / scale[k])
    size, std = np.array(sizes), np.array(stds)
    informative = std < _MAX_STD_RATIO * max(fit.std(size_name), 1e-300)
    size, std = np.where(informative, size, np.nan), np.where(informative, std, np.nan)
    weight = np.where(informative, 1.0 / np.where(informative, np.maximum(std, 1e-150), 1.0) ** 2, 0.0)
    mean = np.nansum(weight * size) / max(weight.sum(), 1e-300)
    p = float(scipy.special.chdtrc(max(informative.sum() - 1, 1), np.nansum(weight * (size - mean) ** 2)))
    days = 0.5 * (edges[1:] + edges[:-1]) * problem.bins.rows_per_bin * problem.record.step / DAY
    return EffectByWindow(days, size, std, p)
