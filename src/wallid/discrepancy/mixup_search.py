"""The search for a mix-up of columns, units, places or clocks that explains a record better than the plain model.

Each hypothesis corrects the readings. The corrected readings are compared with the plain model first at a few
diffusivities, to first order in all other parameters: corrected readings change the residual only, and a corrected
face changes the predictions by a convolution with the wall's response to that face. The best hypotheses are
then fitted in full.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import scipy

from ..case.case_definition import Case
from ..case.mixups import FACE_COLUMNS, Mixup, MixupKind, visible_mixups
from ..estimation.materials import LENGTH_UNITS, implausible
from ..inference.likelihood import LOG_DIFFUSIVITY
from ..inference.noise_covariance import NoiseCovariance
from ..records.uniform_record import Record
from .acceptance import RIVAL
from .effect_fit import EffectFit, refit
from .model_with_effects import face_impulse_response, linearise
from .problem import DiagnosisProblem, diagnosis_problem

_SPREAD = (0.2, 0.35, 0.6, 1.0, 1.7, 2.9, 5.0)  # times the prior diffusivity, at which the hypotheses are ranked
_HOURS = (-12, -6, -3, -2, -1, 1, 2, 3, 6, 12)  # by which a clock may be wrong
_BREAKS = 16  # rows of the record from which on a clock may be wrong, in the first pass
_FITTED = 4  # hypotheses that are fitted in full, at most
_WORTH_FITTING = 0.5  # of the gain that is needed, and of the best gain, to first order
_CLEAR_GAIN = 40.0  # drop of -2 log L for a mix-up: far more than the best of some hundred hypotheses by chance
_HOUR = 3600.0
_LAGS = (0.25, 1.0)  # h, from which the fit of a lag starts
_THICK = 5.0  # m, from which on another unit of length is tried


@dataclass(frozen=True, eq=False)
class Correction:
    """A mix-up, and the readings without it.

    Args:
        mixup: what was mixed up.
        record: the rows used, corrected; NaN where the correction leaves no reading of a sensor or plate.
    """

    mixup: Mixup
    record: Record

    def applied_to(self, case: Case) -> Case:
        """The case with the corrected readings of the rows used."""
        return replace(case, record=self.record, choices=replace(case.choices, diagnose_days=None))


@dataclass(frozen=True, eq=False)
class MixupFit:
    """The plain model fitted to the readings without a mix-up.

    Args:
        mixup: what was mixed up.
        case: the corrected case.
        deviance: see the function.
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
    ranked = _RankedCorrections(plain.problem, reference).best(_FITTED)
    to_first_order = reference.cost - plain.problem.bins.nonempty  # all under the reference's noise
    gains = [to_first_order - one.deviance for one in ranked]
    needed = _WORTH_FITTING * max([of_reference - highest, *gains])
    fits = [
        _fit(plain.problem, one.correction, noise, one.start)
        for one, gain in zip(ranked, gains, strict=True)
        if gain >= needed
    ]
    best = min(fits, key=lambda fit: fit.deviance, default=None)
    return best if best is not None and best.deviance < highest else None


def copied_sensor(plain: EffectFit) -> MixupFit | None:
    """A column of an inner sensor that is a copy of another; the one that fits worse is left out."""
    problem = plain.problem
    case, record = replace(problem.case, record=problem.record), problem.record
    fits = []
    for mixup in visible_mixups(case):
        for name in mixup.targets:
            if mixup.kind != "copy" or name not in record.names:
                continue
            corrected = _with_column(record, name, np.full(record.rows, np.nan))
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
        scaled = _scaled(case, metres)
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
    starts = (plain.parameters.with_values({lag.names[0]: _HOUR * hours}) for hours in _LAGS)
    fits = [refit(problem, (lag,), start, plain.noise) for start in starts]
    return any(deviance(fit, plain.noise) + RIVAL < mixup_fit.deviance for fit in fits)


def _scaled(case: Case, metres: float) -> Case:
    """The case with its lengths taken in another unit."""
    wall = replace(
        case.wall,
        length=metres * case.wall.length,
        layers=tuple(replace(layer, thickness=metres * layer.thickness) for layer in case.wall.layers),
    )
    sensors = tuple(
        replace(sensor, position=metres * sensor.position, position_std=metres * sensor.position_std)
        for sensor in case.sensors
    )
    return replace(case, wall=wall, sensors=sensors)


def _refit_with_noise(problem: DiagnosisProblem, noise: NoiseCovariance, start: float = 0.0) -> EffectFit:
    """The plain model fitted under noise of the same size and autocorrelation as another.

    Args:
        start: logarithm of the first diffusivity over the prior one.
    """
    parameters = problem.parameters.with_values({LOG_DIFFUSIVITY: start})
    own = problem.noise_shape(parameters).covariance_like(noise)
    return refit(problem, (), parameters, own)


@dataclass(frozen=True)
class _Ranked:
    """A correction, its deviance to first order, and the logarithm of the diffusivity (over the prior one) with it."""

    correction: Correction
    deviance: float
    start: float


def _fit(problem: DiagnosisProblem, correction: Correction, noise: NoiseCovariance, start: float) -> MixupFit:
    """The plain model fitted to corrected readings; `start` as in `_refit_with_noise`."""
    case = correction.applied_to(problem.case)
    fit = _refit_with_noise(diagnosis_problem(case), noise, start)
    return MixupFit(correction.mixup, case, deviance(fit, noise))


class _RankedCorrections:
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

    def ranked(self, correction: Correction) -> _Ranked:
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
        return _Ranked(correction, deviances[best] - count, self.points[best][0])

    def best(self, count: int) -> list[_Ranked]:
        """The corrections with the lowest deviances, the best of each mix-up's kind and targets."""
        best: dict[tuple[str, tuple[str, ...]], _Ranked] = {}
        for correction in self._all():
            key, one = (correction.mixup.kind, correction.mixup.targets), self.ranked(correction)
            if key not in best or one.deviance < best[key].deviance:
                best[key] = one
        ordered = sorted(best.values(), key=lambda one: one.deviance)[:count]
        return [self._refined(one) for one in ordered]

    def _all(self) -> Iterator[Correction]:
        record, case = self.problem.record, self.problem.case
        yield from _rearranged(case, record)
        yield from _other_units(record)
        columns = (*FACE_COLUMNS, *self.problem.instruments)
        for target in (*columns, "") if record.names else columns:
            for hours in _HOURS:
                yield _other_clock(record, target, hours, 0)
        breaks = np.linspace(0, record.rows, _BREAKS + 2)[1:-1].astype(int)
        for target in columns:
            for hours in (-1, 1):
                for row in breaks.tolist():
                    yield _other_clock(record, target, hours, row)

    def _refined(self, ranked: _Ranked) -> _Ranked:
        """A clock that is wrong from some row on, with the row found more closely."""
        correction = ranked.correction
        if not isinstance(correction, _ClockCorrection) or correction.row == 0:
            return ranked
        record, target, hours, row = self.problem.record, correction.target, correction.hours, correction.row
        width = record.rows // (_BREAKS + 1)
        first, last = width // 2, record.rows - width // 2  # a break at an end would correct hardly anything
        while width > 1:
            rows = [row + k * width // 2 for k in (-2, -1, 0, 1, 2)]
            others = {
                near: self.ranked(_other_clock(record, target, hours, near)) for near in rows if first <= near <= last
            }
            row = min(others, key=lambda near: others[near].deviance)
            ranked = others[row]
            width //= 2
        return ranked


@dataclass(frozen=True, eq=False)
class _ClockCorrection(Correction):
    """A correction of a clock: the column, the hours and the first row at which it is wrong."""

    target: str
    hours: int
    row: int


def _rearranged(case: Case, record: Record) -> Iterator[Correction]:
    """Faces or sensors in another order."""
    sensors, names, plates = record.sensors, record.names, _plates(record)
    mirrored = "all positions are counted from the right face: count them from the left one"
    exchanged = "the two faces are exchanged: exchange [record] left and right"
    kind, first, second = _faces_or_positions(case, record, exchanged, mirrored)
    words = f"{first} (or, which gives the same readings, {second})" if names and not plates else exchanged
    kind = kind if names and not plates else "faces"
    yield Correction(Mixup(kind, ("left", "right"), words), replace(record, faces=record.faces[:, ::-1]))
    if len(plates) == 2:
        words = "the two plates are exchanged: exchange [record] flux_left and flux_right"
        left, right = (record.regressors[name] for name in plates)
        exchanged_plates = _with_column(_with_column(record, plates[0], right), plates[1], left)
        yield Correction(Mixup("exchanged", tuple(plates), words), exchanged_plates)
    if len(names) > 2:
        words = "the sensors are stated in the reverse order: reverse their columns, or their positions"
        yield Correction(Mixup("order", names, words), replace(record, sensors=sensors[:, ::-1]))
    for one, other in combinations(range(len(names)), 2):
        swapped = sensors.copy()
        swapped[:, [one, other]] = swapped[:, [other, one]]
        pair = (names[one], names[other])
        words = f"{pair[0]} and {pair[1]} are exchanged: exchange their columns, or their positions"
        yield Correction(Mixup("exchanged", pair, words), replace(record, sensors=swapped))


def _faces_or_positions(case: Case, record: Record, exchanged: str, mirrored: str) -> tuple[MixupKind, str, str]:
    """Which of the two is more likely: the outer face has the larger daily range where an outer face is known."""
    outside = ("left", "right").index(case.wall.outside)
    ranges = np.ptp(np.diff(record.faces, axis=0), axis=0)
    if ranges[1 - outside] > ranges[outside]:
        return "faces", exchanged, mirrored
    return "mirrored", mirrored, exchanged


def _other_units(record: Record) -> Iterator[Correction]:
    """One column in degrees Fahrenheit or in kelvin."""
    for unit, scale, offset in (("degF", 1.8, 32.0), ("K", 1.0, 273.15)):
        for name in (*FACE_COLUMNS, *record.names):
            corrected = _with_column(record, name, (_column(record, name) - offset) / scale)
            yield Correction(Mixup("unit", (name,), f"{name} is in {unit}: convert the column to degC"), corrected)


def _column(record: Record, name: str) -> np.ndarray:
    """The readings of a face or of an inner sensor, degC, or of a plate, W/m2, `(time,)`."""
    if name in FACE_COLUMNS:
        return record.faces[:, FACE_COLUMNS.index(name)]
    if name in record.regressors:
        return record.regressors[name]
    return record.sensors[:, record.names.index(name)]


def _with_column(record: Record, name: str, values: np.ndarray) -> Record:
    """The record with other values in one column."""
    if name in record.regressors:
        return replace(record, regressors={**record.regressors, name: values})
    faces, sensors = record.faces.copy(), record.sensors.copy()
    if name in FACE_COLUMNS:
        faces[:, FACE_COLUMNS.index(name)] = values
    else:
        sensors[:, record.names.index(name)] = values
    return replace(record, faces=faces, sensors=sensors)


def _other_clock(record: Record, target: str, hours: int, row: int) -> _ClockCorrection:
    """A column whose clock is some hours late from a row on; with no target every inner sensor's.

    Where the record ends before the corrected time, a face keeps its nearest value and the other instruments have no
    readings.
    """
    rows, shift = np.arange(record.rows), hours * _HOUR / record.step
    source = np.where(rows >= row, rows + shift, rows)
    inside = (source <= record.rows - 1) & (source >= np.where(rows >= row, row, 0))
    corrected = record
    for name in (target,) if target else record.names:
        values = _column(record, name)
        present = np.isfinite(values)
        if not present.any():
            continue
        shifted = np.interp(source, rows[present], values[present])
        if name not in FACE_COLUMNS:
            shifted[~inside | (np.interp(source, rows, present.astype(float)) < 1.0)] = np.nan
        corrected = _with_column(corrected, name, shifted)
    if target in FACE_COLUMNS:
        sensors = np.where(inside[:, None], record.sensors, np.nan)
        plates = {name: np.where(inside, record.regressors[name], np.nan) for name in _plates(record)}
        corrected = replace(corrected, sensors=sensors, regressors={**record.regressors, **plates})
    late = f"{abs(hours)} h {'late' if hours > 0 else 'early'}"
    since = "" if row == 0 else f" from {record.stamp(row)} on"
    whose = f"the clock of {target} is" if target else "the clock of every inner sensor is"
    words = f"{whose} {late}{since}: correct its times"
    return _ClockCorrection(Mixup("clock", (target,) if target else record.names, words), corrected, target, hours, row)


def _plates(record: Record) -> list[str]:
    """The columns of the record's heat flux plates."""
    return [name for name in record.regressors if name.startswith("flux_")]
