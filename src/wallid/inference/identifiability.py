"""Which parameters a record identifies: collinearity index, correlations, and a summary in words.

With `s_j` the whitened derivatives of the readings with respect to each parameter, the initial profile and the common
noise projected out within their priors::

    s~_j = s_j / |s_j|,      gamma_K = 1 / sqrt(min eigenvalue of S~_K' S~_K)

The collinearity index `gamma_K` of a subset K is the effect of a change of one parameter alone over that of the same
change along the subset's worst direction: 1 for orthogonal columns; above about 10 they cannot be distinguished.

Source: R. Brun, P. Reichert, H. R. Kuensch, Water Resour. Res. 37 (2001), 1015.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..case.case_definition import Case
from .gls_fit import GLSFit
from .likelihood import LOG_CONDUCTIVITY, LOG_DIFFUSIVITY, PLATE_GAIN, PROFILE_MODE
from .nuisance_kinds import CommonNoise, WallParameters
from .nuisance_parameters import describe_instrument_error
from .parameters import kind_of, target_of

COLLINEAR = 10.0
_LARGEST_SUBSET = 3
_MAX_PARAMETERS = 20  # with more, subsets of three are too many
_OTHER_KINDS = (CommonNoise.kind, PROFILE_MODE, LOG_CONDUCTIVITY, PLATE_GAIN)
_DESCRIPTIONS = {LOG_DIFFUSIVITY: "the diffusivity", LOG_CONDUCTIVITY: "the conductivity"}
_MAX_GROUPS = 2  # that a sentence names
_UNINFORMED = 0.9  # posterior over prior standard deviation: above, the record adds hardly any information


@dataclass(frozen=True, eq=False)
class Identifiability:
    """Which parameters a record identifies.

    Args:
        names: the parameters in words.
        singular_values: of the scaled sensitivity (by ln(alpha), other logarithms and prior standard deviations,
            over the noise), largest first.
        correlations: of the estimates, priors included.
        collinearity: index of each subset of two, three and all of them, by indices into `names`.
        posterior_prior_ratio: posterior over prior standard deviation; NaN for the diffusivity, which has no prior.
    """

    names: tuple[str, ...]
    singular_values: np.ndarray
    correlations: np.ndarray
    collinearity: dict[tuple[int, ...], float]
    posterior_prior_ratio: np.ndarray

    @property
    def overall_collinearity(self) -> float:
        """The collinearity index of all parameters together."""
        return self.collinearity.get(tuple(range(len(self.names))), 1.0)

    @property
    def collinear_subsets(self) -> list[tuple[int, ...]]:
        """The smallest subsets that cannot be distinguished, worst first."""
        smallest: list[tuple[int, ...]] = []
        for subset in sorted(self.collinearity, key=len):
            if self.collinearity[subset] > COLLINEAR and not any(set(one) <= set(subset) for one in smallest):
                smallest.append(subset)
        return sorted(smallest, key=lambda subset: -self.collinearity[subset])

    def __str__(self) -> str:
        sentences = [
            f"{self._list(subset)} cannot be distinguished by the readings alone "
            f"(collinearity index {_index(self.collinearity[subset])})"
            for subset in self.collinear_subsets[:_MAX_GROUPS]
        ]
        if more := len(self.collinear_subsets[_MAX_GROUPS:]):
            sentences.append(f"the same holds for {more} more group{'s' if more > 1 else ''} of these")
        ratios = zip(self.names, self.posterior_prior_ratio, strict=True)
        if uninformed := [name for name, ratio in ratios if ratio > _UNINFORMED]:
            sentences.append(f"for {_and(uninformed)} the record adds hardly any information to the prior")
        if sentences:
            return "; ".join(sentences)
        return (
            f"{_and(self.names)} are identifiable (collinearity index {_index(self.overall_collinearity)}; above "
            f"{COLLINEAR:g} one of them could replace the others)"
        )

    def _list(self, subset: tuple[int, ...]) -> str:
        return _and([self.names[index] for index in subset])


def _index(value: float) -> str:
    return f"{value:.2g}" if value < 100 else f"{value:.0f}" if value < 1e4 else "over 10000"


def _and(names) -> str:
    names = list(names)
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def collinearity_index(sensitivity: np.ndarray) -> float:
    """The collinearity index of the columns of a sensitivity matrix; infinite where they are linearly dependent.

    Args:
        sensitivity: `(reading, param)`.
    """
    size = np.linalg.norm(sensitivity, axis=0)
    if not np.all(np.isfinite(size)) or np.any(size == 0.0):
        return math.inf
    least = float(np.linalg.svd(sensitivity / size, compute_uv=False)[-1])
    return 1.0 / least if least > 1e-12 else math.inf


def identifiability(case: Case, fit: GLSFit) -> Identifiability:
    """Which parameters of a fit the record identifies: diffusivity, conductivity, instrument errors, the wall's own.

    The materials of a section are left out: the readings depend on their ratios only (`material_values`).
    """
    kinds = (LOG_DIFFUSIVITY, "sensor_offset", "sensor_position", "face_position")
    kinds = kinds if case.section is not None else (*kinds, WallParameters.kind)
    hidden = (WallParameters.kind,) if case.section is not None else ()
    extra = [kind for kind in dict.fromkeys(map(kind_of, fit.names)) if kind not in (*kinds, *hidden, *_OTHER_KINDS)]
    columns = fit.indices(*kinds, *extra, LOG_CONDUCTIVITY, PLATE_GAIN).tolist()
    S = _projected_sensitivity(fit, columns)
    order = range(len(columns))
    largest = min(_LARGEST_SUBSET, len(columns)) if len(columns) <= _MAX_PARAMETERS else min(2, len(columns))
    subsets = [subset for size in range(2, largest + 1) for subset in combinations(order, size)]
    subsets += [tuple(order)] if len(columns) > largest else []
    covariance = fit.covariance[np.ix_(columns, columns)]
    std = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    ratio = std.copy()
    ratio[0] = np.nan
    return Identifiability(
        names=tuple(_describe(fit.names[column]) for column in columns),
        singular_values=np.linalg.svd(S, compute_uv=False),
        correlations=covariance / np.outer(std, std),
        collinearity={subset: collinearity_index(S[:, list(subset)]) for subset in subsets},
        posterior_prior_ratio=ratio,
    )


def _projected_sensitivity(fit: GLSFit, columns: list[int]) -> np.ndarray:
    """The whitened derivatives with respect to some parameters, the others projected out within their priors."""
    J = fit.noise.whitening @ fit.readings_jacobian
    others = [column for column in range(J.shape[1]) if column not in columns]
    if not others:
        return J[:, columns]
    projected_out = np.concatenate([J[:, others], np.eye(len(others))])
    S = np.concatenate([J[:, columns], np.zeros((len(others), len(columns)))])
    return S - projected_out @ np.linalg.lstsq(projected_out, S, rcond=None)[0]


def _describe(name: str) -> str:
    """A parameter in words."""
    kind, target = kind_of(name), target_of(name).replace("_", " ")
    if name in _DESCRIPTIONS:
        return _DESCRIPTIONS[name]
    if kind != WallParameters.kind:
        return f"the {describe_instrument_error(name)}"
    part, _, which = target.partition(" ")
    return f"the conductivity of layer {which}" if part == "layer" else f"the film of the {which} face"
