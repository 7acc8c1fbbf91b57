"""The probability that a future record names the right one of several explanations.

An explanation i predicts readings mu_i, with a Jacobian J_i and priors on its parameters. If i is true, the best fit of
an explanation j to the readings without noise leaves the whitened residual `r_ij`, with the prior residuals below it.
The penalised cost of j exceeds that of i, with noise, by

    Delta_ij = |r_ij|^2 - |r_ii|^2 + c_j - c_i + 2 (r_ij - r_ii)' eps,      eps ~ N(0, I)

because what the noise adds to both fits is nearly the same. The true one is named, and no other is an alternative,
where `Delta_ij` exceeds the criterion of every rival j. For one rival with `d^2 = |r_ij|^2` and criterion c that is

    P = Phi((d^2 - c) / (2 d))

A record of n times the length has the readings n times with the same parameters, and what grows with time, such as a
drift, goes on growing. The true size differs from the fitted one by its uncertainty; a size of s times the fitted one
has s times the residual. The weather differs from that of the present record, and with it the excess (`other_weather`).

Source: A. C. Atkinson, V. V. Fedorov, Biometrika 62 (1975), 57 (designs that discriminate between two models).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .other_weather import LeastSquaresInOtherWeather

_DRAWS = 4000
_MOST_RATIO = 20.0  # of an excess in other weather: where it is nearly nothing, the ratio says nothing


class Growth(NamedTuple):
    """What an effect that grows with time adds from one length of the record to the next.

    Args:
        predicted: to the readings, K, `(reading,)`.
        jacobian: to their derivatives, K per unit, `(reading, param)`.
    """

    predicted: np.ndarray
    jacobian: np.ndarray


@dataclass(frozen=True, eq=False)
class Explanation:
    """The readings that one explanation predicts, linear in its parameters.

    Args:
        predicted: readings, K; or whitened ones, dimensionless, `(reading,)`.
        jacobian: derivative by each parameter, per unit, `(reading, param)`.
        values: of the parameters minus their prior means, `(param,)`.
        prior_std: of the parameters, infinite where there is no prior, `(param,)`.
        penalty: on `-2 log L`, for the positions, hours and temperatures that were searched.
        growth: of an effect that grows with time; None for none.
    """

    predicted: np.ndarray = field(repr=False)
    jacobian: np.ndarray = field(repr=False)
    values: np.ndarray
    prior_std: np.ndarray
    penalty: float = 0.0
    growth: Growth | None = field(default=None, repr=False)

    def whitened(self, whitening: Float[np.ndarray, "reading reading"]) -> Explanation:
        """The same for the readings times W, with `W' W` the inverse covariance of the readings."""
        return self.mapped(lambda readings: readings @ whitening.T)

    def mapped(self, function: Callable[[np.ndarray], np.ndarray]) -> Explanation:
        """The same for a linear function of the readings, such as their means; it maps `(*, reading)`."""
        growth = self.growth
        if growth is not None:
            growth = Growth(function(growth.predicted), function(growth.jacobian.T).T)
        predicted, jacobian = function(self.predicted), function(self.jacobian.T).T
        return replace(self, predicted=predicted, jacobian=jacobian, growth=growth)

    def std(self, param: int, length: float) -> float:
        """The expected standard error of a parameter, by its index, from whitened readings; `length` as before."""
        slopes = self.slopes(length)
        size = np.maximum(np.linalg.norm(slopes, axis=0), 1e-300)
        return float(np.linalg.norm(np.linalg.pinv(slopes / size, rcond=1e-10)[param]) / size[param])

    def slopes(self, length: float) -> Float[np.ndarray, "row param"]:
        """The derivatives in a record of a length, with the rows of the priors below."""
        parts = [root * self.jacobian_in(k) for k, root in _parts(length)]
        return np.concatenate([*parts, np.diag(1.0 / self.prior_std)])

    def predicted_in(self, k: int) -> Float[np.ndarray, " reading"]:
        """The readings in the length k of a longer record."""
        return self.predicted if self.growth is None else self.predicted + k * self.growth.predicted

    def jacobian_in(self, k: int) -> Float[np.ndarray, "reading param"]:
        """Their derivatives."""
        return self.jacobian if self.growth is None else self.jacobian + k * self.growth.jacobian


def _parts(length: float) -> Iterator[tuple[int, float]]:
    """The number of each length of a longer record, and the root of its share: the last may be a part."""
    return ((k, math.sqrt(min(length - k, 1.0))) for k in range(math.ceil(length)))


class FitWithoutNoise:
    """The best fits of one explanation to readings without noise that others predict for the next record.

    Args:
        explanation: whitened.
        length: of the record, in lengths of that of the readings.
        blocks: of days, to which each reading belongs (`blocks_of_days`), the same in each length.
    """

    def __init__(self, explanation: Explanation, length: float, blocks: Int[np.ndarray, " reading"]):
        self.explanation, self.length = explanation, length
        self._problem = LeastSquaresInOtherWeather(explanation.slopes(length), np.tile(blocks, math.ceil(length)))

    @property
    def readings(self) -> int:
        """The number of readings; the rows of the priors follow them."""
        return len(self.explanation.predicted) * math.ceil(self.length)

    def residuals(self, true: Explanation) -> tuple[Float[np.ndarray, " row"], Float[np.ndarray, " draw"]]:
        """The residual of the best fit to the readings of a true explanation, with the prior residuals below.

        Also its square in each draw of the weather, which is the same in each length of the record.
        """
        own = self.explanation
        parts = [root * (true.predicted_in(k) - own.predicted_in(k)) for k, root in _parts(self.length)]
        misfit = np.concatenate([*parts, -own.values / own.prior_std])
        return self._problem.residual(misfit), self._problem.squared_residuals(misfit)


@dataclass(frozen=True, eq=False)
class Separation:
    """How the rivals of a true explanation fall behind it.

    Args:
        excess: expected excess of each rival's penalised cost at the fitted size, without the penalties, `(rival,)`.
        inner: inner products of the residuals' differences, which give the covariance of the excess, `(rival, rival)`.
        penalties: of each rival minus that of the true one, `(rival,)`.
        weather: the excess in other weather over that in the present weather, `(draw, rival)`.
    """

    excess: np.ndarray
    inner: np.ndarray
    penalties: np.ndarray
    weather: np.ndarray

    def with_excess(self, excess: Float[np.ndarray, " rival"], weather: Float[np.ndarray, "draw rival"]) -> Separation:
        """The same directions of the residuals with other squared distances, and their ratios in other weather.

        A rival whose expected excess is not positive has the length of its own direction as the distance so far; one
        without a direction keeps none.
        """
        distance = np.where(self.excess > 0.0, self.excess, np.diag(self.inner))
        has_direction = np.diag(self.inner) > 0.0
        factor = np.sqrt(np.maximum(excess, 0.0) / np.where(has_direction, distance, 1.0))
        return replace(self, excess=excess, inner=self.inner * np.outer(factor, factor), weather=weather)

    def probability(self, criteria: Float[np.ndarray, " rival"], relative_std: float) -> float:
        """The probability that the excess of every rival is over its criterion.

        Args:
            criteria: the excess of the penalised cost that each rival must have.
            relative_std: standard deviation of the true size over the fitted size.
        """
        if not len(self.excess):
            return 1.0
        random = np.random.default_rng(0)
        value, vector = np.linalg.eigh(self.inner)
        root = vector * np.sqrt(np.maximum(value, 0.0))
        noise = random.standard_normal((_DRAWS // 2, len(value))) @ root.T
        sizes = 1.0 + relative_std * random.standard_normal((_DRAWS // 2, 1))
        sizes, noise = np.concatenate([sizes, sizes]), np.concatenate([noise, -noise])
        weather = np.resize(self.weather, noise.shape)  # one draw of the weather after the other
        excess = sizes**2 * weather * self.excess + 2.0 * sizes * np.sqrt(weather) * noise + self.penalties
        return float(np.mean(np.all(excess > criteria, axis=1)))


def separation(true: FitWithoutNoise, rivals: Sequence[FitWithoutNoise]) -> Separation:
    """How rivals fall behind a true explanation.

    Args:
        true: the fit of the true explanation.
        rivals: those of the others, to the same record.
    """
    own, own_squares = true.residuals(true.explanation)
    of_rivals = [rival.residuals(true.explanation) for rival in rivals]
    rests = [rest for rest, _ in of_rivals]
    excess = np.array([rest @ rest - own @ own for rest in rests])
    differences = np.array([rest[: true.readings] - own[: true.readings] for rest in rests])
    differences = differences.reshape(len(rivals), true.readings)
    penalties = np.array([rival.explanation.penalty - true.explanation.penalty for rival in rivals])
    in_draws = np.array([squares - own_squares for _, squares in of_rivals])
    weather = ratio_of_excess(in_draws.reshape(len(rivals), len(own_squares)).T, excess)
    return Separation(excess, differences @ differences.T, penalties, mean_weather(weather, true.length))


def ratio_of_excess(
    in_draws: Float[np.ndarray, "draw rival"], excess: Float[np.ndarray, " rival"]
) -> Float[np.ndarray, "draw rival"]:
    """The excess in each draw of the weather over that in the present weather; 1 where that is nothing."""
    ratio = in_draws / np.where(excess > 0.0, excess, np.inf)
    return np.where(excess > 0.0, np.clip(ratio, 0.0, _MOST_RATIO), 1.0)


def mean_weather(ratio: Float[np.ndarray, "draw rival"], length: float) -> Float[np.ndarray, "draw rival"]:
    """The ratio in a record of some lengths, each of which has weather of its own: it varies less by the root of it."""
    return np.maximum(1.0 + (ratio - 1.0) / math.sqrt(length), 0.0)
