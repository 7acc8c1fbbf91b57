"""Integration in time: one `simulate` through diffrax, and the same exact step on uniform records.

The inputs are straight lines between their rows; the default solver takes one exact step a row.
"""

from __future__ import annotations

from functools import partial
from typing import Literal

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, ScalarLike

from .._internal.arrays import on_device
from .exponential_solver import Exponential, Flow, State, outputs, step_map
from .recurrence.blocks import in_blocks
from .recurrence.row_by_row import run_row_by_row
from .recurrence.single_kernel import is_small, run_in_one_kernel
from .state_space import StateSpace

_STRETCH = 4096  # rows, whole blocks of them
_FLOAT = np.dtype(float)

ArrayLike = Array | np.ndarray

Outputs = Float[Array, "time output"]


class ToRows(diffrax.StepTo):
    """diffrax's steps from row to row, for times that are known to increase from t0 to t1.

    diffrax's own checks of that call back into Python, and JAX's compilation cache keeps no program that does.
    """

    def wrap(self, direction):
        """The times as they are when time is turned round."""
        return type(self)(ts=self.ts * direction)

    def init(self, terms, t0, t1, y0, dt0, args, func, error_order):
        """The first step's end."""
        return self.ts[1], 2


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

    Args:
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
        ValueError: shapes that do not fit the model; times that do not increase (inside a compiled function they
            give NaN); `Exponential` with an adaptive controller.
    """
    # as arrays, or each new number would be compiled anew
    fourier, time, inputs, initial = (_as_array(given) for given in (fourier, time, inputs, initial))
    _check_shapes(system, inputs, initial)
    if time.shape != inputs.shape[:1]:
        raise ValueError(f"simulate: {time.shape[0]} times for {inputs.shape[0]} rows of inputs")
    if controller is not None and isinstance(solver, Exponential):
        raise ValueError("simulate: the exact solver has no error to control; leave `controller` out")
    if not isinstance(time, Tracer) and not np.all(np.diff(time) > 0):
        raise ValueError("simulate: the times must increase from row to row")
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
        steps_controller = ToRows(ts=fine)
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
    increasing = jnp.all(jnp.diff(time) > 0)
    return jax.tree.map(lambda rows: jnp.where(increasing, rows[::substeps], jnp.nan), solution.ys)


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
    if not isinstance(system, StateSpace):
        raise TypeError(
            f"propagate: a StateSpace is wanted, not a {type(system).__name__}; of what was learned, `.system`"
        )
    arrays = _as_array(fourier), _as_array(step), _as_array(inputs), _as_array(initial)
    return _propagate(system, *arrays, sensitivity)


@partial(jax.jit, static_argnames="sensitivity")  # filter_jit's own time counts where a run takes 0.1 ms
def _propagate(
    system: StateSpace,
    fourier: Array,
    step: Array,
    inputs: Array,
    initial: Array,
    sensitivity: bool,
) -> tuple[Outputs, Outputs | None]:
    _check_shapes(system, inputs, initial)
    exact = step_map(system, fourier, step, sensitivity=sensitivity)
    start = _initial_state(system, initial, sensitivity)
    if is_small(system):
        return run_in_one_kernel(system, exact, start, inputs)
    pass_through = partial(in_blocks if system.is_diagonal else run_row_by_row, system, exact)
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
    """`propagate`, or `simulate` with the exact solver, on rows `step` (in t_ref) apart: a part of a larger program."""
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
    # `==`: once a process has read a pickle, its arrays may have a float64 that is not this one
    return given if isinstance(given, jax.Array) and given.dtype == _FLOAT else jnp.asarray(on_device(given), float)


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
