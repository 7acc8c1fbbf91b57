"""Integration of a state space in time: `simulate` by diffrax, and `propagate`, the same exact step on uniform rows.

The inputs are straight lines between rows, `(time, input)`, or cubics from their values and slopes, `(time, 2 input)`.
The default solver takes one exact step per row.
"""

from __future__ import annotations

from functools import partial
from typing import Literal

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox.internal import nondifferentiable_backward
from jax.core import Tracer
from jaxtyping import Array, Float, ScalarLike

from .._internal.arrays import on_device
from .exponential_solver import Exponential, ModelVectorField, State, input_path, outputs, step_map
from .recurrence.blocks import run_in_blocks
from .recurrence.row_by_row import run_row_by_row
from .recurrence.single_kernel import fits_single_kernel, run_in_one_kernel
from .state_space import StateSpace

_SEGMENT_ROWS = 4096  # a multiple of every block length of `run_in_blocks`
_FLOAT = np.dtype(float)

ArrayLike = Array | np.ndarray

Outputs = Float[Array, "time output"]

FORWARD = diffrax.ForwardMode()
_REVERSE_ADJOINT = (
    "simulate: adjoint = ForwardMode() is for forward mode (jax.jvp, jax.jacfwd) only; for reverse mode (jax.grad, "
    "jax.vjp, jax.jacrev) give `adjoint=diffrax.RecursiveCheckpointAdjoint()`, or use `wallid.models.propagate`, which "
    "takes both"
)
_FORWARD_ADJOINT = (
    "simulate: adjoint = {}() is for reverse mode (jax.grad, jax.vjp, jax.jacrev) only; for forward mode (jax.jvp, "
    "jax.jacfwd) give `adjoint=diffrax.ForwardMode()`, for both `adjoint=diffrax.DirectAdjoint()`, or use "
    "`wallid.models.propagate`, which takes both"
)


class StepToRows(diffrax.StepTo):
    """Steps from row to row, for times that are known to increase from t0 to t1.

    `diffrax.StepTo` checks the times by a callback into Python. JAX does not store a program with a callback in its
    compilation cache.
    """

    def wrap(self, direction):
        """The same times for an integration in the direction 1 or -1."""
        return type(self)(ts=self.ts * direction)

    def init(self, terms, t0, t1, y0, dt0, args, func, error_order):
        """The end of the first step."""
        return self.ts[1], 2


def simulate(
    system: StateSpace,
    fourier: ScalarLike,
    time: Float[ArrayLike, " time"],
    inputs: Float[ArrayLike, "time column"],
    initial: Float[ArrayLike, " param"],
    *,
    sensitivity: bool = False,
    solver: diffrax.AbstractSolver = Exponential(),  # noqa: B008 (immutable)
    controller: diffrax.AbstractAdaptiveStepSizeController | None = None,
    substeps: int = 1,
    adjoint: diffrax.AbstractAdjoint = FORWARD,
    max_steps: int | None = None,
) -> tuple[Outputs, Outputs | None]:
    """The outputs of a model, by diffrax.

        x' = (Fo A + A0) x + (Fo B + B0) q,   u = C x + D q,   x(0) = P a

    Args:
        system: a full-order or reduced-order model.
        fourier: Fo = t_ref alpha / L^2, 1.
        time: the rows' times in t_ref, `(time,)`, strictly increasing; the steps may differ.
        inputs: the inputs `q` at the rows, `(time, input)`, 1, for straight lines between rows; or the inputs, then
            their slopes per unit of t_ref, `(time, 2 input)`, for cubics between rows.
        initial: the coefficients `a` of the initial profile, `(param,)`, 1.
        sensitivity: also integrate theta = du/dFo by its explicit system.
        solver: `Exponential()` (exact), `diffrax.Heun()` or `diffrax.Midpoint()` (the paper's; stable for steps up to
            `2 / (Fo |lambda|_max)`, see `stable_substeps`), or an implicit one.
        controller: None for `substeps` equal steps between rows. An adaptive controller also steps to every row.
        substeps: number of equal steps between rows.
        adjoint: how diffrax is differentiated: `diffrax.ForwardMode()` in forward mode (`jax.jvp`, `jax.jacfwd`),
            `diffrax.RecursiveCheckpointAdjoint()` in reverse mode (`jax.grad`, `jax.jacrev`), and the slower
            `diffrax.DirectAdjoint()` in both, such as forward over reverse.
        max_steps: for an adaptive controller; None takes 64 steps per row, at least 4096.

    Returns:
        `u` and `theta` at the rows, `(time, output)`; `theta` is None without `sensitivity`. A solve that fails gives
        NaN or infinite values and raises no error, so a sweep continues.

    Raises:
        ValueError: shapes that do not fit the model; times that do not increase (inside a compiled function they
            give NaN); `Exponential` with an adaptive controller.
        RuntimeError: reverse mode with `ForwardMode`.
        TypeError: forward mode with `RecursiveCheckpointAdjoint`.
    """
    # arrays, because JAX would compile the program again for each new Python number
    fourier, time, inputs, initial = (_as_array(value) for value in (fourier, time, inputs, initial))
    _check_shapes(system, inputs, initial)
    if time.shape != inputs.shape[:1]:
        raise ValueError(f"simulate: {time.shape[0]} times for {inputs.shape[0]} rows of inputs")
    if controller is not None and isinstance(solver, Exponential):
        raise ValueError("simulate: the exact solver gives no error estimate; omit `controller`")
    if not isinstance(time, Tracer) and not np.all(np.diff(time) > 0):
        raise ValueError("simulate: the times must increase from row to row")
    try:
        return _simulate(
            system, fourier, time, inputs, initial, sensitivity, solver, controller, substeps, adjoint, max_steps
        )
    except TypeError as error:
        if "custom_vjp" in str(error):
            raise TypeError(_FORWARD_ADJOINT.format(type(adjoint).__name__)) from error
        raise


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
    field = ModelVectorField(system, fourier, input_path(time, inputs, _are_cubic(system, inputs)))
    steps_controller: diffrax.AbstractStepSizeController
    if controller is None:
        fractions = jnp.arange(substeps) / substeps
        step_times = (time[:-1, None] + jnp.diff(time)[:, None] * fractions).reshape(-1)
        step_times = jnp.concatenate([step_times, time[-1:]])
        steps_controller = StepToRows(ts=step_times)
        steps = step_times.shape[0] - 1
        saveat = diffrax.SaveAt(t0=True, steps=True, fn=field.output)
    else:
        steps_controller = diffrax.ClipStepSizeController(controller, step_ts=time)
        steps = max(4096, 64 * time.shape[0]) if max_steps is None else max_steps
        substeps = 1
        saveat = diffrax.SaveAt(ts=time, fn=field.output)
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(field),
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
    increasing = jnp.all(jnp.diff(time) > 0)
    rows = jax.tree.map(lambda rows: jnp.where(increasing, rows[::substeps], jnp.nan), solution.ys)
    return nondifferentiable_backward(rows, msg=_REVERSE_ADJOINT) if isinstance(adjoint, diffrax.ForwardMode) else rows


def propagate(
    system: StateSpace,
    fourier: ScalarLike,
    step: ScalarLike,
    inputs: Float[ArrayLike, "time column"],
    initial: Float[ArrayLike, " param"],
    *,
    sensitivity: bool = False,
) -> tuple[Outputs, Outputs | None]:
    """The outputs of a model on uniform rows, equal to those of `simulate` with the exact solver.

    The exact step is computed once. The rows are processed in segments, and only the states of one segment are stored.
    It is differentiable in forward and reverse mode by all its arrays.

    Args:
        system: a full-order or reduced-order model.
        fourier: Fo = t_ref alpha / L^2, 1.
        step: time between rows, in t_ref.
        inputs: the inputs `q` at the rows, `(time, input)`, 1, for straight lines between rows; or the inputs, then
            their slopes per unit of t_ref, `(time, 2 input)`, for cubics between rows.
        initial: the coefficients `a` of the initial profile, `(param,)`, 1.
        sensitivity: also compute theta = du/dFo.

    Returns:
        `u` and `theta` at the rows, `(time, output)`; `theta` is None without `sensitivity`.

    Raises:
        TypeError: `system` is not a `StateSpace`.
        ValueError: shapes that do not fit the model.
    """
    if not isinstance(system, StateSpace):
        raise TypeError(
            f"propagate: `system` must be a StateSpace, not a {type(system).__name__}; pass `.system` of a LearnedModel"
        )
    arrays = _as_array(fourier), _as_array(step), _as_array(inputs), _as_array(initial)
    return _propagate(system, *arrays, sensitivity)


@partial(jax.jit, static_argnames="sensitivity")  # eqx.filter_jit adds a large part of a run of 0.1 ms
def _propagate(
    system: StateSpace,
    fourier: Array,
    step: Array,
    inputs: Array,
    initial: Array,
    sensitivity: bool,
) -> tuple[Outputs, Outputs | None]:
    _check_shapes(system, inputs, initial)
    exact = step_map(system, fourier, step, sensitivity=sensitivity, cubic=_are_cubic(system, inputs))
    start = _initial_state(system, initial, sensitivity)
    if fits_single_kernel(system):
        return run_in_one_kernel(system, exact, start, inputs)
    run_segment = partial(run_in_blocks if system.is_diagonal else run_row_by_row, system, exact)
    parts = [jax.tree.map(lambda row: row[None], outputs(system, start, inputs[0, : system.B.shape[1]]))]
    full_rows = (inputs.shape[0] - 1) // _SEGMENT_ROWS * _SEGMENT_ROWS
    if full_rows:
        # neighbouring segments share a row
        segments = inputs[:full_rows].reshape(-1, _SEGMENT_ROWS, inputs.shape[1])
        segments = jnp.concatenate([segments, inputs[_SEGMENT_ROWS : full_rows + 1 : _SEGMENT_ROWS, None]], axis=1)
        start, by_segment = jax.lax.scan(run_segment, start, segments)
        parts.append(jax.tree.map(lambda rows: rows.reshape(-1, rows.shape[-1]), by_segment))
    if inputs.shape[0] - 1 > full_rows:
        parts.append(run_segment(start, inputs[full_rows:])[1])
    return jax.tree.map(lambda *rows: jnp.concatenate(rows), *parts)


Integrator = Literal["propagator", "diffrax"]
"""The implementation of the exact step on uniform rows: `propagate`, or `diffrax.diffeqsolve`."""


def run_rows(
    system: StateSpace,
    fourier: ScalarLike,
    step: ScalarLike,
    inputs: Float[ArrayLike, "time column"],
    initial: Float[ArrayLike, " param"],
    *,
    sensitivity: bool = False,
    integrator: Integrator = "propagator",
    adjoint: diffrax.AbstractAdjoint = FORWARD,
) -> tuple[Outputs, Outputs | None]:
    """The outputs on uniform rows, `step` in t_ref, by `propagate` or by `simulate` with the exact solver.

    `adjoint` is that of `simulate`; the propagator is differentiable in forward and reverse mode without one.
    """
    if integrator == "propagator":
        return propagate(system, fourier, step, inputs, initial, sensitivity=sensitivity)
    time = jnp.asarray(step) * jnp.arange(inputs.shape[0])
    return simulate(system, fourier, time, inputs, initial, sensitivity=sensitivity, adjoint=adjoint)


def stable_substeps(system: StateSpace, fourier: float, step: float) -> int:
    """The number of stable steps of Heun's or the midpoint method between two rows.

    Both are stable for `h Fo |lambda| <= 2`. Gershgorin's circles bound `|lambda|`.

    Args:
        system: a full-order or reduced-order model.
        fourier: Fo = t_ref alpha / L^2, 1.
        step: time between rows, in t_ref.

    Returns:
        `substeps` for `simulate`, at least 1.
    """
    bound = jnp.max(jnp.abs(system.A) if system.is_diagonal else jnp.sum(jnp.abs(system.A), axis=1))
    return max(1, int(jnp.ceil(fourier * bound * step / 2.0)))


def _as_array(value: ScalarLike | ArrayLike) -> Array:
    """The value as a float64 array; no conversion where it is one already, which saves time in a run of 0.1 ms."""
    # `==`, not `is`: an array from a pickle may have another dtype object for float64
    return value if isinstance(value, jax.Array) and value.dtype == _FLOAT else jnp.asarray(on_device(value), float)


def _initial_state(system: StateSpace, initial: Float[Array, " param"], sensitivity: bool) -> State:
    x0 = system.P @ initial
    return x0, (jnp.zeros_like(x0) if sensitivity else None)


def _are_cubic(system: StateSpace, inputs: Array) -> bool:
    """Whether the inputs are values and slopes, for cubics between rows."""
    return inputs.shape[1] == 2 * system.B.shape[1]


def _check_shapes(system: StateSpace, inputs: Array, initial: Array) -> None:
    count = system.B.shape[1]
    if inputs.ndim != 2 or inputs.shape[1] not in (count, 2 * count):
        raise ValueError(
            f"inputs: shape {inputs.shape}; it must be (time, {count}), one column for each input, or "
            f"(time, {2 * count}) with their slopes too"
        )
    if inputs.shape[0] < 2:
        raise ValueError("inputs: at least two rows are needed")
    if initial.shape != (system.P.shape[1],):
        raise ValueError(
            f"initial: shape {initial.shape}; the model's initial profile has {system.P.shape[1]} coefficients"
        )
