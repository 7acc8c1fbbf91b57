"""The memory of the noise beside plates, from drawn noise: its shape, and where none is looked for."""

import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.reference.simulator_with_effects import noise_course

from wallid.inference.noise_covariance import BinnedReadings, NoiseShape
from wallid.inference.noise_memory import memory_of_noise
from wallid.records.face_filter import FaceNoise
from wallid.records.face_spectrum import WHITE

ROWS, SENSORS, SENSOR, FACE, PLATE = 2016, 3, 0.05, 0.08, 1.0
STEP = 600.0  # s
UNREAD = 20  # first rows without a flux


def shape_of(rows_per_bin=7, sensors=SENSORS, every=1):
    """The covariance of sensors and one plate; a face answers after some rows, the plate at once."""
    t = np.arange(ROWS) + 1.0
    depth = np.array([1.0, 2.0, 3.0])[:sensors]
    inside = 0.3 * depth / t[:, None] ** 1.5 * np.exp(-(depth**2) / t[:, None])
    at_plate = 20.0 * np.diff(1.0 / np.sqrt(t), prepend=0.0)
    one = np.concatenate([inside, at_plate[:, None]], axis=1)
    present = np.ones((ROWS, sensors + 1))
    present[:UNREAD, -1] = 0.0
    present[:, :sensors] *= (np.arange(ROWS) % every == 0)[:, None]
    bins = BinnedReadings(jnp.zeros_like(present), jnp.asarray(present), rows_per_bin)
    std = np.array([SENSOR] * sensors + [PLATE])
    return NoiseShape(np.stack([one, 0.2 * one]), bins, std, FaceNoise.white(FACE), np.zeros((2, 1)))


def residual_of(shape, kind, seed):
    """Noise of the sensors and the plate, and that of the faces through the wall."""
    rng = np.random.RandomState(seed)
    residual = shape.sensor_std * np.stack([noise_course(kind, ROWS, rng) for _ in shape.sensor_std], axis=1)
    for response in shape.response:
        own = FACE * noise_course(kind, ROWS, rng)
        residual += np.stack([np.convolve(own, one)[:ROWS] for one in response.T], axis=1)
    return residual


@pytest.mark.parametrize("rows_per_bin", [1, 7])
@pytest.mark.parametrize(("kind", "rho"), [("ar06", 0.6), ("ar09", 0.9)])
def test_the_memory_is_that_of_the_drawn_noise(kind, rho, rows_per_bin):
    """Also in bins whose noise looks white."""
    shape = shape_of(rows_per_bin)
    found = [memory_of_noise(shape, residual_of(shape, kind, seed), SENSORS, STEP) for seed in range(3)]
    assert np.mean([one.share for one in found]) > 0.9
    assert np.mean([one.correlation for one in found]) == pytest.approx(rho, abs=0.05)


def test_white_noise_has_no_memory():
    shape = shape_of()
    assert all(memory_of_noise(shape, residual_of(shape, "white", seed), SENSORS, STEP) == WHITE for seed in range(3))


def test_what_the_initial_profile_does_to_the_first_rows_is_not_taken_for_noise():
    shape = shape_of()
    residual = residual_of(shape, "ar06", 1)
    spoilt = residual.copy()
    spoilt[:4] += np.array([1.4, -0.9, -0.4, -0.1])[:, None]
    assert memory_of_noise(shape, spoilt, SENSORS, STEP) == memory_of_noise(shape, residual, SENSORS, STEP)


@pytest.mark.parametrize("shape", [shape_of(sensors=0), shape_of(every=3)], ids=["no sensor", "every third row"])
def test_without_readings_inside_the_noise_is_taken_as_white(shape):
    assert memory_of_noise(shape, residual_of(shape, "ar06", 1), len(shape.sensor_std) - 1, STEP) == WHITE


def test_slow_changes_are_not_looked_at():
    """What an effect may do in days is no noise."""
    shape = shape_of()
    residual = residual_of(shape, "ar06", 2)
    days = np.arange(ROWS) / 144.0
    found = memory_of_noise(shape, residual + 0.5 * np.sin(2 * np.pi * days)[:, None], SENSORS, STEP)
    assert found.correlation == pytest.approx(memory_of_noise(shape, residual, SENSORS, STEP).correlation, abs=0.02)


def test_rows_of_an_hour_do_not_show_it():
    """There heat with a memory of some hours would be taken for noise."""
    shape = shape_of()
    assert memory_of_noise(shape, residual_of(shape, "ar09", 2), SENSORS, 3600.0) == WHITE
