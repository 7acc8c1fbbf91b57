"""Walls with heat that no column explains, as cases; the truth is sine series, no part of wallid."""

from pathlib import Path

import numpy as np
from benchmarks.accuracy.disturbance import (
    BEFORE,
    FACE_STD,
    FINE,
    FLUX_STD,
    GAIN_STD,
    HEATS,
    LENGTH,
    PLACES,
    SEED,
    SENSOR_STD,
    STEP,
    Kind,
    heat_of,
    simulated,
)
from benchmarks.reference.analytic_slab import weather

import wallid
from wallid.case.options import Choices

SENSORS = Kind("sensors", "wall", 3.0)
DAY_ROWS = round(86400.0 / STEP["sensors"])


def case_of(kind=SENSORS, number=5000):
    """A record of one kind; its number is outside those of the benchmark."""
    faces, inside, through = simulated(kind, number)
    time = STEP[kind.logged] * np.arange(kind.rows)
    stamps = np.datetime64("2026-03-01T00:00:00") + (1e9 * time).astype("timedelta64[ns]")
    with_plates = kind.logged == "plates"
    names = () if with_plates else ("T1", "T2")
    record = wallid.Record(
        time,
        stamps.astype("datetime64[ns]"),
        None,
        faces,
        np.empty((kind.rows, 0)) if with_plates else inside,
        names,
        regressors={f"flux_{side}": through[:, k] for k, side in enumerate(("left", "right")) if with_plates},
        boundary_noise_std=FACE_STD,
        flux_noise_std=FLUX_STD,
        flux_gain_std=GAIN_STD,
    )
    sensors = tuple(wallid.Sensor(n, LENGTH * x, noise_std=SENSOR_STD) for n, x in zip(names, PLACES, strict=False))
    wall = wallid.Wall(length=LENGTH, diffusivity_prior=7e-7, outside="right")
    return wallid.Case("slab", Path("case.toml"), wall, sensors, record, Choices(initial_profile=2 - with_plates))


def hidden_heat(kind=SENSORS, number=5000):
    """The heat of a record at all times of its simulator from the first row on, K/s, as the simulator draws it."""
    rng = np.random.default_rng([SEED, 0, HEATS.index(kind.heat), round(kind.memory), number])
    stride, before = round(STEP["sensors"] / FINE), round(BEFORE * 86400.0 / FINE)
    count = before + (kind.rows - 1) * stride + 1
    weather(count, FINE, rng, hours=(8.0, 2.0))
    return heat_of(kind, count, rng)[0][before:]
