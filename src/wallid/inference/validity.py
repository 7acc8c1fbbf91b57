"""Whether an estimate is reliable, and why not; and the range of diffusivities that a window can distinguish."""

from __future__ import annotations

import math

import numpy as np
import scipy

from ..case.case_definition import Case
from ..case.time_window import Window
from .gls_fit import GLSFit
from .likelihood import LOG_CONDUCTIVITY
from .nuisance_parameters import describe_instrument_error
from .physical_bounds import HIGHEST, LOWEST

_MIN_SHARE, _MAX_SHARE = 0.01, 0.5  # bounds of the smallest detectable share of a step at a face
_MIN_RANGE = 100.0  # ratio of the bounds of a search, where a wall is too thick or too thin for its record
_MAX_PRIOR_RESIDUAL = 4.0  # prior standard deviations: an instrument error is hardly ever larger
_CONSTANCY_LEVEL = 0.01  # significance level of the test of a constant diffusivity
FAR_LARGER = 3.0
"""Noise found over noise stated, from which on the model is wrong, whatever else is found."""
_LARGER, _SMALLER = 1.4, 0.5  # noise found over noise stated; with true ones it is 0.7 to 1.3
_SETTLED = 0.5  # standard errors that the last round may change the diffusivity by
_REMEMBERED = 0.3  # share of autocorrelated noise in the variance, from which an excess is no noise of a sensor


def distinguishable_range(case: Case, window: Window) -> tuple[float, float]:
    """The range of diffusivities that a window can distinguish, m2/s.

    Lowest: during the window, a step at a face reaches the nearest sensor with a hundredth of its size, or with the
    size of a reading's noise, `erfc(d / (2 sqrt(alpha t))) = max(0.01, noise / range)`. Below it the readings depend on
    the initial profile only. With fluxes alone, the lowest is that at which the wall's time constant
    `L^2 / (pi^2 alpha)` equals the window: below it the heat stored at the start could explain any flux.

    Highest: the wall's delay behind its faces, `L^2 / (8 alpha)`, is a hundredth of the time between rows. Above it the
    inner temperatures follow the faces at once.

    Source: Carslaw and Jaeger, Conduction of Heat in Solids (1959), 2.4 and 3.5.
    """
    length, seconds = case.wall.length, case.record.step * window.rows
    lowest = length**2 / (math.pi**2 * seconds)
    present = np.isfinite(case.record.sensors[window.as_slice])
    if sensors := [sensor for sensor, mask in zip(case.sensors, present.T, strict=True) if mask.any()]:
        ranges = np.maximum(np.ptp(case.record.faces[window.as_slice], axis=0), 1e-300)
        lowest = min(
            _lowest_detectable(depth, seconds, float(np.clip(sensor.noise_std / change, _MIN_SHARE, _MAX_SHARE)))
            for sensor in sensors
            for depth, change in zip((sensor.position, length - sensor.position), ranges, strict=True)
        )
    highest = length**2 / (8.0 * _MIN_SHARE * case.record.step)
    lowest = min(max(LOWEST, lowest), HIGHEST / _MIN_RANGE)
    return lowest, max(min(HIGHEST, highest), lowest * _MIN_RANGE)


def _lowest_detectable(depth: float, seconds: float, share: float) -> float:
    """The diffusivity at which a step at a face reaches a depth with this share of its size, m2/s."""
    return depth**2 / (4.0 * float(scipy.special.erfcinv(share)) ** 2 * seconds)


def why_unreliable(
    case: Case,
    value: float,
    interval: tuple[float, float],
    singular: np.ndarray,
    converged: bool,
    bounds: tuple[float, float] = (LOWEST, HIGHEST),
) -> str:
    """Why the estimate is not reliable, or an empty string.

    Args:
        value, interval: the estimate and its 95 % interval, m2/s.
        singular: singular values of the whitened Jacobian.
        converged: whether the iteration has converged.
        bounds: of the search, m2/s.
    """
    if not np.isfinite(value) or not np.all(np.isfinite(singular)):
        return "the model's predictions are not finite"
    if not bounds[0] * 1.001 < value < bounds[1] / 1.001:
        return f"the estimate is at a bound of the search, {value:.3g} m2/s: the record does not determine it"
    if interval[0] <= bounds[0] * 1.001 or interval[1] >= bounds[1] / 1.001:
        return (
            f"its 95 % interval, {interval[0]:.3g} to {interval[1]:.3g} m2/s, reaches a bound of what this window "
            "can distinguish: the temperature variations are too small for their noise"
        )
    factor = interval[1] / interval[0]
    if factor > case.choices.largest_interval_factor:
        return (
            f"its 95 % interval spans a factor of {factor:.3g}, more than {case.choices.largest_interval_factor:g}: "
            "the temperature variations are too small for their noise"
        )
    if not converged:
        return "the iteration did not converge"
    return ""


def why_too_coarse(shift: float, noise_std_log: float) -> str:
    """Why the reduced-order model is not accurate enough, or an empty string.

    Args:
        shift: of ln(alpha) by the error of the reduced-order model.
        noise_std_log: standard error of ln(alpha) by the noise.
    """
    if abs(shift) <= noise_std_log:
        return ""
    return (
        f"the error of the reduced-order model shifts the estimate by {shift:+.1%}, more than the noise does; use a "
        'higher order, learning_diffusivities around the estimate, or model = "lom"'
    )


def why_weak_signal(case: Case, fit: GLSFit) -> str:
    """Why the temperature variations are too small for the stated accuracy of the sensors, or an empty string.

    A diffusivity larger by the largest factor `f` that an interval may span changes the readings of sensor s, apart
    from a constant, by `ln(f) ptp_t dT_s/d(ln alpha)`. If this is less than `offset_std` at every sensor, a small
    change of an offset within the window would have the same effect, and the interval does not include it.
    """
    offsets = fit.indices("sensor_offset")
    if LOG_CONDUCTIVITY in fit.parameters or len(offsets) < len(case.sensors) or not fit.finite:
        return ""
    factor, present = case.choices.largest_interval_factor, fit.noise_shape.counts.T > 0
    sensitivity = fit.readings_jacobian[:, 0].reshape(present.shape)
    ranges = [np.ptp(row[mask]) if mask.any() else 0.0 for row, mask in zip(sensitivity, present, strict=True)]
    change = math.log(factor) * np.array(ranges)
    stated = np.array([sensor.offset_std for sensor in case.sensors])
    if np.any(change >= stated):
        return ""
    best = int(np.argmax(change / stated))
    return (
        f"a diffusivity {factor:g} times as large would change {case.sensors[best].name} by {change[best]:.2g} K, less "
        f"than its stated offset_std of {stated[best]:g} K: a small change of the offset in the window would have the "
        "same effect; use a window with larger variations of the face temperatures, or compare the sensors with each "
        "other and state a smaller offset_std"
    )


def why_contradicted(case: Case, fit: GLSFit) -> str:
    """Why the readings contradict the stated accuracy of the instruments, or an empty string."""
    errors = fit.indices("sensor_offset", "sensor_position", "face_position")
    if not np.any(np.abs(fit.z[errors]) > _MAX_PRIOR_RESIDUAL):
        return ""
    largest = errors[int(np.argmax(np.abs(fit.z[errors])))]
    name, ratio = fit.names[largest], abs(float(fit.z[largest]))
    unit = fit.parameters.units[fit.parameters.index(name)]
    return (
        f"the {describe_instrument_error(name)} would be {float(fit.parameters[name]):+.3g} {unit}, {ratio:.2g} times "
        "its stated standard deviation: the wall differs from the model, or the stated value is too small; run wallid "
        "diagnose to search for missing effects"
    )


def what_to_do(case: Case) -> str:
    """What to do where an effect is missing from the model."""
    search = "run wallid diagnose to search for it"
    if case.section is None or case.section.is_homogeneous or case.choices.free:
        return search
    return f'{search}; check its regions and the sensors\' heights, or take [choices] free = "materials"'


def why_not_constant(case: Case, fit: GLSFit) -> str:
    """Why the diffusivity is not constant over the window, or an empty string.

    It is not tested beside a disturbance, which already says that the model does not explain the record.
    """
    if not fit.finite or fit.disturbance is not None or fit.constancy_p_value >= _CONSTANCY_LEVEL:
        return ""
    return (
        f"the diffusivity is not constant over the window (p = {fit.constancy_p_value:.1g}): an effect is missing from "
        f"the model; {what_to_do(case)}"
    )


def noise_ratio(fit: GLSFit) -> float:
    """Standard deviation of the noise found in the residual over the stated one; NaN where it was not estimated."""
    noise = fit.noise if fit.noise_estimated else fit.robust
    return math.nan if noise is None else math.sqrt(noise.white + noise.autocorrelated)


def _log_std_of_noise(fit: GLSFit) -> float:
    """Standard error of ln of the noise found: few rows with a long memory show its size badly.

        Var(ln s) = (1 + 2 sum_k r_k^2) / (2 n),      r_k = share rho^k

    Source: M. S. Bartlett, J. R. Stat. Soc. Suppl. 8 (1946), 27.
    """
    noise = fit.noise
    share = noise.autocorrelated / max(noise.white + noise.autocorrelated, 1e-300)
    memory = (share * noise.correlation) ** 2 / max(1.0 - noise.correlation**2, 1e-12)
    return math.sqrt((1.0 + 2.0 * memory) / (2.0 * max(noise.degrees_of_freedom, 1.0)))


def why_noisier(case: Case, fit: GLSFit) -> str:
    """Why the residual is more than the stated noise of the sensors, or an empty string.

    A residual that is autocorrelated and larger than stated is rather an effect that the model does not have. With
    heat flux it is not tested: there the weights are those of the stated noise.
    """
    ratio = noise_ratio(fit)
    if fit.robust is not None or not ratio * math.exp(-_log_std_of_noise(fit)) > _LARGER:
        return ""
    share = fit.noise.autocorrelated / (fit.noise.white + fit.noise.autocorrelated)
    if ratio < FAR_LARGER and share < _REMEMBERED:
        return ""
    remembered = f", {share:.0%} of its variance correlated from row to row" if share >= _REMEMBERED else ""
    return (
        f"the residual is {ratio:.2g} times the stated noise{remembered}: an effect is missing from the model, or the "
        f"stated noise_std is too small; {what_to_do(case)}"
    )


def settling_advice(fit: GLSFit) -> str:
    """That the last round still changed the diffusivity much; an empty string where it did not."""
    if not fit.finite or fit.change <= _SETTLED * fit.log_std:
        return ""
    return (
        f"the last of {fit.iterations} rounds with the noise found still changed the diffusivity by "
        f"{fit.change / fit.log_std:.2g} standard errors: take a longer window, which determines the noise better"
    )


def noise_advice(case: Case, fit: GLSFit) -> str:
    """Which stated noise to change, where the noise found is far from it without a sign of a missing effect."""
    ratio = noise_ratio(fit)
    far = ratio < _SMALLER or (ratio > _LARGER and not why_noisier(case, fit))
    if fit.robust is not None or not case.sensors or not far:
        return ""
    stated = sorted({sensor.noise_std for sensor in case.sensors})
    values = ", ".join(f"{value * ratio:.2g} instead of {value:g}" for value in stated)
    return f"the noise found is {ratio:.2g} times the stated one: state [[sensor]] noise_std = {values} (K)"
