"""Mix-ups of columns, units and clocks that are visible in a record without a model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from .._internal.units import DAY
from ..records.reading_pipeline import PLATES
from .case_definition import Case
from .wall_and_sensors import SIDES

MixupKind = Literal["faces", "order", "mirrored", "exchanged", "copy", "unit", "clock", "length_unit", "flux_sign"]

_EQUAL_SHARE = 0.98  # of the rows in which a copy has the value of its original
_MIN_DISTINCT = 5  # values of a column, below which it is too constant to be compared
_FAR_OUTSIDE = 3.0  # K, of a sensor's mean beyond both faces'
_ALWAYS = 0.98  # of the rows in which a sensor is warmer, or colder, than both faces
_AMPLITUDE_RATIO = 1.3  # of the daily amplitudes of two sensors, above the noise, from which their order counts
_CLEAR_AMPLITUDE = 5.0  # of a daily amplitude over the noise
_FLUX_CORRELATION = -0.7  # of the daily means of flux and what drives it, not centred; sound records had -0.65 at least
_FEW_DAYS, _FLUX_CORRELATION_OF_FEW_DAYS = 3, -0.9
_PEAK = 8.0  # of the power at a period over that beside it
_CLEAR_PEAK, _LONG_ENOUGH = 16.0, 10.0  # where there is one at 24 h too; periods in the record
_PERIODS = (  # of the day's cycle in a record with wrong times, in days, and what then is wrong
    (0.5, "the times run half as fast as the clock: is the step twice as long?"),
    (2.0, "the times run twice as fast as the clock: is the step half as long?"),
    (1.0 / 60.0, "are the times in minutes? Seconds are taken where a time is a number"),
    (1.0 / 3600.0, "are the times in hours? Seconds are taken where a time is a number"),
)


FACE_COLUMNS = ("left face", "right face")
"""Names of the face columns in mix-ups."""


@dataclass(frozen=True)
class Mixup:
    """A mistake in a case that explains a record: columns, units, places or clocks that were mixed up.

    Args:
        kind: of the mistake, as in result.json.
        targets: the columns concerned; empty where all are.
        words: what is mixed up and what to change in the case.
    """

    kind: MixupKind
    targets: tuple[str, ...]
    words: str

    def to_dict(self) -> dict[str, Any]:
        """The entry of result.json."""
        return {"kind": self.kind, "targets": list(self.targets), "words": self.words}


def visible_mixups(case: Case) -> tuple[Mixup, ...]:
    """The mix-ups that are certain without a model: copies, units, the sign of a flux, the step of the record."""
    return (*_copies(case), *_units(case), *_flux_signs(case), *_steps(case))


def temperature_columns(case: Case) -> dict[str, np.ndarray]:
    """The temperature columns by name: both faces, then the inner sensors, degC, `(time,)` each."""
    record = case.record
    faces = dict(zip(FACE_COLUMNS, record.faces.T, strict=True))
    return faces | dict(zip(record.names, record.sensors.T, strict=True))


def _copies(case: Case) -> Iterator[Mixup]:
    columns = list(temperature_columns(case).items())
    for k, (name, values) in enumerate(columns):
        for other, others in columns[:k]:
            both = np.isfinite(values) & np.isfinite(others) & ~case.record.broken
            if both.sum() < _MIN_DISTINCT or len(np.unique(values[both])) < _MIN_DISTINCT:
                continue
            if np.mean(values[both] == others[both]) >= _EQUAL_SHARE:
                words = f"{name} is a copy of {other}: one of the two columns is stated wrongly, or was written twice"
                yield Mixup("copy", (name, other), words)


def _units(case: Case) -> Iterator[Mixup]:
    """Columns that fit the others only after a conversion from degrees Fahrenheit or kelvin."""
    columns = {name: values[np.isfinite(values)] for name, values in temperature_columns(case).items()}
    means = {name: float(values.mean()) for name, values in columns.items() if len(values)}
    for name, mean in means.items():
        others = [other for key, other in means.items() if key != name]
        if len(others) < 2 or min(others) - _FAR_OUTSIDE <= mean <= max(others) + _FAR_OUTSIDE:
            continue
        for unit, converted in (("degF", (mean - 32.0) / 1.8), ("K", mean - 273.15)):
            if min(others) - _FAR_OUTSIDE <= converted <= max(others) + _FAR_OUTSIDE:
                words = (
                    f"{name} seems to be in {unit}: its mean is {mean:.3g}, that of the others {min(others):.3g} to "
                )
                words += f"{max(others):.3g} degC; convert the column"
                yield Mixup("unit", (name,), words)
                break


def _flux_signs(case: Case) -> Iterator[Mixup]:
    """Fluxes that run from the cold to the warm face: positive is along +x, from left to right.

    The flux of a wall that warms or cools slowly is, over `k / L`,

        q_left = dT + L^2/alpha (T_l'/3 + T_r'/6),      q_right = dT - L^2/alpha (T_l'/6 + T_r'/3)

    so what the wall stores may run against the temperature difference.
    """
    record, wall = case.record, case.wall
    difference = record.faces[:, 0] - record.faces[:, 1]
    stored = wall.length**2 / wall.diffusivity_prior * np.gradient(record.faces, record.step, axis=0)
    for key, shares in zip(PLATES, ((1.0 / 3.0, 1.0 / 6.0), (-1.0 / 6.0, -1.0 / 3.0)), strict=True):
        if key not in record.regressors:
            continue
        flux, driven = (daily_means(case, one) for one in (record.regressors[key], difference + stored @ shares))
        both = np.isfinite(flux) & np.isfinite(driven)
        q, d = flux[both], driven[both]
        against = float(q @ d) / max(float(np.linalg.norm(q) * np.linalg.norm(d)), 1e-300)
        if against < (_FLUX_CORRELATION if both.sum() >= _FEW_DAYS else _FLUX_CORRELATION_OF_FEW_DAYS):
            words = f"{key} runs against the temperature difference: positive is along +x, from left to right; "
            yield Mixup("flux_sign", (key,), words + "change the sign of the column, or exchange the faces")


def _steps(case: Case) -> Iterator[Mixup]:
    """Times that run too fast or too slowly: the day's cycle then has another period.

    A strong cycle of half a day is the second harmonic of the day. At half the speed it stands at 24 h, and the day
    itself at 48 h, where no weather has a line.
    """
    record = case.record
    face = record.faces[:, int(np.argmax(np.ptp(record.faces, axis=0)))]
    if _peak(face, record.step, DAY) >= _PEAK / 2:
        at_two_days = _peak(face, record.step, 2.0 * DAY)
        if record.duration < _LONG_ENOUGH * 2.0 * DAY or at_two_days < _CLEAR_PEAK:
            return
    for days, words in _PERIODS:
        if _peak(face, record.step, days * DAY) >= _PEAK and _peak(face, record.step, 2.0 * days * DAY) < _PEAK:
            yield Mixup("clock", ("time",), f"the day's cycle has {24.0 * days:.3g} hours in this record: {words}")
            return


def _peak(values: np.ndarray, step: float, period: float) -> float:
    """Power of a series at a period over the mean power at periods a little shorter and longer; 0 where too short."""
    duration = step * len(values)
    if duration < 6.0 * period or period < 4.0 * step:
        return 0.0
    rows = len(values)
    detrended = values - np.polynomial.Polynomial.fit(np.arange(rows), values, 3)(np.arange(rows))
    power = np.abs(np.fft.rfft(detrended * np.hanning(rows))) ** 2
    at = duration / period
    near = np.arange(max(int(at) - 1, 0), min(int(at) + 3, len(power)))
    beside = np.setdiff1d(np.arange(int(0.6 * at), min(int(1.5 * at) + 1, len(power))), near)
    return float(power[near].max() / max(power[beside].mean(), 1e-300)) if len(beside) else 0.0


def daily_means(case: Case, values: np.ndarray) -> np.ndarray:
    """Means over each whole day of the record; over all rows where it is shorter than a day; NaN without a value."""
    days = (case.record.time // DAY).astype(int)
    whole = max(1, int(case.record.span // DAY))
    use = np.isfinite(values) & ~case.record.broken
    count = np.bincount(days[use], minlength=days[-1] + 1)
    total = np.bincount(days[use], values[use], minlength=days[-1] + 1)
    return np.divide(total, count, out=np.full(len(count), np.nan), where=count > 0)[:whole]


def doubtful_places(case: Case) -> list[str]:
    """Sensors whose readings contradict their stated places, as far as no model is needed to see it."""
    record, notes = case.record, []
    coldest, warmest = record.faces.min(axis=1), record.faces.max(axis=1)
    for sensor, values in zip(case.sensors, record.sensors.T, strict=True):
        use = np.isfinite(values) & ~record.broken
        margin = 3.0 * np.hypot(sensor.noise_std, record.boundary_noise_std) + sensor.offset_std
        for word, outside in (("warmer", values > warmest + margin), ("colder", values < coldest - margin)):
            if use.any() and np.mean(outside[use]) >= _ALWAYS:
                notes.append(f"{sensor.name} is {word} than both faces all the time: is its column the right one?")
    return notes + _contradicting_amplitudes(case)


def _contradicting_amplitudes(case: Case) -> list[str]:
    """Pairs of sensors of which the one nearer to the face with the larger daily cycle has the smaller one."""
    amplitudes = {name: _daily_amplitude(case, values) for name, values in temperature_columns(case).items()}
    left, right = (amplitudes[name] for name in FACE_COLUMNS)
    noise = max((sensor.noise_std for sensor in case.sensors), default=0.0)
    if max(left, right) < 4.0 * min(left, right) or max(left, right) < _CLEAR_AMPLITUDE * noise:
        return []  # both faces drive the wall, so amplitudes have no order
    ordered = sorted(case.sensors, key=lambda sensor: sensor.position, reverse=right > left)
    notes = []
    for k, inner in enumerate(ordered):
        for outer in ordered[:k]:
            large, small = amplitudes[inner.name], amplitudes[outer.name]
            if large > _AMPLITUDE_RATIO * small and large > _CLEAR_AMPLITUDE * noise:
                side = SIDES[int(right > left)]
                notes.append(
                    f"{inner.name} has a larger daily cycle than {outer.name} ({large:.2g} and {small:.2g} K), though "
                    f"{outer.name} is nearer to the {side} face, which drives both: are columns or places exchanged?"
                )
    return notes


def _daily_amplitude(case: Case, values: np.ndarray) -> float:
    """Amplitude of the cosine of one day in a column, K; 0 where it has few readings."""
    use = np.isfinite(values) & ~case.record.broken
    if use.sum() < _MIN_DISTINCT:
        return 0.0
    turn = 2.0 * np.pi * case.record.time[use] / DAY
    design = np.stack([np.ones(use.sum()), case.record.time[use] / case.record.duration, np.cos(turn), np.sin(turn)])
    return float(np.hypot(*np.linalg.lstsq(design.T, values[use], rcond=None)[0][2:]))
