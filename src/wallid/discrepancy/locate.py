"""Locate: where and when a model and the readings part, and whether anything is left beside the noise."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.polynomial.hermite_e import hermegauss
from scipy.stats import chi2

from .extend import Fit

_SLOW = 10  # cosines over the record, per sensor
_MODULATIONS = 6  # of the diffusivity's sensitivity, per sensor
_DAILY = (1, 2)  # harmonics of the day, per sensor
_RANK = 1e-3
_NODES = 40  # of the Gauss-Hermite rule over the noise's power
_DAY = 86400.0


@dataclass(frozen=True, eq=False)
class Remainder:
    """What a fitted model leaves.

    Arguments:
        by_sensor: root mean square, K, per sensor. by_hour: mean per sensor and hour of the day, K.
        by_day: root mean square per sensor and day, K.
        statistic, freedom: of the omnibus test: the squared length of the whitened residual in slow, daily and
            diffusivity-like directions, chi-square where nothing is missing and the noise's power is known.
        p_value: of it, as far as the record leaves that power open.
        smooth: the part of the residual in these directions, whitened.
    """

    by_sensor: dict[str, float]
    by_hour: np.ndarray = field(repr=False)
    by_day: np.ndarray = field(repr=False)
    statistic: float
    freedom: int
    p_value: float
    smooth: np.ndarray = field(repr=False)


def locate(fit: Fit) -> Remainder:
    """Where the remainder of a fit sits, and whether it is more than noise.

    The omnibus test looks along some 60 directions that no effect need have named: slow cosines, the day and
    its half, and the diffusivity's own sensitivity modulated in time; what the fit's free parameters explain is
    taken out of them first.
    """
    record, rest = fit.study.record, fit.remainder
    names = [sensor.name for sensor in fit.study.case.sensors]
    hours = np.asarray(fit.study.model.campaign.hour)
    hours = np.concatenate([hours, [(hours[-1] + record.step / 3600.0) % 24]]).astype(int) % 24
    days = (record.time // _DAY).astype(int)
    with np.errstate(invalid="ignore", divide="ignore"):
        by_hour = np.stack([_mean(rest[hours == hour]) for hour in range(24)])
        by_day = np.sqrt(np.stack([_mean(rest[days == day] ** 2) for day in range(days[-1] + 1)]))
        by_sensor = dict(zip(names, np.sqrt(_mean(rest**2)).tolist(), strict=True))
    basis = _directions(fit)
    along = basis.T @ fit.residual
    statistic = float(along @ along)
    freedom = basis.shape[1]
    p_value = chance(statistic, freedom, fit.noise.spread)
    return Remainder(by_sensor, by_hour, by_day, statistic, freedom, p_value, basis @ along)


def chance(statistic: float, freedom: int, spread: float) -> float:
    """How often `exp(spread z) chi^2` passes a value, z standard normal: chi-square in noise of uncertain power."""
    node, weight = hermegauss(_NODES)
    return float(weight @ chi2.sf(statistic * np.exp(-spread * node), freedom) / weight.sum())


def _mean(values: np.ndarray) -> np.ndarray:
    """Of each column's values that are there; NaN where there is none."""
    there = np.isfinite(values)
    return np.where(there, values, 0.0).sum(axis=0) / there.sum(axis=0)


def _directions(fit: Fit) -> np.ndarray:
    """An orthonormal basis of the omnibus directions beside the free parameters, `(reading + free, direction)`."""
    study, whiten = fit.study, fit.noise.whiten
    sensors = study.sensors
    bins = len(whiten) // sensors
    middle = (np.arange(bins) + 0.5) / bins
    phase = 2 * np.pi * middle * bins * study.bins.rows * study.record.step / _DAY
    slow = [np.cos(np.pi * k * middle) for k in range(_SLOW)]
    daily = [wave(k * phase) for k in _DAILY for wave in (np.cos, np.sin)]
    shapes = [np.kron(np.eye(sensors)[s], course) for course in (*slow, *daily) for s in range(sensors)]
    directions = np.array(shapes) @ whiten.T
    # the whitened sensitivity to ln(diffusivity), by sensor, modulated
    size = len(whiten)
    sensitivity = fit.jacobian[:size, 0].reshape(sensors, bins)
    modulated = [
        np.kron(np.eye(sensors)[s], sensitivity[s] * np.cos(np.pi * k * middle))
        for s in range(sensors)
        for k in range(_MODULATIONS)
    ]
    rows = np.concatenate([directions, modulated])
    rows = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300)
    padded = np.pad(rows, ((0, 0), (0, fit.jacobian.shape[0] - size)))
    scale = np.maximum(np.linalg.norm(fit.jacobian, axis=0), 1e-300)
    Q, _ = np.linalg.qr(fit.jacobian / scale)
    left = padded - (padded @ Q) @ Q.T
    u, value, _ = np.linalg.svd(left.T, full_matrices=False)
    return u[:, value > _RANK * value[0]]
