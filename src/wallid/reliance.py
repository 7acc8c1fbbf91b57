"""Whether an estimate is a number to rely on, and why it is not; and what a window can tell at all."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.special import erfcinv

from .case import Case
from .experiment import Window
from .free import Names
from .likelihood import HIGHEST, LOWEST
from .settled import Settled
from .wall import SIDES

_TOLD, _MOST_TOLD = 0.01, 0.5  # share of a face's change: what is told of it, at the least and at the most
_STRAINED = 4.0  # prior standard deviations: an offset or a place hardly ever is that far from what the case states
_UNSTEADY = 0.01  # how often chance may call a steady diffusivity unsteady


def told_range(case: Case, window: Window) -> tuple[float, float]:
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
    return depth**2 / (4.0 * float(erfcinv(share)) ** 2 * seconds)


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


def why_strained(case: Case, settled: Settled) -> str:
    """Why the readings and what the case states of its instruments contradict each other, or an empty string."""
    names, z = settled.names, np.asarray(settled.minimum.parameters)[1:]
    errors = [(z[k], word, std, unit) for k, (word, std, unit) in enumerate(_stated(case, names))]
    pull, word, std, unit = max(errors, key=lambda one: abs(one[0]), default=(0.0, "", 0.0, ""))
    if abs(pull) <= _STRAINED:
        return ""
    return (
        f"{word} would be {pull * std:+.3g} {unit}, {abs(pull):.2g} times what the case states: the wall is not as it "
        "is modelled, or less sure than stated; wallid diagnose looks for what is missing"
    )


def why_unsteady(settled: Settled) -> str:
    """Why there is no one diffusivity, or an empty string."""
    if not settled.finite or settled.steadiness >= _UNSTEADY:
        return ""
    return (
        f"the readings ask for another diffusivity at another time of the window (p = {settled.steadiness:.1g}): "
        "something is missing from the model; wallid diagnose looks for what"
    )


def _stated(case: Case, names: Names) -> Iterator[tuple[str, float, str]]:
    """Of each offset and place that is free, in their order: what it is, its standard deviation and unit."""
    for s in names.offsets:
        yield f"the offset of {case.sensors[s].name}", case.sensors[s].offset_std, "K"
    for s in names.positions:
        yield f"the position error of {case.sensors[s].name}", case.sensors[s].position_std, "m"
    for side in names.depths:
        yield f"the position error of the {SIDES[side]} face's sensor", case.record.face_position_std, "m"


def why_too_coarse(shift: float, noise_std_log: float) -> str:
    """Why a reduced model cannot be relied on here, or an empty string."""
    if abs(shift) <= noise_std_log:
        return ""
    return (
        f"the reduced model's own error moves the estimate by {shift:+.1%}, more than the noise does; take a "
        'higher order, learning_diffusivities around the estimate, or model = "lom"'
    )
