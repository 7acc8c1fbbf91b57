"""Walls for `wallid.estimate_walls` whose readings are the analytic slab's, and a process that estimates them.

As a program: `many_walls.py OUT` estimates on every device there is and writes the diffusivities; with
`many_walls.py OUT ADDRESS PROCESSES NUMBER` it joins a job of several processes first.
"""

import sys
from dataclasses import replace

import jax
import numpy as np
from benchmarks.reference.synthetic_twins import slab_response

import wallid

DAY, LENGTH, STEP, ROWS, PLACES = 86400.0, 0.5, 600.0, 145, (0.1, 0.25)
ALPHAS = np.array([3e-7, 5.21e-7, 8e-7, 1.2e-6, 4e-7])
NOISE = 0.02


def walls(noise=0.0, *, alphas=ALPHAS, offset_std=0.0):
    """The arguments of `estimate_walls`; each wall's sensors lie at places of its own."""
    time, draw = STEP * np.arange(ROWS), np.random.default_rng(1)
    omega = 2 * np.pi / DAY
    systems, data = [], []
    for k, alpha in enumerate(alphas):
        places = np.array(PLACES) + 0.01 * (k % 4)
        readings, _ = slab_response(places, time, length=LENGTH, diffusivity=alpha, harmonics=((omega, 0.0, 5.0),))
        outputs = [wallid.models.Output(x) for x in places]
        wall = wallid.Wall(length=LENGTH, diffusivity_prior=5e-7)
        systems.append(wallid.models.finite_volume_model(wall, outputs, nodes=41, profile_degree=0).modal())
        face = 5.0 * np.sin(omega * time) / 20.0
        offsets = tuple(range(len(places))) if offset_std else ()
        data.append(
            wallid.models.WindowData(
                step=STEP / DAY,
                inputs=np.stack([face, 0 * face], axis=1),
                initial=np.zeros(1),
                observed=readings + noise * draw.standard_normal(readings.shape),
                weight=np.full(readings.shape, 1 / NOISE),
                offset_std=np.full(len(places), offset_std),
                profile_per_offset=np.zeros((1, len(places))),
                temperature=20.0,
                temperature_min=0.0,
                offsets=offsets,
            )
        )
    count = len(alphas)
    return (
        wallid.models.stack(systems),
        wallid.models.stack(data),
        np.full(count, DAY / LENGTH**2),
        np.full(count, 2e-7),
    )


def without_reading(arguments, wall, row, sensor):
    """The same walls, one reading missing."""
    systems, data, per_alpha, start = arguments
    weight = data.weight.at[wall, row, sensor].set(0.0)
    observed = data.observed.at[wall, row, sensor].set(0.0)
    return systems, replace(data, weight=weight, observed=observed), per_alpha, start


def main():
    jax.config.update("jax_enable_x64", True)
    out, *job = sys.argv[1:]
    if job:
        address, processes, number = job
        jax.distributed.initialize(address, int(processes), int(number))
    mesh = jax.make_mesh((jax.device_count(),), ("device",))
    found = wallid.estimate_walls(*walls(NOISE), mesh=mesh)
    windows = () if job else wallid.design(wallid.load("saint_julien"), mesh=mesh).information
    np.savez(
        out,
        devices=jax.device_count(),
        diffusivity=np.asarray(found.diffusivity),
        std=np.asarray(found.relative_std),
        windows=windows,
    )


if __name__ == "__main__":
    main()
