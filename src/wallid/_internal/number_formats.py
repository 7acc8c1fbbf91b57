"""Numbers, units and sentences as a person writes them."""

from __future__ import annotations

import math
import re
from typing import Any

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_POWER = re.compile(r"(?<=\d)e([+-]\d+)\b")
_AREA = re.compile(r"\bm([23])(?=$|[\s/),.;])")
_COUNTED = 1e7  # whole numbers below are said in full


def number(value: Any, digits: int = 4) -> str:
    """A value of result.json as a person reads it."""
    if value is None:
        return "–"
    if value in ({}, [], ()):
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        if value.is_integer() and abs(value) < _COUNTED:  # such as a time in seconds
            return str(int(value)).replace("-", "−")
        return _POWER.sub(_ten, f"{value:.{digits}g}").replace("-", "−")
    if isinstance(value, list | tuple):
        return ", ".join(number(item, digits) for item in value)
    return str(value)


def quantity(found: dict[str, Any]) -> str:
    """A value of result.json that has a unit, with what is known of its uncertainty."""
    text = number(_rounded(found["value"], found.get("std")))
    if found.get("std") is not None:
        text += f" ± {number(found['std'], 2)}"
    if found.get("interval_95"):
        low, high = found["interval_95"]
        text += f" (95 %: {number(low)} to {number(high)})"
    return f"{text} {unit(found['unit'])}".strip()


def _rounded(value: Any, std: float | None) -> Any:
    """A value without the digits that its standard deviation makes meaningless."""
    if not std or not isinstance(value, float):
        return value
    return round(value, 1 - math.floor(math.log10(std))) + 0.0  # no minus zero


def unit(text: str) -> str:
    """A unit as a person writes it; nothing for what has none."""
    return "" if text == "-" else _AREA.sub(lambda found: f"m{'²' if found[1] == '2' else '³'}", text)


def prose(text: str) -> str:
    """What a terminal shows, with a person's powers of ten, units and signs."""
    return unit(_POWER.sub(_ten, text)).replace("+-", "±").replace("degC", "°C")


def _ten(found: re.Match[str]) -> str:
    return f" × 10{str(int(found[1])).translate(_RAISED)}"
