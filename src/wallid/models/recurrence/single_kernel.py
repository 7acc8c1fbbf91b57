"""The recurrence of a diagonal model of few modes as one loop of which XLA makes a single kernel."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._internal.xla_options import has_small_loops
from ..exponential_solver import State, StepMap, times
from ..state_space import StateSpace

# as measured
_SMALL = 24  # states up to which one loop is faster than blocks
_VECTOR = 8  # numbers in the widest vector of a common processor

Pair = tuple[Array, Array | None]
"""Something of the field, and of the sensitivity where it is asked for."""


def is_small(system: StateSpace) -> bool:
    """Whether a diagonal model is of so few states that it is best run by a loop that is a single kernel."""
    return system.order <= _SMALL and system.is_diagonal and has_small_loops()


def run_in_one_kernel(
    system: StateSpace, exact: StepMap, state: State, inputs: Float[Array, "time input"]
) -> tuple[Float[Array, "time output"], Float[Array, "time output"] | None]:
    """u and theta at every row, one row after the other in a single kernel: for a diagonal model that `is_small`.

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
