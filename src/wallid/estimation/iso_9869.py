"""The average method of ISO 9869-1 for a wall's thermal resistance, with all its rules for when to stop.

    R = sum (T_left - T_right) / sum q

over whole steps from the record's start. It is an estimate only where

- three days at least were measured, and less than that is never enough;
- R at the end is within 5 % of R a day earlier;
- R of the first INT(2 D/3) days is within 5 % of R of the last as many, D the days in all.

The heat that the wall has stored between start and end is part of the flux. For a heavy element the standard takes it
out: `sum q - (F_near dT_near + F_far dT_far)/step`, with thermal mass factors which for a homogeneous slab of areal
capacity C are `F_near = C/3` at the plate's face and `F_far = C/6`, and `dT` the change of a face's mean from the
first day to the last.

Source: ISO 9869-1:2014, 7.1 (average method), 7.1.2 and 7.2 (storage effects).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._internal.units import DAY

_LEAST_DAYS = 3.0
_CLOSE = 0.05


@dataclass(frozen=True)
class AverageMethod:
    """The average method's resistance from one flux plate.

    Args:
        face: "left" or "right", where the plate is.
        resistance: m2 K/W, face to face, as plain averages give it; None where the mean flux is none.
        corrected: the same without the heat stored; None without a capacity.
        days: measured.
        three_days, day_before, two_thirds: the state of each rule.
        change_of_a_day, first_to_last: relative differences that the last two rules look at; None where there were
            too few days.
    """

    face: str
    resistance: float | None
    corrected: float | None
    days: float
    three_days: bool
    day_before: bool
    two_thirds: bool
    change_of_a_day: float | None
    first_to_last: float | None

    @property
    def complete(self) -> bool:
        """Whether the standard would let the measurement end."""
        return self.three_days and self.day_before and self.two_thirds

    def __str__(self) -> str:
        if self.resistance is None:
            return f"ISO 9869-1   {self.face} plate: no mean flux, no resistance"
        rules = {"three days": self.three_days, "a day before": self.day_before, "first and last": self.two_thirds}
        unmet = [name for name, met in rules.items() if not met]
        state = "all rules met" if not unmet else f"not met: {', '.join(unmet)}"
        stored = "" if self.corrected is None else f", {self.corrected:.3f} without the heat stored"
        return (
            f"ISO 9869-1   {self.face} plate: R = {self.resistance:.3f} m2 K/W{stored}; {self.days:.2f} days, {state}"
        )


def average_method(
    faces: np.ndarray, flux: np.ndarray, step: float, face: str, areal_heat_capacity: float | None = None
) -> AverageMethod:
    """The average method on one plate's readings.

    Args:
        faces: left and right face, degC, `(time, 2)`. flux: W/m2, positive along +x, NaN where missing.
        step: s. face: of the plate, "left" or "right".
        areal_heat_capacity: J/m2/K, for the heat stored; None leaves it in.
    """
    days = len(flux) * step / DAY
    per_day = round(DAY / step)

    def over(first: int, rows: int, capacity: float | None) -> float | None:
        part = slice(max(first, 0), max(first, 0) + rows)
        return _resistance(faces[part], flux[part], step, face, per_day, capacity)

    rows = len(flux)
    whole, corrected = over(0, rows, None), None
    if areal_heat_capacity is not None and days >= 2:
        corrected = over(0, rows, areal_heat_capacity)
    before = over(0, rows - per_day, None) if rows > per_day else None
    part = int(2 * days / 3) * per_day
    first, last = (over(start, part, None) if part else None for start in (0, rows - part))
    day, thirds = _apart(whole, before), _apart(first, last)
    return AverageMethod(
        face=face,
        resistance=whole,
        corrected=corrected,
        days=days,
        three_days=days >= _LEAST_DAYS,
        day_before=day is not None and day <= _CLOSE,
        two_thirds=thirds is not None and thirds <= _CLOSE,
        change_of_a_day=day,
        first_to_last=thirds,
    )


def _resistance(
    faces: np.ndarray, flux: np.ndarray, step: float, face: str, per_day: int, capacity: float | None
) -> float | None:
    """Of some rows; those without a flux count nowhere."""
    there = np.isfinite(flux)
    through = float(flux[there].sum())
    drop = float((faces[there, 0] - faces[there, 1]).sum())
    if capacity is not None:
        change = faces[-per_day:].mean(axis=0) - faces[:per_day].mean(axis=0)
        near, far = change if face == "left" else change[::-1]
        # heat goes in through the left face along +x, and through the right one against it
        stored = (capacity / 3.0 * near + capacity / 6.0 * far) / step
        through -= stored if face == "left" else -stored
    return drop / through if abs(through) > 1e-9 * max(1.0, float(np.abs(flux[there]).sum())) else None


def _apart(one: float | None, other: float | None) -> float | None:
    return None if one is None or other is None or other == 0 else abs(one / other - 1.0)
