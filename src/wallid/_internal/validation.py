"""Validation of user input: each error message gives the field, the value found and the allowed values.

Classes that validate all their fields with these functions are marked `no_type_check`. Otherwise the run-time type
checker of the tests would reject a value before these functions can give their message.
"""

from __future__ import annotations

import difflib
import json
import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, fields
from typing import Any, SupportsFloat, TypeVar

import numpy as np
from jax.core import Tracer

from .arrays import known_value
from .errors import InputError

T = TypeVar("T")


@contextmanager
def error_context(context: str) -> Iterator[None]:
    """Prefix the message of every InputError in this block with the context, such as "[wall]"."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{context}: {error}") from error.__cause__


def format_value(value: object) -> str:
    """A value as in a TOML file, on one line of at most 60 characters."""
    if isinstance(value, (str, bool, list, dict)):
        text = json.dumps(value, ensure_ascii=False, default=str)
    elif isinstance(value, np.generic):
        text = repr(value.item())
    else:
        text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def spelling_hint(name: str, known: Iterable[str]) -> str:
    """A question with the known name of closest spelling, to append to a message; empty where none is close."""
    by_lower = {known_name.lower(): known_name for known_name in known}
    close = difflib.get_close_matches(name.lower(), by_lower, n=1)
    return f'; did you mean "{by_lower[close[0]]}"?' if close else ""


def number(
    name: str,
    value: object,
    unit: str = "",
    *,
    above: float | None = None,
    minimum: float | None = None,
    maximum: float | None = None,
    hint: str = "",
    alternative: str = "",
) -> float:
    """A finite number within limits, as a float; a number that JAX traces is returned as it is.

    Of a traced number only a known value is checked.

    Args:
        name: of the field, for the message.
        value: to be checked.
        unit: of the value, for the message.
        above, minimum, maximum: limits: value > above, value >= minimum, value <= maximum.
        hint: a likely cause, added to the message where the value exceeds a limit.
        alternative: another allowed value, for the message, such as `or "auto"`.

    Raises:
        InputError: the value is not a number (a bool or a text is not), not finite, or outside the limits.
    """
    if isinstance(value, Tracer) and value.shape == ():
        known = known_value(value)
        if known is not None:
            number(name, known, unit, above=above, minimum=minimum, maximum=maximum, hint=hint)
        return value  # pyright: ignore[reportReturnType]
    limits = [
        f"{word} {limit:g}"
        for word, limit in (("above", above), ("at least", minimum), ("at most", maximum))
        if limit is not None
    ]
    allowed = " ".join(
        filter(None, ["a finite number", " and ".join(limits), f"({unit})" if unit else "", alternative])
    )
    error = InputError(f"{name} = {format_value(value)}; it must be {allowed}")
    if isinstance(value, (bool, np.bool_, str, bytes)) or not isinstance(value, SupportsFloat):
        raise error
    try:
        result = float(value)
    except (TypeError, ValueError, OverflowError):  # an array, 10**400
        raise error from None
    if not math.isfinite(result):
        raise error
    if (
        (above is not None and result <= above)
        or (minimum is not None and result < minimum)
        or (maximum is not None and result > maximum)
    ):
        raise InputError(f"{error}{hint and f' ({hint})'}")
    return result


def integer(name: str, value: Any, minimum: int, maximum: int | None = None, *, alternative: str = "") -> int:
    """A whole number within limits.

    Args:
        name: of the field, for the message.
        value: to be checked.
        minimum, maximum: limits, both allowed.
        alternative: another allowed value, for the message, such as `or "auto"`.

    Raises:
        InputError: the value is not an integer within the limits.
    """
    is_integer = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not is_integer or value < minimum or (maximum is not None and value > maximum):
        limits = f"of at least {minimum}" if maximum is None else f"from {minimum} to {maximum}"
        raise InputError(
            " ".join(filter(None, [f"{name} = {format_value(value)}; it must be a whole number {limits}", alternative]))
        )
    return int(value)


def number_tuple(
    name: str, value: object, unit: str = "", *, min_count: int = 1, above: float | None = None
) -> tuple[float, ...]:
    """A list of at least `min_count` finite numbers, as a tuple of floats."""
    if isinstance(value, (str, bytes, dict)) or not isinstance(value, Iterable):
        raise InputError(f"{name} = {format_value(value)}; it must be a list of numbers")
    items = tuple(value)
    if len(items) < min_count:
        raise InputError(f"{name} = {format_value(list(items))}; it must be a list of at least {min_count} number(s)")
    return tuple(number(f"value {i} of {name}", v, unit, above=above) for i, v in enumerate(items, start=1))


def text(name: str, value: object) -> str:
    """A text that is not blank."""
    if not isinstance(value, str) or not value.strip():
        raise InputError(f"{name} = {format_value(value)}; it must be a text")
    return value


def one_of(name: str, value: object, allowed: Sequence[str]) -> str:
    """One of the allowed texts."""
    if not isinstance(value, str) or value not in allowed:
        words = " or ".join(f'"{word}"' for word in allowed)
        raise InputError(f"{name} = {format_value(value)}; it must be {words}")
    return value


def some_of(name: str, value: object, allowed: Sequence[str]) -> tuple[str, ...]:
    """Some of the allowed texts, in their order; one text stands for a list of one."""
    words = ", ".join(f'"{word}"' for word in allowed)
    if not isinstance(value, str | Sequence | set | frozenset):
        raise InputError(f"{name} = {format_value(value)}; it must be a list of {words}")
    stated = (value,) if isinstance(value, str) else tuple(value)
    for one in stated:
        one_of(name, one, allowed)
    return tuple(one for one in allowed if one in stated)


def set_fields(instance: object, **values: object) -> None:
    """Set fields of a frozen dataclass, in its `__post_init__`."""
    for name, value in values.items():
        object.__setattr__(instance, name, value)


def checked_table(table: object, required: Collection[str], optional: Collection[str] = ()) -> dict[str, Any]:
    """A TOML table whose keys are all known and which has all required keys.

    Raises:
        InputError: the value is not a table, a key is unknown, or a required key is missing.
    """
    if not isinstance(table, dict):
        raise InputError(f"found {format_value(table)}; it must be a table")
    known = (*required, *optional)
    for key in table:
        if key not in known:
            hint = spelling_hint(key, known) or f"; known are {', '.join(known)}"
            raise InputError(f'unknown key "{key}"{hint}')
    for key in required:
        if key not in table:
            raise InputError(f"{key} is missing")
    return table


def array_of_tables(name: str, value: object) -> list[object]:
    """A TOML array of tables; its elements are not checked here."""
    if not isinstance(value, list):
        raise InputError(f"[{name}]: it must be a list of tables; write [[{name}]], with double brackets")
    return value


def dataclass_from_table(cls: type[T], table: object) -> T:
    """An instance of a dataclass from a TOML table with a key for each field; the class checks the values."""
    required = [f.name for f in fields(cls) if f.default is MISSING]  # pyright: ignore[reportArgumentType]
    optional = [f.name for f in fields(cls) if f.default is not MISSING]  # pyright: ignore[reportArgumentType]
    return cls(**checked_table(table, required, optional))
