"""Whether an estimate is a number to rely on, and why it is not; and what a window can tell at all."""

from __future__ import annotations

import math

import numpy as np
import scipy

from ..case.case_definition import Case
from ..case.time_window import Window
from .gls_fit import GLSFit
from .likelihood import HIGHEST, LOWEST
from .nuisance_parameters import instrument_errors_of

_TOLD, _MOST_TOLD = 0.01, 0.5  # share of a face's change: what is told of it, at the least and at the most
_STRAINED = 4.0  # prior standard deviations: an offset or a place hardly ever is that far from what the case states
_UNSTEADY = 0.01  # how often chance may call a steady diffusivity unsteady


def distinguishable_range(case: Case, window: Window) -> tuple[float, float]:
    """Between which diffusivities a window can tell one from another, m2/s.

    Below the lowest, of what a face does in the whole window no more than a hundredth, or than a reading's noise, comes
    as far as the nearest sensor, `erfc(d / (2 sqrt(alpha t))) = max(0.01, noise / range)`: what it reads is the initial
    profile. Above the highest, the wall's delay behind its faces, `L^2 / (8 alpha)`, is less than a hundredth of a row:
    it reads what they read. With fluxes alone, the wall's memory `L^2 / (pi^2 alpha)` must not be longer than the
    window: what heat it holds at the start could explain any flux.

    Source: Carslaw and Jaeger, Conduction of Heat in Solids (1959), 2.4 and 3.5.
    """
    length, seconds = case.wall.length, case.record.step * window.rows
    lowest = length**2 / (math.pi**2 * seconds)
    reading = np.isfinite(case.record.sensors[window.part])
    if sensors := [sensor for sensor, there in zip(case.sensors, reading.T, strict=True) if there.any()]:
        moved = np.maximum(np.ptp(case.record.faces[window.part], axis=0), 1e-300)
        lowest = min(
            _slowest(where, seconds, float(np.clip(sensor.noise_std / change, _TOLD, _MOST_TOLD)))
            for sensor in sensors
            for where, change in zip((sensor.position, length - sensor.position), moved, strict=True)
        )
    highest = length**2 / (8.0 * _TOLD * case.record.step)
    return max(LOWEST, lowest), min(HIGHEST, highest)


def _slowest(depth: float, seconds: float, share: float) -> float:
    """The diffusivity at which a step at a face has come as far as a depth with this share of it, m2/s."""
    return depth**2 / (4.0 * float(scipy.special.erfcinv(share)) ** 2 * seconds)


def why_unreliable(
    case: Case,
    value: float,
    interval: tuple[float, float],
    singular: np.ndarray,
    converged: bool,
    bounds: tuple[float, float] = (LOWEST, HIGHEST),
) -> str:
    """Why the estimate is no number to rely on, or an empty string."""
    if not np.isfinite(value) or not np.all(np.isfinite(singular)):
        return "the model gave values that are not finite"
    if not bounds[0] * 1.001 < value < bounds[1] / 1.001:
        return f"the estimate ran to the bound of its search, {value:.3g} m2/s: the record does not hold it"
    if interval[0] <= bounds[0] * 1.001 or interval[1] >= bounds[1] / 1.001:
        return (
            f"its 95 % interval, {interval[0]:.3g} to {interval[1]:.3g} m2/s, reaches the bound of what this window "
            "can tell: the temperatures vary too little for their noise"
        )
    factor = interval[1] / interval[0]
    if factor > case.choices.largest_interval_factor:
        return (
            f"its 95 % interval spans a factor of {factor:.3g}, more than {case.choices.largest_interval_factor:g}: "
            "the temperatures vary too little for their noise"
        )
    if not converged:
        return "the iteration did not converge"
    return ""


def why_too_coarse(shift: float, noise_std_log: float) -> str:
    """Why a reduced model cannot be relied on here, or an empty string."""
    if abs(shift) <= noise_std_log:
        return ""
    return (
        f"the reduced model's own error moves the estimate by {shift:+.1%}, more than the noise does; take a "
        'higher order, learning_diffusivities around the estimate, or model = "lom"'
    )


def why_too_faint(case: Case, settled: GLSFit) -> str:
    """Why the sensors as the case states them are too coarse for what moves, or an empty string.

    A diffusivity larger by the largest factor `f` that an interval may span moves sensor s by
    `ln(f) ptp_t dT_s/d(ln alpha)` beside a constant. Where that is less than its `offset_std` at every sensor, an error
    of the size that the case states would pass for it as soon as it is not quite constant: no interval counts that.
    """
    names = settled.names
    if names.fluxes or len(names.offsets) < len(case.sensors) or not settled.finite:
        return ""
    factor, there = case.choices.largest_interval_factor, settled.shape.counts.T > 0
    slope = np.asarray(settled.minimum.jacobian)[:, 0].reshape(there.shape)
    largest = [np.ptp(course[seen]) if seen.any() else 0.0 for course, seen in zip(slope, there, strict=True)]
    moved = math.log(factor) * np.array(largest)
    stated = np.array([sensor.offset_std for sensor in case.sensors])
    if np.any(moved >= stated):
        return ""
    best = int(np.argmax(moved / stated))
    return (
        f"a diffusivity {factor:g} times as large would move {case.sensors[best].name} by {moved[best]:.2g} K, less "
        f"than the {stated[best]:g} K that the case states of its error: one that changes a little in the window would "
        "do the same; take a window in which the faces move more, or compare the sensors and state a smaller offset_std"
    )


def why_strained(case: Case, settled: GLSFit) -> str:
    """Why the readings and what the case states of its instruments contradict each other, or an empty string."""
    constants = instrument_errors_of(case, settled.names)
    pulls = np.asarray(settled.minimum.parameters)[1 : 1 + len(constants)]
    if not np.any(np.abs(pulls) > _STRAINED):
        return ""
    farthest = int(np.argmax(np.abs(pulls)))
    pull, one = float(pulls[farthest]), constants[farthest]
    error = "offset" if one.kind == "offsets" else "position error"
    return (
        f"the {error} of {one.of} would be {pull * one.std:+.3g} {one.unit}, {abs(pull):.2g} times what the case "
        "states: the wall is not as it is modelled, or less sure than stated; wallid diagnose looks for what is missing"
    )


def why_unsteady(settled: GLSFit) -> str:
    """Why there is no one diffusivity, or an empty string."""
    if not settled.finite or settled.steadiness >= _UNSTEADY:
        return ""
    return (
        f"the readings ask for another diffusivity at another time of the window (p = {settled.steadiness:.1g}): "
        "something is missing from the model; wallid diagnose looks for what"
    )
