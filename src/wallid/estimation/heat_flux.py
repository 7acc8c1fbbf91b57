"""What a heat flux adds: conductivity and heat capacity apart, resistance and transmittance, ISO 9869-1 beside them.

A flux is an output like any other, `j = (1 + gain) (k T_ref / L) J(u; Fo)`, whose size tells the conductivity and
whose course the diffusivity. With `k` and `alpha` of a wall of length L: `R = L / k`, areal capacity `L k / alpha`,
`U = 1 / (R_si + R + R_se)`. R and the areal capacity follow from `k / L` and `alpha / L^2` alone: the length may be a
guess.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from ..case.case_definition import Case
from ..case.time_window import Window, whole
from ..inference.generalised_least_squares import fit_generalised_least_squares
from ..inference.gls_fit import GLSFit
from ..inference.likelihood import LikelihoodProblem, NuisanceModel
from ..inference.quantity import NORMAL_95, Quantity, lognormal
from ..models.flux_plates import fluxes_of
from ..models.window_inputs import window_data
from .iso_9869 import AverageMethod, average_method
from .pooled_mean import PooledMean, covariance_of, mean_of

R_SURFACES = 0.13 + 0.04  # m2 K/W, inside and outside (ISO 6946)
_FEWEST_HALF = 50  # rows of a half that is to predict the other


@dataclass(frozen=True)
class HeldOut:
    """The first half's estimate held against the flux of the second half.

    Args:
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
class ThermalProperties:
    """What the fluxes told of a wall.

    Args:
        conductivity, heat_capacity: W/m/K and J/m3/K, for the stated length.
        resistance, areal_heat_capacity: m2 K/W and J/m2/K, face to face, whatever the length.
        transmittance: W/m2/K, with the standard surface resistances.
        gains: per plate, what its calibration is off by: value, std, 1.
        averages: the average method of ISO 9869-1 for each plate.
        held_out: the first half against the second; None where a half is too short or without a flux, or for several
            windows together.
        assumed: whether the plates' calibration was assumed and not stated.
    """

    conductivity: Quantity
    heat_capacity: Quantity
    resistance: Quantity
    areal_heat_capacity: Quantity
    transmittance: Quantity
    gains: dict[str, tuple[float, float]]
    averages: tuple[AverageMethod, ...]
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


def thermal(case: Case, window: Window, settled: GLSFit) -> ThermalProperties:
    """What the fluxes of a settled estimate tell."""
    logs = _logs(settled, case.wall.length)

    def of(name: str, unit: str) -> Quantity:
        value, along = logs[name]
        return lognormal(math.exp(value), settled.variance(along), settled.quantile, unit)

    gains = {
        face: (value, math.sqrt(settled.variance(along)))
        for face in settled.names.fluxes
        for value, along in [logs[face]]
    }
    properties = of("conductivity", "W/m/K"), of("heat_capacity", "J/m3/K")
    return _thermal(case, window, *properties, gains, _held_out(case, window, settled))


def pooled_thermal(case: Case, windows: Sequence[GLSFit]) -> tuple[ThermalProperties, PooledMean]:
    """What the fluxes of several windows tell together, and the mean of their ln(conductivity).

    The mean of each quantity's logarithm and of each plate's calibration, all windows with the same errors of the
    instruments (`pooling`); the average method takes the whole record, or its longest unbroken part.
    """
    logs, quantile = [_logs(one, case.wall.length) for one in windows], max(one.quantile for one in windows)
    means = {}
    told = [name for name, (_, along) in logs[0].items() if along.any()]  # a calibration may be known
    for name in told:
        values, along = (np.array(part) for part in zip(*(one[name] for one in logs), strict=True))
        stds = np.sqrt([one.variance(way) for one, way in zip(windows, along, strict=True)])
        shared = np.stack([one.of_constants(way) for one, way in zip(windows, along, strict=True)])
        means[name] = mean_of(values, covariance_of(stds, shared), quantile)

    def of(name: str, unit: str) -> Quantity:
        return lognormal(math.exp(means[name].value), means[name].std ** 2, means[name].quantile, unit)

    gains = {face: (means[face].value, means[face].std) if face in means else (0.0, 0.0) for face in fluxes_of(case)}
    properties = of("conductivity", "W/m/K"), of("heat_capacity", "J/m3/K")
    return _thermal(case, whole(case), *properties, gains, None), means["conductivity"]


def _logs(settled: GLSFit, length: float) -> dict[str, tuple[float, np.ndarray]]:
    """ln(conductivity), ln(heat capacity) and each plate's gain, and what combination of the parameters each is."""
    names, free, y = settled.names, settled.problem.nuisance, np.asarray(settled.minimum.parameters)
    unit, place = np.eye(len(y)), 1 + names.conductivity
    log_k = math.log(float(free.flux[0]) / float(settled.problem.data.temperature) * length) + free.log_std * y[place]
    along_k = free.log_std * unit[place]
    found = {
        "conductivity": (log_k, along_k),
        "heat_capacity": (log_k - math.log(settled.diffusivity), along_k - unit[0]),
    }
    for face, gain, at in zip(names.fluxes, np.asarray(free.gain_std), range(place + 1, len(y)), strict=True):
        found[face] = float(gain * y[at]), gain * unit[at]
    return found


def _thermal(
    case: Case,
    window: Window,
    conductivity: Quantity,
    heat_capacity: Quantity,
    gains: dict[str, tuple[float, float]],
    held_out: HeldOut | None,
) -> ThermalProperties:
    """All that follows from conductivity and heat capacity, and the average method over a window beside it."""
    length, k = case.wall.length, conductivity
    ends = tuple(length / end for end in k.interval_95[::-1])
    resistance = Quantity(length / k.value, length * k.std / k.value**2, (ends[0], ends[1]), "m2 K/W")
    low, high = (1.0 / (R + R_SURFACES) for R in ends[::-1])
    U = 1.0 / (resistance.value + R_SURFACES)
    c = heat_capacity
    areal = Quantity(length * c.value, length * c.std, (length * c.interval_95[0], length * c.interval_95[1]), "J/m2/K")
    part = case.record.window(window.row, window.rows)
    return ThermalProperties(
        conductivity=conductivity,
        heat_capacity=heat_capacity,
        resistance=resistance,
        areal_heat_capacity=areal,
        transmittance=Quantity(U, U**2 * resistance.std, (low, high), "W/m2/K"),
        gains=gains,
        averages=tuple(
            average_method(part.faces, part.regressors[f"flux_{face}"], part.step, face, areal.value) for face in gains
        ),
        held_out=held_out,
        assumed=case.record.flux_gain_std is None,
    )


def _held_out(case: Case, window: Window, settled: GLSFit) -> HeldOut | None:
    """Estimate from the first half, predict the second on from there."""
    half, plates = window.rows // 2, len(fluxes_of(case))
    there = np.asarray(settled.problem.data.weight)[:, -plates:] > 0
    if half < _FEWEST_HALF or not (there[:half].any() and there[half:].any()):
        return None
    model, data = settled.problem.system, window_data(case, window)
    early = fit_generalised_least_squares(case, window, data, model, settled.diffusivity, eta=1e-6, rows_used=half)
    predicted, J = (
        np.asarray(part) for part in _linear(settled.problem, early.problem.nuisance, early.minimum.parameters)
    )
    data, there = settled.problem.data, there[half:]
    missed = (np.asarray(data.observed) - predicted)[half:, -plates:]
    noise = early.robust or early.noise
    own = np.asarray(settled.shape.sensor_std)[-plates:] ** 2 * (noise.white + noise.autocorrelated)
    faces = (settled.shape.face_std**2 * (noise.white + noise.autocorrelated)) * np.sum(
        settled.shape.response**2, axis=(0, 1)
    )
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
def _linear(problem: LikelihoodProblem, free: NuisanceModel, y: Float[Array, " param"]) -> tuple[Array, Array]:
    """Predictions at the rows and their derivatives, `(time, channel, param)`."""
    problem = eqx.tree_at(lambda p: p.nuisance, problem, free)
    slopes, predicted = jax.jacfwd(lambda y: (problem.predicted(y),) * 2, has_aux=True)(y)
    return predicted, slopes
