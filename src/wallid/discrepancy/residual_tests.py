"""Tests of the residual of a fit: its distribution over instruments, hours and days; omnibus tests against noise."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy
from numpy.polynomial.hermite_e import hermegauss

from .._internal.units import DAY
from ..inference.likelihood import LOG_DIFFUSIVITY
from .effect_fit import EffectFit

_SLOW = 10  # slow cosines over the record, per instrument
_MODULATIONS = 6  # slow modulations of the sensitivity to ln(alpha), per instrument
_MAX_FREQUENCY = 1.0  # cycles per day, of the modulations common to all instruments
_DAILY = (1, 2)  # harmonics of the day, per instrument
_RANK_TOLERANCE = 1e-3  # relative singular value below which a direction is dropped
_NODES = 40  # of the Gauss-Hermite rule over the noise variance


@dataclass(frozen=True, eq=False)
class ResidualTests:
    """Tests of the residual of a fit.

    Args:
        by_instrument: root mean square, K (W/m2 of a plate), by name of the sensor or plate.
        by_hour: mean, `(hour of the day, instrument)`.
        by_day: root mean square, `(day, instrument)`.
        statistic: squared length of the whitened residual in the directions of the omnibus test with the smaller
            p-value; chi-square distributed for a true model and known noise variance.
        degrees_of_freedom: of that test.
        p_value: of both omnibus tests together, with the uncertainty of the noise variance.
        smooth_residual: the part of the residual in all directions of the tests, orthogonal to the estimated
            parameters, `(bin, instrument)`.
    """

    by_instrument: dict[str, float]
    by_hour: np.ndarray = field(repr=False)
    by_day: np.ndarray = field(repr=False)
    statistic: float
    degrees_of_freedom: int
    p_value: float
    smooth_residual: np.ndarray = field(repr=False)


def run_residual_tests(fit: EffectFit, allowance: float = 0.0) -> ResidualTests:
    """The distribution of the residual of a fit, and whether it exceeds the noise.

    Two omnibus tests project the residual on directions that do not depend on any effect and are orthogonal to the
    estimated parameters. The first has about 60 directions: slow cosines, harmonics of the day, and the slowly
    modulated sensitivity to ln(alpha), each per instrument. The second has two directions per day of record: the
    sensitivity modulated with up to one cycle per day, for all instruments at once, orthogonal to the first. The
    smaller p-value p of the two independent tests gives `1 - (1 - p)^2`.

    Args:
        fit: the fit.
        allowance: squared length that a model error may have in the whitened residual. No effect is modelled exactly,
            so a large one leaves more than noise.
    """
    record, residual = fit.problem.record, fit.residual_at_rows
    names = fit.problem.instruments
    hours = np.asarray(fit.problem.model.forcing.hour)
    hours = np.concatenate([hours, [(hours[-1] + record.step / 3600.0) % 24]]).astype(int) % 24
    days = (record.time // DAY).astype(int)
    with np.errstate(invalid="ignore", divide="ignore"):
        by_hour = np.stack([_mean(residual[hours == hour]) for hour in range(24)])
        by_day = np.sqrt(np.stack([_mean(residual[days == day] ** 2) for day in range(days[-1] + 1)]))
        by_instrument = dict(zip(names, np.sqrt(_mean(residual**2)).tolist(), strict=True))
    tests, bases = [], []
    for directions in omnibus_directions(fit):
        basis = _orthogonal_basis(fit, directions, bases)
        projection = basis.T @ fit.residual
        statistic, freedom = float(projection @ projection), basis.shape[1]
        p_value = chi_square_p_value(statistic, freedom, fit.noise.log_power_std, allowance)
        tests.append((p_value, statistic, freedom))
        bases.append(basis)
    smallest, statistic, freedom = min(tests)
    p_value = -np.expm1(len(tests) * np.log1p(-min(smallest, 1.0 - 1e-16)))
    white = np.sum([basis @ (basis.T @ fit.residual) for basis in bases], axis=0)[: len(fit.noise.whitening)]
    smooth = scipy.linalg.solve_triangular(fit.noise.whitening, white, lower=True)
    smooth = smooth.reshape(fit.problem.instrument_count, -1).T
    return ResidualTests(by_instrument, by_hour, by_day, statistic, freedom, float(p_value), smooth)


def chi_square_p_value(statistic: float, freedom: int, spread: float, noncentrality: float = 0.0) -> float:
    """Probability that `exp(spread z) chi^2` exceeds a statistic, z standard normal.

    Args:
        statistic: the observed value.
        freedom: degrees of freedom of the chi-square.
        spread: standard deviation of the logarithm of the noise variance.
        noncentrality: of the chi-square.
    """
    node, weight = hermegauss(_NODES)
    tails = scipy.stats.ncx2.sf(statistic * np.exp(-spread * node), freedom, noncentrality)
    return float(weight @ tails / weight.sum())


def _mean(values: np.ndarray) -> np.ndarray:
    """Mean of the finite values of each column; NaN where there is none."""
    present = np.isfinite(values)
    return np.where(present, values, 0.0).sum(axis=0) / present.sum(axis=0)


def omnibus_directions(fit: EffectFit) -> tuple[np.ndarray, np.ndarray]:
    """The directions of the two omnibus tests in the binned readings, K, `(direction, reading)` each."""
    problem, instruments = fit.problem, fit.problem.instrument_count
    sensitivity = fit.unwhitened()[0][:, fit.index(LOG_DIFFUSIVITY)].reshape(instruments, -1)
    bins = sensitivity.shape[1]
    middle = (np.arange(bins) + 0.5) / bins
    days = middle * bins * problem.bins.rows_per_bin * problem.record.step / DAY
    slow = [np.cos(np.pi * k * middle) for k in range(_SLOW)]
    daily = [harmonic(2 * np.pi * k * days) for k in _DAILY for harmonic in (np.cos, np.sin)]
    each = [np.kron(np.eye(instruments)[s], signal) for signal in (*slow, *daily) for s in range(instruments)]
    each += [
        np.kron(np.eye(instruments)[s], sensitivity[s] * np.cos(np.pi * k * middle))
        for s in range(instruments)
        for k in range(_MODULATIONS)
    ]
    half_cycles = max(2, int(2 * _MAX_FREQUENCY * days[-1]))
    common = [(sensitivity * np.cos(np.pi * k * middle)).ravel() for k in range(1, half_cycles + 1)]
    return np.array(each), np.array(common)


def _orthogonal_basis(fit: EffectFit, directions: np.ndarray, others: list[np.ndarray]) -> np.ndarray:
    """Orthonormal basis of whitened directions, orthogonal to the Jacobian and other bases, `(residual, direction)`."""
    rows = directions @ fit.noise.whitening.T
    rows = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300)
    padded = np.pad(rows, ((0, 0), (0, fit.jacobian.shape[0] - rows.shape[1])))
    scale = np.maximum(np.linalg.norm(fit.jacobian, axis=0), 1e-300)
    Q, _ = np.linalg.qr(np.concatenate([fit.jacobian / scale, *others], axis=1))
    orthogonal = padded - (padded @ Q) @ Q.T
    u, value, _ = np.linalg.svd(orthogonal.T, full_matrices=False)
    return u[:, value > _RANK_TOLERANCE * value[0]]
