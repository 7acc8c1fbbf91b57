"""Where the sensors of unknown height in a section probably are.

Each set of heights, one for each such sensor, has the likelihood of its own readings, all other parameters being fitted
anew (linearly). The weights of the heights times the likelihoods give the probability of each height and material.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._internal.arrays import on_device
from .._internal.result_object import ResultObject
from ..case.case_definition import Case
from ..case.wall_and_sensors import Sensor
from .gls_fit import GLSFit
from .sensor_heights import (
    HEIGHT_KIND,
    candidate_heights,
    has_uncertain_height,
    height_deviations,
    principal_components,
)

_MOST_SETS = 1_000_000  # sets of heights whose likelihood is computed
_FEWEST = 4  # heights of each sensor in these sets


@dataclass(frozen=True, eq=False)
class SensorPlace(ResultObject):
    """Where a sensor probably is.

    Args:
        heights: candidates, m. probability: of each.
        materials: probability of each material of the section, by name.
        deviance: by how much -2 log L is lower in the likeliest material than in the next one.
    """

    heights: np.ndarray
    probability: np.ndarray
    materials: dict[str, float]
    deviance: float

    @property
    def material(self) -> str:
        """The most probable material."""
        return max(self.materials, key=self.materials.__getitem__)

    def to_dict(self) -> dict[str, Any]:
        """The entry of result.json."""
        mean = float(self.probability @ self.heights)
        std = float(np.sqrt(self.probability @ (self.heights - mean) ** 2))
        return {"height": mean, "std": std, "materials": self.materials, "deviance": self.deviance}

    def __str__(self) -> str:
        name = self.material
        return f"in {name} with probability {self.materials[name]:.2g}"


def sensor_places(case: Case, fit: GLSFit) -> dict[str, SensorPlace]:
    """Where the sensors of unknown height probably are, by name; none in a case without such sensors."""
    uncertain = [k for k, sensor in enumerate(case.sensors) if has_uncertain_height(case, sensor)]
    if not uncertain or not fit.finite:
        return {}
    candidates = [candidate_heights(case, case.sensors[k]) for k in uncertain]
    base, moves = _projected(case, fit, uncertain)
    single = [np.log(weights) for _, weights in candidates]
    posterior = _posterior_of_sets(base, moves, single)
    found = {}
    for number, k in enumerate(uncertain):
        heights, weights = candidates[number]
        found[case.sensors[k].name] = _place(case, case.sensors[k], heights, weights, posterior[number])
    return found


def _projected(case: Case, fit: GLSFit, uncertain: Sequence[int]) -> tuple[np.ndarray, list[np.ndarray]]:
    """The whitened residual and the whitened deviations, all parameters but the heights projected out.

    Returns:
        the residual without any deviation, `(row,)`, and for each sensor its deviations, `(height, row)`.
    """
    kept = np.setdiff1d(np.arange(len(fit.names)), fit.indices(HEIGHT_KIND))
    heights = fit.indices(HEIGHT_KIND)
    whitening, count = fit.noise.whitening, len(kept)
    jacobian = np.concatenate([whitening @ fit.readings_jacobian[:, kept], np.eye(count - 1, count, 1)])
    size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    basis, _ = np.linalg.qr(jacobian / size)

    def projected(readings: np.ndarray, priors: np.ndarray) -> np.ndarray:
        rows = np.concatenate([whitening @ readings, priors])
        return rows - basis @ (basis.T @ rows)

    # the residual of the model's own output: the amplitudes' part and the mean deviation are put back
    residual = np.asarray(fit.minimum.residual) + fit.readings_jacobian[:, heights] @ fit.z[heights]
    data, bins, moves = fit.problem.data, fit.problem.bins, []
    for k in uncertain:
        sensor = case.sensors[k]
        deviations = height_deviations(case, data, fit.diffusivity, sensor)
        mean, _ = principal_components(deviations, candidate_heights(case, sensor)[1])
        rows = np.zeros((*deviations.shape, data.observed.shape[1]))
        rows[:, :, k] = deviations - mean
        binned = np.stack([np.asarray(bins.mean(on_device(one))) for one in rows])
        moves.append(np.stack([projected(one, np.zeros(count - 1)) for one in binned]))
    return projected(residual, -fit.z[kept][1:]), moves


def _posterior_of_sets(
    base: np.ndarray, moves: Sequence[np.ndarray], log_weights: Sequence[np.ndarray]
) -> list[np.ndarray]:
    """The marginal probability of each height of each sensor, over all sets of heights.

    With the residual a and the deviations b the cost of a set is `|a - sum_s b_s|^2`. Of many sensors only the most
    probable heights of each are combined, the others being at their best.
    """
    sensors, kept = len(moves), [np.arange(len(one)) for one in moves]
    most = max(_FEWEST, int(_MOST_SETS ** (1.0 / sensors)))
    if most < max(map(len, moves)):
        best = _best_set(base, moves, log_weights)
        for s in range(sensors):
            rest = base - sum((moves[t][best[t]] for t in range(sensors) if t != s), np.zeros_like(base))
            cost = np.sum((rest - moves[s]) ** 2, axis=1) - 2.0 * log_weights[s]
            kept[s] = np.sort(np.argsort(cost)[:most])
    total = np.array(base @ base)
    for s in range(sensors):
        own = np.sum(moves[s][kept[s]] ** 2, axis=1) - 2.0 * moves[s][kept[s]] @ base - 2.0 * log_weights[s][kept[s]]
        total = total[..., None] + own
        for t in range(s):
            cross = 2.0 * moves[t][kept[t]] @ moves[s][kept[s]].T
            shape = [1] * (s + 1)
            shape[t], shape[s] = cross.shape
            total = total + cross.reshape(shape)
    probability = np.exp(-0.5 * (total - total.min()))
    probability /= probability.sum()
    result = []
    for s in range(sensors):
        marginal = np.zeros(len(moves[s]))
        marginal[kept[s]] = probability.sum(axis=tuple(t for t in range(sensors) if t != s))
        result.append(marginal)
    return result


def _best_set(base: np.ndarray, moves: Sequence[np.ndarray], log_weights: Sequence[np.ndarray]) -> list[int]:
    """A set of heights of a low cost, by improving one sensor after the other."""
    best = [int(np.argmin(np.sum((base - one) ** 2, axis=1))) for one in moves]
    for _ in range(10):
        for s, one in enumerate(moves):
            rest = base - sum((moves[t][best[t]] for t in range(len(moves)) if t != s), np.zeros_like(base))
            best[s] = int(np.argmin(np.sum((rest - one) ** 2, axis=1) - 2.0 * log_weights[s]))
    return best


def _place(
    case: Case, sensor: Sensor, heights: np.ndarray, weights: np.ndarray, probability: np.ndarray
) -> SensorPlace:
    """The probabilities of a sensor's materials."""
    assert case.section is not None
    names = np.array([case.section.material_at(sensor.position, float(y)).name for y in heights])
    materials = {one.name: float(probability[names == one.name].sum()) for one in case.section.materials}
    # the likelihood of a material: the mean over its heights
    likelihood = [
        float(probability[names == name].sum() / weights[names == name].sum()) for name in dict.fromkeys(names)
    ]
    first, second = [*sorted(likelihood, reverse=True), 0.0][:2]
    with np.errstate(divide="ignore"):
        deviance = float(2.0 * np.log(first / second)) if second > 0.0 else float("inf")
    return SensorPlace(heights, probability, materials, deviance)
