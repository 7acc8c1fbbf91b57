"""Rank: what each effect of the library, and each pair of them, would explain, from one derivative each.

With W the whitening of the noise, `r = W (y - f)`, `W J = Q R` for what is already free (its priors as
further rows), and `z = (I - Q Q') W df/dphi` of an effect's size::

    expected drop of -2 log L = (z'r)^2 / z'z,      expected size = z'r / z'z

and for a pair with normalised scores s_i, s_j and cosine c: `(s_i^2 + s_j^2 - 2 c s_i s_j) / (1 - c^2)`. Under
a model from which nothing is missing the scores are normal with the cosines as covariance: draws of them
give the largest score that chance alone makes in the whole library. Each draw has a noise of its own, as far as
the record leaves its power open.

Source: C. R. Rao, Proc. Camb. Phil. Soc. 44 (1948), 50 (the score test).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .acceptance import price
from .effect_fit import Fit
from .model_with_effects import first_order_columns
from .problem import DiagnosisProblem, EffectParameters

DRAWS = 2000
_PAIR_DRAWS = 200
_COLLINEAR = 1e-3  # 1 - cosine^2 under which two effects are one to this record
_FAR = 0.15  # of ln(diffusivity)
_UNSEEN = 1e-6  # share of a derivative that nothing free explains, under which the record cannot show it


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect at a place of its scan.

    Args:
        where: its places, times and temperatures by index in the vector.
    """

    slot: EffectParameters
    where: dict[int, float]


@dataclass(frozen=True, eq=False)
class Screen:
    """What every candidate would explain beside a fitted model.

    Args:
        base: the fitted model.
        norm: of each `z`, 1 per unit of the size.
        score: `z'r / |z|`. cosine: between all pairs of `z`.
        moves: what a unit of each size does to the free parameters, `(free, candidate)`.
        signs: +1 or -1 where the size must be positive or negative, else 0.
    """

    base: Fit
    candidates: tuple[Candidate, ...]
    norm: np.ndarray = field(repr=False)
    score: np.ndarray = field(repr=False)
    cosine: np.ndarray = field(repr=False)
    moves: np.ndarray = field(repr=False)
    signs: np.ndarray = field(repr=False)
    random: np.random.Generator = field(repr=False)

    @cached_property
    def gain(self) -> np.ndarray:
        """Expected drop of `-2 log L` by each candidate alone; 0 where its sign would be wrong."""
        return np.where(self.signs * self.score < 0, 0.0, self.score**2)

    @cached_property
    def size(self) -> np.ndarray:
        """Expected size of each candidate alone, in its unit."""
        return self.score / self.norm

    @cached_property
    def shift(self) -> np.ndarray:
        """What each candidate would do to ln(diffusivity)."""
        return self.moves[0] * self.size

    @cached_property
    def groups(self) -> dict[EffectParameters, np.ndarray]:
        """The candidates of each effect, by their places in `candidates`."""
        found: dict[EffectParameters, list[int]] = {}
        for place, candidate in enumerate(self.candidates):
            found.setdefault(candidate.slot, []).append(place)
        return {slot: np.array(places) for slot, places in found.items()}

    def places(self, slot: EffectParameters) -> list[int]:
        """The candidates of one effect, best first."""
        own = self.groups.get(slot, np.array([], dtype=int))
        return [int(place) for place in own[np.argsort(-self.gain[own])]]

    def best(self, count: int) -> list[int]:
        """The best candidate of each of the best effects, one per effect, best first."""
        tops = [places[np.argmax(self.gain[places])] for places in self.groups.values()]
        return sorted((int(top) for top in tops), key=lambda top: -self.gain[top])[:count]

    def farthest(self, p: float, count: int) -> list[int]:
        """The same of those past chance that move the diffusivity so far that one derivative tells little of them."""
        threshold = self.threshold(p)
        far = [k for k in self.best(len(self.groups)) if self.gain[k] > threshold and abs(self.shift[k]) > _FAR]
        return sorted(far, key=lambda k: -abs(self.shift[k]))[:count]

    def likeliest(self, count: int) -> list[int]:
        """The same by their gains less the price of the places and hours that they chose."""
        weighed = {
            top: self.gain[top] - price(self.base, (self.candidates[top].slot,)) for top in self.best(len(self.groups))
        }
        return sorted(weighed, key=lambda top: -weighed[top])[:count]

    @cached_property
    def _largest(self) -> np.ndarray:
        """The largest gain that chance makes, per draw, sorted."""
        draws = self._draw(DRAWS)
        draws = draws * np.exp(0.5 * self.base.noise.spread * self.random.standard_normal((DRAWS, 1)))
        return np.sort(np.where(self.signs * draws < 0, 0.0, draws**2).max(axis=1, initial=0.0))

    def _draw(self, count: int) -> np.ndarray:
        value, vector = np.linalg.eigh(self.cosine)
        root = vector * np.sqrt(np.maximum(value, 0.0))
        return self.random.standard_normal((count, len(value))) @ root.T

    def p_value(self, gain: float) -> float:
        """How often chance alone makes a larger best gain in the whole library; never under 1/(draws + 1)."""
        larger = len(self._largest) - np.searchsorted(self._largest, gain)
        return float(1 + larger) / (1 + len(self._largest))

    def threshold(self, p: float) -> float:
        """The gain that chance alone passes with this probability."""
        return float(np.quantile(self._largest, 1 - p)) if len(self.candidates) else np.inf

    @cached_property
    def pair_gain(self) -> np.ndarray:
        """Expected drop by each pair; 0 on the diagonal, within an effect, and where a sign would be wrong."""
        return self._pairs(self.score)

    def _pairs(self, score: np.ndarray) -> np.ndarray:
        apart = self._apart
        own, other = score[:, None] - self.cosine * score[None, :], score[None, :] - self.cosine * score[:, None]
        total = np.where(apart > 0, (score[:, None] * own + score[None, :] * other) / np.maximum(apart, _COLLINEAR), 0)
        wrong = (self.signs[:, None] * own < 0) | (self.signs[None, :] * other < 0)
        return np.where(wrong, 0.0, total)

    @cached_property
    def _apart(self) -> np.ndarray:
        """`1 - cosine^2`, 0 for what is no pair."""
        apart = 1.0 - self.cosine**2
        names = [(c.slot.effect.name, c.slot.effect.target) for c in self.candidates]
        code = {name: i for i, name in enumerate(dict.fromkeys(names))}
        group = np.array([code[name] for name in names], dtype=int)
        apart[group[:, None] == group[None, :]] = 0.0
        return np.where(apart < _COLLINEAR, 0.0, apart)

    def best_pairs(self, count: int) -> list[tuple[int, int]]:
        """The best pairs of effects, each at its best places, best first."""
        gain = np.triu(self.pair_gain)
        found: list[tuple[int, int]] = []
        seen: set[frozenset[EffectParameters]] = set()
        for flat in np.argsort(-gain, axis=None)[: 50 * count]:
            i, j = (int(k) for k in np.unravel_index(flat, gain.shape))
            slots = frozenset((self.candidates[i].slot, self.candidates[j].slot))
            if gain[i, j] <= 0 or len(found) == count:
                break
            if slots not in seen:
                seen.add(slots)
                found.append((i, j))
        return found

    def pair_threshold(self, p: float) -> float:
        """The gain of a best pair that chance alone passes with this probability."""
        largest = [self._pairs(draw).max(initial=0.0) for draw in self._draw(_PAIR_DRAWS)]
        return float(np.quantile(largest, 1 - p)) if len(self.candidates) > 1 else np.inf

    def prediction(self, chosen: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
        """Sizes of some candidates together, and what they do to the base's free parameters."""
        places = np.array(chosen)
        system = self.cosine[np.ix_(places, places)]
        size = np.linalg.lstsq(system, self.score[places], rcond=None)[0] / self.norm[places]
        return size, self.moves[:, places] @ size


@dataclass(frozen=True, eq=False)
class CandidateJacobian:
    """Every candidate beside a fit, and its derivative, K per unit of its size, `(candidate, reading)`."""

    candidates: tuple[Candidate, ...]
    columns: np.ndarray = field(repr=False)


def screen(base: Fit, outlook: CandidateJacobian, random: np.random.Generator) -> Screen:
    """Score every candidate beside a fitted model."""
    candidates, z = outlook.candidates, outlook.columns
    white = z @ base.noise.whiten.T
    white = np.concatenate([white, np.zeros((len(white), base.jacobian.shape[0] - white.shape[1]))], axis=1)
    size = np.maximum(np.linalg.norm(base.jacobian, axis=0), 1e-300)
    Q, R = np.linalg.qr(base.jacobian / size)
    inside = white @ Q
    moves = -np.linalg.lstsq(R, inside.T, rcond=1e-12)[0] / size[:, None]
    left = white - inside @ Q.T
    left -= (left @ Q) @ Q.T  # once more, for round-off
    norm = np.linalg.norm(left, axis=1)
    seen = norm > _UNSEEN * np.maximum(np.linalg.norm(white, axis=1), 1e-300)
    keep = np.flatnonzero(seen & (norm > 0))
    unit = left[keep] / norm[keep, None]
    signs = np.array([_sign(candidates[k].slot) for k in keep], dtype=float)
    return Screen(
        base,
        tuple(candidates[k] for k in keep),
        norm[keep],
        unit @ base.residual,
        unit @ unit.T,
        moves[:, keep],
        signs,
        random,
    )


def candidate_jacobian(study: DiagnosisProblem, base: Fit) -> CandidateJacobian:
    """The derivative of every effect that is not in a fitted model, at every place of its scan.

    To first order about the base's linear part, whose temperatures differ little from the base's own: a ranking
    needs no more, and a refit is exact.
    """
    slots = [slot for slot in study.library if not any(same(slot, other) for other in base.active)]
    return _outlook(study, base, [candidate for slot in slots for candidate in _scanned(study, slot, {})])


def candidate_jacobian_of_forms(
    study: DiagnosisProblem, base: Fit, forms: list[EffectParameters], known: dict[str, float]
) -> CandidateJacobian:
    """The same of some forms of an effect, at the places and hours that are known of it, the rest scanned."""
    return _outlook(study, base, [candidate for form in forms for candidate in _scanned(study, form, known)])


def same(one: EffectParameters, other: EffectParameters) -> bool:
    """Whether both are forms of one effect on one target."""
    return (one.effect.name, one.effect.target) == (other.effect.name, other.effect.target)


def _scanned(study: DiagnosisProblem, slot: EffectParameters, known: dict[str, float]) -> list[Candidate]:
    """An effect at every place of its scan, but where something of it is known."""
    index = {p.name: i for p, i in zip(slot.effect.parameters, slot.indices, strict=True)}
    places = [{index[name]: known.get(name, at) for name, at in row.items()} for row in slot.effect.scan(study.search)]
    return [Candidate(slot, dict(place)) for place in dict.fromkeys(tuple(place.items()) for place in places)]


def _outlook(study: DiagnosisProblem, base: Fit, candidates: list[Candidate]) -> CandidateJacobian:
    thetas = np.stack([_placed(base.theta, candidate) for candidate in candidates])
    directions = np.eye(study.size)[[candidate.slot.first for candidate in candidates]]
    return CandidateJacobian(
        tuple(candidates), first_order_columns(study.model, study.bins, base.theta, thetas, directions)
    )


def _placed(theta: np.ndarray, candidate: Candidate) -> np.ndarray:
    """The parameters with a candidate at its place."""
    theta = theta.copy()
    theta[list(candidate.where)] = list(candidate.where.values())
    return theta


def _sign(slot: EffectParameters) -> int:
    """The sign that an effect's size must have, 0 for either."""
    size = slot.effect.parameters[0]
    if size.least == 0.0:
        return 1
    return -1 if size.most == 0.0 else 0
