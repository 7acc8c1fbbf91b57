"""The recurrence of a diagonal model in blocks of rows, as products of matrices: for models of many modes."""

from __future__ import annotations

import math
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..exponential_solver import State, StepMap, direct_term, thin_product
from ..state_space import StateSpace
from .row_by_row import MAX_ORDER_FOR_SUMS, SegmentResult


def run_in_blocks(
    system: StateSpace, exact: StepMap, state: State, inputs: Float[Array, "time column"]
) -> SegmentResult:
    """u and theta in blocks of rows, for a diagonal model. The numbers are those of `run_row_by_row`.

    theta is the tangent of u along the derivative of the step by Fo. The returned state is that of the last row only
    where the rows fill the blocks, as a large power of two does.
    """
    run = partial(_in_blocks, inputs, _block_length(inputs.shape[0] - 1, system.order))
    x, theta = state
    step, derivative = (exact.E, exact.W0, exact.W1, x), (exact.E_theta, exact.V0, exact.V1, theta)
    if theta is None:
        x, u = run(system.C, *step)
        y = None
    else:
        (x, u), (theta, y) = jax.jvp(partial(run, system.theta_outputs), step, derivative)
        if system.C_theta is not None:
            _, u = run(system.C, *step)
    return (x, theta), (u + thin_product(direct_term(system, exact), inputs[1:]), y)


def _block_length(rows: int, order: int) -> int:
    """Rows of a block, as measured: long blocks need larger products and longer compilation, short ones more steps."""
    if rows <= 128:
        return 2
    if rows <= 1024:
        return 4
    return 8 if order <= MAX_ORDER_FOR_SUMS else 16


def _in_blocks(
    inputs: Float[Array, "time column"],
    length: int,
    C: Float[Array, "output node"],
    E: Float[Array, " node"],
    W0: Float[Array, "node column"],
    W1: Float[Array, "node column"],
    x: Float[Array, " node"],
) -> tuple[Float[Array, " node"], Float[Array, "later output"]]:
    """The state at the last block's end and `C x` at every row but the first.

    For `z = x - W1 q` a step takes one row of inputs,

        z_k+1 = E z_k + b q_k,      b = W0 + E W1,      C x_k = C z_k + C W1 q_k

    The effects of a block's inputs and of its first state on its outputs and its last state are matrix products, the
    same for all blocks. Only the first states of the blocks are a recurrence.
    """
    rows, width = inputs.shape[0] - 1, inputs.shape[1]
    count = -(-rows // length)
    block_inputs = zero_padded(inputs[:-1], count * length).reshape(count, length * width)

    power = jnp.stack([jnp.ones_like(E), E])
    while power.shape[0] <= length:
        power = jnp.concatenate([power, power[-1] * power[1:]])
    response = power[:-1, :, None] * (W0 + E[:, None] * W1)  # of z to a unit input, from the next row on
    first, last = _block_start_states(
        power[-1], block_inputs @ input_to_final_state(response), x - thin_product(W1, inputs[0])
    )

    input_to_outputs = convolution_matrix(jnp.einsum("on,kni->kio", C, response))
    outputs = (block_inputs @ input_to_outputs + first @ state_to_outputs(C, power[1:])).reshape(count * length, -1)[
        :rows
    ]
    return last + thin_product(W1, inputs[-1]), outputs + thin_product(C @ W1, inputs[1:])


def convolution_matrix(kernel: Float[Array, "row input output"]) -> Float[Array, "row*input row*output"]:
    """The matrix that maps the inputs of a block to its outputs, from the response `kernel` to one input."""
    length, width, _ = kernel.shape
    later = np.arange(length) - np.arange(length)[:, None]
    # axes: row of the input, row of the output, input, output
    blocks = jnp.where((later >= 0)[..., None, None], kernel[np.maximum(later, 0)], 0.0)
    return blocks.swapaxes(1, 2).reshape(length * width, -1)


def state_to_outputs(
    C: Float[Array, "output node"], power: Float[Array, "row node"]
) -> Float[Array, "node row*output"]:
    """The matrix that maps a state to the outputs at some rows, at which its modes have decayed by `power`."""
    return (power.T[:, :, None] * C.T[:, None]).reshape(C.shape[1], -1)


def input_to_final_state(response: Float[Array, "row node input"]) -> Float[Array, "row*input node"]:
    """The matrix that maps the inputs of a block to the state after its last row."""
    return response[::-1].swapaxes(1, 2).reshape(-1, response.shape[1])


def _block_start_states(
    E: Float[Array, " node"], forcing: Float[Array, "block node"], x: Float[Array, " node"]
) -> tuple[Float[Array, "block node"], Float[Array, " node"]]:
    """The first state of each block, and the state after the last one: `x_b+1 = E x_b + f_b`.

    In about the square root of the number of blocks as groups side by side: each from a zero state, then the groups'
    first states as a recurrence, whose effect n blocks later is `E^n` times them.
    """
    count = forcing.shape[0]
    groups = math.isqrt(count) + 1
    length = -(-(count + 1) // groups)
    grouped = zero_padded(forcing, groups * length).reshape(groups, length, -1).swapaxes(0, 1)

    def step(now: tuple[Array, Array], forcing: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """One block further in all groups, and the power of `E`."""
        return (E * now[0] + forcing, E * now[1]), now

    zero = jnp.zeros((groups, E.shape[0])), jnp.ones_like(E)
    (ends, full_power), (from_zero, power) = jax.lax.scan(step, zero, grouped)
    _, firsts = jax.lax.scan(lambda now, end: (full_power * now + end, now), x, ends)
    states = (from_zero + power[:, None] * firsts).swapaxes(0, 1).reshape(groups * length, -1)
    return states[:count], states[count]


def zero_padded(rows: Float[Array, "few column"], count: int) -> Float[Array, "many column"]:
    """The rows, padded with zeros to `count` rows."""
    return jnp.concatenate([rows, jnp.zeros((count - rows.shape[0], rows.shape[1]))])
