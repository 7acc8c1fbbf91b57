"""The likelihood of the readings under their full covariance: its minimum, its profile, and new draws from it.

    -2 log L(y) = |W (m - M(y))|^2 + |z - z_0|^2,      y = (ln(alpha/alpha_0), z),      W' W = R^-1

`m` are the readings (means over bins where they are many), `M` the model's predictions, `R` their covariance
(`noise_covariance`) and `z` the nuisance parameters, each divided by the standard deviation of its prior: offsets,
position errors, the wall's own parameters, the share of the faces' noise that all sensors of one logger have in common,
and the amplitudes of the initial profile along the wall's slowest modes. All of them are named (`parameters`). `z_0` is
0, but for the calibrations of two plates beside a disturbance (`gains_by_heat`).
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from .._internal.arrays import on_device
from ..models.integration import Integrator, run_rows
from ..models.sensitivity_equations import field_with_theta, simulate_window
from ..models.state_space import StateSpace
from ..models.window_inputs import WindowData
from .gauss_newton import Trace, search
from .noise_covariance import BinnedReadings
from .parameters import Parameters, kind_of

LOG_DIFFUSIVITY, LOG_CONDUCTIVITY = "log_diffusivity", "log_conductivity"
PROFILE_MODE, PLATE_GAIN = "profile_mode", "plate_gain"
"""The parameters and kinds that are part of the model itself; all others act linearly (`NuisanceModel.columns`)."""

_PRODUCT_STEPS = 6  # of Gauss-Newton at a fixed diffusivity
_POINTS_TOGETHER = 11  # of a profile: a third of the 33 of an interval, whitened by one product
_BOOTSTRAP_STEPS = 12  # of Gauss-Newton, from the estimate that drew the readings
_BOOTSTRAP_ETA = 1e-6  # relative, of a draw's diffusivity: far under any standard error


class NuisanceModel(eqx.Module):
    """The effect of the nuisance parameters on the readings, linear about one diffusivity `alpha_k`.

    Args:
        columns: change of the readings for one prior standard deviation of each linear parameter, K.
        linearised_at: the linear parameters at which the change below was computed, in prior standard deviations.
        change, change_slope: change of the readings at that point, K, and its derivative with respect to ln(alpha).
        log_alpha: ln(alpha_k / start).
        rates, shapes: of the wall's slowest modes: `f_k` in `x_k' = Fo f_k x_k`, and the mode shape at the sensors, 1.
        flux: W/m2 for each unit of the model's flux output, at the reference conductivity; empty without plates.
        gains: calibration error of each plate at that point.
        heat_by_gain: change of the plates' readings by a disturbance for a gain of 1 of each, W/m2 (`gains_by_heat`).
    """

    columns: Float[Array, "param time sensor"] = eqx.field(converter=on_device)
    linearised_at: Float[Array, " param"] = eqx.field(converter=on_device)
    change: Float[Array, "time sensor"] = eqx.field(converter=on_device)
    change_slope: Float[Array, "time sensor"] = eqx.field(converter=on_device)
    log_alpha: Float[Array, ""] = eqx.field(converter=on_device)
    rates: Float[Array, " mode"] = eqx.field(converter=on_device)
    shapes: Float[Array, "sensor mode"] = eqx.field(converter=on_device)
    flux: Float[Array, " flux"] = eqx.field(converter=on_device)
    gains: Float[Array, " flux"] = eqx.field(converter=on_device)
    heat_by_gain: Float[Array, "flux time flux"] = eqx.field(converter=on_device)

    @property
    def fluxes(self) -> int:
        """The number of fluxes among the readings; they come after the sensors."""
        return self.flux.shape[0]


class LikelihoodProblem(eqx.Module):
    """The cost to be minimised over `y = (ln(alpha/start), z)`.

    Args:
        parameters: names, priors, and the mask of those estimated. `y` is in their order, `z` in prior standard
            deviations. A parameter that is known exactly has no effect on the readings, so its `z` stays 0.
        observed: the readings' means over bins, degC, 0 in an empty bin.
        whitening: W.
        fourier_per_alpha: the Fourier number for 1 m2/s.
        start: alpha_0, m2/s.
        lowest, highest: bounds of the diffusivity, m2/s.
        prior_mean: of `z`; the first entry is without meaning.
    """

    system: StateSpace
    data: WindowData
    parameters: Parameters
    nuisance: NuisanceModel
    bins: BinnedReadings
    observed: Float[Array, " reading"]
    whitening: Float[Array, "reading reading"]
    fourier_per_alpha: Float[Array, ""]
    start: Float[Array, ""]
    lowest: Float[Array, ""]
    highest: Float[Array, ""]
    prior_mean: Float[Array, " param"]
    explicit_theta: bool = eqx.field(static=True, default=True)
    integrator: Integrator = eqx.field(static=True, default="propagator")

    def to_vector(self, parameters: Parameters) -> np.ndarray:
        """The vector `y` of named parameters: values over their prior standard deviations."""
        std = np.asarray(parameters.prior_std)
        return np.asarray(parameters.values) / np.where(np.isfinite(std) & (std > 0), std, 1.0)

    def to_parameters(self, y: Float[Array, " param"]) -> Parameters:
        """The named parameters at a vector `y`."""
        std = np.asarray(self.parameters.prior_std)
        return self.parameters.with_values(on_device(np.asarray(y) * np.where(np.isfinite(std), std, 1.0)))

    def fourier(self, y: Float[Array, " param"]) -> Array:
        """The Fourier number."""
        return self.fourier_per_alpha * self.start * jnp.exp(y[self.parameters.index(LOG_DIFFUSIVITY)])

    def values_of(self, y: Float[Array, " param"], *kinds: str) -> Float[Array, " chosen"]:
        """The values of the parameters of some kinds, in their own units."""
        at = self.parameters.indices(self.parameters.of_kind(*kinds))
        return self.parameters.prior_std[at] * y[at]

    def predicted(self, y: Float[Array, " param"]) -> Float[Array, "time sensor"]:
        """The predicted readings at the rows, degC, and W/m2 of plates."""
        fourier, nuisance, data = self.fourier(y), self.nuisance, self.data
        if self.explicit_theta:
            u = field_with_theta(fourier, data.initial, self.system, data, self.integrator)
        else:
            u = simulate_window(self.system, fourier, data, integrator=self.integrator)[0]
        nonlinear = (LOG_DIFFUSIVITY, LOG_CONDUCTIVITY, PROFILE_MODE, PLATE_GAIN)
        linear = self.parameters.indices(name for name in self.parameters.names if kind_of(name) not in nonlinear)
        modes = jnp.exp(fourier * jnp.outer(data.time, nuisance.rates)) * self.values_of(y, PROFILE_MODE)
        log_alpha = y[self.parameters.index(LOG_DIFFUSIVITY)]
        change = nuisance.change + nuisance.change_slope * (log_alpha - nuisance.log_alpha)
        change = change + jnp.tensordot(y[linear] - nuisance.linearised_at, nuisance.columns, 1)
        profile = modes @ nuisance.shapes.T
        if not nuisance.fluxes:
            return data.celsius(u) + change + profile
        sensors = u.shape[1] - nuisance.fluxes
        temperatures = data.celsius(u[:, :sensors]) + change[:, :sensors] + profile[:, :sensors]
        fluxes = self.flux_scale(y) * (u + (profile + change) / data.temperature)[:, sensors:]
        fluxes = fluxes + jnp.tensordot(self.values_of(y, PLATE_GAIN) - nuisance.gains, nuisance.heat_by_gain, 1)
        return jnp.concatenate([temperatures, fluxes], axis=1)

    def flux_scale(self, y: Float[Array, " param"]) -> Float[Array, " flux"]:
        """Each plate's reading for one unit of the model's flux output, W/m2."""
        return self.nuisance.flux * (
            jnp.exp(self.values_of(y, LOG_CONDUCTIVITY)) * (1.0 + self.values_of(y, PLATE_GAIN))
        )

    def binned(self, y: Float[Array, " param"]) -> tuple[Float[Array, " reading"], Float[Array, "time sensor"]]:
        """The predicted readings' means over bins, degC, 0 in an empty bin; and the predictions at the rows."""
        predicted = self.predicted(y)
        return self.bins.mean(predicted), predicted

    def residual(self, y: Float[Array, " param"]) -> tuple[Float[Array, " row"], None]:
        """The whitened residual, then the prior residuals; and no further values."""
        return jnp.concatenate([self.whitening @ (self.binned(y)[0] - self.observed), (y - self.prior_mean)[1:]]), None


class Minimum(eqx.Module):
    """The minimum of the cost.

    Args:
        vector: `y`.
        trace: of the iteration.
        predicted: predicted readings at the rows, degC (W/m2 of plates).
        residual: of the binned readings, measured minus predicted, K.
        jacobian: of the binned readings, K, before whitening and without the priors' rows.
        cost: -2 log L.
        converged: whether Gauss-Newton has converged.
    """

    vector: Float[Array, " param"]
    trace: Trace
    predicted: Float[Array, "time sensor"]
    residual: Float[Array, " reading"]
    jacobian: Float[Array, "reading param"]
    cost: Float[Array, ""]
    converged: Array


@eqx.filter_jit
def minimise(
    problem: LikelihoodProblem, first: Float[Array, " param"], eta: Float[Array, ""], max_iterations: int
) -> Minimum:
    """The minimum of the cost, by Gauss-Newton.

    One compilation serves all windows of a shape and all choices of estimated parameters.

    Args:
        first: the vector `y` to start from.
        eta: stopping criterion on the relative change of the diffusivity.
        max_iterations: after more evaluations the iteration ends as not converged.
    """
    solution = search(problem, first, eta, max_iterations)
    jacobian, predicted = jax.jacfwd(problem.binned, has_aux=True)(solution.value)
    return Minimum(
        vector=solution.value,
        trace=solution.stats["trace"],
        predicted=predicted,
        residual=problem.observed - problem.bins.mean(predicted),
        jacobian=jacobian,
        cost=jnp.sum(solution.stats["residual"] ** 2),
        converged=solution.result == optx.RESULTS.successful,
    )


@eqx.filter_jit
def predicted_jacobian(problem: LikelihoodProblem, y: Float[Array, " param"]) -> Float[Array, "time sensor param"]:
    """The derivative of the predicted readings at the rows, K or W/m2."""
    return jax.jacfwd(problem.predicted)(y)


@eqx.filter_jit
def profile_likelihood(problem: LikelihoodProblem, log_alpha: Float[Array, " point"]) -> Float[Array, " point"]:
    """The profile of `-2 log L` over ln(alpha/start), nuisance parameters integrated out, without `log det R`.

    At a fixed diffusivity the predictions are linear in `z`, whose prior is normal, so the integral is exact:
    `min_z (|W (m - M)|^2 + |z|^2) + log det (1 + J_z' W' W J_z)`. The last term penalises small diffusivities, at which
    the initial profile persists and could explain any readings.

    Args:
        log_alpha: ln(alpha/start) of the points.
    """

    def linearise(log: Array, z: Array) -> tuple[Array, Array]:
        def residual(z: Array) -> tuple[Array, Array]:
            value, _ = problem.residual(jnp.concatenate([log[None], z]))
            return value, value

        return jax.jacfwd(residual, has_aux=True)(z)

    # the product of conductivity and gains is not linear: Gauss-Newton steps come first
    steps = _PRODUCT_STEPS + 1 if problem.nuisance.fluxes else 1

    def cost(log: Array) -> Array:
        def at_next(_: Array, point: tuple[Array, Array]) -> tuple[Array, Array]:
            z, _ = point
            J, residual = linearise(log, z)  # with the rows of the priors
            root = jnp.linalg.cholesky(J.T @ J)
            explained = jax.scipy.linalg.solve_triangular(root, J.T @ residual, lower=True)
            step = jax.scipy.linalg.solve_triangular(root, explained, lower=True, trans=1)
            marginal = jnp.sum(residual**2) - jnp.sum(explained**2) + 2.0 * jnp.sum(jnp.log(jnp.diag(root)))
            return z - step / jnp.maximum(1.0, jnp.max(jnp.abs(step))), marginal

        first = jnp.zeros(len(problem.parameters) - 1), jnp.zeros(())
        return jax.lax.fori_loop(0, steps, at_next, first)[1]  # a loop, because each copy is compiled

    return jax.lax.map(cost, log_alpha, batch_size=_POINTS_TOGETHER)


@eqx.filter_jit
def bootstrap_estimates(
    problem: LikelihoodProblem,
    vector: Float[Array, " param"],
    covariance_root: Float[Array, "reading reading"],
    draws: int,
    drawn_from_prior: Array,
    key: Array,
) -> Float[Array, " draw"]:
    """ln(alpha/start) estimated from readings drawn from the fitted model.

    Each draw has noise of the covariance, and instrument errors drawn from their priors. All other parameters are those
    of the fit. A drawn disturbance has nothing to do with the fitted one, so the priors have the mean 0.

    Args:
        vector: `y` of the fit.
        covariance_root: lower Cholesky factor of the covariance of the binned readings, K.
        draws: the number of draws.
        drawn_from_prior: mask of the parameters that are drawn from their priors.
        key: of the random numbers.
    """

    def estimate(key: Array) -> Array:
        noise_key, error_key = jax.random.split(key)
        truth = jnp.where(drawn_from_prior, jax.random.normal(error_key, vector.shape), vector)
        observed = problem.binned(truth)[0] + covariance_root @ jax.random.normal(noise_key, problem.observed.shape)
        present = problem.bins.counts().T.reshape(-1) > 0
        new = jnp.where(present, observed, 0.0), jnp.zeros_like(vector)
        drawn = eqx.tree_at(lambda p: (p.observed, p.prior_mean), problem, new)
        return search(drawn, vector, jnp.asarray(_BOOTSTRAP_ETA), _BOOTSTRAP_STEPS).value[0]

    return jax.lax.map(estimate, jax.random.split(key, draws))


@eqx.filter_jit
def face_response(
    system: StateSpace, fourier: Float[Array, ""], step: Float[Array, ""], rows: int
) -> Float[Array, "face time output"]:
    """The outputs' response to 1 K more at one row of one face, with straight lines between rows.

    Args:
        fourier: the Fourier number.
        step: between rows, relative to the reference time.
        rows: the number of rows of the response, from the row of the pulse on.
    """
    # the pulse is at the second row, so that the line from the row before is included; the first row is cut off
    pulse = jnp.zeros((2, rows + 1, system.B.shape[1])).at[jnp.arange(2), 1, jnp.arange(2)].set(1.0)
    uniform = jnp.zeros(system.P.shape[1])
    return jax.vmap(lambda inputs: run_rows(system, fourier, step, inputs, uniform)[0])(pulse)[:, 1:]
