"""Figures of what a model leaves: over time, by hour of the day, by frequency, and the smooth part of it."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.ticker import MaxNLocator

from ._style import DAYS, GREY, colour
from .discrepancy import Explanation
from .discrepancy.extend import Fit
from .discrepancy.locate import Remainder
from .discrepancy.model import impulses

_DAY = 86400.0
_CLIPPED = 98.0  # percentile of the residuals that the map's colours reach: single outliers would bleach it
_KOLMOGOROV_95 = 1.358


def residual_map(ax: Axes, fit: Fit, limit: float, title: str) -> QuadMesh:
    """The remainder by sensor and time, blue where the model is too warm.

    Arguments:
        limit: of the colours, K; see `colour_limit`.
    """
    days = days_of(fit)
    step = fit.study.record.step / _DAY
    names = names_of(fit)
    edges = np.append(days, days[-1] + step) - 0.5 * step
    mesh = ax.pcolormesh(
        edges, np.arange(len(names) + 1), fit.remainder.T, cmap="RdBu_r", vmin=-limit, vmax=limit, rasterized=True
    )
    ax.set_facecolor("0.8")  # missing readings: neither warm nor cold
    ax.set(xlabel=DAYS, title=f"{title}: rms {short(fit.gap)} K")
    ax.set_yticks(np.arange(len(names)) + 0.5, names)
    ax.invert_yaxis()
    ax.grid(False)
    return mesh


def colour_limit(explanation: Explanation) -> float:
    """The colours' common end for the maps before and after, K."""
    return float(np.nanpercentile(np.abs(explanation.before.remainder), _CLIPPED))


def hourly_residual(ax: Axes, fit: Fit, by_hour: np.ndarray, title: str) -> None:
    """The mean remainder by sensor and hour of the day.

    Arguments:
        by_hour: K, `(hour, sensor)`; NaN where no row falls.
    """
    hours = np.arange(24)
    for s, name in enumerate(names_of(fit)):
        seen = np.isfinite(by_hour[:, s])
        ax.plot(hours[seen] + 0.5, by_hour[seen, s], ".-", color=colour(s), label=name)
    ax.axhline(0.0, color=GREY, lw=0.8)
    ax.set(xlabel="hour of the day", ylabel="mean residual (K)", xlim=(0, 24), title=title)
    ax.set_xticks(range(0, 25, 6))


def smooth_remainder(ax: Axes, fit: Fit, left: Remainder) -> None:
    """The part of a remainder that the omnibus tests saw, orthogonal to all that is free: where and when it sits.

    Beside it the mean of each day's remainder.
    """
    days = days_of(fit)
    middle = (np.arange(len(left.smooth)) + 0.5) * fit.study.bins.rows * fit.study.record.step / _DAY
    number = days.astype(int)
    for s, name in enumerate(names_of(fit)):
        ax.plot(middle, left.smooth[:, s], color=colour(s), lw=1.1, label=name)
        for day in np.unique(number):
            some = fit.remainder[number == day, s]
            if np.isfinite(some).any():
                ax.plot(day + 0.5, np.nanmean(some), ".", color=colour(s), ms=5)
    ax.axhline(0.0, color=GREY, lw=0.8)
    ax.set(xlabel=DAYS, ylabel="smooth remainder (K)", title="What no effect explains (dots: means of days)")
    ax.legend(ncols=6)


def periodogram(values: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """The share of a series' variance below each frequency; missing values count as the mean.

    Arguments:
        step: s.

    Returns:
        Frequencies, 1/day, and shares.
    """
    there = np.isfinite(values)
    centred = np.where(there, values - np.mean(values[there]), 0.0) if there.any() else np.zeros(len(values))
    # without the constant, and without the last that an even length has at half weight
    power = np.abs(np.fft.rfft(centred)[1 : (len(values) + 1) // 2]) ** 2
    frequency = np.arange(1, len(power) + 1) / (len(values) * step) * _DAY
    total = power.sum()
    return frequency, np.cumsum(power) / total if total > 0 else np.linspace(0.0, 1.0, len(power))


def expected_shares(fit: Fit) -> np.ndarray:
    """The share of the noise's variance below each of `periodogram`'s frequencies, as a fit models it, by sensor.

    (white + lasting AR(rho)) times (the sensor's variance + the faces' through the wall), as in `noise`.
    """
    study, noise = fit.study, fit.noise
    rows = study.record.rows
    own = np.array([sensor.noise_std for sensor in study.case.sensors])
    through = np.fft.rfft(impulses(study.model, fit.theta), axis=1)[:, 1 : (rows + 1) // 2]
    omega = 2 * np.pi * np.arange(1, through.shape[1] + 1) / rows
    rho = noise.correlation
    memory = (1 - rho**2) / (1 - 2 * rho * np.cos(omega) + rho**2)
    faces = study.record.boundary_noise_std**2 * (np.abs(through) ** 2).sum(axis=0)
    power = (noise.white + noise.lasting * memory)[:, None] * (own**2 + faces)
    return np.cumsum(power, axis=0) / power.sum(axis=0)


def cumulative_periodogram(ax: Axes, fit: Fit, title: str) -> None:
    """The remainder's cumulative periodogram by sensor, with the band that white noise keeps to 95 times in 100.

    Noise that remembers, or that came in through the faces, leaves the band as well: dashed lines show what the
    fit's own noise model expects.

    Source: M. S. Bartlett, An Introduction to Stochastic Processes (1955), 9.23.
    """
    step = fit.study.record.step
    frequency, expected = np.array([]), expected_shares(fit)
    for s, name in enumerate(names_of(fit)):
        frequency, share = periodogram(fit.remainder[:, s], step)
        ax.plot(frequency, share, color=colour(s), label=name)
        ax.plot(frequency, expected[:, s], "--", lw=0.9, color=colour(s))
    ax.plot([], [], "--", lw=0.9, color=GREY, label="noise as modelled")
    white = np.linspace(0.0, 1.0, len(frequency) + 1)
    freedom = max(len(frequency) - 1, 1)
    # Stephens' correction for few frequencies
    width = _KOLMOGOROV_95 / (np.sqrt(freedom) + 0.12 + 0.11 / np.sqrt(freedom))
    at = np.concatenate([[0.0], frequency])
    ax.fill_between(
        at, np.clip(white - width, 0, 1), np.clip(white + width, 0, 1), color="0.85", lw=0, label="white noise, 95 %"
    )
    ax.set(
        xlabel="frequency (1/day)", ylabel="share of the variance (-)", xlim=(0, at[-1]), ylim=(0, 1.02), title=title
    )
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))


def names_of(fit: Fit) -> list[str]:
    return [sensor.name for sensor in fit.study.case.sensors]


def days_of(fit: Fit) -> np.ndarray:
    return np.asarray(fit.study.record.time) / _DAY


def short(value: float) -> str:
    return f"{value:.3g}"


__all__ = [
    "colour_limit",
    "cumulative_periodogram",
    "expected_shares",
    "hourly_residual",
    "periodogram",
    "residual_map",
    "smooth_remainder",
]
