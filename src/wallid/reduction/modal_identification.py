"""The reduced model, learned by the Modal Identification Method.

    X' = Fo (F X + G Q),   Y_u = H X + D Q,   Y_theta = H_theta X_theta,   X(0) = P a

with `F = diag(f)`, `f < 0`. Learning minimises the misfit to the large model's outputs and sensitivities over a set of
signals (`variable_projection`).

Three things are given by the physics and not learned. In a steady state a mode sits at
`X = b Q`, `b = -G/f`, so with `S` the large model's static gain the direct term is `D = S - H b`:
the truncated fast modes keep their static part, and a reduced model is right at rest whatever the
level of temperature. An initial profile that is itself a steady state (a constant; on a
homogeneous wall a straight line) takes its `P` from `b`. And `H` enters linearly, so it is
eliminated: what Levenberg-Marquardt searches are the poles, the direction of each row of `b`, and
the rest of `P`.

Source: Berger and Kadoch, Section 3.2.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array
from threadpoolctl import threadpool_limits

from .._internal.arrays import index_array, on_device
from .._internal.errors import InputError
from ..models.error_measures import eps_2, eps_inf
from ..models.integration import Integrator
from ..models.state_space import StateSpace
from .variable_projection import (
    QUIET,
    Modes,
    Setting,
    TrainingSignals,
    blocks,
    courses,
    eliminate,
    left_over,
    setting_of,
)

_POLE_RATIO = 1.05  # smallest ratio of neighbouring poles: where two meet, their basis is singular
_MOST_STEPS = 60
_SHAPE = 10  # orders up to a multiple of it are learned in arrays of its size


class LearnedModel(eqx.Module):
    """A reduced model and how well it was learned.

    Args:
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


def learn_system(
    lom: StateSpace,
    order: int,
    signals: TrainingSignals,
    *,
    tied: bool = True,
    integrator: Integrator = "propagator",
    max_steps: int = _MOST_STEPS,
) -> LearnedModel:
    """A reduced model of `order` modes that gives the large model's outputs on these signals.

    Args:
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
    _check_order(lom, order)
    lom = lom.modal()
    reference = courses(lom, signals, integrator)
    return _learn(lom, order, order, signals, reference, tied, integrator, max_steps)


def _check_order(lom: StateSpace, order: int) -> None:
    """Refuse an order that the large model cannot give."""
    if not 1 <= order <= lom.order:
        raise InputError(f"order = {order}; it must lie between 1 and the large model's {lom.order}")


@threadpool_limits.wrap(limits=1, user_api="blas")
def _learn(
    lom: StateSpace,
    order: int,
    shape: int,
    signals: TrainingSignals,
    reference: tuple[Array, Array],
    tied: bool,
    integrator: Integrator,
    max_steps: int,
) -> LearnedModel:
    """Learn `order` modes in arrays of `shape` modes: orders of one shape share one compilation.

    LAPACK's threads are kept from it: its matrices are thin, and on a busy machine threads that wait
    for each other made the factorisations fifty times slower.
    """
    jax.block_until_ready(reference)
    setting = setting_of(lom, signals, reference, tied, integrator, order, shape)
    modes, steps = _search(_start(lom, shape, setting), setting, max_steps)
    whole, R = _assemble(lom, modes, setting)
    learned = courses(whole, signals, integrator)
    return LearnedModel(
        system=_first_modes(whole, order),
        eps_2=(eps_2(learned[0], reference[0]), eps_2(learned[1], reference[1])),
        eps_inf=(eps_inf(learned[0], reference[0]), eps_inf(learned[1], reference[1])),
        condition=float(np.linalg.cond(np.asarray(R)[:order, :order])),
        steps=int(steps),
    )


def _first_modes(system: StateSpace, order: int) -> StateSpace:
    """A modal model without the modes past the first `order`."""
    return replace(
        system,
        A=index_array(system.A, slice(order)),
        B=index_array(system.B, slice(order)),
        C=index_array(system.C, (slice(None), slice(order))),
        P=index_array(system.P, slice(order)),
        C_theta=None if system.C_theta is None else index_array(system.C_theta, (slice(None), slice(order))),
    )


def sweep_orders(
    lom: StateSpace,
    orders: Sequence[int],
    signals: TrainingSignals,
    *,
    tied: bool = True,
    integrator: Integrator = "propagator",
) -> Iterator[LearnedModel]:
    """Learn each order in turn: the paper's figures of error against order, one at a time.

    Up to ten orders share one compilation: for each by itself it takes longer than to learn it.

    Raises:
        InputError: an order that the large model cannot give, or signals that do not teach it.
    """
    for order in orders:
        _check_order(lom, order)
    lom = lom.modal()
    reference = courses(lom, signals, integrator)
    for order in orders:
        shape = min(_SHAPE * math.ceil(order / _SHAPE), lom.order)
        yield _learn(lom, order, shape, signals, reference, tied, integrator, _MOST_STEPS)


def choose_order(
    lom: StateSpace,
    signals: TrainingSignals,
    *,
    tolerance: float,
    sensitivity_tolerance: float = 0.01,
    orders: Sequence[int] = (2, 4, 6, 8, 10, 12, 15, 20, 25, 30),
    tied: bool = True,
    integrator: Integrator = "propagator",
    on_try: Callable[[LearnedModel], None] = lambda learned: None,
) -> LearnedModel:
    """The smallest order whose errors do not matter, or the best one tried.

    Args:
        tolerance: largest error of u over the learning signals, dimensionless; a tenth of the
            smallest noise is a good one.
        sensitivity_tolerance: largest error of theta over the largest theta.
        tied, integrator: as in `learn_system`.
        on_try: told of each order, for a progress display.
    """
    largest = float(jnp.max(jnp.abs(courses(lom.modal(), signals, integrator)[1])))
    best: LearnedModel | None = None
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


def _start(lom: StateSpace, order: int, setting: Setting) -> Modes:
    """The large model's slowest modes, each row of b scaled to a largest entry of 1."""
    slowest = np.argsort(-np.asarray(lom.A))[:order]
    f = np.asarray(lom.A)[slowest]
    b = -np.asarray(lom.B)[slowest] / f[:, None] * np.asarray(setting.driven)
    largest = b[np.arange(order), np.argmax(np.abs(b), axis=1)]
    largest = np.where(np.abs(largest) > QUIET, largest, 1.0)
    gaps = np.maximum(np.diff(np.log(-f)), 1.001 * np.log(_POLE_RATIO))
    return Modes(
        log_poles=on_device(np.cumsum(np.concatenate([np.log(-f[:1]), gaps]))),
        b=on_device(b / largest[:, None]),
        profile=on_device(np.asarray(lom.P)[slowest][:, setting.free] / largest[:, None]),
    )


@eqx.filter_jit
def _search(start: Modes, setting: Setting, max_steps: int) -> tuple[Modes, Array]:
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

    def decode(unknowns) -> Modes:
        coded, b_change, profile = unknowns
        gaps = smallest + jax.nn.softplus(coded[1:])
        b = start.b if b_change is None else start.b + jnp.where(searched, b_change, 0.0)
        return Modes(jnp.cumsum(jnp.concatenate([coded[:1], gaps])), b, profile)

    solution = optx.least_squares(
        lambda unknowns, setting: left_over(decode(unknowns), setting),
        optx.LevenbergMarquardt(rtol=1e-5, atol=1e-13, norm=optx.two_norm),
        unknowns,
        args=setting,
        max_steps=max_steps,
        throw=False,
    )
    return decode(solution.value), solution.stats["num_steps"]


@eqx.filter_jit
def _assemble(lom: StateSpace, modes: Modes, setting: Setting) -> tuple[StateSpace, Array]:
    """The reduced model with its H, and R of its basis."""
    pairs = zip(blocks(modes, setting), setting.target, strict=True)
    solved = [eliminate(basis, target) for basis, target in pairs]
    H = solved[0][2]
    system = StateSpace(
        A=modes.poles,
        B=modes.inflow,
        C=H,
        D=setting.static_gain - H @ modes.b,
        P=setting.profiles(modes),
        C_theta=solved[1][2] if len(solved) > 1 else None,
        output_names=lom.output_names,
        driven=setting.driven,
    )
    return system, solved[0][1]
