"""Figures of the residual of a model: over time, by hour of the day, by frequency, and its smooth part."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import Colormap
from matplotlib.ticker import MaxNLocator

from .._internal.number_formats import format_unit
from .._internal.units import DAY
from ..discrepancy.effect_fit import EffectFit
from ..discrepancy.model_with_effects import face_impulse_response
from ..discrepancy.problem import DiagnosisProblem
from ..discrepancy.residual_tests import ResidualTests
from ..discrepancy.result.diagnosis_result import Diagnosis
from ..models.flux_plates import face_noise_of_model, fluxes_of
from ..records.face_spectrum import autoregression_spectrum
from .house_style import GREY, axes_or_new, curve_style, line_style, marker_style, sensor_colour
from .legends import legend_above, legend_below, root_figure, shortened, use_constrained_layout
from .time_axis import TimeAxis

_CLIPPED = 98.0  # percentile of the absolute residual at the end of the colour scale, so that outliers do not set it
_LONG_UNIT = 6  # characters of a unit, from which the label of a colour bar takes two lines
_KOLMOGOROV_95 = 1.358  # 95 % quantile of the Kolmogorov distribution


def residual_scale(problem: DiagnosisProblem) -> tuple[np.ndarray, str]:
    """The factor of each instrument's residual in a figure, and the unit that all then have.

    Sensors and plates together are shown in standard deviations of their stated noise, either alone in its own unit.
    """
    count = problem.instrument_count
    if 0 < problem.sensor_count < count:
        return 1.0 / problem.noise_stds, "noise std"
    return np.ones(count), format_unit(problem.unit_of_gap)


def shown_residual(fit: EffectFit) -> np.ndarray:
    """The residual at the rows in the unit of `residual_scale`, `(time, instrument)`."""
    return fit.residual_at_rows * residual_scale(fit.problem)[0]


def residual_map(fit: EffectFit, limit: float, title: str, *, colour_bar: bool = True, ax: Axes | None = None) -> Axes:
    """The residual by instrument and time, blue where the model is too warm, grey where there is no reading.

    Args:
        limit: end of the colour scale; see `colour_limit`.
        title: of the panel; the root mean square is added.
        colour_bar: False where several maps share one.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    use_constrained_layout(ax)
    axis = TimeAxis(fit.problem.record.start)
    days = axis.at(fit.problem.record.days)
    step = fit.problem.record.step / DAY
    names = instrument_names(fit)
    edges = np.append(days, days[-1] + step) - 0.5 * step
    ax.pcolormesh(
        edges, np.arange(len(names) + 1), shown_residual(fit).T, cmap=_residual_colours(), vmin=-limit, vmax=limit
    )
    axis.apply(ax)
    ax.set(title=f"{title}: rms {fit.gap:.3g} {format_unit(fit.problem.unit_of_gap)}")
    ax.set_yticks(np.arange(len(names)) + 0.5, names)
    ax.invert_yaxis()
    ax.grid(False)
    if colour_bar:
        shared_colour_bar([ax], residual_scale(fit.problem)[1])
    return ax


def _residual_colours() -> Colormap:
    """Red where the wall is warmer than the model, blue where it is colder, grey where there is no reading."""
    return mpl.colormaps["RdBu_r"].with_extremes(bad="0.7")


def shared_colour_bar(axes: Sequence[Axes], unit: str = "K") -> None:
    """Draw the colour bar of one or several `residual_map` panels beside them; `unit` is that of `residual_scale`."""
    (mesh,) = (artist for artist in axes[0].collections if isinstance(artist, QuadMesh))
    separator = " " if len(unit) < _LONG_UNIT else "\n"
    label = f"measured minus simulated{separator}({unit})"
    root_figure(axes[0]).colorbar(mesh, ax=list(axes), label=label, extend="both", pad=0.01)


def colour_limit(diagnosis: Diagnosis) -> float:
    """End of the colour scale for the residual maps without and with effects, in the unit of `residual_scale`."""
    return float(np.nanpercentile(np.abs(shown_residual(diagnosis.before)), _CLIPPED))


def hourly_residual(
    fit: EffectFit, by_hour: np.ndarray, title: str, *, legend: bool = True, ax: Axes | None = None
) -> Axes:
    """The mean residual by instrument and hour of the day.

    Args:
        by_hour: mean residual, K (W/m2 of a plate), `(hour, instrument)`; NaN where there is no reading.
        legend: False where the panel shares the legend of another.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    hours, (scale, unit) = np.arange(24), residual_scale(fit.problem)
    by_hour = by_hour * scale
    for s, name in enumerate(instrument_names(fit)):
        present = np.isfinite(by_hour[:, s])
        ax.plot(hours[present] + 0.5, by_hour[present, s], ms=3.5, label=name, **curve_style(s))
    ax.axhline(0.0, color=GREY, lw=0.8)
    ax.set(xlabel="hour of the day", ylabel=f"mean residual ({unit})", xlim=(0, 24), title=title)
    ax.set_xticks(range(0, 25, 6))
    if legend:
        legend_above(ax)
    use_constrained_layout(ax)
    return ax


def smooth_residual(fit: EffectFit, tests: ResidualTests, *, ax: Axes | None = None) -> Axes:
    """The smooth part of the residual that the omnibus test examines, and the mean residual of each day.

    The smooth part is orthogonal to the Jacobian of all estimated and nuisance parameters.

    Args:
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.
    """
    ax = axes_or_new(ax)
    record = fit.problem.record
    axis, days_per_bin = TimeAxis(record.start), fit.problem.bins.rows_per_bin * record.step / DAY
    middle = axis.at((np.arange(len(tests.smooth_residual)) + 0.5) * days_per_bin)
    day_of_row, (scale, unit) = record.days.astype(int), residual_scale(fit.problem)
    shown = shown_residual(fit)
    for s, name in enumerate(instrument_names(fit)):
        ax.plot(middle, scale[s] * tests.smooth_residual[:, s], lw=1.1, label=name, **line_style(s))
        for day in np.unique(day_of_row):
            residual = shown[day_of_row == day, s]
            if np.isfinite(residual).any():
                ax.plot(axis.at(day + 0.5), np.nanmean(residual), ".", ms=5, color=sensor_colour(s))
    ax.axhline(0.0, color=GREY, lw=0.8)
    axis.apply(ax)
    ax.set(ylabel=f"smooth residual ({unit})", title="Unexplained smooth residual (dots: daily means)")
    legend_above(ax)
    return ax


def cumulative_power(values: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Normalised cumulative periodogram of a series: the share of its variance below each frequency.

    Missing values are replaced by the mean.

    Args:
        values: `(time,)`, NaN where missing.
        step: of the series, s.

    Returns:
        Frequencies, 1/day, and shares, both `(frequency,)`.
    """
    present = np.isfinite(values)
    centred = np.where(present, values - np.mean(values[present]), 0.0) if present.any() else np.zeros(len(values))
    # without the mean, and without the Nyquist frequency of an even length, which has half the weight
    power = np.abs(np.fft.rfft(centred)[1 : (len(values) + 1) // 2]) ** 2
    frequency = np.arange(1, len(power) + 1) / (len(values) * step) * DAY
    total = power.sum()
    return frequency, np.cumsum(power) / total if total > 0 else np.linspace(0.0, 1.0, len(power))


def expected_cumulative_power(fit: EffectFit) -> np.ndarray:
    """Share of the variance of the modelled noise below each frequency of `cumulative_power`, by instrument.

    The power density is `(white + autocorrelated S(omega)) (noise_std^2 + N(omega) |H(omega)|^2)
    + V(omega) |H(omega)|^2`. `S` is the spectrum of an AR(1) process, `H` the frequency response of an instrument to
    the boundary temperatures, `N` the spectrum of their white noise in the model, and `V` that of their errors between
    rows, random and with one share in all rows.

    Returns:
        Shares, `(frequency, instrument)`.
    """
    problem, noise = fit.problem, fit.noise
    rows = problem.record.rows
    face_noise, face_errors = face_noise_of_model(problem.case)
    sizes = noise.white, noise.autocorrelated, noise.correlation
    response = np.fft.rfft(face_impulse_response(problem.model, fit.parameters), axis=1)[:, 1 : (rows + 1) // 2]
    omega = 2 * np.pi * np.arange(1, response.shape[1] + 1) / rows
    spectrum = autoregression_spectrum(noise.correlation, omega)
    gain = np.abs(response) ** 2
    face_variance = np.einsum("fw,fws->ws", _spectra(face_noise.limited(*sizes), omega), gain)
    power = (noise.white + noise.autocorrelated * spectrum)[:, None] * (problem.noise_stds**2 + face_variance)
    shared = face_errors.shared_errors(problem.record.faces, problem.record.step)
    of_shared = (np.abs(np.fft.rfft(shared, axis=-1)[..., 1 : (rows + 1) // 2]) ** 2).sum(axis=0) / rows
    power += np.einsum("fw,fws->ws", _spectra(face_errors.autocovariance, omega) + of_shared, gain)
    return np.cumsum(power, axis=0) / power.sum(axis=0)


def _spectra(autocovariance: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """The spectrum of each process, `(process, frequency)`, from its autocovariance by lag in rows."""
    lags = np.arange(1, autocovariance.shape[1])
    power = autocovariance[:, :1] + 2.0 * autocovariance[:, 1:] @ np.cos(np.outer(lags, omega))
    return np.maximum(power, 0.0)


def cumulative_periodogram(fit: EffectFit, title: str, *, legend: bool = True, ax: Axes | None = None) -> Axes:
    """Normalised cumulative periodogram of the residual by instrument, with the 95 % band of white noise.

    Autocorrelated noise, and noise of the boundary temperatures, also leave the band: the dashed lines are the
    expected periodograms of the fitted noise model.

    Args:
        legend: False where the panel shares the legend of another.
        ax: to draw on; None for a new figure.

    Returns:
        The Axes.

    Source: M. S. Bartlett, An Introduction to Stochastic Processes (1955), 9.23.
    """
    ax = axes_or_new(ax)
    step = fit.problem.record.step
    frequency, expected = np.array([]), expected_cumulative_power(fit)
    for s, name in enumerate(instrument_names(fit)):
        frequency, share = cumulative_power(fit.residual_at_rows[:, s], step)
        spacing = max(1, len(frequency) // 12)
        ax.plot(frequency, share, ms=3.5, markevery=(s * spacing // 4, spacing), label=name, **marker_style(s))
        ax.plot(frequency, expected[:, s], "--", lw=0.9, color=sensor_colour(s))
    ax.plot([], [], "--", lw=0.9, color=GREY, label="fitted noise model")
    white = np.linspace(0.0, 1.0, len(frequency) + 1)
    root = np.sqrt(max(len(frequency) - 1, 1))
    width = _KOLMOGOROV_95 / (root + 0.12 + 0.11 / root)  # with the correction of Stephens (1970) for few frequencies
    abscissa = np.concatenate([[0.0], frequency])
    band = np.clip(white - width, 0, 1), np.clip(white + width, 0, 1)
    ax.fill_between(abscissa, *band, color="0.5", alpha=0.25, lw=0, label="white noise, 95 %")
    ax.set(
        xlabel="frequency (1/day)",
        ylabel="share of the variance (-)",
        xlim=(0, abscissa[-1]),
        ylim=(0, 1.02),
        title=title,
    )
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    if legend:
        legend_below(ax)
    use_constrained_layout(ax)
    return ax


def instrument_names(fit: EffectFit) -> list[str]:
    """Names of the sensors, long ones shortened, and of the plates."""
    plates = [f"{face} plate" for face in fluxes_of(fit.problem.case)]
    return [*(shortened(sensor.name) for sensor in fit.problem.case.sensors), *plates]


__all__ = [
    "colour_limit",
    "cumulative_periodogram",
    "cumulative_power",
    "expected_cumulative_power",
    "hourly_residual",
    "residual_map",
    "residual_scale",
    "shared_colour_bar",
    "smooth_residual",
]
