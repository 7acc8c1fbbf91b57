"""The paper's estimate: Gauss-Newton on the weighted misfit of each reading by itself.

Minimised over `y = (ln(alpha/alpha_0), beta)`:

    J(y) = sum over readings ((T_model(alpha) + offset_std beta - T_measured) / sigma)^2 + |beta|^2

with an offset `offset_std beta` for each sensor whose case states an `offset_std`.

Source: Berger and Kadoch, Section 4.2.
"""

from __future__ import annotations

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from ..case.case_definition import Case
from ..case.initial_profile import scales
from ..models.finite_volume_wall import Output
from ..models.integration import Integrator
from ..models.sensitivity_equations import field_with_theta, run
from ..models.state_space import StateSpace
from ..models.window_inputs import WindowData, full_order_model
from .gauss_newton import Trace, search
from .likelihood import HIGHEST, LOWEST

_NO_INFORMATION = 1e-9  # singular value over the largest: this direction is not in the record


class WeightedFit(eqx.Module):
    """What the compiled estimate gives back."""

    parameters: Float[Array, " param"]
    trace: Trace
    predicted: Array
    jacobian: Array
    evaluations: Array
    converged: Array


class WeightedProblem(eqx.Module):
    """What the Gauss-Newton iteration minimises over `y = (ln(alpha/start), beta)`."""

    system: StateSpace
    data: WindowData
    fourier_per_alpha: Float[Array, ""]
    start: Float[Array, ""]
    explicit_theta: bool = eqx.field(static=True)
    integrator: Integrator = eqx.field(static=True)

    def predicted(self, y: Float[Array, " param"]) -> Float[Array, "time sensor"]:
        """Temperatures in degC, offsets included."""
        fourier = self.fourier_per_alpha * self.start * jnp.exp(y[0])
        initial, offset = self.data.initial, jnp.zeros_like(self.data.offset_std)
        if self.data.offsets:
            places = np.asarray(self.data.offsets)
            offset = offset.at[places].set(self.data.offset_std[places] * y[1:])
            # the profile was fitted through readings that hold the offsets
            initial = initial - self.data.profile_per_offset @ offset
        if self.explicit_theta:
            u = field_with_theta(fourier, initial, self.system, self.data, self.integrator)
        else:
            u = run(self.system, fourier, self.data.starting_from(initial), integrator=self.integrator)[0]
        return self.data.celsius(u) + offset

    def residual(
        self, y: Float[Array, " param"]
    ) -> tuple[tuple[Float[Array, "time sensor"], Float[Array, " offset"]], Float[Array, "time sensor"]]:
        """The weighted misfit of every reading, and of every offset's prior; and the predicted temperatures."""
        predicted = self.predicted(y)
        return (self.data.weight * (predicted - self.data.observed), y[1:]), predicted


def searched(problem: WeightedProblem, eta: Float[Array, ""], max_iterations: int) -> optx.Solution:
    """The iteration from the start, traced where it is called; its arrays lie as the problem's rows do."""
    return search(
        lambda y, problem: problem.residual(y),
        jnp.zeros(1 + len(problem.data.offsets)),
        problem,
        eta=eta,
        lower=jnp.log(LOWEST / problem.start),
        upper=jnp.log(HIGHEST / problem.start),
        max_iterations=max_iterations,
    )


def stacked(of_readings: Float[Array, "*readings param"], of_priors: Array) -> Float[Array, "row param"]:
    """A Jacobian of a row a reading, then one an offset's prior."""
    return jnp.concatenate([of_readings.reshape(-1, of_readings.shape[-1]), of_priors])


# where an estimate takes a millisecond, filter_jit's own time counts
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
    """The compiled estimate: one compilation for all windows of a length, all starts, all values.

    Args:
        fourier_per_alpha: Fo for a diffusivity of 1 m2/s.
        start: m2/s.
        eta: the stopping criterion on the diffusivity; its square is that on the cost.
    """
    problem = WeightedProblem(system, data, fourier_per_alpha, start, explicit_theta, integrator)
    solution = searched(problem, eta, max_iterations)
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
        jacobian=stacked(of_readings, of_priors),
        evaluations=stats["num_steps"],
        converged=solution.result == optx.RESULTS.successful,
    )


@eqx.filter_jit
def model_difference(
    large: StateSpace, system: StateSpace, data: WindowData, fourier: Float[Array, ""]
) -> Float[Array, "time sensor"]:
    """The large model's predictions less a reduced one's, K."""
    return data.temperature * (run(large, fourier, data)[0] - run(system, fourier, data)[0])


def covariance(jacobian: np.ndarray, row_std: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Singular values of J, and `J^+ diag(row_std^2) J^+T` (infinite where a direction is missing).

    With each row weighted by its own noise that is `(J^T J)^-1`.
    """
    parameters = jacobian.shape[1]
    if not np.all(np.isfinite(jacobian)):
        return np.full(parameters, np.nan), np.full((parameters, parameters), np.inf)
    U, singular, V = np.linalg.svd(jacobian, full_matrices=False)
    if singular[-1] <= _NO_INFORMATION * max(singular[0], 1.0):
        return singular, np.full((parameters, parameters), np.inf)
    spread = (V.T / singular) @ U.T * row_std
    return singular, spread @ spread.T


def paper_sigma(
    noise_std: np.ndarray, gradient: np.ndarray, position_std: np.ndarray
) -> Float[np.ndarray, "time sensor"]:
    """The paper's combined uncertainty, `sqrt(sigma_m^2 + (dT/dx delta_x)^2)`, K.

    A position error is the same all the time: this is for the paper's figure, and no weight.

    Args:
        noise_std: sigma_m per sensor, K.
        gradient: dT/dx at the sensors, K/m, `(time, sensor)`.
        position_std: delta_x per sensor, m.
    """
    return np.sqrt(noise_std**2 + (gradient * position_std) ** 2)


def simple_sigma(case: Case, data: WindowData, diffusivity: float) -> Float[np.ndarray, "time sensor"]:
    """`paper_sigma` of each reading of a window at a diffusivity (m2/s), by the large model, K."""
    gradients = [Output(sensor.position, "gradient") for sensor in case.sensors]
    sensors = len(gradients)
    large = full_order_model(case, gradients).select(list(range(sensors, 2 * sensors)))
    slope = np.asarray(run(large, scales(case).fourier_number(diffusivity), data)[0])
    return paper_sigma(
        np.array([sensor.noise_std for sensor in case.sensors]),
        slope * float(data.temperature) / case.wall.length,
        np.array([sensor.position_std for sensor in case.sensors]),
    )
