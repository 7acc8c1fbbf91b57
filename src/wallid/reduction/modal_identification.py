"""The reduced-order model, learned by the Modal Identification Method.

    X' = Fo (F X + G Q),   Y_u = H X + D Q,   Y_theta = H_theta X_theta,   X(0) = P a

with `F = diag(f)`, `f < 0`. Learning minimises the error of outputs and sensitivities against the full-order model over
a set of signals (`variable_projection`).

Three things follow from the physics and are not learned. In a steady state a mode is `X = b Q`, `b = -G/f`. So with `S`
the static gain of the full-order model the direct term is `D = S - H b`: the truncated fast modes keep their static
part, and the reduced-order model is exact in every steady state. An initial profile that is a steady state (a constant;
in a homogeneous wall a straight line) has its column of `P` from `b`. And `H` enters linearly, so it is solved for.
Levenberg-Marquardt searches the poles, the direction of each row of `b`, and the other columns of `P`.

Source: Berger and Kadoch, Section 3.2.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array

from .._internal.arrays import index_array, on_device
from .._internal.blas_threads import one_blas_thread
from .._internal.errors import InputError
from .._internal.html import html_table
from .._internal.progress import Progress, no_progress
from .._internal.result_object import ResultObject, plain_value
from ..models.error_measures import eps_2, eps_inf
from ..models.integration import Integrator
from ..models.state_space import StateSpace
from .variable_projection import (
    CONSTANT_TOLERANCE,
    LearningProblem,
    Modes,
    TrainingSignals,
    basis_blocks,
    learning_problem,
    projected_residual,
    simulated_outputs,
    solve_for_outputs,
)

if TYPE_CHECKING:
    from pandas import DataFrame

_MIN_POLE_RATIO = 1.05  # of neighbouring poles: the basis of two equal ones is singular
_MAX_STEPS = 60
_ARRAY_SIZE = 10  # orders up to a multiple of it are learned in arrays of that size, with one compilation


class LearnedModel(eqx.Module, ResultObject):
    """A reduced-order model with its errors.

    Args:
        system: the reduced-order model.
        eps_2, eps_inf: root mean square and largest error of (u, theta) over all learning signals, dimensionless.
        condition: condition number of the modes' basis; above about 1e8 single modes have no meaning.
        steps: of Levenberg-Marquardt.
    """

    system: StateSpace
    eps_2: tuple[float, float] = eqx.field(static=True)
    eps_inf: tuple[float, float] = eqx.field(static=True)
    condition: float = eqx.field(static=True)
    steps: int = eqx.field(static=True)

    def to_dict(self) -> dict[str, Any]:
        """Order, errors, condition number, steps, and the rates of the modes per unit of Fo."""
        errors = {name: getattr(self, name) for name in ("eps_2", "eps_inf", "condition", "steps")}
        return plain_value({"order": self.system.order, **errors, "rates": self.system.A})

    def to_frame(self) -> DataFrame:
        """One row for each mode: its rate per unit of Fo, and its share in each output, a column of H."""
        return self.system.to_frame()

    def _repr_html_(self) -> str:
        rows = [("order", str(self.system.order), "", "-")]
        rows += [
            (f"largest error of {name}", f"{largest:.1e}", f"root mean square {rms:.1e}", "-")
            for name, largest, rms in zip(("u", "theta"), self.eps_inf, self.eps_2, strict=True)
        ]
        return html_table("Reduced-order model", rows)

    def __str__(self) -> str:
        return (
            f"Reduced-order model of order {self.system.order}, learned in {self.steps} steps: largest error over the "
            f"training signals {self.eps_inf[0]:.1e} of the temperature, {self.eps_inf[1]:.1e} of the sensitivity "
            f"(dimensionless); condition number of the modes' basis {self.condition:.0e}"
        )


def learn_system(
    full_order_model: StateSpace,
    order: int,
    signals: TrainingSignals,
    *,
    tied: bool = True,
    integrator: Integrator = "propagator",
    max_steps: int = _MAX_STEPS,
    progress: Progress = no_progress,
) -> LearnedModel:
    """A reduced-order model of `order` modes that gives the full-order model's outputs on these signals.

    Args:
        full_order_model: as from `wallid.full_order_model`; for repeated calls take its `modal()` once.
        order: the number of modes.
        signals: to learn from. An input that is constant in all of them is not learned (`driven` of the result).
        tied: one H for u and theta, so that theta is the exact derivative; False learns H_theta separately, as the
            paper does.
        integrator: how the signals' rows are stepped through.
        max_steps: of Levenberg-Marquardt. Where two poles come close it goes on without gain, so the last step need
            not be converged; `eps_inf` gives the error that was reached.
        progress: called as `progress(text, share)` with the step that begins.

    Returns:
        the model with its errors.

    Raises:
        InputError: an order above the full-order model's, or signals without the excitation to learn from.

    Source: Berger and Kadoch, Section 3.2.
    """
    _check_order(full_order_model, order)
    progress("learn: simulating the full-order model", 0.0)
    full_order_model = full_order_model.modal()
    reference = jax.block_until_ready(simulated_outputs(full_order_model, signals, integrator))
    progress(f"learn: searching {order} modes", 0.3)
    return _learn(full_order_model, order, order, signals, reference, tied, integrator, max_steps)


def _check_order(full_order_model: StateSpace, order: int) -> None:
    """Refuse an order below 1 or above the full-order model's."""
    if not 1 <= order <= full_order_model.order:
        raise InputError(f"order = {order}; it must lie between 1 and the full-order model's {full_order_model.order}")


@one_blas_thread
def _learn(
    full_order_model: StateSpace,
    order: int,
    array_size: int,
    signals: TrainingSignals,
    reference: tuple[Array, Array],
    tied: bool,
    integrator: Integrator,
    max_steps: int,
) -> LearnedModel:
    """Learn `order` modes in arrays of `shape` modes, so that orders of one shape share one compilation.

    With one thread: on a busy machine several took fifty times longer.
    """
    jax.block_until_ready(reference)
    problem = learning_problem(full_order_model, signals, reference, tied, integrator, order, array_size)
    modes, steps = _levenberg_marquardt(_initial_modes(full_order_model, array_size, problem), problem, max_steps)
    system, R = _assemble_model(full_order_model, modes, problem)
    learned = simulated_outputs(system, signals, integrator)
    return LearnedModel(
        system=_first_modes(system, order),
        eps_2=(eps_2(learned[0], reference[0]), eps_2(learned[1], reference[1])),
        eps_inf=(eps_inf(learned[0], reference[0]), eps_inf(learned[1], reference[1])),
        condition=float(np.linalg.cond(np.asarray(R)[:order, :order])),
        steps=int(steps),
    )


def _first_modes(system: StateSpace, order: int) -> StateSpace:
    """The first `order` modes of a modal model."""
    return replace(
        system,
        A=index_array(system.A, slice(order)),
        B=index_array(system.B, slice(order)),
        C=index_array(system.C, (slice(None), slice(order))),
        P=index_array(system.P, slice(order)),
        C_theta=None if system.C_theta is None else index_array(system.C_theta, (slice(None), slice(order))),
    )


def sweep_orders(
    full_order_model: StateSpace,
    orders: Sequence[int],
    signals: TrainingSignals,
    *,
    tied: bool = True,
    integrator: Integrator = "propagator",
) -> Iterator[LearnedModel]:
    """Learn several orders, one after the other: the paper's figures of error against order.

    Up to ten orders share one compilation. Arguments as in `learn_system`.

    Raises:
        InputError: an order above the full-order model's, or signals without the excitation to learn from.
    """
    for order in orders:
        _check_order(full_order_model, order)
    full_order_model = full_order_model.modal()
    reference = simulated_outputs(full_order_model, signals, integrator)
    for order in orders:
        shape = min(_ARRAY_SIZE * math.ceil(order / _ARRAY_SIZE), full_order_model.order)
        yield _learn(full_order_model, order, shape, signals, reference, tied, integrator, _MAX_STEPS)


def choose_order(
    full_order_model: StateSpace,
    signals: TrainingSignals,
    *,
    tolerance: float,
    sensitivity_tolerance: float = 0.01,
    orders: Sequence[int] = (2, 4, 6, 8, 10, 12, 15, 20, 25, 30),
    tied: bool = True,
    integrator: Integrator = "propagator",
    on_try: Callable[[LearnedModel], None] = lambda learned: None,
    progress: Progress = no_progress,
) -> LearnedModel:
    """The smallest order whose errors are within tolerances, or else the best of those tried.

    Args:
        tolerance: of the largest error of u over the learning signals, dimensionless; a tenth of the smallest noise
            is a good choice.
        sensitivity_tolerance: of the largest error of theta, over the largest theta.
        orders: to be tried.
        tied, integrator: as in `learn_system`.
        on_try: called with each model.
        progress: called as `progress(text, share)` before each order.

    Raises:
        InputError: no order is below that of the full-order model.
    """
    progress("learn: simulating the full-order model", 0.0)
    largest = float(jnp.max(jnp.abs(simulated_outputs(full_order_model.modal(), signals, integrator)[1])))
    best: LearnedModel | None = None
    possible = [order for order in orders if order <= full_order_model.order]
    models = sweep_orders(full_order_model, possible, signals, tied=tied, integrator=integrator)
    for count, order in enumerate(possible):
        progress(f"learn: searching {order} modes", 0.1 + 0.9 * count / len(possible))
        learned = next(models)
        on_try(learned)
        if best is None or learned.eps_inf[0] < best.eps_inf[0]:
            best = learned
        if learned.eps_inf[0] <= tolerance and learned.eps_inf[1] <= sensitivity_tolerance * largest:
            return learned
    if best is None:
        raise InputError(f"orders: none of {tuple(orders)} is within the full-order model's {full_order_model.order}")
    return best


def _initial_modes(full_order_model: StateSpace, order: int, problem: LearningProblem) -> Modes:
    """The full-order model's slowest modes, each row of b scaled to a largest entry of 1."""
    slowest = np.argsort(-np.asarray(full_order_model.A))[:order]
    f = np.asarray(full_order_model.A)[slowest]
    b = -np.asarray(full_order_model.B)[slowest] / f[:, None] * np.asarray(problem.driven)
    largest = b[np.arange(order), np.argmax(np.abs(b), axis=1)]
    largest = np.where(np.abs(largest) > CONSTANT_TOLERANCE, largest, 1.0)
    gaps = np.maximum(np.diff(np.log(-f)), 1.001 * np.log(_MIN_POLE_RATIO))
    return Modes(
        log_poles=on_device(np.cumsum(np.concatenate([np.log(-f[:1]), gaps]))),
        b=on_device(b / largest[:, None]),
        profile=on_device(np.asarray(full_order_model.P)[slowest][:, problem.learned_columns] / largest[:, None]),
    )


@eqx.filter_jit
def _levenberg_marquardt(start: Modes, problem: LearningProblem, max_steps: int) -> tuple[Modes, Array]:
    """The best modes by Levenberg-Marquardt, and its number of steps.

    The unknowns are the gaps between the logarithms of the poles (above the smallest ratio, by a softplus), the entries
    of b except each mode's largest one and those of inputs that do not vary, and the learned columns of P.
    """
    smallest = np.log(_MIN_POLE_RATIO)
    gaps = jnp.diff(start.log_poles) - smallest
    coded = jnp.concatenate([start.log_poles[:1], jnp.log(jnp.expm1(gaps))])
    # one entry of each row of b stays 1: H has the row's size
    fixed = jax.nn.one_hot(jnp.argmax(jnp.abs(start.b), axis=1), start.b.shape[1], dtype=bool)
    searched = ~fixed & jnp.asarray(problem.driven)
    unknowns = (coded, jnp.zeros_like(start.b), start.profile)
    if sum(problem.driven) < 2:
        unknowns = (coded, None, start.profile)

    def decode(unknowns) -> Modes:
        coded, b_change, profile = unknowns
        gaps = smallest + jax.nn.softplus(coded[1:])
        b = start.b if b_change is None else start.b + jnp.where(searched, b_change, 0.0)
        return Modes(jnp.cumsum(jnp.concatenate([coded[:1], gaps])), b, profile)

    solution = optx.least_squares(
        lambda unknowns, problem: projected_residual(decode(unknowns), problem),
        optx.LevenbergMarquardt(rtol=1e-5, atol=1e-13, norm=optx.two_norm),
        unknowns,
        args=problem,
        max_steps=max_steps,
        throw=False,
    )
    return decode(solution.value), solution.stats["num_steps"]


@eqx.filter_jit
def _assemble_model(full_order_model: StateSpace, modes: Modes, problem: LearningProblem) -> tuple[StateSpace, Array]:
    """The reduced-order model with its H, and R of its basis."""
    pairs = zip(basis_blocks(modes, problem), problem.target, strict=True)
    solved = [solve_for_outputs(basis, target) for basis, target in pairs]
    H = solved[0][2]
    system = StateSpace(
        A=modes.poles,
        B=modes.input_matrix,
        C=H,
        D=problem.static_gain - H @ modes.b,
        P=problem.profiles(modes),
        C_theta=solved[1][2] if len(solved) > 1 else None,
        output_names=full_order_model.output_names,
        driven=problem.driven,
    )
    return system, solved[0][1]
