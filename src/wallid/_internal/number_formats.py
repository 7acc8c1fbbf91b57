"""Numbers, quantities, units and sentences in typographic form, for reports and the terminal."""

from __future__ import annotations

import datetime
import math
import re
from typing import Any

from .units import DAY
from .visible_text import visible_text

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_EXPONENT = re.compile(r"(?<=[\d)])e([+-]\d+)\b")
_PERCENT = re.compile(r"(?<=\d)%")
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
    """A quantity of result.json as text: value, standard deviation, unit and 95 % interval, as far as present."""
    value, std, interval = entry["value"], entry.get("std"), entry.get("interval_95")
    if value is None or not std:
        text = f"{format_number(value)} {format_unit(entry['unit'])}".strip()
        return text if not interval else f"{text} (95 %: {format_number(interval[0])} to {format_number(interval[1])})"
    ends = None if not interval or None in interval else (interval[0], interval[1])
    return format_text(value_and_interval(value, std, ends, "" if entry["unit"] == "-" else entry["unit"], gap=" "))


def format_interval(entry: dict[str, Any]) -> str:
    """The 95 % interval of a quantity of result.json, as text; empty where there is none."""
    return format_quantity(entry).partition(" (95 %: ")[2].rstrip(")")


def value_and_std(value: float, std: float, unit: str = "") -> str:
    """A value with two significant digits of its standard deviation, in a unit that a person uses, as plain text.

    Seconds become minutes, hours or days, metres become mm or cm, rates per second become rates per day. Very large and
    very small values share one power of ten: `(1.061 +- 0.012)e-06 m2/s`.
    """
    return value_and_interval(value, std, None, unit)


def value_and_interval(
    value: float, std: float, interval_95: tuple[float, float] | None, unit: str = "", note: str = "", gap: str = "   "
) -> str:
    """As `value_and_std`, followed by the 95 % interval in the same unit and with the same digits.

    Args:
        interval_95: its ends; None for the value alone.
        note: behind the interval, inside the parentheses.
        gap: between value and interval.
    """
    scale, unit = _unit_for_people(max(abs(value), abs(std)), unit)
    value, std = value / scale, std / scale
    ends = () if interval_95 is None else (interval_95[0] / scale, interval_95[1] / scale)
    if not (math.isfinite(value) and math.isfinite(std)) or std <= 0:
        text, shown = f"{value:.4g} {unit}".strip(), [f"{end:.4g}" for end in ends]
    else:
        power = math.floor(math.log10(max(abs(value), std)))
        power = power if power < -4 or power > 4 else 0
        size = 10.0**power
        digits = max(1 - math.floor(math.log10(std / size)), 0)
        exponent = f"e{power:+03d}" if power else ""
        text = f"{_fixed(value / size, digits)} +- {_fixed(std / size, digits)}"
        text = f"({text}){exponent} {unit}".strip() if power else f"{text} {unit}".strip()
        shown = [f"{_fixed(end / size, digits)}{exponent}" for end in ends]
    return text if not ends else f"{text}{gap}(95 %: {shown[0]} to {shown[1]}{note})"


def _fixed(value: float, digits: int) -> str:
    """A number with a fixed number of decimals, and no minus sign at zero."""
    return f"{round(value, digits) + 0.0:.{digits}f}"


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
    text = _PERCENT.sub(" %", text)
    return _NEGATIVE.sub("−", text)


def terminal_text(text: str, encoding: str | None) -> str:
    """A text in typographic form for a terminal, as plain text where the terminal's encoding lacks the signs."""
    text = visible_text(text)
    try:
        shown = format_text(text)
        shown.encode(encoding or "ascii")
    except UnicodeEncodeError:
        return text.encode(encoding or "ascii", "replace").decode(encoding or "ascii")
    return shown


def _power_of_ten(match: re.Match[str]) -> str:
    return f" × 10{str(int(match[1])).translate(_SUPERSCRIPTS)}"


def date_of(day: int) -> str:
    """A day of a year that is no leap year, from 1 on, as text, such as "3 February"."""
    date = datetime.date(2023, 1, 1) + datetime.timedelta(days=day - 1)
    return f"{date.day} {date:%B}"


def counted(number: int, noun: str) -> str:
    """A number with its noun: "1 sensor", "2 sensors", "no plate"."""
    return f"{number or 'no'} {noun}{'s' if number > 1 else ''}"
