import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from scipy.optimize import least_squares

from wallid.inference.gauss_newton import GaussNewton


def solve(residual, *, y0=(0.0, 0.0), eta=1e-12, lower=-20.0, upper=20.0, steps=60):
    solver = GaussNewton(
        jnp.asarray(eta),
        jnp.asarray(eta),
        lower=jnp.asarray(lower),
        upper=jnp.asarray(upper),
        max_iterations=steps,
    )
    return optx.least_squares(lambda y, _: residual(y), solver, jnp.asarray(y0), max_steps=None, throw=False)


def curved(y):
    t = jnp.linspace(0, 3, 30)
    return jnp.exp(-jnp.exp(y[0]) * t) * (1 + y[1]) - jnp.exp(-2.5 * t) * 1.3 - 0.01 * jnp.sin(40 * t)


def test_it_finds_scipys_minimum():
    want = least_squares(lambda y: np.asarray(curved(jnp.asarray(y))), [0.0, 0.0], xtol=1e-14, ftol=1e-14).x
    got = solve(curved)
    assert got.result == optx.RESULTS.successful
    np.testing.assert_allclose(got.value, want, rtol=1e-8)


def test_the_trace_is_the_papers_iteration():
    """Each row is the step `p + (J^T J)^-1 J^T r` from the row before, with its gammas."""
    solution = solve(curved, eta=1e-6)
    trace = solution.stats["trace"]
    count = int(trace.count)
    for k in range(count - 1):
        y = trace.parameters[k]
        J, r = np.asarray(jax.jacfwd(curved)(y)), np.asarray(curved(y))
        step = np.linalg.solve(J.T @ J, -J.T @ r)
        np.testing.assert_allclose(trace.parameters[k + 1], y + step, rtol=1e-8, atol=1e-10)
        gamma_1 = abs(trace.cost[k + 1] - trace.cost[k]) / trace.cost[k]
        assert trace.gamma_1[k + 1] == pytest.approx(float(gamma_1), rel=1e-6)
    # it went on while both were at least eta, and ended with the first that was not
    both = np.minimum(trace.gamma_1[1:count], trace.gamma_2[1:count])
    assert np.all(both[:-1] >= 1e-6) and both[-1] < 1e-6
    assert np.all(np.isnan(trace.cost[count:]))


def test_an_overshooting_start_is_brought_back():
    solution = solve(curved, y0=(-9.0, 0.0))
    np.testing.assert_allclose(solution.value, solve(curved).value, rtol=1e-6)


def test_it_ends_at_a_bound():
    solution = solve(lambda y: jnp.stack([y[0] - 10.0, y[1] - 1.0]), upper=3.0)
    assert solution.value[0] == pytest.approx(3.0)


def test_a_parameter_without_information_stays_where_it_is():
    solution = solve(lambda y: jnp.stack([y[0] - 1.0, 2 * y[0] - 2.0, 0.0 * y[1]]), y0=(0.0, 0.4))
    np.testing.assert_allclose(solution.value, [1.0, 0.4], atol=1e-12)


@pytest.mark.parametrize("steps", [60, 8])
@pytest.mark.parametrize("size", [1, 2])
def test_what_it_hands_out_is_the_last_iterates_own_after_a_refused_step(size, steps):
    """With a derivative of the wrong sign every step grows the cost: the start stays, and is evaluated once more."""

    @jax.custom_jvp
    def residual(y):
        return jnp.concatenate([jnp.exp(y) - 3.0, 2.0 * y])

    residual.defjvp(lambda at, to: (residual(*at), -jnp.concatenate([jnp.exp(at[0]) * to[0], 2.0 * to[0]])))
    start = np.full(size, 0.5)
    solution = solve(residual, y0=start, eta=1e-6, steps=steps)
    assert solution.result == (optx.RESULTS.successful if steps == 60 else optx.RESULTS.nonlinear_max_steps_reached)
    np.testing.assert_array_equal(solution.value, start)
    assert solution.stats["trace"].count == 1
    np.testing.assert_array_equal(solution.stats["residual"], residual(jnp.asarray(start)))
    np.testing.assert_array_equal(
        solution.stats["jacobian"], -np.concatenate([np.diag(np.exp(start)), 2.0 * np.eye(size)])
    )
    if steps == 8:
        # the start, eight tried, and the start again
        assert solution.stats["num_steps"] == 10


@pytest.mark.parametrize("size", [1, 2])
def test_a_step_into_what_is_not_finite_is_halved(size):
    def residual(y):
        return jnp.concatenate([jnp.sqrt(1.0 - y) - 0.3, 0.1 * y])

    start = np.zeros(size)
    J, r = np.asarray(jax.jacfwd(residual)(start)), np.asarray(residual(start))
    assert np.all(start - np.linalg.lstsq(J, r, rcond=None)[0] > 1.0)
    inside = -np.inf, 1.0 - 1e-9
    want = least_squares(lambda y: np.asarray(residual(jnp.asarray(y))), start, bounds=inside, xtol=1e-14).x
    solution = solve(residual, y0=start)
    assert solution.result == optx.RESULTS.successful
    np.testing.assert_allclose(solution.value, want, rtol=1e-6)


@pytest.mark.parametrize("size", [1, 2])
def test_a_start_that_is_not_finite_is_no_minimum(size):
    solution = solve(lambda y: jnp.log(y), y0=np.full(size, -1.0))
    assert solution.result == optx.RESULTS.nonfinite
    assert solution.stats["num_steps"] == 1


def test_an_end_at_the_last_iteration_allowed_is_not_converged():
    solution = solve(curved, steps=2)
    assert solution.result == optx.RESULTS.nonlinear_max_steps_reached
    assert solution.stats["num_steps"] == 3 and solution.stats["trace"].count == 3
    np.testing.assert_allclose(solution.stats["residual"], curved(solution.value), rtol=1e-12)
