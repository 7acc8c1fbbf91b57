"""The questions of `wallid new`: the columns of a logger's file, the sensor positions and the face outdoors."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Protocol, TypeVar, runtime_checkable

from .._internal.errors import InputError
from .._internal.validation import number, one_of, spelling_hint
from ..records import column_roles
from ..records.column_detection import DetectedColumn, DetectedColumns
from .toml_writer import DEFAULT_NOISE_STD, REGRESSOR_UNITS, Answers

_LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_MAX_WITHOUT_UNIT = 3.0  # m; a larger number without a unit was probably meant in cm or mm
_USES = "\n".join(
    [
        "Uses of a column that is not in the wall",
        *(f"  {key}: {unit}" for key, unit in REGRESSOR_UNITS.items()),
        "  none",
    ]
)

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
    if column_roles.is_outdoors(right) or column_roles.is_indoors(left):
        return "right"
    return "left" if column_roles.is_outdoors(left) or column_roles.is_indoors(right) else None


def suggested_face(columns: Iterable[DetectedColumn], side: str, taken: str | None) -> str | None:
    """The column whose name says "left" or "right" (indoors or outdoors); one of the air only if there is no other."""
    says = column_roles.is_left if side == "left" else column_roles.is_right
    names = [column.name for column in columns if column.name != taken and says(column.name)]
    return min(names, key=column_roles.is_air, default=None)


def suggested_use(column: DetectedColumn) -> str | None:
    """The regressor that a column is by its name; None where it shows none, or not the face of a heat flux."""
    if column.kind == "temperature":
        return column_roles.air_key(column.name)
    if column.use == "flux":
        sides = [side for side in ("left", "right") if _says_side(column.name, side)]
        return f"flux_{sides[0]}" if len(sides) == 1 else None
    return column.use if column.use in REGRESSOR_UNITS else None


def _says_side(name: str, side: str) -> bool:
    return column_roles.is_left(name) if side == "left" else column_roles.is_right(name)


def ask_missing(answers: Answers, detected: DetectedColumns, ask: Ask) -> Answers:
    """The answers with the values that a case needs; the user is asked for missing ones."""
    if answers.file_format.day_first is None and detected.ambiguous:
        answers = ask_dates(answers, ask)
    if answers.length is None:
        answers = replace(answers, length=ask_length(ask))
    heading = f"The columns are\n{listed(detected.of_kind('temperature', 'number'))}\n"
    if answers.left is None:
        answers = replace(answers, left=ask_face(ask, "left", heading, detected, answers.right))
        heading = ""
    if answers.right is None:
        answers = replace(answers, right=ask_face(ask, "right", heading, detected, answers.left))
    if answers.outside is None:
        answers = replace(answers, outside=ask_outside(ask, answers))
    if answers.sensors is None and not answers.has_channel:
        answers = ask_uses(answers, detected, ask)
    if answers.conductivity is None:
        answers = replace(answers, conductivity=ask_conductivity(ask))
    if answers.noise is None:
        answers = replace(answers, noise=ask_noise(ask))
    return answers


def ask_dates(answers: Answers, ask: Ask) -> Answers:
    """Whether dates begin with the day."""
    question = "Do dates begin with the day or the month, day or month"
    first = ask(question, "day", lambda text: one_of("dates", text.strip().lower(), ("day", "month")))
    return replace(answers, file_format=replace(answers.file_format, day_first=first == "day"))


def ask_length(ask: Ask) -> float:
    """Ask for the length of the wall, m."""
    question = "Length of the wall between the two faces, m, or with its unit such as 43 cm"
    return ask(question, None, lambda text: number("length", parse_length("length", text), "m", above=0.0))


def ask_outside(ask: Ask, answers: Answers) -> str:
    """Ask for the face outdoors, which the names of the columns may suggest."""
    assert answers.left and answers.right
    guess = guess_outdoor_face(answers.left, answers.right)
    return ask(
        "Which face is outdoors, left or right",
        guess,
        lambda text: one_of("outside", text.strip().lower(), ("left", "right")),
    )


def ask_conductivity(ask: Ask) -> float:
    """Ask for the conductivity, W/m/K; 0 where it is not known."""
    question = "Thermal conductivity of the wall, W/m/K (empty: not known)"
    return ask(question, "", lambda text: decimal("conductivity", text, "W/m/K") if text.strip() else 0.0)


def ask_noise(ask: Ask) -> float:
    """Ask for the standard deviation of a reading, K."""
    question = "Noise of a temperature reading, standard deviation, K"
    return ask(question, f"{DEFAULT_NOISE_STD:g}", lambda text: decimal("noise", text, "K"))


def decimal(name: str, text: str, unit: str, *, positive: bool = True) -> float:
    """A number, above 0 unless said otherwise, also with a decimal comma."""
    try:
        return number(name, float(text.replace(",", ".")), unit, above=0.0 if positive else None)
    except ValueError:  # InputError is one
        above = " above 0" if positive else ""
        raise InputError(f"{name} = {text!r}; it must be a number{above} ({unit})") from None


def listed(columns: Iterable[DetectedColumn]) -> str:
    """One line for each column."""
    return "\n".join(f"  {column}" for column in columns)


def ask_face(ask: Ask, side: str, heading: str, detected: DetectedColumns, taken: str | None) -> str:
    """Ask for the column of a face; the default is the first whose name says so."""
    columns = [column for column in detected.of_kind("temperature", "number") if column.name != taken]
    known = [column.name for column in columns]

    def parse(text: str) -> str:
        name = text.strip()
        if name not in known:
            raise InputError(
                f'no column "{name}"; the columns to choose from are {", ".join(known)}{spelling_hint(name, known)}'
            )
        return name

    at = ", x = 0" if side == "left" else ""
    return ask(f"{heading}Column of the {side} face{at}", suggested_face(columns, side, taken), parse)


def ask_uses(answers: Answers, detected: DetectedColumns, ask: Ask) -> Answers:
    """Ask for the use of each other column: a position in the wall, or a regressor; each is used once.

    Columns of numbers without a name that shows a use are asked for only where the others leave no channel.
    """
    heading, all_numbers = f"{_USES}\n", False
    while True:
        others = [column for column in detected.columns if column.name not in answers.columns]
        named = [column for column in others if column.kind not in ("time", "text", "number") or suggested_use(column)]
        numbers = [column for column in others if column.kind not in ("time", "text")]
        for column in numbers if all_numbers else named:
            answers = _ask_use(answers, column, ask, heading)
            heading = ""
        if answers.has_channel or all_numbers or not numbers:  # the check of the case tells what is missing
            return replace(answers, sensors=answers.sensors or {})
        heading, all_numbers = "A case needs a sensor inside the wall, or a heat flux.\n", True


def _ask_use(answers: Answers, column: DetectedColumn, ask: Ask, heading: str) -> Answers:
    """Ask for the use of one column."""
    name, positions = column.name, dict(answers.sensors or {})
    free = [key for key in REGRESSOR_UNITS if key not in answers.regressors]
    suggestion = suggested_use(column)

    def parse(text: str) -> str | float | None:
        use = text.strip()
        if use in ("", "none"):
            return None
        if use in REGRESSOR_UNITS:
            if use not in free:
                raise InputError(f'{use} is the column "{answers.regressors[use]}"; free are {", ".join(free)}')
            return use
        return _position(use, name, answers)

    position = "Position in the wall, m from the left face, or use" if column.kind == "temperature" else "Use"
    use = ask(f"{heading}{position} of {column}", suggestion if suggestion in free else "none", parse)
    if isinstance(use, float):
        return replace(answers, sensors={**positions, name: use})
    return answers if use is None else replace(answers, regressors={**answers.regressors, use: name})


def _position(text: str, name: str, answers: Answers) -> float:
    """A position inside the wall that no other sensor has."""
    if not re.match(r"[+-]?[\d.,]", text):
        raise InputError(
            f"{name}: {text!r} is neither a position nor a use{spelling_hint(text, REGRESSOR_UNITS)}; a position is a "
            f"number, uses are {', '.join(REGRESSOR_UNITS)} and none"
        )
    position, length, taken = parse_length(f"position of {name}", text), answers.length, answers.sensors or {}
    if length is not None and not 0.0 < position < length:
        raise InputError(f"position of {name} = {position:g} m is not inside the wall of {length:g} m")
    other = next((other for other, place in taken.items() if place == position), None)
    if other is not None:
        raise InputError(f"position of {name} = {position:g} m is that of {other}; positions must differ")
    return position
