"""How much the weather of the next record may tell: days of the present one, weighted at random.

The next campaign has other weather than the present one, and what a record tells grows with the changes of its weather.
The present record shows how much days differ. Its blocks of four days, which are about as long as weather lasts, get
random weights of mean 1. Each draw of the weights stands for one other campaign. With the weights w_b of the blocks b,
the whitened misfit m of an explanation and its derivatives Z, the squared residual is

    |r|^2 = min_beta sum_b w_b |m_b - Z_b beta|^2 + the terms of the priors

The weights are n times those of a Dirichlet distribution, whose concentration is 0.3. The total of a quantity over the
blocks then has a little more than twice the variance that the blocks' own spread gives: the next campaign is one draw
from the climate, and so is the present one, by which it is judged. A next campaign of L times the length has 1 / L of
the variance of its own, so the weights differ from 1 by `sqrt((1 + 1 / L) / 2)` of that.

Source: D. B. Rubin, The Bayesian bootstrap, Ann. Stat. 9 (1981), 130.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

_DAYS_IN_A_BLOCK = 4.0
_FEWEST_BLOCKS = 3
_CONCENTRATION = 0.3
_DRAWS = 24
_RCOND = 1e-10  # of the derivatives: what is smaller cannot be distinguished
_RIDGE = 1e-12  # of the normal matrices, whose parameters may depend on a block of nearly no weight

SAME_WEATHER = -1
"""The block of what tells the same in any weather."""


def blocks_of_days(readings: int, instruments: int, days: float) -> Int[np.ndarray, " reading"]:
    """The block of days to which each reading belongs; all `SAME_WEATHER` in a record of less than three days.

    Args:
        readings: number of means over bins, instrument by instrument.
        instruments: number of sensors and plates.
        days: length of the record.
    """
    blocks = max(round(days / _DAYS_IN_A_BLOCK), min(int(days), _FEWEST_BLOCKS))
    if blocks < _FEWEST_BLOCKS:
        return np.full(readings, SAME_WEATHER)
    bins = readings // instruments
    return np.tile(np.arange(bins) * blocks // bins, instruments)


def weights_of_blocks(blocks: int, length: float) -> Float[np.ndarray, "draw block"]:
    """The weights of blocks of days in each draw, of mean 1 over the blocks.

    Args:
        blocks: their number in the present record.
        length: of the next record, in lengths of the present one.
    """
    drawn = np.random.default_rng(0).dirichlet(np.full(max(blocks, 1), _CONCENTRATION), _DRAWS)[:, :blocks]
    return 1.0 + math.sqrt(0.5 * (1.0 + 1.0 / length)) * (blocks * drawn - 1.0)


class LeastSquaresInOtherWeather:
    """A linear least-squares problem whose rows have the weights of their blocks of days.

    Args:
        slopes: derivative of the whitened readings by each parameter, with the rows of the priors below,
            `(row, param)`.
        blocks: of each reading; the priors are the same in any weather, `(reading,)`.
        length: of the next record, in lengths of the present one.
    """

    def __init__(self, slopes: Float[np.ndarray, "row param"], blocks: Int[np.ndarray, " reading"], length: float):
        size = np.maximum(np.linalg.norm(slopes, axis=0), 1e-300)
        left, value, _ = np.linalg.svd(slopes / size, full_matrices=False)
        self._basis = left[:, value > _RCOND * value.max(initial=0.0)]
        self._blocks = np.pad(blocks, (0, len(slopes) - len(blocks)), constant_values=SAME_WEATHER)
        self._length = length

    def residual(self, misfit: Float[np.ndarray, " row"]) -> Float[np.ndarray, " row"]:
        """The residual of the best fit to a misfit in the present weather."""
        return misfit - self._basis @ (self._basis.T @ misfit)

    def trace_of_projection(self, readings: int) -> float:
        """The trace of the projection on the slopes, over the first rows, which are readings."""
        return float(np.sum(self._basis[:readings] ** 2))

    def inner_products(self, misfits: Float[np.ndarray, "row misfit"]) -> Float[np.ndarray, "draw misfit misfit"]:
        """The inner products of the residuals of the best fits to several misfits, in each draw of the weather.

        That of a misfit with itself is its squared residual. For the misfits M, the basis B and the weights w
        these are the Schur complement `M' w M - M' w B (B' w B)^-1 B' w M`.
        """
        weights, normal_matrices = self._weights_and_normal_matrices
        slopes = np.stack([self._basis[rows].T @ misfits[rows] for rows in self._rows])
        products = np.stack([misfits[rows].T @ misfits[rows] for rows in self._rows])
        weighted = np.tensordot(weights, slopes, axes=1)
        steps = np.linalg.solve(normal_matrices, weighted)
        return np.tensordot(weights, products, axes=1) - np.swapaxes(weighted, 1, 2) @ steps

    @cached_property
    def _rows(self) -> list[np.ndarray]:
        """The rows of the same weather, then those of each block."""
        return [np.flatnonzero(self._blocks == one) for one in range(SAME_WEATHER, int(self._blocks.max()) + 1)]

    @cached_property
    def _weights_and_normal_matrices(self) -> tuple[np.ndarray, np.ndarray]:
        """The weights, `(draw, rows)`, and in the orthonormal basis the normal matrices, `(draw, param, param)`."""
        of_blocks = weights_of_blocks(len(self._rows) - 1, self._length)
        weights = np.column_stack([np.ones(len(of_blocks)), of_blocks])
        grams = np.stack([self._basis[rows].T @ self._basis[rows] for rows in self._rows])
        return weights, np.tensordot(weights, grams, axes=1) + _RIDGE * np.eye(self._basis.shape[1])
