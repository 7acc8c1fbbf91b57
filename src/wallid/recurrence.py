"""The exact step of a model over many rows at once."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._xla import has_small_loops
from .exponential import State, StepMap, times
from .statespace import StateSpace

_FEW = 16  # states: below, sums are cheaper than products of thin matrices
_VECTOR = 8  # numbers in the widest vector of a common processor
_LANES = 64  # stretches of rows side by side: of fewer, XLA makes single numbers and not vectors
# up to where one loop or lanes are faster than blocks, as measured
_VERY_SMALL = 12  # states: however many rows there are
_SMALL = 24, 2**17  # states, and states times rows
_LONG = 256  # rows from which lanes are long enough

Pair = tuple[Array, Array | None]
"""Something of the field, and of the sensitivity where it is asked for."""

Stretch = tuple[State, tuple[Array, Array | None]]
"""The state at the last row; u and theta at every row but the first, theta None without the sensitivity."""


def in_turn(system: StateSpace, exact: StepMap, state: State, inputs: Float[Array, "time input"]) -> Stretch:
    """One row after the other: for any model."""
    drives = exact.drive(inputs[:-1], inputs[1:])
    state, (x, theta) = jax.lax.scan(lambda now, drive: (moved := exact.move(now, drive), moved), state, drives)
    apply = times if system.order <= _FEW else lambda matrix, rows: rows @ matrix.T
    u = apply(system.C, x) + times(system.D, inputs[1:])
    return state, (u, None if theta is None else apply(system.theta_outputs, theta))


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


def is_small(system: StateSpace, rows: int) -> bool:
    """Whether a diagonal model is best run by loops that are single kernels: of few states, or of some and few rows."""
    states, work = _SMALL
    fits = system.order <= _VERY_SMALL or (system.order <= states and rows * system.order <= work)
    return fits and system.is_diagonal and has_small_loops()


def in_loops(
    system: StateSpace, exact: StepMap, state: State, inputs: Float[Array, "time input"]
) -> tuple[Float[Array, "time output"], Float[Array, "time output"] | None]:
    """u and theta at every row, for a diagonal model that `is_small`: in lanes where its states are not few."""
    rows = inputs.shape[0]
    if system.order <= _FEW or not suits_lanes(system, rows):
        return in_one_loop(system, exact, state, inputs)
    return jax.tree.map(lambda lanes: in_rows(lanes, rows), side_by_side(system, exact, state, in_lanes(inputs)))


def in_one_loop(
    system: StateSpace, exact: StepMap, state: State, inputs: Float[Array, "time input"]
) -> tuple[Float[Array, "time output"], Float[Array, "time output"] | None]:
    """u and theta at every row, one after the other, in a single kernel: for a diagonal model that `is_small`.

    The states of field and sensitivity (`_one_row_a_step`) lie in one array, each from a whole number of `_VECTOR` on:
    the compiler then steps them as vectors.
    """
    first, driven, seen = _one_row_a_step(system, exact, state, inputs[0])
    E_theta, order = exact.E_theta, system.order
    width = -(-order // _VECTOR) * _VECTOR

    def padded(pair: Pair) -> Array:
        parts = jax.tree.leaves(pair)
        return jnp.concatenate([jnp.pad(part, [(0, width - order)] + [(0, 0)] * (part.ndim - 1)) for part in parts])

    def on(z: Array, q: Array) -> tuple[Array, tuple[Array, ...]]:
        after = sum((part * q[k] for k, part in enumerate(drive)), decay * z)
        if E_theta is not None and len(seen) > 1:
            after += jax.lax.pad(E_theta * z[:order], 0.0, [(width, width - order, 0)])
        parts = (z[k * width : k * width + order] for k in range(len(seen)))
        return after, tuple(times(C, part) + times(D, q) for (C, D), part in zip(seen, parts, strict=True))

    # an input's column by itself, or the compiler takes it out of the others at every row
    decay, drive = padded(jax.tree.map(lambda _: exact.E, first)), padded(driven).T
    u, *y = jax.lax.scan(on, padded(first), inputs)[1]
    return u, y[0] if y else None


def suits_lanes(system: StateSpace, rows: int) -> bool:
    """Whether a diagonal model is best run `side_by_side` by who takes what comes out as it lies."""
    return rows >= _LONG and is_small(system, rows)


def in_lanes(rows: Float[Array, "time column"]) -> Float[Array, "step column lane"]:
    """Rows cut into stretches that lie side by side; past the last row zeros."""
    steps = -(-rows.shape[0] // _LANES)
    return _lengthened(rows, _LANES * steps).reshape(_LANES, steps, -1).transpose(1, 2, 0)


def in_rows(lanes: Float[Array, "step column lane"], rows: int) -> Float[Array, "time column"]:
    """The rows that `in_lanes` cut."""
    return lanes.transpose(2, 0, 1).reshape(-1, lanes.shape[1])[:rows]


def side_by_side(
    system: StateSpace, exact: StepMap, state: State, inputs: Float[Array, "step input lane"]
) -> tuple[Float[Array, "step output lane"], Float[Array, "step output lane"] | None]:
    """u and theta at every row, all lanes a row on at a time: for a diagonal model that `suits_lanes`.

    Each lane goes from rest to its end, the lanes' first states follow from each other, and from these all go once
    more. Twice the steps, but of whole vectors: for whoever can use what comes out as it lies.
    """
    first, driven, seen = _one_row_a_step(system, exact, state, inputs[0, :, 0])
    steps, lanes = inputs.shape[0], inputs.shape[2]
    E, E_theta = exact.E, exact.E_theta
    row = replace(exact, E=E[:, None], E_theta=None if E_theta is None else E_theta[:, None])
    # with the derivative of a power
    lane = replace(exact, E=E**steps, E_theta=None if E_theta is None else steps * E ** (steps - 1) * E_theta)

    def on(z: Pair, q: Array) -> Pair:
        return row.move(z, jax.tree.map(lambda drive: _as_sum(drive, q), driven))

    def seen_at(z: Pair, q: Array) -> tuple[Array, ...]:
        return tuple(_as_sum(C, part) + _as_sum(D, q) for (C, D), part in zip(seen, jax.tree.leaves(z), strict=True))

    rest = jax.tree.map(lambda part: jnp.zeros((part.shape[0], lanes)), first)
    ends, _ = jax.lax.scan(lambda z, q: (on(z, q), None), rest, inputs)
    _, firsts = jax.lax.scan(lambda z, end: (lane.move(z, end), z), first, _turned(ends))
    u, *y = jax.lax.scan(lambda z, q: (on(z, q), seen_at(z, q)), _turned(firsts), inputs)[1]
    return u, y[0] if y else None


def _turned(states: Pair) -> Pair:
    """Lanes of states from states in lanes, or back."""
    return jax.tree.map(jnp.transpose, states)


def _one_row_a_step(
    system: StateSpace, exact: StepMap, state: State, first: Float[Array, " input"]
) -> tuple[Pair, Pair, list[tuple[Array, Array]]]:
    """For `z = x - W1 q` and `zeta = theta - V1 q` a step takes one row of inputs,

        z_k+1 = E z_k + b q_k,                               b = W0 + E W1
        zeta_k+1 = E zeta_k + E' z_k + b' q_k,               b' = V0 + E V1 + E' W1

    Returns their first values, `b` and `b'` (the second of each None without the sensitivity), and what sees them:
    `(C, D + C W1)`, with the sensitivity `(C_theta, C_theta V1)` as well.
    """
    # products of matrices as sums, or XLA does not make one kernel of a whole search with this in it
    (x, theta), E = state, exact.E[:, None]
    z, b = x - times(exact.W1, first), exact.W0 + E * exact.W1
    seen = [(system.C, system.D + _as_sum(system.C, exact.W1))]
    if theta is None or exact.E_theta is None or exact.V0 is None or exact.V1 is None:
        return (z, None), (b, None), seen
    zeta = theta - times(exact.V1, first)
    b_theta = exact.V0 + E * exact.V1 + exact.E_theta[:, None] * exact.W1
    return (z, zeta), (b, b_theta), [*seen, (system.theta_outputs, _as_sum(system.theta_outputs, exact.V1))]


def _as_sum(matrix: Float[Array, "out few"], columns: Float[Array, "few column"]) -> Float[Array, "out column"]:
    """`matrix columns` as a sum; `times` takes rows."""
    return sum((matrix[:, k, None] * columns[k] for k in range(1, matrix.shape[1])), matrix[:, :1] * columns[0])


def _block_length(rows: int, order: int) -> int:
    """As measured: long blocks take larger products and longer compiling, short ones more steps in turn."""
    if rows <= 128:
        return 2
    if rows <= 1024:
        return 4
    return 8 if order <= _FEW else 16


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
    driving = _lengthened(inputs[:-1], count * length).reshape(count, length * width)

    power = jnp.stack([jnp.ones_like(E), E])
    while power.shape[0] <= length:
        power = jnp.concatenate([power, power[-1] * power[1:]])
    response = power[:-1, :, None] * (W0 + E[:, None] * W1)  # of z to a unit of input, one row later and on
    to_the_end = response[::-1].swapaxes(1, 2).reshape(length * width, -1)
    first, last = _first_states(power[-1], driving @ to_the_end, x - times(W1, inputs[0]))

    later = np.arange(length) - np.arange(length)[:, None]
    kernel = jnp.einsum("on,kni->kio", C, response)
    # driven, seen, input, output
    convolve = jnp.where((later >= 0)[..., None, None], kernel[np.maximum(later, 0)], 0.0)
    convolve = convolve.swapaxes(1, 2).reshape(length * width, -1)
    observe = (power[1:, None] * C).reshape(-1, C.shape[1]).T
    seen = (driving @ convolve + first @ observe).reshape(count * length, -1)[:rows]
    return last + times(W1, inputs[-1]), seen + times(C @ W1, inputs[1:])


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
    in_lanes = _lengthened(added, lanes * length).reshape(lanes, length, -1).swapaxes(0, 1)

    def on(now: tuple[Array, Array], added: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """All lanes a block on, and the power of `E`."""
        return (E * now[0] + added, E * now[1]), now

    rest = jnp.zeros((lanes, E.shape[0])), jnp.ones_like(E)
    (ends, whole), (from_rest, power) = jax.lax.scan(on, rest, in_lanes)
    _, firsts = jax.lax.scan(lambda now, end: (whole * now + end, now), x, ends)
    states = (from_rest + power[:, None] * firsts).swapaxes(0, 1).reshape(lanes * length, -1)
    return states[:count], states[count]


def _lengthened(rows: Float[Array, "few column"], count: int) -> Float[Array, "many column"]:
    """The rows, and zeros up to `count`."""
    return jnp.concatenate([rows, jnp.zeros((count - rows.shape[0], rows.shape[1]))])
