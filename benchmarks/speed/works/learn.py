"""Learning a reduced model of order 5 and 10 from the validation case's four signals, and what others make of it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import wallid
from benchmarks.reference.model_reduction import by_pymor, by_swarm
from benchmarks.speed.measure import Prepared
from benchmarks.speed.works.ratio import Asked, Results, error_ratio, within

DAY = 86400.0
ORDERS = (5, 10)
SWARMS = 9  # what one of them ends at is chance: their median counts
TITLE = (
    "learning, validation case: 4 signals of 2881 rows, 75 nodes, 5 sensors; errors over 50 diffusivities "
    f"(particle swarm: the median of {SWARMS})"
)
LEARNED, NEVER = ("u", "theta"), ("u, never learned", "theta, never learned")


@cache
def _models() -> tuple[wallid.StateSpace, wallid.StateSpace, wallid.reduction.TrainingSignals]:
    """The large model in nodes and in modes, and the learning signals."""
    case = wallid.load("validation")
    outputs = [wallid.models.Output(sensor.position) for sensor in case.sensors]
    nodal = wallid.models.finite_volume_model(case.wall, outputs, nodes=75, profile_degree=0)
    return nodal, nodal.modal(), wallid.reduction.training_signals(case, wallid.Window(0, case.record.rows))


@cache
def _answers() -> tuple[Callable[[wallid.StateSpace], tuple], tuple]:
    """Of a model: u and theta at 50 diffusivities, on a face signal that was learned and on one that never was.

    The large model's are the second part.
    """
    time = np.arange(2881) * 30 / DAY
    courses = np.stack([5 * np.sin(2 * np.pi * time) / 20, 3 * (1 - np.cos(4 * np.pi * time)) / 20])
    inputs = jnp.asarray(np.stack([courses, 0 * courses], axis=2))
    fouriers = jnp.asarray(DAY * np.linspace(2.03e-7, 6.37e-7, 50) / 0.25)

    @jax.jit
    def run(model: wallid.StateSpace) -> tuple:
        still = jnp.zeros(model.P.shape[1])

        def one(fo: jax.Array, course: jax.Array) -> tuple:
            return wallid.models.propagate(model, fo, 30 / DAY, course, still, sensitivity=True)

        return jax.lax.map(lambda course: jax.lax.map(lambda fo: one(fo, course), fouriers), inputs)

    return run, run(_models()[1])


def eps_inf(system: wallid.StateSpace) -> dict[str, float]:
    """eps_inf of u and theta over 50 diffusivities, on the learned face signal and on one never learned."""
    run, want = _answers()
    apart = [np.abs(np.asarray(one - other)).max(axis=(1, 2, 3)) for one, other in zip(want, run(system), strict=True)]
    return {
        kind + name: float(largest[place])
        for place, name in enumerate(("", ", never learned"))
        for kind, largest in zip(("u", "theta"), apart, strict=True)
    }


def _projection(order: int) -> Prepared:
    _, modal, signals = _models()
    return Prepared(lambda: jax.block_until_ready(wallid.reduction.learn_system(modal, order, signals).system), eps_inf)


def _swarms(order: int, *, eliminated: bool, count: int) -> Prepared:
    """Several swarms that differ by their seed; the median of what they end at."""
    _, modal, signals = _models()

    def error(found: list[wallid.StateSpace]) -> dict[str, float]:
        errors = [eps_inf(system) for system in found]
        return {name: float(np.median([each[name] for each in errors])) for name in errors[0]}

    run = by_swarm(modal, order, signals, eliminated=eliminated)
    return Prepared(lambda: [run(seed) for seed in range(count)], error, units=count, once=True)


def _pymor(order: int, way: str) -> Prepared:
    return Prepared(partial(by_pymor, _models()[0], order, way), eps_inf)


def _contenders() -> dict[str, Callable[[], Any]]:
    found: dict[str, Callable[[], Any]] = {}
    for order in ORDERS:
        found |= {
            f"variable projection, order {order}": partial(_projection, order),
            f"particle swarm, order {order}": partial(_swarms, order, eliminated=False, count=SWARMS),
            f"particle swarm on the poles alone, order {order}": partial(_swarms, order, eliminated=True, count=1),
            f"balanced truncation, order {order}": partial(_pymor, order, "balanced truncation"),
            f"IRKA, order {order}": partial(_pymor, order, "IRKA"),
        }
    return found


CONTENDERS = _contenders()


def asked(results: Results) -> list[Asked]:
    """What the issue asks, for both orders and both face signals."""
    rows = []
    for order in ORDERS:
        ours, swarm = f"variable projection, order {order}", f"particle swarm, order {order}"
        rows += [error_ratio(results, ours, swarm, errors, 1 / 100) for errors in (LEARNED, NEVER)]
        rows.append(within(results, ours, swarm, 1 / 2))
        rows += [
            error_ratio(results, ours, f"{way}, order {order}", LEARNED + NEVER, 1 / 30)
            for way in ("balanced truncation", "IRKA")
        ]
    return rows
