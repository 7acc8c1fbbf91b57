"""Integration in time: one `simulate` through diffrax, and the same exact step on uniform records.

The inputs are straight lines between their rows; the default solver takes one exact step a row.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Literal

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, ScalarLike

from .exponential import Exponential, Flow, State, StepMap, outputs, step_map, times
from .statespace import StateSpace

_STRETCH = 4096  # rows
_FEW = 16  # states: below, sums are cheaper than a product of thin matrices

ArrayLike = Array | np.ndarray

Outputs = Float[Array, "time output"]


def simulate(
    system: StateSpace,
    fourier: ScalarLike,
    time: Float[ArrayLike, " time"],
    inputs: Float[ArrayLike, "time input"],
    initial: Float[ArrayLike, " param"],
    *,
    sensitivity: bool = False,
    solver: diffrax.AbstractSolver = Exponential(),  # noqa: B008 (immutable)
    controller: diffrax.AbstractAdaptiveStepSizeController | None = None,
    substeps: int = 1,
    adjoint: diffrax.AbstractAdjoint = diffrax.ForwardMode(),  # noqa: B008 (immutable)
    max_steps: int | None = None,
) -> tuple[Outputs, Outputs | None]:
    """The outputs of a model under inputs that are straight lines between rows, by diffrax.

    Arguments:
        fourier: Fo = t_ref alpha / L^2.
        time: the rows' times in t_ref, strictly increasing, any steps.
        inputs: the inputs at the rows.
        initial: the coefficients `a` of the initial profile.
        sensitivity: also integrate theta = du/dFo by its explicit system.
        solver: `Exponential()` (exact), `diffrax.Heun()` or `Midpoint()` (the paper's; stable for
            steps under `2 / (Fo |lambda|_max)`, see `stable_substeps`), or an implicit one.
        controller: None for `substeps` equal steps between rows; an adaptive controller is clipped
            to the rows.
        adjoint: `ForwardMode()` for forward derivatives, diffrax's others for reverse ones.
        max_steps: for an adaptive controller; None takes 64 steps per row, at least 4096.

    Returns:
        `u` and `theta` at the rows (`theta` is None without `sensitivity`). A solve that fails
        gives NaN or infinite values, so a sweep goes on.

    Raises:
        ValueError: shapes that do not fit the model; `Exponential` with an adaptive controller.
    """
    # as arrays, or each new number would be compiled anew
    fourier, time, inputs, initial = (_as_array(given) for given in (fourier, time, inputs, initial))
    _check_shapes(system, inputs, initial)
    if time.shape != inputs.shape[:1]:
        raise ValueError(f"simulate: {time.shape[0]} times for {inputs.shape[0]} rows of inputs")
    if controller is not None and isinstance(solver, Exponential):
        raise ValueError("simulate: the exact solver has no error to control; leave `controller` out")
    return _simulate(
        system, fourier, time, inputs, initial, sensitivity, solver, controller, substeps, adjoint, max_steps
    )


@eqx.filter_jit
def _simulate(
    system: StateSpace,
    fourier: Array,
    time: Array,
    inputs: Array,
    initial: Array,
    sensitivity: bool,
    solver: diffrax.AbstractSolver,
    controller: diffrax.AbstractAdaptiveStepSizeController | None,
    substeps: int,
    adjoint: diffrax.AbstractAdjoint,
    max_steps: int | None,
) -> tuple[Outputs, Outputs | None]:
    flow = Flow(system, fourier, diffrax.LinearInterpolation(time, inputs))
    steps_controller: diffrax.AbstractStepSizeController
    if controller is None:
        fractions = jnp.arange(substeps) / substeps
        fine = (time[:-1, None] + jnp.diff(time)[:, None] * fractions).reshape(-1)
        fine = jnp.concatenate([fine, time[-1:]])
        steps_controller = diffrax.StepTo(ts=fine)
        steps = fine.shape[0] - 1
        saveat = diffrax.SaveAt(t0=True, steps=True, fn=flow.output)
    else:
        steps_controller = diffrax.ClipStepSizeController(controller, step_ts=time)
        steps = max(4096, 64 * time.shape[0]) if max_steps is None else max_steps
        substeps = 1
        saveat = diffrax.SaveAt(ts=time, fn=flow.output)
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(flow),
        solver,
        t0=time[0],
        t1=time[-1],
        dt0=None,
        y0=_initial_state(system, initial, sensitivity),
        saveat=saveat,
        stepsize_controller=steps_controller,
        adjoint=adjoint,
        max_steps=steps,
        throw=False,
    )
    u, theta = solution.ys  # pyright: ignore[reportGeneralTypeIssues]
    return u[::substeps], None if theta is None else theta[::substeps]


def propagate(
    system: StateSpace,
    fourier: ScalarLike,
    step: ScalarLike,
    inputs: Float[ArrayLike, "time input"],
    initial: Float[ArrayLike, " param"],
    *,
    sensitivity: bool = False,
) -> tuple[Outputs, Outputs | None]:
    """The same numbers as `simulate` with the exact solver, for rows `step` (in t_ref) apart.

    The exact step is made once; the states of a stretch of rows are kept at a time, so memory does
    not grow with nodes times rows.

    Arguments, Returns, Raises: as in `simulate`.
    """
    fourier, step, inputs, initial = (_as_array(given) for given in (fourier, step, inputs, initial))
    _check_shapes(system, inputs, initial)
    return _propagate(system, fourier, step, inputs, initial, sensitivity)


@partial(jax.jit, static_argnames="sensitivity")  # where a run takes 0.1 ms, filter_jit's own time counts
def _propagate(
    system: StateSpace, fourier: Array, step: Array, inputs: Array, initial: Array, sensitivity: bool
) -> tuple[Outputs, Outputs | None]:
    exact = step_map(system, fourier, step, sensitivity=sensitivity)
    start = _initial_state(system, initial, sensitivity)
    pass_through = partial(_in_lanes if system.is_diagonal else _in_turn, system, exact)
    parts = [jax.tree.map(lambda row: row[None], outputs(system, start, inputs[0]))]
    whole = (inputs.shape[0] - 1) // _STRETCH * _STRETCH
    if whole:
        # a stretch needs the last row before it
        before = inputs[:whole].reshape(-1, _STRETCH, inputs.shape[1])
        in_stretches = jnp.concatenate([before, inputs[_STRETCH : whole + 1 : _STRETCH, None]], axis=1)
        start, long = jax.lax.scan(pass_through, start, in_stretches)
        parts.append(jax.tree.map(lambda rows: rows.reshape(-1, rows.shape[-1]), long))
    if inputs.shape[0] - 1 > whole:
        parts.append(pass_through(start, inputs[whole:])[1])
    return jax.tree.map(lambda *rows: jnp.concatenate(rows), *parts)


Pair = tuple[Array, Array | None]
"""Of x and of theta, in any shape."""

Stretch = tuple[State, Pair]


def _in_turn(system: StateSpace, exact: StepMap, state: State, inputs: Array) -> Stretch:
    """The last state, and the outputs at every row but the first, one row after the other."""
    drives = exact.drive(inputs[:-1], inputs[1:])
    state, states = jax.lax.scan(lambda now, drive: (moved := exact.move(now, drive), moved), state, drives)
    return state, _outputs(system, states, inputs[1:])


def _in_lanes(system: StateSpace, exact: StepMap, state: State, inputs: Array) -> Stretch:
    """The same for a diagonal model, in some square root of the rows' number of lanes side by side.

    Each lane is a run of consecutive rows from rest; then the lanes' first states follow from each other, and what they
    add at a row is linear in them: at row n of a lane `E^n x_0` and `E^n theta_0 + (E^n)' x_0`. That takes twice the
    square root of the steps in turn, each wide enough for a processor's vector units.
    """
    rows = inputs.shape[0] - 1
    lanes = math.isqrt(rows)
    length = -(-rows // lanes)
    held = jnp.concatenate([inputs, jnp.broadcast_to(inputs[-1:], (lanes * length - rows, inputs.shape[1]))])
    before, after = (part.reshape(lanes, length, -1).swapaxes(0, 1) for part in (held[:-1], held[1:]))
    rest = jax.tree.map(lambda part: jnp.zeros((lanes, *part.shape)), state)
    one = jnp.ones_like(exact.E)
    powers = (one, None if exact.E_theta is None else jnp.zeros_like(one))
    still = jax.tree.map(jnp.zeros_like, powers)

    def step(now: tuple[Pair, Pair], q: tuple[Array, Array]) -> tuple[tuple[Pair, Pair], tuple[Pair, Pair]]:
        """All lanes a row on; what the inputs add is made here: kept for all rows it would fill the cache."""
        moved = exact.advance(now[0], *q), exact.move(now[1], still)
        return moved, moved

    _, (from_rest, power) = jax.lax.scan(step, (rest, powers), (before, after))
    power = jax.tree.map(lambda part: part[:, None], power)
    lane, ends_from_rest = jax.tree.map(lambda part: part[-1, 0], power), jax.tree.map(lambda part: part[-1], from_rest)
    _, firsts = jax.lax.scan(lambda now, end: (_from(lane, now, end), now), state, ends_from_rest)
    states = _from(power, firsts, from_rest)
    by_lane = _outputs(system, states, after)
    in_order = jax.tree.map(lambda part: part.swapaxes(0, 1).reshape(lanes * length, -1)[:rows], by_lane)
    last = divmod(rows - 1, length)[::-1]
    return jax.tree.map(lambda part: part[last], states), in_order


def _from(power: Pair, first: Pair, from_rest: Pair) -> Pair:
    """The states some steps after `first`, by the powers of the step and the states from rest under the same inputs."""
    (E, E_theta), (x, theta) = power, first
    if theta is None or E_theta is None or from_rest[1] is None:
        return E * x + from_rest[0], None
    return E * x + from_rest[0], E * theta + E_theta * x + from_rest[1]


def _outputs(system: StateSpace, states: Pair, inputs: Array) -> Pair:
    """`outputs` of many rows at once."""
    x, theta = states
    apply = times if system.order <= _FEW else lambda matrix, rows: rows @ matrix.T
    u = apply(system.C, x) + times(system.D, inputs)
    return u, None if theta is None else apply(system.C if system.C_theta is None else system.C_theta, theta)


Integrator = Literal["propagator", "diffrax"]
"""How uniform rows are stepped through: the fast scan, or `diffrax.diffeqsolve`; the same exact step."""


def run_rows(
    system: StateSpace,
    fourier: ScalarLike,
    step: ScalarLike,
    inputs: Float[ArrayLike, "time input"],
    initial: Float[ArrayLike, " param"],
    *,
    sensitivity: bool = False,
    integrator: Integrator = "propagator",
) -> tuple[Outputs, Outputs | None]:
    """`propagate`, or `simulate` with the exact solver, on rows `step` (in t_ref) apart."""
    if integrator == "propagator":
        return propagate(system, fourier, step, inputs, initial, sensitivity=sensitivity)
    time = jnp.asarray(step) * jnp.arange(inputs.shape[0])
    return simulate(system, fourier, time, inputs, initial, sensitivity=sensitivity)


def stable_substeps(system: StateSpace, fourier: float, step: float) -> int:
    """How many steps of Heun's or the midpoint method a step of `step` (in t_ref) needs to be stable.

    Both are stable for `h |lambda| <= 2`; `|lambda|` is bounded by Gershgorin's circles.
    """
    bound = jnp.max(jnp.abs(system.A) if system.is_diagonal else jnp.sum(jnp.abs(system.A), axis=1))
    return max(1, int(jnp.ceil(fourier * bound * step / 2.0)))


def _as_array(given: ScalarLike | ArrayLike) -> Array:
    """In float64; what is that already is left alone, which a call of 0.1 ms feels."""
    return given if isinstance(given, jax.Array) and given.dtype == jnp.float64 else jnp.asarray(given, dtype=float)


def _initial_state(system: StateSpace, initial: Float[Array, " param"], sensitivity: bool) -> State:
    x0 = system.P @ initial
    return x0, (jnp.zeros_like(x0) if sensitivity else None)


def _check_shapes(system: StateSpace, inputs: Array, initial: Array) -> None:
    if inputs.ndim != 2 or inputs.shape[1] != system.B.shape[1]:
        raise ValueError(
            f"inputs: shape {inputs.shape}; this model wants (time, {system.B.shape[1]}), one column an input"
        )
    if inputs.shape[0] < 2:
        raise ValueError("inputs: at least two rows are needed")
    if initial.shape != (system.P.shape[1],):
        raise ValueError(f"initial: shape {initial.shape}; this model's profile has {system.P.shape[1]} coefficients")
