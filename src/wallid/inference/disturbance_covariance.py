"""The covariance of the readings due to a disturbance, for readings that are means over bins of rows.

With `Phi` and `Q` the exact step over one row (`models.disturbance`), `m` rows in a bin and `P_j` the covariance of the
states at the first row of bin j:

    P_{j+1} = Phi^m P_j (Phi^m)' + Q_m,      C_m = (C + C Phi + ... + C Phi^(m-1)) / m
    Cov(y_j, y_j) = C_m P_j C_m' + V_m
    Cov(y_i, y_j) = C_m (Phi^m)^(i-j-1) (Phi^m P_j C_m' + W_m),      i > j

The mean of the heat is unknown too: heat that is switched on and off has one. Its prior has the standard deviation of
the process, so the covariance contains `g g'` with `g` the readings' response to a constant heat of one unit.

`Q_m`, `V_m` and `W_m` are the covariances of the states after a bin, of the bin's mean, and between both, by what
enters within the bin.
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

DEPTHS = (1.0 / 12.0, 1.0 / 24.0, 1.0 / 6.0, 1.0 / 3.0)
"""Over the length: the depths over which heat behind a face may decay; the first is tried first."""
HEAT_PROFILES = (
    HeatProfile("wall"),
    *(HeatProfile(face, depth) for depth in DEPTHS for face in ("left", "right")),
)
"""Where heat that the model does not know may be released."""


def binned_covariance(step: GaussianStep, bins: int, rows_per_bin: int) -> Float[np.ndarray, "output bin output bin"]:
    """The covariance of the outputs' means over bins, for a step over one row."""
    transition, noise, C = (np.asarray(part) for part in (step.transition, step.noise, step.C))
    states, outputs = len(transition), len(C)
    of_states, of_sum, between = np.zeros((states, states)), np.zeros((outputs, outputs)), np.zeros((states, outputs))
    mean, over_bin, total = C, np.eye(states), np.zeros_like(C)
    for _ in range(rows_per_bin):
        total = total + mean
        mean = mean @ transition
        over_bin = transition @ over_bin
        with_sum = C @ between
        of_sum = of_sum + with_sum + with_sum.T + C @ of_states @ C.T
        between = transition @ (between + of_states @ C.T)
        of_states = transition @ of_states @ transition.T + noise
    of_mean, between, C_m = of_sum / rows_per_bin**2, between / rows_per_bin, total / rows_per_bin
    later = np.empty((bins, outputs, states))
    later[0] = C_m
    for k in range(1, bins):
        later[k] = later[k - 1] @ over_bin
    covariance = np.empty((outputs, bins, outputs, bins))
    at_start = np.asarray(step.initial)
    for j in range(bins):
        covariance[:, j, :, j] = C_m @ at_start @ C_m.T + of_mean
        after = over_bin @ at_start @ C_m.T + between
        block = later[: bins - j - 1] @ after  # (bin, output, output)
        covariance[:, j + 1 :, :, j] = block.transpose(1, 0, 2)
        covariance[:, j, :, j + 1 :] = block.transpose(2, 1, 0)
        at_start = over_bin @ at_start @ over_bin.T + of_states
    return covariance


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
    """
    scale, plates, temperature = scales(case), len(fluxes_of(case)), float(data.temperature)
    return DisturbedReadings(
        system=full_order_model_with_plates(case, wall, contacts=contacts, heat=HEAT_PROFILES),
        fourier=float(scale.fourier_number(diffusivity)),
        step=float(data.step) * spacing,
        reference_time=scale.time,
        temperature=temperature,
        scale=np.array([temperature] * len(case.sensors) + [temperature * conductance] * plates),
        heating=diffusivity / (conductance * case.wall.length**2) if plates else 0.0,
        in_flux=plates > 0,
    )
