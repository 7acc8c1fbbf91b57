"""The average method of ISO 9869-1 for the thermal resistance of a wall, with its stopping rules.

    R = sum (T_left - T_right) / sum q

The sums are over all time steps from the start of the record. The standard lets a measurement end when

- at least three days were measured;
- R at the end is within 5 % of R one day earlier;
- R of the first INT(2 D/3) days is within 5 % of R of the last INT(2 D/3) days, with D days in total.

Part of the measured heat is stored in the wall between start and end. For a heavy element the standard corrects for it:
`sum q - (F_near dT_near + F_far dT_far)/step`. For a homogeneous slab with areal heat capacity C the thermal mass
factors are `F_near = C/3` at the plate's face and `F_far = C/6`; `dT` is the change of a face's daily mean temperature
from the first day to the last.

Source: ISO 9869-1:2014, 7.1 (average method), 7.1.2 and 7.2 (storage effects).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._internal.units import DAY

_MIN_DAYS = 3.0
_TOLERANCE = 0.05


@dataclass(frozen=True)
class AverageMethod:
    """The resistance by the average method, from one flux plate.

    Args:
        face: "left" or "right", the face with the plate.
        resistance: from plain averages, face to face, m2 K/W; None where the mean flux is zero.
        corrected_resistance: the same corrected for stored heat; None without a heat capacity, or below two days.
        days: measured.
        three_days, day_before, two_thirds: whether each stopping rule is met.
        change_of_a_day, first_to_last: the relative differences of the last two rules; None with too few days.
    """

    face: str
    resistance: float | None
    corrected_resistance: float | None
    days: float
    three_days: bool
    day_before: bool
    two_thirds: bool
    change_of_a_day: float | None
    first_to_last: float | None

    @property
    def complete(self) -> bool:
        """Whether all stopping rules are met."""
        return self.three_days and self.day_before and self.two_thirds

    def __str__(self) -> str:
        if self.resistance is None:
            return f"ISO 9869-1   {self.face} plate: no mean flux, no resistance"
        rules = {"three days": self.three_days, "a day before": self.day_before, "first and last": self.two_thirds}
        unmet = [name for name, met in rules.items() if not met]
        state = "all rules met" if not unmet else f"not met: {', '.join(unmet)}"
        corrected = (
            "" if self.corrected_resistance is None else f", {self.corrected_resistance:.3f} corrected for storage"
        )
        resistance = f"R = {self.resistance:.3f} m2 K/W{corrected}"
        return f"ISO 9869-1   {self.face} plate: {resistance}; {self.days:.2f} days, {state}"


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
    days = len(flux) * step / DAY
    per_day = round(DAY / step)

    def resistance(first: int, rows: int, capacity: float | None = None) -> float | None:
        part = slice(max(first, 0), max(first, 0) + rows)
        return _resistance(faces[part], flux[part], step, face, per_day, capacity)

    rows = len(flux)
    entire, corrected = resistance(0, rows), None
    if areal_heat_capacity is not None and days >= 2:
        corrected = resistance(0, rows, areal_heat_capacity)
    before = resistance(0, rows - per_day) if rows > per_day else None
    part = int(2 * days / 3) * per_day
    first, last = (resistance(start, part) if part else None for start in (0, rows - part))
    day, thirds = _relative_difference(entire, before), _relative_difference(first, last)
    return AverageMethod(
        face=face,
        resistance=entire,
        corrected_resistance=corrected,
        days=days,
        three_days=days >= _MIN_DAYS,
        day_before=day is not None and day <= _TOLERANCE,
        two_thirds=thirds is not None and thirds <= _TOLERANCE,
        change_of_a_day=day,
        first_to_last=thirds,
    )


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
        stored = (capacity / 3.0 * near + capacity / 6.0 * far) / step
        heat -= stored if face == "left" else -stored
    return drop / heat if abs(heat) > 1e-9 * max(1.0, float(np.abs(flux[present]).sum())) else None


def _relative_difference(one: float | None, other: float | None) -> float | None:
    return None if one is None or other is None or other == 0 else abs(one / other - 1.0)
