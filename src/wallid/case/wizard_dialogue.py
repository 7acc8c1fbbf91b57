"""The questions of `wallid new`: the columns of a logger's file, the sensor positions and the face outdoors."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol, TypeVar, runtime_checkable

from .._internal.errors import InputError
from .._internal.validation import number, one_of, spelling_hint
from ..records.column_detection import DetectedColumn, DetectedColumns
from .toml_writer import Answers

_LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_MAX_WITHOUT_UNIT = 3.0  # m; a larger number without a unit was probably meant in cm or mm
_INDOORS = re.compile(r"inner|indoor|inside|innen|int\b|_in\b|_i\b|si\b", re.IGNORECASE)
_OUTDOORS = re.compile(r"outer|outdoor|outside|aussen|außen|ext\b|out\b|_e\b|se\b", re.IGNORECASE)
_LEFT = re.compile(rf"left|links|gauche|{_INDOORS.pattern}", re.IGNORECASE)
_RIGHT = re.compile(rf"right|rechts|droit|{_OUTDOORS.pattern}", re.IGNORECASE)

T = TypeVar("T")


@runtime_checkable
class Ask(Protocol):
    """Asks the user a question, and repeats it while `parse` raises an InputError for the answer."""

    def __call__(self, question: str, default: str | None, parse: Callable[[str], T]) -> T:
        """The parsed answer; an empty answer stands for the default."""
        ...


def parse_length(name: str, text: str) -> float:
    """The length in m from a text such as "0.43", "43 cm" or "430 mm".

    Raises:
        InputError: another form of text, or a number above 3 without a unit.
    """
    match = re.fullmatch(r"\s*([+-]?[\d.,]+(?:[eE][+-]?\d+)?)\s*(m|cm|mm)?\s*", text)
    try:
        value = float(match[1].replace(",", ".")) if match else float("nan")
    except ValueError:
        value = float("nan")
    if match is None or value != value:
        raise InputError(f'{name} = {text!r}; it must be a length, such as 0.43, "43 cm" or "430 mm"')
    if match[2] is None and value > _MAX_WITHOUT_UNIT:
        digits = match[1]
        raise InputError(f'{name} = {text!r}: is this in m? add the unit: "{digits} mm", "{digits} cm" or "{digits} m"')
    return number(name, round(value * _LENGTHS[match[2] or "m"], 9), "m", minimum=0.0)


def guess_outdoor_face(left: str, right: str) -> str | None:
    """The face outdoors as suggested by the names of the columns; None where they suggest none."""
    if _OUTDOORS.search(right) or _INDOORS.search(left):
        return "right"
    return "left" if _OUTDOORS.search(left) or _INDOORS.search(right) else None


def ask_missing(answers: Answers, detected: DetectedColumns, ask: Ask) -> Answers:
    """The answers with the values that a case needs; the user is asked for missing ones."""
    if answers.file_format.day_first is None and detected.ambiguous:
        answers = replace(answers, file_format=replace(answers.file_format, day_first=_day_first(ask)))
    columns = detected.of_kind("temperature", "number")
    if answers.length is None:
        question = "Length of the wall between the two faces (m, or such as 43 cm)"
        answers = replace(answers, length=ask(question, None, lambda text: _above_zero(parse_length("length", text))))
    if answers.left is None or answers.right is None:
        names = "\n  ".join(str(column) for column in columns)
        heading = f"The columns are\n  {names}\n"
        if answers.left is None:
            question = f"{heading}Column of the left face, x = 0"
            answers = replace(answers, left=_column(ask, question, columns, _LEFT, answers.right))
            heading = ""
        if answers.right is None:
            question = f"{heading}Column of the right face"
            answers = replace(answers, right=_column(ask, question, columns, _RIGHT, answers.left))
    if answers.outside is None:
        assert answers.left and answers.right
        answers = replace(
            answers,
            outside=ask(
                "Which face is outdoors, left or right",
                guess_outdoor_face(answers.left, answers.right),
                lambda text: one_of("outside", text.strip().lower(), ("left", "right")),
            ),
        )
    if answers.sensors is None and not answers.fluxes:
        answers = replace(answers, sensors=_sensors(ask, detected, answers))
        if not answers.sensors:
            answers = replace(answers, fluxes=_fluxes(ask, detected))
    return answers


def _day_first(ask: Ask) -> bool:
    """Whether dates begin with the day."""
    question = "Do dates begin with the day or the month, day or month"
    return ask(question, "day", lambda text: one_of("dates", text.strip().lower(), ("day", "month"))) == "day"


def _above_zero(length: float) -> float:
    return number("length", length, "m", above=0.0)


def _column(ask: Ask, question: str, columns: list[DetectedColumn], pattern: re.Pattern[str], taken: str | None) -> str:
    """Ask for one of the columns; the default is the first whose name matches the pattern."""
    known = [column.name for column in columns if column.name != taken]

    def parse(text: str) -> str:
        name = text.strip()
        if name not in known:
            raise InputError(
                f'no column "{name}"; the columns to choose from are {", ".join(known)}{spelling_hint(name, known)}'
            )
        return name

    return ask(question, next((name for name in known if pattern.search(name)), None), parse)


def _sensors(ask: Ask, detected: DetectedColumns, answers: Answers) -> dict[str, float]:
    """Ask for the position of each other column of temperatures; an empty answer leaves the column out."""
    assert answers.length is not None
    positions, length = dict[str, float](), answers.length

    def parse(name: str, text: str) -> float | None:
        if not text.strip():
            return None
        position = parse_length(f"position of {name}", text)
        if not 0.0 < position < length:
            raise InputError(f"position of {name} = {position:g} m is not inside the wall of {length:g} m")
        if position in positions.values():
            other = next(other for other, taken in positions.items() if taken == position)
            raise InputError(f"position of {name} = {position:g} m is that of {other}; positions must differ")
        return position

    for column in detected.of_kind("temperature"):
        name = column.name
        if name not in (answers.left, answers.right):
            question = f"Position of {name} in the wall, m from the left face (empty: not in the wall)"
            position = ask(question, "", lambda text, name=name: parse(name, text))
            if position is not None:
                positions[name] = position
    return positions


def _fluxes(ask: Ask, detected: DetectedColumns) -> dict[str, str]:
    """Ask for the columns of heat flux of a case without a sensor inside the wall."""
    columns = detected.of_kind("flux", "number")
    known = [column.name for column in columns]
    candidates = ", ".join(map(str, columns)) or "no column seems to be a heat flux"

    def parse(text: str) -> str:
        name = text.strip()
        if name and name not in known:
            raise InputError(f'no column "{name}"; heat fluxes may be: {candidates}{spelling_hint(name, known)}')
        return name

    columns_by_key = {
        f"flux_{side}": ask(
            f"Column of the heat flux at the {side} face, positive along +x (empty: none) [{candidates}]", "", parse
        )
        for side in ("left", "right")
    }
    return {key: name for key, name in columns_by_key.items() if name}
