"""Checks of what a person wrote: each refusal names the field, what was found and what is right.

The classes that use them for all their fields are `no_type_check`: a type checker at run time, as in
the tests, would refuse a value first, with a message for programmers.
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

from .errors import InputError

T = TypeVar("T")


@contextmanager
def within(where: str) -> Iterator[None]:
    """Put the place where a field stands in front of every refusal."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{where}: {error}") from error.__cause__


def show(value: object) -> str:
    """A value as it would stand in a TOML file, on one line."""
    if isinstance(value, (str, bool, list, dict)):
        text = json.dumps(value, ensure_ascii=False, default=str)
    elif isinstance(value, np.generic):
        text = repr(value.item())
    else:
        text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def nearest(name: str, known: Iterable[str]) -> str:
    """The known name that was likely meant, as a question to append; empty where none is close."""
    by_lower = {other.lower(): other for other in known}
    close = difflib.get_close_matches(name.lower(), by_lower, n=1)
    return f'; did you mean "{by_lower[close[0]]}"?' if close else ""


def number(
    name: str,
    value: object,
    unit: str = "",
    *,
    above: float | None = None,
    least: float | None = None,
    most: float | None = None,
    hint: str = "",
) -> float:
    """A finite number within limits, as a plain float.

    Args:
        unit: of the value, for the message.
        above, least, most: value > above, value >= least, value <= most.
        hint: what may have gone wrong where the value is beyond a limit.

    Raises:
        InputError: anything else; a bool or a text is no number.
    """
    limits = [
        f"{word} {limit:g}"
        for word, limit in (("above", above), ("at least", least), ("at most", most))
        if limit is not None
    ]
    wanted = " ".join(filter(None, ["a finite number", " and ".join(limits), f"({unit})" if unit else ""]))
    refusal = InputError(f"{name} = {show(value)}; it must be {wanted}")
    if isinstance(value, (bool, np.bool_, str, bytes)) or not isinstance(value, SupportsFloat):
        raise refusal
    try:
        result = float(value)
    except (TypeError, ValueError, OverflowError):  # an array, a traced value, 10**400
        raise refusal from None
    if not math.isfinite(result):
        raise refusal
    if (
        (above is not None and result <= above)
        or (least is not None and result < least)
        or (most is not None and result > most)
    ):
        raise InputError(f"{refusal}{hint and f' ({hint})'}")
    return result


def whole(name: str, value: Any, least: int, most: int | None = None, *, instead: str = "") -> int:
    """A whole number within limits.

    Args:
        instead: what else may stand there, for the message (`or "auto"`).
    """
    proper = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not proper or value < least or (most is not None and value > most):
        limits = f"of at least {least}" if most is None else f"from {least} to {most}"
        raise InputError(
            " ".join(filter(None, [f"{name} = {show(value)}; it must be a whole number {limits}", instead]))
        )
    return int(value)


def series(
    name: str, value: object, unit: str = "", *, fewest: int = 1, above: float | None = None
) -> tuple[float, ...]:
    """A list of at least `fewest` finite numbers, as a tuple."""
    if isinstance(value, (str, bytes, dict)) or not isinstance(value, Iterable):
        raise InputError(f"{name} = {show(value)}; it must be a list of numbers")
    items = tuple(value)
    if len(items) < fewest:
        raise InputError(f"{name} = {show(list(items))}; it must be a list of at least {fewest} number(s)")
    return tuple(number(f"value {i} of {name}", v, unit, above=above) for i, v in enumerate(items, start=1))


def text(name: str, value: object) -> str:
    """A text that is not empty."""
    if not isinstance(value, str) or not value.strip():
        raise InputError(f"{name} = {show(value)}; it must be a text")
    return value


def one_of(name: str, value: object, allowed: Sequence[str]) -> str:
    """One of a few words."""
    if not isinstance(value, str) or value not in allowed:
        words = " or ".join(f'"{word}"' for word in allowed)
        raise InputError(f"{name} = {show(value)}; it must be {words}")
    return value


def settle(instance: object, **values: object) -> None:
    """Put checked values into a frozen dataclass while it is being made."""
    for name, value in values.items():
        object.__setattr__(instance, name, value)


def keys(table: object, required: Collection[str], optional: Collection[str] = ()) -> dict[str, Any]:
    """A TOML table after a check of its keys.

    Raises:
        InputError: no table, an unknown key, or a required key that is missing.
    """
    if not isinstance(table, dict):
        raise InputError(f"found {show(table)}; it must be a table")
    known = (*required, *optional)
    for key in table:
        if key not in known:
            hint = nearest(key, known) or f"; known are {', '.join(known)}"
            raise InputError(f'unknown key "{key}"{hint}')
    for key in required:
        if key not in table:
            raise InputError(f"{key} is missing")
    return table


def tables(name: str, value: object) -> list[object]:
    """An array of TOML tables, to be checked one by one."""
    if not isinstance(value, list):
        raise InputError(f"[{name}]: it must be a list of tables; write [[{name}]], with double brackets")
    return value


def build(cls: type[T], table: object) -> T:
    """A dataclass from a TOML table whose keys are its fields; the class checks the values."""
    needed = [f.name for f in fields(cls) if f.default is MISSING]  # pyright: ignore[reportArgumentType]
    optional = [f.name for f in fields(cls) if f.default is not MISSING]  # pyright: ignore[reportArgumentType]
    return cls(**keys(table, needed, optional))
