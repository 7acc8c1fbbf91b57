"""The format of a logger's file and how its readings are processed: keys of a case's `[record]` beside the columns."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, no_type_check

from .._internal.errors import InputError
from .._internal.validation import format_value, number, one_of, set_fields, spelling_hint, text

Unit = Literal["degC", "degF", "K"]
UNITS = ("degC", "degF", "K")
SEPARATORS = (",", ";", "\t", "|")

_DEFAULT_GAP_HOURS = 3.0  # the longest gap in a face that is interpolated, unless the case sets it,
_DEFAULT_GAP_STEPS = 3.0  # or this number of steps where that is longer


@no_type_check
@dataclass(frozen=True)
class FileFormat:
    """The format of a logger's file, and how its readings are processed.

    Args:
        separator: between the columns: "," ";" "|" or a tab; None: detected.
        decimal: "." or ","; None: detected.
        encoding: such as "utf-8", "cp1252" or "utf-16"; None: detected.
        day_first: whether dates such as 03/04/2020 begin with the day (True) or the month (False); None: dates must
            be ISO 8601.
        timezone: IANA time zone of local times with daylight saving, such as "Europe/Berlin"; None: the clock has no
            daylight saving.
        missing: texts and numbers that mark a missing value, in addition to the common ones.
        unit: of the temperature columns without a unit of their own: "degC", "degF" or "K"; None: degC, and an error
            where the file states another.
        step: of the uniform grid, s; None: the typical step of the faces.
        longest_gap: h. A shorter gap in a face is interpolated; a longer gap splits the record. A reading of an
            inner sensor or a flux plate between two rows is interpolated to one of them only if its neighbours are at
            most this far apart. None: 3 h, or three steps where that is longer.
        clean: whether spikes and stuck readings are masked.

    Raises:
        InputError: a value is not allowed.
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
                raise InputError(f"{name} = {format_value(value)}; it must be true or false")
        if self.encoding is not None:
            _check_encoding(self.encoding)
        if self.timezone is not None:
            _check_timezone(self.timezone)
        set_fields(self, missing=_missing_markers(self.missing))
        if self.step is not None:
            set_fields(self, step=number("step", self.step, "s", above=0.0))
        if self.longest_gap is not None:
            set_fields(self, longest_gap=number("longest_gap", self.longest_gap, "hours", minimum=0.0))

    def longest_gap_seconds(self, step: float) -> float:
        """The longest interval between two readings of a face that is interpolated, s; the grid has this step, s."""
        if self.longest_gap is not None:
            return 3600.0 * self.longest_gap
        return max(3600.0 * _DEFAULT_GAP_HOURS, _DEFAULT_GAP_STEPS * step)


def check_unit(name: str, unit: object) -> str:
    """A unit of temperature, or an InputError."""
    return one_of(name, unit, UNITS)


def to_celsius(values, unit: str):
    """Convert temperatures in degC, degF or K to degC."""
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
            f'encoding = {format_value(name)}; it must be an encoding such as "utf-8", "cp1252" or "utf-16"'
        ) from None


def _check_timezone(name: object) -> None:
    from zoneinfo import ZoneInfo, available_timezones

    text("timezone", name)
    try:
        ZoneInfo(str(name))
    except (KeyError, ValueError, OSError):  # unknown, invalid, or a folder of zones
        hint = spelling_hint(str(name), available_timezones())
        raise InputError(
            f'timezone = {format_value(name)}; it must be the name of an IANA time zone, such as "Europe/Berlin"{hint}'
        ) from None


def _missing_markers(value: object) -> tuple[str | float, ...]:
    if isinstance(value, (str, bytes, dict)) or not isinstance(value, Iterable):
        raise InputError(
            f'missing = {format_value(value)}; it must be a list of texts and numbers, such as ["Err", -999]'
        )
    return tuple(
        text(f"value {k} of missing", marker).strip()
        if isinstance(marker, str)
        else number(f"value {k} of missing", marker)
        for k, marker in enumerate(value, start=1)
    )
