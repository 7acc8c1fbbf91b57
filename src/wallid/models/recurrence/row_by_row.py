"""The recurrence of a model, one row after the other: for any model, and the reference for the faster ways."""

from __future__ import annotations

import jax
from jaxtyping import Array, Float

from ..exponential_solver import State, StepMap, direct_term, thin_product
from ..state_space import StateSpace

MAX_ORDER_FOR_SUMS = 16  # number of states up to which a sum is faster than a product of thin matrices

SegmentResult = tuple[State, tuple[Array, Array | None]]
"""The state at the last row; u and theta at every row but the first, theta None without the sensitivity."""


def run_row_by_row(
    system: StateSpace, exact: StepMap, state: State, inputs: Float[Array, "time column"]
) -> SegmentResult:
    """u and theta row by row, for any model: `x_k+1 = E x_k + W0 q_k + W1 q_k+1`, `u_k = C x_k + D q_k`."""

    def step(state: State, input_terms: State) -> tuple[State, State]:
        following = exact.next_state(state, input_terms)
        return following, following

    state, (x, theta) = jax.lax.scan(step, state, exact.input_terms(inputs[:-1], inputs[1:]))
    apply = thin_product if system.order <= MAX_ORDER_FOR_SUMS else lambda matrix, rows: rows @ matrix.T
    u = apply(system.C, x) + thin_product(direct_term(system, exact), inputs[1:])
    return state, (u, None if theta is None else apply(system.theta_outputs, theta))
