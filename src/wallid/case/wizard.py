"""Writing a new `case.toml` for a logger's file."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from .._internal.errors import InputError
from .._internal.units import DAY
from .._internal.validation import spelling_hint
from ..records.column_detection import DetectedColumns, detect_columns
from ..records.file_format import FileFormat
from ..records.table_columns import MIN_ROWS
from ..records.uniform_record import Record, read_record
from .case_definition import Case
from .case_file import load
from .toml_writer import Answers, write_toml
from .wizard_dialogue import Ask, ask_missing, guess_outdoor_face, parse_length

__all__ = ["Answers", "Ask", "new_case", "parse_length", "parse_sensor"]


def parse_sensor(text: str) -> tuple[str, float]:
    """The column and the position of a sensor (m) from a text such as "T1=0.05".

    Raises:
        InputError: another form of text.
    """
    name, equals, position = text.rpartition("=")
    if not equals or not name.strip():
        raise InputError(f'--sensor {text!r}; it must be NAME=POSITION, such as "T1=0.05" or "T1=5 cm"')
    return name.strip(), parse_length(f"--sensor {name.strip()}", position)


def new_case(
    record: str | os.PathLike[str],
    answers: Answers | None = None,
    *,
    to: str | os.PathLike[str] | None = None,
    force: bool = False,
    ask: Ask | None = None,
) -> Case:
    """Write a `case.toml` for a record; the file is written only if the case loads.

    Args:
        record: the CSV file.
        answers: what the user has already stated.
        to: the file to write; None for `case.toml` in the folder of the record.
        force: overwrite an existing file.
        ask: asks the user for missing values; with None a missing value is an error.

    Returns:
        The case, loaded from the new file.

    Raises:
        InputError: a value is missing or invalid; no file is written.
    """
    record = Path(record)
    target = record.parent / "case.toml" if to is None else Path(to)
    if target.exists() and not force:
        raise InputError(f"{target} exists; --force writes over it, --to FILE writes another")
    if not target.parent.is_dir():
        raise InputError(f"{target}: there is no folder {target.parent}; make it first")
    answers = answers or Answers()
    detected = detect_columns(record, answers.file_format, answers.time)
    answers = _complete(record, answers, detected, ask)
    answers = replace(answers, file_format=_with_unit(answers, detected))
    units = _sensor_units(answers, detected)
    days = _window_days(_read(record, answers, units))
    record_path = Path(os.path.relpath(record.resolve(), target.resolve().parent)).as_posix()
    return _write_checked(target, write_toml(record_path, answers, units, days))


def _write_checked(target: Path, text: str) -> Case:
    """Write the text to a temporary file, load it, and move it to the target if it loads."""
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
        file_format=answers.file_format,
        units=units,
    )


def _with_unit(answers: Answers, detected: DetectedColumns) -> FileFormat:
    """The file format with the unit of the face columns, unless the user has stated a unit."""
    units = {detected[name].unit or "degC" for name in (answers.left, answers.right) if name is not None}
    if answers.file_format.unit is not None or units == {"degC"}:
        return answers.file_format
    if len(units) > 1:
        raise InputError(
            f'the faces "{answers.left}" and "{answers.right}" seem to be in {" and ".join(sorted(units))}; convert '
            "one, or state the unit of both with --unit"
        )
    return replace(answers.file_format, unit=units.pop())


def _sensor_units(answers: Answers, detected: DetectedColumns) -> dict[str, str]:
    """The units of sensors whose unit differs from that of the faces."""
    default = answers.file_format.unit or "degC"
    units = {name: detected[name].unit or default for name in answers.sensors or ()}
    return {name: unit for name, unit in units.items() if unit != default}


def _window_days(record: Record) -> float:
    """The length of a window: three days, or half of the longest unbroken part of a short record."""
    rows = record.longest_part[1]
    if rows * record.step >= 6 * DAY:
        return 3.0
    wanted = min(max(rows // 2, 2 * MIN_ROWS), rows)
    return float(f"{wanted * record.step / DAY:.4g}")


def _complete(record: Path, answers: Answers, detected: DetectedColumns, ask: Ask | None) -> Answers:
    """The answers with the values that a case needs; the user is asked for missing ones if `ask` is not None."""
    for name in (answers.time, answers.left, answers.right, *(answers.sensors or ()), *answers.fluxes.values()):
        known = [column.name for column in detected.columns]
        if name is not None and name not in known:
            raise InputError(
                f'{record}: no column "{name}"; the columns are {", ".join(known)}{spelling_hint(name, known)}'
            )
    if answers.time is None:
        answers = replace(answers, time=detected.of_kind("time")[0].name)
    if answers.file_format.day_first is None:
        answers = replace(answers, file_format=replace(answers.file_format, day_first=detected.day_first))
    if ask is not None:
        return ask_missing(answers, detected, ask)
    _raise_missing(record, answers, detected)
    assert answers.left and answers.right
    return replace(answers, outside=answers.outside or guess_outdoor_face(answers.left, answers.right))


def _raise_missing(record: Path, answers: Answers, detected: DetectedColumns) -> None:
    """Raise an error that names the missing options, as nobody can be asked without a terminal."""
    missing = [f"--{name}" for name in ("length", "left", "right") if getattr(answers, name) is None]
    if not answers.sensors and not answers.fluxes:
        missing.append("--sensor NAME=POSITION (m from the left face), or --flux-left or --flux-right")
    if missing:
        columns = ", ".join(map(str, detected.columns))
        raise InputError(f"{record}: no terminal for questions; give {', '.join(missing)}. The columns are {columns}")
    if answers.file_format.day_first is None and detected.ambiguous:
        raise InputError(f"{record}: dates begin with the day or the month; give --day-first or --month-first")
