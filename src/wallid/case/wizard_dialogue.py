"""What a person is asked of a logger's file: which column is what, where the sensors sit, which face is outdoors."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol, TypeVar, runtime_checkable

from .._internal.errors import InputError
from .._internal.validation import nearest, number, one_of
from ..records.column_detection import Column, Look
from .toml_writer import Answers

_LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_MOST_BARE = 3.0  # m; above it a number without a unit is rather cm or mm
_INDOORS = re.compile(r"inner|indoor|inside|innen|int\b|_in\b|_i\b|si\b", re.IGNORECASE)
_OUTDOORS = re.compile(r"outer|outdoor|outside|aussen|außen|ext\b|out\b|_e\b|se\b", re.IGNORECASE)
_LEFT = re.compile(rf"left|links|gauche|{_INDOORS.pattern}", re.IGNORECASE)
_RIGHT = re.compile(rf"right|rechts|droit|{_OUTDOORS.pattern}", re.IGNORECASE)

T = TypeVar("T")


@runtime_checkable
class Ask(Protocol):
    """Asks a person a question, and again while `read` refuses the answer with an InputError."""

    def __call__(self, question: str, default: str | None, read: Callable[[str], T]) -> T:
        """The answer as `read` takes it; of an empty one, the default."""
        ...


def metres(name: str, text: str) -> float:
    """A length such as "0.43", "43 cm" or "430 mm", in m.

    Raises:
        InputError: anything else, or a bare number too large for metres to be meant.
    """
    found = re.fullmatch(r"\s*([+-]?[\d.,]+(?:[eE][+-]?\d+)?)\s*(m|cm|mm)?\s*", text)
    try:
        value = float(found[1].replace(",", ".")) if found else float("nan")
    except ValueError:
        value = float("nan")
    if found is None or value != value:
        raise InputError(f'{name} = {text!r}; it must be a length, such as 0.43, "43 cm" or "430 mm"')
    if found[2] is None and value > _MOST_BARE:
        bare = found[1]
        raise InputError(f'{name} = {text!r}: in m? give the unit with it: "{bare} mm", "{bare} cm" or "{bare} m"')
    return number(name, round(value * _LENGTHS[found[2] or "m"], 9), "m", least=0.0)


def outdoors(left: str, right: str) -> str | None:
    """Which face is outdoors, as far as the names of their columns tell."""
    if _OUTDOORS.search(right) or _INDOORS.search(left):
        return "right"
    return "left" if _OUTDOORS.search(left) or _INDOORS.search(right) else None


def complete(answers: Answers, seen: Look, ask: Ask) -> Answers:
    """The answers with all that a case needs, asked for where it is missing."""
    if answers.form.day_first is None and seen.ambiguous:
        answers = replace(answers, form=replace(answers.form, day_first=_day_first(ask)))
    columns = seen.of("temperature", "number")
    if answers.length is None:
        question = "Length of the wall between the two faces (m, or such as 43 cm)"
        answers = replace(answers, length=ask(question, None, lambda text: _above_zero(metres("length", text))))
    if answers.left is None or answers.right is None:
        there = "\n  ".join(str(column) for column in columns)
        listed = f"The columns are\n  {there}\n"
        if answers.left is None:
            question = f"{listed}Column of the left face, x = 0"
            answers = replace(answers, left=_column(ask, question, columns, _LEFT, answers.right))
            listed = ""
        if answers.right is None:
            answers = replace(
                answers, right=_column(ask, f"{listed}Column of the right face", columns, _RIGHT, answers.left)
            )
    if answers.outside is None:
        assert answers.left and answers.right
        answers = replace(
            answers,
            outside=ask(
                "Which face is outdoors, left or right",
                outdoors(answers.left, answers.right),
                lambda text: one_of("outside", text.strip().lower(), ("left", "right")),
            ),
        )
    if answers.sensors is None and not answers.fluxes:
        answers = replace(answers, sensors=_sensors(ask, seen, answers))
        if not answers.sensors:
            answers = replace(answers, fluxes=_fluxes(ask, seen))
    return answers


def _day_first(ask: Ask) -> bool:
    """Whether dates begin with the day."""
    question = "Do dates begin with the day or the month, day or month"
    return ask(question, "day", lambda text: one_of("dates", text.strip().lower(), ("day", "month"))) == "day"


def _above_zero(length: float) -> float:
    return number("length", length, "m", above=0.0)


def _column(ask: Ask, question: str, columns: list[Column], pattern: re.Pattern[str], taken: str | None) -> str:
    """One of the columns; offered is the first whose name looks like it."""
    known = [column.name for column in columns if column.name != taken]

    def read(text: str) -> str:
        name = text.strip()
        if name not in known:
            raise InputError(f'no column "{name}"; these are left: {", ".join(known)}{nearest(name, known)}')
        return name

    return ask(question, next((name for name in known if pattern.search(name)), None), read)


def _sensors(ask: Ask, seen: Look, answers: Answers) -> dict[str, float]:
    """The place of each other column of temperatures; an empty answer leaves it out."""
    assert answers.length is not None
    found, length = dict[str, float](), answers.length

    def read(name: str, text: str) -> float | None:
        if not text.strip():
            return None
        where = metres(f"position of {name}", text)
        if not 0.0 < where < length:
            raise InputError(f"position of {name} = {where:g} m is not inside the wall of {length:g} m")
        if where in found.values():
            other = next(other for other, place in found.items() if place == where)
            raise InputError(f"position of {name} = {where:g} m; {other} is there already, positions must differ")
        return where

    for column in seen.of("temperature"):
        name = column.name
        if name not in (answers.left, answers.right):
            question = f"Place of {name} in the wall, m from the left face (empty: not in the wall)"
            where = ask(question, "", lambda text, name=name: read(name, text))
            if where is not None:
                found[name] = where
    return found


def _fluxes(ask: Ask, seen: Look) -> dict[str, str]:
    """Columns of heat flux, where there is no sensor inside."""
    columns = seen.of("flux", "number")
    known = [column.name for column in columns]
    there = ", ".join(map(str, columns)) or "none seems to be one"

    def read(text: str) -> str:
        name = text.strip()
        if name and name not in known:
            raise InputError(f'no column "{name}"; heat fluxes may be: {there}{nearest(name, known)}')
        return name

    found = {
        f"flux_{side}": ask(
            f"Column of the heat flux at the {side} face, positive along +x (empty: none) [{there}]", "", read
        )
        for side in ("left", "right")
    }
    return {key: name for key, name in found.items() if name}
