"""What readings can tell: the Fisher information of a window, under the covariance that its interval will have.

    M = J' R^-1 J + P,      R = S S' + sum_f s_f^2 G_f G_f'

over `p = (ln(alpha), z)`, with z all that the estimate leaves free in units of its priors: the faces' common noise,
the initial profile's modes, offsets and position errors. `S` holds the sensors' noise, `G_f` the readings' response
to a face, both as stated; `P` is 1 for each z. No reading is needed for it but the faces', so that sensors can be
thought of where there are none.

A criterion makes one number of M (Kiefer's mean of its eigenvalues `m_i`, all in units of information)::

    D: (prod m_i)^(1/p)        A: p / sum(1 / m_i)        E: min m_i

Source: J. Kiefer, Ann. Stat. 2 (1974), 849; F. Pukelsheim, Optimal Design of Experiments (1993), 6.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular, toeplitz

from ._fields import one_of
from .case import Case
from .courses import Courses, held
from .displaced import depth_columns
from .experiment import Window, fit_profile
from .free import noise_within, window_span
from .noise import MOST_READINGS
from .wall import InputError, Sensor

Criterion = Literal["D", "A", "E"]
Of = Literal["diffusivity", "constants", "all"]
Robust = Literal["no", "expected", "worst"]

ROBUST_FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Of the prior: over these a robust design looks where nothing else is said."""
HOPELESS = 1e3
"""A relative standard error past which nothing is told."""
_NOTHING = 1e-12  # of the largest eigenvalue: no information along that direction


def check_words(criterion: str, of: str, robust: str) -> None:
    """Refuse unknown choices.

    Raises:
        InputError: which one.
    """
    one_of("criterion", criterion, ("D", "A", "E"))
    one_of("of", of, ("diffusivity", "constants", "all"))
    one_of("robust", robust, ("no", "expected", "worst"))


def alphas_of(case: Case, diffusivities: Sequence[float] | None, robust: str) -> tuple[float, ...]:
    """At which diffusivities a design looks, m2/s: the prior, and with a robust one up to four times as much and less.

    Raises:
        InputError: none, or one that is not above 0.
    """
    prior = case.wall.diffusivity_prior
    if diffusivities is None:
        # the prior comes first: it is what the words speak of
        others = [factor * prior for factor in ROBUST_FACTORS if factor != 1.0] if robust != "no" else []
        return (prior, *others)
    found = tuple(float(alpha) for alpha in diffusivities)
    if not found or not all(0.0 < alpha < math.inf for alpha in found):
        raise InputError(f"diffusivities = {list(found)}; at least one is needed, each above 0 m2/s")
    return found


def size(matrix: Float[np.ndarray, "param param"], criterion: Criterion) -> float:
    """One number for an information matrix, itself in units of information; 0 where a direction is not told."""
    eigenvalues = np.linalg.eigvalsh(0.5 * (matrix + matrix.T))
    if not np.all(np.isfinite(eigenvalues)) or eigenvalues[0] <= _NOTHING * max(eigenvalues[-1], 1e-300):
        return 0.0
    if criterion == "D":
        return float(np.exp(np.mean(np.log(eigenvalues))))
    return float(len(eigenvalues) / np.sum(1.0 / eigenvalues)) if criterion == "A" else float(eigenvalues[0])


def merit(sizes: Float[np.ndarray, "case candidate"], robust: Robust) -> Float[np.ndarray, " candidate"]:
    """Each candidate's criterion over the best one's, 1: at the first diffusivity, or over all of them.

    "expected" takes the geometric mean over the diffusivities, "worst" the smallest (Dette's standardised maximin).
    Source: H. Dette, J. R. Stat. Soc. B 59 (1997), 97.
    """
    largest = sizes.max(axis=1, keepdims=True)
    share = sizes / np.where(largest > 0, largest, 1.0)
    if robust == "no":
        return share[0]
    if robust == "worst":
        return share.min(axis=0)
    with np.errstate(divide="ignore"):
        return np.exp(np.mean(np.log(share), axis=0))


@dataclass(frozen=True, eq=False)
class Whitening:
    """The Cholesky factor of the readings' covariance, sensor after sensor.

    Arguments:
        root: L, `R = L L'`. through: what each reading makes of the faces' noise in each bin, K.
    """

    root: np.ndarray
    through: np.ndarray

    @staticmethod
    def none(bins: int) -> Whitening:
        """Before the first sensor."""
        return Whitening(np.zeros((0, 0)), np.zeros((0, bins)))

    def whiten(self, columns: np.ndarray) -> np.ndarray:
        """`L^-1` times columns of readings."""
        return solve_triangular(self.root, columns, lower=True)

    def beside(self, through: np.ndarray, variance: np.ndarray) -> Whitening:
        """With one more sensor's readings."""
        mixed = solve_triangular(self.root, self.through @ through.T, lower=True) if len(self.root) else self.root
        mixed = mixed.reshape(len(self.root), len(through))
        corner = np.linalg.cholesky(through @ through.T + np.diag(variance) - mixed.T @ mixed)
        root = np.block([[self.root, np.zeros_like(mixed)], [mixed.T, corner]])
        return Whitening(root, np.concatenate([self.through, through]))


@dataclass(frozen=True, eq=False)
class Seen:
    """One sensor's binned readings in one window: derivatives and noise.

    Arguments:
        shared: by ln(alpha), the faces' places, common noise, modes, K. own: by its offset and its position error, K.
        through, variance: of the faces' noise and its own, where there is a reading. present: those bins.
    """

    shared: Float[np.ndarray, "bin shared"]
    own: Float[np.ndarray, "bin own"]
    through: np.ndarray
    variance: np.ndarray
    present: bytes


@dataclass(eq=False)
class Looking:
    """Windows seen at one diffusivity, with what is kept from window to window.

    Arguments:
        rows: of the record in each window.
        stride: rows of the courses from one reading to the next, of faces and sensors alike.
    """

    case: Case
    courses: Courses
    starts: np.ndarray
    rows: int
    bin_rows: int = 1
    stride: int = 1
    kept: dict[tuple, Whitening] = field(default_factory=dict)

    def __post_init__(self) -> None:
        answer = self.courses.response if self.stride == 1 else held(self.courses.response, self.stride)
        rows = answer.shape[1]
        self.bins = -(-rows // self.bin_rows)
        padded = np.pad(answer, ((0, 0), (0, self.bins * self.bin_rows - rows), (0, 0)))
        ends = np.cumsum(padded, axis=1).reshape(2, self.bins, self.bin_rows, -1).mean(axis=2)
        # of a bin's mean to a change of a face over a whole bin, as in NoiseModel
        self.binned = np.diff(ends, axis=1, prepend=0.0)
        self.toeplitz: dict[int, np.ndarray] = {}

    def through(self, place: int) -> np.ndarray:
        """What the readings at a place make of white noise of the faces, K, `(bin, face and bin)`."""
        if place not in self.toeplitz:
            std = self.case.record.boundary_noise_std / math.sqrt(self.bin_rows)
            parts = [std * toeplitz(face, np.zeros(self.bins)) for face in self.binned[:, :, place]]
            self.toeplitz[place] = np.concatenate(parts, axis=1)
        return self.toeplitz[place]

    def seen(self, window: int, place: int, sensor: Sensor, present: np.ndarray | None = None) -> Seen:
        """What a sensor at a place sees; without `present` it has a reading in every row."""
        courses, rows = self.courses, slice(None, None, self.stride)
        slope = courses.slope[window, rows, place]
        present = np.ones(len(slope)) if present is None else present.astype(float)
        gradient = courses.gradient[window, rows, place]
        moved = self.moved(slope, gradient, place)
        shared = np.column_stack([slope, *moved, *self.common(window), *self.waves(window, place)])
        own = []
        if sensor.offset_std > 0:
            own.append(np.full(len(slope), sensor.offset_std))
        if sensor.position_std > 0:
            own.append(sensor.position_std * gradient)
        count = self._total(present[:, None])[:, 0]
        there = count > 0
        binned = self.mean(np.column_stack([shared, *own]), present)[there]
        split = shared.shape[1]
        return Seen(
            shared=binned[:, :split],
            own=binned[:, split:],
            through=self.through(place)[there],
            variance=sensor.noise_std**2 / count[there],
            present=count.tobytes(),
        )

    def moved(self, slope: np.ndarray, gradient: np.ndarray, place: int) -> np.ndarray:
        """What one standard deviation of the places of the faces' sensors makes of a place's readings, K."""
        std = self.case.record.face_position_std
        if std == 0.0:
            return np.zeros((0, len(slope)))
        return std * depth_columns(slope, gradient, self.courses.places[place], self.case.wall.length)

    def mean(self, values: Float[np.ndarray, "time column"], present: np.ndarray) -> Float[np.ndarray, "bin column"]:
        """Of the rows present in each bin; 0 in an empty one."""
        count = self._total(present[:, None])
        return self._total(values * present[:, None]) / np.maximum(count, 1.0)

    def _total(self, values: np.ndarray) -> np.ndarray:
        short = ((0, self.bins * self.bin_rows - len(values)), (0, 0))
        return np.pad(values, short).reshape(self.bins, self.bin_rows, -1).sum(axis=1)

    def common(self, window: int) -> list[np.ndarray]:
        """What of the faces' readings may be noise, which sensors of one logger may share, K."""
        std = self.case.record.boundary_noise_std
        return [noise_within(face, std) for face in self.courses.faces[window, :: self.stride].T] if std > 0 else []

    def waves(self, window: int, place: int) -> np.ndarray:
        """The initial profile's free modes, K; none where it was given."""
        row = int(self.starts[window])
        if fit_profile(self.case, row).eps_2 is None:
            return np.zeros((0, 0))
        span = window_span(self.case, Window(row, self.rows))
        waves = self.courses.waves[:, :: self.stride, place]
        return span / np.arange(1, len(waves) + 1)[:, None] * waves

    def whitening(self, keys: Sequence[tuple[int, Seen]]) -> Whitening:
        """Of several sensors at places; the same sensors with the same rows missing are gone through once."""
        key = tuple((place, seen.present) for place, seen in keys)
        if key not in self.kept:
            found = Whitening.none(2 * self.bins)
            for _, seen in keys:
                found = found.beside(seen.through, seen.variance)
            self.kept[key] = found
        return self.kept[key]


def whitened(seen: Sequence[Seen], whitening: Whitening) -> Float[np.ndarray, "reading param"]:
    """`L^-1 J` over ln(alpha), what all sensors share, then each sensor's own."""
    own = sum(one.own.shape[1] for one in seen)
    shared = seen[0].shared.shape[1]
    J = np.zeros((sum(len(one.shared) for one in seen), shared + own))
    row, column = 0, shared
    for one in seen:
        J[row : row + len(one.shared), :shared] = one.shared
        J[row : row + len(one.own), column : column + one.own.shape[1]] = one.own
        row, column = row + len(one.shared), column + one.own.shape[1]
    return whitening.whiten(J)


def fisher(seen: Sequence[Seen], whitening: Whitening) -> Float[np.ndarray, "param param"]:
    """M over ln(alpha), what all sensors share, then each sensor's own, with the priors in."""
    white = whitened(seen, whitening)
    return white.T @ white + np.diag((np.arange(white.shape[1]) > 0).astype(float))


def on(matrix: Float[np.ndarray, "param param"], kept: list[int]) -> Float[np.ndarray, "kept kept"]:
    """The information on some parameters, the others projected out."""
    rest = [place for place in range(len(matrix)) if place not in kept]
    found = matrix[kept][:, kept]
    if not rest:
        return found
    mixed = matrix[kept][:, rest]
    return found - mixed @ np.linalg.solve(matrix[rest][:, rest], mixed.T)


def std_of(matrix: Float[np.ndarray, "param param"]) -> float:
    """The relative standard error of the diffusivity that an information leaves, 1."""
    on_log = float(on(matrix, [0])[0, 0])
    return 1.0 / math.sqrt(on_log) if on_log > HOPELESS**-2 else math.inf


def told(matrix: Float[np.ndarray, "param param"], criterion: Criterion, kept: list[int]) -> float:
    """The criterion of what M says of some parameters; of the diffusivity alone every one is its information."""
    found = on(matrix, kept)
    return max(float(found[0, 0]), 0.0) if len(kept) == 1 else size(found, criterion)


def kept(of: Of, seen: Sequence[Seen]) -> list[int]:
    """The places in M of the parameters that a criterion is of."""
    shared, own = seen[0].shared.shape[1], sum(one.own.shape[1] for one in seen)
    if of == "all":
        return list(range(shared + own))
    return [0, *range(shared, shared + own)] if of == "constants" else [0]


def rows_per_bin(readings: int) -> int:
    """How many rows are put together so that a dense covariance holds them."""
    return max(1, math.ceil(readings / MOST_READINGS))


def like(sensors: Sequence[Sensor], **given: float | None) -> Sensor:
    """A sensor as the case has them: the median of each of their standard deviations where none is given."""
    names = ("noise_std", "position_std", "offset_std")
    usual = {name: float(np.median([getattr(sensor, name) for sensor in sensors])) for name in names}
    found = {name: usual[name] if given.get(name) is None else given[name] for name in names}
    return replace(sensors[0], name="another", **found)
