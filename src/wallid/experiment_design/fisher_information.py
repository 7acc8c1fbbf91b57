"""What readings can tell: the Fisher information of a window, under the covariance that its interval will have.

    M = J' R^-1 J + P,      R = S S' + sum_f s_f^2 G_f G_f'

over `p = (ln(alpha), z)`, with z all that the estimate leaves free in units of its priors: the faces' common noise,
the initial profile's modes, offsets and position errors, with flux plates ln(conductivity) and their calibrations. `S`
holds the sensors' and plates' noise, `G_f` the readings' response to a face, both as stated; `P` is 1 for each z. No
reading is needed for it but the faces', so that sensors can be thought of where there are none; the plates' noise is
beside what fluxes they read, by the conductivity stated or that of mean fluxes.

A criterion makes one number of M (Kiefer's mean of its eigenvalues `m_i`, all in units of information)::

    D: (prod m_i)^(1/p)        A: p / sum(1 / m_i)        E: min m_i

Source: J. Kiefer, Ann. Stat. 2 (1974), 849; F. Pukelsheim, Optimal Design of Experiments (1993), 6.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from .._internal.errors import InputError
from .._internal.validation import one_of
from ..case.case_definition import Case
from ..case.wall_and_sensors import Sensor
from .information_contributions import Contribution, Whitening, whitened

Criterion = Literal["D", "A", "E"]
Of = Literal["diffusivity", "constants", "all"]
Robust = Literal["no", "expected", "worst"]

ROBUST_FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Of the prior: over these a robust design looks where nothing else is said."""
HOPELESS = 1e3
"""A relative standard error past which nothing is told."""
_NOTHING = 1e-12  # of the largest eigenvalue: no information along that direction


def check_words(criterion: str, of: str, robust: str) -> None:
    """Refuse unknown choices.

    Raises:
        InputError: which one.
    """
    one_of("criterion", criterion, ("D", "A", "E"))
    one_of("of", of, ("diffusivity", "constants", "all"))
    one_of("robust", robust, ("no", "expected", "worst"))


def alphas_of(case: Case, diffusivities: Sequence[float] | None, robust: str) -> tuple[float, ...]:
    """At which diffusivities a design looks, m2/s: the prior, and with a robust one up to four times as much and less.

    Raises:
        InputError: none, or one that is not above 0.
    """
    prior = case.wall.diffusivity_prior
    if diffusivities is None:
        # the prior comes first: it is what the words speak of
        others = [factor * prior for factor in ROBUST_FACTORS if factor != 1.0] if robust != "no" else []
        return (prior, *others)
    found = tuple(float(alpha) for alpha in diffusivities)
    if not found or not all(0.0 < alpha < math.inf for alpha in found):
        raise InputError(f"diffusivities = {list(found)}; at least one is needed, each above 0 m2/s")
    return found


def size(matrix: Float[np.ndarray, "param param"], criterion: Criterion) -> float:
    """One number for an information matrix, itself in units of information; 0 where a direction is not told."""
    eigenvalues = np.linalg.eigvalsh(0.5 * (matrix + matrix.T))
    if not np.all(np.isfinite(eigenvalues)) or eigenvalues[0] <= _NOTHING * max(eigenvalues[-1], 1e-300):
        return 0.0
    if criterion == "D":
        return float(np.exp(np.mean(np.log(eigenvalues))))
    return float(len(eigenvalues) / np.sum(1.0 / eigenvalues)) if criterion == "A" else float(eigenvalues[0])


def merit(sizes: Float[np.ndarray, "case candidate"], robust: Robust) -> Float[np.ndarray, " candidate"]:
    """Each candidate's criterion over the best one's, 1: at the first diffusivity, or over all of them.

    "expected" takes the geometric mean over the diffusivities, "worst" the smallest (Dette's standardised maximin).
    Source: H. Dette, J. R. Stat. Soc. B 59 (1997), 97.
    """
    largest = sizes.max(axis=1, keepdims=True)
    share = sizes / np.where(largest > 0, largest, 1.0)
    if robust == "no":
        return share[0]
    if robust == "worst":
        return share.min(axis=0)
    with np.errstate(divide="ignore"):
        return np.exp(np.mean(np.log(share), axis=0))


def fisher(seen: Sequence[Contribution], whitening: Whitening) -> Float[np.ndarray, "param param"]:
    """M over ln(alpha), what all sensors share, then each sensor's own, with the priors in."""
    white = whitened(seen, whitening)
    return white.T @ white + np.diag((np.arange(white.shape[1]) > 0).astype(float))


def on(matrix: Float[np.ndarray, "param param"], kept: list[int]) -> Float[np.ndarray, "kept kept"]:
    """The information on some parameters, the others projected out."""
    rest = [place for place in range(len(matrix)) if place not in kept]
    found = matrix[kept][:, kept]
    if not rest:
        return found
    mixed = matrix[kept][:, rest]
    return found - mixed @ np.linalg.solve(matrix[rest][:, rest], mixed.T)


def std_of(matrix: Float[np.ndarray, "param param"]) -> float:
    """The relative standard error of the diffusivity that an information leaves, 1."""
    on_log = float(on(matrix, [0])[0, 0])
    return 1.0 / math.sqrt(on_log) if on_log > HOPELESS**-2 else math.inf


def criterion_of(matrix: Float[np.ndarray, "param param"], criterion: Criterion, kept: list[int]) -> float:
    """The criterion of what M says of some parameters; of the diffusivity alone every one is its information."""
    found = on(matrix, kept)
    return max(float(found[0, 0]), 0.0) if len(kept) == 1 else size(found, criterion)


def kept(of: Of, seen: Sequence[Contribution]) -> list[int]:
    """The places in M of the parameters that a criterion is of."""
    shared, own = seen[0].shared.shape[1], sum(one.own.shape[1] for one in seen)
    if of == "all":
        return list(range(shared + own))
    return [0, *range(shared, shared + own)] if of == "constants" else [0]


def like(sensors: Sequence[Sensor], **given: float | None) -> Sensor:
    """A sensor as the case has them: the median of each of their standard deviations where none is given."""
    names = ("noise_std", "position_std", "offset_std")
    usual = {name: float(np.median([getattr(sensor, name) for sensor in sensors])) for name in names}
    found = {name: usual[name] if given.get(name) is None else given[name] for name in names}
    return replace(sensors[0], name="another", **found)
