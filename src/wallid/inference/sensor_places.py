"""Where the sensors of unknown height in a section probably are.

A sensor's readings at each of its heights have a likelihood, all other parameters being fitted anew (linearly), those
of the other sensors' heights among them. The weights of the heights times the likelihoods give the probability of each
height, and of each material.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import logsumexp

from .._internal.arrays import on_device
from .._internal.result_object import ResultObject
from ..case.case_definition import Case
from ..case.wall_and_sensors import Sensor
from .gls_fit import GLSFit
from .nuisance_kinds import WallParameters
from .parameters import target_of
from .sensor_heights import HEIGHT_KIND, candidate_heights, component_name, has_uncertain_height, height_deviations


@dataclass(frozen=True, eq=False)
class SensorPlace(ResultObject):
    """Where a sensor probably is.

    Args:
        heights: candidates, m. probability: of each.
        materials: probability of each material of the section, by name.
        deviance: -2 log L of the next likely material minus that of the likeliest, each material's likelihood being the
            mean over its heights; None where all heights are in one material.
    """

    heights: np.ndarray
    probability: np.ndarray
    materials: dict[str, float]
    deviance: float | None

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
    if not fit.finite:
        return {}
    return {
        sensor.name: _place(case, fit, number, sensor)
        for number, sensor in enumerate(case.sensors)
        if has_uncertain_height(case, sensor)
    }


def _place(case: Case, fit: GLSFit, number: int, sensor: Sensor) -> SensorPlace:
    """Where one sensor probably is."""
    assert case.section is not None
    heights, weights = candidate_heights(case, sensor)
    names = [case.section.material_at(sensor.position, float(height)).name for height in heights]
    return place_of_likelihoods(
        heights, weights, names, -0.5 * _costs(case, fit, number, sensor), [one.name for one in case.section.materials]
    )


def place_of_likelihoods(
    heights: np.ndarray,
    weights: np.ndarray,
    names: Sequence[str],
    log_likelihood: np.ndarray,
    materials: Sequence[str],
) -> SensorPlace:
    """Where a sensor probably is, from the log-likelihood at each height.

    Args:
        heights: candidates, m. weights: of them, of sum 1. names: the material at each.
        log_likelihood: at each.
        materials: all of the section.
    """
    log_weights = np.log(np.maximum(weights, 1e-300))
    probability = np.exp(log_weights + log_likelihood - _log_sum(log_weights + log_likelihood))
    own = {name: np.array([one == name for one in names]) for name in dict.fromkeys(names)}
    mean_likelihood = sorted(
        (_log_sum((log_weights + log_likelihood)[at]) - _log_sum(log_weights[at]) for at in own.values()),
        reverse=True,
    )
    return SensorPlace(
        heights,
        probability,
        {name: float(probability[own[name]].sum()) if name in own else 0.0 for name in materials},
        2.0 * (mean_likelihood[0] - mean_likelihood[1]) if len(mean_likelihood) > 1 else None,
    )


def _log_sum(values: np.ndarray) -> float:
    """`ln sum exp`."""
    return float(np.asarray(logsumexp(values)))


def _costs(case: Case, fit: GLSFit, number: int, sensor: Sensor) -> np.ndarray:
    """-2 log L of a sensor's heights, all parameters but its own height projected out."""
    own = [k for k, name in enumerate(fit.names) if _is_component_of(name, sensor)]
    kept = np.setdiff1d(np.arange(len(fit.names)), own)
    whitening, count = fit.noise.whitening, len(kept)
    jacobian = np.concatenate([whitening @ fit.readings_jacobian[:, kept], np.eye(count - 1, count, 1)])
    basis, _ = np.linalg.qr(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300))

    def projected(readings: np.ndarray, priors: np.ndarray) -> np.ndarray:
        rows = np.concatenate([whitening @ readings, np.broadcast_to(priors[:, None], (count - 1, readings.shape[1]))])
        return rows - basis @ (basis.T @ rows)

    data, bins, wall = fit.problem.data, fit.problem.bins, fit.z[fit.indices(WallParameters.kind)]
    deviations = height_deviations(case, data, fit.diffusivity, sensor, wall).readings
    mean = candidate_heights(case, sensor)[1] @ deviations
    rows = np.zeros((*deviations.shape, data.observed.shape[1]))
    rows[:, :, number] = deviations - mean
    moves = np.stack([np.asarray(bins.mean(on_device(one))) for one in rows], axis=1)
    # the residual at the mean over the heights: the components' part is put back
    residual = np.asarray(fit.minimum.residual) + fit.readings_jacobian[:, own] @ fit.z[own]
    base = projected(residual[:, None], -fit.deviation[kept][1:])
    return np.sum((base - projected(moves, np.zeros(count - 1))) ** 2, axis=0)


def _is_component_of(name: str, sensor: Sensor) -> bool:
    """Whether a parameter is a component of this sensor's height."""
    return name.startswith(HEIGHT_KIND) and target_of(name).startswith(component_name(sensor, ""))
