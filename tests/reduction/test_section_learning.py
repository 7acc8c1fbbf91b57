"""Modal identification takes a section as it takes a wall."""

import numpy as np
import pandas as pd

import wallid
from wallid.case import scales
from wallid.case.section import SectionMaterial, coursed_rubble, section_of_regions
from wallid.models import explicit, full_order_model, window_data


def rubble_case(seed, days, section):
    """A record of faces that vary by the day and at random; what the sensors read does not matter here."""
    rng, rows = np.random.default_rng(seed), days * 48
    time, noise = np.arange(rows) / 48.0, np.zeros((rows, 2))
    for row in range(1, rows):
        noise[row] = 0.97 * noise[row - 1] + 0.4 * rng.standard_normal(2)
    daily = [8 + 6 * np.sin(2 * np.pi * time + rng.uniform(0, 6)), 19 + 2 * np.sin(2 * np.pi * time)]
    faces = np.stack(daily, axis=1) + noise
    frame = pd.DataFrame({"time": 1800.0 * np.arange(rows), "left": faces[:, 0], "right": faces[:, 1]})
    frame["T1"], frame["T2"], frame["T3"] = 10.0 + time, 12.0 + time, 14.0 + time
    sensors = [
        wallid.Sensor(f"T{k + 1}", x, noise_std=0.05, height=y)
        for k, (x, y) in enumerate(((0.1, 0.2), (0.2, 0.3), (0.3, None)))
    ]
    return wallid.Case.from_dataframe(
        frame, time="time", left="left", right="right", sensors=sensors, section=section,
        wall=wallid.Wall(0.4, section.diffusivity_prior),
    )  # fmt: skip


def test_order_10_gives_the_field_and_the_sensitivity_for_an_unseen_face():
    materials = [SectionMaterial("stone", 1.7, 2.1e6), SectionMaterial("mortar", 0.6, 1.5e6)]
    regions = coursed_rubble(0.4, 0.5, seed=2, courses=3, joint=0.02)
    section = section_of_regions(0.4, 0.5, materials, regions)
    learned = wallid.learn(rubble_case(1, 3, section), wallid.Window(0, 144), 10).system
    unseen = rubble_case(2, 6, section)
    data = window_data(unseen)
    fourier = scales(unseen).fourier_number(section.diffusivity_prior)
    (u, theta), (u_full, theta_full) = (
        (np.asarray(part)[1:] for part in explicit(model, fourier, data))
        for model in (learned, full_order_model(unseen))
    )
    assert np.abs(u - u_full).max() < 1e-4
    rms = np.sqrt(np.mean(theta_full**2, axis=0))
    assert (np.abs(theta - theta_full).max(axis=0) < 5e-3 * rms).all()
