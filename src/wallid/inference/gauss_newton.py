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

from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int, PyTree

_LONGEST = 2.0  # of a step in ln(alpha)
_ROUND_OFF = 1e-12  # relative growth of the cost that is no growth: a sum of many squares rounds


class Trace(eqx.Module):
    """Per accepted iterate: parameters, cost, gamma_1, gamma_2; NaN in rows not reached."""

    parameters: Float[Array, "iterate param"]
    cost: Float[Array, " iterate"]
    gamma_1: Float[Array, " iterate"]
    gamma_2: Float[Array, " iterate"]
    count: Int[Array, ""]


class _State(eqx.Module):
    """Where the iteration stands.

    Args:
        tried: what is evaluated next.
        cost: of the last iterate.
        newton, length: the direction there, and the share of it that leads to `tried`.
        residual, jacobian: of the last evaluation, for whoever wants them at the minimum; no step reads them.
        rows: what the trace is made of, parameters, cost and both gammas a row; the first `count` are iterates.
        met: whether one of the criteria ended it.
        returning: `tried` is the last iterate once more, so that residual, Jacobian and aux are its own and not those
            of a step that was refused.
    """

    tried: Float[Array, " param"]
    cost: Float[Array, ""]
    newton: Float[Array, " param"]
    length: Float[Array, ""]
    residual: PyTree[Array]
    jacobian: PyTree[Array]
    rows: Float[Array, "iterate column"]
    count: Int[Array, ""]
    evaluations: Int[Array, ""]
    met: Bool[Array, ""]
    returning: Bool[Array, ""]
    result: optx.RESULTS


class GaussNewton(optx.AbstractLeastSquaresSolver):
    """Gauss-Newton with the paper's two criteria, its steps bounded and halved.

    Optimistix's own carries residual, Jacobian and aux of the last iterate from step to step, and copies them in each:
    as much work as a reduced model. This one carries numbers, and where it ends on a refused step evaluates once more.

    In `stats`: the `trace` of its iterates; `residual` and `jacobian` at the last of them, whose is `aux`: one array or
    several, as `fn` gives them, the Jacobian's with the parameters as their last axis.

    Args:
        eta_1, eta_2: it goes on while both relative changes are at least these.
        lower, upper: bounds of the first parameter.
        longest_trace: the largest number of iterations, past which it ends as not converged; it needs no `max_steps`.
    """

    eta_1: Float[Array, ""]
    eta_2: Float[Array, ""]
    lower: Float[Array, ""]
    upper: Float[Array, ""]
    longest_trace: int = eqx.field(static=True)
    rtol: float = eqx.field(static=True, default=0.0)
    atol: float = eqx.field(static=True, default=0.0)
    norm: Callable = optx.max_norm

    def init(self, fn, y, args, options, f_struct, aux_struct, tags):
        """Nothing is evaluated yet."""
        return _State(
            tried=y,
            cost=jnp.array(jnp.inf),
            newton=jnp.zeros_like(y),
            length=jnp.array(1.0),
            residual=jax.tree.map(lambda part: jnp.zeros(part.shape), f_struct),
            jacobian=jax.tree.map(lambda part: jnp.zeros(y.shape + part.shape), f_struct),
            rows=jnp.full((self.longest_trace + 1, y.size + 3), jnp.nan),
            count=jnp.array(0),
            evaluations=jnp.array(0),
            met=jnp.array(False),
            returning=jnp.array(False),
            result=optx.RESULTS.successful,
        )

    def step(self, fn, y, args, options, state, tags):
        """One evaluation: an accepted one is an iterate, and is tested by the two criteria."""
        tried, first = state.tried, state.evaluations == 0
        residual, tangent, aux = jax.linearize(lambda y: fn(y, args), tried, has_aux=True)
        jacobian = jax.vmap(tangent)(jnp.eye(y.size))
        cost, newton, result = _newton(residual, jacobian)

        accepted = ~state.returning & (first | (cost <= state.cost * (1 + _ROUND_OFF)))
        gamma_1 = jnp.where(first, jnp.nan, jnp.abs(cost - state.cost) / state.cost)
        gamma_2 = jnp.where(first, jnp.nan, relative_change(tried, y))
        # a row that is no iterate's is written over by the next, or left out of the trace
        rows = state.rows.at[state.count].set(jnp.concatenate([tried, jnp.stack([cost, gamma_1, gamma_2])]))
        # a refused step that is already this small will not help when halved again
        met = jnp.where(state.returning, state.met, (accepted & (gamma_1 < self.eta_1)) | (gamma_2 < self.eta_2))

        y = jnp.where(accepted, tried, y)
        newton = jnp.where(accepted, self._bounded(newton, y), state.newton)
        length = jnp.where(accepted, 1.0, 0.5 * state.length)
        returning = (met | (state.evaluations == self.longest_trace)) & ~accepted & ~state.returning
        # a refused misfit need not be finite, the first has to be
        result = optx.RESULTS.where(accepted, result, optx.RESULTS.successful)
        result = optx.RESULTS.where(first & ~jnp.isfinite(cost), optx.RESULTS.nonfinite, result)
        now = _State(
            tried=jnp.where(returning, y, y - length * newton),
            cost=jnp.where(accepted, cost, state.cost),
            newton=newton,
            length=length,
            residual=residual,
            jacobian=jacobian,
            rows=rows,
            count=state.count + accepted,
            evaluations=state.evaluations + 1,
            met=met,
            returning=returning,
            result=result,
        )
        return y, now, aux

    def _bounded(self, newton: Array, y: Array) -> Array:
        """The step against `newton`, cut to the longest and to the box of its first parameter."""
        newton = newton * jnp.minimum(1.0, _LONGEST / jnp.maximum(jnp.abs(newton[0]), _LONGEST))
        return newton.at[0].set(y[0] - jnp.clip(y[0] - newton[0], self.lower, self.upper))

    def terminate(self, fn, y, args, options, state, tags):
        """Met criteria end the iteration, or the last one allowed does."""
        spent = ~state.met & (state.evaluations > self.longest_trace) & ~state.returning
        result = optx.RESULTS.where(spent, optx.RESULTS.nonlinear_max_steps_reached, state.result)
        return (state.met | spent) & ~state.returning, result

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        """Hand out the trace, and what the last evaluation found: nothing is evaluated again for it."""
        reached = jnp.arange(len(state.rows)) < state.count
        rows = jnp.where(reached[:, None], state.rows, jnp.nan)
        cost, gamma_1, gamma_2 = rows[:, y.size :].T
        trace = Trace(rows[:, : y.size], cost, gamma_1, gamma_2, state.count)
        jacobian = jax.tree.map(lambda part: jnp.moveaxis(part, 0, -1), state.jacobian)
        return y, aux, {"trace": trace, "residual": state.residual, "jacobian": jacobian}


def _newton(residual: PyTree[Array], jacobian: PyTree[Array]) -> tuple[Array, Array, optx.RESULTS]:
    """The cost `|r|^2`, and the smallest solution of `min |J d - r|`: a parameter without information stays.

    By singular values; one column needs no decomposition (thousands of walls at once do), and its three sums are one
    pass through the readings, in whatever shape they lie.
    """
    parts = [(r, J) for r, J in zip(jax.tree.leaves(residual), jax.tree.leaves(jacobian), strict=True) if r.size]
    if parts[0][1].shape[0] > 1:
        r = jnp.concatenate([r.reshape(-1) for r, _ in parts])
        J = jnp.concatenate([J.reshape(J.shape[0], -1) for _, J in parts], axis=1)
        solved = lx.linear_solve(lx.MatrixLinearOperator(J.T), r, lx.SVD(rcond=1e-12), throw=False)
        return jnp.sum(r**2), solved.value, optx.RESULTS.promote(solved.result)
    zero = jnp.zeros(())

    def together(sums: Sequence[Array], more: Sequence[Array]) -> tuple[Array, ...]:
        return tuple(a + b for a, b in zip(sums, more, strict=True))

    sums = [jax.lax.reduce((r**2, J**2, J * r), (zero,) * 3, together, range(r.ndim)) for r, (J,) in parts]
    cost, size, pull = reduce(together, sums)
    newton = jnp.where(size > 0, pull / jnp.where(size > 0, size, 1.0), 0.0)
    return cost, newton[None], optx.RESULTS.successful


def search(
    residual: Callable[[Any, Any], tuple[PyTree[Array], Any]],
    first: Float[Array, " param"],
    args: Any,
    *,
    eta: Float[Array, ""],
    lower: Float[Array, ""],
    upper: Float[Array, ""],
    max_iterations: int,
) -> optx.Solution:
    """The iteration on `residual(y, args)` from `first`, through optimistix; for its `stats` see `GaussNewton`.

    Args:
        residual: gives the residual, one array or several, and what else is wanted at the minimum (`aux`).
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
    return optx.least_squares(residual, solver, first, args=args, has_aux=True, max_steps=None, throw=False)


def relative_change(y_new: Float[Array, " param"], y: Float[Array, " param"]) -> Float[Array, ""]:
    """gamma_2: `|alpha_new/alpha - 1|`, with the other parameters' changes in their priors' units."""
    change = (y_new - y).at[0].set(jnp.expm1(y_new[0] - y[0]))
    return jnp.sqrt(jnp.sum(change**2))
