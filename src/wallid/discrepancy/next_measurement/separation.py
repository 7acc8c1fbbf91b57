"""The probability that a future record names the right one of several explanations.

An explanation i predicts readings mu_i, with a Jacobian J_i and priors on its parameters. If i is true, the best fit of
an explanation j to the readings without noise leaves the whitened residual `r_ij`, with the prior residuals below it.
The penalised cost of j exceeds that of i, with noise, by

    Delta_ij = |r_ij|^2 - |r_ii|^2 + c_j - c_i - (q_j - q_i) + 2 (r_ij - r_ii)' eps,      eps ~ N(0, I)

where q is the trace of the matrix that projects the readings on the fitted ones: a fit with one parameter more gains 1
from the noise in the mean. The true one is named, and no other is an alternative, where `Delta_ij` exceeds the
criterion of every rival j. For one rival with `d^2 = |r_ij|^2` and criterion c that is

    P = Phi((d^2 - c) / (2 d))

A record of n times the length has the readings n times with the same parameters, and what grows with time, such as a
drift, goes on growing. The true effect differs from the fitted one by what the present record leaves open, delta
(`possible_truths`): its readings are `mu_i + J_i delta`. The weather differs from that of the present record
(`other_weather`).

Source: A. C. Atkinson, V. V. Fedorov, Biometrika 62 (1975), 57 (designs that discriminate between two models).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .other_weather import LeastSquaresInOtherWeather
from .possible_truths import PossibleTruths

_DRAWS = 3840  # of the noise: each half has every draw of the weather and of the true effect equally often


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
        names: of the parameters, `(param,)`.
        predicted: readings, K; or whitened ones, dimensionless, `(reading,)`.
        jacobian: derivative by each parameter, per unit, `(reading, param)`.
        values: of the parameters minus their prior means, `(param,)`.
        prior_std: of the parameters, infinite where there is no prior, `(param,)`.
        penalty: on `-2 log L`, for the positions, hours and temperatures that were searched.
        growth: of an effect that grows with time; None for none.
    """

    names: tuple[str, ...]
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

    def without(self, names: Collection[str]) -> Explanation:
        """The same without some of its parameters, which keep their values."""
        kept = np.array([name not in names for name in self.names])
        growth = self.growth if self.growth is None else self.growth._replace(jacobian=self.growth.jacobian[:, kept])
        return replace(
            self,
            names=tuple(name for name in self.names if name not in names),
            jacobian=self.jacobian[:, kept],
            values=self.values[kept],
            prior_std=self.prior_std[kept],
            growth=growth,
        )

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
        blocks = np.tile(blocks, math.ceil(length))
        self._problem = LeastSquaresInOtherWeather(explanation.slopes(length), blocks, length)

    @property
    def readings(self) -> int:
        """The number of readings; the rows of the priors follow them."""
        return len(self.explanation.predicted) * math.ceil(self.length)

    def residual(self, true: Explanation) -> Float[np.ndarray, " row"]:
        """The residual of the best fit to the readings of a true explanation, with the prior residuals below."""
        return self._problem.residual(self._misfit(true))

    @property
    def fitted_directions(self) -> float:
        """The trace of the matrix that projects the readings on the fitted ones: less than the parameters by priors."""
        return self._problem.trace_of_projection(self.readings)

    def squared_residuals(self, true: Explanation, truths: PossibleTruths) -> Float[np.ndarray, " draw"]:
        """The squared residual in each draw of the weather and of what the true effect may be."""
        columns = [true.names.index(name) for name in truths.names]
        changes = np.concatenate([root * true.jacobian_in(k)[:, columns] for k, root in _parts(self.length)])
        changes = np.pad(changes, ((0, len(self.explanation.values)), (0, 0)))
        products = self._problem.inner_products(np.column_stack([self._misfit(true), changes]))
        weights = np.column_stack([np.ones(len(truths.draws)), truths.draws])
        return np.maximum(np.einsum("ti,wij,tj->wt", weights, products, weights), 0.0).ravel()

    def _misfit(self, true: Explanation) -> Float[np.ndarray, " row"]:
        own = self.explanation
        parts = [root * (true.predicted_in(k) - own.predicted_in(k)) for k, root in _parts(self.length)]
        return np.concatenate([*parts, -own.values / own.prior_std])


@dataclass(frozen=True, eq=False)
class Separation:
    """How the rivals of a true explanation fall behind it.

    Args:
        excess: of each rival's penalised cost without noise and without the penalties, in each draw of the weather and
            of the true effect, `(draw, rival)`.
        cosine: between the directions in which the noise changes each two of them, `(rival, rival)`.
        penalties: of each rival minus that of the true one, less what the noise gives to its further parameters,
            `(rival,)`.
    """

    excess: np.ndarray
    cosine: np.ndarray
    penalties: np.ndarray

    def probability(self, criteria: Float[np.ndarray, " rival"]) -> float:
        """The probability that the true one is named and no rival is an alternative.

        Args:
            criteria: the excess of the penalised cost that each rival must have.
        """
        random = np.random.default_rng(0)
        value, vector = np.linalg.eigh(self.cosine)
        noise = random.standard_normal((_DRAWS // 2, len(value))) @ (vector * np.sqrt(np.maximum(value, 0.0))).T
        excess = np.resize(self.excess, (_DRAWS, len(value)))  # one draw after the other
        with_noise = excess + 2.0 * np.sqrt(np.maximum(excess, 0.0)) * np.concatenate([noise, -noise]) + self.penalties
        return float(np.mean(np.all(with_noise > criteria, axis=1)))


def separation(true: FitWithoutNoise, rivals: Sequence[FitWithoutNoise], truths: PossibleTruths) -> Separation:
    """How rivals fall behind a true explanation.

    Args:
        true: the fit of the true explanation.
        rivals: those of the others, to the same record.
        truths: what the true effect may be.
    """
    own = true.squared_residuals(true.explanation, truths)
    excess = np.array([rival.squared_residuals(true.explanation, truths) - own for rival in rivals])
    own_residual = true.residual(true.explanation)[: true.readings]
    directions = np.array([rival.residual(true.explanation)[: true.readings] - own_residual for rival in rivals])
    directions = directions.reshape(len(rivals), true.readings)
    own_penalty = true.explanation.penalty - true.fitted_directions
    penalties = np.array([rival.explanation.penalty - rival.fitted_directions - own_penalty for rival in rivals])
    return Separation(excess.reshape(len(rivals), len(own)).T, cosines(directions @ directions.T), penalties)


def cosines(inner: Float[np.ndarray, "rival rival"]) -> Float[np.ndarray, "rival rival"]:
    """The cosines of inner products; a direction of no length is orthogonal to the others."""
    length = np.sqrt(np.diag(inner))
    cosine = inner / np.maximum(np.outer(length, length), 1e-300)
    cosine[np.diag_indices(len(cosine))] = 1.0
    return cosine
