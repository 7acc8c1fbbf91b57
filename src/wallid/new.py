"""Starting a case: from a logger's file, and what its columns are, to a commented `case.toml` that runs."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from ._columns import FEWEST_ROWS
from ._fields import InputError, nearest, number, one_of
from ._format import Format
from ._look import Column, Look, look
from ._toml import Answers, write_toml
from .case import Case, load
from .record import Record, read_record

Ask = Callable[[str, str | None], str]
"""Asks a person a question, with what is taken where the answer is empty."""

__all__ = ["Answers", "metres", "new_case", "place"]

_DAY = 86400.0
_LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_MOST_BARE = 3.0  # m; above it a number without a unit is rather cm or mm
_LEFT = re.compile(r"left|links|gauche|inner|indoor|inside|innen|int\b|_in\b|_i\b|si\b", re.IGNORECASE)
_RIGHT = re.compile(r"right|rechts|droit|outer|outdoor|outside|aussen|außen|ext\b|out\b|_e\b|se\b", re.IGNORECASE)


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


def place(text: str) -> tuple[str, float]:
    """A sensor's column and place, from "T1=0.05".

    Raises:
        InputError: anything else.
    """
    name, mark, where = text.rpartition("=")
    if not mark or not name.strip():
        raise InputError(f'--sensor {text!r}; it must be NAME=POSITION, such as "T1=0.05" or "T1=5 cm"')
    return name.strip(), metres(f"--sensor {name.strip()}", where)


def new_case(
    record: str | os.PathLike[str],
    answers: Answers | None = None,
    *,
    to: str | os.PathLike[str] | None = None,
    force: bool = False,
    ask: Ask | None = None,
) -> Case:
    """Write a `case.toml` for a record, once it is known to load.

    Arguments:
        record: the CSV file.
        answers: what is known already.
        to: the file to write; None for `case.toml` beside the record.
        force: write over a file that is there.
        ask: how to ask for what is missing; None refuses instead, and names what must be given.

    Returns:
        the case, loaded from the new file.

    Raises:
        InputError: something is missing or does not fit; nothing is written then.
    """
    record = Path(record)
    target = record.parent / "case.toml" if to is None else Path(to)
    if target.exists() and not force:
        raise InputError(f"{target} exists; --force writes over it, --to FILE writes another")
    if not target.parent.is_dir():
        raise InputError(f"{target}: there is no folder {target.parent}; make it first")
    answers = answers or Answers()
    seen = look(record, answers.form, answers.time)
    answers = _complete(record, answers, seen, ask)
    answers = replace(answers, form=_with_unit(answers, seen))
    units = _sensor_units(answers, seen)
    days = _window_days(_read(record, answers, units))
    where = Path(os.path.relpath(record.resolve(), target.resolve().parent)).as_posix()
    return _settle(target, write_toml(where, answers, units, days))


def _settle(target: Path, text: str) -> Case:
    """Write a file that loads, or nothing."""
    draft = target.with_name(f".wallid-{os.getpid()}-{target.name}")
    try:
        try:
            draft.write_text(text, encoding="utf-8")
            case = load(draft)
            os.replace(draft, target)
        finally:
            draft.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{target}: cannot be written ({error.strerror or error})") from error
    except InputError as error:
        raise InputError(str(error).replace(str(draft), str(target))) from error
    name = target.resolve().parent.name if target.name == "case.toml" else target.stem
    return replace(case, name=name or case.name, path=target)


def _read(path: Path, answers: Answers, units: dict[str, str]) -> Record:
    assert answers.time and answers.left and answers.right
    return read_record(
        path,
        time=answers.time,
        left=answers.left,
        right=answers.right,
        sensors=list(answers.sensors or ()),
        regressors=dict(answers.fluxes),
        form=answers.form,
        units=units,
    )


def _with_unit(answers: Answers, seen: Look) -> Format:
    """The format with the faces' unit, where they say one and the answers do not."""
    units = {seen[name].unit or "degC" for name in (answers.left, answers.right) if name is not None}
    if answers.form.unit is not None or units == {"degC"}:
        return answers.form
    if len(units) > 1:
        raise InputError(
            f'the faces "{answers.left}" and "{answers.right}" seem to be in {" and ".join(sorted(units))}; convert '
            "one, or state the unit of both with --unit"
        )
    return replace(answers.form, unit=units.pop())


def _sensor_units(answers: Answers, seen: Look) -> dict[str, str]:
    """The units of sensors that are not in the faces'."""
    usual = answers.form.unit or "degC"
    found = {name: seen[name].unit or usual for name in answers.sensors or ()}
    return {name: unit for name, unit in found.items() if unit != usual}


def _window_days(record: Record) -> float:
    """Three days, or half of what the record holds without a break."""
    rows = record.longest_part[1]
    if rows * record.step >= 6 * _DAY:
        return 3.0
    wanted = min(max(rows // 2, 2 * FEWEST_ROWS), rows)
    return float(f"{wanted * record.step / _DAY:.4g}")


def _complete(record: Path, answers: Answers, seen: Look, ask: Ask | None) -> Answers:
    """The answers with all that a case needs, asked for where it is missing."""
    for name in (answers.time, answers.left, answers.right, *(answers.sensors or ()), *answers.fluxes.values()):
        known = [column.name for column in seen.columns]
        if name is not None and name not in known:
            raise InputError(f'{record}: no column "{name}"; the columns are {", ".join(known)}{nearest(name, known)}')
    if answers.time is None:
        answers = replace(answers, time=seen.of("time")[0].name)
    if ask is None:
        _refuse_missing(record, answers, seen)
        return _settle_dates(record, answers, seen, None)
    answers = _settle_dates(record, answers, seen, ask)
    numbers = [column for column in seen.columns if column.kind in ("temperature", "number")]
    if answers.length is None:
        text = ask("Length of the wall between the two faces (m, or such as 43 cm)", None)
        answers = replace(answers, length=metres("length", text))
    if answers.left is None:
        name = _ask_column(ask, "Column of the left face, x = 0", numbers, _guess(numbers, _LEFT))
        answers = replace(answers, left=name)
    if answers.right is None:
        rest = [column for column in numbers if column.name != answers.left]
        answers = replace(answers, right=_ask_column(ask, "Column of the right face", rest, _guess(rest, _RIGHT)))
    if answers.outside is None:
        found = ask("Which face is outdoors, left or right", "left")
        answers = replace(answers, outside=one_of("outside", found.strip().lower(), ("left", "right")))
    if answers.sensors is None and not answers.fluxes:
        answers = replace(answers, sensors=_ask_sensors(ask, seen, answers))
        if not answers.sensors:
            answers = replace(answers, fluxes=_ask_fluxes(ask, seen))
    return answers


def _refuse_missing(record: Path, answers: Answers, seen: Look) -> None:
    """Without a terminal there is nobody to ask: say which options are missing."""
    missing = [f"--{name}" for name in ("length", "left", "right") if getattr(answers, name) is None]
    if not answers.sensors and not answers.fluxes:
        missing.append("--sensor NAME=POSITION (m from the left face), or --flux-left or --flux-right")
    if missing:
        there = ", ".join(map(str, seen.columns))
        raise InputError(f"{record}: nobody to ask here; give {', '.join(missing)}. The columns are {there}")


def _settle_dates(record: Path, answers: Answers, seen: Look, ask: Ask | None) -> Answers:
    """Whether dates begin with the day: as stated, as one of them shows, or asked for."""
    first = answers.form.day_first if answers.form.day_first is not None else seen.day_first
    if first is None and seen.ambiguous:
        if ask is None:
            raise InputError(f"{record}: dates may begin with the day or the month; give --day-first or --month-first")
        first = ask("Do dates begin with the day or the month, day or month", "day").strip().lower() != "month"
    return replace(answers, form=replace(answers.form, day_first=first))


def _guess(columns: list[Column], pattern: re.Pattern[str]) -> str | None:
    """The first column whose name looks like a face's."""
    return next((column.name for column in columns if pattern.search(column.name)), None)


def _ask_column(ask: Ask, question: str, columns: list[Column], default: str | None) -> str:
    there = ", ".join(map(str, columns))
    name = ask(f"{question} [{there}]", default).strip()
    known = [column.name for column in columns]
    if name not in known:
        raise InputError(f'no column "{name}"; these are left: {", ".join(known)}{nearest(name, known)}')
    return name


def _ask_sensors(ask: Ask, seen: Look, answers: Answers) -> dict[str, float]:
    """The place of each other column of temperatures; an empty answer leaves it out."""
    found = {}
    for column in seen.of("temperature"):
        if column.name in (answers.left, answers.right):
            continue
        text = ask(f"Place of {column} in the wall, m from the left face (empty: not in the wall)", "").strip()
        if text:
            found[column.name] = metres(f"position of {column.name}", text)
    return found


def _ask_fluxes(ask: Ask, seen: Look) -> dict[str, str]:
    """Columns of heat flux, where there is no sensor inside."""
    found = {}
    for side in ("left", "right"):
        there = ", ".join(map(str, seen.of("flux", "number"))) or "none seems to be one"
        name = ask(f"Column of the heat flux at the {side} face, positive along +x (empty: none) [{there}]", "").strip()
        if name:
            found[f"flux_{side}"] = name
    return found
