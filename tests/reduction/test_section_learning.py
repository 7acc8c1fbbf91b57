"""Modal identification and batches take a section as they take a wall."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import minimize_scalar

import wallid
from wallid.case import scales
from wallid.case.section import SectionMaterial, coursed_rubble, section_of_regions
from wallid.models import explicit, full_order_model, stack, window_data


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


def rubble_section():
    materials = [SectionMaterial("stone", 1.7, 2.1e6), SectionMaterial("mortar", 0.6, 1.5e6)]
    return section_of_regions(0.4, 0.5, materials, coursed_rubble(0.4, 0.5, seed=2, courses=3, joint=0.02))


@pytest.mark.slow
def test_order_10_gives_the_field_and_the_sensitivity_for_an_unseen_face():
    section = rubble_section()
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


def test_a_batch_gives_what_scipy_finds_for_each_record():
    """Two windows of a record that another diffusivity made, with noise: the minimum of the squares, by Brent."""
    case, rng = rubble_case(3, 6, rubble_section()), np.random.default_rng(3)
    model, per_alpha = full_order_model(case), float(scales(case).fourier_number(1.0))
    truth = 1.3 * case.wall.diffusivity_prior
    whole = window_data(case)
    readings = np.asarray(whole.celsius(explicit(model, per_alpha * truth, whole)[0]))
    readings = readings + 0.05 * rng.standard_normal(readings.shape)
    case = replace(case, record=replace(case.record, sensors=readings))
    data = [window_data(case, wallid.Window(row, 144)) for row in (0, 120)]
    start = np.full(2, case.wall.diffusivity_prior)
    found = wallid.estimate_walls(stack([model] * 2), stack(data), np.full(2, per_alpha), start)
    assert bool(found.converged.all())
    for one, value in zip(data, np.asarray(found.diffusivity), strict=True):

        def squares(log, one=one):
            u = explicit(model, per_alpha * start[0] * np.exp(log), one)[0]
            return float(np.sum((np.asarray(one.weight) * np.asarray(one.observed - one.celsius(u))) ** 2))

        best = minimize_scalar(squares, bounds=(-1.0, 1.0), method="bounded", options={"xatol": 1e-9})
        assert value == pytest.approx(start[0] * np.exp(best.x), rel=1e-6)
