"""Compare: how far the gap shrank, on days that were not used too, and whether a size is the same at all times."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from .._internal.units import DAY
from .effect_fit import Fit, refit, whiten_block, whiten_part
from .problem import DiagnosisProblem, EffectParameters

_BLOCKS = 9  # a third of them is held out
_LEAST = 0.2  # of the rows
_WINDOWS = 4
_BLIND = 100.0  # standard deviations of the whole record's size: a window as uncertain as this tells nothing
_OTHERS = 2.0  # how far what else is free may go in one window, in its standard deviations of the whole record


@dataclass(frozen=True)
class Gap:
    """Root mean squares of measured minus predicted, K.

    Args:
        before, after: of all rows used, by the plain and by the extended model.
        floor: what the noise alone would leave.
        held_out_before, held_out_after: of the rows held out, predicted with parameters found without them;
            None where the record is too short to hold a day out.
    """

    before: float
    after: float
    floor: float
    held_out_before: float | None
    held_out_after: float | None

    @property
    def left(self) -> float | None:
        """The share of the held-out excess over the floor that is left; None where there was none."""
        if self.held_out_before is None or self.held_out_after is None:
            return None
        before, after = (max(gap**2 - self.floor**2, 0.0) ** 0.5 for gap in (self.held_out_before, self.held_out_after))
        return after / before if before > 0 else None


def cross_validate(before: Fit, after: Fit) -> Gap:
    """The gap of two models, on all rows and on days held out."""
    held = held_out(after.study, after.events)
    if held is None:
        return Gap(before.gap, after.gap, after.noise.floor, None, None)
    outside_before = _gap_outside(before, held)
    outside_after = outside_before if after is before else _gap_outside(after, held)
    return Gap(before.gap, after.gap, after.noise.floor, outside_before, outside_after)


def held_out(study: DiagnosisProblem, events: Iterable[tuple[float, float]] = ()) -> np.ndarray | None:
    """Which rows are held out: every third block of whole days; None where the record has under three days.

    Args:
        events: when something happened once and how long it lasted, s. No other days tell of it, so those blocks are
            held out that see least of it.
    """
    time = study.record.time
    if study.record.duration + study.record.step < 3 * DAY:
        return None
    days = (time // DAY).astype(int)
    block = days // max(1, (days[-1] + 1) // _BLOCKS)
    seen = sum(np.where(time >= begin, np.exp(-np.maximum(time - begin, 0.0) / lasts), 0.0) for begin, lasts in events)
    thirds = [(block % 3 == third) & (block > 0) for third in (1, 2, 0)]  # the first hours are a free profile's
    return min((held for held in thirds if np.mean(held) >= _LEAST), key=lambda held: float(np.sum(held * seen)))


def _gap_outside(fit: Fit, held: np.ndarray) -> float:
    """Root mean square on the rows held out, with parameters found without them, K."""
    rest = _trained(fit, held).residual_at_rows[held]
    return float(np.sqrt(np.nanmean(rest**2)))


def _trained(fit: Fit, held: np.ndarray) -> Fit:
    """The same model found without the rows held out."""
    key = held.tobytes()
    if key not in fit.trained:
        used = ~_bins_with(fit.study, held)
        fit.trained[key] = refit(fit.study, fit.active, fit.theta, fit.noise, used=used)
    return fit.trained[key]


def cost_outside(fit: Fit, held: np.ndarray) -> float:
    """`-2 log L` of the rows held out, predicted with parameters found without them, up to what noise sets.

    With their pull on their priors: a position error of many standard deviations foretells days as well as the effect
    that it stands for, and is no rival to it for that.
    """
    study = fit.study
    trained = _trained(fit, held)
    binned = study.binned(trained.residual_at_rows)
    chosen = np.flatnonzero(_bins_with(study, held))
    return float(np.sum((whiten_part(fit.noise, chosen) @ binned) ** 2) + np.sum(trained.prior_residual**2))


def _bins_with(study: DiagnosisProblem, rows: np.ndarray) -> np.ndarray:
    """Which binned readings hold any of these rows."""
    size = study.bins.rows
    padded = np.pad(rows, (0, -len(rows) % size)).reshape(-1, size).any(axis=1)
    return np.tile(padded, study.sensors)


@dataclass(frozen=True)
class Windows:
    """An effect's size, window by window.

    Args:
        days: the middle of each window, from the record's start.
        size, std: in the effect's unit; NaN where a window tells nothing of it. p_value: of all being the same, 1 where
            fewer than two tell.
    """

    days: np.ndarray
    size: np.ndarray
    std: np.ndarray
    p_value: float

    @property
    def told(self) -> int:
        """How many windows tell something of the size."""
        return int(np.isfinite(self.size).sum())


def windows(fit: Fit, slot: EffectParameters) -> Windows:
    """The size of an effect found in each quarter of the record.

    To first order about the fit; what else is free may go twice its uncertainty from where the whole
    record puts it.
    """
    study, noise = fit.study, fit.noise
    place = fit.free.index(slot.first)
    bins = len(noise.whiten) // study.sensors
    J, r = fit.in_kelvin()
    prior = 1.0 / (_OTHERS * np.sqrt(np.diag(fit.covariance)))
    prior[place] = 0.0
    edges = np.linspace(0, bins, _WINDOWS + 1).astype(int)
    sizes, stds = [], []
    for first, last in pairwise(edges):
        used = np.tile((np.arange(bins) >= first) & (np.arange(bins) < last), study.sensors)
        chosen = np.flatnonzero(used)
        W = whiten_block(noise, chosen)
        system = np.concatenate([W @ J[chosen], np.diag(prior)])
        right = np.concatenate([W @ r[chosen], np.zeros(len(prior))])
        scale = np.maximum(np.linalg.norm(system, axis=0), 1e-300)
        inverse = np.linalg.pinv(system / scale, rcond=1e-12)
        sizes.append(fit.theta[slot.first] + (inverse @ right)[place] / scale[place])
        stds.append(np.linalg.norm(inverse[place]) / scale[place])
    size, std = np.array(sizes), np.array(stds)
    told = std < _BLIND * max(fit.std(slot.first), 1e-300)
    size, std = np.where(told, size, np.nan), np.where(told, std, np.nan)
    weight = np.where(told, 1.0 / np.where(told, std, 1.0) ** 2, 0.0)
    mean = np.nansum(weight * size) / max(weight.sum(), 1e-300)
    p = float(scipy.special.chdtrc(max(told.sum() - 1, 1), np.nansum(weight * (size - mean) ** 2)))
    days = 0.5 * (edges[1:] + edges[:-1]) * study.bins.rows * study.record.step / DAY
    return Windows(days, size, std, p)
