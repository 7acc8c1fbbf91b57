"""The ranking of corrections of a record, to first order about the plain model at a few diffusivities.

Corrected readings change the residual only. A corrected face changes the predictions by a convolution with the wall's
response to that face.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy

from ...case.mixups import FACE_COLUMNS
from ...inference.likelihood import LOG_DIFFUSIVITY
from ..effect_fit import EffectFit
from ..model_with_effects import face_impulse_response, linearise
from ..problem import DiagnosisProblem
from .corrections import ClockCorrection, Correction, other_clock, other_units, rearranged

_SPREAD = (0.2, 0.35, 0.6, 1.0, 1.7, 2.9, 5.0)  # times the prior diffusivity, at which the hypotheses are ranked
_HOURS = (-12, -6, -3, -2, -1, 1, 2, 3, 6, 12)  # by which a clock may be wrong
_BREAKS = 16  # rows of the record from which on a clock may be wrong, in the first pass


@dataclass(frozen=True)
class Ranked:
    """A correction, its deviance to first order, and the logarithm of the diffusivity (over the prior one) with it."""

    correction: Correction
    deviance: float
    start: float


class RankedCorrections:
    """All corrections with their deviances to first order about the plain model at a few diffusivities."""

    def __init__(self, problem: DiagnosisProblem, reference: EffectFit):
        self.problem, self.noise = problem, reference.noise
        names = problem.estimated_names(())
        weight = 1.0 / np.asarray(problem.parameters.prior_std)[problem.parameters.indices(names)]
        low, high = (np.log(end / problem.case.wall.diffusivity_prior) for end in problem.diffusivity_bounds)
        values = {float(np.clip(np.log(factor), low, high)) for factor in _SPREAD}
        self.points = []
        for value in sorted(values | {float(reference.parameters[LOG_DIFFUSIVITY])}):
            parameters = problem.parameters.with_values({LOG_DIFFUSIVITY: value})
            predicted, slope = linearise(problem.model, problem.bins, parameters, names, linear=True)
            design = np.concatenate([self.noise.whitening @ slope.T, np.diag(weight)])
            basis, _ = np.linalg.qr(design / np.maximum(np.linalg.norm(design, axis=0), 1e-300))
            self.points.append((value, predicted, face_impulse_response(problem.model, parameters), basis))

    def ranked(self, correction: Correction) -> Ranked:
        """`-2 log L` of corrected readings less their number, at the best of the diffusivities."""
        record, problem = self.problem.record, self.problem
        change, readings = correction.record.faces - record.faces, problem.readings_of(correction.record)
        residuals = []
        for _, predicted, response, _ in self.points:
            if change.any():
                caused = scipy.signal.fftconvolve(change.T[:, :, None], response, axes=1)[:, : record.rows].sum(axis=0)
                predicted = predicted + caused
            residuals.append(problem.binned(np.nan_to_num(readings - predicted)))
        whitened = self.noise.whitening @ np.stack(residuals, axis=1)
        deviances = []
        for residual, (_, _, _, basis) in zip(whitened.T, self.points, strict=True):
            residual = np.pad(residual, (0, len(basis) - len(residual)))
            left = residual - basis @ (basis.T @ residual)
            deviances.append(float(left @ left))
        best = int(np.argmin(deviances))
        count = float(np.isfinite(readings).sum()) / problem.bins.rows_per_bin
        return Ranked(correction, deviances[best] - count, self.points[best][0])

    def best(self, count: int) -> list[Ranked]:
        """The corrections with the lowest deviances, the best of each mix-up's kind and targets."""
        best: dict[tuple[str, tuple[str, ...]], Ranked] = {}
        for correction in self._all():
            key, one = (correction.mixup.kind, correction.mixup.targets), self.ranked(correction)
            if key not in best or one.deviance < best[key].deviance:
                best[key] = one
        ordered = sorted(best.values(), key=lambda one: one.deviance)[:count]
        return [self._refined(one) for one in ordered]

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
            others = {
                near: self.ranked(other_clock(record, target, hours, near)) for near in rows if first <= near <= last
            }
            row = min(others, key=lambda near: others[near].deviance)
            ranked = others[row]
            width //= 2
        return ranked
