"""The covariance of the readings due to a disturbance, for readings that are means over bins of rows.

With `Phi` the exact step over one row (`models.disturbance`), `m` rows in a bin, `P` the covariance of the states long
after the start and `P_0` at the first row, the means over bins i >= j have the covariance

    Cov(y_i, y_j) = S_(i-j) + C_i (P_0 - P) C_j',      C_j = (C + C Phi + ... + C Phi^(m-1)) Phi^(m j) / m
    S_0 = sum_ab R_(a-b) / m^2,    a, b < m,           R_l = C Phi^l P C',   R_(-l) = R_l'
    S_k = C_(k-1) (Phi + Phi^2 + ... + Phi^m) P C' / m

`S` is that of a heat that began long ago; the wall's states at the first row do not contain it yet.

The mean of the heat is unknown too: heat that is switched on and off has one. Its prior has the standard deviation of
the process, so the covariance contains `g g'` with `g` the readings' response to a constant heat of one unit.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import equinox as eqx
import numpy as np
from jaxtyping import Float

from .._internal.arrays import on_device
from .._internal.units import DAY
from ..case.case_definition import Case
from ..case.initial_profile import scales
from ..models.disturbance import GaussianStep, MaternProcess, Smoothness, gaussian_step, with_slow_modes
from ..models.finite_volume_wall import HeatProfile
from ..models.flux_plates import fluxes_of, full_order_model_with_plates
from ..models.state_space import StateSpace
from ..models.window_inputs import WindowData

DEPTHS_PER_DOUBLING = 8
"""How many depths there are from one to its double: neighbours differ by 9 %."""
DEPTHS = tuple(2.0 ** (number / DEPTHS_PER_DOUBLING) / 24.0 for number in range(3 * DEPTHS_PER_DOUBLING + 1))
"""Over the length: the depths over which heat behind a face may decay, from 1/24 to 1/3."""
HEAT_PROFILES = (
    HeatProfile("wall"),
    *(HeatProfile(face, depth) for depth in DEPTHS for face in ("left", "right")),
)
"""Where heat that the model does not know may be released."""


def binned_covariance(step: GaussianStep, bins: int, rows_per_bin: int) -> Float[np.ndarray, "output bin output bin"]:
    """The covariance of the outputs' means over bins, for a step over one row."""
    transition, stationary, initial, C = (
        np.asarray(part) for part in (step.transition, step.stationary, step.initial, step.C)
    )
    states, outputs = len(transition), len(C)
    with_output = stationary @ C.T
    row, of_sum, after, total = C, np.zeros((outputs, outputs)), np.zeros((states, outputs)), np.zeros_like(C)
    for lag in range(rows_per_bin):
        pairs = (rows_per_bin - lag) * (row @ with_output)
        of_sum += pairs if lag == 0 else pairs + pairs.T
        total = total + row
        row = row @ transition
        after = transition @ (after + with_output)
    over_bin = np.linalg.matrix_power(transition, rows_per_bin)
    responses = np.empty((bins, outputs, states))
    responses[0] = total / rows_per_bin
    for k in range(1, bins):
        responses[k] = responses[k - 1] @ over_bin
    by_lag = np.concatenate([of_sum[None] / rows_per_bin**2, responses[:-1] @ after / rows_per_bin])
    by_lag = np.concatenate([by_lag[:0:-1].transpose(0, 2, 1), by_lag])  # from the most negative lag on
    lags = np.subtract.outer(np.arange(bins), np.arange(bins))
    stationary_part = by_lag[lags + bins - 1].transpose(2, 0, 3, 1)
    flat = responses.transpose(1, 0, 2).reshape(-1, states)
    return stationary_part + (flat @ (initial - stationary) @ flat.T).reshape(outputs, bins, outputs, bins)


@dataclass(frozen=True, eq=False)
class DisturbedReadings:
    """The readings of a window as a disturbance of unit size changes them.

    Args:
        system: full-order or reduced-order, in its modes, with an input for each of `HEAT_PROFILES`.
        fourier: Fo, 1.
        step: between rows, in t_ref.
        reference_time: t_ref, s. temperature: T_ref, K.
        scale: each output's reading for one unit of the model's output, K or W/m2, `(output,)`.
        heating: rate of temperature by 1 W/m2 released in the whole wall, K/s.
        in_flux: whether sizes are in W/m2; else in K/day, as the mean over the wall.
    """

    system: StateSpace
    fourier: float
    step: float
    reference_time: float
    temperature: float
    scale: np.ndarray
    heating: float
    in_flux: bool

    @property
    def unit(self) -> str:
        """Of the sizes."""
        return "W/m2" if self.in_flux else "K/day"

    @property
    def unit_rate(self) -> float:
        """The model's input of heat for one unit of the size."""
        return (self.heating if self.in_flux else 1.0 / DAY) * self.reference_time / self.temperature

    @cached_property
    def slow(self) -> StateSpace:
        """The model without the modes that decay within a row."""
        return with_slow_modes(self.system, self.fourier, self.step)

    def step_of(self, profile: HeatProfile, std: float, time_constant: float, smoothness: Smoothness) -> GaussianStep:
        """The exact step over one row, its outputs in the readings' units.

        Args:
            profile: of `HEAT_PROFILES`.
            std: of the heat, in `unit`.
            time_constant: s.
            smoothness: of the process.
        """
        process = MaternProcess(std * self.unit_rate, time_constant / self.reference_time, smoothness)
        column = 2 + HEAT_PROFILES.index(profile)
        one = gaussian_step(self.slow, self.fourier, self.step, process, column, cubic=False)
        scale = on_device(self.scale[:, None])
        return eqx.tree_at(lambda step: (step.C, step.D), one, (scale * one.C, scale * one.D))

    def covariance(
        self, profile: HeatProfile, time_constant: float, smoothness: Smoothness, bins: int, rows_per_bin: int
    ) -> Float[np.ndarray, "reading reading"]:
        """The covariance of the binned readings for a size of one unit, in the readings' units squared.

        Args:
            profile: of `HEAT_PROFILES`. time_constant: s. smoothness: of the process.
            bins, rows_per_bin: of the readings.
        """
        blocks = binned_covariance(self.step_of(profile, 1.0, time_constant, smoothness), bins, rows_per_bin)
        readings = blocks.shape[0] * bins
        constant = self.of_constant_heat(profile, bins * rows_per_bin)
        mean = constant.reshape(bins, rows_per_bin, -1).mean(axis=1).T.reshape(-1)
        return blocks.reshape(readings, readings) + np.outer(mean, mean)

    def of_constant_heat(self, profile: HeatProfile, rows: int) -> Float[np.ndarray, "time output"]:
        """The change of the readings by a constant heat of one unit from the first row on."""
        system, column = self.slow, 2 + HEAT_PROFILES.index(profile)
        assert system.B0 is not None
        rates = self.fourier * np.asarray(system.A)
        heat = self.unit_rate * np.asarray(system.B0)[:, column]
        times = self.step * np.arange(rows)
        states = np.expm1(np.outer(times, rates)) / rates * heat
        return self.scale * (states @ np.asarray(system.C).T + self.unit_rate * np.asarray(system.D)[:, column])


def disturbed_readings(
    case: Case,
    data: WindowData,
    diffusivity: float,
    *,
    conductance: float = 0.0,
    contacts: tuple[float, float] = (0.0, 0.0),
    wall: np.ndarray | None = None,
    spacing: int = 1,
    gains: np.ndarray | None = None,
) -> DisturbedReadings:
    """How heat that the model does not know would change the readings, by the full-order model.

    Args:
        case: with its sensors and plates.
        data: of a window.
        diffusivity: m2/s.
        conductance: conductivity over length, W/m2/K; needed with plates.
        contacts: length of wall with the resistance between each face and its sensor, m.
        wall: the wall's own parameters, in prior standard deviations.
        spacing: of the rows with readings.
        gains: calibration error of each plate; None for exact plates.
    """
    scale, plates, temperature = scales(case), len(fluxes_of(case)), float(data.temperature)
    of_plates = conductance * (np.ones(plates) if gains is None else 1.0 + gains)
    return DisturbedReadings(
        system=full_order_model_with_plates(case, wall, contacts=contacts, heat=HEAT_PROFILES),
        fourier=float(scale.fourier_number(diffusivity)),
        step=float(data.step) * spacing,
        reference_time=scale.time,
        temperature=temperature,
        scale=temperature * np.concatenate([np.ones(len(case.sensors)), of_plates]),
        heating=diffusivity / (conductance * case.wall.length**2) if plates else 0.0,
        in_flux=plates > 0,
    )
