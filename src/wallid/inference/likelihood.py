"""The readings' likelihood under the full covariance: what is minimised, its minimum, its profile, its bootstrap.

    -2 log L(y) = |W (m - M(y))|^2 + |z|^2,      y = (ln(alpha/alpha_0), z),      W' W = R^-1

`m` are the readings, put together in bins where they are many, `M` the model's, `R` their covariance (`noise`) and `z`
all that is free beside the diffusivity, each in units of its prior's standard deviation: offsets, position errors,
the share of the faces' noise that all sensors of one logger have in common, and the amplitudes by which the initial
profile differs from its polynomial, along the wall's slowest modes.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float

from .._internal.arrays import on_device
from ..models.integration import Integrator, run_rows
from ..models.sensitivity_equations import field_with_theta, run
from ..models.state_space import StateSpace
from ..models.window_inputs import WindowData
from .gauss_newton import Trace, search
from .noise_covariance import Bins

LOWEST, HIGHEST = 1e-10, 1e-2
"""Bounds of any search, m2/s: past any solid. An estimate at one is none."""

_PRODUCT_STEPS = 6  # of Gauss-Newton at a fixed diffusivity
_BOOTSTRAP_STEPS = 12  # of Gauss-Newton, from the estimate that drew the readings
_BOOTSTRAP_ETA = 1e-6  # relative, of a draw's diffusivity: far under any standard error


class NuisanceModel(eqx.Module):
    """What is free beside the diffusivity, as it acts about one diffusivity `alpha_k`.

    Args:
        columns: what one prior standard deviation of each offset, position error, parameter of the wall itself and
            common noise adds, K.
        at: the columns' parameters about which positions and the wall itself are linear, prior standard deviations.
        moved: what the positions at `at` add, K, and `moved_slope`, its derivative by ln(alpha).
        log_alpha: ln(alpha_k / start).
        rates, shapes: of the wall's slowest modes: `x_k' = Fo f_k x_k`, and what 1 K of each is at the sensors.
        mode_std: the amplitudes' priors, K.
        flux: what a flux through 1 of the model's output is at the conductivity begun with, W/m2; none for sensors.
        log_std: the wide prior of ln(conductivity) about that. gain_std: of each plate's calibration, 1.
    """

    columns: Float[Array, "param time sensor"] = eqx.field(converter=on_device)
    at: Float[Array, " param"] = eqx.field(converter=on_device)
    moved: Float[Array, "time sensor"] = eqx.field(converter=on_device)
    moved_slope: Float[Array, "time sensor"] = eqx.field(converter=on_device)
    log_alpha: Float[Array, ""] = eqx.field(converter=on_device)
    rates: Float[Array, " mode"] = eqx.field(converter=on_device)
    shapes: Float[Array, "sensor mode"] = eqx.field(converter=on_device)
    mode_std: Float[Array, " mode"] = eqx.field(converter=on_device)
    flux: Float[Array, " flux"] = eqx.field(converter=on_device, default=())
    gain_std: Float[Array, " flux"] = eqx.field(converter=on_device, default=())
    log_std: float = eqx.field(static=True, default=3.0)

    @property
    def fluxes(self) -> int:
        """How many fluxes are among the readings; they come after the sensors."""
        return self.flux.shape[0]

    @property
    def count(self) -> int:
        """How many parameters these are: columns, modes, and with a flux ln(conductivity) and each plate's gain."""
        return self.columns.shape[0] + self.rates.shape[0] + (1 + self.fluxes if self.fluxes else 0)


class LikelihoodProblem(eqx.Module):
    """What is minimised over `y = (ln(alpha/start), z)`.

    Args:
        observed: the readings in their bins, degC, 0 in an empty one.
        whiten: W.
        lowest, highest: between which diffusivities is searched, m2/s.
    """

    system: StateSpace
    data: WindowData
    nuisance: NuisanceModel
    bins: Bins
    observed: Float[Array, " reading"]
    whiten: Float[Array, "reading reading"]
    fourier_per_alpha: Float[Array, ""]
    start: Float[Array, ""]
    lowest: Float[Array, ""]
    highest: Float[Array, ""]
    explicit_theta: bool = eqx.field(static=True, default=True)
    integrator: Integrator = eqx.field(static=True, default="propagator")

    def fourier(self, y: Float[Array, " param"]) -> Array:
        """Fo."""
        return self.fourier_per_alpha * self.start * jnp.exp(y[0])

    def predicted(self, y: Float[Array, " param"]) -> Float[Array, "time sensor"]:
        """The readings at the rows, degC."""
        fourier, free, data = self.fourier(y), self.nuisance, self.data
        if self.explicit_theta:
            u = field_with_theta(fourier, data.initial, self.system, data, self.integrator)
        else:
            u = run(self.system, fourier, data, integrator=self.integrator)[0]
        columns, modes = len(free.columns), len(free.rates)
        linear, amplitudes = y[1 : 1 + columns], y[1 + columns : 1 + columns + modes]
        decay = jnp.exp(fourier * jnp.outer(data.time, free.rates)) * (free.mode_std * amplitudes)
        moved = free.moved + free.moved_slope * (y[0] - free.log_alpha)
        added = moved + jnp.tensordot(linear - free.at, free.columns, 1)
        shaped = decay @ free.shapes.T
        if not free.fluxes:
            return data.celsius(u) + added + shaped
        sensors = u.shape[1] - free.fluxes
        inside = data.celsius(u[:, :sensors]) + added[:, :sensors] + shaped[:, :sensors]
        through = self.flux_scale(y) * (u + (shaped + added) / data.temperature)[:, sensors:]
        return jnp.concatenate([inside, through], axis=1)

    def flux_scale(self, y: Float[Array, " param"]) -> Float[Array, " flux"]:
        """What each plate reads of a flux of 1 of the model's output, W/m2."""
        thermal = y[y.shape[0] - 1 - self.nuisance.fluxes :]
        scale = jnp.exp(self.nuisance.log_std * thermal[0]) * (1.0 + self.nuisance.gain_std * thermal[1:])
        return self.nuisance.flux * scale

    def binned(self, y: Float[Array, " param"]) -> tuple[Float[Array, " reading"], Float[Array, "time sensor"]]:
        """The readings in their bins, degC, 0 in an empty one; and the readings at the rows."""
        predicted = self.predicted(y)
        return self.bins.mean(predicted), predicted

    def residual(self, y: Float[Array, " param"]) -> Float[Array, " row"]:
        """The whitened misfit, then the priors' rows."""
        return jnp.concatenate([self.whiten @ (self.binned(y)[0] - self.observed), y[1:]])


class Minimum(eqx.Module):
    """The minimum, and the problem there.

    Args:
        jacobian: of the binned readings, K, before whitening and without the priors' rows.
        cost: -2 log L.
    """

    parameters: Float[Array, " param"]
    trace: Trace
    predicted: Float[Array, "time sensor"]
    left: Float[Array, " reading"]
    jacobian: Float[Array, "reading param"]
    cost: Float[Array, ""]
    converged: Array


@eqx.filter_jit
def minimise(
    problem: LikelihoodProblem, first: Float[Array, " param"], eta: Float[Array, ""], max_iterations: int
) -> Minimum:
    """Gauss-Newton from `first`; one compilation for all windows of a shape."""
    solution = _search(problem, first, eta, max_iterations)
    jacobian, predicted = jax.jacfwd(problem.binned, has_aux=True)(solution.value)
    return Minimum(
        parameters=solution.value,
        trace=solution.stats["trace"],
        predicted=predicted,
        left=problem.observed - problem.bins.mean(predicted),
        jacobian=jacobian,
        cost=jnp.sum(solution.stats["residual"] ** 2),
        converged=solution.result == optx.RESULTS.successful,
    )


def _search(problem: LikelihoodProblem, first: Array, eta: Array, max_iterations: int) -> optx.Solution:
    return search(
        lambda y, problem: (problem.residual(y), None),
        first,
        problem,
        eta=eta,
        lower=jnp.log(problem.lowest / problem.start),
        upper=jnp.log(problem.highest / problem.start),
        max_iterations=max_iterations,
    )


@eqx.filter_jit
def profile_likelihood(problem: LikelihoodProblem, log_alpha: Float[Array, " point"]) -> Float[Array, " point"]:
    """`-2 log L` at each ln(alpha/start) with all else integrated out, up to what the noise alone sets.

    At a fixed diffusivity the rest, `z`, is linear with a normal prior, so that the integral is exact:
    `min_z (|W (m - M)|^2 + |z|^2) + log det (1 + J_z' W' W J_z)`. Its last term is what a small diffusivity owes for
    an initial profile that stays, and could then explain any course of the readings.
    """

    def linear(log: Array, z: Array) -> tuple[Array, Array]:
        def residual(z: Array) -> tuple[Array, Array]:
            at = problem.residual(jnp.concatenate([log[None], z]))
            return at, at

        rest, at = jax.jacfwd(residual, has_aux=True)(z)
        return at, rest

    def cost(log: Array) -> Array:
        z = jnp.zeros(problem.nuisance.count)
        # conductivity and gains are a product: a few steps to where it is linear enough
        for _ in range(_PRODUCT_STEPS if problem.nuisance.fluxes else 0):
            residual, rest = linear(log, z)
            step = jnp.linalg.lstsq(rest, residual)[0]
            z = z - step / jnp.maximum(1.0, jnp.max(jnp.abs(step)))
        residual, rest = linear(log, z)
        # the priors' rows are in `rest`
        root = jnp.linalg.cholesky(rest.T @ rest)
        pull = jax.scipy.linalg.solve_triangular(root, rest.T @ residual, lower=True)
        return jnp.sum(residual**2) - jnp.sum(pull**2) + 2.0 * jnp.sum(jnp.log(jnp.diag(root)))

    return jax.lax.map(cost, log_alpha)


@eqx.filter_jit
def resample(
    problem: LikelihoodProblem,
    parameters: Float[Array, " param"],
    covariance_root: Float[Array, "reading reading"],
    draws: int,
    constant: Array,
    key: Array,
) -> Float[Array, " draw"]:
    """ln(alpha/start) estimated again from readings that the fitted model makes.

    Each draw has noise of the covariance, and the parameters that are `constant` errors from their priors; the rest is
    that of the fit.
    """

    def one(key: Array) -> Array:
        noise, errors = jax.random.split(key)
        truth = jnp.where(constant, jax.random.normal(errors, parameters.shape), parameters)
        size = problem.observed.shape
        observed = problem.binned(truth)[0] + covariance_root @ jax.random.normal(noise, size)
        drawn = eqx.tree_at(lambda p: p.observed, problem, jnp.where(_present(problem), observed, 0.0))
        return _search(drawn, parameters, jnp.asarray(_BOOTSTRAP_ETA), _BOOTSTRAP_STEPS).value[0]

    return jax.lax.map(one, jax.random.split(key, draws))


def _present(problem: LikelihoodProblem) -> Array:
    return problem.bins.counts().T.reshape(-1) > 0


@eqx.filter_jit
def face_response(
    system: StateSpace, fourier: Float[Array, ""], step: Float[Array, ""], rows: int
) -> Float[Array, "face time output"]:
    """The outputs' answer to 1 more at one row of one face, which between rows is a straight line."""
    # at the second row, so that the line up to it is there; what comes before is cut
    pulse = jnp.zeros((2, rows + 1, system.B.shape[1])).at[jnp.arange(2), 1, jnp.arange(2)].set(1.0)
    still = jnp.zeros(system.P.shape[1])
    return jax.vmap(lambda inputs: run_rows(system, fourier, step, inputs, still)[0])(pulse)[:, 1:]
