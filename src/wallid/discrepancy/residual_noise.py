"""The noise covariance of a diagnosis problem, with the face response of its model."""

from __future__ import annotations

import numpy as np

from ..inference import noise_covariance as noise
from ..inference import whittle_likelihood as whittle
from ..inference.gap_covariance import gap_errors
from ..inference.noise_covariance import NoiseCovariance
from ..inference.parameters import Parameters
from .model_with_effects import face_impulse_response
from .problem import DiagnosisProblem

__all__ = ["DiagnosisNoiseShape", "NoiseCovariance", "estimate_noise"]


class DiagnosisNoiseShape(noise.NoiseShape):
    """The structure of the noise covariance at some parameters.

    Args:
        problem: the case prepared for the search.
        parameters: those at which the face response is computed.
    """

    def __init__(self, problem: DiagnosisProblem, parameters: Parameters):
        sensor_std = np.array([sensor.noise_std for sensor in problem.case.sensors])
        face_std = problem.record.boundary_noise_std
        response = face_impulse_response(problem.model, parameters)
        gaps = gap_errors(problem.record.fill_std, face_std, response, problem.bins)
        super().__init__(response, problem.bins, sensor_std, face_std, gaps)


def estimate_noise(model: DiagnosisNoiseShape, residual: np.ndarray, directions: np.ndarray) -> NoiseCovariance:
    """Estimate the noise from a residual, orthogonally to some directions.

    The edges of the record are not used: the significance levels were calibrated without them.

    Args:
        model: structure of the covariance.
        residual: of the binned readings, K, `(reading,)`.
        directions: excluded from the estimate, K, `(direction, reading)`.
    """
    return whittle.estimate_noise(model, residual, directions, edge_correction=False)
