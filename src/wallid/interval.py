"""From the likelihood to an interval: the covariance found with the estimate, and the likelihood's profile.

Rounds of Gauss-Newton: each takes the faces' response, the noise's sizes and the sensors' places from the round
before. The standard error is that of generalised least squares, `(J' R^-1 J + priors)^-1`; where the noise's sizes
were estimated, Student's quantile stands for the normal one. Where the cost is no parabola the interval is that of
the profile likelihood, `-2 log L <= min + q^2`.

Source: G. A. F. Seber, C. J. Wild, Nonlinear Regression (1989), 5.4 and 5.9.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .case import Case
from .experiment import Experiment, Window, scales
from .free import (
    Names,
    bins_of,
    flux_noise_std,
    fluxes_of,
    free_at,
    names_of,
    thinned,
    told_range,
    whole_model,
    with_flux,
)
from .likelihood import Minimum, Problem, face_response, minimise, profile
from .noise import Bins, Noise, NoiseModel, estimate_noise, filled_gaps
from .simulate import Integrator
from .statespace import StateSpace
from .structure import within

NORMAL_95 = 1.959963984540054  # 97.5 % quantile of the normal distribution
_MOST_ROUNDS = 4
_STRUCTURE_ROUNDS = 15  # where the wall itself is free: each builds its model anew
_STILL = 0.1  # of a standard error: a round that moves the estimate by less was the last
_FEWEST_READINGS = 30  # beyond the parameters: from fewer no noise is estimated
_SCAN = 25  # diffusivities between the bounds, to see minima elsewhere
_LOCAL = 8
_PARABOLA = (0.85, 1.2)  # of the cost's rise at the interval's ends over that of a parabola
_DEEPER = 1.0  # of -2 log L: a minimum elsewhere is taken if it is lower by more
_LARGEST = 700.0  # exp(709) is the largest float


class Interval(NamedTuple):
    """A 95 % interval of ln(alpha/start).

    Arguments:
        kind: "normal", or "profile likelihood" where the cost is no parabola.
        deeper: ln(alpha/start) of a point outside where the cost is lower than at the minimum found; or None.
    """

    low: float
    high: float
    kind: str
    deeper: float | None


@dataclass(frozen=True, eq=False)
class Settled:
    """The minimum under the covariance that belongs to it.

    Arguments:
        reduced_chi_square: the cost under the noise as stated, over its degrees of freedom.
        estimated: whether the noise's sizes are the record's; else as stated, and a misfit widens the interval.
        robust: the noise that was found beside weights as stated; or None.
        rounds: how many it took.
    """

    problem: Problem
    minimum: Minimum
    shape: NoiseModel
    noise: Noise
    names: Names
    reduced_chi_square: float
    estimated: bool
    rounds: int
    robust: Noise | None = None

    @cached_property
    def jacobian(self) -> np.ndarray:
        """Whitened, the priors' rows below."""
        J = self.noise.whiten @ np.asarray(self.minimum.jacobian)
        return np.concatenate([J, np.eye(self.names.count, 1 + self.names.count, 1)])

    @cached_property
    def inverse(self) -> np.ndarray:
        """What each whitened reading and each prior does to each parameter, `(param, row)`; NaN where it failed."""
        if not np.all(np.isfinite(self.jacobian)):
            return np.full(self.jacobian.shape[::-1], np.nan)
        size = np.maximum(np.linalg.norm(self.jacobian, axis=0), 1e-300)
        return np.linalg.pinv(self.jacobian / size, rcond=1e-13) / size[:, None]

    @cached_property
    def marginal(self) -> float:
        """`-2 log L` with all that is free integrated out, up to what the noise alone sets."""
        J = self.jacobian[:, 1:]
        return float(self.minimum.cost + np.linalg.slogdet(J.T @ J)[1])

    @property
    def evidence(self) -> float:
        """The same with what the noise sets, to compare minima under noise of different sizes."""
        return self.marginal - 2.0 * float(np.sum(np.log(np.diag(self.noise.whiten))))

    @property
    def along(self) -> np.ndarray:
        """The binned readings' derivative by ln(alpha), K, with all that is free at its best."""
        J = self.jacobian
        rest = np.linalg.lstsq(J[:, 1:], J[:, 0], rcond=None)[0]
        raw = np.asarray(self.minimum.jacobian)
        return raw[:, 0] - raw[:, 1:] @ rest

    @property
    def widening(self) -> float:
        """Of the covariance: by how uncertain the noise's shape is, or by a misfit beyond the stated noise."""
        if self.robust is not None:
            return float(self.covariance[0, 0] / (self.inverse[0] @ self.inverse[0]))
        return self.noise.widening if self.estimated else max(1.0, self.reduced_chi_square)

    @cached_property
    def covariance(self) -> np.ndarray:
        """Of ln(alpha) and all that is free, in prior standard deviations."""
        if self.robust is None:
            return self.inverse @ self.inverse.T * self.widening
        # what the noise found makes of an estimate by these weights (P. J. Huber, 1967), and the priors' part
        readings = len(self.noise.whiten)
        own, priors = self.inverse[:, :readings] @ self.noise.whiten, self.inverse[:, readings:]
        return own @ self.robust.covariance @ own.T + priors @ priors.T

    @property
    def log_alpha(self) -> float:
        """ln(alpha/start)."""
        return float(self.minimum.parameters[0])

    @property
    def diffusivity(self) -> float:
        """m2/s."""
        return float(self.problem.start * jnp.exp(self.log_alpha))

    @property
    def log_std(self) -> float:
        """Of ln(alpha)."""
        variance = float(self.covariance[0, 0])
        return math.sqrt(variance) if 0.0 < variance < math.inf else math.inf

    @property
    def quantile(self) -> float:
        """97.5 %, in units of `log_std`: beyond the normal one by what the record leaves open of the noise."""
        if self.robust is not None:
            return self.robust.quantile
        return self.noise.quantile / math.sqrt(self.noise.widening)

    @cached_property
    def interval(self) -> Interval:
        """95 %, of ln(alpha/start)."""
        return _interval_95(self)

    @property
    def of_constants(self) -> np.ndarray:
        """What one standard deviation of each constant (offsets, positions, gains) makes of ln(alpha)."""
        readings = len(self.noise.whiten)
        return self.inverse[0, readings:][self.names.constants[1:]]

    def model_shift(self, apart: np.ndarray) -> float:
        """How far an error of the predictions, K at the rows, moves ln(alpha)."""
        binned = np.asarray(self.problem.bins.mean(jnp.asarray(apart)))
        return float(self.inverse[0, : len(binned)] @ (self.noise.whiten @ binned))

    def shares(self) -> dict[str, float]:
        """What each kind of error makes of ln(alpha)'s variance, 1.

        The noise with all else known, then what it adds that offsets, positions and the initial profile are not.
        """
        names, J = self.names, self.jacobian
        readings = len(self.noise.whiten)
        own = J[:readings, 0] / np.sum(J[:readings, 0] ** 2) @ self.noise.whiten
        known = float(own @ self.noise.covariance @ own)
        faces = float(own @ self.faces_covariance @ own)
        variance = {"sensors' noise": known - faces, "faces' noise": faces}
        groups = {"offsets": len(names.offsets), "positions": len(names.positions)}
        groups |= {"layers and films": len(names.structure), "common noise": len(names.common)}
        groups |= {"initial profile": names.modes}
        used = 1
        for name, count in groups.items():
            used += count
            if count:
                # ln(alpha) last: its row is what the rest leave
                R = np.asarray(np.linalg.qr(J[:, :used][:, ::-1], mode="r"))
                variance[name] = float(1.0 / R[-1, -1] ** 2) - sum(variance.values())
        total = sum(variance.values())
        return {name: part / total for name, part in variance.items()}

    @cached_property
    def faces_covariance(self) -> np.ndarray:
        """The part of the covariance that comes through the faces."""
        only = NoiseModel(np.zeros_like(self.shape.response), self.shape.bins, self.shape.sensor_std, 0.0)
        sensors = only.noise(self.noise.white, self.noise.lasting, self.noise.correlation).covariance
        there = self.shape.counts.T.reshape(-1) > 0
        return (self.noise.covariance - sensors) * np.outer(there, there)


def settle(
    case: Case,
    window: Window,
    data: Experiment,
    system: StateSpace,
    first: float,
    *,
    eta: float,
    explicit_theta: bool = True,
    integrator: Integrator = "propagator",
    rows_used: int | None = None,
) -> Settled:
    """The estimate under the full covariance, from a first diffusivity (m2/s).

    Arguments:
        system: its outputs are the sensors, then the plates.
        rows_used: of the window, from its start; None for all.
    """
    names, scale = names_of(case, window), scales(case)
    data = with_flux(case, window, data)
    if rows_used is not None:
        used = jnp.asarray(np.arange(window.rows) < rows_used, dtype=float)[:, None]
        data = eqx.tree_at(lambda d: (d.weight, d.observed), data, (data.weight * used, data.observed * used))
    bins, thin = bins_of(np.asarray(data.weight) > 0, np.asarray(data.observed))
    readings = int((np.asarray(bins.counts()) > 0).sum())
    kind = case.choices.noise or ("robust" if names.fluxes else "estimated")
    enough = readings - 1 - names.count >= _FEWEST_READINGS
    estimated = kind == "estimated" and enough
    per_alpha, start = jnp.asarray(scale.fourier(1.0)), jnp.asarray(case.wall.diffusivity_prior)
    large, length = whole_model(case), case.wall.length
    conductivity = first_conductivity(case, window) if names.fluxes else 0.0
    lowest, highest = told_range(case, window)
    value, found, settled = float(np.clip(first, lowest, highest)), np.zeros(names.count), None
    chi_square, fill_std = 1.0, case.record.window(window.row, window.rows).fill_std
    loose, reached = names.of_structure, np.zeros(len(names.structure))
    for rounds in range(1, (_MOST_ROUNDS if not names.structure else _STRUCTURE_ROUNDS) + 1):
        if names.structure:
            system = large = whole_model(case, reached)
        free = free_at(case, window, data, names, float(start), value, found, large, conductivity)
        now = conductivity * math.exp(free.log_std * found[names.conductivity]) if names.fluxes else 0.0
        shape = noise_model(case, data, system, scale.fourier(value), bins, thin, now / length, fill_std)
        noise = _noise_left(shape, settled) if settled is not None and estimated else shape.noise(1.0, 0.0, 0.8)
        problem = Problem(
            system=system,
            data=data,
            free=free,
            bins=bins,
            observed=bins.mean(bins.observed),
            whiten=jnp.asarray(noise.whiten),
            fourier_per_alpha=per_alpha,
            start=start,
            lowest=jnp.asarray(lowest),
            highest=jnp.asarray(highest),
            explicit_theta=explicit_theta,
            integrator=integrator,
        )
        begin = jnp.asarray(np.concatenate([[math.log(value / float(start))], found]))
        at = minimise(problem, begin, jnp.asarray(eta), case.choices.max_iterations)
        if rounds == 1:
            chi_square = float(at.cost) / max(readings - 1, 1)
        settled = Settled(problem, at, shape, noise, names, chi_square, estimated, rounds)
        moved = abs(math.log(settled.diffusivity / value)) if math.isfinite(settled.diffusivity) else math.inf
        still = moved < _STILL * settled.log_std and _still(settled, found)
        if not math.isfinite(moved) or (rounds > 1 and still):
            break
        value, found = settled.diffusivity, np.array(at.parameters)[1:]
        # the wall's own parameters are linear about where they were: no farther than a prior's standard deviation
        reached = within(np.clip(found[loose], reached - 1.0, reached + 1.0))
        found[loose] = reached
    assert settled is not None
    if names.structure:  # the first round's wall was that of the priors
        stated = settled.shape.noise(1.0, 0.0, 0.8).whiten @ np.asarray(settled.minimum.left)
        z = np.asarray(settled.minimum.parameters)[1:]
        settled = replace(settled, reduced_chi_square=float(stated @ stated + z @ z) / max(readings - 1, 1))
    if kind == "robust" and enough and math.isfinite(settled.diffusivity):
        return replace(settled, robust=_noise_left(settled.shape, settled))
    return settled


def _still(settled: Settled, found: np.ndarray) -> bool:
    """Whether the wall's own parameters stayed where they were."""
    loose = settled.names.of_structure
    width = np.sqrt(np.maximum(np.diag(settled.covariance)[1:][loose], 0.0))
    return bool(np.all(np.abs(np.asarray(settled.minimum.parameters)[1:][loose] - found[loose]) <= _STILL * width))


def _noise_left(shape: NoiseModel, settled: Settled) -> Noise:
    """The noise that a minimum leaves, beside every direction that a parameter could move the readings in."""
    directions = np.asarray(settled.minimum.jacobian).T
    moving = np.linalg.norm(directions, axis=1) > 0
    if not moving[0]:  # nothing tells of the diffusivity, and no noise would either
        return shape.noise(1.0, 0.0, 0.8)
    return estimate_noise(shape, np.asarray(settled.minimum.left), directions[moving], settled.along)


def first_conductivity(case: Case, window: Window) -> float:
    """Where to begin, W/m/K: what the case states, else mean fluxes over the mean drop of temperature, else 1."""
    if case.wall.effective_conductivity is not None:
        return case.wall.effective_conductivity
    part = case.record.window(window.row, window.rows)
    fluxes = [part.regressors[f"flux_{face}"] for face in fluxes_of(case)]
    drop = float(np.mean(part.faces[:, 0] - part.faces[:, 1]))
    found = float(np.nanmean(np.concatenate(fluxes))) / drop * case.wall.length if abs(drop) > 1e-3 else 1.0
    return float(np.clip(found, 1e-3, 1e3)) if math.isfinite(found) and found > 0 else 1.0


def noise_model(
    case: Case,
    data: Experiment,
    system: StateSpace,
    fourier: float,
    bins: Bins,
    apart: int,
    conductance: float = 0.0,
    fill_std: np.ndarray | None = None,
) -> NoiseModel:
    """The covariance's shape at a Fourier number, with the faces' noise through this model.

    Arguments:
        conductance: k/L, W/m2/K, by which a face's noise is in the fluxes.
        fill_std: of the faces' interpolation in the window's rows, K; None where every row was read.
    """
    response = np.array(face_response(system, jnp.asarray(fourier), data.step, data.observed.shape[0]))
    plates = response.shape[2] - len(case.sensors)
    response[:, :, len(case.sensors) :] *= conductance
    gaps = filled_gaps(fill_std, case.record.boundary_noise_std, response, bins)
    response, bins = thinned(response, bins, apart)
    sensor_std = np.array([sensor.noise_std for sensor in case.sensors] + [flux_noise_std(case)] * plates)
    return NoiseModel(response, bins, sensor_std, case.record.boundary_noise_std, gaps=gaps)


def _interval_95(settled: Settled) -> Interval:
    """The interval of the settled estimate, by its curvature where that serves, else by its profile."""
    start, at = float(settled.problem.start), settled.log_alpha
    low, high = (math.log(float(end) / start) for end in (settled.problem.lowest, settled.problem.highest))
    half = min(settled.quantile * settled.log_std, _LARGEST)
    rise = settled.quantile**2 * settled.widening  # of the weights' own cost
    near = np.clip(at + half * np.linspace(-2.0, 2.0, _LOCAL + 1)[np.arange(_LOCAL + 1) != _LOCAL // 2], low, high)
    points = np.concatenate([near, np.linspace(low, high, _SCAN)])
    change = _profile(settled, points)
    ends = change[[_LOCAL // 4, _LOCAL // 4 + _LOCAL // 2 - 1]]
    outside = np.abs(points - at) > half
    elsewhere = np.where(outside, change, np.inf)
    deeper = float(points[np.argmin(elsewhere)]) if elsewhere.min() < -_DEEPER else None
    parabolic = np.all((ends > _PARABOLA[0] * rise) & (ends < _PARABOLA[1] * rise))
    if half < high - low and parabolic and not np.any(change[outside] < _PARABOLA[0] * rise):
        return Interval(at - half, at + half, "normal", deeper)
    points, change = np.append(points, at), np.append(change, 0.0)
    return Interval(
        _crossing(settled, points, change, rise, -1), _crossing(settled, points, change, rise, 1),
        "profile likelihood", deeper,
    )  # fmt: skip


def _profile(settled: Settled, points: np.ndarray) -> np.ndarray:
    """The rise of -2 log L over its minimum with all else at its best; infinite where the model has no value."""
    change = np.asarray(profile(settled.problem, jnp.asarray(points))) - settled.marginal
    return np.where(np.isfinite(change), change, np.inf)


def _crossing(settled: Settled, points: np.ndarray, change: np.ndarray, rise: float, side: int) -> float:
    """The outermost point on one side where the profile passes `rise`; the bound where it does not."""
    order = np.argsort(points * side)
    points, change = points[order], change[order]
    inside = int(np.flatnonzero(change <= rise)[-1])
    if inside == len(points) - 1:
        return float(points[inside])
    fine = np.linspace(points[inside], points[inside + 1], _LOCAL + _SCAN)
    fine_change = _profile(settled, fine)
    last = min(int(np.flatnonzero(fine_change <= rise)[-1]) if (fine_change <= rise).any() else 0, len(fine) - 2)
    a, b = (math.sqrt(max(c, 0.0)) for c in fine_change[last : last + 2])
    share = (math.sqrt(rise) - a) / (b - a) if math.isfinite(b) and b > a else 0.0
    return float(fine[last] + min(max(share, 0.0), 1.0) * (fine[last + 1] - fine[last]))
