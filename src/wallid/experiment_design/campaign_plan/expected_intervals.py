"""The standard errors that campaigns in a typical year would have.

    cov(ln alpha, ln k) from (M + P)^-1,      std(ln R) = std(ln k),      std(ln C) = std(ln k - ln alpha)

`M` is the Fisher information with the full covariance of the estimate (`fisher_information`), at each of some
diffusivities that the wall may have.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from jaxtyping import Float

from ..._internal.units import DAY
from ...case.case_definition import Case
from ...case.time_window import Window
from ...case.wall_and_sensors import Sensor
from ...inference.likelihood import LOG_CONDUCTIVITY
from ...inference.nuisance_parameters import CONDUCTIVITY_STD
from ...models.flux_plates import flux_readings
from ..fisher_information import information_matrix
from ..information_contributions import Contribution, WindowContributions, parameter_columns
from ..predicted_response import PredictedResponse, ResponseModel

_MOST_READINGS = 600  # in one dense covariance of a plan: rows are averaged over bins until there are no more
_NOISE_LOG_STD = 0.15  # of the size of the noise that a record will show
_QUANTILE = 1.96


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


class TypicalYear:
    """The typical year of a wall of one diffusivity, with all places of a sensor and all plates that are compared.

    Args:
        case: with a sensor at each place and each plate.
        starts: first rows of the campaigns that are compared.
        days: the longest campaign.
    """

    def __init__(self, case: Case, starts: Sequence[int], days: float):
        self.case, self.starts = case, np.asarray(starts, int)
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
            window = Window(int(self.starts[start]), rows)
            present = np.isfinite(flux_readings(self.case, window))
            none = np.zeros((rows, len(self.case.sensors)), bool)
            plates = contributions.contributions_of_case(start, none, present)[len(self.case.sensors) :]
            indexed += [plates[k] for k in instruments.plates]
        if not indexed:
            return RelativeErrors(math.inf, math.inf, math.inf)
        each = [one for _, one in indexed]
        matrix = information_matrix(each, contributions.whitening(indexed))
        return _errors_of(matrix, parameter_columns(each).get((None, LOG_CONDUCTIVITY)))

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


def chance_of_uninformative(log_stds: Sequence[float], largest_ratio: float) -> float:
    """The chance that the 95 % interval has a larger ratio of its ends, over the diffusivities and the noise shown."""
    largest = math.log(largest_ratio) / (2.0 * _QUANTILE)
    exceeding = np.log(np.minimum(log_stds, 1e6) / np.float64(largest)) / _NOISE_LOG_STD
    return float(np.mean(scipy.special.ndtr(exceeding)))
