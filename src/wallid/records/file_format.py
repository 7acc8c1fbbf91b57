"""How a file of records is written, and what may be made of it: the keys of a case's `[record]` beside the columns."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, no_type_check

from .._internal.errors import InputError
from .._internal.validation import nearest, number, one_of, settle, show, text

Unit = Literal["degC", "degF", "K"]
UNITS = ("degC", "degF", "K")
SEPARATORS = (",", ";", "\t", "|")

_SHORTEST_GAP = 3.0  # h: what a gap in a face may last unless the case says otherwise,
_GAP_STEPS = 3.0  # or so many steps, where rows are hours apart


@no_type_check
@dataclass(frozen=True)
class Format:
    """How a file of records is written, and what may be made of it. None: seen from the file.

    Args:
        separator: between the columns: "," ";" "|" or a tab.
        decimal: "." or ",".
        encoding: such as "utf-8", "cp1252" or "utf-16".
        day_first: dates such as 03/04/2020 begin with the day (True) or the month (False); None refuses
            dates that are not ISO 8601.
        timezone: whose wall clock the times are, such as "Europe/Berlin", daylight saving included; None
            takes a clock that never jumps.
        missing: texts and numbers that stand for a missing value, beside the common ones.
        unit: of every temperature column that does not state its own: "degC", "degF" or "K". None takes
            degC, and refuses a column that the file says is in another.
        step: of the grid that the readings are put on, s; None takes the faces' usual step.
        longest_gap: h; a face is interpolated across less, and the record is split at more. An inner
            reading between two rows is carried to one of them only between neighbours this close. None
            means 3 h, or three steps where that is longer.
        clean: mask spikes and stuck readings.

    Raises:
        InputError: a value that is none of these.
    """

    separator: str | None = None
    decimal: Literal[".", ","] | None = None
    encoding: str | None = None
    day_first: bool | None = None
    timezone: str | None = None
    missing: tuple[str | float, ...] = ()
    unit: Unit | None = None
    step: float | None = None
    longest_gap: float | None = None
    clean: bool = True

    def __post_init__(self) -> None:
        if self.separator is not None:
            one_of("separator", self.separator, SEPARATORS)
        if self.decimal is not None:
            one_of("decimal", self.decimal, (".", ","))
        if self.unit is not None:
            one_of("unit", self.unit, UNITS)
        for name in ("day_first", "clean"):
            value = getattr(self, name)
            if not isinstance(value, bool) and not (name == "day_first" and value is None):
                raise InputError(f"{name} = {show(value)}; it must be true or false")
        if self.encoding is not None:
            _check_encoding(self.encoding)
        if self.timezone is not None:
            _check_timezone(self.timezone)
        settle(self, missing=_markers(self.missing))
        if self.step is not None:
            settle(self, step=number("step", self.step, "s", above=0.0))
        if self.longest_gap is not None:
            settle(self, longest_gap=number("longest_gap", self.longest_gap, "hours", least=0.0))

    def gap_seconds(self, step: float) -> float:
        """The longest stretch between two readings of a face that is interpolated, s."""
        if self.longest_gap is not None:
            return 3600.0 * self.longest_gap
        return max(3600.0 * _SHORTEST_GAP, _GAP_STEPS * step)


def check_unit(name: str, unit: object) -> str:
    """A unit of temperature."""
    return one_of(name, unit, UNITS)


def celsius(values, unit: str):
    """Temperatures in degC from those in a unit."""
    if unit == "degF":
        return (values - 32.0) / 1.8
    return values - 273.15 if unit == "K" else values


def _check_encoding(name: object) -> None:
    import codecs

    text("encoding", name)
    try:
        codecs.lookup(str(name))
        "".encode(str(name))
    except (LookupError, ValueError):
        raise InputError(
            f'encoding = {show(name)}; it must be an encoding such as "utf-8", "cp1252" or "utf-16"'
        ) from None


def _check_timezone(name: object) -> None:
    from zoneinfo import ZoneInfo, available_timezones

    text("timezone", name)
    try:
        ZoneInfo(str(name))
    except (KeyError, ValueError, OSError):  # unknown; not a name; a folder of names
        hint = nearest(str(name), available_timezones())
        raise InputError(
            f'timezone = {show(name)}; it must be a name of the IANA time zones, such as "Europe/Berlin"{hint}'
        ) from None


def _markers(value: object) -> tuple[str | float, ...]:
    if isinstance(value, (str, bytes, dict)) or not isinstance(value, Iterable):
        raise InputError(f'missing = {show(value)}; it must be a list of texts and numbers, such as ["Err", -999]')
    found: list[str | float] = []
    for count, one in enumerate(value, start=1):
        name = f"value {count} of missing"
        found.append(text(name, one).strip() if isinstance(one, str) else number(name, one))
    return tuple(found)
