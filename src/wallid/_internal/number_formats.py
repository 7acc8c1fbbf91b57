"""Numbers, quantities, units and sentences in typographic form, for reports and the terminal."""

from __future__ import annotations

import math
import re
from typing import Any

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_EXPONENT = re.compile(r"(?<=\d)e([+-]\d+)\b")
_SQUARE_OR_CUBIC_METRE = re.compile(r"\bm([23])(?=$|[\s/),.;])")
_FULL_INTEGER_LIMIT = 1e7  # smaller integers are written with all digits


def format_number(value: Any, digits: int = 4) -> str:
    """A value of result.json as text."""
    if value is None:
        return "–"
    if value in ({}, [], ()):
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        if value.is_integer() and abs(value) < _FULL_INTEGER_LIMIT:  # such as a time in seconds
            return str(int(value)).replace("-", "−")
        return _EXPONENT.sub(_power_of_ten, f"{value:.{digits}g}").replace("-", "−")
    if isinstance(value, list | tuple):
        return ", ".join(format_number(item, digits) for item in value)
    return str(value)


def format_quantity(entry: dict[str, Any]) -> str:
    """A quantity of result.json as text: value, standard deviation, 95 % interval and unit, as far as present."""
    text = format_number(_rounded(entry["value"], entry.get("std")))
    if entry.get("std") is not None:
        text += f" ± {format_number(entry['std'], 2)}"
    if entry.get("interval_95"):
        low, high = entry["interval_95"]
        text += f" (95 %: {format_number(low)} to {format_number(high)})"
    return f"{text} {format_unit(entry['unit'])}".strip()


def _rounded(value: Any, std: float | None) -> Any:
    """A value rounded to the second significant digit of its standard deviation."""
    if not std or not isinstance(value, float):
        return value
    return round(value, 1 - math.floor(math.log10(std))) + 0.0  # -0.0 becomes 0.0


def format_unit(text: str) -> str:
    """A unit with superscripts; empty for the dimensionless unit "-"."""
    return "" if text == "-" else _SQUARE_OR_CUBIC_METRE.sub(lambda match: f"m{'²' if match[1] == '2' else '³'}", text)


def format_text(text: str) -> str:
    """A sentence with powers of ten, units and signs in typographic form."""
    return format_unit(_EXPONENT.sub(_power_of_ten, text)).replace("+-", "±").replace("degC", "°C")


def _power_of_ten(match: re.Match[str]) -> str:
    return f" × 10{str(int(match[1])).translate(_SUPERSCRIPTS)}"
