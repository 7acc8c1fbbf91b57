"""The recurrence of a model, one row after the other: for any model, and the reference for the faster ways."""

from __future__ import annotations

import jax
from jaxtyping import Array, Float

from ..exponential_solver import State, StepMap, times
from ..state_space import StateSpace

FEW = 16  # states: below, sums are cheaper than products of thin matrices

Stretch = tuple[State, tuple[Array, Array | None]]
"""The state at the last row; u and theta at every row but the first, theta None without the sensitivity."""


def run_row_by_row(system: StateSpace, exact: StepMap, state: State, inputs: Float[Array, "time input"]) -> Stretch:
    """One row after the other: for any model."""
    drives = exact.drive(inputs[:-1], inputs[1:])
    state, (x, theta) = jax.lax.scan(lambda now, drive: (moved := exact.move(now, drive), moved), state, drives)
    apply = times if system.order <= FEW else lambda matrix, rows: rows @ matrix.T
    u = apply(system.C, x) + times(system.D, inputs[1:])
    return state, (u, None if theta is None else apply(system.theta_outputs, theta))
