"""Where a disturbance is, how large and with which memory, by the restricted likelihood of a fit's residual.

With `r` the residual of a fit and `J` its Jacobian, the parameters integrated out under their priors P:

    R = v R_0 + s^2 D(profile, tau)
    -2 log L = r' R^-1 r - b' (J' R^-1 J + P)^-1 b + ln det R + ln det (J' R^-1 J + P),      b = J' R^-1 r - P z

`R_0` is the stated noise, the faces' part included, `v` its size, and `D` the covariance by a disturbance of unit size.
The noise is white, or has the memory that the sensors show beside plates (`noise_memory`). The priors shrink the
disturbance to nothing, and to a constant (the joint prior of Fuglstad and others):

    p(s) ~ exp(-lambda_s s),      p(tau) ~ tau^-3/2 exp(-lambda_t tau^-1/2)

95 % of the sizes are below `LARGEST_STD`, and 95 % of the time constants above `SHORTEST_TIME`. The prior of `ln v` is
that of the Whittle likelihood. The places and a grid of sizes and time constants give the posterior over them, and
from it the spread of every parameter and of a forecast. The depths of heat behind a face are tried ever closer about
the most probable one, and each weighs by the part of the range for which it stands.

Source: D. A. Harville, J. Am. Stat. Assoc. 72 (1977), 320; G.-A. Fuglstad, D. Simpson, F. Lindgren, H. Rue, J. Am.
Stat. Assoc. 114 (2019), 445; H. Rue and others, J. R. Stat. Soc. B 71 (2009), 319.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

import numpy as np
import scipy
from jaxtyping import Float

from .._internal.result_object import ResultObject, plain_value
from ..models.disturbance import Smoothness
from ..models.finite_volume_wall import HeatProfile
from ..records.face_spectrum import WHITE, NoiseMemory
from .disturbance_covariance import DEPTHS, DEPTHS_PER_DOUBLING, DisturbedReadings
from .noise_covariance import BinnedReadings, NoiseCovariance, NoiseShape

LARGEST_STD = 10.0
"""W/m2 or K/day: 95 % of disturbances are taken as smaller before the record is seen."""
SHORTEST_TIME = 1800.0
"""s: 95 % of disturbances are taken to have a longer memory."""
EVIDENCE = 10.0
"""Of -2 log L: a disturbance with more evidence is taken with `disturbance = "auto"`."""
_RARE = math.log(1.0 / 0.05)  # lambda_s is this over LARGEST_STD, lambda_t this times the root of SHORTEST_TIME
_sytrd, _ormqr, _sygst, _pttrf, _pttrs = scipy.linalg.get_lapack_funcs(("sytrd", "ormqr", "sygst", "pttrf", "pttrs"))
_BLOCK = 64  # columns, of LAPACK's work space
_MAX_READINGS = 480  # means over bins in a search
_TIMES = 7  # of the grid
_SIZES = np.exp(np.arange(-2.1, 3.6, 0.3))  # standard deviation of the readings by the disturbance over the noise's
_NOISE_STEP = 0.25  # of ln v
_NOISE_SIZES = np.exp(np.arange(-5.0, 5.1, _NOISE_STEP))
_TIME_TOLERANCE, _SIZE_TOLERANCE = 0.05, 0.02  # of the logarithms at the best point
_KEPT = 0.98  # probability of the places and time constants that a forecast averages over
_SEARCHED_AGAIN = 0.999  # and of those that a search in the residual of a later fit is limited to
_FIRST_DEPTH = DEPTHS[DEPTHS_PER_DOUBLING]  # 1/12 of the length
_FIRST_PROFILES = HeatProfile("wall"), HeatProfile("left", _FIRST_DEPTH), HeatProfile("right", _FIRST_DEPTH)
_RESOLVED = 1.0  # of -2 log L, between a depth and its neighbours, below which none between them is tried
_NEGLIGIBLE = 12.0  # of -2 log L, above the best depth's
_SMOOTHNESS: tuple[Smoothness, ...] = ("matern-1/2", "matern-3/2")


class _Process(NamedTuple):
    """What is searched for: the attributes of a `Disturbance` of the same names."""

    profile: HeatProfile
    std: float
    time_constant: float
    smoothness: Smoothness
    noise_size: float


class WeightedPlace(NamedTuple):
    """Where a search tries heat: a profile and a time constant, s.

    `doublings` is its weight in the posterior: the range of depths, in doublings, that this depth represents.
    """

    profile: HeatProfile
    time_constant: float
    doublings: float


@dataclass(frozen=True, eq=False)
class Disturbance(ResultObject):
    """A disturbance found in a record.

    Args:
        profile: where the heat is released.
        std: standard deviation of the heat, in `unit`: W/m2, or K/day where the record has no flux.
        time_constant: s. smoothness: of the process.
        evidence: -2 log L without it minus -2 log L with it at its best place, size and time constant, less what its
            priors take.
        noise_size: v, the noise's variance over the stated one. noise_memory: its shape.
        inflation: of each estimated parameter's standard error, by the uncertainty of place, size and time constant.
        posterior: the most probable places and time constants, each with its probability and its mean-square size.
        probable: those that are not excluded, for a search in the residual of a later fit.
    """

    profile: HeatProfile
    std: float
    unit: str
    time_constant: float
    smoothness: Smoothness
    evidence: float
    noise_size: float = field(repr=False)
    inflation: np.ndarray = field(repr=False)
    posterior: tuple[tuple[float, _Process], ...] = field(default=(), repr=False)
    noise_memory: NoiseMemory = field(default=WHITE, repr=False)
    probable: tuple[WeightedPlace, ...] = field(default=(), repr=False)

    @property
    def noise_variances(self) -> tuple[float, float]:
        """Variances of the white and of the autocorrelated noise beside it, over the stated one."""
        share = self.noise_memory.share
        return self.noise_size * (1.0 - share), self.noise_size * share

    @property
    def alternatives(self) -> tuple[tuple[float, Disturbance], ...]:
        """The disturbances of the posterior, each with its probability."""
        return tuple((share, replace(self, **one._asdict())) for share, one in self.posterior)

    def noise_beside(
        self, shape: NoiseShape, readings: DisturbedReadings, degrees_of_freedom: float
    ) -> NoiseCovariance:
        """The covariance of the readings by noise and the disturbance.

        Args:
            shape: of the noise's covariance.
            readings: as a disturbance changes them.
            degrees_of_freedom: of the residual.
        """
        unit = readings.covariance(
            self.profile, self.time_constant, self.smoothness, shape.bin_count, shape.rows_per_bin
        )
        noise = shape.covariance_of(*self.noise_variances, self.noise_memory.correlation, self.std**2 * unit)
        return replace(noise, degrees_of_freedom=degrees_of_freedom)

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


class _Place(NamedTuple):
    """Where heat may enter, and how it remembers: what the covariance of a disturbance of unit size depends on."""

    profile: HeatProfile
    time_constant: float
    smoothness: Smoothness = "matern-1/2"


class _Point(NamedTuple):
    """The restricted likelihood at one covariance: its cost, `v`, and the parameters' estimates and covariance.

    `cost` is -2 log L; of a disturbance with its priors.
    """

    cost: float
    noise_size: float
    shift: np.ndarray
    covariance: np.ndarray


def tridiagonal(
    matrix: Float[np.ndarray, "row row"], columns: Float[np.ndarray, "row column"]
) -> tuple[Float[np.ndarray, " row"], Float[np.ndarray, " beside"], Float[np.ndarray, "row column"]]:
    """Diagonal and subdiagonal of `T`, and `Q' columns`, for a symmetric `matrix = Q T Q'` with an orthogonal `Q`.

    Only the lower triangle of the matrix is used. LAPACK's `Q` leaves the first row as it is. It takes a quarter of the
    time of eigenvalues and eigenvectors.
    """
    reflectors, diagonal, beside, scales, _ = _sytrd(matrix, lower=1, lwork=_BLOCK * len(matrix))
    rotated = np.array(columns, order="F")
    below = np.asfortranarray(reflectors[1:, :-1])
    rotated[1:], _, _ = _ormqr("L", "T", below, scales, rotated[1:], _BLOCK * columns.shape[1])
    return diagonal, beside, rotated


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

    @classmethod
    def of_coarser_bins(
        cls,
        shape: NoiseShape,
        bins: BinnedReadings,
        residual: np.ndarray,
        jacobian: np.ndarray,
        deviation: np.ndarray,
    ) -> RestrictedLikelihood:
        """The likelihood in the bins of a shape, from a residual and its Jacobian in finer bins."""
        binned = shape.bins.in_coarser_bins(bins)
        return cls(shape.has_reading, binned(residual), binned(jacobian.T).T, deviation)

    def at(self, covariance: Float[np.ndarray, "reading reading"]) -> _Point:
        """The minimum over the noise's size `v`, for a covariance divided by `v`."""
        return LikelihoodBesideNoise(self, covariance).alone

    def minima(
        self, products: Float[np.ndarray, "size column column"], log_dets: Float[np.ndarray, " size"]
    ) -> list[_Point]:
        """The minima over `v`, from the whitened columns' products and ln det of the covariances divided by `v`.

        With `A` the products of the Jacobian, `M' A M = diag(c)` and `M' (A + P) M = 1`, the parameters' information
        `A / v + P` is `diag(c / v + 1 - c)` in the directions `M`, at every `v`.
        """
        A = products[:, :-1, :-1] / np.outer(self.size, self.size)
        lower = np.linalg.cholesky(A + np.diag(self.precision / self.size**2))
        half = np.linalg.solve(lower, A)
        shares, vectors = np.linalg.eigh(np.linalg.solve(lower, half.transpose(0, 2, 1)))
        modes = np.linalg.solve(lower.transpose(0, 2, 1), vectors)
        shares = np.clip(shares, 0.0, 1.0)
        log_dets = log_dets + self.prior_cost + 2.0 * np.sum(np.log(np.diagonal(lower, axis1=1, axis2=2)), axis=1)
        by_readings = np.einsum("sp,spm->sm", products[:, :-1, -1] / self.size, modes)
        by_prior = (self.prior / self.size) @ modes
        squares = products[:, -1, -1]

        def information(noise_size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            """Information in the directions M, and M' b, `(..., size, mode)`, for variances v `(..., size)`."""
            inverse = 1.0 / noise_size[..., None]
            return shares * inverse + (1.0 - shares), by_readings * inverse + by_prior

        def costs(noise_size: np.ndarray) -> np.ndarray:
            weights, b = information(noise_size)
            log_size, misfit = np.log(noise_size), squares / noise_size - np.sum(b**2 / weights, axis=-1)
            return len(self.columns) * log_size + misfit + np.sum(np.log(weights), axis=-1) + log_size**2 + log_dets

        every = np.arange(len(products))
        grid = costs(np.repeat(_NOISE_SIZES[:, None], len(products), axis=1))
        best = np.clip(np.argmin(grid, axis=0), 1, len(grid) - 2)
        before, at_best, after = (grid[best + beside, every] for beside in (-1, 0, 1))
        # the vertex of the parabola through three points
        bend = before - 2.0 * at_best + after
        offset = np.clip(0.5 * (before - after) / np.where(bend > 0, bend, np.inf), -1.0, 1.0)
        noise_size = _NOISE_SIZES[best] * np.exp(offset * _NOISE_STEP)
        weights, b = information(noise_size)
        directions = modes / self.size[:, None]
        shifts = np.einsum("spm,sm->sp", directions, b / weights)
        covariances = (directions / weights[:, None]) @ directions.transpose(0, 2, 1)
        return [
            _Point(float(cost), float(size), shift, covariance)
            for cost, size, shift, covariance in zip(costs(noise_size), noise_size, shifts, covariances, strict=True)
        ]


class LikelihoodBesideNoise:
    """The restricted likelihood for covariances `v (noise + size^2 unit)`.

    With `noise = L L'` and `L^-1 unit L^-T = Q T Q'`, `T` tridiagonal, they are `v L Q (1 + size^2 T) Q' L'`: one
    decomposition serves all sizes.

    Args:
        likelihood: of the residual.
        noise: the covariance by noise, for `v = 1`.
    """

    def __init__(self, likelihood: RestrictedLikelihood, noise: Float[np.ndarray, "reading reading"]):
        self.likelihood, self.rows = likelihood, np.ix_(likelihood.present, likelihood.present)
        self.lower = np.linalg.cholesky(noise[self.rows])
        self.columns = scipy.linalg.solve_triangular(self.lower, likelihood.columns, lower=True)
        self.log_det = 2.0 * float(np.sum(np.log(np.diag(self.lower))))

    @property
    def alone(self) -> _Point:
        """The minimum over `v` for noise alone."""
        return self.likelihood.minima((self.columns.T @ self.columns)[None], np.array([self.log_det]))[0]

    def of_sizes(self, unit: Float[np.ndarray, "reading reading"]) -> Callable[[Sequence[float]], list[_Point]]:
        """The minima over `v`, as a function of the sizes."""
        whitened_unit, _ = _sygst(unit[self.rows], self.lower, lower=1)  # its lower triangle
        diagonal, beside, rotated = tridiagonal(whitened_unit, self.columns)

        def at(sizes: Sequence[float]) -> list[_Point]:
            products, log_dets = [], []
            for size in sizes:
                pivots, factors, _ = _pttrf(1.0 + size**2 * diagonal, size**2 * beside)
                whitened, _ = _pttrs(pivots, factors, rotated)
                products.append(rotated.T @ whitened)
                log_dets.append(self.log_det + float(np.sum(np.log(pivots))))
            return self.likelihood.minima(np.stack(products), np.array(log_dets))

        return at


def search_bins(bins: BinnedReadings) -> BinnedReadings:
    """Bins that are few enough for a search: their dense covariance is decomposed at every place."""
    factor = -(-bins.readings // _MAX_READINGS)
    return BinnedReadings(bins.observed, bins.present, bins.rows_per_bin * factor)


def find_disturbance(
    readings: DisturbedReadings,
    shape: NoiseShape,
    step: float,
    likelihood: RestrictedLikelihood,
    without: NoiseCovariance | None,
    memory: NoiseMemory,
    enough: float = math.inf,
    among: Sequence[WeightedPlace] = (),
) -> Disturbance:
    """The disturbance that explains a residual best.

    Args:
        readings: as a disturbance changes them.
        shape: of the noise's covariance. step: between its rows, s.
        likelihood: of the residual of the readings in the bins of `shape`.
        without: the noise as estimated without a disturbance; None for noise of the same shape as beside one.
        memory: shape of the noise beside the disturbance.
        enough: evidence from which the best point of the first grid, with one depth behind each face, is taken as it
            is.
        among: the places and time constants that are tried, as an earlier search has left them; none for all.
    """
    search = _Search(readings, shape, step, likelihood, memory)
    if among:
        search.try_again(among)
    else:
        search.try_all(itertools.product(_FIRST_PROFILES, search.times))
    none = search.beside_noise.alone.cost
    if without is not None:
        total = without.white + without.autocorrelated
        alone = search.noise_of(NoiseMemory(without.autocorrelated / total, without.correlation))
        none = min(none, likelihood.at(alone).cost)
    best = search.best
    if none - best.point.cost < enough:
        if best.place.profile.place != "wall" and not among:
            search.try_depths(best.place.profile.place, best.place.time_constant)
        best = search.refined()
    posterior = search.posterior()
    return Disturbance(
        **best.process._asdict(),
        unit=readings.unit,
        evidence=none - best.point.cost,
        inflation=_inflation(best.point, posterior),
        posterior=search.most_probable(posterior),
        probable=search.not_excluded(posterior),
        noise_memory=memory,
    )


class _Tried(NamedTuple):
    """A disturbance that was tried.

    Args:
        place: where it enters.
        size: root mean square of the readings by it over that of the noise.
        std: of the heat, W/m2 or K/day.
        point: the likelihood, its cost with the priors.
    """

    place: _Place
    size: float
    std: float
    point: _Point

    @property
    def process(self) -> _Process:
        """The same as attributes of a `Disturbance`."""
        profile, time_constant, smoothness = self.place
        return _Process(profile, self.std, time_constant, smoothness, self.point.noise_size)


class _Search:
    """The cost of disturbances of all profiles, time constants and sizes.

    Attributes:
        noise: the covariance of noise of the stated size.
        times: time constants of the grid, s.
    """

    def __init__(
        self,
        readings: DisturbedReadings,
        shape: NoiseShape,
        step: float,
        likelihood: RestrictedLikelihood,
        memory: NoiseMemory,
    ):
        self.readings, self.shape, self.likelihood = readings, shape, likelihood
        self.noise = self.noise_of(memory)
        self.beside_noise = LikelihoodBesideNoise(likelihood, self.noise)
        window = step * shape.rows_per_bin * shape.bin_count
        self.times: list[float] = np.geomspace(max(2.0 * step, 900.0), max(window, 8.0 * step), _TIMES).tolist()
        self._tried: dict[_Place, list[_Tried]] = {}
        self._doublings: dict[HeatProfile, float] = {}  # of the depth, for which a profile stands; else 1
        self._units: dict[_Place, tuple[float, Callable[[Sequence[float]], list[_Point]]]] = {}

    def noise_of(self, memory: NoiseMemory) -> np.ndarray:
        """The covariance of noise of the stated size with this memory."""
        return self.shape.covariance_of(1.0 - memory.share, memory.share, memory.correlation).covariance

    def _unit(self, place: _Place) -> tuple[float, Callable[[Sequence[float]], list[_Point]]]:
        """The heat of a size of 1 over the root of `v`, in W/m2 or K/day, and the likelihood by such values."""
        if place not in self._units:
            present = self.likelihood.present
            covariance = self.readings.covariance(*place, self.shape.bin_count, self.shape.rows_per_bin)
            ratio = float(np.mean((np.diag(covariance) / np.diag(self.noise))[present]))
            self._units[place] = 1.0 / math.sqrt(ratio), self.beside_noise.of_sizes(covariance)
        return self._units[place]

    def at(self, place: _Place, sizes: Sequence[float]) -> list[_Tried]:
        """Disturbances of some sizes with their likelihood."""
        unit, likelihood = self._unit(place)
        tried = []
        for size, point in zip(sizes, likelihood([size * unit for size in sizes]), strict=True):
            std = size * unit * math.sqrt(point.noise_size)
            cost = point.cost + _prior_cost(std, place.time_constant)
            tried.append(_Tried(place, size, std, point._replace(cost=cost)))
        return tried

    def try_all(self, places: Iterable[tuple[HeatProfile, float]]) -> None:
        """Try all sizes at the profiles and time constants that have not been tried."""
        for place in (_Place(profile, time_constant) for profile, time_constant in places):
            if place not in self._tried:
                self._tried[place] = self.at(place, _SIZES.tolist())

    @property
    def tried(self) -> list[_Tried]:
        """The disturbances of the grid."""
        return [one for own in self._tried.values() for one in own]

    def try_depths(self, face: Literal["left", "right"], time_constant: float) -> None:
        """Try other depths behind a face: each double, then halfway to the best one's neighbours, ever closer.

        Where the best depth and its neighbours are about as probable, none between them is tried. The probable ones are
        then tried at the neighbouring time constants.

        Args:
            face: behind which heat of the first depth was tried.
            time_constant: of the best disturbance there, of the grid.
        """
        costs: dict[int, float] = {}

        def try_depth(number: int) -> None:
            if number not in costs and 0 <= number < len(DEPTHS):
                place = _Place(HeatProfile(face, DEPTHS[number]), time_constant)
                self.try_all([place[:2]])
                costs[number] = min(one.point.cost for one in self._tried[place])

        spacing = DEPTHS_PER_DOUBLING
        for number in range(0, len(DEPTHS), spacing):
            try_depth(number)
        while spacing > 1:
            best = min(costs, key=lambda number: costs[number])
            beside = [costs[number] for number in (best - spacing, best + spacing) if number in costs]
            if max(beside) - costs[best] < _RESOLVED:
                break
            spacing //= 2
            try_depth(best - spacing)
            try_depth(best + spacing)
        for number, width in _widths(sorted(costs)).items():
            self._doublings[HeatProfile(face, DEPTHS[number])] = width / DEPTHS_PER_DOUBLING
        limit = min(costs.values()) + _NEGLIGIBLE
        probable = [HeatProfile(face, DEPTHS[number]) for number, cost in costs.items() if cost < limit]
        at = self.times.index(time_constant)
        self.try_all(itertools.product(probable, self.times[max(at - 1, 0) : at + 2]))

    def try_again(self, places: Sequence[WeightedPlace]) -> None:
        """Try all sizes at the places that an earlier search has left."""
        self._doublings = {place.profile: place.doublings for place in places}
        self.try_all(place[:2] for place in places)

    @property
    def best(self) -> _Tried:
        """The disturbance of the grid with the lowest cost."""
        return min(self.tried, key=lambda one: one.point.cost)

    def posterior(self) -> list[tuple[float, _Tried]]:
        """The disturbances of the grid, each with its probability.

        The grid is even in the logarithm of the size, its prior is a density of the size: each weighs by its size. A
        depth weighs by the doublings for which it stands.
        """
        tried = self.tried
        costs = np.array([one.point.cost for one in tried])
        sizes = np.array([one.std for one in tried])
        doublings = np.array([self._doublings.get(one.place.profile, 1.0) for one in tried])
        weights = np.exp(-0.5 * (costs - costs.min())) * sizes * doublings
        return list(zip((weights / weights.sum()).tolist(), tried, strict=True))

    def most_probable(self, posterior: list[tuple[float, _Tried]]) -> tuple[tuple[float, _Process], ...]:
        """The places that hold almost all of the posterior, each with the mean variances of its heat and its noise."""
        found = []
        for total, own in _most_probable_places(posterior, _KEPT):
            heat = sum(share * one.std**2 for share, one in own) / total
            noise_size = sum(share * one.point.noise_size for share, one in own) / total
            found.append((total, own[0][1].process._replace(std=math.sqrt(heat), noise_size=noise_size)))
        all_found = sum(share for share, _ in found)
        return tuple((share / all_found, process) for share, process in found)

    def not_excluded(self, posterior: list[tuple[float, _Tried]]) -> tuple[WeightedPlace, ...]:
        """The places that a search in the residual of a later fit need try."""
        places = (own[0][1].place for _, own in _most_probable_places(posterior, _SEARCHED_AGAIN))
        return tuple(WeightedPlace(*place[:2], self._doublings.get(place.profile, 1.0)) for place in places)

    def refined(self) -> _Tried:
        """The minimum about the best point of the grid, for the smoothness with the lower cost."""
        first = self.best
        step, around = math.log(self.times[1] / self.times[0]), math.log(first.place.time_constant)
        bounds = max(around - step, math.log(self.times[0])), min(around + step, math.log(self.times[-1]))
        found = []
        for smoothness in _SMOOTHNESS:

            def at(log_time: float, smoothness: Smoothness = smoothness) -> _Tried:
                return self._of_best_size(_Place(first.place.profile, math.exp(log_time), smoothness), first.size)

            found.append(_minimum_between(at, bounds, _TIME_TOLERANCE))
        return min([*found, first], key=lambda one: one.point.cost)

    def _of_best_size(self, place: _Place, size: float) -> _Tried:
        """The minimum over sizes up to four times smaller or larger than a first one."""
        bounds = math.log(size / 4.0), math.log(size * 4.0)
        return _minimum_between(lambda log_size: self.at(place, [math.exp(log_size)])[0], bounds, _SIZE_TOLERANCE)


def _most_probable_places(
    posterior: list[tuple[float, _Tried]], probability: float
) -> list[tuple[float, list[tuple[float, _Tried]]]]:
    """The places that together have this probability, the most probable first: each one's own, and its disturbances."""
    places: dict[_Place, list[tuple[float, _Tried]]] = {}
    for share, one in posterior:
        places.setdefault(one.place, []).append((share, one))
    found = [(sum(share for share, _ in own), own) for own in places.values()]
    found.sort(key=lambda pair: -pair[0])
    before = itertools.accumulate((share for share, _ in found), initial=0.0)
    return [pair for pair, total in zip(found, before, strict=False) if total <= probability]


def _widths(numbers: list[int]) -> dict[int, float]:
    """How much each of some ascending numbers stands for: half of the way to its neighbours; half a doubling beyond."""
    middles = 0.5 * np.add(numbers[1:], numbers[:-1])
    beyond = 0.5 * DEPTHS_PER_DOUBLING
    edges = np.concatenate([[numbers[0] - beyond], middles, [numbers[-1] + beyond]])
    return dict(zip(numbers, np.diff(edges).tolist(), strict=True))


def _minimum_between(at: Callable[[float], _Tried], bounds: tuple[float, float], tolerance: float) -> _Tried:
    """The disturbance of the lowest cost between two values of a logarithm."""

    def cost(value: float) -> float:
        return at(value).point.cost

    found = scipy.optimize.minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": tolerance})
    return at(float(found.x))


def _inflation(best: _Point, posterior: list[tuple[float, _Tried]]) -> np.ndarray:
    """Each parameter's standard error over the posterior of the disturbance, over the one at its best point.

    The total variance is the mean of the variances plus the variance of the means.
    """
    at_best = np.diag(best.covariance)
    shares = np.array([share for share, _ in posterior])
    points = [one.point for _, one in posterior]
    spread = np.stack([np.diag(one.covariance) + (one.shift - best.shift) ** 2 for one in points])
    return np.sqrt(np.maximum(shares @ spread / np.maximum(at_best, 1e-300), 1.0))


def _prior_cost(std: float, time_constant: float) -> float:
    """-2 log of the prior of the size and of the logarithm of the time constant; 0 at the most probable ones.

    Args:
        std: s, W/m2 or K/day. time_constant: tau, s.
    """
    ratio = _RARE**2 * SHORTEST_TIME / time_constant  # 1 at the most probable time constant
    return 2.0 * _RARE * std / LARGEST_STD + 2.0 * (math.sqrt(ratio) - 1.0) - math.log(ratio)
