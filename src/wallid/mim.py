"""The reduced model, learned by the Modal Identification Method.

    X' = Fo (F X + G Q),   Y_u = H X + D Q,   Y_theta = H_theta X_theta,   X(0) = P a

with `F = diag(f)`, `f < 0`. Learning minimises the misfit to the large model's outputs and
sensitivities over a set of signals, each divided by its root mean square (the paper divides point
by point, by values that vanish at t = 0):

    J = sum_signals  |Y_u - y_u|^2 / rms(y_u)^2
                     + |Y_theta - y_theta|^2 / rms(y_theta)^2

Three things are given by the physics and not learned. In a steady state a mode sits at
`X = b Q`, `b = -G/f`, so with `S` the large model's static gain the direct term is `D = S - H b`:
the truncated fast modes keep their static part, and a reduced model is right at rest whatever the
level of temperature. An initial profile that is itself a steady state (a constant; on a
homogeneous wall a straight line) takes its `P` from `b`. And `H` enters linearly, so it is
eliminated (variable projection): what Levenberg-Marquardt searches are the poles, the direction
of each row of `b`, and the rest of `P`.

Source: Berger and Kadoch, Section 3.2; Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973), 413.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float
from threadpoolctl import threadpool_limits

from .metrics import eps_2, eps_inf
from .simulate import Integrator, run_rows
from .statespace import StateSpace
from .wall import InputError

_POLE_RATIO = 1.05  # smallest ratio of neighbouring poles: where two meet, their basis is singular
_STEADY = 1e-8  # relative: a profile column is a steady state of the large model
_ENOUGH_ROWS = 400  # of a signal in the functional: rows between them say the same again
_QUIET = 1e-12  # a signal with a smaller root mean square teaches nothing


class Signals(eqx.Module):
    """What a reduced model learns from: a set of runs of the large model.

    Arguments:
        fourier: one Fo per signal.
        step: the common step of the rows, in t_ref.
        inputs: the inputs of each signal.
        initial: the coefficients of each signal's initial profile.
    """

    fourier: Float[Array, " signal"] = eqx.field(converter=jnp.asarray)
    step: Float[Array, ""] = eqx.field(converter=jnp.asarray)
    inputs: Float[Array, "signal time input"] = eqx.field(converter=jnp.asarray)
    initial: Float[Array, "signal param"] = eqx.field(converter=jnp.asarray)


class Learned(eqx.Module):
    """A reduced model and how well it was learned.

    Arguments:
        system: the reduced model.
        eps_2, eps_inf: errors of (u, theta) over all learning signals, dimensionless.
        condition: of the modes' basis; above some 1e8 the split into modes means nothing.
        steps: of Levenberg-Marquardt.
    """

    system: StateSpace
    eps_2: tuple[float, float] = eqx.field(static=True)
    eps_inf: tuple[float, float] = eqx.field(static=True)
    condition: float = eqx.field(static=True)
    steps: int = eqx.field(static=True)

    def __str__(self) -> str:
        return (
            f"Reduced model of order {self.system.order}, learned in {self.steps} steps: "
            f"eps_inf {self.eps_inf[0]:.1e} (u), {self.eps_inf[1]:.1e} (theta), dimensionless; "
            f"condition of the basis {self.condition:.0e}"
        )


class _Modes(NamedTuple):
    """A reduced model but for H; row k belongs to mode k, so each number moves one column of the basis."""

    log_poles: Float[Array, " mode"]
    b: Float[Array, "mode input"]
    profile: Float[Array, "mode free"]  # the columns of P that are no steady states


class _Setting(eqx.Module):
    """What stays the same while learning."""

    signals: Signals
    static_gain: Float[Array, "output input"]
    steady_inputs: Float[Array, "input param"]  # zero columns for profiles that are no steady states
    weight: Float[Array, "kind signal"]
    target: tuple[Array, ...]  # weighted rows by outputs, a block per independent H
    integrator: Integrator = eqx.field(static=True)
    every: int = eqx.field(static=True)  # each how many rows count
    free: tuple[int, ...] = eqx.field(static=True)
    driven: tuple[bool, ...] = eqx.field(static=True)


@threadpool_limits.wrap(limits=1, user_api="blas")
def learn_system(
    lom: StateSpace,
    order: int,
    signals: Signals,
    *,
    tied: bool = True,
    integrator: Integrator = "propagator",
    max_steps: int = 60,
) -> Learned:
    """A reduced model of `order` modes that gives the large model's outputs on these signals.

    LAPACK's threads are kept from it: its matrices are thin, and on a busy machine threads that wait
    for each other made the factorisations fifty times slower.

    Arguments:
        lom: the large model; hoist its `modal()` out of repeated calls.
        order: the number of modes.
        signals: the learning set; inputs that no signal moves are left out of the model, which
            then says so in `driven`.
        tied: one H for u and theta (theta is then the exact derivative); False leaves H_theta
            free, as the paper does.
        integrator: how the signals' rows are stepped through.
        max_steps: of Levenberg-Marquardt. Where two poles meet it creeps on without gain, so the last
            step need not be a converged one; `eps_inf` says what was reached.

    Raises:
        InputError: an order that the large model cannot give, or signals that do not teach it.
    """
    if not 1 <= order <= lom.order:
        raise InputError(f"order = {order}; it must lie between 1 and the large model's {lom.order}")
    lom = lom.modal()
    reference = jax.block_until_ready(_reference(lom, signals, integrator))
    setting = _setting(lom, signals, reference, tied, integrator)
    start = _start(lom, order, setting)
    modes, steps = _search(start, setting, max_steps)
    system, condition = _assemble(lom, modes, setting)
    learned = _reference(system, signals, integrator)
    return Learned(
        system=system,
        eps_2=(eps_2(learned[0], reference[0]), eps_2(learned[1], reference[1])),
        eps_inf=(eps_inf(learned[0], reference[0]), eps_inf(learned[1], reference[1])),
        condition=float(condition),
        steps=int(steps),
    )


def sweep_orders(
    lom: StateSpace,
    orders: Sequence[int],
    signals: Signals,
    *,
    tied: bool = True,
    integrator: Integrator = "propagator",
) -> Iterator[Learned]:
    """Learn each order in turn: the paper's figures of error against order, one at a time."""
    for order in orders:
        yield learn_system(lom, order, signals, tied=tied, integrator=integrator)


def choose_order(
    lom: StateSpace,
    signals: Signals,
    *,
    tolerance: float,
    sensitivity_tolerance: float = 0.01,
    orders: Sequence[int] = (2, 4, 6, 8, 10, 12, 15, 20, 25, 30),
    tied: bool = True,
    integrator: Integrator = "propagator",
    on_try: Callable[[Learned], None] = lambda learned: None,
) -> Learned:
    """The smallest order whose errors do not matter, or the best one tried.

    Arguments:
        tolerance: largest error of u over the learning signals, dimensionless; a tenth of the
            smallest noise is a good one.
        sensitivity_tolerance: largest error of theta over the largest theta.
        tied, integrator: as in `learn_system`.
        on_try: told of each order, for a progress display.
    """
    largest = float(jnp.max(jnp.abs(_reference(lom.modal(), signals, integrator)[1])))
    best: Learned | None = None
    within = [order for order in orders if order <= lom.order]
    for learned in sweep_orders(lom, within, signals, tied=tied, integrator=integrator):
        on_try(learned)
        if best is None or learned.eps_inf[0] < best.eps_inf[0]:
            best = learned
        if learned.eps_inf[0] <= tolerance and learned.eps_inf[1] <= sensitivity_tolerance * largest:
            return learned
    if best is None:
        raise InputError(f"orders: none of {tuple(orders)} is within the large model's {lom.order}")
    return best


@eqx.filter_jit
def _reference(system: StateSpace, signals: Signals, integrator: Integrator) -> tuple[Array, Array]:
    """u and theta of each signal, `(signal, time, output)`."""

    def run(fo: Array, q: Array, a: Array) -> tuple[Array, Array | None]:
        return run_rows(system, fo, signals.step, q, a, sensitivity=True, integrator=integrator)

    u, theta = jax.vmap(run)(signals.fourier, signals.inputs, signals.initial)
    assert theta is not None
    return u, theta


def _setting(
    lom: StateSpace, signals: Signals, reference: tuple[Array, Array], tied: bool, integrator: Integrator
) -> _Setting:
    steady = _steady_inputs(lom)
    free = tuple(int(k) for k in np.flatnonzero(~np.any(steady != 0, axis=0)))
    inputs, initial = np.asarray(signals.inputs), np.asarray(signals.initial)
    moves = np.ptp(inputs, axis=1) > _QUIET
    # from a steady profile, a constant input that does not meet it is a step at the start
    at_rest = ~np.any(initial[:, free], axis=1)
    moves |= at_rest[:, None] & (np.abs(inputs[:, 0] - initial @ steady.T) > _QUIET)
    driven = tuple(bool(moved) for moved in np.any(moves, axis=0))
    unlearned = [k for k in free if not np.any(np.asarray(signals.initial)[:, k])]
    if not any(driven) and len(unlearned) == len(free):
        raise InputError("signals: none of them moves a face or a profile, so there is nothing to learn from")
    if unlearned:
        raise InputError(
            f"signals: no signal starts from a profile of degree {unlearned[0]}, so the reduced model "
            "cannot learn it; add one that does, or lower the large model's profile_degree"
        )
    rms = jnp.stack([jnp.sqrt(jnp.mean(y**2, axis=(1, 2))) for y in reference])
    every = -(-signals.inputs.shape[1] // _ENOUGH_ROWS)
    count = sum(block[:, ::every].size for block in reference)
    weight = jnp.where(rms > _QUIET, 1.0 / jnp.where(rms > _QUIET, rms, 1.0), 0.0) / np.sqrt(count)
    gain = lom.static_gain()
    u_rest = reference[0] - signals.inputs @ gain.T
    rows = [_rows(block, w, every) for block, w in zip((u_rest, reference[1]), weight, strict=True)]
    target = (jnp.concatenate(rows),) if tied else tuple(rows)
    return _Setting(signals, gain, jnp.asarray(steady), weight, target, integrator, every, free, driven)


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


def _rows(block: Float[Array, "signal time column"], weight: Float[Array, " signal"], every: int) -> Array:
    weighted = block[:, ::every] * weight[:, None, None]
    return weighted.reshape(-1, block.shape[-1])


def _start(lom: StateSpace, order: int, setting: _Setting) -> _Modes:
    """The large model's slowest modes, each row of b scaled to a largest entry of 1."""
    slowest = np.argsort(-np.asarray(lom.A))[:order]
    f = np.asarray(lom.A)[slowest]
    b = -np.asarray(lom.B)[slowest] / f[:, None] * np.asarray(setting.driven)
    largest = b[np.arange(order), np.argmax(np.abs(b), axis=1)]
    largest = np.where(np.abs(largest) > _QUIET, largest, 1.0)
    gaps = np.maximum(np.diff(np.log(-f)), 1.001 * np.log(_POLE_RATIO))
    return _Modes(
        log_poles=jnp.asarray(np.cumsum(np.concatenate([np.log(-f[:1]), gaps]))),
        b=jnp.asarray(b / largest[:, None]),
        profile=jnp.asarray(np.asarray(lom.P)[slowest][:, setting.free] / largest[:, None]),
    )


def _basis(modes: _Modes, setting: _Setting) -> tuple[Array, Array]:
    """`X - b Q` and `X_theta` of every mode in every signal, weighted, as rows."""
    f = -jnp.exp(modes.log_poles)
    count, inputs = modes.b.shape
    P = (modes.b @ setting.steady_inputs).at[:, setting.free].set(modes.profile)
    system = StateSpace(A=f, B=-f[:, None] * modes.b, C=jnp.eye(count), D=-modes.b, P=P, driven=(True,) * inputs)
    u, theta = _reference(system, setting.signals, setting.integrator)
    return _rows(u, setting.weight[0], setting.every), _rows(theta, setting.weight[1], setting.every)


def _blocks(modes: _Modes, setting: _Setting) -> tuple[Array, ...]:
    """The basis, a block per independent H: both kinds of rows together where H is tied."""
    basis = _basis(modes, setting)
    return (jnp.concatenate(basis),) if len(setting.target) == 1 else basis


def _eliminate(basis: Array, target: Array) -> tuple[Array, Array, Array, Array]:
    """The best H for a basis, `min |target - basis H^T|`: Q and R of the basis, H, what is left."""
    Q, R = jnp.linalg.qr(basis)
    projected = Q.T @ target
    return Q, R, jax.scipy.linalg.solve_triangular(R, projected).T, target - Q @ projected


@jax.custom_jvp
def _left_over(modes: _Modes, setting: _Setting) -> tuple[Array, ...]:
    """The weighted misfit once H is eliminated."""
    pairs = zip(_blocks(modes, setting), setting.target, strict=True)
    return tuple(_eliminate(basis, target)[3] for basis, target in pairs)


@_left_over.defjvp
def _left_over_jvp(primals, tangents):
    """Exactly: `dr = -(I - Q Q^T) dPhi H^T - Q R^-T dPhi^T r` (Golub and Pereyra).

    A number of mode k moves column k of the basis only, so one derivative per kind of number, along
    a direction that moves all modes at once, gives all columns of all modes.
    """
    modes, setting = primals
    moved: _Modes = tangents[0]
    numbers = jnp.concatenate([moved.log_poles[:, None], moved.b, moved.profile], axis=1)

    def along(kind: Array) -> tuple[Array, ...]:
        ones = jnp.ones_like(modes.log_poles)[:, None] * kind
        inputs = modes.b.shape[1]
        direction = _Modes(ones[:, 0], ones[:, 1 : 1 + inputs], ones[:, 1 + inputs :])
        return jax.jvp(lambda m: _blocks(m, setting), (modes,), (direction,))[1]

    slopes = jax.vmap(along)(jnp.eye(numbers.shape[1]))
    left, changes = [], []
    for basis, target, slope in zip(_blocks(modes, setting), setting.target, slopes, strict=True):
        Q, R, H, r = _eliminate(basis, target)
        change = jnp.einsum("krm,mk->rm", slope, numbers)
        moves = change @ H.T
        turn = Q @ jax.scipy.linalg.solve_triangular(R, change.T @ r, trans=1)
        left.append(r)
        changes.append(Q @ (Q.T @ moves) - moves - turn)
    return tuple(left), tuple(changes)


@eqx.filter_jit
def _search(start: _Modes, setting: _Setting, max_steps: int) -> tuple[_Modes, Array]:
    """The best modes by Levenberg-Marquardt, and its steps.

    Searched are the logs of the gaps between poles past the smallest ratio, b but for its largest entry
    of each mode and for inputs that nothing drives, and the free columns of P.
    """
    smallest = np.log(_POLE_RATIO)
    gaps = jnp.diff(start.log_poles) - smallest
    coded = jnp.concatenate([start.log_poles[:1], jnp.log(jnp.expm1(gaps))])
    # one entry of each row of b stays 1: H holds the row's size
    kept = jax.nn.one_hot(jnp.argmax(jnp.abs(start.b), axis=1), start.b.shape[1], dtype=bool)
    searched = ~kept & jnp.asarray(setting.driven)
    unknowns = (coded, jnp.zeros_like(start.b), start.profile)
    if sum(setting.driven) < 2:
        unknowns = (coded, None, start.profile)

    def decode(unknowns) -> _Modes:
        coded, b_change, profile = unknowns
        gaps = smallest + jax.nn.softplus(coded[1:])
        b = start.b if b_change is None else start.b + jnp.where(searched, b_change, 0.0)
        return _Modes(jnp.cumsum(jnp.concatenate([coded[:1], gaps])), b, profile)

    solution = optx.least_squares(
        lambda unknowns, setting: _left_over(decode(unknowns), setting),
        optx.LevenbergMarquardt(rtol=1e-5, atol=1e-13, norm=optx.two_norm),
        unknowns,
        args=setting,
        max_steps=max_steps,
        throw=False,
    )
    return decode(solution.value), solution.stats["num_steps"]


@eqx.filter_jit
def _assemble(lom: StateSpace, modes: _Modes, setting: _Setting) -> tuple[StateSpace, Array]:
    """The reduced model with its H, and the condition of its basis."""
    pairs = zip(_blocks(modes, setting), setting.target, strict=True)
    solved = [_eliminate(basis, target) for basis, target in pairs]
    f = -jnp.exp(modes.log_poles)
    H = solved[0][2]
    system = StateSpace(
        A=f,
        B=-f[:, None] * modes.b,
        C=H,
        D=setting.static_gain - H @ modes.b,
        P=(modes.b @ setting.steady_inputs).at[:, setting.free].set(modes.profile),
        C_theta=solved[1][2] if len(solved) > 1 else None,
        output_names=lom.output_names,
        driven=setting.driven,
    )
    return system, jnp.linalg.cond(solved[0][1])
