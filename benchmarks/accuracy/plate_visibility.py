"""How clearly a record with heat flux plates can show an effect, whatever the method: by differences of the simulator.

The squared signal-to-noise of what the effect changes in the readings, with the true covariance of their noise.
Projected out: diffusivity and conductivity; eight sine modes of the initial profile, the plates' calibrations, and
positions, with their priors.
"""

import math
from dataclasses import replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import brentq

from benchmarks.accuracy.discrepancy.scenarios import MODES, PROFILE_STD, READINGS, averaged, noise_covariance
from benchmarks.reference.simulator_with_effects import Spec, clean

_STEP = 0.01  # of ln(diffusivity), for its derivative


class Visibility:
    """The projections of one record, nothing hidden in it.

    Args:
        spec: of the record; its effects do not count.
    """

    def __init__(self, spec: Spec):
        self.spec = spec = replace(spec, effects=(), misplaced=False)
        self.many = math.ceil(spec.rows * (len(spec.positions) + len(spec.plates)) / READINGS)
        self.factor = cholesky(noise_covariance(spec, spec.diffusivity, self.many), lower=True)
        self.plain = self._readings(spec)
        columns, prior_std = self._nuisance()
        priors = np.diag(1.0 / np.array(prior_std))
        self.basis = np.linalg.qr(np.concatenate([self._white(columns), priors]))[0]

    def _readings(self, spec: Spec) -> np.ndarray:
        """Without noise, (row, reading): sensors, then plates."""
        known = clean(spec)
        return np.hstack([known["readings"][:, 2:], known["fluxes"]])

    def _nuisance(self) -> tuple[np.ndarray, list[float]]:
        """The readings' derivatives to what is not known, (row, reading, parameter), and the priors."""
        spec, sensors = self.spec, len(self.spec.positions)
        faster = self._readings(replace(spec, diffusivity=spec.diffusivity * math.exp(_STEP)))
        columns, prior_std = [(faster - self.plain) / _STEP], [np.inf]
        of_flux = self.plain * (np.arange(self.plain.shape[1]) >= sensors)
        columns.append(of_flux)  # ln(conductivity)
        prior_std.append(np.inf)
        for number in range(sensors, self.plain.shape[1]):
            columns.append(of_flux * (np.arange(self.plain.shape[1]) == number))
            prior_std.append(spec.flux_gain_std)
        time, x = spec.step * np.arange(spec.rows), np.array(spec.positions)
        for n in np.arange(1, MODES + 1) * np.pi / spec.length:
            places = np.array([0.0 if side == "left" else spec.length for side in spec.plates])
            shape = np.concatenate([np.sin(n * x), -spec.conductivity * n * np.cos(n * places)])
            columns.append(np.outer(np.exp(-spec.diffusivity * n**2 * time), shape))
            prior_std.append(PROFILE_STD)
        for number, place in enumerate(x if spec.position_std > 0 else ()):
            moved = [*spec.positions[:number], place + spec.position_std, *spec.positions[number + 1 :]]
            columns.append((self._readings(replace(spec, positions=tuple(moved))) - self.plain) / spec.position_std)
            prior_std.append(spec.position_std)
        return np.stack(columns, axis=-1), prior_std

    def _white(self, columns: np.ndarray) -> np.ndarray:
        """Whitened means over rows, reading after reading, of (row, reading, column)."""
        means = [averaged(one, self.many) for one in np.moveaxis(columns, -1, 0)]
        return solve_triangular(self.factor, np.transpose(means), lower=True)

    def of(self, spec: Spec) -> float:
        """The squared signal-to-noise of the effects of the same record."""
        change = self._readings(replace(spec, misplaced=False)) - self.plain
        signal = self._white(change[:, :, None])[:, 0]
        signal = np.concatenate([signal, np.zeros(self.basis.shape[0] - len(signal))])
        return float(np.sum((signal - self.basis @ (self.basis.T @ signal)) ** 2))


def with_signal_to_noise(spec: Spec, parameter: str, target: float) -> Spec:
    """A record with one hidden effect whose size gives a squared signal-to-noise.

    Args:
        spec: of the record, its effect of any size.
        parameter: the effect's size; its sign stays.
        target: squared signal-to-noise.
    """
    visibility, (effect,) = Visibility(spec), spec.effects
    first = effect.parameters[parameter]

    def sized(log_factor: float) -> Spec:
        size = float(f"{first * math.exp(log_factor):.5g}")
        return replace(spec, effects=(effect._replace(parameters=effect.parameters | {parameter: size}),))

    def excess(log_factor: float) -> float:
        return math.log(visibility.of(sized(log_factor)) / target)

    low, high = -0.5 * excess(0.0) - 0.5, -0.5 * excess(0.0) + 0.5  # about linear
    while excess(low) > 0:
        low -= 1.0
    while excess(high) < 0:
        high += 1.0
    return sized(brentq(excess, low, high, xtol=1e-3))
