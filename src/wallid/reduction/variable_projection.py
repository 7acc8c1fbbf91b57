"""Variable projection: how far modes are from the large model's courses once the H that fits them best is in.

Learning minimises the misfit to the large model's outputs and sensitivities over a set of signals, each divided by its
root mean square (the paper divides point by point, by values that vanish at t = 0):

    J = sum_signals  |Y_u - y_u|^2 / rms(y_u)^2  +  |Y_theta - y_theta|^2 / rms(y_theta)^2

With the direct term `D = S - H b` of `mim`, `H` enters linearly. Let `Phi` hold the weighted rows of `X - b Q` and
`X_theta` of every mode, and `t` those of `y_u - S Q` and `y_theta`. The best `H` of some modes, and what it leaves, are

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

QUIET = 1e-12
"""Dimensionless: what varies by less stands still; a signal with a smaller root mean square teaches nothing."""

_STEADY = 1e-8  # relative: a profile column is a steady state of the large model
_ENOUGH_ROWS = 400  # of a signal in the functional: rows between them say the same again


class TrainingSignals(eqx.Module):
    """What a reduced model learns from: a set of runs of the large model.

    Args:
        fourier: one Fo per signal.
        step: the common step of the rows, in t_ref.
        inputs: the inputs of each signal.
        initial: the coefficients of each signal's initial profile.
    """

    fourier: Float[Array, " signal"] = eqx.field(converter=on_device)
    step: Float[Array, ""] = eqx.field(converter=on_device)
    inputs: Float[Array, "signal time input"] = eqx.field(converter=on_device)
    initial: Float[Array, "signal param"] = eqx.field(converter=on_device)


class Modes(eqx.Module):
    """A reduced model but for H; row k belongs to mode k, so each number moves one column of the basis.

    Args:
        log_poles: `ln(-f)`, the slowest first.
        b: `-G/f`, where a mode sits in a steady state of each input.
        profile: the columns of P that are no steady states.
    """

    log_poles: Float[Array, " mode"]
    b: Float[Array, "mode input"]
    profile: Float[Array, "mode free"]

    @property
    def poles(self) -> Float[Array, " mode"]:
        """`f`, all negative."""
        return -jnp.exp(self.log_poles)

    @property
    def inflow(self) -> Float[Array, "mode input"]:
        """`G = -f b`."""
        return -self.poles[:, None] * self.b


class Setting(eqx.Module):
    """What stays the same while learning.

    Args:
        static_gain: S, of the large model.
        steady_inputs: in whose steady state each profile column is; zero columns for those that are in none.
        weight: of u and of theta, by signal.
        target: weighted rows by outputs, a block per independent H.
        every: each how many rows count.
        free: the profile columns that are no steady states.
        driven: the inputs that some signal moves.
        counts: 1 for a mode of the model, 0 for one that only fills the shape.
    """

    signals: TrainingSignals
    static_gain: Float[Array, "output input"]
    steady_inputs: Float[Array, "input param"]
    weight: Float[Array, "kind signal"]
    target: tuple[Array, ...]
    integrator: Integrator = eqx.field(static=True)
    every: int = eqx.field(static=True)
    free: tuple[int, ...] = eqx.field(static=True)
    driven: tuple[bool, ...] = eqx.field(static=True)
    counts: Float[Array, " mode"]

    def profiles(self, modes: Modes) -> Float[Array, "mode param"]:
        """`P`: the columns that are steady states by `b`, the others as the modes have them."""
        return (modes.b @ self.steady_inputs).at[:, self.free].set(modes.profile)


@eqx.filter_jit
def courses(system: StateSpace, signals: TrainingSignals, integrator: Integrator) -> tuple[Array, Array]:
    """A model's u and theta in each signal, `(signal, time, output)`."""

    def run(fo: Array, q: Array, a: Array) -> tuple[Array, Array | None]:
        return run_rows(system, fo, signals.step, q, a, sensitivity=True, integrator=integrator)

    u, theta = jax.vmap(run)(signals.fourier, signals.inputs, signals.initial)
    assert theta is not None
    return u, theta


def setting_of(
    lom: StateSpace,
    signals: TrainingSignals,
    reference: tuple[Array, Array],
    tied: bool,
    integrator: Integrator,
    order: int,
    shape: int,
) -> Setting:
    """What learning from these signals needs.

    Args:
        reference: the large model's courses of u and theta.
        order, shape: how many modes are learned, in arrays of how many.

    Raises:
        InputError: the signals do not teach it.
    """
    steady = _steady_inputs(lom)
    free = tuple(int(k) for k in np.flatnonzero(~np.any(steady != 0, axis=0)))
    inputs, initial = np.asarray(signals.inputs), np.asarray(signals.initial)
    moves = np.ptp(inputs, axis=1) > QUIET
    # from a steady profile, a constant input that does not meet it is a step at the start
    at_rest = ~np.any(initial[:, free], axis=1)
    moves |= at_rest[:, None] & (np.abs(inputs[:, 0] - initial @ steady.T) > QUIET)
    driven = tuple(bool(moved) for moved in np.any(moves, axis=0))
    unlearned = [k for k in free if not np.any(np.asarray(signals.initial)[:, k])]
    if not any(driven) and len(unlearned) == len(free):
        raise InputError("signals: none of them moves a face or a profile, so there is nothing to learn from")
    if unlearned:
        raise InputError(
            f"signals: no signal starts from a profile of degree {unlearned[0]}, so the reduced model "
            "cannot learn it; add one that does, or lower the large model's profile_degree"
        )
    u, theta = (np.asarray(course) for course in reference)
    rms = np.stack([np.sqrt(np.mean(y**2, axis=(1, 2))) for y in (u, theta)])
    every = -(-inputs.shape[1] // _ENOUGH_ROWS)
    count = sum(block[:, ::every].size for block in (u, theta))
    weight = np.where(rms > QUIET, 1.0 / np.where(rms > QUIET, rms, 1.0), 0.0) / np.sqrt(count)
    gain = lom.static_gain()
    u_rest = u - inputs @ np.asarray(gain).T
    rows = [_rows(block, w, every) for block, w in zip((u_rest, theta), weight, strict=True)]
    stacked = (np.concatenate(rows),) if tied else tuple(rows)
    target = tuple(on_device(np.pad(block, ((0, shape), (0, 0)))) for block in stacked)
    return Setting(
        signals=signals,
        static_gain=gain,
        steady_inputs=on_device(steady),
        weight=on_device(weight),
        target=target,
        integrator=integrator,
        every=every,
        free=free,
        driven=driven,
        counts=on_device(1.0 * (np.arange(shape) < order)),
    )


def _steady_inputs(lom: StateSpace) -> np.ndarray:
    """Per profile column, the constant inputs in whose steady state it is, or zeros where in none.

    `A P_k + B q = 0` has a solution `q` for a constant always, for a straight line on a
    homogeneous wall.
    """
    A, B, P = (np.asarray(part) for part in (lom.A, lom.B, lom.P))
    gained = -B / A[:, None]
    inputs, *_ = np.linalg.lstsq(gained, P, rcond=None)
    inputs[np.abs(inputs) < _STEADY] = 0.0
    error = np.linalg.norm(gained @ inputs - P, axis=0) / np.linalg.norm(P, axis=0)
    return np.where(error < _STEADY, inputs, 0.0)


def _rows(
    block: Float[ArrayLike, "signal time column"], weight: Float[ArrayLike, " signal"], every: int
) -> Float[ArrayLike, "row column"]:
    """The rows of all signals that count, weighted, below each other."""
    weighted = block[:, ::every] * weight[:, None, None]
    return weighted.reshape(-1, block.shape[-1])


def _basis(modes: Modes, setting: Setting) -> tuple[Array, Array]:
    """`X - b Q` and `X_theta` of every mode in every signal, weighted, as rows."""
    count, inputs = modes.b.shape
    C, P = jnp.eye(count), setting.profiles(modes)
    system = StateSpace(A=modes.poles, B=modes.inflow, C=C, D=-modes.b, P=P, driven=(True,) * inputs)
    u, theta = courses(system, setting.signals, setting.integrator)
    rows = (_rows(u, setting.weight[0], setting.every), _rows(theta, setting.weight[1], setting.every))
    return jnp.multiply(rows[0], setting.counts), jnp.multiply(rows[1], setting.counts)


def blocks(modes: Modes, setting: Setting) -> tuple[Array, ...]:
    """The basis, a block per independent H: both kinds of rows together where H is tied.

    A mode that only fills the shape has a row of its own below them, which nothing asks for: its H is 0.
    """
    basis, filling = _basis(modes, setting), jnp.diag(1.0 - setting.counts)
    stacked = (jnp.concatenate(basis),) if len(setting.target) == 1 else basis
    return tuple(jnp.concatenate([block, filling]) for block in stacked)


def eliminate(basis: Array, target: Array) -> tuple[Array, Array, Array, Array]:
    """The best H for a basis, `min |target - basis H^T|`: Q and R of the basis, H, what is left."""
    Q, R = jnp.linalg.qr(basis)
    projected = Q.T @ target
    return Q, R, jax.scipy.linalg.solve_triangular(R, projected).T, target - Q @ projected


@jax.custom_jvp
def left_over(modes: Modes, setting: Setting) -> tuple[Array, ...]:
    """The weighted misfit once H is eliminated."""
    pairs = zip(blocks(modes, setting), setting.target, strict=True)
    return tuple(eliminate(basis, target)[3] for basis, target in pairs)


@left_over.defjvp
def _left_over_jvp(primals, tangents):
    """Exactly: `dr = -(I - Q Q^T) dPhi H^T - Q R^-T dPhi^T r` (Golub and Pereyra).

    A number of mode k moves column k of the basis only, so one derivative per kind of number, along
    a direction that moves all modes at once, gives all columns of all modes.
    """
    modes, setting = primals
    moved: Modes = tangents[0]
    numbers = jnp.concatenate([moved.log_poles[:, None], moved.b, moved.profile], axis=1)

    def along(kind: Array) -> tuple[Array, ...]:
        ones = jnp.ones_like(modes.log_poles)[:, None] * kind
        inputs = modes.b.shape[1]
        direction = Modes(ones[:, 0], ones[:, 1 : 1 + inputs], ones[:, 1 + inputs :])
        return jax.jvp(lambda m: blocks(m, setting), (modes,), (direction,))[1]

    slopes = jax.vmap(along)(jnp.eye(numbers.shape[1]))
    left, changes = [], []
    for basis, target, slope in zip(blocks(modes, setting), setting.target, slopes, strict=True):
        Q, R, H, r = eliminate(basis, target)
        change = jnp.einsum("krm,mk->rm", slope, numbers)
        moves = change @ H.T
        turn = Q @ jax.scipy.linalg.solve_triangular(R, change.T @ r, trans=1)
        left.append(r)
        changes.append(Q @ (Q.T @ moves) - moves - turn)
    return tuple(left), tuple(changes)
