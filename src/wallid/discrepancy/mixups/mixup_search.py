"""The search for a mix-up of columns, units, places or clocks that explains a record better than the plain model.

Each hypothesis corrects the readings. The corrected readings are ranked to first order. The best hypotheses are then
fitted in full.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...case.case_definition import Case
from ...case.mixups import FACE_COLUMNS, Mixup, visible_mixups
from ...estimation.materials import LENGTH_UNITS, implausible
from ...inference.likelihood import LOG_DIFFUSIVITY
from ...inference.noise_covariance import NoiseCovariance
from ..effect_fit import EffectFit, refit
from ..problem import DiagnosisProblem, diagnosis_problem
from ..selection.acceptance import RIVAL
from .corrections import Correction, lengths_in, with_column
from .first_order_ranking import RankedCorrections

_FITTED = 4  # hypotheses that are fitted in full, at most
_WORTH_FITTING = 0.5  # of the gain that is needed, and of the best gain, to first order
_CLEAR_GAIN = 40.0  # drop of -2 log L for a mix-up: far more than the best of some hundred hypotheses by chance
_LAGS = (900.0, 3600.0)  # s, from which the fit of a lag starts
_THICK = 5.0  # m, from which on another unit of length is tried


@dataclass(frozen=True, eq=False)
class MixupFit:
    """The plain model fitted to the readings without a mix-up.

    Args:
        mixup: what was mixed up.
        case: the corrected case.
        deviance: of `deviance()`.
    """

    mixup: Mixup
    case: Case
    deviance: float


def deviance(fit: EffectFit, reference: NoiseCovariance) -> float:
    """`-2 log L` of a fit, to compare fits to different numbers of readings::

        r' R^-1 r - n + ln |R| - ln |R_0|

    with the covariance `R_0` of the same n readings by a reference. The errors of the faces enter R, above all that of
    fluxes, as much as the wall of the fit lets them.
    """
    present = np.asarray(fit.problem.bins.counts()).T.reshape(-1) > 0
    own = -2.0 * np.log(np.diag(fit.noise.whitening)).sum()  # an empty bin has the variance 1
    _, other = np.linalg.slogdet(reference.covariance[np.ix_(present, present)])
    return float(fit.cost - present.sum() + own - other)


def best_mixup(plain: EffectFit, noise: NoiseCovariance, highest: float = math.inf) -> MixupFit | None:
    """The mix-up that explains the readings best; None where none explains them far better than the plain model.

    Args:
        plain: the fit of the plain model.
        noise: its size and autocorrelation are those of every comparison.
        highest: deviance that a mix-up has to be below.
    """
    reference = _refit_with_noise(plain.problem, noise, float(plain.parameters[LOG_DIFFUSIVITY]))
    of_reference = deviance(reference, noise)
    highest = min(highest, of_reference - _CLEAR_GAIN)
    ranked = RankedCorrections(plain.problem, reference).best(_FITTED)
    to_first_order = reference.cost - plain.problem.bins.nonempty  # all under the reference's noise
    gains = [to_first_order - one.deviance for one in ranked]
    needed = _WORTH_FITTING * max([of_reference - highest, *gains])
    chosen = [one for one, gain in zip(ranked, gains, strict=True) if gain >= needed]
    if any(one.correction.mixup.kind == "order" for one in chosen):  # exchanged faces may explain it as well
        chosen += [one for one in ranked if one.has_exchanged_faces and one not in chosen]
    fits = [_fit(plain.problem, one.correction, noise, one.start) for one in chosen]
    best = min(fits, key=lambda fit: fit.deviance, default=None)
    return _with_rivals(best, fits) if best is not None and best.deviance < highest else None


def _with_rivals(best: MixupFit, fits: Sequence[MixupFit]) -> MixupFit:
    """The best mix-up, its words with those of the others that the readings cannot exclude."""
    close = [best]
    for fit in sorted(fits, key=lambda fit: fit.deviance):
        if fit.deviance < best.deviance + RIVAL and not any(_same_record(fit, other) for other in close):
            close.append(fit)
    words = "; or, which the readings cannot exclude: ".join(fit.mixup.words for fit in close)
    return replace(best, mixup=replace(best.mixup, words=words))


def _same_record(one: MixupFit, other: MixupFit) -> bool:
    """Whether two mix-ups correct a record in the same way."""
    columns = [
        {"faces": record.faces, "sensors": record.sensors, **record.regressors}
        for record in (one.case.record, other.case.record)
    ]
    return all(np.array_equal(*(each[name] for each in columns), equal_nan=True) for name in columns[0])


def copied_sensor(plain: EffectFit) -> MixupFit | None:
    """A column of an inner sensor that is a copy of another; the one that fits worse is left out."""
    problem = plain.problem
    case, record = replace(problem.case, record=problem.record), problem.record
    fits = []
    for mixup in visible_mixups(case):
        for name in mixup.targets:
            if mixup.kind != "copy" or name not in record.names:
                continue
            corrected = with_column(record, name, np.full(record.rows, np.nan))
            if np.isfinite(corrected.sensors).any():
                start = float(plain.parameters[LOG_DIFFUSIVITY])
                fits.append(_fit(problem, Correction(mixup, corrected), plain.noise, start))
    return min(fits, key=lambda fit: fit.deviance, default=None)


def wrong_length_unit(plain: EffectFit) -> MixupFit | None:
    """Lengths in another unit than the metre, where the diffusivity is that of no material but would be one with it.

    The readings depend on the diffusivity over the squared length only, so they fit as well: the evidence is the value.
    A wall that is thicker than walls are is evidence too: within its bounds no diffusivity may then fit.
    """
    case = plain.problem.case
    prior = case.wall.diffusivity_prior
    if not implausible(plain.diffusivity, prior) and case.wall.length < _THICK:
        return None
    fits: dict[str, tuple[EffectFit, Case, float]] = {}
    highest = deviance(plain, plain.noise) + _CLEAR_GAIN
    for unit, metres in LENGTH_UNITS.items():
        scaled = lengths_in(case, metres)
        fit = _refit_with_noise(diagnosis_problem(scaled), plain.noise)
        if not implausible(fit.diffusivity, prior) and (own := deviance(fit, plain.noise)) < highest:
            fits[unit] = fit, scaled, own
    lowest = min((own for _, _, own in fits.values()), default=0.0)
    close = {unit: fit for unit, (fit, _, own) in fits.items() if own < lowest + RIVAL}
    if not close:
        return None
    unit, *others = sorted(close, key=lambda name: abs(math.log(close[name].diffusivity / prior)))
    values = ", or ".join(f"with them in {name} {close[name].diffusivity:.3g} m2/s" for name in others)
    words = (
        f"the lengths are in {unit}, not in m: with them in m the diffusivity is {close[unit].diffusivity:.3g} m2/s"
        f"{f' ({values}, which the readings cannot exclude)' if others else ''}"
    )
    _, scaled, own = fits[unit]
    return MixupFit(Mixup("length_unit", (), words), scaled, own)


def is_rather_a_lag(plain: EffectFit, mixup_fit: MixupFit) -> bool:
    """Whether a lag of one instrument explains the readings far better than a late clock of the same instrument."""
    mixup = mixup_fit.mixup
    if mixup.kind != "clock" or len(mixup.targets) != 1:
        return False
    problem, (column,) = plain.problem, mixup.targets
    kind, target = ("sensor_lag", column)
    if column in FACE_COLUMNS:
        kind, target = "face_lag", column.removesuffix(" face")
    elif column not in problem.record.names:
        kind, target = "plate_lag", column.removeprefix("flux_")
    lag = next(one for one in problem.library if one.effect.name == kind and problem.target_name(one.effect) == target)
    starts = (plain.parameters.with_values({lag.names[0]: seconds}) for seconds in _LAGS)
    fits = [refit(problem, (lag,), start, plain.noise) for start in starts]
    return any(deviance(fit, plain.noise) + RIVAL < mixup_fit.deviance for fit in fits)


def _refit_with_noise(problem: DiagnosisProblem, noise: NoiseCovariance, start: float = 0.0) -> EffectFit:
    """The plain model fitted under noise of the same size and autocorrelation as another.

    Args:
        start: logarithm of the first diffusivity over the prior one.
    """
    parameters = problem.parameters.with_values({LOG_DIFFUSIVITY: start})
    own = problem.noise_shape(parameters).covariance_like(noise)
    return refit(problem, (), parameters, own)


def _fit(problem: DiagnosisProblem, correction: Correction, noise: NoiseCovariance, start: float) -> MixupFit:
    """The plain model fitted to corrected readings; `start` as in `_refit_with_noise`."""
    case = correction.applied_to(problem.case)
    fit = _refit_with_noise(diagnosis_problem(case), noise, start)
    return MixupFit(correction.mixup, case, deviance(fit, noise))
