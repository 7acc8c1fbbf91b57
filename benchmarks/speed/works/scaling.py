"""How the time of field and sensitivity grows with nodes, steps, the reduced model's order, and sensors."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

import wallid
from benchmarks.speed.measure import Prepared
from benchmarks.speed.works.ratio import Asked, Results

TITLE = "scaling of field and sensitivity: hourly rows, a wall of 0.5 m"
SIZES = {
    "nodes": (50, 100, 200, 400, 800, 1600),
    "steps": (1_000, 10_000, 100_000, 1_000_000),
    "order": (2, 5, 10, 20, 40),
    "sensors": (1, 5, 20, 50),
}
NODES, STEPS, ORDER, SENSORS = 100, 10_000, 10, 5  # what stays where another grows; nodes with 1,000 rows
ABOUT = {  # what is asked: no steeper than the work there is
    "nodes": 1.1,  # once the modes are known
    "steps": 1.1,
    "order": 1.1,
    "sensors": 1.1,
}


def _prepared(nodes: int, steps: int, sensors: int, order: int | None) -> Prepared:
    """The exact large model; with an order its slowest modes alone, which cost what a reduced model costs."""
    wall = wallid.Wall(length=0.5, diffusivity_prior=5e-7)
    places = np.linspace(0.05, 0.45, sensors)
    modal = wallid.models.finite_volume_model(
        wall, [wallid.models.Output(x) for x in places], nodes=nodes, profile_degree=0
    ).modal()
    if order is not None:
        slowest = np.argsort(-np.asarray(modal.A))[:order]
        modal = wallid.StateSpace(
            A=modal.A[slowest], B=modal.B[slowest], C=modal.C[:, slowest], D=modal.D, P=modal.P[slowest]
        )
    course = np.cumsum(np.random.default_rng(0).standard_normal((steps, 2)), axis=0) / 100
    inputs, step, fourier = jnp.asarray(course), jnp.asarray(1 / 24), jnp.asarray(0.2)
    initial = jnp.zeros(1)

    def run() -> jax.Array:
        return jax.block_until_ready(wallid.models.propagate(modal, fourier, step, inputs, initial, sensitivity=True))

    return Prepared(run, lambda answer: {})


def _contenders() -> dict[str, Callable[[], Prepared]]:
    found: dict[str, Callable[[], Prepared]] = {}
    for nodes in SIZES["nodes"]:
        found[f"nodes {nodes}"] = partial(_prepared, nodes, 1_000, SENSORS, None)
    for steps in SIZES["steps"]:
        found[f"steps {steps}"] = partial(_prepared, NODES, steps, SENSORS, ORDER)
    for order in SIZES["order"]:
        found[f"order {order}"] = partial(_prepared, NODES, STEPS, SENSORS, order)
    for sensors in SIZES["sensors"]:
        found[f"sensors {sensors}"] = partial(_prepared, NODES, STEPS, sensors, ORDER)
    return found


CONTENDERS = _contenders()


def exponents(results: Results) -> dict[str, float]:
    """The slope of log time over log size, by least squares through the larger sizes: four of six, three of four."""
    found = {}
    for name, sizes in SIZES.items():
        there = [(size, results[f"{name} {size}"].seconds) for size in sizes if f"{name} {size}" in results]
        upper = np.log(np.array(there[len(there) // 2 - 1 :]))
        if len(upper) >= 2:
            found[name] = float(np.polyfit(upper[:, 0], upper[:, 1], 1)[0])
    return found


def asked(results: Results) -> list[Asked]:
    """The exponents, none above that of the work there is."""
    found = exponents(results)
    return [
        Asked(f"exponent of {name}", found.get(name), most, at_least=False, unit="") for name, most in ABOUT.items()
    ]
