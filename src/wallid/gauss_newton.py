"""The paper's Gauss-Newton iteration, as an optimistix solver that keeps its history.

    p_{k+1} = p_k + (J^T J)^-1 J^T r(p_k),      r = weighted (measured - model)

It goes on while `gamma_1 >= eta_1` and `gamma_2 >= eta_2`, with the relative changes of the cost
and of the parameters:

    gamma_1 = |J(p_{k+1}) - J(p_k)| / J(p_k),      gamma_2 = |p_{k+1} - p_k| / |p_k|

The parameters are searched as `y = (ln(alpha/alpha_0), others in units of their prior)`, which
keeps the diffusivity positive. Far from the solution a full step can overshoot: a step changes the
diffusivity by a factor of e^2 at most, stays within its bounds, and is halved until the cost
does not grow.

Source: Berger and Kadoch, Section 4.2 and Algorithm 1; Deuflhard, Newton Methods for Nonlinear Problems
(2004), chapter 4.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Array, Float, Int

_LONGEST = 2.0  # of a step in ln(alpha)
_ROUND_OFF = 1e-12  # relative growth of the cost that is no growth: a sum of many squares rounds


def _silent(**_kwargs: Any) -> None:
    """Optimistix tells its progress to this; the trace holds what is wanted of it."""


class Trace(eqx.Module):
    """Per accepted iterate: parameters, cost, gamma_1, gamma_2; NaN in rows not reached."""

    parameters: Float[Array, "iterate param"]
    cost: Float[Array, " iterate"]
    gamma_1: Float[Array, " iterate"]
    gamma_2: Float[Array, " iterate"]
    count: Int[Array, ""]


class _BoundedState(NamedTuple):
    newton: Array
    result: optx.RESULTS


class BoundedNewton(optx.AbstractDescent):
    """The Newton direction, cut to the longest step and to the box of its first parameter.

    A parameter without any information is left where it is instead of being thrown away.
    """

    lower: Float[Array, ""]
    upper: Float[Array, ""]

    def init(self, y, f_info_struct):
        """No step yet."""
        return _BoundedState(y, optx.RESULTS.successful)

    def query(self, y, f_info, state):
        """The direction at `y`."""
        jacobian = f_info.jac.as_matrix()
        newton, result = _least_squares(jacobian, f_info.residual)
        newton = newton * jnp.minimum(1.0, _LONGEST / jnp.maximum(jnp.abs(newton[0]), _LONGEST))
        newton = newton.at[0].set(y[0] - jnp.clip(y[0] - newton[0], self.lower, self.upper))
        return _BoundedState(newton, result)

    def step(self, step_size, state):
        """The step of this length along the direction."""
        return -step_size * state.newton, state.result


def _least_squares(jacobian: Array, residual: Array) -> tuple[Array, optx.RESULTS]:
    """The smallest solution, by singular values; one column needs no decomposition (thousands of walls at once do)."""
    if jacobian.shape[1] == 1:
        size = jnp.sum(jacobian**2)
        newton = jnp.where(size > 0, jacobian[:, 0] @ residual / jnp.where(size > 0, size, 1.0), 0.0)
        return newton[None], optx.RESULTS.successful
    solved = lx.linear_solve(lx.MatrixLinearOperator(jacobian), residual, lx.SVD(rcond=1e-12), throw=False)
    return solved.value, optx.RESULTS.promote(solved.result)


class StepHalving(optx.AbstractSearch):
    """Take the full step; halve it while the cost grows or is not finite."""

    def init(self, y, f_info_struct):
        """The full step."""
        return jnp.array(1.0)

    def step(self, first_step, y, y_eval, f_info, f_eval_info, state):
        """Whether to accept `y_eval`, and the next step's length."""
        before, after = f_info.as_min(), f_eval_info.as_min()
        accept = first_step | (after <= before * (1 + _ROUND_OFF))
        step_size = jnp.where(accept, 1.0, 0.5 * state)
        return step_size, accept, optx.RESULTS.successful, step_size


class _HalvedSteps(optx.AbstractGaussNewton):
    """Optimistix's Gauss-Newton with this module's descent and search; `GaussNewton` says when it ends."""

    descent: optx.AbstractDescent
    search: optx.AbstractSearch
    rtol: float = eqx.field(static=True, default=0.0)
    atol: float = eqx.field(static=True, default=0.0)
    norm: Callable = optx.max_norm
    verbose: Callable = eqx.field(static=True, default=_silent)


class _TracedState(eqx.Module):
    inner: Any
    trace: Trace
    stop: Array


class GaussNewton(optx.AbstractLeastSquaresSolver):
    """Gauss-Newton with the paper's two criteria.

    In `stats`: the `trace` of its iterates; `residual`, `jacobian` and `aux` at the last of them.

    Arguments:
        eta_1, eta_2: it goes on while both relative changes are at least these.
        lower, upper: bounds of the first parameter.
        longest_trace: the largest number of iterations.
    """

    eta_1: Float[Array, ""]
    eta_2: Float[Array, ""]
    inner: _HalvedSteps
    longest_trace: int = eqx.field(static=True)
    rtol: float = eqx.field(static=True, default=0.0)
    atol: float = eqx.field(static=True, default=0.0)
    norm: Callable = optx.max_norm

    def __init__(
        self,
        eta_1: Float[Array, ""],
        eta_2: Float[Array, ""],
        *,
        lower: Float[Array, ""],
        upper: Float[Array, ""],
        longest_trace: int,
    ):
        self.eta_1, self.eta_2 = eta_1, eta_2
        self.inner = _HalvedSteps(descent=BoundedNewton(lower, upper), search=StepHalving())
        self.longest_trace = longest_trace

    def init(self, fn, y, args, options, f_struct, aux_struct, tags):
        """The inner state and an empty trace."""
        empty = jnp.full(self.longest_trace + 1, jnp.nan)
        trace = Trace(jnp.full((*empty.shape, y.size), jnp.nan), empty, empty, empty, jnp.array(0))
        inner = self.inner.init(fn, y, args, options, f_struct, aux_struct, tags)
        return _TracedState(inner, trace, jnp.array(False))

    def step(self, fn, y, args, options, state, tags):
        """One evaluation: an accepted one is an iterate, and is tested by the two criteria."""
        tried, first = state.inner.y_eval, state.inner.first_step
        y_next, inner, aux = self.inner.step(fn, y, args, options, state.inner, tags)
        accepted = inner.num_accepted_steps > state.inner.num_accepted_steps
        cost = jnp.sum(inner.f_info.residual**2)
        k, trace = state.trace.count, state.trace
        previous = trace.cost[k - 1]
        gamma_1 = jnp.where(first, jnp.nan, jnp.abs(cost - previous) / previous)
        gamma_2 = jnp.where(first, jnp.nan, relative_change(tried, y))

        def put(rows: Array, row: Array) -> Array:
            return rows.at[k].set(jnp.where(accepted, row, rows[k]))

        trace = Trace(
            put(trace.parameters, y_next),
            put(trace.cost, cost),
            put(trace.gamma_1, gamma_1),
            put(trace.gamma_2, gamma_2),
            k + accepted,
        )
        # a refused step that is already this small will not help when halved again
        met = (accepted & (gamma_1 < self.eta_1)) | (gamma_2 < self.eta_2)
        return y_next, _TracedState(inner, trace, met), aux

    def terminate(self, fn, y, args, options, state, tags):
        """Met criteria end the iteration."""
        return state.stop, state.inner.result

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        """Hand out the trace, and what the last accepted evaluation found: nothing is evaluated again for it."""
        at = state.inner
        found = {"residual": at.f_info.residual, "jacobian": at.f_info.jac.as_matrix(), "aux": at.aux}
        return y, aux, {"trace": state.trace, **found}


def search(
    residual: Callable[[Any, Any], tuple[Array, Any]],
    first: Float[Array, " param"],
    args: Any,
    *,
    eta: Float[Array, ""],
    lower: Float[Array, ""],
    upper: Float[Array, ""],
    max_iterations: int,
) -> optx.Solution:
    """The iteration on `residual(y, args)` from `first`, through optimistix; for its `stats` see `GaussNewton`.

    Arguments:
        residual: gives the residual, and what else is wanted at the minimum (`stats["aux"]`).
        eta: the stopping criterion on the diffusivity; its square is that on the cost.
        lower, upper: of ln(alpha/alpha_0).
    """
    solver = GaussNewton(
        # near the minimum gamma_1 goes with the square of gamma_2; under 1e-14 a sum of squares is round-off
        eta_1=jnp.maximum(eta**2, 1e-14),
        eta_2=eta,
        lower=lower,
        upper=upper,
        longest_trace=max_iterations,
    )
    steps = max_iterations + 1
    return optx.least_squares(residual, solver, first, args=args, has_aux=True, max_steps=steps, throw=False)


def relative_change(y_new: Float[Array, " param"], y: Float[Array, " param"]) -> Float[Array, ""]:
    """gamma_2: `|alpha_new/alpha - 1|`, with the other parameters' changes in their priors' units."""
    change = (y_new - y).at[0].set(jnp.expm1(y_new[0] - y[0]))
    return jnp.sqrt(jnp.sum(change**2))
