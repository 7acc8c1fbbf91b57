"""Rounds of Gauss-Newton to the minimum under the covariance that belongs to it.

The covariance needs what is looked for: each round takes the faces' response, the noise's sizes, the sensors' places
and the wall's own parameters from the round before, until the estimate stays.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._internal.arrays import on_device
from ..case.case_definition import Case
from ..case.initial_profile import scales
from ..case.time_window import Window
from ..models.flux_plates import first_conductivity, flux_noise_std, with_flux
from ..models.integration import Integrator
from ..models.plate_model import full_order_model_with_plates
from ..models.state_space import StateSpace
from ..models.wall_parameters import clipped_to_prior
from ..models.window_inputs import WindowData
from .gap_covariance import gap_errors
from .gls_fit import GLSFit
from .likelihood import LikelihoodProblem, face_response, minimise
from .noise_covariance import Bins, Noise, NoiseShape, bins_of, thinned
from .nuisance_parameters import NuisanceParameters, linearise_nuisance, nuisance_parameters_of
from .validity import distinguishable_range
from .whittle_likelihood import estimate_noise

_MOST_ROUNDS = 4
_STRUCTURE_ROUNDS = 15  # where the wall itself is free: each builds its model anew
_STILL = 0.1  # of a standard error: a round that moves the estimate by less was the last
_FEWEST_READINGS = 30  # beyond the parameters: from fewer no noise is estimated


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
) -> GLSFit:
    """The estimate under the full covariance, from a first diffusivity (m2/s).

    Args:
        system: its outputs are the sensors, then the plates.
        rows_used: of the window, from its start; None for all.
    """
    rounds = _Rounds.of(case, window, _used(with_flux(case, window, data), rows_used), eta, explicit_theta, integrator)
    names, large = rounds.names, full_order_model_with_plates(case)
    value, found, settled = float(np.clip(first, *rounds.bounds)), np.zeros(names.count), None
    loose, reached = names.of_structure, np.zeros(len(names.structure))
    for _ in range(_STRUCTURE_ROUNDS if names.structure else _MOST_ROUNDS):
        if names.structure:
            system = large = full_order_model_with_plates(case, reached)
        settled = rounds.another(system, large, value, found, settled)
        moved = abs(math.log(settled.diffusivity / value)) if math.isfinite(settled.diffusivity) else math.inf
        still = moved < _STILL * settled.log_std and _still(settled, found)
        if not math.isfinite(moved) or (settled.rounds > 1 and still):
            break
        value, found = settled.diffusivity, np.array(settled.minimum.parameters)[1:]
        # the wall's own parameters are linear about where they were: no farther than a prior's standard deviation
        reached = clipped_to_prior(np.clip(found[loose], reached - 1.0, reached + 1.0))
        found[loose] = reached
    assert settled is not None
    if names.structure:  # the first round's wall was that of the priors
        stated = settled.shape.stated().whiten @ np.asarray(settled.minimum.left)
        z = np.asarray(settled.minimum.parameters)[1:]
        settled = replace(settled, reduced_chi_square=float(stated @ stated + z @ z) / rounds.freedom)
    if rounds.kind == "robust" and rounds.enough and math.isfinite(settled.diffusivity):
        return replace(settled, robust=_noise_left(settled.shape, settled))
    return settled


def _used(data: WindowData, rows: int | None) -> WindowData:
    """The experiment without the readings after its first rows."""
    if rows is None:
        return data
    used = jnp.asarray(np.arange(data.observed.shape[0]) < rows, dtype=float)[:, None]
    return eqx.tree_at(lambda d: (d.weight, d.observed), data, (data.weight * used, data.observed * used))


@dataclass(frozen=True, eq=False)
class _Rounds:
    """What stays the same from round to round.

    Args:
        bins, apart: of the readings, as `bins_of` gives them.
        readings: how many there are, in their bins.
        conductivity: W/m/K, with which the first round begins; 0 without a flux.
        bounds: between which diffusivities is searched, m2/s.
        fill_std: of the faces' interpolation in the window's rows, K; None where every row was read.
    """

    case: Case
    window: Window
    data: WindowData
    names: NuisanceParameters
    bins: Bins
    apart: int
    readings: int
    conductivity: float
    bounds: tuple[float, float]
    fill_std: np.ndarray | None
    eta: float
    explicit_theta: bool
    integrator: Integrator

    @classmethod
    def of(
        cls, case: Case, window: Window, data: WindowData, eta: float, explicit_theta: bool, integrator: Integrator
    ) -> _Rounds:
        """What a window's readings, plates included, set."""
        names = nuisance_parameters_of(case, window)
        bins, apart = bins_of(np.asarray(data.weight) > 0, np.asarray(data.observed))
        return cls(
            case=case,
            window=window,
            data=data,
            names=names,
            bins=bins,
            apart=apart,
            readings=int((np.asarray(bins.counts()) > 0).sum()),
            conductivity=first_conductivity(case, window) if names.fluxes else 0.0,
            bounds=distinguishable_range(case, window),
            fill_std=case.record.window(window.row, window.rows).fill_std,
            eta=eta,
            explicit_theta=explicit_theta,
            integrator=integrator,
        )

    @property
    def kind(self) -> str:
        """How the noise is taken: "estimated", "stated", or "robust", the default beside a flux."""
        return self.case.choices.noise or ("robust" if self.names.fluxes else "estimated")

    @property
    def enough(self) -> bool:
        """Whether there are readings enough to estimate the noise from."""
        return self.readings - 1 - self.names.count >= _FEWEST_READINGS

    @property
    def freedom(self) -> int:
        """The cost's degrees of freedom."""
        return max(self.readings - 1, 1)

    def another(
        self, system: StateSpace, large: StateSpace, value: float, found: np.ndarray, before: GLSFit | None
    ) -> GLSFit:
        """One more round, about a diffusivity and the other parameters found."""
        case, names, start = self.case, self.names, self.case.wall.diffusivity_prior
        free = linearise_nuisance(case, self.window, self.data, names, start, value, found, large, self.conductivity)
        now = self.conductivity * math.exp(free.log_std * found[names.conductivity]) if names.fluxes else 0.0
        shape = self._shape(system, scales(case).fourier(value), now / case.wall.length)
        estimated = self.kind == "estimated" and self.enough
        noise = _noise_left(shape, before) if before is not None and estimated else shape.stated()
        problem = LikelihoodProblem(
            system=system,
            data=self.data,
            nuisance=free,
            bins=self.bins,
            observed=self.bins.mean(self.bins.observed),
            whiten=on_device(noise.whiten),
            fourier_per_alpha=on_device(scales(case).fourier(1.0)),
            start=on_device(start),
            lowest=on_device(self.bounds[0]),
            highest=on_device(self.bounds[1]),
            explicit_theta=self.explicit_theta,
            integrator=self.integrator,
        )
        begin = on_device(np.concatenate([[math.log(value / start)], found]))
        at = minimise(problem, begin, on_device(self.eta), case.choices.max_iterations)
        chi_square = float(at.cost) / self.freedom if before is None else before.reduced_chi_square
        rounds = 1 if before is None else before.rounds + 1
        return GLSFit(problem, at, shape, noise, names, chi_square, estimated, rounds)

    def _shape(self, system: StateSpace, fourier: float, conductance: float) -> NoiseShape:
        """The covariance's shape at a Fourier number, with the faces' noise through this model.

        Args:
            conductance: k/L, W/m2/K, by which a face's noise is in the fluxes.
        """
        case, data = self.case, self.data
        response = np.array(face_response(system, on_device(fourier), data.step, data.observed.shape[0]))
        plates = response.shape[2] - len(case.sensors)
        response[:, :, len(case.sensors) :] *= conductance
        gaps = gap_errors(self.fill_std, case.record.boundary_noise_std, response, self.bins)
        response, bins = thinned(response, self.bins, self.apart)
        sensor_std = np.array([sensor.noise_std for sensor in case.sensors] + [flux_noise_std(case)] * plates)
        return NoiseShape(response, bins, sensor_std, case.record.boundary_noise_std, gaps)


def _still(settled: GLSFit, found: np.ndarray) -> bool:
    """Whether the wall's own parameters stayed where they were."""
    loose = settled.names.of_structure
    width = np.sqrt(np.maximum(np.diag(settled.covariance)[1:][loose], 0.0))
    return bool(np.all(np.abs(np.asarray(settled.minimum.parameters)[1:][loose] - found[loose]) <= _STILL * width))


def _noise_left(shape: NoiseShape, settled: GLSFit) -> Noise:
    """The noise that a minimum leaves, beside every direction that a parameter could move the readings in."""
    directions = np.asarray(settled.minimum.jacobian).T
    moving = np.linalg.norm(directions, axis=1) > 0
    if not moving[0]:  # nothing tells of the diffusivity, and no noise would either
        return shape.stated()
    return estimate_noise(shape, np.asarray(settled.minimum.left), directions[moving], settled.along)
