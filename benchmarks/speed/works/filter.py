"""The likelihood of a wall of two nodes with process noise, and its maximum, beside statsmodels."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.speed.measure import AbsentError, Prepared
from benchmarks.speed.works.ratio import Asked, Results

ROWS = 10_000
TITLE = f"the likelihood of a wall of two nodes with process noise, {ROWS} rows, and its maximum over four parameters"
LIKELIHOOD, GRADIENT, FIT = "likelihood", "likelihood and gradient", "fit"


@cache
def _work() -> tuple[Any, np.ndarray, np.ndarray]:
    """The wall's module, which needs statsmodels, and a record."""
    try:
        from benchmarks.reference import two_node_wall
    except ModuleNotFoundError as error:
        raise AbsentError(f"{error.name} is not installed") from error
    return two_node_wall, *two_node_wall.simulated(ROWS)


def _ours(what: str) -> Prepared:
    wall, faces, y = _work()
    theta = jnp.asarray(wall.START)
    if what == FIT:
        return Prepared(wall.fitted(faces, y, 1e-2), lambda found: {"-log L": abs(found.fun + _best().llf)})
    function = wall.log_likelihood if what == LIKELIHOOD else jax.value_and_grad(wall.log_likelihood)
    compiled = jax.jit(lambda theta: function(theta, faces, y))

    def error(answer: Any) -> dict[str, float]:
        value = answer if what == LIKELIHOOD else answer[0]
        return {"-log L": abs(float(value) - wall.StatsmodelsWall(y, faces).loglike(wall.START))}

    return Prepared(lambda: jax.block_until_ready(compiled(theta)), error)


@cache
def _best() -> Any:
    """The maximum by statsmodels."""
    wall, faces, y = _work()
    return wall.StatsmodelsWall(y, faces).fit(disp=False, maxiter=500, method="bfgs", gtol=1e-6)


def _theirs(what: str) -> Prepared:
    wall, faces, y = _work()
    model = wall.StatsmodelsWall(y, faces)

    def nothing(answer: Any) -> dict[str, float]:
        return {"-log L": 0.0}

    if what == FIT:
        return Prepared(lambda: model.fit(disp=False, maxiter=500, method="bfgs", gtol=1e-6), nothing, once=True)
    if what == GRADIENT:
        return Prepared(lambda: (model.loglike(wall.START), model.score(wall.START)), nothing)
    return Prepared(lambda: model.loglike(wall.START), nothing)


CONTENDERS: dict[str, Callable[[], Prepared]] = {
    f"{name}, {what}": partial(make, what)
    for what in (LIKELIHOOD, GRADIENT, FIT)
    for name, make in (("wallid", _ours), ("statsmodels", _theirs))
}


def asked(results: Results) -> list[Asked]:
    """Nothing: the times stand beside each other."""
    del results
    return []
