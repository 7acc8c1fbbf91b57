"""What a heat flux adds: conductivity and heat capacity apart, resistance and transmittance, ISO 9869-1 beside them.

A flux is an output like any other, `j = (1 + gain) (k T_ref / L) J(u; Fo)`, whose size tells the conductivity and
whose course the diffusivity. With `k` and `alpha` of a wall of length L: `R = L / k`, areal capacity `L k / alpha`,
`U = 1 / (R_si + R + R_se)`. R and the areal capacity follow from `k / L` and `alpha / L^2` alone: the length may be a
guess.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from .case import Case
from .experiment import Window, experiment
from .free import flux_gain_std, fluxes_of
from .iso9869 import Average, average_method
from .likelihood import Free, Problem
from .quantity import NORMAL_95, Quantity, lognormal
from .settle import settle
from .settled import Settled

R_SURFACES = 0.13 + 0.04  # m2 K/W, inside and outside (ISO 6946)
_FEWEST_HALF = 50  # rows of a half that is to predict the other


@dataclass(frozen=True)
class HeldOut:
    """The first half's estimate held against the flux of the second half.

    Arguments:
        coverage: share of the second half's readings within their 95 % interval. rms: W/m2, of what was missed.
        hours: of each half. readings: in the second half.
    """

    coverage: float
    rms: float
    hours: float
    readings: int

    def __str__(self) -> str:
        return (
            f"held out     the first {self.hours:.3g} h predict the flux of the last {self.hours:.3g} h to "
            f"{self.rms:.2g} W/m2 root mean square; {self.coverage:.0%} of {self.readings} readings lie in their "
            "95 % interval"
        )


@dataclass(frozen=True)
class Thermal:
    """What the fluxes told of a wall.

    Arguments:
        conductivity, heat_capacity: W/m/K and J/m3/K, for the stated length.
        resistance, areal_heat_capacity: m2 K/W and J/m2/K, face to face, whatever the length.
        transmittance: W/m2/K, with the standard surface resistances.
        gains: per plate, what its calibration is off by: value, std, 1.
        averages: the average method of ISO 9869-1 for each plate.
        held_out: the first half against the second; None where a half is too short.
        assumed: whether the plates' calibration was assumed and not stated.
    """

    conductivity: Quantity
    heat_capacity: Quantity
    resistance: Quantity
    areal_heat_capacity: Quantity
    transmittance: Quantity
    gains: dict[str, tuple[float, float]]
    averages: tuple[Average, ...]
    held_out: HeldOut | None
    assumed: bool

    def __str__(self) -> str:
        lines = [
            f"resistance   {self.resistance}",
            f"capacity     {self.areal_heat_capacity}",
            f"U-value      {self.transmittance}",
            f"conductivity {self.conductivity}, for the stated length",
        ]
        lines += [
            f"plate        {face}: calibration {gain:+.1%} +- {std:.1%}" for face, (gain, std) in self.gains.items()
        ]
        if self.assumed:
            lines.append("             (5 % assumed; state [record] flux_gain_std)")
        lines += [str(average) for average in self.averages]
        return "\n".join([*lines, *([str(self.held_out)] if self.held_out is not None else [])])


def thermal(case: Case, window: Window, settled: Settled) -> Thermal:
    """What the fluxes of a settled estimate tell."""
    names, length = settled.names, case.wall.length
    place = 1 + names.conductivity
    free, y, spread = settled.problem.free, np.asarray(settled.minimum.parameters), settled.covariance
    scale, gain = free.log_std, flux_gain_std(case)
    k = float(free.flux[0]) / float(settled.problem.data.temperature) * length * math.exp(scale * y[place])
    alpha, log_k = settled.diffusivity, float(scale**2 * spread[place, place])
    log_c = log_k + float(spread[0, 0]) - 2 * scale * float(spread[0, place])

    def of(value: float, variance: float, unit: str) -> Quantity:
        return lognormal(value, variance, settled.quantile, unit)

    resistance = of(length / k, log_k, "m2 K/W")
    low, high = (1.0 / (R + R_SURFACES) for R in resistance.interval_95[::-1])
    U = 1.0 / (resistance.value + R_SURFACES)
    capacity = of(length * k / alpha, log_c, "J/m2/K")
    part = case.record.window(window.row, window.rows)
    return Thermal(
        conductivity=of(k, log_k, "W/m/K"),
        heat_capacity=of(k / alpha, log_c, "J/m3/K"),
        resistance=resistance,
        areal_heat_capacity=capacity,
        transmittance=Quantity(U, U**2 * resistance.std, (low, high), "W/m2/K"),
        gains={
            face: (gain * float(y[place + 1 + p]), gain * math.sqrt(float(spread[place + 1 + p, place + 1 + p])))
            for p, face in enumerate(names.fluxes)
        },
        averages=tuple(
            average_method(part.faces, part.regressors[f"flux_{face}"], part.step, face, capacity.value)
            for face in names.fluxes
        ),
        held_out=_held_out(case, window, settled),
        assumed=case.record.flux_gain_std is None,
    )


def _held_out(case: Case, window: Window, settled: Settled) -> HeldOut | None:
    """Estimate from the first half, predict the second on from there."""
    half = window.rows // 2
    if half < _FEWEST_HALF:
        return None
    model, data = settled.problem.system, experiment(case, window)
    early = settle(case, window, data, model, settled.diffusivity, eta=1e-6, rows_used=half)
    predicted, J = (np.asarray(part) for part in _linear(settled.problem, early.problem.free, early.minimum.parameters))
    data, plates = settled.problem.data, len(fluxes_of(case))
    there = np.asarray(data.weight)[half:, -plates:] > 0
    missed = (np.asarray(data.observed) - predicted)[half:, -plates:]
    noise = early.robust or early.noise
    own = np.asarray(settled.shape.sensor_std)[-plates:] ** 2 * (noise.white + noise.lasting)
    faces = (settled.shape.face_std**2 * (noise.white + noise.lasting)) * np.sum(settled.shape.response**2, axis=(0, 1))
    late = J[half:, -plates:]
    variance = own + faces[-plates:] + np.einsum("tsp,pq,tsq->ts", late, early.covariance, late)
    inside = np.abs(missed) <= NORMAL_95 * np.sqrt(variance)
    return HeldOut(
        coverage=float(inside[there].mean()),
        rms=float(np.sqrt(np.mean(missed[there] ** 2))),
        hours=half * case.record.step / 3600.0,
        readings=int(there.sum()),
    )


@eqx.filter_jit
def _linear(problem: Problem, free: Free, y: Float[Array, " param"]) -> tuple[Array, Array]:
    """Predictions at the rows and their derivatives, `(time, channel, param)`."""
    problem = eqx.tree_at(lambda p: p.free, problem, free)
    slopes, predicted = jax.jacfwd(lambda y: (problem.predicted(y),) * 2, has_aux=True)(y)
    return predicted, slopes
