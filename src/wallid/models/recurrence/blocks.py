"""The recurrence of a diagonal model in blocks of rows, as products of matrices: for models of many modes."""

from __future__ import annotations

import math
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..exponential_solver import State, StepMap, times
from ..state_space import StateSpace
from .row_by_row import FEW, Stretch


def in_blocks(system: StateSpace, exact: StepMap, state: State, inputs: Float[Array, "time input"]) -> Stretch:
    """In blocks of rows, for a diagonal model: theta is the tangent of u that the step's own derivative by Fo makes.

    The state is the last row's where the rows are whole blocks, so where their number is a large power of two.
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
    return (x, theta), (u + times(system.D, inputs[1:]), y)


def _block_length(rows: int, order: int) -> int:
    """As measured: long blocks take larger products and longer compiling, short ones more steps in turn."""
    if rows <= 128:
        return 2
    if rows <= 1024:
        return 4
    return 8 if order <= FEW else 16


def _in_blocks(
    inputs: Float[Array, "time input"],
    length: int,
    C: Float[Array, "output node"],
    E: Float[Array, " node"],
    W0: Float[Array, "node input"],
    W1: Float[Array, "node input"],
    x: Float[Array, " node"],
) -> tuple[Float[Array, " node"], Float[Array, "later output"]]:
    """The state at the last block's end and `C x` at every row but the first.

    For `z = x - W1 q` a step takes one row of inputs,

        z_k+1 = E z_k + b q_k,      b = W0 + E W1,      C x_k = C z_k + C W1 q_k

    What a block's inputs add to its outputs and to the state at its end, and what its first state adds, are products
    of matrices, the same for all blocks; only the blocks' first states follow from each other.
    """
    rows, width = inputs.shape[0] - 1, inputs.shape[1]
    count = -(-rows // length)
    driving = lengthened(inputs[:-1], count * length).reshape(count, length * width)

    power = jnp.stack([jnp.ones_like(E), E])
    while power.shape[0] <= length:
        power = jnp.concatenate([power, power[-1] * power[1:]])
    response = power[:-1, :, None] * (W0 + E[:, None] * W1)  # of z to a unit of input, one row later and on
    first, last = _first_states(power[-1], driving @ to_the_end(response), x - times(W1, inputs[0]))

    convolve = convolution(jnp.einsum("on,kni->kio", C, response))
    seen = (driving @ convolve + first @ observation(C, power[1:])).reshape(count * length, -1)[:rows]
    return last + times(W1, inputs[-1]), seen + times(C @ W1, inputs[1:])


def convolution(kernel: Float[Array, "row input output"]) -> Float[Array, "row*input row*output"]:
    """What as many rows of inputs, one after the other, make of the outputs: `kernel` says it of one, row by row."""
    length, width, _ = kernel.shape
    later = np.arange(length) - np.arange(length)[:, None]
    # driven, seen, input, output
    blocks = jnp.where((later >= 0)[..., None, None], kernel[np.maximum(later, 0)], 0.0)
    return blocks.swapaxes(1, 2).reshape(length * width, -1)


def observation(C: Float[Array, "output node"], power: Float[Array, "row node"]) -> Float[Array, "node row*output"]:
    """What a state makes of the outputs at some rows, one after the other, until which it has decayed by `power`."""
    return (power.T[:, :, None] * C.T[:, None]).reshape(C.shape[1], -1)


def to_the_end(response: Float[Array, "row node input"]) -> Float[Array, "row*input node"]:
    """What as many rows of inputs make of the state after the last: `response` says it of one, row by row."""
    return response[::-1].swapaxes(1, 2).reshape(-1, response.shape[1])


def _first_states(
    E: Float[Array, " node"], added: Float[Array, "block node"], x: Float[Array, " node"]
) -> tuple[Float[Array, "block node"], Float[Array, " node"]]:
    """The first state of each block and the state past the last, `x_b+1 = E x_b + added_b`.

    In some square root of the blocks' number of lanes side by side: each from rest, then the lanes' first states follow
    from each other, and what these add n blocks on is `E^n` times them.
    """
    count = added.shape[0]
    lanes = math.isqrt(count) + 1
    length = -(-(count + 1) // lanes)
    in_lanes = lengthened(added, lanes * length).reshape(lanes, length, -1).swapaxes(0, 1)

    def on(now: tuple[Array, Array], added: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """All lanes a block on, and the power of `E`."""
        return (E * now[0] + added, E * now[1]), now

    rest = jnp.zeros((lanes, E.shape[0])), jnp.ones_like(E)
    (ends, whole), (from_rest, power) = jax.lax.scan(on, rest, in_lanes)
    _, firsts = jax.lax.scan(lambda now, end: (whole * now + end, now), x, ends)
    states = (from_rest + power[:, None] * firsts).swapaxes(0, 1).reshape(lanes * length, -1)
    return states[:count], states[count]


def lengthened(rows: Float[Array, "few column"], count: int) -> Float[Array, "many column"]:
    """The rows, and zeros up to `count`."""
    return jnp.concatenate([rows, jnp.zeros((count - rows.shape[0], rows.shape[1]))])
