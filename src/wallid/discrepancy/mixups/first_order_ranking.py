"""The ranking of corrections of a record, to first order about the plain model at a few diffusivities.

Corrected readings change the residual only. A corrected face changes the predictions by a convolution with the wall's
response to that face.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
import scipy

from ...case.mixups import FACE_COLUMNS
from ...inference.likelihood import LOG_DIFFUSIVITY
from ...records.uniform_record import Record
from ..effect_fit import EffectFit
from ..model_with_effects import face_impulse_response, linearise
from ..problem import DiagnosisProblem
from .corrections import ClockCorrection, Correction, other_clock, other_units, rearranged

_SPREAD = (0.2, 0.35, 0.6, 1.0, 1.7, 2.9, 5.0)  # times the prior diffusivity, at which the hypotheses are ranked
_HOURS = (-12, -6, -3, -2, -1, 1, 2, 3, 6, 12)  # by which a clock may be wrong
_TOGETHER = 64  # corrections whose residuals are whitened together
_BREAKS = 16  # rows of the record from which on a clock may be wrong, in the first pass


@dataclass(frozen=True)
class Ranked:
    """A correction, its deviance to first order, and the logarithm of the diffusivity (over the prior one) with it."""

    correction: Correction
    deviance: float
    start: float

    @property
    def has_exchanged_faces(self) -> bool:
        """Whether the two faces change places, or all positions, which gives the same readings."""
        return self.correction.mixup.kind in ("faces", "mirrored")


class RankedCorrections:
    """All corrections with their deviances to first order about the plain model at a few diffusivities."""

    def __init__(self, problem: DiagnosisProblem, reference: EffectFit):
        self.problem, self.noise = problem, reference.noise
        names = problem.estimated_names(())
        weight = 1.0 / np.asarray(problem.parameters.prior_std)[problem.parameters.indices(names)]
        low, high = (np.log(end / problem.case.wall.diffusivity_prior) for end in problem.diffusivity_bounds)
        values = {float(np.clip(np.log(factor), low, high)) for factor in _SPREAD}
        self.starts = sorted(values | {float(reference.parameters[LOG_DIFFUSIVITY])})
        # at each of the diffusivities: the readings, the transforms of the responses to the faces `(face, frequency,
        # instrument)`, and what the parameters explain of whitened readings `(reading, param)`
        points = [self._point(start, names, weight) for start in self.starts]
        self._predicted, self._transfers, self._bases = (np.stack(part) for part in zip(*points, strict=True))

    def _point(self, start: float, names: Sequence[str], weight: np.ndarray) -> tuple[np.ndarray, ...]:
        """The plain model at a diffusivity; `weight` are one over the prior standard deviations of the parameters."""
        problem = self.problem
        parameters = problem.parameters.with_values({LOG_DIFFUSIVITY: start})
        predicted, slope = linearise(problem.model, problem.bins, parameters, names, linear=True)
        design = np.concatenate([self.noise.whitening @ slope.T, np.diag(weight)])
        basis, _ = np.linalg.qr(design / np.maximum(np.linalg.norm(design, axis=0), 1e-300))
        response = face_impulse_response(problem.model, parameters)
        return predicted, np.fft.rfft(response, self._length, axis=1), basis[: slope.shape[1]]

    @property
    def _length(self) -> int:
        """Length of the transforms: twice the record, so that the end of a convolution does not fall on its start."""
        return scipy.fft.next_fast_len(2 * self.problem.record.rows, real=True)

    def _residuals(self, record: Record, readings: np.ndarray) -> np.ndarray:
        """The binned residual of a corrected record at each of the diffusivities, `(point, reading)`."""
        stated, predicted = self.problem.record, self._predicted
        change = record.faces - stated.faces
        if change.any():
            spectrum = np.fft.rfft(change, self._length, axis=0)
            caused = np.einsum("fs,psfk->pfk", spectrum, self._transfers)
            predicted = predicted + np.fft.irfft(caused, self._length, axis=1)[:, : stated.rows]
        return self.problem.binned(np.nan_to_num(readings - predicted))

    def ranked(self, corrections: Sequence[Correction]) -> list[Ranked]:
        """`-2 log L` of corrected readings less the number of their means, each at the best of the diffusivities."""
        readings = [self.problem.readings_of(one.record) for one in corrections]
        pairs = zip(corrections, readings, strict=True)
        residuals = np.stack([self._residuals(one.record, own) for one, own in pairs], axis=1)
        whitened = residuals @ self.noise.whitening.T  # (point, correction, reading)
        deviances = np.sum(whitened**2, axis=2) - np.sum((whitened @ self._bases) ** 2, axis=2)
        counts = [np.count_nonzero(self.problem.binned(np.isfinite(own).astype(float))) for own in readings]
        best = np.argmin(deviances, axis=0)
        lowest = deviances.min(axis=0) - np.array(counts)
        return [
            Ranked(correction, float(deviance), self.starts[point])
            for correction, deviance, point in zip(corrections, lowest, best, strict=True)
        ]

    def best(self, count: int) -> list[Ranked]:
        """The corrections with the lowest deviances, the best of each mix-up's kind and targets; and exchanged faces.

        The derivatives by the parameters are those of the faces as stated, so exchanged faces are ranked too low.
        """
        best: dict[tuple[str, tuple[str, ...]], Ranked] = {}
        corrections = self._all()
        while some := list(islice(corrections, _TOGETHER)):
            for one in self.ranked(some):
                key = one.correction.mixup.kind, one.correction.mixup.targets
                if key not in best or one.deviance < best[key].deviance:
                    best[key] = one
        ordered = enumerate(sorted(best.values(), key=lambda one: one.deviance))
        return [self._refined(one) for place, one in ordered if place < count or one.has_exchanged_faces]

    def _all(self) -> Iterator[Correction]:
        record, case = self.problem.record, self.problem.case
        yield from rearranged(case, record)
        yield from other_units(record)
        columns = (*FACE_COLUMNS, *self.problem.instruments)
        for target in (*columns, "") if record.names else columns:
            for hours in _HOURS:
                yield other_clock(record, target, hours, 0)
        breaks = np.linspace(0, record.rows, _BREAKS + 2)[1:-1].astype(int)
        for target in columns:
            for hours in (-1, 1):
                for row in breaks.tolist():
                    yield other_clock(record, target, hours, row)

    def _refined(self, ranked: Ranked) -> Ranked:
        """A clock that is wrong from some row on, with the row found more closely."""
        correction = ranked.correction
        if not isinstance(correction, ClockCorrection) or correction.row == 0:
            return ranked
        record, target, hours, row = self.problem.record, correction.target, correction.hours, correction.row
        width = record.rows // (_BREAKS + 1)
        first, last = width // 2, record.rows - width // 2  # a break at an end would correct hardly anything
        while width > 1:
            rows = [row + k * width // 2 for k in (-2, -1, 0, 1, 2)]
            rows = [near for near in rows if first <= near <= last]
            others = self.ranked([other_clock(record, target, hours, near) for near in rows])
            row, ranked = min(zip(rows, others, strict=True), key=lambda pair: pair[1].deviance)
            width //= 2
        return ranked
