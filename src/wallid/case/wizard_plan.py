"""Writing a new case file for a campaign that is to be planned."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from .._internal.errors import InputError
from ..records.weather_year import read_weather_year
from .case_file import campaign_of
from .planned_campaign import UNHEATED, PlannedCampaign
from .toml_writer import WallAnswers, key_line, wall_lines
from .wall_and_sensors import SIDES
from .wizard import check_target, write_case_file
from .wizard_dialogue import Ask, ask_length, decimal

_DIRECTIONS = {
    "N": 0.0, "NE": 45.0, "E": 90.0, "SE": 135.0, "S": 180.0, "SW": 225.0, "W": 270.0, "NW": 315.0,
}  # fmt: skip


@dataclass(frozen=True)
class PlanAnswers(WallAnswers):
    """The user's description of a wall that is to be measured; the dialogue asks for what is None.

    Args:
        length, outside, conductivity, prior: as in `WallAnswers`; the left face is outdoors where none is stated.
        azimuth: where the outer face looks, degrees clockwise from north.
        indoor: temperature of the room, degC, or "unheated".
        sensors: the largest number of sensors inside the wall.
        plates: number of heat flux plates, 0 to 2.
        days: the longest campaign.
    """

    azimuth: float | None = None
    indoor: float | str | None = None
    sensors: int | None = None
    plates: int | None = None
    days: float | None = None


def parse_azimuth(text: str) -> float:
    """An azimuth, degrees, from a number or a direction such as "SW".

    Raises:
        InputError: another form of text.
    """
    direction = text.strip().upper()
    known = direction in _DIRECTIONS
    return _DIRECTIONS[direction] if known else decimal("azimuth", text, "degrees", positive=False)


def parse_indoor(text: str) -> float | str:
    """The temperature of a room, degC, or "unheated".

    Raises:
        InputError: another form of text.
    """
    return UNHEATED if text.strip().lower() == UNHEATED else decimal("indoor", text, "degC", positive=False)


def new_plan(
    weather: str | os.PathLike[str],
    answers: PlanAnswers | None = None,
    *,
    to: str | os.PathLike[str] | None = None,
    force: bool = False,
    ask: Ask | None = None,
) -> PlannedCampaign:
    """Write a case file with `[plan]` for a wall that is to be measured, and load it.

    Args:
        weather: the EPW or TMY3 file of a typical year.
        answers: what the user has already stated.
        to: the file to write; None for `case.toml` in the folder of the weather file.
        force: overwrite an existing file.
        ask: asks the user for missing values; with None, length and azimuth must be given.

    Returns:
        The campaign, loaded from the new file.

    Raises:
        InputError: a value is missing or invalid, or the weather cannot be read; no file is written then.
    """
    weather = Path(weather)
    target = weather.parent / "case.toml" if to is None else Path(to)
    check_target(target, force)
    read_weather_year(weather)
    answers = _complete(answers or PlanAnswers(), ask)
    _checked_plates(answers.plates or 0)
    path = Path(os.path.relpath(weather.resolve(), target.resolve().parent)).as_posix()
    text = _text(path, answers)
    campaign = campaign_of(text.encode(), target)
    write_case_file(target, text)
    return campaign


def _complete(answers: PlanAnswers, ask: Ask | None) -> PlanAnswers:
    """The answers with what is missing: asked for, or by default where there is one."""
    if ask is None:
        missing = [f"--{name}" for name in ("length", "azimuth") if getattr(answers, name) is None]
        if missing:
            raise InputError(f"{' and '.join(missing)} must be given where there is no terminal to ask at")
        return answers
    if answers.length is None:
        answers = replace(answers, length=ask_length(ask))
    questions: dict[str, tuple[str, str | None, Callable[[str], Any]]] = {
        "azimuth": (
            "Where does the outer face look? (N, NE, E, .., or degrees clockwise from north)",
            None,
            parse_azimuth,
        ),
        "indoor": ('Temperature of the room, degC, or "unheated"', "20", parse_indoor),
        "sensors": ("At most how many temperature sensors inside the wall", "2", _count),
        "plates": ("How many heat flux plates, 0, 1 or 2", "0", _plates),
        "days": ("At most how many days", "21", lambda text: decimal("days", text, "days")),
    }
    for name, question in questions.items():
        if getattr(answers, name) is None:
            answers = replace(answers, **{name: ask(*question)})
    return answers


def _plates(text: str) -> int:
    return _checked_plates(_count(text))


def _checked_plates(plates: int) -> int:
    if not 0 <= plates <= len(SIDES):
        raise InputError(f"{plates} heat flux plates; it must be 0, 1 or 2, one for each face")
    return plates


def _count(text: str) -> int:
    if not text.strip().isdigit():
        raise InputError(f"{text!r}; it must be a whole number")
    return int(text)


def _text(weather: str, answers: PlanAnswers) -> str:
    """The text of the case file."""
    faces = ["left", "right"] if answers.outside == "right" else ["right", "left"]  # the inner one first: no sun
    indoor = 20.0 if answers.indoor is None else answers.indoor
    lines = [
        "# Case for `wallid plan`, by `wallid new --plan`. Once there is a record, add [record] and [[sensor]].",
        *wall_lines(answers, "a guess", "without it that of masonry with the diffusivity"),
        "",
        "[plan]",
        key_line("weather", weather, "typical year, EPW or TMY3; relative to the folder of this file"),
        key_line("azimuth", answers.azimuth, "degrees clockwise from north, where the outer face looks"),
        key_line("tilt", 90.0, "degrees from the horizontal"),
        key_line("indoor", indoor, 'degC, or "unheated"'),
        key_line("sensors", 2 if answers.sensors is None else answers.sensors, "at most so many inside the wall"),
        key_line("plates", faces[: answers.plates or 0], "faces on which a heat flux plate can be put"),
        key_line("days", answers.days or 21.0, "the longest campaign"),
        key_line("uncertainty", 1.5, "factor by which the diffusivity may differ from its prior"),
    ]
    return "\n".join(lines) + "\n"
