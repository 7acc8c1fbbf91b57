"""Figures of what a model leaves: over time, by hour of the day, by frequency, and the smooth part of it."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import Colormap
from matplotlib.ticker import MaxNLocator

from .._internal.units import DAY
from ..discrepancy.effect_fit import Fit
from ..discrepancy.findings import Diagnosis
from ..discrepancy.model_with_effects import impulses
from ..discrepancy.residual_tests import ResidualTests
from .house_style import DAYS, GREY, colour, line, marked_line, marks
from .legends import legend_above, legend_below, make_room, shortened

_CLIPPED = 98.0  # percentile of the residuals that the map's colours reach: single outliers would bleach it
_KOLMOGOROV_95 = 1.358


def residual_map(ax: Axes, fit: Fit, limit: float, title: str, *, colour_bar: bool = True) -> QuadMesh:
    """The remainder by sensor and time, blue where the model is too warm, grey where there is no reading.

    Args:
        limit: of the colours, K; see `colour_limit`. colour_bar: False where several maps share one.
    """
    make_room(ax)
    days = days_of(fit)
    step = fit.study.record.step / DAY
    names = names_of(fit)
    edges = np.append(days, days[-1] + step) - 0.5 * step
    mesh = ax.pcolormesh(
        edges, np.arange(len(names) + 1), fit.residual_at_rows.T, cmap=_warm_and_cold(), vmin=-limit, vmax=limit
    )
    ax.set(xlabel=DAYS, title=f"{title}: rms {short(fit.gap)} K")
    ax.set_yticks(np.arange(len(names)) + 0.5, names)
    ax.invert_yaxis()
    ax.grid(False)
    if colour_bar:
        shared_colour_bar(mesh, [ax])
    return mesh


def _warm_and_cold() -> Colormap:
    """Red where the wall is warmer than the model, blue where it is colder, grey where there is no reading."""
    return mpl.colormaps["RdBu_r"].with_extremes(bad="0.7")


def shared_colour_bar(mesh: QuadMesh, axes: Sequence[Axes]) -> None:
    """The colours of `residual_map`, beside the maps that share them."""
    made = axes[0].get_figure(root=True)
    assert made is not None
    made.colorbar(mesh, ax=list(axes), label="measured minus simulated (K)", extend="both", pad=0.01)


def colour_limit(explanation: Diagnosis) -> float:
    """The colours' common end for the maps before and after, K."""
    return float(np.nanpercentile(np.abs(explanation.before.residual_at_rows), _CLIPPED))


def hourly_residual(ax: Axes, fit: Fit, by_hour: np.ndarray, title: str, *, legend: bool = True) -> None:
    """The mean remainder by sensor and hour of the day.

    Args:
        by_hour: K, `(hour, sensor)`; NaN where no row falls. legend: False where another panel's tells.
    """
    hours = np.arange(24)
    for s, name in enumerate(names_of(fit)):
        seen = np.isfinite(by_hour[:, s])
        ax.plot(hours[seen] + 0.5, by_hour[seen, s], ms=3.5, label=name, **marked_line(s))
    ax.axhline(0.0, color=GREY, lw=0.8)
    ax.set(xlabel="hour of the day", ylabel="mean residual (K)", xlim=(0, 24), title=title)
    ax.set_xticks(range(0, 25, 6))
    if legend:
        legend_above(ax)
    make_room(ax)


def smooth_remainder(ax: Axes, fit: Fit, left: ResidualTests) -> None:
    """The part of a remainder that the omnibus tests saw, orthogonal to all that is free: where and when it sits.

    Beside it the mean of each day's remainder.
    """
    days = days_of(fit)
    middle = (np.arange(len(left.smooth)) + 0.5) * fit.study.bins.rows * fit.study.record.step / DAY
    number = days.astype(int)
    for s, name in enumerate(names_of(fit)):
        ax.plot(middle, left.smooth[:, s], lw=1.1, label=name, **line(s))
        for day in np.unique(number):
            some = fit.residual_at_rows[number == day, s]
            if np.isfinite(some).any():
                ax.plot(day + 0.5, np.nanmean(some), ".", ms=5, color=colour(s))
    ax.axhline(0.0, color=GREY, lw=0.8)
    ax.set(xlabel=DAYS, ylabel="smooth remainder (K)", title="What no effect explains (dots: means of days)")
    legend_above(ax)


def periodogram(values: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """The share of a series' variance below each frequency; missing values count as the mean.

    Args:
        step: s.

    Returns:
        Frequencies, 1/day, and shares.
    """
    there = np.isfinite(values)
    centred = np.where(there, values - np.mean(values[there]), 0.0) if there.any() else np.zeros(len(values))
    # without the constant, and without the last that an even length has at half weight
    power = np.abs(np.fft.rfft(centred)[1 : (len(values) + 1) // 2]) ** 2
    frequency = np.arange(1, len(power) + 1) / (len(values) * step) * DAY
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
    power = (noise.white + noise.autocorrelated * memory)[:, None] * (own**2 + faces)
    return np.cumsum(power, axis=0) / power.sum(axis=0)


def cumulative_periodogram(ax: Axes, fit: Fit, title: str, *, legend: bool = True) -> None:
    """The remainder's cumulative periodogram by sensor, with the band that white noise keeps to 95 times in 100.

    Noise that remembers, or that came in through the faces, leaves the band as well: dashed lines show what the
    fit's own noise model expects.

    Args:
        legend: False where another panel's tells.

    Source: M. S. Bartlett, An Introduction to Stochastic Processes (1955), 9.23.
    """
    step = fit.study.record.step
    frequency, expected = np.array([]), expected_shares(fit)
    for s, name in enumerate(names_of(fit)):
        frequency, share = periodogram(fit.residual_at_rows[:, s], step)
        some = max(1, len(frequency) // 12)  # the lines' kinds are taken: dashed is what the model expects
        ax.plot(frequency, share, ms=3.5, markevery=(s * some // 4, some), label=name, **marks(s))
        ax.plot(frequency, expected[:, s], "--", lw=0.9, color=colour(s))
    ax.plot([], [], "--", lw=0.9, color=GREY, label="noise as modelled")
    white = np.linspace(0.0, 1.0, len(frequency) + 1)
    freedom = max(len(frequency) - 1, 1)
    # Stephens' correction for few frequencies
    width = _KOLMOGOROV_95 / (np.sqrt(freedom) + 0.12 + 0.11 / np.sqrt(freedom))
    at = np.concatenate([[0.0], frequency])
    band = np.clip(white - width, 0, 1), np.clip(white + width, 0, 1)
    ax.fill_between(at, *band, color="0.5", alpha=0.25, lw=0, label="white noise, 95 %")
    ax.set(
        xlabel="frequency (1/day)", ylabel="share of the variance (-)", xlim=(0, at[-1]), ylim=(0, 1.02), title=title
    )
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    if legend:
        legend_below(ax)
    make_room(ax)


def names_of(fit: Fit) -> list[str]:
    """The sensors' names as a figure has room for them."""
    return [shortened(sensor.name) for sensor in fit.study.case.sensors]


def days_of(fit: Fit) -> np.ndarray:
    return fit.study.record.days


def short(value: float) -> str:
    return f"{value:.3g}"


__all__ = [
    "colour_limit",
    "cumulative_periodogram",
    "expected_shares",
    "hourly_residual",
    "periodogram",
    "residual_map",
    "shared_colour_bar",
    "smooth_remainder",
]
