"""Locate: where and when a model and the readings part, and whether anything is left beside the noise."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy
from numpy.polynomial.hermite_e import hermegauss

from .._internal.units import DAY
from .effect_fit import Fit

_SLOW = 10  # cosines over the record, per sensor
_MODULATIONS = 6  # of the diffusivity's sensitivity, per sensor
_FASTEST = 1.0  # cycles a day: modulations of the diffusivity for all sensors at once
_DAILY = (1, 2)  # harmonics of the day, per sensor
_RANK = 1e-3
_NODES = 40  # of the Gauss-Hermite rule over the noise's power


@dataclass(frozen=True, eq=False)
class ResidualTests:
    """What a fitted model leaves.

    Args:
        by_sensor: root mean square, K, per sensor. by_hour: mean per sensor and hour of the day, K.
        by_day: root mean square per sensor and day, K.
        statistic, freedom: of the omnibus test that tells most: the squared length of the whitened residual in
            some directions, chi-square where nothing is missing and the noise's power is known.
        p_value: of the tests together, as far as the record leaves that power open.
        smooth: the part of the residual in all their directions, orthogonal to what is free, K, `(bin, sensor)`.
    """

    by_sensor: dict[str, float]
    by_hour: np.ndarray = field(repr=False)
    by_day: np.ndarray = field(repr=False)
    statistic: float
    freedom: int
    p_value: float
    smooth: np.ndarray = field(repr=False)


def test_residual(fit: Fit) -> ResidualTests:
    """Where the remainder of a fit sits, and whether it is more than noise.

    The omnibus tests look along directions that no effect need have named; what the fit's free parameters explain
    is taken out of them first. Some 60: slow cosines, the day and its half, and the diffusivity's own sensitivity
    modulated in time, each for every sensor by itself. And two a day: that sensitivity modulated by up to a
    cycle a day, for all sensors at once, as far as the others have not seen it. The smaller p-value of the two
    independent tests counts, as the smaller of two.
    """
    record, rest = fit.study.record, fit.residual_at_rows
    names = [sensor.name for sensor in fit.study.case.sensors]
    hours = np.asarray(fit.study.model.forcing.hour)
    hours = np.concatenate([hours, [(hours[-1] + record.step / 3600.0) % 24]]).astype(int) % 24
    days = (record.time // DAY).astype(int)
    with np.errstate(invalid="ignore", divide="ignore"):
        by_hour = np.stack([_mean(rest[hours == hour]) for hour in range(24)])
        by_day = np.sqrt(np.stack([_mean(rest[days == day] ** 2) for day in range(days[-1] + 1)]))
        by_sensor = dict(zip(names, np.sqrt(_mean(rest**2)).tolist(), strict=True))
    tests, bases = [], []
    for shapes in omnibus_directions(fit):
        basis = _beside(fit, shapes, bases)
        along = basis.T @ fit.residual
        statistic, freedom = float(along @ along), basis.shape[1]
        tests.append((chance(statistic, freedom, fit.noise.spread), statistic, freedom))
        bases.append(basis)
    least, statistic, freedom = min(tests)
    together = -np.expm1(len(tests) * np.log1p(-min(least, 1.0 - 1e-16)))
    white = np.sum([basis @ (basis.T @ fit.residual) for basis in bases], axis=0)[: len(fit.noise.whiten)]
    smooth = scipy.linalg.solve_triangular(fit.noise.whiten, white, lower=True).reshape(fit.study.sensors, -1).T
    return ResidualTests(by_sensor, by_hour, by_day, statistic, freedom, float(together), smooth)


def chance(statistic: float, freedom: int, spread: float) -> float:
    """How often `exp(spread z) chi^2` passes a value, z standard normal: chi-square in noise of uncertain power."""
    node, weight = hermegauss(_NODES)
    return float(weight @ scipy.special.chdtrc(freedom, statistic * np.exp(-spread * node)) / weight.sum())


def _mean(values: np.ndarray) -> np.ndarray:
    """Of each column's values that are there; NaN where there is none."""
    there = np.isfinite(values)
    return np.where(there, values, 0.0).sum(axis=0) / there.sum(axis=0)


def omnibus_directions(fit: Fit) -> tuple[np.ndarray, np.ndarray]:
    """Shapes of the binned readings in which the omnibus tests look, K, `(direction, reading)` each."""
    study, sensors = fit.study, fit.study.sensors
    sensitivity = fit.in_kelvin()[0][:, 0].reshape(sensors, -1)  # to ln(diffusivity)
    bins = sensitivity.shape[1]
    middle = (np.arange(bins) + 0.5) / bins
    days = middle * bins * study.bins.rows * study.record.step / DAY
    slow = [np.cos(np.pi * k * middle) for k in range(_SLOW)]
    daily = [wave(2 * np.pi * k * days) for k in _DAILY for wave in (np.cos, np.sin)]
    own = [np.kron(np.eye(sensors)[s], course) for course in (*slow, *daily) for s in range(sensors)]
    own += [
        np.kron(np.eye(sensors)[s], sensitivity[s] * np.cos(np.pi * k * middle))
        for s in range(sensors)
        for k in range(_MODULATIONS)
    ]
    half_cycles = max(2, int(2 * _FASTEST * days[-1]))
    together = [(sensitivity * np.cos(np.pi * k * middle)).ravel() for k in range(1, half_cycles + 1)]
    return np.array(own), np.array(together)


def _beside(fit: Fit, shapes: np.ndarray, taken: list[np.ndarray]) -> np.ndarray:
    """An orthonormal basis of whitened shapes beside the free parameters and other bases, `(residual, direction)`."""
    rows = shapes @ fit.noise.whiten.T
    rows = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300)
    padded = np.pad(rows, ((0, 0), (0, fit.jacobian.shape[0] - rows.shape[1])))
    scale = np.maximum(np.linalg.norm(fit.jacobian, axis=0), 1e-300)
    Q, _ = np.linalg.qr(np.concatenate([fit.jacobian / scale, *taken], axis=1))
    left = padded - (padded @ Q) @ Q.T
    u, value, _ = np.linalg.svd(left.T, full_matrices=False)
    return u[:, value > _RANK * value[0]]
