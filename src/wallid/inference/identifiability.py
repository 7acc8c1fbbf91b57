"""Which parameters a record tells apart, and a plain sentence on what it cannot give.

With `s_j` the readings' derivatives by each parameter, whitened, what the initial profile and the shared noise could
take up projected out (their priors kept)::

    s~_j = s_j / |s_j|,      gamma_K = 1 / sqrt(min eigenvalue of S~_K' S~_K)

The collinearity index `gamma_K` of a subset K is how many times less a change along its worst direction shows than the
same change of one parameter alone: 1 where they are orthogonal; past 10 or so they cannot be told apart.

Source: R. Brun, P. Reichert, H. R. Kuensch, Water Resour. Res. 37 (2001), 1015.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..case.case_definition import Case
from .gls_fit import GLSFit
from .nuisance_parameters import instrument_errors_of

COLLINEAR = 10.0
_LARGEST_SUBSET = 3
_MOST_PARAMETERS = 20  # subsets of three of more are too many to go through, or to read
_CONSTANTS = {"offsets": "offset", "positions": "position", "face_positions": "place"}
_SAID = 2  # groups that a sentence names
_NOT_TOLD = 0.9  # of a prior's standard deviation that is left


@dataclass(frozen=True, eq=False)
class Identifiability:
    """Which parameters a record tells apart.

    Args:
        names: of the parameters.
        singular_values: of the scaled sensitivity (by ln(alpha), other logarithms and prior standard deviations,
            over the noise), largest first.
        correlations: of the estimates, priors counted.
        collinearity: of subsets of two, three and all of them, by places in `names`.
        left: the standard deviation that is left over that of the prior, 1; NaN for the diffusivity, which has none.
    """

    names: tuple[str, ...]
    singular_values: np.ndarray
    correlations: np.ndarray
    collinearity: dict[tuple[int, ...], float]
    left: np.ndarray

    @property
    def worst(self) -> float:
        """The collinearity index of all of them."""
        return self.collinearity.get(tuple(range(len(self.names))), 1.0)

    @property
    def confused(self) -> list[tuple[int, ...]]:
        """The smallest subsets that cannot be told apart, worst first."""
        found: list[tuple[int, ...]] = []
        for subset in sorted(self.collinearity, key=len):
            if self.collinearity[subset] > COLLINEAR and not any(set(one) <= set(subset) for one in found):
                found.append(subset)
        return sorted(found, key=lambda subset: -self.collinearity[subset])

    def __str__(self) -> str:
        told = [
            f"{self._list(subset)} cannot be told apart by the readings alone "
            f"(collinearity index {_index(self.collinearity[subset])})"
            for subset in self.confused[:_SAID]
        ]
        if more := len(self.confused[_SAID:]):
            told.append(f"nor can {more} more group{'s' if more > 1 else ''} of these")
        nothing = [name for name, left in zip(self.names, self.left, strict=True) if left > _NOT_TOLD]
        if nothing:
            told.append(f"of {_and(nothing)} the record tells hardly more than was assumed")
        if told:
            return "; ".join(told)
        return f"{_and(self.names)} are told apart (collinearity index {_index(self.worst)})"

    def _list(self, subset: tuple[int, ...]) -> str:
        return _and([self.names[place] for place in subset])


def _index(value: float) -> str:
    return f"{value:.2g}" if value < 100 else f"{value:.0f}" if value < 1e4 else "over 10000"


def _and(names) -> str:
    names = list(names)
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def collinearity_index(sensitivity: np.ndarray) -> float:
    """gamma of the columns of a sensitivity matrix; infinite where one is 0 or they are dependent."""
    size = np.linalg.norm(sensitivity, axis=0)
    if not np.all(np.isfinite(size)) or np.any(size == 0.0):
        return math.inf
    least = float(np.linalg.svd(sensitivity / size, compute_uv=False)[-1])
    return 1.0 / least if least > 1e-12 else math.inf


def identifiability(case: Case, settled: GLSFit) -> Identifiability:
    """Which of a settled estimate's parameters the record tells apart."""
    names = settled.names
    told = [0, *(1 + k for k in range(names.of_structure.stop))]
    words = ["the diffusivity"]
    words += [f"the {_CONSTANTS[one.kind]} of {one.of}" for one in instrument_errors_of(case, names)]
    words += [_of_wall(name) for name in names.structure]
    if names.fluxes:
        told += range(1 + names.conductivity, 1 + names.count)
        words += ["the conductivity", *(f"the calibration of the {face} plate" for face in names.fluxes)]
    S = _told_alone(settled, told)
    places = range(len(told))
    largest = min(_LARGEST_SUBSET, len(told)) if len(told) <= _MOST_PARAMETERS else min(2, len(told))
    subsets = [subset for size in range(2, largest + 1) for subset in combinations(places, size)]
    subsets += [tuple(places)] if len(told) > largest else []
    spread = settled.covariance[np.ix_(told, told)]
    std = np.sqrt(np.maximum(np.diag(spread), 1e-300))
    left = std.copy()
    left[0] = np.nan
    return Identifiability(
        names=tuple(words),
        singular_values=np.linalg.svd(S, compute_uv=False),
        correlations=spread / np.outer(std, std),
        collinearity={subset: collinearity_index(S[:, list(subset)]) for subset in subsets},
        left=left,
    )


def _told_alone(settled: GLSFit, told: list[int]) -> np.ndarray:
    """The whitened derivatives by some parameters, without what the others (within their priors) could take up."""
    J = settled.noise.whiten @ np.asarray(settled.minimum.jacobian)
    others = [place for place in range(J.shape[1]) if place not in told]
    if not others:
        return J[:, told]
    taken = np.concatenate([J[:, others], np.eye(len(others))])
    wanted = np.concatenate([J[:, told], np.zeros((len(others), len(told)))])
    return wanted - taken @ np.linalg.lstsq(taken, wanted, rcond=None)[0]


def _of_wall(name: str) -> str:
    kind, _, place = name.replace("_", " ").partition(" ")
    return f"the conductivity of layer {place}" if kind == "layer" else f"the film of the {place} face"
