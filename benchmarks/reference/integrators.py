"""Field and sensitivity as a user of SciPy or of plain diffrax would integrate them, from a model's matrices."""

from __future__ import annotations

from collections.abc import Callable

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import lsim
from scipy.sparse import csc_matrix

from wallid import StateSpace

Run = Callable[[], tuple[np.ndarray, np.ndarray]]


def augmented(system: StateSpace, fourier: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C, D of field and sensitivity together: `x' = Fo (A x + B q)`, `theta' = Fo A theta + A x + B q`."""
    A, B, C, D = (np.asarray(part) for part in (system.A, system.B, system.C, system.D))
    zero, none = np.zeros_like(A), np.zeros_like(C)
    return (
        np.block([[fourier * A, zero], [A, fourier * A]]),
        np.vstack([fourier * B, B]),
        np.block([[C, none], [none, C]]),
        np.vstack([D, np.zeros_like(D)]),
    )


def by_lsim(system: StateSpace, time: np.ndarray, inputs: np.ndarray, initial: np.ndarray) -> Callable[[float], tuple]:
    """`scipy.signal.lsim`: exact for straight lines between rows, by one dense exponential."""
    sensors, start = system.C.shape[0], _start(system, initial)

    def run(fourier: float) -> tuple[np.ndarray, np.ndarray]:
        _, y, _ = lsim(augmented(system, fourier), inputs, time, X0=start)
        return y[:, :sensors], y[:, sensors:]

    return run


def by_bdf(system: StateSpace, time: np.ndarray, inputs: np.ndarray, initial: np.ndarray, longest: float) -> Callable:
    """`scipy.integrate.solve_ivp`, BDF with the Jacobian given, sparse, rtol 1e-6; no step longer than `longest`."""
    sensors, start = system.C.shape[0], _start(system, initial)

    def run(fourier: float) -> tuple[np.ndarray, np.ndarray]:
        A, B, C, D = augmented(system, fourier)
        A = csc_matrix(A)

        def rate(t: float, x: np.ndarray) -> np.ndarray:
            return A @ x + B @ np.array([np.interp(t, time, column) for column in inputs.T])

        solved = solve_ivp(rate, (time[0], time[-1]), start, "BDF", time, jac=A, rtol=1e-6, atol=1e-8, max_step=longest)
        y = solved.y.T @ C.T + inputs @ D.T
        return y[:, :sensors], y[:, sensors:]

    return run


def by_heun(
    spacing: float,
    readout: np.ndarray,
    direct: np.ndarray,
    time: np.ndarray,
    inputs: np.ndarray,
    x0: np.ndarray,
    step: float,
) -> Callable[[float], tuple]:
    """Plain diffrax: Heun at a fixed step on the paper's central differences, theta beside the field.

    **Arguments:** `spacing`: of the nodes, of the wall's length; `readout`, `direct`: outputs from inner nodes and
    faces; `step`: of the integration, in t_ref.
    """
    times, q = jnp.asarray(time), jnp.asarray(inputs)
    C, D = jnp.asarray(readout), jnp.asarray(direct)
    steps = round(float((time[-1] - time[0]) / step))

    def second(field: jax.Array, faces: jax.Array) -> jax.Array:
        full = jnp.concatenate([faces[:1], field, faces[1:]])
        return (full[2:] - 2.0 * full[1:-1] + full[:-2]) / spacing**2

    def rate(t, state, args):
        fourier, path = args
        faces = path.evaluate(t)
        change = second(state[0], faces)
        return fourier * change, fourier * second(state[1], jnp.zeros(2)) + change

    def output(t, state, args):
        return C @ state[0] + D @ args[1].evaluate(t), C @ state[1]

    @jax.jit
    def solve(fourier):
        path = diffrax.LinearInterpolation(times, q)
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(rate),
            diffrax.Heun(),
            times[0],
            times[-1],
            step,
            (jnp.asarray(x0), jnp.zeros(len(x0))),
            args=(fourier, path),
            saveat=diffrax.SaveAt(ts=times, fn=output),
            max_steps=steps + 2,
            adjoint=diffrax.ForwardMode(),
        )
        return solution.ys

    return lambda fourier: jax.block_until_ready(solve(jnp.asarray(fourier)))


def _start(system: StateSpace, initial: np.ndarray) -> np.ndarray:
    return np.concatenate([np.asarray(system.P @ initial), np.zeros(system.order)])
