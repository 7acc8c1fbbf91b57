"""Starting a case: from a logger's file, and what its columns are, to a commented `case.toml` that runs."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from .._internal.errors import InputError
from .._internal.units import DAY
from .._internal.validation import nearest
from ..records.column_detection import Look, look
from ..records.file_format import Format
from ..records.table_columns import FEWEST_ROWS
from ..records.uniform_record import Record, read_record
from .case_definition import Case
from .case_file import load
from .toml_writer import Answers, write_toml
from .wizard_dialogue import Ask, complete, metres, outdoors

__all__ = ["Answers", "Ask", "metres", "new_case", "place"]


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

    Args:
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
    if rows * record.step >= 6 * DAY:
        return 3.0
    wanted = min(max(rows // 2, 2 * FEWEST_ROWS), rows)
    return float(f"{wanted * record.step / DAY:.4g}")


def _complete(record: Path, answers: Answers, seen: Look, ask: Ask | None) -> Answers:
    """The answers with all that a case needs, asked for where it is missing and there is somebody to ask."""
    for name in (answers.time, answers.left, answers.right, *(answers.sensors or ()), *answers.fluxes.values()):
        known = [column.name for column in seen.columns]
        if name is not None and name not in known:
            raise InputError(f'{record}: no column "{name}"; the columns are {", ".join(known)}{nearest(name, known)}')
    if answers.time is None:
        answers = replace(answers, time=seen.of("time")[0].name)
    if answers.form.day_first is None:
        answers = replace(answers, form=replace(answers.form, day_first=seen.day_first))
    if ask is not None:
        return complete(answers, seen, ask)
    _refuse_missing(record, answers, seen)
    assert answers.left and answers.right
    return replace(answers, outside=answers.outside or outdoors(answers.left, answers.right))


def _refuse_missing(record: Path, answers: Answers, seen: Look) -> None:
    """Without a terminal there is nobody to ask: say which options are missing."""
    missing = [f"--{name}" for name in ("length", "left", "right") if getattr(answers, name) is None]
    if not answers.sensors and not answers.fluxes:
        missing.append("--sensor NAME=POSITION (m from the left face), or --flux-left or --flux-right")
    if missing:
        there = ", ".join(map(str, seen.columns))
        raise InputError(f"{record}: nobody to ask here; give {', '.join(missing)}. The columns are {there}")
    if answers.form.day_first is None and seen.ambiguous:
        raise InputError(f"{record}: dates may begin with the day or the month; give --day-first or --month-first")
