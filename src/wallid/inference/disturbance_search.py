"""Where a disturbance is, how large and with which memory, by the restricted likelihood of a fit's residual.

With `r` the residual of a fit and `J` its Jacobian, the parameters integrated out under their priors P:

    R = v R_0 + s^2 D(profile, tau)
    -2 log L = r' R^-1 r - b' (J' R^-1 J + P)^-1 b + ln det R + ln det (J' R^-1 J + P),      b = J' R^-1 r - P z

`R_0` is the stated white noise, the faces' part included, `v` its size, and `D` the covariance by a disturbance of unit
size. The priors shrink it to nothing: an exponential one of the size `s`, of which 95 % are below `LARGEST_STD`; a
log-normal one of the time constant about 6 h; and `ln v` as in the Whittle likelihood. The places and a grid of sizes
and time constants give the posterior over them, and from it the spread of every parameter.

Source: D. A. Harville, J. Am. Stat. Assoc. 72 (1977), 320; D. Simpson and others, Stat. Sci. 32 (2017), 1; H. Rue and
others, J. R. Stat. Soc. B 71 (2009), 319.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import scipy
from jaxtyping import Float

from .._internal.result_object import ResultObject, plain_value
from ..models.disturbance import Smoothness
from ..models.finite_volume_wall import HeatProfile
from .disturbance_covariance import DEPTHS, HEAT_PROFILES, DisturbedReadings
from .noise_covariance import NoiseCovariance, NoiseShape

LARGEST_STD = 10.0
"""W/m2 or K/day: 95 % of disturbances are taken as smaller before the record is seen."""
EVIDENCE = 10.0
"""Of -2 log L: a disturbance with more evidence is taken with `disturbance = "auto"`."""
_TYPICAL_TIME, _TIME_SPREAD = 6.0 * 3600.0, 1.2  # s, and of its logarithm
_TIMES = 6  # of the grid
_SIZES = np.exp(np.arange(-2.1, 3.6, 0.7))  # standard deviation of the readings by the disturbance over the noise's
_NOISE_STEP = 0.25  # of ln v
_NOISE_SIZES = np.exp(np.arange(-5.0, 5.1, _NOISE_STEP))
_STORED = 60  # covariances of unit size
_EVALUATIONS = 40  # of the search about the best point of the grid
_SMOOTHNESS: tuple[Smoothness, ...] = ("matern-1/2", "matern-3/2")


@dataclass(frozen=True, eq=False)
class Disturbance(ResultObject):
    """A disturbance found in a record.

    Args:
        profile: where the heat is released.
        std: standard deviation of the heat, in `unit`: W/m2, or K/day where the record has no flux.
        time_constant: s. smoothness: of the process.
        evidence: -2 log L without it minus -2 log L with it, at the best size and time constant of each.
        noise_size: v, the noise's variance over the stated one.
        inflation: of each estimated parameter's standard error, by the uncertainty of place, size and time constant.
    """

    profile: HeatProfile
    std: float
    unit: str
    time_constant: float
    smoothness: Smoothness
    evidence: float
    noise_size: float = field(repr=False)
    inflation: np.ndarray = field(repr=False)

    @property
    def place(self) -> str:
        """ "wall", or "left" or "right": behind that face."""
        return self.profile.place

    def to_dict(self) -> dict[str, Any]:
        """The entry of result.json."""
        keys = ("place", "std", "unit", "time_constant", "evidence", "smoothness")
        return plain_value({key: getattr(self, key) for key in keys})

    @property
    def heat(self) -> str:
        """Where the heat is and how large, in words."""
        where = "spread through the wall" if self.place == "wall" else f"behind the {self.place} face"
        unit = "W/m2" if self.unit == "W/m2" else "K a day"
        hours = self.time_constant / 3600.0
        memory = f"{hours:.2g} h" if hours < 48.0 else f"{hours / 24.0:.2g} days"
        return f"heat {where} that no column explains ({self.std:.2g} {unit}, memory {memory})"

    def __str__(self) -> str:
        return f"{self.heat}, evidence {self.evidence:.0f}"


class _Candidate(NamedTuple):
    """A disturbance to be tried; `size` is that of the readings by it over that of the noise."""

    profile: HeatProfile
    time_constant: float
    size: float
    smoothness: Smoothness = "matern-1/2"


class _Point(NamedTuple):
    """The restricted likelihood at one covariance: its cost, `v`, and the parameters' estimates and covariance.

    `cost` is -2 log L; of a candidate with its priors.
    """

    cost: float
    noise_size: float
    shift: np.ndarray
    covariance: np.ndarray


class RestrictedLikelihood:
    """The restricted likelihood of a residual for any covariance of the readings.

    Args:
        present: mask of the readings.
        residual: measured minus predicted, `(reading,)`.
        jacobian: of the predictions, `(reading, param)`.
        deviation: the parameters' estimates in prior standard deviations; the first has no prior.
    """

    def __init__(self, present: np.ndarray, residual: np.ndarray, jacobian: np.ndarray, deviation: np.ndarray):
        self.present = present
        self.columns = np.column_stack([jacobian, residual])[present]
        # a scale that is kept in a difference of costs: only the first parameter has no prior
        norms = np.linalg.norm(self.columns[:, :-1], axis=0)
        self.size = np.where(norms > 0.0, norms, 1.0)
        self.precision = np.ones(jacobian.shape[1])
        self.precision[0] = 0.0
        self.prior = -self.precision * deviation
        self.prior_cost = float(self.precision @ deviation**2)

    def at(self, covariance: Float[np.ndarray, "reading reading"]) -> _Point:
        """The minimum over the noise's size `v`, for a covariance over `v`."""
        lower = np.linalg.cholesky(covariance[np.ix_(self.present, self.present)])
        whitened = scipy.linalg.solve_triangular(lower, self.columns, lower=True)
        products = whitened.T @ whitened
        log_det = 2.0 * float(np.sum(np.log(np.diag(lower))))
        costs = self._costs(products, _NOISE_SIZES)
        best = int(np.clip(np.argmin(costs), 1, len(costs) - 2))
        before, at_best, after = costs[best - 1 : best + 2]
        # the vertex of the parabola through three points
        bend = before - 2.0 * at_best + after
        offset = float(np.clip(0.5 * (before - after) / bend, -1.0, 1.0)) if bend > 0 else 0.0
        noise_size = math.exp(math.log(_NOISE_SIZES[best]) + offset * _NOISE_STEP)
        information, b = self._normal_equations(products, np.array([noise_size]))
        inverse = np.linalg.inv(information[0] / np.outer(self.size, self.size)) / np.outer(self.size, self.size)
        return _Point(
            float(self._costs(products, np.array([noise_size]))[0]) + log_det, noise_size, inverse @ b[0], inverse
        )

    def _normal_equations(self, products: np.ndarray, sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        information = products[:-1, :-1] / sizes[:, None, None] + np.diag(self.precision)
        return information, products[:-1, -1] / sizes[:, None] + self.prior

    def _costs(self, products: np.ndarray, sizes: np.ndarray) -> np.ndarray:
        """`-2 log L` at sizes of the noise, without ln det of the covariance over `v`."""
        information, b = self._normal_equations(products, sizes)
        scaled = information / np.outer(self.size, self.size)
        b = b / self.size
        explained = np.einsum("vp,vp->v", b, np.linalg.solve(scaled, b[:, :, None])[:, :, 0])
        log_det = np.linalg.slogdet(scaled)[1]
        count = len(self.columns)
        return (
            count * np.log(sizes)
            + products[-1, -1] / sizes
            + self.prior_cost
            - explained
            + log_det
            + np.log(sizes) ** 2
        )


def find_disturbance(
    readings: DisturbedReadings,
    shape: NoiseShape,
    step: float,
    likelihood: RestrictedLikelihood,
    without: NoiseCovariance | None,
) -> Disturbance:
    """The disturbance that explains a residual best.

    Args:
        readings: as a disturbance changes them.
        shape: of the noise's covariance. step: between its rows, s.
        likelihood: of the residual of the readings in the bins of `shape`.
        without: the noise as estimated without a disturbance; None for white noise.
    """
    search = _Search(readings, shape, step, likelihood)
    times_and_sizes = list(product(search.times.tolist(), _SIZES.tolist()))
    grid = [_Candidate(profile, time, size) for profile in HEAT_PROFILES[:3] for time, size in times_and_sizes]
    points = {one: search.at(one) for one in grid}
    first = min(points, key=lambda one: points[one].cost)
    if first.profile.place != "wall":
        others = [HeatProfile(first.profile.place, depth) for depth in DEPTHS[1:]]
        sizes = (0.5 * first.size, first.size, 2.0 * first.size)
        deeper = [first._replace(profile=profile, size=size) for profile, size in product(others, sizes)]
        points |= {one: search.at(one) for one in deeper}
        first = min(points, key=lambda one: points[one].cost)
    best, point = search.refined(first)
    none = likelihood.at(search.white).cost
    if without is not None:
        none = min(none, likelihood.at(search.noise_alone(without)).cost)
    return Disturbance(
        profile=best.profile,
        std=search.std(best, point),
        unit=readings.unit,
        time_constant=best.time_constant,
        smoothness=best.smoothness,
        evidence=none - point.cost,
        noise_size=point.noise_size,
        inflation=_inflation(point, list(points.values())),
    )


class _Search:
    """The cost of disturbances of all profiles, time constants and sizes.

    Sizes are relative: the root mean square of the readings by the disturbance over that of the noise.
    """

    def __init__(self, readings: DisturbedReadings, shape: NoiseShape, step: float, likelihood: RestrictedLikelihood):
        self.readings, self.shape, self.likelihood = readings, shape, likelihood
        self.white = shape.stated_covariance().covariance
        window = step * shape.rows_per_bin * shape.bin_count
        self.times = np.geomspace(max(2.0 * step, 900.0), max(window / 2.0, 8.0 * step), _TIMES)
        self.units: dict[_Candidate, tuple[np.ndarray, float]] = {}

    def noise_alone(self, noise: NoiseCovariance) -> np.ndarray:
        """The covariance of noise of this shape with a total variance of 1."""
        total = noise.white + noise.autocorrelated
        return self.shape.covariance_of(noise.white / total, noise.autocorrelated / total, noise.correlation).covariance

    def unit(self, one: _Candidate) -> tuple[np.ndarray, float]:
        """The covariance by a disturbance of one unit, and the mean of the noise's variance over its own."""
        key = one._replace(size=1.0)
        if key not in self.units:
            if len(self.units) > _STORED:
                self.units.clear()
            bins, rows = self.shape.bin_count, self.shape.rows_per_bin
            covariance = self.readings.covariance(one.profile, one.time_constant, one.smoothness, bins, rows)
            present = self.likelihood.present
            ratio = np.diag(covariance)[present] / np.diag(self.white)[present]
            self.units[key] = covariance, 1.0 / float(ratio.mean())
        return self.units[key]

    def std(self, one: _Candidate, point: _Point) -> float:
        """The size in W/m2 or K/day."""
        return one.size * math.sqrt(self.unit(one)[1] * point.noise_size)

    def at(self, one: _Candidate) -> _Point:
        """The likelihood at one disturbance; its cost with the priors."""
        covariance, ratio = self.unit(one)
        point = self.likelihood.at(self.white + one.size**2 * ratio * covariance)
        priors = 6.0 * self.std(one, point) / LARGEST_STD
        priors += (math.log(one.time_constant / _TYPICAL_TIME) / _TIME_SPREAD) ** 2
        return point._replace(cost=point.cost + priors)

    def refined(self, first: _Candidate) -> tuple[_Candidate, _Point]:
        """The minimum about a point of the grid, for the smoothness with the lower cost."""
        bounds, found = np.log([self.times[0], self.times[-1]]), []
        start = np.log([first.time_constant, first.size])
        simplex = start + np.array([[0.0, 0.0], [0.4, 0.0], [0.0, 0.3]])
        options = {"initial_simplex": simplex, "maxfev": _EVALUATIONS, "xatol": 0.03, "fatol": 0.05}
        for smoothness in _SMOOTHNESS:

            def candidate(y: np.ndarray, smoothness: Smoothness = smoothness) -> _Candidate:
                time_constant = math.exp(float(np.clip(y[0], *bounds)))
                return _Candidate(first.profile, time_constant, math.exp(float(y[1])), smoothness)

            minimum = scipy.optimize.minimize(
                lambda y, candidate=candidate: self.at(candidate(y)).cost, start, method="Nelder-Mead", options=options
            )
            one = candidate(minimum.x)
            found.append((one, self.at(one)))
        return min(found, key=lambda pair: pair[1].cost)


def _inflation(best: _Point, points: list[_Point]) -> np.ndarray:
    """Each parameter's standard error over the posterior of the disturbance, over the one at its best point.

    The total variance is the mean of the variances plus the variance of the means.
    """
    costs = np.array([one.cost for one in points])
    probability = np.exp(-0.5 * (costs - costs.min()))
    probability /= probability.sum()
    at_best = np.diag(best.covariance)
    spread = np.stack([np.diag(one.covariance) + (one.shift - best.shift) ** 2 for one in points])
    return np.sqrt(np.maximum(probability @ spread / np.maximum(at_best, 1e-300), 1.0))
