"""The average method of ISO 9869-1 for the thermal resistance of a wall, with its stopping rules.

    R = sum (T_left - T_right) / sum q

The sums are over all time steps from the start of the record, and over whole days: the standard asks for an integer
multiple of 24 h, so that the daily cycle of stored heat cancels. The rest of a day at the end is left out; a record
shorter than a day is used entirely. The standard lets a measurement end when

- at least three days were measured;
- R at the end is within 5 % of R one day earlier;
- R of the first INT(2 D/3) days is within 5 % of R of the last INT(2 D/3) days, with D days in total.

`D` is the number of whole days.

Part of the measured heat is stored in the wall between start and end. For a heavy element the standard corrects for it:
`sum q - (F_near dT_near + F_far dT_far)/step`. For a homogeneous slab with areal heat capacity C the thermal mass
factors are `F_near = C/3` at the plate's face and `F_far = C/6`; `dT` is the change of a face's daily mean temperature
from the first day to the last.

Source: ISO 9869-1:2014, 7.1 (average method), 7.1.2 and 7.2 (storage effects).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .._internal.html import Row, html_table
from .._internal.result_object import ResultObject, plain_fields
from .._internal.units import DAY

MIN_DAYS = 3.0
"""Shortest measurement, days."""
TOLERANCE = 0.05
"""Largest relative difference of the last two stopping rules."""
_ROUNDING = 1e-6  # of the length: steps such as 86400 s / 7 are rounded in files
_SMALLEST_MEAN = 1e-9  # of the mean magnitude of the flux


@dataclass(frozen=True)
class AverageMethod(ResultObject):
    """The resistance by the average method, from one flux plate.

    Args:
        face: "left" or "right", the face with the plate.
        resistance: from plain averages over `averaged_days`, face to face, m2 K/W; None where the mean flux is zero.
        corrected_resistance: the same corrected for stored heat; None without a heat capacity, or below two days.
        days: measured.
        averaged_days: of them averaged: the largest whole number, or all of less than one day.
        three_days, day_before, two_thirds: whether each stopping rule is met.
        change_of_a_day, first_to_last: the relative differences of the last two rules; None with too few days.
        part_days: length of the two parts that the last rule compares, INT(2 D/3) days.
        resistance_day_before: R one day before the end of `averaged_days`, m2 K/W; None with too few days.
        resistances_of_parts: R of the first and of the last `part_days`, m2 K/W; None with too few days.
    """

    face: str
    resistance: float | None
    corrected_resistance: float | None
    days: float
    averaged_days: float
    three_days: bool
    day_before: bool
    two_thirds: bool
    change_of_a_day: float | None
    first_to_last: float | None
    part_days: int
    resistance_day_before: float | None
    resistances_of_parts: tuple[float | None, float | None]

    @property
    def complete(self) -> bool:
        """Whether all stopping rules are met."""
        return self.three_days and self.day_before and self.two_thirds

    @property
    def unmet_rules(self) -> tuple[str, ...]:
        """Each stopping rule that is not met, in plain words with its numbers; empty where all are met."""
        unmet, limit = [], f"limit: {100 * TOLERANCE:g} %"
        if not self.three_days:
            unmet.append(f"{self.days:.3g} days were measured (at least {MIN_DAYS:g} are required)")
        if not self.day_before:
            unmet.append(
                "R at the end cannot be compared with R a day before (two whole days are required)"
                if self.change_of_a_day is None
                else f"R changed by {100 * self.change_of_a_day:.3g} % in the last day ({limit})"
            )
        if not self.two_thirds:
            unmet.append(
                "R of the first and of the last two thirds cannot be compared (two whole days are required)"
                if self.first_to_last is None
                else f"R of the first and of the last {_days_text(self.part_days)} differ by "
                f"{100 * self.first_to_last:.3g} % ({limit})"
            )
        return tuple(unmet)

    def to_dict(self) -> dict[str, Any]:
        """The resistances and the state of each stopping rule and the unmet rules in words, as plain values."""
        return plain_fields(self) | {"complete": self.complete, "unmet_rules": list(self.unmet_rules)}

    def html_row(self) -> Row:
        """The row of a notebook's table."""
        value = "–" if self.resistance is None else f"{self.resistance:.3f}"
        state = "all rules met" if self.complete else f"not met: {'; '.join(self.unmet_rules)}"
        return f"resistance by ISO 9869-1, {self.face} plate", value, state, "m2 K/W"

    def _repr_html_(self) -> str:
        return html_table("Average method of ISO 9869-1", [self.html_row()])

    def __str__(self) -> str:
        if self.resistance is None:
            return f"ISO 9869-1   {self.face} plate: no mean flux, no resistance"
        state = "all rules met" if self.complete else f"not met: {'; '.join(self.unmet_rules)}"
        corrected = (
            "" if self.corrected_resistance is None else f", {self.corrected_resistance:.3f} corrected for storage"
        )
        resistance = f"R = {self.resistance:.3f} m2 K/W{corrected}"
        days = f"{self.days:.2f} days" if self.days < 1 else f"{self.averaged_days:g} of {self.days:.2f} days"
        return f"ISO 9869-1   {self.face} plate: {resistance}; {days}, {state}"


def average_method(
    faces: np.ndarray, flux: np.ndarray, step: float, face: str, areal_heat_capacity: float | None = None
) -> AverageMethod:
    """The resistance of a wall by the average method, from one flux plate.

    Args:
        faces: temperatures of the left and right face, degC, `(time, 2)`.
        flux: W/m2, positive along +x, NaN where missing, `(time,)`.
        step: time between rows, s.
        face: face with the plate, "left" or "right".
        areal_heat_capacity: J/m2/K, for the correction for stored heat; None for no correction.

    Returns:
        the resistance and the state of each stopping rule.

    Source: ISO 9869-1:2014, 7.1, 7.1.2 and 7.2.
    """
    days, per_day = len(flux) * step / DAY, round(DAY / step)
    whole_days = int(days * (1.0 + _ROUNDING))
    rows = min(round(whole_days * DAY / step), len(flux)) if whole_days else len(flux)

    def resistance(first: int, count: int, capacity: float | None = None) -> float | None:
        part = slice(max(first, 0), max(first, 0) + count)
        return _resistance(faces[part], flux[part], step, face, per_day, capacity)

    entire, corrected = resistance(0, rows), None
    if areal_heat_capacity is not None and whole_days >= 2:
        corrected = resistance(0, rows, areal_heat_capacity)
    before = resistance(0, rows - per_day) if whole_days >= 2 else None
    part_days = 2 * whole_days // 3
    part = part_days * per_day
    first, last = (resistance(start, part) if part else None for start in (0, rows - part))
    day, thirds = _relative_difference(entire, before), _relative_difference(first, last)
    return AverageMethod(
        face=face,
        resistance=entire,
        corrected_resistance=corrected,
        days=days,
        averaged_days=float(whole_days) if whole_days else days,
        three_days=whole_days >= MIN_DAYS,
        day_before=day is not None and day <= TOLERANCE,
        two_thirds=thirds is not None and thirds <= TOLERANCE,
        change_of_a_day=day,
        first_to_last=thirds,
        part_days=part_days,
        resistance_day_before=before,
        resistances_of_parts=(first, last),
    )


def resistance_over_time(faces: np.ndarray, flux: np.ndarray) -> np.ndarray:
    """The resistance by the average method from the first row to each row, without a correction for stored heat.

    Args:
        faces: temperatures of the left and right face, degC, `(time, 2)`.
        flux: W/m2, positive along +x, NaN where missing, `(time,)`.

    Returns:
        m2 K/W, `(time,)`; NaN where the mean flux is zero.
    """
    present = np.isfinite(flux)
    heat = np.cumsum(np.where(present, flux, 0.0))
    drop = np.cumsum(np.where(present, faces[:, 0] - faces[:, 1], 0.0))
    known = np.abs(heat) > _SMALLEST_MEAN * np.maximum(np.cumsum(np.where(present, np.abs(flux), 0.0)), 1.0)
    return np.divide(drop, heat, out=np.full(len(flux), np.nan), where=known)


def _days_text(days: int) -> str:
    return "day" if days == 1 else f"{days} days"


def _resistance(
    faces: np.ndarray, flux: np.ndarray, step: float, face: str, per_day: int, capacity: float | None
) -> float | None:
    """The resistance over some rows; rows without a flux are omitted. None where the mean flux is zero."""
    present = np.isfinite(flux)
    heat = float(flux[present].sum())
    drop = float((faces[present, 0] - faces[present, 1]).sum())
    if capacity is not None:
        change = faces[-per_day:].mean(axis=0) - faces[:per_day].mean(axis=0)
        near, far = change if face == "left" else change[::-1]
        # a positive flux enters the wall through the left face and leaves it through the right face
        stored = (capacity / 3.0 * near + capacity / 6.0 * far) / step * present.mean()  # as many rows as have a flux
        heat -= stored if face == "left" else -stored
    return drop / heat if abs(heat) > _SMALLEST_MEAN * max(1.0, float(np.abs(flux[present]).sum())) else None


def _relative_difference(one: float | None, other: float | None) -> float | None:
    return None if one is None or other is None or other == 0 else abs(one / other - 1.0)
