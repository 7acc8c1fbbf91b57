"""The noise beside a search for effects: the covariance of `wallid.noise`, with this study's response to the faces."""

from __future__ import annotations

import numpy as np

from ..inference import noise_covariance as noise
from ..inference import whittle_likelihood as whittle
from ..inference.gap_covariance import gap_errors
from ..inference.noise_covariance import Noise
from .model_with_effects import impulses
from .problem import DiagnosisProblem

__all__ = ["Noise", "NoiseModel", "estimate_noise"]


class NoiseModel(noise.NoiseShape):
    """The covariance's shape at some parameters of a study."""

    def __init__(self, study: DiagnosisProblem, theta: np.ndarray):
        sensor_std = np.array([sensor.noise_std for sensor in study.case.sensors])
        face_std = study.record.boundary_noise_std
        response = impulses(study.model, theta)
        gaps = gap_errors(study.record.fill_std, face_std, response, study.bins)
        super().__init__(response, study.bins, sensor_std, face_std, gaps)


def estimate_noise(model: NoiseModel, residual: np.ndarray, directions: np.ndarray) -> Noise:
    """The noise that a residual shows beside these directions, without the record's two ends.

    The bars that an effect has to pass were set without them.
    """
    return whittle.estimate_noise(model, residual, directions, edges=False)
