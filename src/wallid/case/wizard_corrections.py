"""The questions of `wallid new` after the check of the finished case has failed: which answer to change."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

from .._internal.validation import one_of
from ..records.column_detection import DetectedColumns
from .toml_writer import Answers
from .wizard_dialogue import (
    Ask,
    ask_conductivity,
    ask_dates,
    ask_face,
    ask_length,
    ask_noise,
    ask_outside,
    ask_uses,
    decimal,
    listed,
)


def ask_again(answers: Answers, detected: DetectedColumns, ask: Ask, fault: str) -> Answers | None:
    """The answers after the user has changed one; None where the user wants the file as it is.

    Args:
        answers: complete, but not a valid case.
        detected: the columns of the file.
        ask: asks the user.
        fault: why the case cannot be used.
    """

    def parse(text: str) -> str:
        return one_of("answer", text.strip().lower(), (*_CHANGES, "write")) if text.strip() else "write"

    question = (
        f"This case cannot be used: {fault}\nAll answers are kept. Which one to change: {', '.join(_CHANGES)}; or "
        "write, for a file that you edit"
    )
    change = ask(question, _answer_at_fault(answers, fault), parse)
    return None if change == "write" else _CHANGES[change](answers, detected, ask)


def _answer_at_fault(answers: Answers, fault: str) -> str:
    """The answer that a message is about; "write" where it shows none."""
    for name, column in (("left", answers.left), ("right", answers.right)):
        if f'column "{column}"' in fault:
            return name
    patterns = {
        "timezone": r"timezone|time zone|daylight",
        "dates": r"day_first|day or the month",
        "unit": r"\bunit\b|--unit|kelvin",
        "columns": r"\[\[sensor\]\]|position|sensor|flux|column|regressor",
        "length": r"\blength\b",
        "prior": r"diffusivity_prior",
        "conductivity": r"conductivity",
        "noise": r"noise",
    }
    return next((name for name, pattern in patterns.items() if re.search(pattern, fault)), "write")


def _without_uses(answers: Answers) -> Answers:
    return replace(answers, sensors=None, regressors={})


def _change_face(side: str) -> Callable[[Answers, DetectedColumns, Ask], Answers]:
    """Ask for a face again."""

    def change(answers: Answers, detected: DetectedColumns, ask: Ask) -> Answers:
        other = answers.right if side == "left" else answers.left
        heading = f"The columns are\n{listed(detected.of_kind('temperature', 'number'))}\n"
        return replace(answers, **{side: ask_face(ask, side, heading, detected, other)})

    return change


def _change_prior(answers: Answers, detected: DetectedColumns, ask: Ask) -> Answers:
    question = "Prior diffusivity, m2/s (brick 5e-7, stone 1e-6, concrete 7e-7)"
    return replace(answers, prior=ask(question, "5e-7", lambda text: decimal("prior", text, "m2/s")))


def _change_unit(answers: Answers, detected: DetectedColumns, ask: Ask) -> Answers:
    units = ("degC", "degF", "K")
    unit = ask("Unit of the temperatures, degC, degF or K", "degC", lambda text: one_of("unit", text.strip(), units))
    return replace(answers, file_format=replace(answers.file_format, unit=unit))


def _change_timezone(answers: Answers, detected: DetectedColumns, ask: Ask) -> Answers:
    question = "Time zone of the times, such as Europe/Berlin (empty: as in the file)"
    zone = ask(question, "", lambda text: replace(answers.file_format, timezone=text.strip() or None).timezone)
    return replace(answers, file_format=replace(answers.file_format, timezone=zone))


_CHANGES: dict[str, Callable[[Answers, DetectedColumns, Ask], Answers]] = {
    "length": lambda answers, _, ask: replace(answers, length=ask_length(ask)),
    "left": _change_face("left"),
    "right": _change_face("right"),
    "outside": lambda answers, _, ask: replace(answers, outside=ask_outside(ask, answers)),
    "columns": lambda answers, detected, ask: ask_uses(_without_uses(answers), detected, ask),
    "conductivity": lambda answers, _, ask: replace(answers, conductivity=ask_conductivity(ask)),
    "noise": lambda answers, _, ask: replace(answers, noise=ask_noise(ask)),
    "prior": _change_prior,
    "dates": lambda answers, _, ask: ask_dates(answers, ask),
    "unit": _change_unit,
    "timezone": _change_timezone,
}
