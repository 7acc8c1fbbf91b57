"""Iterated generalised least squares: the covariance depends on the estimated parameters, so GLS is iterated."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._internal.arrays import on_device
from ..case.case_definition import Case
from ..case.initial_profile import scales
from ..case.time_window import Window
from ..case.wall_and_sensors import SIDES
from ..models.flux_plates import (
    face_noise_of_model,
    flux_noise_std,
    fluxes_of,
    full_order_model_with_plates,
    initial_conductivity,
    with_filtered_faces,
    with_flux,
)
from ..models.integration import Integrator
from ..models.state_space import StateSpace
from ..models.wall_parameters import clipped_to_prior
from ..models.window_inputs import WindowData
from .contact_test import SIGNIFICANT, contact_scores
from .disturbance_covariance import DisturbedReadings, disturbed_readings
from .disturbance_search import (
    EVIDENCE,
    Disturbance,
    RestrictedLikelihood,
    WeightedPlace,
    find_disturbance,
    search_bins,
)
from .gains_by_heat import gains_by_heat
from .gls_fit import GLSFit
from .likelihood import LOG_CONDUCTIVITY, LOG_DIFFUSIVITY, PLATE_GAIN, LikelihoodProblem, minimise
from .noise_covariance import BinnedReadings, NoiseCovariance, NoiseShape, bin_readings
from .noise_memory import memory_of_noise
from .noise_of_record import noise_shape_of_record, response_to_faces
from .nuisance_kinds import (
    NUISANCE_KINDS,
    ContactResistances,
    Linearisation,
    NuisanceKind,
    WallParameters,
    contact_lengths,
)
from .nuisance_parameters import linearise_nuisance, window_parameters
from .parameters import Parameters
from .validity import distinguishable_range
from .whittle_likelihood import MIN_READINGS, estimate_noise

_MAX_ITERATIONS = 4
_MAX_WALL_ITERATIONS = 15  # with estimated wall parameters: each iteration builds the model again
_MAX_DISTURBED_ITERATIONS = 7  # where a disturbance is searched for
_SEARCHES = 2  # for a disturbance, at least: the first is in the residual of a fit that may be far off
_MOVED = 0.3  # standard errors: after a larger change a disturbance is searched for again
_FAR = 1.0  # standard errors: after a larger change it is searched for everywhere
_CONVERGED = 0.1  # standard errors: the iteration ends when the estimate changes by less
_LARGER_NOISE = 4.0  # of the variance, over the stated one: the search starts again from other diffusivities
_OTHER_STARTS = (1.0, 1.0 / 3.0, 3.0)  # over the first diffusivity


def fit_generalised_least_squares(
    case: Case,
    window: Window,
    data: WindowData,
    system: StateSpace,
    first: float,
    *,
    eta: float,
    explicit_theta: bool = True,
    integrator: Integrator = "propagator",
    rows_used: int | None = None,
    other_rows_binned: bool = True,
    kinds: Sequence[NuisanceKind] = NUISANCE_KINDS,
    with_contacts: bool = False,
    heat_among: Sequence[WeightedPlace] | None = None,
) -> GLSFit:
    """The estimate under the full covariance, by iterated generalised least squares.

    Args:
        data: of the window.
        system: the model; its outputs are the sensors, then the plates.
        first: the diffusivity to start from, m2/s.
        eta: stopping criterion of Gauss-Newton on the relative change of the diffusivity.
        explicit_theta: whether the sensitivity comes from the explicit theta system, not from autodiff.
        integrator: how the rows are stepped through.
        rows_used: the number of rows whose readings are used, from the window's start; None for all.
        other_rows_binned: whether the bins of the readings go on over the other rows, as those of the entire window do:
            one compilation serves both. If not, the fit is the same for any number of other rows.
        kinds: of nuisance parameters.
        with_contacts: whether contact resistances at plates are estimated also where the record shows none.
        heat_among: the places and time constants at which a disturbance is searched for; empty for no disturbance,
            None for all places.

    Returns:
        the fit of the last iteration.
    """
    data = _first_rows(with_filtered_faces(case, window, with_flux(case, window, data)), rows_used)

    def fit_with(kinds: Sequence[NuisanceKind], first: float) -> GLSFit:
        binned = None if other_rows_binned else rows_used
        return _IteratedGLS(
            case, window, data, kinds, eta, explicit_theta, integrator, binned, heat_among
        ).fit(system, first)  # fmt: skip

    simpler = [kind for kind in kinds if kind.kind != ContactResistances.kind]
    if case.section is not None:  # its model has no resistance between a face and its sensor
        return fit_with(simpler, first)
    if with_contacts or not fluxes_of(case) or len(simpler) == len(kinds):
        return fit_with(kinds, first)
    fit = fit_with(simpler, first)
    if not fit.finite or max(contact_scores(case, fit).values()) < SIGNIFICANT:
        return fit
    contacts = fit_with(kinds, fit.diffusivity)
    if fit.disturbance is None and contacts.disturbance is None:
        return contacts if math.isfinite(contacts.marginal_deviance) else fit
    # the score does not know that another disturbance may explain as much as the resistances
    asked = 0.0 if fit.disturbance is None else EVIDENCE
    return contacts if _deviance_with_evidence(contacts) < _deviance_with_evidence(fit) - asked else fit


def _first_rows(data: WindowData, rows: int | None) -> WindowData:
    """The window's data without the readings after its first rows."""
    if rows is None:
        return data
    used = jnp.asarray(np.arange(data.observed.shape[0]) < rows, dtype=float)[:, None]
    return eqx.tree_at(lambda d: (d.weight, d.observed), data, (data.weight * used, data.observed * used))


class _IteratedGLS:
    """Iterated GLS on one window: the data and settings that all iterations share.

    Attributes:
        parameters: the diffusivity and the nuisance parameters, at their priors.
        bins, spacing: of the readings (`bin_readings`).
        readings: the number of means over bins that contain a reading.
        conductivity: W/m/K, the reference value; 0 without a flux.
        bounds: of the diffusivity, m2/s.
        record: the window's rows.
    """

    def __init__(
        self,
        case: Case,
        window: Window,
        data: WindowData,
        kinds: Sequence[NuisanceKind],
        eta: float,
        explicit_theta: bool,
        integrator: Integrator,
        binned_rows: int | None,
        heat_among: Sequence[WeightedPlace] | None,
    ):
        self.case, self.window, self.kinds = case, window, kinds
        self.eta, self.explicit_theta = eta, explicit_theta
        self.integrator: Integrator = integrator
        self.heat_among = heat_among
        self.data = replace(data, offsets=())  # `offsets` is static and unused here: without it, fewer compilations
        self.parameters = window_parameters(case, window, kinds)
        present, observed = (np.asarray(part)[:binned_rows] for part in (data.weight > 0, data.observed))
        self.bins, self.spacing = bin_readings(present, observed, plates=bool(fluxes_of(case)))
        self.readings = self.bins.nonempty
        self.conductivity = initial_conductivity(case, window) if LOG_CONDUCTIVITY in self.parameters else 0.0
        self.bounds = distinguishable_range(case, window)
        self.record = case.record.window(window.row, window.rows)

    def fit(self, system: StateSpace, first: float) -> GLSFit:
        """The best fit from a first diffusivity in m2/s.

        A large disturbance can draw the minimum under the noise alone so far away that a search in its residual finds
        another disturbance, or none. Where one is searched for, and the noise is found to be much larger than stated,
        the first search is made in the residual at each of some first diffusivities too.
        """
        fit = self.iterated(system, first)
        if not self.disturbance_is_searched or fit.noise.white + fit.noise.autocorrelated < _LARGER_NOISE:
            return fit
        others = [self.iterated(system, factor * first, minimised=False) for factor in _OTHER_STARTS]
        finite = [one for one in (fit, *others) if math.isfinite(one.marginal_deviance)]
        best = min(finite, key=_deviance_with_evidence, default=fit)
        return replace(best, reduced_chi_square=fit.reduced_chi_square)

    def iterated(self, system: StateSpace, first: float, minimised: bool = True) -> GLSFit:
        """The fit of the last iteration, from a first diffusivity in m2/s.

        Args:
            minimised: whether the first iteration goes to the minimum under the stated noise; else it only evaluates
                the residual at the first diffusivity.
        """
        wall_names = self.parameters.of_kind(WallParameters.kind)
        bent = self.parameters.of_kind(WallParameters.kind, ContactResistances.kind)  # far from linear
        full_order = full_order_model_with_plates(self.case)
        start = float(np.clip(first, *self.bounds)) / self.case.wall.diffusivity_prior
        parameters, fit = self.parameters.with_values({LOG_DIFFUSIVITY: math.log(start)}), None
        while True:
            point = Linearisation(self.case, self.window, self.data, self.diffusivity(parameters), parameters)
            if wall_names:
                system = full_order = full_order_model_with_plates(self.case, point.wall)
            steps = 0 if fit is None and not minimised else self.case.choices.max_iterations
            last, fit = fit, self.iterate(system, full_order, point, fit, steps)
            if self.is_last(fit, last, parameters, bent):
                break
            if fit.iterations == 1 and minimised:  # of another residual the memory of the noise is not known
                self.filter_faces_as_found(fit)
            parameters = fit.parameters
            if bent:  # the model is linear about the last values: a step is one prior standard deviation at most
                indices, before = parameters.indices(bent), point.in_prior_std(bent)
                std = np.asarray(parameters.prior_std)[indices]
                z = np.clip(np.asarray(parameters.values)[indices] / std, before - 1.0, before + 1.0)
                parameters = parameters.with_values(dict(zip(bent, std * clipped_to_prior(z), strict=True)))
        if wall_names:  # the reduced chi-square of the first iteration was that of the prior wall
            whitened = fit.noise_shape.stated_covariance().whitening @ np.asarray(fit.minimum.residual)
            z = np.asarray(fit.minimum.vector)[1:]
            fit = replace(fit, reduced_chi_square=float(whitened @ whitened + z @ z) / self.degrees_of_freedom)
        if self.noise_option == "robust" and self.noise_can_be_estimated and math.isfinite(fit.diffusivity):
            return replace(fit, robust=_noise_of_residual(fit.noise_shape, fit))
        return fit

    def is_last(self, fit: GLSFit, last: GLSFit | None, before: Parameters, names: Sequence[str]) -> bool:
        """Whether the iteration ends with a fit: it stays, or the iterations are as many as there may be.

        Args:
            last: the fit before it; None in the first iteration.
            before: the parameters before it.
            names: of those on which the readings depend in a way that is far from linear.
        """
        if not math.isfinite(fit.change):
            return True
        searches = 1 if fit.disturbance is None else _SEARCHES
        most = _MAX_DISTURBED_ITERATIONS if self.disturbance_is_searched else _MAX_ITERATIONS
        same_noise = last is not None and (last.disturbance is None) == (fit.disturbance is None)
        converged = same_noise and fit.change < _CONVERGED * fit.log_std and _converged(fit, before, names)
        return (converged and fit.iterations > searches) or fit.iterations >= (_MAX_WALL_ITERATIONS if names else most)

    def filter_faces_as_found(self, fit: GLSFit) -> None:
        """Filter the faces beside plates for noise with the memory that a fit shows."""
        if LOG_CONDUCTIVITY not in self.parameters or self.noise_option == "stated":
            return
        residual = np.asarray(self.data.observed - fit.minimum.predicted)[: len(self.bins.present)]
        memory = memory_of_noise(fit.noise_shape, residual, len(self.case.sensors), self.record.step)
        if memory != self.case.record.noise_memory:
            self.case = replace(self.case, record=self.case.record.with_noise_memory(memory))
            self.data = with_filtered_faces(self.case, self.window, self.data)

    def diffusivity(self, parameters: Parameters) -> float:
        """The diffusivity, m2/s."""
        return self.case.wall.diffusivity_prior * math.exp(float(parameters[LOG_DIFFUSIVITY]))

    def _contacts(self, point: Linearisation) -> tuple[float, float]:
        """The length of wall with each face's contact resistance, m."""
        names = point.parameters.of_kind(ContactResistances.kind)
        return contact_lengths(self.conductivity, names, np.asarray(point.parameters.vector(names)))

    @property
    def noise_option(self) -> str:
        """ "estimated", the default, "stated" or "robust"."""
        return self.case.choices.noise or "estimated"

    @property
    def disturbance_option(self) -> str:
        """ "none", "auto" (the default with a flux and noise that is estimated) or "on"."""
        by_default = LOG_CONDUCTIVITY in self.parameters and self.noise_option == "estimated"
        return self.case.choices.disturbance or ("auto" if by_default else "none")

    @property
    def noise_can_be_estimated(self) -> bool:
        """Whether there are enough readings to estimate the noise from."""
        return self.readings - len(self.parameters.estimated_names) >= MIN_READINGS

    @property
    def disturbance_is_searched(self) -> bool:
        """Whether a disturbance is asked for, may be anywhere, and there are enough readings to search for one."""
        anywhere = self.heat_among is None or len(self.heat_among) > 0
        return self.disturbance_option != "none" and anywhere and self.noise_can_be_estimated

    @property
    def noise_is_estimated(self) -> bool:
        """Whether the noise is estimated from the residual."""
        return self.noise_option == "estimated" and self.noise_can_be_estimated

    @property
    def degrees_of_freedom(self) -> int:
        """Degrees of freedom of the cost."""
        return max(self.readings - 1, 1)

    def iterate(
        self, system: StateSpace, full_order: StateSpace, point: Linearisation, last: GLSFit | None, steps: int
    ) -> GLSFit:
        """One iteration: the covariance and the linear effects at a point, then steps to the minimum of the cost."""
        case, parameters, start = self.case, point.parameters, self.case.wall.diffusivity_prior
        nuisance = linearise_nuisance(point, self.kinds, full_order, self.conductivity)
        conductivity = 0.0
        if LOG_CONDUCTIVITY in parameters:
            conductivity = self.conductivity * math.exp(float(parameters[LOG_CONDUCTIVITY]))
        shape = self._noise_shape(system, point, conductivity / case.wall.length, self.bins)
        noise, disturbance = self._noise(system, point, conductivity / case.wall.length, shape, last)
        problem = LikelihoodProblem(
            system=system,
            data=self.data,
            parameters=parameters,
            nuisance=nuisance,
            bins=self.bins,
            observed=self.bins.mean(self.bins.observed),
            whitening=on_device(noise.whitening),
            fourier_per_alpha=on_device(scales(case).fourier_number(1.0)),
            start=on_device(start),
            lowest=on_device(self.bounds[0]),
            highest=on_device(self.bounds[1]),
            prior_mean=jnp.zeros(len(parameters)),
            explicit_theta=self.explicit_theta,
            integrator=self.integrator,
        )
        if disturbance is not None and last is not None:
            problem = _with_heat_in_gains(problem, noise, shape, np.asarray(last.minimum.residual))
        first = on_device(problem.to_vector(parameters))
        minimum = minimise(problem, first, on_device(self.eta), steps)
        chi_square = float(minimum.cost) / self.degrees_of_freedom if last is None else last.reduced_chi_square
        iterations = 1 if last is None else last.iterations + 1
        return GLSFit(
            problem, minimum, shape, noise, self.kinds, chi_square,
            self.noise_is_estimated or disturbance is not None, iterations, disturbance=disturbance,
        )  # fmt: skip

    def _noise(
        self, system: StateSpace, point: Linearisation, conductance: float, shape: NoiseShape, last: GLSFit | None
    ) -> tuple[NoiseCovariance, Disturbance | None]:
        """The covariance of the readings at a point and the disturbance in it, by the residual of the last iteration.

        Args:
            conductance: k/L, W/m2/K. shape: of the noise's covariance. last: None in the first iteration.
        """
        if last is None:
            return shape.stated_covariance(), None

        @cache  # beside plates a disturbance does without it
        def alone() -> NoiseCovariance:
            return _noise_of_residual(shape, last) if self.noise_is_estimated else shape.stated_covariance()

        if self.disturbance_is_searched and last.depends_on_diffusivity:
            readings = self._disturbed_readings(point, conductance)
            found = self._disturbance(system, point, conductance, readings, last, alone)
            if found is not None:
                degrees = float(self.readings - len(self.parameters.estimated_names))
                return found.noise_beside(shape, readings, degrees), found
        return alone(), None

    def _disturbed_readings(self, point: Linearisation, conductance: float) -> DisturbedReadings:
        """How heat that the model does not know would change the readings, at a point."""
        return disturbed_readings(
            self.case, self.data, point.diffusivity,
            conductance=conductance, contacts=self._contacts(point), wall=point.wall, spacing=self.spacing,
            gains=point.gains,
        )  # fmt: skip

    def _disturbance(
        self,
        system: StateSpace,
        point: Linearisation,
        conductance: float,
        readings: DisturbedReadings,
        last: GLSFit,
        alone: Callable[[], NoiseCovariance],
    ) -> Disturbance | None:
        """The disturbance found in the residual of the last iteration, or that of the last iteration where that stayed.

        None where `"auto"` asks for more evidence.
        """
        among = self.heat_among or ()
        if last.disturbance is not None and last.iterations > _SEARCHES:
            if last.change < _MOVED * last.log_std:
                return last.disturbance
            if last.change < _FAR * last.log_std:
                among = last.disturbance.probable
        shape = self._noise_shape(system, point, conductance, search_bins(self.bins))
        likelihood = RestrictedLikelihood.of_coarser_bins(
            shape, last.noise_shape.bins, np.asarray(last.minimum.residual), last.readings_jacobian, last.deviation
        )
        # a plate's own noise has no memory of hours, unless the sensors show one
        without, memory = None if readings.in_flux else alone(), self.case.record.noise_memory
        enough = EVIDENCE if last.iterations < _SEARCHES else math.inf
        step = self.record.step * self.spacing
        found = find_disturbance(readings, shape, step, likelihood, without, memory, enough, among)
        return found if self.disturbance_option == "on" or found.evidence > EVIDENCE else None

    def _noise_shape(
        self, system: StateSpace, point: Linearisation, conductance: float, bins: BinnedReadings
    ) -> NoiseShape:
        """The covariance's shape at a point, with the faces' noise propagated by this model to the stated positions.

        Args:
            conductance: k/L, W/m2/K, by which the faces' noise enters the fluxes.
        """
        case, (rows, _) = self.case, point.shape
        response = response_to_faces(
            case, system, point.diffusivity, self.data.step, rows,
            conductance=conductance, contacts=self._contacts(point), wall=point.wall,
        )  # fmt: skip
        plates = response.shape[2] - len(case.sensors)
        sensor_std = np.array([sensor.noise_std for sensor in case.sensors] + [flux_noise_std(case)] * plates)
        return noise_shape_of_record(self.record, response, bins, self.spacing, sensor_std, *face_noise_of_model(case))


def _deviance_with_evidence(fit: GLSFit) -> float:
    """What compares fits: a disturbance must explain more by the evidence that is asked for."""
    return fit.marginal_deviance + (0.0 if fit.disturbance is None else EVIDENCE)


def _with_heat_in_gains(
    problem: LikelihoodProblem, noise: NoiseCovariance, shape: NoiseShape, residual: np.ndarray
) -> LikelihoodProblem:
    """A problem with what a disturbance tells about the gains of two plates; unchanged without two plates."""
    plates = problem.parameters.indices(problem.parameters.of_kind(PLATE_GAIN))
    if len(plates) < len(SIDES):
        return problem
    gains, std = np.asarray(problem.nuisance.gains), np.asarray(problem.parameters.prior_std)[plates]
    by_heat = gains_by_heat(noise, shape, residual, gains, std, problem.data.observed.shape[0])
    return replace(
        problem,
        nuisance=replace(problem.nuisance, heat_by_gain=by_heat.columns),
        prior_mean=problem.prior_mean.at[plates].set(by_heat.prior_mean),
    )


def _converged(fit: GLSFit, before: Parameters, names: Sequence[str]) -> bool:
    """Whether some parameters changed by less than a tenth of a standard error."""
    change = np.abs(np.asarray(fit.parameters.vector(names)) - np.asarray(before.vector(names)))
    return bool(np.all(change <= _CONVERGED * np.array([fit.std(name) for name in names])))


def _noise_of_residual(shape: NoiseShape, fit: GLSFit) -> NoiseCovariance:
    """The noise estimated from a fit's residual, every direction of its parameters projected out."""
    directions = np.asarray(fit.minimum.jacobian).T[fit.estimated_indices]
    nonzero = np.linalg.norm(directions, axis=1) > 0
    if not nonzero[0]:  # the readings do not depend on the diffusivity
        return shape.stated_covariance()
    return estimate_noise(shape, np.asarray(fit.minimum.residual), directions[nonzero], fit.sensitivity)
