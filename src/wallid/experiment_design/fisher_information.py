"""The Fisher information matrix of a window, and the design criteria computed from it.

    M = J' R^-1 J + P,      R = S S' + sum_f s_f^2 G_f G_f'

The parameters are `p = (ln(alpha), z)`. The nuisance parameters z are in units of their prior standard deviations: the
faces' common noise, the modes of the initial profile, offsets and position errors; with flux plates also
ln(conductivity) and the plates' calibration errors. `S` holds the noise of sensors and plates and `G_f` the response of
the readings to a face temperature, both as stated in the case. `P` is 1 for each z and 0 for ln(alpha). Only the face
temperatures of the record are used, so M can be computed for sensors that do not exist yet.

A criterion reduces M to one number (Kiefer's mean of its eigenvalues `m_i`, in units of information)::

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
from .information_contributions import Contribution, Whitening, parameter_columns, whitened

Criterion = Literal["D", "A", "E"]
ParametersOfInterest = Literal["diffusivity", "constants", "all"]
Robust = Literal["no", "expected", "worst"]

ROBUST_FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Default diffusivities of a robust design, relative to the prior."""
UNINFORMATIVE_STD = 1e3
"""A relative standard error of the diffusivity above which a window counts as uninformative."""
_RANK_TOLERANCE = 1e-12  # relative to the largest eigenvalue; a smaller one means no information in that direction


def check_choices(criterion: str, of: str, robust: str) -> None:
    """Check the names of the design options.

    Raises:
        InputError: an option has an unknown value.
    """
    one_of("criterion", criterion, ("D", "A", "E"))
    one_of("of", of, ("diffusivity", "constants", "all"))
    one_of("robust", robust, ("no", "expected", "worst"))


def design_diffusivities(case: Case, diffusivities: Sequence[float] | None, robust: str) -> tuple[float, ...]:
    """The diffusivities at which a design is evaluated, m2/s.

    Args:
        diffusivities: m2/s; None for the prior, and for a robust design also `ROBUST_FACTORS` times the prior.

    Returns:
        the diffusivities; the first is the nominal one.

    Raises:
        InputError: the list is empty, or a diffusivity is not positive.
    """
    prior = case.wall.diffusivity_prior
    if diffusivities is None:
        # the prior comes first: the printed summary refers to the first diffusivity
        others = [factor * prior for factor in ROBUST_FACTORS if factor != 1.0] if robust != "no" else []
        return (prior, *others)
    alphas = tuple(float(alpha) for alpha in diffusivities)
    if not alphas or not all(0.0 < alpha < math.inf for alpha in alphas):
        raise InputError(f"diffusivities = {list(alphas)}; at least one is needed, each above 0 m2/s")
    return alphas


def criterion_value(matrix: Float[np.ndarray, "param param"], criterion: Criterion) -> float:
    """The D-, A- or E-criterion of an information matrix, in units of information; 0 for a singular matrix."""
    eigenvalues = np.linalg.eigvalsh(0.5 * (matrix + matrix.T))
    if not np.all(np.isfinite(eigenvalues)) or eigenvalues[0] <= _RANK_TOLERANCE * max(eigenvalues[-1], 1e-300):
        return 0.0
    if criterion == "D":
        return float(np.exp(np.mean(np.log(eigenvalues))))
    return float(len(eigenvalues) / np.sum(1.0 / eigenvalues)) if criterion == "A" else float(eigenvalues[0])


def relative_criterion(values: Float[np.ndarray, "case candidate"], robust: Robust) -> Float[np.ndarray, " candidate"]:
    """The criterion of each candidate divided by that of the best candidate, dimensionless.

    Args:
        values: the criterion, `(diffusivity, candidate)`.
        robust: "no" takes the first diffusivity, "expected" the geometric mean over all of them, "worst" the smallest
            (standardised maximin).

    Source: H. Dette, J. R. Stat. Soc. B 59 (1997), 97.
    """
    largest = values.max(axis=1, keepdims=True)
    efficiency = values / np.where(largest > 0, largest, 1.0)
    if robust == "no":
        return efficiency[0]
    if robust == "worst":
        return efficiency.min(axis=0)
    with np.errstate(divide="ignore"):
        return np.exp(np.mean(np.log(efficiency), axis=0))


def information_matrix(contributions: Sequence[Contribution], whitening: Whitening) -> Float[np.ndarray, "param param"]:
    """M for ln(alpha), the nuisance parameters common to all sensors, then those of each sensor; priors included."""
    white = whitened(contributions, whitening)
    return white.T @ white + prior_information(white.shape[1])


def prior_information(parameters: int) -> Float[np.ndarray, "param param"]:
    """P: 1 for each nuisance parameter and 0 for ln(alpha), the first of so many."""
    return np.diag((np.arange(parameters) > 0).astype(float))


def marginal_information(
    matrix: Float[np.ndarray, "param param"], indices: list[int]
) -> Float[np.ndarray, "index index"]:
    """The information on some parameters with the others projected out: `M_aa - M_ab M_bb^-1 M_ba`."""
    rest = [index for index in range(len(matrix)) if index not in indices]
    block = matrix[indices][:, indices]
    if not rest:
        return block
    cross = matrix[indices][:, rest]
    return block - cross @ np.linalg.solve(matrix[rest][:, rest], cross.T)


def relative_std(matrix: Float[np.ndarray, "param param"]) -> float:
    """The relative standard error of the diffusivity from an information matrix; infinite for an uninformative one."""
    log_alpha_information = float(marginal_information(matrix, [0])[0, 0])
    return 1.0 / math.sqrt(log_alpha_information) if log_alpha_information > UNINFORMATIVE_STD**-2 else math.inf


def criterion_of(matrix: Float[np.ndarray, "param param"], criterion: Criterion, indices: list[int]) -> float:
    """The criterion of the marginal information on some parameters; for one parameter D, A and E are the same."""
    marginal = marginal_information(matrix, indices)
    return max(float(marginal[0, 0]), 0.0) if len(indices) == 1 else criterion_value(marginal, criterion)


def indices_of_interest(of: ParametersOfInterest, contributions: Sequence[Contribution]) -> list[int]:
    """The indices in M of the parameters that the criterion is computed for."""
    columns = parameter_columns(contributions)
    own = [column for (owner, _), column in columns.items() if owner is not None]
    return {"all": list(columns.values()), "constants": [0, *own], "diffusivity": [0]}[of]


def typical_sensor(sensors: Sequence[Sensor], **stds: float | None) -> Sensor:
    """A sensor with the given standard deviations; for None the median over the sensors of the case."""
    medians = {name: float(np.median([getattr(sensor, name) for sensor in sensors])) for name in stds}
    stated = {name: std for name, std in stds.items() if std is not None}
    return replace(sensors[0], name="another", **(medians | stated))
