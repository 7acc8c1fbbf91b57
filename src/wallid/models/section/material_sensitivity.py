"""The sensitivity of a section's outputs to each material, by the explicit coupled system.

With `E x' = K x + B q` and a parameter p, `theta = dx/dp` follows from

    E theta' = K theta + K_p x + B_p q - E_p x'

For p = ln k_m these are `K_p = k_m K_m`, `B_p = k_m B_m`, `E_p = 0`; for p = ln c_m only `E_p = c_m E_m` is not zero.
In the modes of (K, E), with rates f, the equations of `theta` are those of the modes, driven by the modes:

    theta' = diag(f) theta + M z + d q

For inputs that are straight lines between rows the step is exact. In `a = h f` its integrals are the divided
differences `g[a_i, a_j] = (g(a_i) - g(a_j)) / (a_i - a_j)` of `exp`, `phi_1` and `phi_2`: where two modes have the same
rate they are the derivative `g'`, while the derivative of the modes themselves does not exist.

Source: N. J. Higham, Functions of Matrices (2008), 3.2 (Daleckii and Krein).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._internal.arrays import on_device
from ..exponential_solver import phi_functions
from .affine_model import AffineModel
from .krylov_basis import generalised_modes

_NEAR = 1.0  # of a: where the difference of two is smaller, the divided difference is an integral of the derivative
_NODES, _WEIGHTS = (0.5 * part for part in np.polynomial.legendre.leggauss(10))
_NODES = _NODES + 0.5  # on [0, 1]


def material_sensitivity(
    model: AffineModel,
    conductivity: np.ndarray,
    heat_capacity: np.ndarray,
    inputs: np.ndarray,
    step: float,
    *,
    profile: Sequence[float] | None = None,
) -> tuple[Float[np.ndarray, "time output"], Float[np.ndarray, "time param output"]]:
    """The outputs of a reduced model, and their derivatives by each material.

    Args:
        model: reduced: with dense matrices.
        conductivity, heat_capacity: of the materials, W/m/K and J/m3/K.
        inputs: temperatures given at the faces, degC, `(time, 2)`; straight lines between rows.
        step: from row to row, s.
        profile: coefficients of the initial profile, degC; None for the steady state with the first row's inputs.

    Returns:
        the outputs, degC, and their derivatives by ln k of each material, then by ln c of each, K.

    Raises:
        ValueError: a full-order model.
    """
    if model.is_sparse:
        raise ValueError("material_sensitivity: takes a reduced model (`reduce_section`), not the full-order one")
    inputs = np.asarray(inputs, float)
    E, K, B = model.at(conductivity, heat_capacity)
    rates, modes = generalised_modes(E, K)
    driven = modes.T @ B
    couplings, drives = [], []
    for k, K_m, B_m in zip(conductivity, model.conduction, model.drive, strict=True):
        couplings.append(k * modes.T @ K_m @ modes)
        drives.append(k * modes.T @ B_m)
    for c, E_m in zip(heat_capacity, model.capacity, strict=True):
        weight = c * modes.T @ E_m @ modes
        couplings.append(-weight * rates)
        drives.append(-weight @ driven)
    coupling, drive = np.stack(couplings), np.stack(drives)
    if profile is None:
        first = -(driven @ inputs[0]) / rates
        first_theta = -(coupling @ first + drive @ inputs[0]) / rates
    else:
        first = modes.T @ (E @ (model.P @ np.asarray(profile, float)))
        first_theta = np.zeros(coupling.shape[:2])
    z, theta = _rows(*map(on_device, (rates * step, driven * step, coupling * step, drive * step)),
                     *map(on_device, (first, first_theta, inputs)))  # fmt: skip
    outputs = model.C @ modes
    return np.asarray(z) @ outputs.T + inputs @ model.D.T, np.asarray(theta) @ outputs.T


@eqx.filter_jit
def _rows(
    a: Float[Array, " mode"],
    driven: Float[Array, "mode input"],
    coupling: Float[Array, "param mode mode"],
    drive: Float[Array, "param mode input"],
    first: Float[Array, " mode"],
    first_theta: Float[Array, "param mode"],
    inputs: Float[Array, "time input"],
) -> tuple[Float[Array, "time mode"], Float[Array, "time param mode"]]:
    """The modes and their derivatives at the rows; rates and couplings are per row."""
    decay, phi_1, phi_2 = phi_functions(a, 2)
    of_exp, of_phi_1, of_phi_2 = _divided_differences(a)

    def row(state: tuple[Array, Array], ends: tuple[Array, Array]) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        z, theta = state
        before, change = ends[0], ends[1] - ends[0]
        heat, more = driven @ before, driven @ change
        following = decay * z + phi_1 * heat + phi_2 * more
        through = coupling * of_exp @ z + coupling * of_phi_1 @ heat + coupling * of_phi_2 @ more
        direct = phi_1 * (drive @ before) + phi_2 * (drive @ change)
        state = following, decay * theta + direct + through
        return state, state

    _, (z, theta) = jax.lax.scan(row, (first, first_theta), (inputs[:-1], inputs[1:]))
    return jnp.concatenate([first[None], z]), jnp.concatenate([first_theta[None], theta])


def _divided_differences(a: Float[Array, " mode"]) -> tuple[Float[Array, "mode mode"], ...]:
    """Those of exp, phi_1 and phi_2 at all pairs; `phi_k' = phi_k - k phi_{k+1}`."""

    def values(z: Array) -> tuple[Array, ...]:
        return phi_functions(z, 2)

    def slopes(z: Array) -> tuple[Array, ...]:
        decay, phi_1, phi_2, phi_3 = phi_functions(z, 3)
        return decay, phi_1 - phi_2, phi_2 - 2.0 * phi_3

    gap = a[:, None] - a
    near = jnp.abs(gap) < _NEAR
    apart = jnp.where(near, 1.0, gap)
    quotients = [(g[:, None] - g) / apart for g in values(a)]
    integrals = _mean_over_pairs(slopes, a, jnp.where(near, gap, 0.0))
    return tuple(jnp.where(near, one, other) for one, other in zip(integrals, quotients, strict=True))


def _mean_over_pairs(
    function: Callable[[Array], tuple[Array, ...]], a: Float[Array, " mode"], gap: Float[Array, "mode mode"]
) -> list[Float[Array, "mode mode"]]:
    """The mean of functions between `a_j` and `a_j + gap_ij`, by Gauss quadrature."""
    at_nodes = [function(a + node * gap) for node in _NODES]
    return [
        sum((weight * one for weight, one in zip(_WEIGHTS, values, strict=True)), jnp.zeros_like(gap))
        for values in zip(*at_nodes, strict=True)
    ]
