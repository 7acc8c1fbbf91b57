"""Score test of every effect of the library, and of every pair, against a fitted model.

With W the whitening matrix of the noise, `r = W (y - f)`, `W J = Q R` for the estimated parameters (with their
priors as further rows), and `z = (I - Q Q') W df/dphi` for the size phi of an effect::

    expected drop of -2 log L = (z'r)^2 / z'z,      expected size = z'r / z'z

For a pair with normalised scores s_i, s_j and cosine c the drop is `(s_i^2 + s_j^2 - 2 c s_i s_j) / (1 - c^2)`. What
chance alone gives to the largest score in the entire library is drawn at random (`chance_gains`).

Source: C. R. Rao, Proc. Camb. Phil. Soc. 44 (1948), 50 (the score test).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ...inference.likelihood import LOG_DIFFUSIVITY
from ..effect_fit import EffectFit
from ..model_with_effects import first_order_columns
from ..problem import DiagnosisProblem, EffectParameters
from .acceptance import bic_penalty
from .chance_gains import ChanceGains, draw_scores

_PAIR_DRAWS = 200
_COLLINEAR = 1e-3  # 1 - cosine^2 below which two effects cannot be distinguished
_LARGE_SHIFT = 0.15  # of ln(alpha), from which the linear prediction is poor
_NOT_IDENTIFIABLE = 1e-6  # share of a derivative orthogonal to the estimated parameters, below which it is left out


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect at one point of the grid over its positions, times or temperatures.

    Args:
        effect_parameters: the effect and the names of its parameters.
        scan_values: the values of these parameters at the grid point, by name.
    """

    effect_parameters: EffectParameters
    scan_values: dict[str, float]


@dataclass(frozen=True, eq=False)
class CandidateScores:
    """The score test of every candidate against a fitted model.

    Args:
        base: the fitted model.
        candidates: the candidates with an identifiable size.
        norm: `|z|` of each candidate, per unit of its size, `(candidate,)`.
        score: `z'r / |z|`, `(candidate,)`.
        cosine: cosine between each two `z`, `(candidate, candidate)`.
        prior_cosine: the part of it in the rows of the priors, `(candidate, candidate)`.
        parameter_shifts: change of the estimated parameters per unit of each size, `(parameter, candidate)`.
        required_signs: +1 or -1 where the size must be positive or negative, else 0, `(candidate,)`.
        random: generator of the draws.
    """

    base: EffectFit
    candidates: tuple[Candidate, ...]
    norm: np.ndarray = field(repr=False)
    score: np.ndarray = field(repr=False)
    cosine: np.ndarray = field(repr=False)
    prior_cosine: np.ndarray = field(repr=False)
    parameter_shifts: np.ndarray = field(repr=False)
    required_signs: np.ndarray = field(repr=False)
    random: np.random.Generator = field(repr=False)

    @cached_property
    def gain(self) -> np.ndarray:
        """Expected drop of `-2 log L` by each candidate alone; 0 where its size has the wrong sign."""
        return np.where(self.required_signs * self.score < 0, 0.0, self.score**2)

    @cached_property
    def size(self) -> np.ndarray:
        """Expected size of each candidate alone, in its unit."""
        return self.score / self.norm

    @cached_property
    def shift(self) -> np.ndarray:
        """Expected shift of ln(alpha) by each candidate alone."""
        return self.parameter_shifts[self.base.index(LOG_DIFFUSIVITY)] * self.size

    @cached_property
    def by_effect(self) -> dict[EffectParameters, np.ndarray]:
        """The indices of the candidates of each effect."""
        indices: dict[EffectParameters, list[int]] = {}
        for index, candidate in enumerate(self.candidates):
            indices.setdefault(candidate.effect_parameters, []).append(index)
        return {effect_parameters: np.array(own) for effect_parameters, own in indices.items()}

    def effect(self, index: int) -> EffectParameters:
        """The effect of a candidate."""
        return self.candidates[index].effect_parameters

    def candidates_of(self, effect_parameters: EffectParameters) -> list[int]:
        """The indices of the candidates of one effect, largest gain first."""
        own = self.by_effect.get(effect_parameters, np.array([], dtype=int))
        return own[np.argsort(-self.gain[own])].tolist()

    def best(self, count: int) -> list[int]:
        """The index of the best candidate of each effect, largest gain first; at most `count`."""
        best = [int(own[np.argmax(self.gain[own])]) for own in self.by_effect.values()]
        return sorted(best, key=lambda index: -self.gain[index])[:count]

    def largest_shifts(self, p: float, count: int) -> list[int]:
        """Significant candidates with a shift of ln(alpha) too large for the linear prediction, largest shift first."""
        threshold = self.threshold(p)
        best = self.best(len(self.by_effect))
        far = [k for k in best if self.weighted_gain[k] > threshold and abs(self.shift[k]) > _LARGE_SHIFT]
        return sorted(far, key=lambda k: -abs(self.shift[k]))[:count]

    def best_penalised(self, count: int) -> list[int]:
        """The best candidates by their gain less the penalty for their positions and hours; at most `count`."""
        best = self.best(len(self.by_effect))
        return sorted(best, key=lambda k: bic_penalty(self.base, (self.effect(k),)) - self.gain[k])[:count]

    @cached_property
    def by_chance(self) -> ChanceGains:
        """What chance alone gives to the candidates."""
        spread = self.base.noise.log_power_std
        return ChanceGains(self.cosine, self.prior_cosine, self.required_signs, spread, self.random)

    @property
    def weighted_gain(self) -> np.ndarray:
        """The gain of each candidate times its weight, by which significance is judged."""
        return self.gain * self.by_chance.weight

    def weight_of(self, effect_parameters: EffectParameters) -> float:
        """The weight of the gain of an effect; 1 for one that is no candidate."""
        own = self.by_effect.get(effect_parameters, np.array([], dtype=int))
        return float(self.by_chance.weight[own].max(initial=1.0))

    def p_value(self, gain: float, weight: float = 1.0) -> float:
        """Probability that the largest gain in the entire library exceeds a value by chance; at least 1/(draws + 1)."""
        return self.by_chance.p_value(weight * gain)

    def threshold(self, p: float, weight: float = 1.0) -> float:
        """The gain that the largest one in the entire library exceeds by chance with this probability."""
        return self.by_chance.threshold(p) / weight

    @cached_property
    def pair_gain(self) -> np.ndarray:
        """Expected drop of `-2 log L` by each pair; 0 for candidates of one effect and where a sign is wrong."""
        return self._pair_gains(self.score)

    def _pair_gains(self, score: np.ndarray) -> np.ndarray:
        determinant = self._one_minus_cosine_squared
        own, other = score[:, None] - self.cosine * score[None, :], score[None, :] - self.cosine * score[:, None]
        total = score[:, None] * own + score[None, :] * other
        total = np.where(determinant > 0, total / np.maximum(determinant, _COLLINEAR), 0)
        wrong = (self.required_signs[:, None] * own < 0) | (self.required_signs[None, :] * other < 0)
        return np.where(wrong, 0.0, total)

    @cached_property
    def _one_minus_cosine_squared(self) -> np.ndarray:
        """`1 - cosine^2`, 0 for candidates that are collinear or of the same effect."""
        determinant = 1.0 - self.cosine**2
        names = [(c.effect_parameters.effect.name, c.effect_parameters.effect.target) for c in self.candidates]
        code = {name: i for i, name in enumerate(dict.fromkeys(names))}
        group = np.array([code[name] for name in names], dtype=int)
        determinant[group[:, None] == group[None, :]] = 0.0
        return np.where(determinant < _COLLINEAR, 0.0, determinant)

    def best_pairs(self, count: int) -> list[tuple[int, int]]:
        """The best pairs of effects, each at its best candidates, largest gain first; at most `count`."""
        gain = np.triu(self.pair_gain)
        pairs: dict[frozenset[EffectParameters], tuple[int, int]] = {}
        for flat in np.argsort(-gain, axis=None)[: 50 * count]:
            i, j = (int(k) for k in np.unravel_index(flat, gain.shape))
            pairs.setdefault(frozenset((self.effect(i), self.effect(j))), (i, j))
            if gain[i, j] <= 0 or len(pairs) == count:
                break
        return list(pairs.values())

    def pair_threshold(self, p: float) -> float:
        """The gain that the best pair exceeds by chance with this probability."""
        largest = [
            self._pair_gains(draw).max(initial=0.0) for draw in draw_scores(self.cosine, _PAIR_DRAWS, self.random)
        ]
        return float(np.quantile(largest, 1 - p)) if len(self.candidates) > 1 else np.inf

    def joint_gain(self, chosen: tuple[int, ...]) -> float:
        """Expected drop of `-2 log L` by some candidates together."""
        k = np.array(chosen)
        return float(self.score[k] @ np.linalg.lstsq(self.cosine[np.ix_(k, k)], self.score[k], rcond=None)[0])

    def joint_prediction(self, chosen: tuple[int, ...]) -> tuple[np.ndarray, dict[str, float]]:
        """Expected sizes of some candidates together, and the shift of each estimated parameter of the base."""
        k = np.array(chosen)
        size = np.linalg.lstsq(self.cosine[np.ix_(k, k)], self.score[k], rcond=None)[0] / self.norm[k]
        shifts = self.parameter_shifts[:, k] @ size
        return size, dict(zip(self.base.parameters.estimated_names, shifts.tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class CandidateJacobian:
    """The candidates for a fit.

    Args:
        candidates: the effects that are not in the fit, at each point of their grids.
        columns: derivative of the binned readings by each size, K per unit of the size, `(candidate, reading)`.
    """

    candidates: tuple[Candidate, ...]
    columns: np.ndarray = field(repr=False)


def score_candidates(base: EffectFit, jacobian: CandidateJacobian, random: np.random.Generator) -> CandidateScores:
    """Score every candidate against a fitted model.

    Args:
        base: the fitted model.
        jacobian: the candidates with their derivatives.
        random: generator of the draws for significance levels.
    """
    candidates, z = jacobian.candidates, jacobian.columns
    white = z @ base.noise.whitening.T
    white = np.concatenate([white, np.zeros((len(white), base.jacobian.shape[0] - white.shape[1]))], axis=1)
    size = np.maximum(np.linalg.norm(base.jacobian, axis=0), 1e-300)
    Q, R = np.linalg.qr(base.jacobian / size)
    projection = white @ Q
    shifts = -np.linalg.lstsq(R, projection.T, rcond=1e-12)[0] / size[:, None]
    rest = white - projection @ Q.T
    rest -= (rest @ Q) @ Q.T  # once more, against round-off
    norm = np.linalg.norm(rest, axis=1)
    identifiable = norm > _NOT_IDENTIFIABLE * np.maximum(np.linalg.norm(white, axis=1), 1e-300)
    keep = np.flatnonzero(identifiable & (norm > 0))
    unit = rest[keep] / norm[keep, None]
    signs = np.array([_required_sign(candidates[k].effect_parameters) for k in keep], dtype=float)
    return CandidateScores(
        base,
        tuple(candidates[k] for k in keep),
        norm[keep],
        unit @ base.residual,
        unit @ unit.T,
        unit[:, z.shape[1] :] @ unit[:, z.shape[1] :].T,
        shifts[:, keep],
        signs,
        random,
    )


def candidate_jacobian(problem: DiagnosisProblem, base: EffectFit) -> CandidateJacobian:
    """The derivative of the readings by every effect that is not in a fitted model, at every point of its grid.

    The derivative is taken at the linear part of the base, whose temperatures differ little from those of the base.
    This is accurate enough for a ranking; a refit is exact.
    """
    effects = [effect for effect in problem.library if not any(same_effect_and_target(effect, o) for o in base.active)]
    return jacobian_of_effects(problem, base, effects, {})


def jacobian_of_effects(
    problem: DiagnosisProblem, base: EffectFit, effects: Sequence[EffectParameters], known: Mapping[str, float]
) -> CandidateJacobian:
    """The same for some effects, with their known positions, hours and temperatures; the other ones are scanned."""
    candidates = [candidate for effect in effects for candidate in _scan_candidates(problem, effect, known)]
    points = [(candidate.effect_parameters.names[0], candidate.scan_values) for candidate in candidates]
    return CandidateJacobian(
        tuple(candidates), first_order_columns(problem.model, problem.bins, base.parameters, points)
    )


def same_effect_and_target(one: EffectParameters, other: EffectParameters) -> bool:
    """Whether both are forms of the same effect on the same target."""
    return (one.effect.name, one.effect.target) == (other.effect.name, other.effect.target)


def _scan_candidates(
    problem: DiagnosisProblem, effect_parameters: EffectParameters, known: Mapping[str, float]
) -> list[Candidate]:
    """An effect at every point of its grid, with the known parameters at their values."""
    names = effect_parameters.full_names
    grid = effect_parameters.effect.scan(problem.search_range)
    points = [tuple((names[key], known.get(key, value)) for key, value in point.items()) for point in grid]
    return [Candidate(effect_parameters, dict(point)) for point in dict.fromkeys(points)]


def _required_sign(effect_parameters: EffectParameters) -> int:
    """The sign that the size of an effect must have, 0 for either."""
    size = effect_parameters.effect.parameters[0]
    if size.lower == 0.0:
        return 1
    return -1 if size.upper == 0.0 else 0
