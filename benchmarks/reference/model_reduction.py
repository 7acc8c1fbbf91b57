"""Reduced models as a user would get them elsewhere: the paper's particle swarm, pyMOR's projections."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy

import wallid
from benchmarks.speed.measure import AbsentError
from wallid.models.section import AffineModel

PARTICLES, ITERATIONS = 50, 100  # the paper's
SLOWEST, FASTEST = 1.0, 3e4  # poles, per t_ref at Fo = 1
EVERY = 8  # of the signals' rows count, as in `wallid.variable_projection`


def by_pymor(nodal: wallid.StateSpace, order: int, way: str) -> wallid.StateSpace:
    """Balanced truncation or IRKA of the large model, which Fo scales as a whole.

    Raises:
        AbsentError: pyMOR is not installed.
    """
    model, balanced, irka = _pymor()
    matrices = [np.asarray(part) for part in (nodal.A, nodal.B, nodal.C, nodal.D)]
    reductor = (balanced if way == "balanced truncation" else irka)(model.from_matrices(*matrices))
    A, B, C, D = _explicit_matrices(reductor.reduce(order))
    return wallid.StateSpace(A=A, B=B, C=C, D=matrices[3] if D is None else D, P=np.zeros((order, 1)))


def section_by_pymor(
    model: AffineModel, conductivity: np.ndarray, heat_capacity: np.ndarray, order: int
) -> scipy.signal.StateSpace:
    """Balanced truncation of a section's full-order model at one value of its materials, by low-rank Gramians.

    Raises:
        AbsentError: pyMOR is not installed.
    """
    full_order, balanced, _ = _pymor()
    E, K, B = model.at(conductivity, heat_capacity)
    full = full_order.from_matrices(K.tocsc(), B, model.C.toarray(), model.D, E.tocsc())
    A, B, C, _ = _explicit_matrices(balanced(full).reduce(order))
    return scipy.signal.StateSpace(A, B, C, model.D)


def _pymor() -> tuple:
    """pyMOR's linear model, and its reductors by balanced truncation and by IRKA.

    Raises:
        AbsentError: pyMOR is not installed.
    """
    try:
        from pymor.core.logger import set_log_levels
        from pymor.models.iosys import LTIModel
        from pymor.reductors.bt import BTReductor
        from pymor.reductors.h2 import IRKAReductor
    except ImportError as missing:
        raise AbsentError("pyMOR is not installed") from missing
    set_log_levels({"pymor": "ERROR"})
    return LTIModel, BTReductor, IRKAReductor


def _explicit_matrices(model: Any) -> tuple:
    """A, B, C and D of a pyMOR model, solved for the derivative of the state."""
    A, B, C, D, E = model.to_matrices()
    if E is not None:
        A, B = np.linalg.solve(E, A), np.linalg.solve(E, B)
    return A, B, C, D


def response_of_rows(model: scipy.signal.StateSpace, faces: np.ndarray, step: float) -> np.ndarray:
    """The outputs at rows `step` s apart from a steady state on, exact for straight lines between rows.

    Temperatures are taken from the faces' mean on: a constant is not the model's to get right.
    """
    mean = faces.mean()
    first = np.linalg.solve(-model.A, model.B @ (faces[0] - mean))
    outputs = scipy.signal.lsim(model, faces - mean, step * np.arange(len(faces)), X0=first)[1]
    return mean + outputs.reshape(len(faces), -1)


def by_swarm(
    lom: wallid.StateSpace, order: int, signals: wallid.reduction.TrainingSignals, *, eliminated: bool
) -> Callable[[int], wallid.StateSpace]:
    """The paper's particle swarm (50 particles, 100 iterations) on the functional that `wallid.mim` minimises.

    `run(seed)`: the model that it ends at. Its cost is compiled before that.

    **Arguments:** `eliminated`: the swarm searches the poles alone and the outputs' matrix follows by least squares,
    which the paper does not do; else it searches poles, inputs and outputs.

    Raises:
        AbsentError: pyswarms is not installed.
    """
    try:
        import pyswarms
    except ImportError as missing:
        raise AbsentError("pyswarms is not installed") from missing
    logging.disable(logging.INFO)
    sensors = lom.C.shape[0]
    gain = lom.static_gain()
    want = _outputs(lom, signals)
    weight = [1.0 / jnp.sqrt(jnp.mean(part**2, axis=(1, 2), keepdims=True)) for part in want]

    def system(numbers: jax.Array, target: tuple | None = None) -> wallid.StateSpace:
        f = -jnp.exp(numbers[:order])
        b = jnp.stack([jnp.ones(order), jnp.zeros(order)], axis=1)  # only the left face moves
        if target is None:
            H = numbers[order:].reshape(sensors, order)
        else:
            basis = _outputs(_of(f, b, jnp.eye(order), -b), signals)
            rows = jnp.concatenate([(w * part).reshape(-1, order) for w, part in zip(weight, basis, strict=True)])
            Q, R = jnp.linalg.qr(rows)
            H = jax.scipy.linalg.solve_triangular(R, Q.T @ target[0]).T
        return _of(f, b, H, gain - H @ b)

    rest = want[0] - (signals.inputs[..., : gain.shape[1]] @ gain.T)[:, ::EVERY]
    target = (jnp.concatenate([(w * p).reshape(-1, sensors) for w, p in zip(weight, (rest, want[1]), strict=True)]),)

    def cost(numbers: jax.Array) -> jax.Array:
        found = _outputs(system(numbers, target if eliminated else None), signals)
        return sum(jnp.mean((w * (a - b)) ** 2) for w, a, b in zip(weight, found, want, strict=True))

    swarm_cost = jax.jit(lambda swarm: jax.lax.map(cost, swarm))
    lower = np.concatenate([np.full(order, np.log(SLOWEST)), np.full(0 if eliminated else sensors * order, -2.0)])
    upper = np.concatenate([np.full(order, np.log(FASTEST)), np.full(0 if eliminated else sensors * order, 2.0)])

    def model(numbers: np.ndarray) -> wallid.StateSpace:
        return jax.block_until_ready(system(jnp.asarray(numbers), target if eliminated else None))

    def run(seed: int) -> wallid.StateSpace:
        np.random.seed(seed)  # noqa: NPY002 (pyswarms draws from the global generator)
        search = pyswarms.single.GlobalBestPSO(
            PARTICLES, len(lower), {"c1": 1.5, "c2": 1.5, "w": 0.7}, bounds=(lower, upper)
        )
        _, best = search.optimize(lambda swarm: np.asarray(swarm_cost(jnp.asarray(swarm))), ITERATIONS, verbose=False)
        return model(best)

    jax.block_until_ready(swarm_cost(jnp.tile(lower, (PARTICLES, 1))))
    model(lower)
    return run


def _of(f: jax.Array, b: jax.Array, H: jax.Array, D: jax.Array) -> wallid.StateSpace:
    return wallid.StateSpace(A=f, B=-f[:, None] * b, C=H, D=D, P=jnp.zeros((f.shape[0], 1)))


def _outputs(system: wallid.StateSpace, signals: wallid.reduction.TrainingSignals) -> tuple[jax.Array, jax.Array]:
    """u and theta of every signal from rest, at the rows that count."""

    def run(fourier: jax.Array, inputs: jax.Array) -> tuple:
        still = jnp.zeros(system.P.shape[1])
        return wallid.models.propagate(system, fourier, signals.step, inputs, still, sensitivity=True)

    u, theta = jax.vmap(run)(signals.fourier, signals.inputs)
    return u[:, ::EVERY], theta[:, ::EVERY]
