"""Ten thousand estimates in one call: walls of other diffusivities, sensors' places and records, MIM 10, 73 rows."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares

import wallid
from benchmarks.reference.integrators import by_lsim
from benchmarks.speed.learned_models import learned
from benchmarks.speed.measure import Prepared
from benchmarks.speed.works.ratio import Asked, Results
from wallid.estimation.many_walls import WallEstimates, estimate_walls

TITLE = "10,000 estimates in one call: three hourly days, three sensors anywhere, MIM 10 (seconds of one wall)"
WALLS, PLACES, NOISE, SCIPY = 10_000, 41, 0.1, 20


@cache
def _case() -> wallid.Case:
    """The twin with a sensor at each of 41 places, of which every wall has three."""
    case = wallid.load("saint_julien")
    places = np.linspace(0.04, 0.96, PLACES) * case.wall.length
    sensors = tuple(replace(case.sensors[0], name=f"P{k}", position=float(x)) for k, x in enumerate(places))
    names = tuple(sensor.name for sensor in sensors)
    record = replace(case.record, names=names, sensors=np.zeros((case.record.rows, PLACES)))
    return replace(case, sensors=sensors, record=record)


def _truths(count: int) -> dict[str, np.ndarray]:
    """Diffusivity, first row, three places, and noise of every wall."""
    draw = np.random.default_rng(4)
    return {
        "alpha": np.exp(draw.uniform(np.log(5e-7), np.log(2e-6), count)),
        "row": draw.integers(0, _case().record.rows - 73, count),
        "places": np.stack([np.sort(draw.choice(PLACES, 3, replace=False)) for _ in range(count)]),
        "noise": NOISE * draw.standard_normal((count, 73, 3)),
    }


@cache
def walls(count: int = WALLS) -> tuple[tuple, dict[str, np.ndarray]]:
    """Models, experiments, scales and starts of so many walls, and what is true of them.

    A wall's readings come from the large model, its estimate from a reduced one.
    """
    case, truth = _case(), _truths(count)
    window = wallid.Window(0, 73)
    large, rom = wallid.full_order_model(case).modal(), learned(case, window, 10)
    blank = wallid.models.window_data(case, window)
    scale = wallid.case.scales(case)
    faces = jnp.asarray((np.asarray(case.record.faces) - scale.temperature_min) / scale.temperature)

    def one(alpha: jax.Array, row: jax.Array, places: jax.Array, noise: jax.Array) -> tuple:
        q = jax.lax.dynamic_slice_in_dim(faces, row, 73)
        initial = jnp.zeros(blank.initial.shape).at[0].set(q[0, 0]).at[1].set(q[0, 1] - q[0, 0])
        u, _ = wallid.models.propagate(large, alpha * scale.fourier_number(1.0), blank.step, q, initial)
        observed = scale.temperature_min + scale.temperature * u[:, places] + noise
        system = replace(rom, C=rom.C[places], D=rom.D[places], output_names=())
        data = replace(
            blank,
            inputs=q,
            initial=initial,
            observed=observed,
            weight=jnp.full((73, 3), 1.0 / NOISE),
            offset_std=jnp.zeros(3),
            profile_per_offset=jnp.zeros((initial.shape[0], 3)),
        )
        return system, data

    columns = tuple(jnp.asarray(truth[name]) for name in ("alpha", "row", "places", "noise"))
    systems, data = jax.jit(lambda items: jax.lax.map(lambda item: one(*item), items))(columns)
    per_alpha, start = jnp.full(count, scale.fourier_number(1.0)), jnp.full(count, 1e-6)
    return jax.block_until_ready((systems, data, per_alpha, start)), truth


def _error(found: WallEstimates, truth: dict[str, np.ndarray]) -> dict[str, float]:
    """Median relative error; scatter in standard errors (1 is right); share that did not converge."""
    apart = np.log(np.asarray(found.diffusivity) / truth["alpha"][: len(found.diffusivity)])
    return {
        "median": np.median(np.abs(apart)),
        "scatter in standard errors": np.sqrt(np.mean((apart / np.asarray(found.relative_std)) ** 2)),
        "not converged": 1.0 - np.mean(np.asarray(found.converged)),
    }


def _ours(**options: Any) -> Prepared:
    arguments, truth = walls()
    run = partial(estimate_walls, *arguments, **options)
    return Prepared(lambda: jax.block_until_ready(run()), partial(_error, truth=truth), units=WALLS)


def _sharded() -> Prepared:
    return _ours(mesh=jax.make_mesh((jax.device_count(),), ("device",)))


def _scipy() -> Prepared:
    """`least_squares` on lsim, wall after wall, with the sensitivity as Jacobian."""
    (_, data, _, _), truth = walls()
    case = _case()
    degree = int(data.initial.shape[1]) - 1
    outputs = [wallid.models.Output(sensor.position) for sensor in case.sensors]
    nodal, scale = (
        wallid.models.finite_volume_model(case.wall, outputs, nodes=101, profile_degree=degree),
        wallid.case.scales(case),
    )
    time = np.asarray(data.step[0]) * np.arange(73)

    def one(k: int) -> float:
        places = [int(place) for place in truth["places"][k]]
        simulate = by_lsim(nodal.select(places), time, np.asarray(data.inputs[k]), np.asarray(data.initial[k]))
        observed = np.asarray(data.observed[k])

        def residual(log_alpha: np.ndarray) -> np.ndarray:
            u, _ = simulate(scale.fourier_number(float(np.exp(log_alpha[0]))))
            return ((scale.temperature_min + scale.temperature * u - observed) / NOISE).ravel()

        def jacobian(log_alpha: np.ndarray) -> np.ndarray:
            fourier = scale.fourier_number(float(np.exp(log_alpha[0])))
            return (scale.temperature * fourier * simulate(fourier)[1] / NOISE).reshape(-1, 1)

        return float(np.exp(least_squares(residual, [np.log(1e-6)], jacobian, xtol=1e-8, ftol=1e-8, gtol=None).x[0]))

    def error(found: list[float]) -> dict[str, float]:
        return {"median": float(np.median(np.abs(np.log(np.array(found) / truth["alpha"][:SCIPY]))))}

    return Prepared(lambda: [one(k) for k in range(SCIPY)], error, units=SCIPY, once=True)


CONTENDERS = {
    "lax.map": _ours,
    "lax.map, 32 walls together": lambda: _ours(chunk=32),
    "vmap": lambda: _ours(way="vmap"),
    "a device for each core": _sharded,
    "loop of least_squares on lsim (20 walls)": _scipy,
}
# a device for each core has to be asked for before JAX starts
SURROUNDINGS = {"a device for each core": {"XLA_FLAGS": "--xla_force_host_platform_device_count={cores}"}}


def asked(results: Results) -> list[Asked]:
    """What the issue asks, of the best way; cores that a way keeps busy are counted."""
    ours = [name for name in CONTENDERS if name in results and "least_squares" not in name]
    rates = [1e-3 / results[name].each / max(results[name].busy, 1.0) for name in ours]
    return [Asked("walls a millisecond of a core", max(rates, default=None), 10, at_least=True, unit="walls")]
