"""The exact step of a diagonal model of few states over many rows: loops of which XLA makes single kernels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._xla import has_small_loops
from .exponential import State, StepMap, times
from .recurrence import convolution, lengthened, observation, to_the_end
from .statespace import StateSpace

# as measured
_SMALL = 24  # states up to which one loop is faster than blocks
_VECTOR = 8  # numbers in the widest vector of a common processor
_TOGETHER = 4  # rows a step
_MANY = 1024  # rows from which these are worth what their matrices take
_LANES = 64  # stretches of rows side by side: of fewer, XLA makes single numbers and not vectors
_LONG = 256  # rows from which lanes are long enough

Pair = tuple[Array, Array | None]
"""Something of the field, and of the sensitivity where it is asked for."""


def is_small(system: StateSpace) -> bool:
    """Whether a diagonal model is of so few states that it is best run by loops that are single kernels."""
    return system.order <= _SMALL and system.is_diagonal and has_small_loops()


def in_one_loop(
    system: StateSpace, exact: StepMap, state: State, inputs: Float[Array, "time input"], *, by_row: bool = False
) -> tuple[Float[Array, "time output"], Float[Array, "time output"] | None]:
    """u and theta at every row in a single kernel: for a diagonal model that `is_small`.

    Arguments:
        by_row: one row a step however many there are, which compiles in half the time.
    """
    some = inputs.shape[0] >= _MANY and system.C.shape[0] <= _VECTOR and not by_row
    return (_some_rows_a_step if some else _one_row_a_step)(system, exact, state, inputs)


def _one_row_a_step(
    system: StateSpace, exact: StepMap, state: State, inputs: Float[Array, "time input"]
) -> tuple[Float[Array, "time output"], Float[Array, "time output"] | None]:
    """As `in_one_loop`, one row after the other.

    The states of field and sensitivity (`_driven`) lie in one array (`_padded`), which the compiler steps as vectors.
    """
    first, driven, seen = _driven(system, exact, state, inputs[0])
    mixed = None if len(seen) == 1 else exact.E_theta
    # what a number of the state or the inputs adds lies side by side, or the compiler gathers it at every row
    looks = [(C.T, D.T) for C, D in seen]
    decay, drive = _padded([exact.E for _ in seen]), _padded([b.T for b in jax.tree.leaves(driven)])

    def on(z: Array, q: Array) -> tuple[Array, tuple[Array, ...]]:
        parts = zip(looks, _parts(z, system.order), strict=True)
        return _moved(z, q, drive, decay, mixed), tuple(_combined(C, x) + _combined(D, q) for (C, D), x in parts)

    u, *y = jax.lax.scan(on, _padded(jax.tree.leaves(first)), inputs)[1]
    return u, y[0] if y else None


def _some_rows_a_step(
    system: StateSpace, exact: StepMap, state: State, inputs: Float[Array, "time input"]
) -> tuple[Float[Array, "time output"], Float[Array, "time output"] | None]:
    """As `in_one_loop`, `_TOGETHER` rows a step, whose outputs fill vectors where those of one row do not.

    What a step's inputs and its first state make of its outputs is a product of matrices (`_maps`). The last step ends
    with the last row: where the rows are no whole steps, the first step goes on by fewer than it shows.
    """
    first, driven, seen = _driven(system, exact, state, inputs[0])
    rows, outputs, length = inputs.shape[0], system.C.shape[0], _TOGETHER
    twice = -rows % length  # rows that the first two steps both show
    advances = (length - twice, length) if twice else (length,)
    C, D = seen[0]
    of_field = D, exact.E, driven[0]
    field = _maps(C, *of_field, advances)
    looks, drive, mixed = [(field.of_inputs, [field.of_state])], [field.drive], None
    if len(seen) > 1:
        C, D = seen[1]
        # a derivative by Fo, of all but the outputs' matrix
        values, slopes = jax.jvp(partial(_maps, C, advances=advances), of_field, (D, exact.E_theta, driven[1]))
        looks.append((slopes.of_inputs, [slopes.of_state, values.of_state]))
        drive, mixed = [*drive, slopes.drive], slopes.decay
    drive, decay = _padded(drive), _padded([field.decay for _ in seen])

    def on(k: Array, now: tuple[Array, tuple[Array, ...]]) -> tuple[Array, tuple[Array, ...]]:
        z, shown = now
        row, kind = jnp.maximum(k * length - twice, 0), jnp.minimum(k, len(advances) - 1)
        q = jax.lax.dynamic_slice_in_dim(inputs, row, length).reshape(-1)
        parts = _parts(z, system.order)
        seen_now = [
            _combined(of_inputs, q) + sum(_combined(*pair) for pair in zip(of_states, parts, strict=False))
            for of_inputs, of_states in looks
        ]
        # in place: to put stretches of rows together would copy them all
        put = partial(jax.lax.dynamic_update_slice_in_dim, start_index=row * outputs, axis=0)
        after = _moved(z, q, drive[kind], decay[kind], None if mixed is None else mixed[kind])
        return after, tuple(put(whole, part) for whole, part in zip(shown, seen_now, strict=True))

    # of equal numbers XLA would make one array, and a copy of it
    nothing = tuple(jnp.full(rows * outputs, float(k)) for k in range(len(seen)))
    _, shown = jax.lax.fori_loop(0, -(-rows // length), on, (_padded(jax.tree.leaves(first)), nothing))
    u, *y = (whole.reshape(rows, outputs) for whole in shown)
    return u, y[0] if y else None


class _Maps(NamedTuple):
    """What some rows of inputs, one after the other, and the state at the first of them make of the outputs at these
    rows, one after the other; and of the state some rows later, for each of some numbers of rows.
    """

    of_inputs: Float[Array, "rows*input rows*output"]
    of_state: Float[Array, "node rows*output"]
    drive: Float[Array, "advance rows*input node"]
    decay: Float[Array, "advance node"]


def _maps(
    C: Float[Array, "output node"],
    D: Float[Array, "output input"],
    E: Float[Array, " node"],
    b: Float[Array, "node input"],
    advances: tuple[int, ...],
) -> _Maps:
    """Of `z_k+1 = E z_k + b q_k`, `u_k = C z_k + D q_k`, for `_TOGETHER` rows."""
    length, width = _TOGETHER, b.shape[1]
    power = jnp.stack([E**k for k in range(length + 1)])
    response = power[:-1, :, None] * b  # of z to a unit of input, one row later and on
    # a product, or XLA computes it anew for every place where `convolution` puts it
    later = jnp.einsum("on,kni->kio", C, response[:-1])  # of u
    drive = [to_the_end(response[:rows]) for rows in advances]
    return _Maps(
        of_inputs=convolution(jnp.concatenate([D.T[None], later])),
        of_state=observation(C, power[:-1]),
        drive=jnp.stack([lengthened(rows, length * width) for rows in drive]),
        decay=power[np.array(advances)],
    )


def _combined(rows: Float[Array, "few column"], weights: Float[Array, " few"]) -> Float[Array, " column"]:
    """The weighted sum of some rows: `times`, with what lies side by side in a row."""
    return sum((rows[k] * weights[k] for k in range(1, rows.shape[0])), rows[0] * weights[0])


def _moved(
    z: Float[Array, " wide"],
    q: Float[Array, " input"],
    drive: Float[Array, "input wide"],
    decay: Float[Array, " wide"],
    mixed: Float[Array, " node"] | None,
) -> Float[Array, " wide"]:
    """The states of field and sensitivity a step later; `mixed`: what the field's adds to the sensitivity's."""
    after = _combined(drive, q) + decay * z
    if mixed is None:
        return after
    half, order = z.shape[0] // 2, mixed.shape[0]
    return after + jax.lax.pad(mixed * z[:order], 0.0, [(half, half - order, 0)])


def _padded(parts: Sequence[Float[Array, "*rows node"]]) -> Float[Array, "*rows wide"]:
    """The parts side by side, each from a whole number of `_VECTOR` on."""
    fill = -parts[0].shape[-1] % _VECTOR
    return jnp.concatenate([jnp.pad(part, [(0, 0)] * (part.ndim - 1) + [(0, fill)]) for part in parts], axis=-1)


def _parts(z: Float[Array, " wide"], order: int) -> list[Float[Array, " node"]]:
    """The parts that were `_padded`."""
    return [z[start : start + order] for start in range(0, z.shape[0], order + -order % _VECTOR)]


def suits_lanes(system: StateSpace, rows: int) -> bool:
    """Whether a diagonal model is best run `side_by_side` by who takes what comes out as it lies."""
    return rows >= _LONG and is_small(system)


def in_lanes(rows: Float[Array, "time column"]) -> Float[Array, "step column lane"]:
    """Rows cut into stretches that lie side by side; past the last row zeros."""
    steps = -(-rows.shape[0] // _LANES)
    return lengthened(rows, _LANES * steps).reshape(_LANES, steps, -1).transpose(1, 2, 0)


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
    first, driven, seen = _driven(system, exact, state, inputs[0, :, 0])
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


def _driven(
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
