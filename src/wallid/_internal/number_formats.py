"""Numbers, quantities, units and sentences in typographic form, for reports and the terminal."""

from __future__ import annotations

import math
import re
from typing import Any

from .units import DAY

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_EXPONENT = re.compile(r"(?<=[\d)])e([+-]\d+)\b")
_NEGATIVE = re.compile(r"(?<![\w.)−-])-(?=\d)")  # a sign, not a hyphen or a date
_SQUARE_OR_CUBIC_METRE = re.compile(r"\bm([23])(?=$|[\s/),.;])")
_PEOPLE = {  # for each unit: from which size on, the factor of another unit and its name
    "s": ((2 * DAY, DAY, "d"), (7200.0, 3600.0, "h"), (120.0, 60.0, "min")),
    "m": ((1.0, 1.0, "m"), (0.1, 0.01, "cm"), (0.0, 0.001, "mm")),
}
_RATES = ("K/s", "1/s")  # shown per day
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


def value_and_std(value: float, std: float, unit: str = "") -> str:
    """A value with two significant digits of its standard deviation, in a unit that a person uses, as plain text.

    Seconds become minutes, hours or days, metres become mm or cm, rates per second become rates per day. Very large and
    very small values share one power of ten: `(1.061 +- 0.012)e-06 m2/s`.
    """
    scale, unit = _unit_for_people(max(abs(value), abs(std)), unit)
    value, std = value / scale, std / scale
    if not (math.isfinite(value) and math.isfinite(std)) or std <= 0:
        return f"{value:.4g} {unit}".strip()
    power = math.floor(math.log10(max(abs(value), std)))
    power = power if power < -4 or power > 4 else 0
    value, std = value / 10.0**power, std / 10.0**power
    digits = max(1 - math.floor(math.log10(std)), 0)
    text = f"{round(value, digits) + 0.0:.{digits}f} +- {std:.{digits}f}"
    return f"({text})e{power:+03d} {unit}".strip() if power else f"{text} {unit}".strip()


def p_value_text(p: float, least: float = 5e-4) -> str:
    """A p-value as text: "p < 0.0005" below the smallest value shown."""
    return f"p < {least:g}" if p < least else f"p = {p:.2g}"


def _unit_for_people(size: float, unit: str) -> tuple[float, str]:
    """The factor and name of a unit in which a size is easy to read."""
    if unit in _RATES:
        return 1.0 / DAY, f"{unit.removesuffix('/s')}/d"
    for least, factor, shown in _PEOPLE.get(unit, ()):
        if size >= least:
            return factor, shown
    return 1.0, unit


def format_unit(text: str) -> str:
    """A unit with superscripts; empty for the dimensionless unit "-"."""
    return "" if text == "-" else _SQUARE_OR_CUBIC_METRE.sub(lambda match: f"m{'²' if match[1] == '2' else '³'}", text)


def format_text(text: str) -> str:
    """A sentence with powers of ten, units and signs in typographic form."""
    text = format_unit(_EXPONENT.sub(_power_of_ten, text)).replace("+-", "±").replace("degC", "°C")
    return _NEGATIVE.sub("−", text)


def _power_of_ten(match: re.Match[str]) -> str:
    return f" × 10{str(int(match[1])).translate(_SUPERSCRIPTS)}"
