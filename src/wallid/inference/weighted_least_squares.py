"""The paper's estimate: Gauss-Newton on the weighted sum of squared residuals, all readings independent.

Minimised over `y = (ln(alpha/alpha_0), beta)`:

    J(y) = sum over readings ((T_model(alpha) + offset_std beta - T_measured) / sigma)^2 + |beta|^2

with an offset `offset_std beta` for each sensor whose case states an `offset_std`.

Source: Berger and Kadoch, Section 4.2.
"""

from __future__ import annotations

from functools import partial
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from ..case.case_definition import Case
from ..case.initial_profile import scales
from ..models.integration import Integrator
from ..models.sensitivity_equations import field_with_theta, simulate_window
from ..models.state_space import StateSpace
from ..models.window_inputs import WindowData, full_order_model, sensor_outputs
from .gauss_newton import Trace, search
from .physical_bounds import HIGHEST, LOWEST

_RANK_TOLERANCE = 1e-9  # of a singular value over the largest: a smaller one is no information


class WeightedFit(eqx.Module):
    """The result of the compiled estimate.

    Args:
        parameters: `y = (ln(alpha/start), beta)`.
        trace: of the iteration, with the diffusivity (m2/s) as the first parameter.
        predicted: predicted readings, degC, offsets included, `(time, sensor)`.
        jacobian: of the weighted residuals, then of the prior residuals, `(row, param)`.
        evaluations: the number of evaluations of the residual.
        converged: whether Gauss-Newton has converged.
    """

    parameters: Float[Array, " param"]
    trace: Trace
    predicted: Array
    jacobian: Array
    evaluations: Array
    converged: Array


class WeightedProblem(eqx.Module):
    """The residuals that Gauss-Newton minimises over `y = (ln(alpha/start), beta)`.

    Args:
        system: the model; its outputs are the sensors.
        data: of the window.
        fourier_per_alpha: the Fourier number for 1 m2/s.
        start: alpha_0, m2/s.
        explicit_theta: whether the sensitivity comes from the explicit theta system, not from autodiff.
        integrator: how the rows are stepped through.
        lowest, highest: bounds of the diffusivity, m2/s.
    """

    system: StateSpace
    data: WindowData
    fourier_per_alpha: Float[Array, ""]
    start: Float[Array, ""]
    explicit_theta: bool = eqx.field(static=True)
    integrator: Integrator = eqx.field(static=True)
    lowest: ClassVar[float] = LOWEST
    highest: ClassVar[float] = HIGHEST

    def predicted(self, y: Float[Array, " param"]) -> Float[Array, "time sensor"]:
        """The predicted readings, degC, offsets included."""
        fourier = self.fourier_per_alpha * self.start * jnp.exp(y[0])
        initial, offset = self.data.initial, jnp.zeros_like(self.data.offset_std)
        if self.data.offsets:
            indices = np.asarray(self.data.offsets)
            offset = offset.at[indices].set(self.data.offset_std[indices] * y[1:])
            # the profile was fitted through readings with these offsets
            initial = initial - self.data.profile_per_offset @ offset
        if self.explicit_theta:
            u = field_with_theta(fourier, initial, self.system, self.data, self.integrator)
        else:
            u = simulate_window(self.system, fourier, self.data.starting_from(initial), integrator=self.integrator)[0]
        return self.data.celsius(u) + offset

    def residual(
        self, y: Float[Array, " param"]
    ) -> tuple[tuple[Float[Array, "time sensor"], Float[Array, " offset"]], Float[Array, "time sensor"]]:
        """The weighted residuals of the readings and the prior residuals of the offsets; and the predicted readings."""
        predicted = self.predicted(y)
        return (self.data.weight * (predicted - self.data.observed), y[1:]), predicted


def solve_weighted_problem(problem: WeightedProblem, eta: Float[Array, ""], max_iterations: int) -> optx.Solution:
    """The Gauss-Newton iteration from `start`, for use inside a compiled function."""
    return search(problem, jnp.zeros(1 + len(problem.data.offsets)), eta, max_iterations)


def stack_jacobian(of_readings: Float[Array, "*readings param"], of_priors: Array) -> Float[Array, "row param"]:
    """The Jacobian with one row for each reading, then one for each offset's prior."""
    return jnp.concatenate([of_readings.reshape(-1, of_readings.shape[-1]), of_priors])


# jax.jit, because the overhead of eqx.filter_jit is not small compared with an estimate of a millisecond
@partial(jax.jit, static_argnames=("explicit_theta", "integrator", "max_iterations"))
def fit_weighted_least_squares(
    system: StateSpace,
    data: WindowData,
    fourier_per_alpha: Float[Array, ""],
    start: Float[Array, ""],
    eta: Float[Array, ""],
    *,
    explicit_theta: bool = True,
    integrator: Integrator = "propagator",
    max_iterations: int = 100,
) -> WeightedFit:
    """The paper's estimate, with one compilation for all windows of a length.

    Args:
        system, data, fourier_per_alpha, start, explicit_theta, integrator: as in `WeightedProblem`.
        eta: the stopping criterion on the diffusivity; its square is the one on the cost.
        max_iterations: after more evaluations the iteration ends as not converged.
    """
    problem = WeightedProblem(system, data, fourier_per_alpha, start, explicit_theta, integrator)
    solution = solve_weighted_problem(problem, eta, max_iterations)
    stats = solution.stats
    predicted, (of_readings, of_priors) = solution.aux, stats["jacobian"]
    trace = stats["trace"]
    trace = eqx.tree_at(
        lambda t: t.parameters, trace, trace.parameters.at[:, 0].set(start * jnp.exp(trace.parameters[:, 0]))
    )
    return WeightedFit(
        parameters=solution.value,
        trace=trace,
        predicted=predicted,
        jacobian=stack_jacobian(of_readings, of_priors),
        evaluations=stats["num_steps"],
        converged=solution.result == optx.RESULTS.successful,
    )


@eqx.filter_jit
def model_difference(
    full_order: StateSpace, reduced_order: StateSpace, data: WindowData, fourier: Float[Array, ""]
) -> Float[Array, "time sensor"]:
    """The full-order model's predictions minus the reduced-order model's, K.

    Args:
        fourier: the Fourier number.
    """
    return data.temperature * (
        simulate_window(full_order, fourier, data)[0] - simulate_window(reduced_order, fourier, data)[0]
    )


def covariance(jacobian: np.ndarray, row_std: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Singular values of J, and the covariance `J^+ diag(row_std^2) J^+T`, `(J^T J)^-1` where all `row_std` are 1.

    Args:
        jacobian: J, `(row, param)`.
        row_std: standard deviation of the noise of each row, in units of the row.

    Returns:
        the singular values, and the covariance: infinite where J has not full rank or is not finite.
    """
    parameters = jacobian.shape[1]
    if not np.all(np.isfinite(jacobian)):
        return np.full(parameters, np.nan), np.full((parameters, parameters), np.inf)
    U, singular, V = np.linalg.svd(jacobian, full_matrices=False)
    if singular[-1] <= _RANK_TOLERANCE * max(singular[0], 1.0):
        return singular, np.full((parameters, parameters), np.inf)
    root = (V.T / singular) @ U.T * row_std
    return singular, root @ root.T


def paper_sigma(
    noise_std: np.ndarray, gradient: np.ndarray, position_std: np.ndarray
) -> Float[np.ndarray, "time sensor"]:
    """The paper's combined uncertainty, `sqrt(sigma_m^2 + (dT/dx delta_x)^2)`, K.

    A position error is constant in time and no noise, so this is for the paper's figure only, and not a weight.

    Args:
        noise_std: sigma_m per sensor, K.
        gradient: dT/dx at the sensors, K/m, `(time, sensor)`.
        position_std: delta_x per sensor, m.
    """
    return np.sqrt(noise_std**2 + (gradient * position_std) ** 2)


def paper_sigma_of_readings(case: Case, data: WindowData, diffusivity: float) -> Float[np.ndarray, "time sensor"]:
    """`paper_sigma` of each reading of a window at a diffusivity (m2/s), by the full-order model, K."""
    gradients = sensor_outputs(case, "gradient")
    sensors = len(gradients)
    model = full_order_model(case, gradients).select(list(range(sensors, 2 * sensors)))
    gradient = np.asarray(simulate_window(model, scales(case).fourier_number(diffusivity), data)[0])
    return paper_sigma(
        np.array([sensor.noise_std for sensor in case.sensors]),
        gradient * float(data.temperature) / case.wall.length,
        np.array([sensor.position_std for sensor in case.sensors]),
    )
