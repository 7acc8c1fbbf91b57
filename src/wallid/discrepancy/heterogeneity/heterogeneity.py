"""The evidence of a record for the pattern of a section, and its size.

With `s` the size of the pattern (0 a homogeneous wall, 1 the section as it is stated), the residual `r` of the
homogeneous wall is normal,

    r ~ N(s m, R + s^2 C C')

with the mean `m` and the components `C` of the pattern, and the noise R. All other parameters of the final model, those
of its effects among them, are projected out within their priors. The size is the likeliest s; its standard deviation
follows from the curvature there. The evidence compares the final models in both walls, each with the effects that it
needs:

    E = D(homogeneous) - D(section),      D = -2 log L + log det R + log det(1 + C' R^-1 C) + prices of effects

with the price of an effect the gain that chance alone gives to the search for it. So an effect of a sensor or a face is
not taken for stones, nor stones for an effect.

Source: H. Rue, L. Held, Gaussian Markov Random Fields (2005), 2 (marginal likelihoods of normal effects).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from ..._internal.arrays import on_device
from ..._internal.number_formats import value_and_std
from ...inference.parameters import Parameters
from ...inference.sensor_heights import HEIGHT_KIND
from ..effect_fit import EffectFit
from ..selection.acceptance import RIVAL, penalised_cost

_LARGEST = 5.0  # size that is searched
_STEP = 1e-3  # of the size, for the curvature
_FAR = 3.0  # standard deviations of the size from 1, from which the section is not as it is stated


@dataclass(frozen=True)
class Heterogeneity:
    """The pattern of a section as a record shows it.

    Args:
        size: of the pattern; 1 as stated.
        std: standard deviation of the size; infinite where the record does not determine it.
        evidence: drop of -2 log L from the homogeneous wall to the stated section, each with its effects.
        p_value: of a homogeneous wall, against the likeliest size.
    """

    size: float
    std: float
    evidence: float
    p_value: float

    @property
    def is_clear(self) -> bool:
        """Whether the record shows the section, as it is stated."""
        return self.evidence > RIVAL and abs(self.size - 1.0) < _FAR * self.std

    @property
    def is_contradicted(self) -> bool:
        """Whether the record shows that the wall is not as the section says."""
        return self.evidence < -RIVAL

    @property
    def label(self) -> str:
        """The pattern with its size, as text."""
        return f"heterogeneity of {self._size_text}"

    @property
    def _size_text(self) -> str:
        return value_and_std(self.size, self.std, "") if math.isfinite(self.std) else f"{self.size:.2g} or more"

    def __str__(self) -> str:
        return (
            f"heterogeneity: size {self._size_text} (1: the section as stated); "
            f"-2 log L drops by {self.evidence:.1f} from a homogeneous wall"
        )


def compare_walls(
    with_section: EffectFit, homogeneous: EffectFit, prices: tuple[float, float] = (0.0, 0.0)
) -> Heterogeneity:
    """The evidence for a section against a homogeneous wall, and the size of its pattern.

    Args:
        with_section: the final model with the section's pattern. homogeneous: that without it.
        prices: of the effects of each, in -2 log L.
    """
    likelihood = _SizeLikelihood(with_section)
    found = scipy.optimize.minimize_scalar(likelihood, bounds=(0.0, _LARGEST), method="bounded")
    size, none = float(found.x), likelihood(0.0)
    at_bound = size > _LARGEST - 0.01
    curvature = (likelihood(size + _STEP) - 2.0 * likelihood(size) + likelihood(abs(size - _STEP))) / _STEP**2
    return Heterogeneity(
        size=size,
        std=math.sqrt(2.0 / curvature) if curvature > 0.0 and not at_bound else math.inf,
        evidence=_deviance(homogeneous)
        + prices[1]
        - _deviance(with_section)
        - prices[0]
        - likelihood.log_determinant(1.0),
        p_value=0.5 * float(scipy.special.chdtrc(1, max(none - likelihood(size), 0.0))),  # the size is not negative
    )


def _deviance(fit: EffectFit) -> float:
    """`-2 log L` with the determinant of the noise and the penalties of the effects."""
    return penalised_cost(fit) - 2.0 * float(np.log(np.diag(fit.noise.whitening)).sum())


class _SizeLikelihood:
    """-2 log L of the size, all other parameters projected out."""

    def __init__(self, fit: EffectFit):
        problem, parameters = fit.problem, fit.parameters
        pattern = problem.model.pattern
        assert pattern is not None
        self.own = np.array([fit.index(name) for name in parameters.of_kind(HEIGHT_KIND)], int)
        others = np.setdiff1d(np.arange(fit.jacobian.shape[1]), self.own)
        readings = len(fit.noise.whitening)
        kept = np.concatenate([np.arange(readings), readings + others])  # the readings, and the others' priors
        scale = np.maximum(np.linalg.norm(fit.jacobian[np.ix_(kept, others)], axis=0), 1e-300)
        self.basis, _ = np.linalg.qr(fit.jacobian[np.ix_(kept, others)] / scale)
        mean = fit.noise.whitening @ _binned_change(fit, parameters.with_values(dict.fromkeys(self._names(fit), 0.0)))
        components = fit.jacobian[np.ix_(kept, self.own)]
        amplitudes = np.asarray(parameters.values)[parameters.indices(self._names(fit))]
        residual = fit.residual[kept] + components @ amplitudes
        padded = np.pad(mean, (0, len(others)))
        self.mean, self.residual = self._projected(padded), self._projected(residual + padded)
        self.components = (
            np.stack([self._projected(column) for column in components.T], axis=1) if len(self.own) else None
        )

    @staticmethod
    def _names(fit: EffectFit) -> tuple[str, ...]:
        return fit.parameters.of_kind(HEIGHT_KIND)

    def _projected(self, rows: np.ndarray) -> np.ndarray:
        return rows - self.basis @ (self.basis.T @ rows)

    @cached_property
    def _decomposed(self) -> tuple[np.ndarray, np.ndarray]:
        """The components' directions, and the square of their length in each."""
        if self.components is None:
            return np.zeros((len(self.residual), 0)), np.zeros(0)
        directions, lengths, _ = np.linalg.svd(self.components, full_matrices=False)
        return directions, lengths**2

    def __call__(self, size: float) -> float:
        directions, squared = self._decomposed
        rest = self.residual - size * self.mean
        along, variance = directions.T @ rest, 1.0 + size**2 * squared
        return float(np.log(variance).sum() + rest @ rest - (along**2) @ (1.0 - 1.0 / variance))

    def log_determinant(self, size: float) -> float:
        """`log det(1 + s^2 C' R^-1 C)`: what the amplitudes' priors cost."""
        return float(np.log1p(size**2 * self._decomposed[1]).sum())


def _binned_change(fit: EffectFit, parameters: Parameters) -> np.ndarray:
    """The pattern's change of the binned readings at some parameters."""
    model, bins = fit.problem.model, fit.problem.bins
    return np.asarray(bins.mean(on_device(np.asarray(model.change_by_pattern(parameters)))))
