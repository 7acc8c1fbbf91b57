"""The paper's Gauss-Newton iteration, as an optimistix solver that records its iterates.

    p_{k+1} = p_k + (J^T J)^-1 J^T r(p_k),      r = weighted (measured - model)

It continues while `gamma_1 >= eta_1` and `gamma_2 >= eta_2`, with the relative changes of the cost and of the
parameters:

    gamma_1 = |J(p_{k+1}) - J(p_k)| / J(p_k),      gamma_2 = |p_{k+1} - p_k| / |p_k|

The vector is `y = (ln(alpha/alpha_0), other parameters in prior standard deviations)`, so the diffusivity stays
positive. Far from the solution a full step can overshoot. Each step therefore changes the diffusivity by a factor of
e^2 at most, stays within its bounds, and is halved until the cost does not increase.

Source: Berger and Kadoch, Section 4.2 and Algorithm 1; Deuflhard, Newton Methods for Nonlinear Problems
(2004), chapter 4.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial, reduce
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int, PyTree

_MAX_STEP = 2.0  # of ln(alpha)
_ROUND_OFF = 1e-12  # relative increase of the cost that is round-off of a sum of many squares


class Trace(eqx.Module):
    """Parameters, cost, gamma_1 and gamma_2 of each iterate; NaN in the rows past the last of the `count` iterates."""

    parameters: Float[Array, "iterate param"]
    cost: Float[Array, " iterate"]
    gamma_1: Float[Array, " iterate"]
    gamma_2: Float[Array, " iterate"]
    count: Int[Array, ""]


class _State(eqx.Module):
    """The state of the iteration.

    Args:
        trial: the point that is evaluated next.
        cost: of the last iterate.
        newton_step, step_length: the step from the last iterate, and the fraction of it that leads to `trial`.
        residual, jacobian: of the last evaluation, for the result only.
        rows: of the trace: parameters, cost, gamma_1 and gamma_2. The first `count` rows are iterates.
        converged: whether one of the two criteria was met.
        restoring: whether `trial` is the last iterate again. It is evaluated again after a rejected step, so that the
            returned residual, Jacobian and aux are those of the last iterate.
    """

    trial: Float[Array, " param"]
    cost: Float[Array, ""]
    newton_step: Float[Array, " param"]
    step_length: Float[Array, ""]
    residual: PyTree[Array]
    jacobian: PyTree[Array]
    rows: Float[Array, "iterate column"]
    count: Int[Array, ""]
    evaluations: Int[Array, ""]
    converged: Bool[Array, ""]
    restoring: Bool[Array, ""]
    result: optx.RESULTS


class GaussNewton(optx.AbstractLeastSquaresSolver):
    """Gauss-Newton with the paper's two criteria, and with bounded and halved steps.

    Optimistix's own solver copies residual, Jacobian and aux of the last iterate in every step, which costs as much as
    a reduced-order model. This solver does not. If it ends on a rejected step, it evaluates the last iterate again.

    `stats` has the `trace`, and the `residual` and `jacobian` of the last iterate, in the structure that `fn` returns,
    with the parameters as the Jacobian's last axis.

    Args:
        eta_1, eta_2: the iteration continues while gamma_1 and gamma_2 are at least these.
        lower, upper: bounds of the first parameter.
        max_iterations: after more evaluations the iteration ends as not converged; `max_steps` is not needed.
    """

    eta_1: Float[Array, ""]
    eta_2: Float[Array, ""]
    lower: Float[Array, ""]
    upper: Float[Array, ""]
    max_iterations: int = eqx.field(static=True)
    rtol: float = eqx.field(static=True, default=0.0)
    atol: float = eqx.field(static=True, default=0.0)
    norm: Callable = optx.max_norm

    def init(self, fn, y, args, options, f_struct, aux_struct, tags):
        """The state before the first evaluation."""
        return _State(
            trial=y,
            cost=jnp.array(jnp.inf),
            newton_step=jnp.zeros_like(y),
            step_length=jnp.array(1.0),
            residual=jax.tree.map(lambda part: jnp.zeros(part.shape), f_struct),
            jacobian=jax.tree.map(lambda part: jnp.zeros(y.shape + part.shape), f_struct),
            rows=jnp.full((self.max_iterations + 1, y.size + 3), jnp.nan),
            count=jnp.array(0),
            evaluations=jnp.array(0),
            converged=jnp.array(False),
            restoring=jnp.array(False),
            result=optx.RESULTS.successful,
        )

    def step(self, fn, y, args, options, state, tags):
        """One evaluation: accept or reject the trial point, test the two criteria, compute the next trial point."""
        trial, first = state.trial, state.evaluations == 0
        residual, tangent, aux = jax.linearize(lambda y: fn(y, args), trial, has_aux=True)
        jacobian = jax.vmap(tangent)(jnp.eye(y.size))
        cost, newton_step, result = _newton_step(residual, jacobian)

        accepted = ~state.restoring & (first | (cost <= state.cost * (1 + _ROUND_OFF)))
        gamma_1 = jnp.where(first, jnp.nan, jnp.abs(cost - state.cost) / state.cost)
        gamma_2 = jnp.where(first, jnp.nan, relative_change(trial, y))
        # the row of a rejected step is overwritten by the next one, or cut off at the end
        rows = state.rows.at[state.count].set(jnp.concatenate([trial, jnp.stack([cost, gamma_1, gamma_2])]))
        # a rejected step below eta_2 ends the iteration: halving it again would not help
        converged = jnp.where(
            state.restoring, state.converged, (accepted & (gamma_1 < self.eta_1)) | (gamma_2 < self.eta_2)
        )

        y = jnp.where(accepted, trial, y)
        newton_step = jnp.where(accepted, self._bounded(newton_step, y), state.newton_step)
        step_length = jnp.where(accepted, 1.0, 0.5 * state.step_length)
        restoring = (converged | (state.evaluations == self.max_iterations)) & ~accepted & ~state.restoring
        # the first cost must be finite; that of a rejected step need not be
        result = optx.RESULTS.where(accepted, result, optx.RESULTS.successful)
        result = optx.RESULTS.where(first & ~jnp.isfinite(cost), optx.RESULTS.nonfinite, result)
        new_state = _State(
            trial=jnp.where(restoring, y, y - step_length * newton_step),
            cost=jnp.where(accepted, cost, state.cost),
            newton_step=newton_step,
            step_length=step_length,
            residual=residual,
            jacobian=jacobian,
            rows=rows,
            count=state.count + accepted,
            evaluations=state.evaluations + 1,
            converged=converged,
            restoring=restoring,
            result=result,
        )
        return y, new_state, aux

    def _bounded(self, newton_step: Array, y: Array) -> Array:
        """The step, shortened to `_MAX_STEP` and to the bounds of the first parameter."""
        newton_step = newton_step * jnp.minimum(1.0, _MAX_STEP / jnp.maximum(jnp.abs(newton_step[0]), _MAX_STEP))
        return newton_step.at[0].set(y[0] - jnp.clip(y[0] - newton_step[0], self.lower, self.upper))

    def terminate(self, fn, y, args, options, state, tags):
        """The iteration ends when it has converged, or after `max_iterations`."""
        exhausted = ~state.converged & (state.evaluations > self.max_iterations) & ~state.restoring
        result = optx.RESULTS.where(exhausted, optx.RESULTS.nonlinear_max_steps_reached, state.result)
        return (state.converged | exhausted) & ~state.restoring, result

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        """The result, from the last evaluation."""
        reached = jnp.arange(len(state.rows)) < state.count
        rows = jnp.where(reached[:, None], state.rows, jnp.nan)
        cost, gamma_1, gamma_2 = rows[:, y.size :].T
        trace = Trace(rows[:, : y.size], cost, gamma_1, gamma_2, state.count)
        jacobian = jax.tree.map(lambda part: jnp.moveaxis(part, 0, -1), state.jacobian)
        return y, aux, {"trace": trace, "residual": state.residual, "jacobian": jacobian}


def _newton_step(residual: PyTree[Array], jacobian: PyTree[Array]) -> tuple[Array, Array, optx.RESULTS]:
    """The cost `|r|^2`, and the smallest solution d of `min |J d - r|`, 0 for a parameter without information.

    By singular values. One parameter (as in a batch of walls) needs no decomposition: three sums in one pass over the
    readings.
    """
    parts = [(r, J) for r, J in zip(jax.tree.leaves(residual), jax.tree.leaves(jacobian), strict=True) if r.size]
    if parts[0][1].shape[0] > 1:
        r = jnp.concatenate([r.reshape(-1) for r, _ in parts])
        J = jnp.concatenate([J.reshape(J.shape[0], -1) for _, J in parts], axis=1)
        solution = lx.linear_solve(lx.MatrixLinearOperator(J.T), r, lx.SVD(rcond=1e-12), throw=False)
        return jnp.sum(r**2), solution.value, optx.RESULTS.promote(solution.result)
    add = partial(jax.tree.map, jnp.add)
    sums = [jax.lax.reduce((r**2, J**2, J * r), (jnp.zeros(()),) * 3, add, range(r.ndim)) for r, (J,) in parts]
    cost, square, product = reduce(add, sums)
    step = jnp.where(square > 0, product / jnp.where(square > 0, square, 1.0), 0.0)
    return cost, step[None], optx.RESULTS.successful


def search(problem: Any, first: Float[Array, " param"], eta: Float[Array, ""], max_iterations: int) -> optx.Solution:
    """The Gauss-Newton iteration on `problem.residual(y)` from `first`, for use inside a compiled function.

    Args:
        problem: a pytree with a method `residual`, which returns the residual (a pytree of arrays) and any further
            values (`aux`); with `start`, alpha_0; and with `lowest` and `highest`, the bounds of the diffusivity, m2/s.
        first: where the iteration starts.
        eta: the stopping criterion on the diffusivity; its square is the one on the cost.
        max_iterations: after more evaluations the iteration ends as not converged.

    Returns:
        the optimistix solution: `value` (y), `aux`, `result`, and `stats` (see `GaussNewton`).
    """
    solver = GaussNewton(
        # near the minimum gamma_1 is proportional to gamma_2^2; below 1e-14 a sum of squares is round-off
        eta_1=jnp.maximum(eta**2, 1e-14),
        eta_2=eta,
        lower=jnp.log(problem.lowest / problem.start),
        upper=jnp.log(problem.highest / problem.start),
        max_iterations=max_iterations,
    )
    return optx.least_squares(
        lambda y, problem: problem.residual(y), solver, first, problem, has_aux=True, max_steps=None, throw=False
    )


def relative_change(y_new: Float[Array, " param"], y: Float[Array, " param"]) -> Float[Array, ""]:
    """gamma_2: the norm of `alpha_new/alpha - 1` and of the other parameters' changes in prior standard deviations."""
    change = (y_new - y).at[0].set(jnp.expm1(y_new[0] - y[0]))
    return jnp.sqrt(jnp.sum(change**2))
