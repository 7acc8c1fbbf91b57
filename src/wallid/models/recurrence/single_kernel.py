"""The recurrence of a diagonal model with few modes, as one loop that XLA compiles to a single kernel."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._internal.xla_options import has_small_loops
from ..exponential_solver import State, StepMap, direct_term, thin_product
from ..state_space import StateSpace

# as measured
_MAX_ORDER = 24  # modes up to which one loop is faster than blocks
_VECTOR = 8  # numbers in the widest vector register of a common processor

Pair = tuple[Array, Array | None]
"""A quantity of the field, and the same of the sensitivity (None without the sensitivity)."""


def fits_single_kernel(system: StateSpace) -> bool:
    """Whether a diagonal model has so few modes that a loop compiled to a single kernel is the fastest."""
    return system.order <= _MAX_ORDER and system.is_diagonal and has_small_loops()


def run_in_one_kernel(
    system: StateSpace, exact: StepMap, state: State, inputs: Float[Array, "time column"]
) -> tuple[Float[Array, "time output"], Float[Array, "time output"] | None]:
    """u and theta at every row, one row after the other: for a diagonal model that `fits_single_kernel`.

    The states of field and sensitivity (`_single_input_form`) are joined in one array, so that the compiler uses vector
    instructions. The numbers are those of `run_row_by_row`.
    """
    first, input_maps, output_maps = _single_input_form(system, exact, state, inputs[0])
    coupling = None if len(output_maps) == 1 else exact.E_theta
    # transposed, so that the entries for one state or input are contiguous
    transposed = [(C.T, D.T) for C, D in output_maps]
    decay = _joined_with_padding([exact.E for _ in output_maps])
    drive = _joined_with_padding([b.T for b in jax.tree.leaves(input_maps)])

    def step(z: Array, q: Array) -> tuple[Array, tuple[Array, ...]]:
        parts = zip(transposed, _split_padded(z, system.order), strict=True)
        outputs = tuple(_weighted_row_sum(C, x) + _weighted_row_sum(D, q) for (C, D), x in parts)
        return _next_state(z, q, drive, decay, coupling), outputs

    u, *theta = jax.lax.scan(step, _joined_with_padding(jax.tree.leaves(first)), inputs)[1]
    return u, theta[0] if theta else None


def _weighted_row_sum(rows: Float[Array, "few column"], weights: Float[Array, " few"]) -> Float[Array, " column"]:
    """`sum_k weights_k rows_k`: a product of thin matrices as a sum."""
    return sum((rows[k] * weights[k] for k in range(1, rows.shape[0])), rows[0] * weights[0])


def _next_state(
    z: Float[Array, " wide"],
    q: Float[Array, " input"],
    drive: Float[Array, "input wide"],
    decay: Float[Array, " wide"],
    coupling: Float[Array, " node"] | None,
) -> Float[Array, " wide"]:
    """The joined states one step later; `coupling` is E', by which the field enters the sensitivity."""
    following = _weighted_row_sum(drive, q) + decay * z
    if coupling is None:
        return following
    half, order = z.shape[0] // 2, coupling.shape[0]
    return following + jax.lax.pad(coupling * z[:order], 0.0, [(half, half - order, 0)])


def _joined_with_padding(parts: Sequence[Float[Array, "*rows node"]]) -> Float[Array, "*rows wide"]:
    """The parts in one array, each padded with zeros to a multiple of the vector length."""
    fill = -parts[0].shape[-1] % _VECTOR
    return jnp.concatenate([jnp.pad(part, [(0, 0)] * (part.ndim - 1) + [(0, fill)]) for part in parts], axis=-1)


def _split_padded(z: Float[Array, " wide"], order: int) -> list[Float[Array, " node"]]:
    """The parts that `_joined_with_padding` joined."""
    return [z[start : start + order] for start in range(0, z.shape[0], order + -order % _VECTOR)]


def _single_input_form(
    system: StateSpace, exact: StepMap, state: State, first: Float[Array, " input"]
) -> tuple[Pair, Pair, list[tuple[Array, Array]]]:
    """The recurrence in `z = x - W1 q` and `zeta = theta - V1 q`, whose step takes one row of inputs,

        z_k+1 = E z_k + b q_k,                               b = W0 + E W1
        zeta_k+1 = E zeta_k + E' z_k + b' q_k,               b' = V0 + E V1 + E' W1

    Returns:
        the first values of z and zeta; `b` and `b'` (the second of each None without the sensitivity); and the output
        maps `(C, D + C W1)`, with the sensitivity also `(C_theta, C_theta V1)`.
    """
    # products as sums, so that XLA can compile an iteration around this into one kernel
    (x, theta), E = state, exact.E[:, None]
    z, b = x - thin_product(exact.W1, first), exact.W0 + E * exact.W1
    output_maps = [(system.C, direct_term(system, exact) + _product_as_sum(system.C, exact.W1))]
    if theta is None or exact.E_theta is None or exact.V0 is None or exact.V1 is None:
        return (z, None), (b, None), output_maps
    zeta = theta - thin_product(exact.V1, first)
    b_theta = exact.V0 + E * exact.V1 + exact.E_theta[:, None] * exact.W1
    return (
        (z, zeta),
        (b, b_theta),
        [*output_maps, (system.theta_outputs, _product_as_sum(system.theta_outputs, exact.V1))],
    )


def _product_as_sum(matrix: Float[Array, "out few"], columns: Float[Array, "few column"]) -> Float[Array, "out column"]:
    """`matrix columns` as a sum; `times` is the same for rows."""
    return sum((matrix[:, k, None] * columns[k] for k in range(1, matrix.shape[1])), matrix[:, :1] * columns[0])
