"""Variable projection: the residual of the learning problem as a function of the modes alone, with H solved for.

Learning minimises the error of the reduced-order model's outputs and sensitivities over a set of signals, each divided
by its root mean square (the paper divides point by point, by values that vanish at t = 0):

    J = sum_signals  |Y_u - y_u|^2 / rms(y_u)^2  +  |Y_theta - y_theta|^2 / rms(y_theta)^2

With the direct term `D = S - H b` (`modal_identification`), `H` enters linearly. Let `Phi` hold the weighted rows of
`X - b Q` and `X_theta` of every mode, and `t` those of `y_u - S Q` and `y_theta`. For given modes the best `H` and the
residual are

    H' = Phi^+ t,      r = (I - Phi Phi^+) t

Source: Berger and Kadoch, Section 3.2; Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973), 413.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.arrays import on_device
from .._internal.errors import InputError
from ..models.integration import ArrayLike, Integrator, run_rows
from ..models.state_space import StateSpace

CONSTANT_TOLERANCE = 1e-12
"""Dimensionless: a signal that varies by less is constant, and contains nothing to learn from."""

_STEADY_TOLERANCE = 1e-8  # relative: a profile column is a steady state of the full-order model
_MAX_ROWS = 400  # of a signal in the functional: more rows add no information


class TrainingSignals(eqx.Module):
    """The signals that a reduced-order model is learned from: simulations with the full-order model.

    Args:
        fourier: Fo of each signal.
        step: the common step of the rows, in t_ref.
        inputs: dimensionless boundary temperatures of each signal; with their slopes per t_ref after them for cubics
            between rows.
        initial: coefficients of each signal's initial profile, dimensionless.
    """

    fourier: Float[Array, " signal"] = eqx.field(converter=on_device)
    step: Float[Array, ""] = eqx.field(converter=on_device)
    inputs: Float[Array, "signal time column"] = eqx.field(converter=on_device)
    initial: Float[Array, "signal param"] = eqx.field(converter=on_device)


class Modes(eqx.Module):
    """The modes of a reduced-order model, without H. Row k belongs to mode k and changes column k of the basis only.

    Args:
        log_poles: `ln(-f)`, the slowest first.
        b: `-G/f`, each mode's steady state per unit of each input.
        profile: the columns of P that are not steady states.
    """

    log_poles: Float[Array, " mode"]
    b: Float[Array, "mode input"]
    profile: Float[Array, "mode free"]

    @property
    def poles(self) -> Float[Array, " mode"]:
        """`f`, all negative."""
        return -jnp.exp(self.log_poles)

    @property
    def input_matrix(self) -> Float[Array, "mode input"]:
        """`G = -f b`."""
        return -self.poles[:, None] * self.b


class LearningProblem(eqx.Module):
    """All that is constant while the modes are learned.

    Args:
        static_gain: S, of the full-order model.
        steady_inputs: the inputs whose steady state each profile column is; zeros for a column that is not one.
        weight: of u and of theta, for each signal.
        target: weighted rows by outputs, one block per independent H.
        stride: every how many rows are used.
        learned_columns: the profile columns that are not steady states.
        driven: the inputs that vary in some signal.
        mode_mask: 1 for a mode of the model, 0 for one that only fills the arrays.
    """

    signals: TrainingSignals
    static_gain: Float[Array, "output input"]
    steady_inputs: Float[Array, "input param"]
    weight: Float[Array, "kind signal"]
    target: tuple[Array, ...]
    integrator: Integrator = eqx.field(static=True)
    stride: int = eqx.field(static=True)
    learned_columns: tuple[int, ...] = eqx.field(static=True)
    driven: tuple[bool, ...] = eqx.field(static=True)
    mode_mask: Float[Array, " mode"]

    def profiles(self, modes: Modes) -> Float[Array, "mode param"]:
        """`P`: steady-state columns from `b`, the others as learned."""
        return (modes.b @ self.steady_inputs).at[:, self.learned_columns].set(modes.profile)


@eqx.filter_jit
def simulated_outputs(system: StateSpace, signals: TrainingSignals, integrator: Integrator) -> tuple[Array, Array]:
    """u and theta of a model in each signal, `(signal, time, output)`."""

    def run(fo: Array, q: Array, a: Array) -> tuple[Array, Array | None]:
        return run_rows(system, fo, signals.step, q, a, sensitivity=True, integrator=integrator)

    u, theta = jax.vmap(run)(signals.fourier, signals.inputs, signals.initial)
    assert theta is not None
    return u, theta


def learning_problem(
    full_order_model: StateSpace,
    signals: TrainingSignals,
    reference: tuple[Array, Array],
    tied: bool,
    integrator: Integrator,
    order: int,
    array_size: int,
) -> LearningProblem:
    """The learning problem of these signals.

    Args:
        reference: u and theta of the full-order model in each signal.
        tied: whether field and sensitivity share one H.
        order, shape: number of modes, and size of the arrays that hold them.

    Raises:
        InputError: the signals do not excite a face or a profile that is to be learned.
    """
    steady = _steady_inputs(full_order_model)
    learned = tuple(int(k) for k in np.flatnonzero(~np.any(steady != 0, axis=0)))
    inputs, initial = np.asarray(signals.inputs)[..., : full_order_model.B.shape[1]], np.asarray(signals.initial)
    varies = np.ptp(inputs, axis=1) > CONSTANT_TOLERANCE
    # a constant input that differs from the steady initial profile is a step at the start
    at_rest = ~np.any(initial[:, learned], axis=1)
    varies |= at_rest[:, None] & (np.abs(inputs[:, 0] - initial @ steady.T) > CONSTANT_TOLERANCE)
    driven = tuple(bool(one) for one in np.any(varies, axis=0))
    unlearned = [k for k in learned if not np.any(np.asarray(signals.initial)[:, k])]
    if not any(driven) and len(unlearned) == len(learned):
        raise InputError("signals: no face and no profile varies in them, so there is nothing to learn from")
    if unlearned:
        raise InputError(
            f"signals: no signal starts from a profile of degree {unlearned[0]}, so the reduced model "
            "cannot learn it; add one that does, or lower the full-order model's profile_degree"
        )
    u, theta = (np.asarray(block) for block in reference)
    rms = np.stack([np.sqrt(np.mean(y**2, axis=(1, 2))) for y in (u, theta)])
    stride = -(-inputs.shape[1] // _MAX_ROWS)
    count = sum(block[:, ::stride].size for block in (u, theta))
    weight = np.where(rms > CONSTANT_TOLERANCE, 1.0 / np.where(rms > CONSTANT_TOLERANCE, rms, 1.0), 0.0) / np.sqrt(
        count
    )
    gain = full_order_model.static_gain()
    dynamic = u - inputs @ np.asarray(gain).T
    rows = [weighted_rows(block, w, stride) for block, w in zip((dynamic, theta), weight, strict=True)]
    stacked = (np.concatenate(rows),) if tied else tuple(rows)
    target = tuple(on_device(np.pad(block, ((0, array_size), (0, 0)))) for block in stacked)
    return LearningProblem(
        signals=signals,
        static_gain=gain,
        steady_inputs=on_device(steady),
        weight=on_device(weight),
        target=target,
        integrator=integrator,
        stride=stride,
        learned_columns=learned,
        driven=driven,
        mode_mask=on_device(1.0 * (np.arange(array_size) < order)),
    )


def _steady_inputs(model: StateSpace) -> np.ndarray:
    """For each profile column the constant inputs whose steady state it is; zeros where it is none.

    `A P_k + B q = 0` has a solution `q` for a constant profile always, for a straight line in a homogeneous wall.
    """
    A, B, P = (np.asarray(part) for part in (model.A, model.B, model.P))
    steady_states = -B / A[:, None]
    inputs, *_ = np.linalg.lstsq(steady_states, P, rcond=None)
    inputs[np.abs(inputs) < _STEADY_TOLERANCE] = 0.0
    error = np.linalg.norm(steady_states @ inputs - P, axis=0) / np.linalg.norm(P, axis=0)
    return np.where(error < _STEADY_TOLERANCE, inputs, 0.0)


def weighted_rows(
    block: Float[ArrayLike, "signal time column"], weight: Float[ArrayLike, " signal"], stride: int
) -> Float[ArrayLike, "row column"]:
    """Every so many rows of all signals, weighted and stacked."""
    weighted = block[:, ::stride] * weight[:, None, None]
    return weighted.reshape(-1, block.shape[-1])


def _basis(modes: Modes, problem: LearningProblem) -> tuple[Array, Array]:
    """The weighted rows of `X - b Q` and `X_theta` of every mode in every signal."""
    count, inputs = modes.b.shape
    C, P = jnp.eye(count), problem.profiles(modes)
    system = StateSpace(A=modes.poles, B=modes.input_matrix, C=C, D=-modes.b, P=P, driven=(True,) * inputs)
    u, theta = simulated_outputs(system, problem.signals, problem.integrator)
    rows = (
        weighted_rows(u, problem.weight[0], problem.stride),
        weighted_rows(theta, problem.weight[1], problem.stride),
    )
    return jnp.multiply(rows[0], problem.mode_mask), jnp.multiply(rows[1], problem.mode_mask)


def basis_blocks(modes: Modes, problem: LearningProblem) -> tuple[Array, ...]:
    """The basis Phi, one block per independent H: both kinds of rows together where H is tied.

    A mode that only fills the arrays has a row of its own with target 0, so its H is 0.
    """
    basis, fill = _basis(modes, problem), jnp.diag(1.0 - problem.mode_mask)
    stacked = (jnp.concatenate(basis),) if len(problem.target) == 1 else basis
    return tuple(jnp.concatenate([block, fill]) for block in stacked)


def solve_for_outputs(basis: Array, target: Array) -> tuple[Array, Array, Array, Array]:
    """The best H for a basis, `min |target - basis H^T|`: Q and R of the basis, H, and the residual."""
    Q, R = jnp.linalg.qr(basis)
    projected = Q.T @ target
    return Q, R, jax.scipy.linalg.solve_triangular(R, projected).T, target - Q @ projected


@jax.custom_jvp
def projected_residual(modes: Modes, problem: LearningProblem) -> tuple[Array, ...]:
    """The weighted residual with the best H, one block per independent H."""
    pairs = zip(basis_blocks(modes, problem), problem.target, strict=True)
    return tuple(solve_for_outputs(basis, target)[3] for basis, target in pairs)


@projected_residual.defjvp
def _projected_residual_jvp(primals, tangents):
    """The exact derivative `dr = -(I - Q Q^T) dPhi H^T - Q R^-T dPhi^T r` (Golub and Pereyra).

    A number of mode k changes column k of the basis only. So one derivative per kind of number, along a direction that
    changes all modes at once, gives the columns of all modes.
    """
    modes, problem = primals
    tangent: Modes = tangents[0]
    numbers = jnp.concatenate([tangent.log_poles[:, None], tangent.b, tangent.profile], axis=1)

    def along(kind: Array) -> tuple[Array, ...]:
        ones = jnp.ones_like(modes.log_poles)[:, None] * kind
        inputs = modes.b.shape[1]
        direction = Modes(ones[:, 0], ones[:, 1 : 1 + inputs], ones[:, 1 + inputs :])
        return jax.jvp(lambda m: basis_blocks(m, problem), (modes,), (direction,))[1]

    slopes = jax.vmap(along)(jnp.eye(numbers.shape[1]))
    residuals, changes = [], []
    for basis, target, slope in zip(basis_blocks(modes, problem), problem.target, slopes, strict=True):
        Q, R, H, r = solve_for_outputs(basis, target)
        change = jnp.einsum("krm,mk->rm", slope, numbers)
        first = change @ H.T
        second = Q @ jax.scipy.linalg.solve_triangular(R, change.T @ r, trans=1)
        residuals.append(r)
        changes.append(Q @ (Q.T @ first) - first - second)
    return tuple(residuals), tuple(changes)
