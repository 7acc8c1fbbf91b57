"""Packaged cases with other noise, weather or sun, from the independent truths."""

from dataclasses import replace

import numpy as np

from benchmarks.reference.make_examples import saint_julien, validation


def validation_case(case, seed):
    """The validation slab with the noise of another seed."""
    truth = validation([sensor.noise_std for sensor in case.sensors], 1000 + seed)
    sensors = np.stack([truth[sensor.name] for sensor in case.sensors], axis=1)
    return replace(case, record=replace(case.record, sensors=sensors))


def saint_julien_case(case, seed, *, sun, noise_seed=None):
    """The twin with another weather, sun or noise."""
    truth = saint_julien(seed, sun=sun, noise_seed=noise_seed)
    faces = np.stack([truth["T_left"], truth["T_right"]], axis=1)
    sensors = np.stack([truth[sensor.name] for sensor in case.sensors], axis=1)
    regressors = {"irradiance": truth["irradiance"]}
    return replace(case, record=replace(case.record, faces=faces, sensors=sensors, regressors=regressors))
