"""The standard errors that campaigns in a typical year would have.

    cov(ln alpha, ln k) from (M / f^2 + P)^-1,      std(ln R) = std(ln k),      std(ln C) = std(ln k - ln alpha)

`M` is the Fisher information with the full covariance of the estimate (`fisher_information`), at each of some
diffusivities that the wall may have. The noise is as stated, but an estimate finds it out from the record, which makes
the interval wider by the factor `f` (`whittle_likelihood.expected_widening`).

The 95 % interval of a record whose best diffusivity is `x` reaches to where the distance along ln(alpha) in standard
errors is 1.96:

    d(x, x') = integral dx / std(x),      d(low, x) = d(x, high) = 1.96
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import scipy
from jaxtyping import Float

from ..._internal.units import DAY
from ...case.case_definition import Case
from ...case.time_window import Window
from ...case.wall_and_sensors import Sensor
from ...inference.likelihood import LOG_CONDUCTIVITY
from ...inference.noise_covariance import MAX_READINGS
from ...inference.nuisance_parameters import CONDUCTIVITY_STD
from ...inference.whittle_likelihood import expected_widening, projected_sensitivity
from ...models.flux_plates import flux_readings
from ..fisher_information import prior_information
from ..information_contributions import Contribution, WindowContributions, parameter_columns, whitened
from ..predicted_response import PredictedResponse, ResponseModel

_MOST_READINGS = 600  # in one dense covariance of a plan: rows are averaged over bins until there are no more
_NOISE_LOG_STD = 0.15  # of the size of the noise that a record will show
_QUANTILE = 1.96
EQUAL_CHANCES = np.array([-1.282, -0.524, 0.0, 0.524, 1.282])
"""Values of a standard normal variable that stand for fifths of its probability."""
_REACH, _FINE = 6.0, 0.02  # of ln(alpha) on both sides, and its step, in the integral of the distance


@dataclass(frozen=True)
class Instruments:
    """The sensors and plates of a campaign.

    Args:
        sensors: indices of the places of a sensor.
        plates: indices of the plates.
    """

    sensors: tuple[int, ...] = ()
    plates: tuple[int, ...] = ()


@dataclass(frozen=True)
class RelativeErrors:
    """Standard errors of the logarithms of the quantities; infinite where they are not determined."""

    diffusivity: float
    resistance: float
    capacity: float


@dataclass(frozen=True, eq=False)
class CampaignErrors:
    """Standard errors of a campaign, in the weather of several years and for several diffusivities of the wall.

    Args:
        each: by weather, then by diffusivity.
    """

    each: tuple[tuple[RelativeErrors, ...], ...]

    @property
    def diffusivity(self) -> Float[np.ndarray, "weather diffusivity"]:
        """The standard errors of ln(diffusivity)."""
        return np.array([[one.diffusivity for one in errors] for errors in self.each])

    @property
    def typical(self) -> tuple[RelativeErrors, ...]:
        """The median over the weather, for each diffusivity."""
        names = [one.name for one in fields(RelativeErrors)]
        return tuple(
            RelativeErrors(**{name: float(np.median([getattr(one, name) for one in errors])) for name in names})
            for errors in zip(*self.each, strict=True)
        )


class TypicalYear:
    """The typical year of a wall of one diffusivity, with all places of a sensor and all plates that are compared.

    Args:
        case: with a sensor at each place and each plate.
        starts: first rows of the campaigns that are compared.
        days: the longest campaign.
        step: from row to row of a campaign, s; the case has means over longer times.
    """

    def __init__(self, case: Case, starts: Sequence[int], days: float, step: float):
        self.case, self.starts, self.step = case, np.asarray(starts, int), step
        self.diffusivity = case.wall.diffusivity_prior
        model = ResponseModel(case, [sensor.position for sensor in case.sensors])
        self.predicted: PredictedResponse = model.predict(self.starts, self.rows_in(days), self.diffusivity)
        self._contributions: dict[tuple[int, int], WindowContributions] = {}

    def rows_in(self, days: float) -> int:
        """The rows of so many days."""
        return round(days * DAY / self.case.record.step)

    def errors(self, start: int, days: float, instruments: Instruments, sensor: Sensor | None = None) -> RelativeErrors:
        """The expected standard errors of a campaign.

        Args:
            start: index of its first row in `starts`.
            days: its length.
            instruments: what is measured.
            sensor: with other standard deviations than those of the case; None for those.
        """
        rows = self.rows_in(days)
        count = max(1, len(instruments.sensors) + len(instruments.plates))
        contributions = self._of_length(rows, max(1, math.ceil(rows * count / _MOST_READINGS)))
        indexed: list[tuple[int, Contribution]] = []
        for k in instruments.sensors:
            own = self.case.sensors[k]
            own = own if sensor is None else replace(sensor, name=own.name, position=own.position)
            indexed.append((k, contributions.contribution(start, k, own)))
        if instruments.plates:
            used = np.isfinite(flux_readings(self.case, Window(int(self.starts[start]), rows)))
            first = len(self.case.sensors)
            indexed += [
                (first + k, contributions.plate_contribution(start, first + k, used[:, k])) for k in instruments.plates
            ]
        if not indexed:
            return RelativeErrors(math.inf, math.inf, math.inf)
        each = [one for _, one in indexed]
        jacobian = whitened(each, contributions.whitening(indexed))
        prior = prior_information(jacobian.shape[1])
        sensitivity = projected_sensitivity(np.concatenate([jacobian, prior]), jacobian)
        ends = np.cumsum([len(one.variance) for one in each])[:-1]
        readings = min(round(days * DAY / self.step), MAX_READINGS // len(each))
        widening = expected_widening(np.split(sensitivity, ends), np.split(jacobian, ends), readings)
        conductivity = parameter_columns(each).get((None, LOG_CONDUCTIVITY))
        return _errors_of(jacobian.T @ jacobian / widening**2 + prior, conductivity)

    def _of_length(self, rows: int, bin_rows: int) -> WindowContributions:
        key = (rows, bin_rows)
        if key not in self._contributions:
            predicted = self.predicted.first_rows(rows)
            self._contributions[key] = WindowContributions(
                self.case, predicted, self.starts, rows, bin_rows, known_between_rows=True
            )
        return self._contributions[key]


def _errors_of(matrix: Float[np.ndarray, "param param"], conductivity: int | None) -> RelativeErrors:
    """The standard errors from an information matrix, whose first parameter is ln(alpha)."""
    columns = np.array([0] if conductivity is None else [0, conductivity])
    others = np.flatnonzero(~np.isin(np.arange(len(matrix)), columns))
    cross, block = matrix[np.ix_(columns, others)], matrix[np.ix_(others, others)]
    information = matrix[np.ix_(columns, columns)] - cross @ scipy.linalg.solve(block, cross.T, assume_a="pos")
    if conductivity is None:
        value = float(information[0, 0])
        return RelativeErrors(value**-0.5 if value > 0 else math.inf, math.inf, math.inf)
    scale = np.array([1.0, CONDUCTIVITY_STD])
    try:
        covariance = np.linalg.inv(information) * np.outer(scale, scale)
    except np.linalg.LinAlgError:
        return RelativeErrors(math.inf, math.inf, math.inf)
    alpha, k, both = covariance[0, 0], covariance[1, 1], covariance[0, 1]
    return RelativeErrors(*(math.sqrt(max(value, 0.0)) for value in (alpha, k, alpha + k - 2.0 * both)))


def half_width(log_std: float) -> float:
    """The upper half width of a 95 % interval, relative; infinite where nothing is determined."""
    return math.expm1(min(_QUANTILE * log_std, 50.0)) if math.isfinite(log_std) else math.inf


def times_as_wide(log_std: float, other: float) -> float:
    """The half width of an interval over that of another one, from the standard errors of both."""
    return half_width(log_std) / half_width(other)


def chance_of_uninformative(
    log_stds: Float[np.ndarray, "weather diffusivity"],
    diffusivities: Sequence[float],
    largest_ratio: float,
) -> float:
    """The chance that the ratio of the ends of the 95 % interval is larger than allowed.

    It is the mean over the weather, the diffusivities that the wall may have, the error of the estimate, and the noise
    that the record shows.

    Args:
        log_stds: standard errors of ln(diffusivity). diffusivities: at which, of equal chances.
        largest_ratio: of the ends of an interval.
    """
    x = np.log(np.asarray(diffusivities, float))
    grid = np.arange(x.min() - _REACH, x.max() + _REACH, _FINE)
    quantile = _QUANTILE * np.exp(_NOISE_LOG_STD * EQUAL_CHANCES)
    wide = []
    for stds in log_stds:
        distance = np.concatenate([[0.0], np.cumsum(_FINE / _extrapolated(grid, x, stds)[1:])])
        found = np.interp(x, grid, distance)[:, None] + EQUAL_CHANCES  # of the best diffusivity
        low, high = (
            np.interp(found[..., None] + side * quantile, distance, grid, left=-np.inf, right=np.inf)
            for side in (-1.0, 1.0)
        )
        wide.append(high - low > math.log(largest_ratio))
    return float(np.mean(wide))


def _extrapolated(grid: np.ndarray, x: np.ndarray, stds: np.ndarray) -> np.ndarray:
    """Standard errors at other values of ln(alpha): straight lines through their logarithms; one value is constant."""
    x, first = np.unique(x, return_index=True)
    logs = np.log(np.clip(stds[first], 1e-6, 1e6))
    lines = scipy.interpolate.make_interp_spline(x, logs, k=min(1, len(x) - 1))
    return np.exp(np.clip(lines(grid), -14.0, 14.0))
