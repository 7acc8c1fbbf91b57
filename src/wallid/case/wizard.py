"""Writing a new `case.toml` for a logger's file."""

from __future__ import annotations

import os
import shlex
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from .._internal.errors import InputError
from .._internal.interrupts import signals_held, written
from .._internal.units import DAY
from .._internal.validation import spelling_hint
from ..records.column_detection import DetectedColumns, detect_columns
from ..records.file_format import FileFormat
from ..records.table_columns import MIN_ROWS
from ..records.uniform_record import Record, read_record
from .case_definition import Case
from .case_file import case_of
from .toml_writer import Answers, write_toml
from .wizard_corrections import ask_again
from .wizard_dialogue import (
    Ask,
    ask_missing,
    guess_outdoor_face,
    parse_length,
    suggested_face,
    suggested_use,
)

_COLUMN_OPTIONS = ("irradiance", "air_outdoor", "air_indoor", "flux_left", "flux_right")

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
    """Write a `case.toml` for a record, and load it.

    Where the finished case cannot be used, the user is asked which answer to change. Without a user, or on request, the
    file is written as it is, with the fault in its first line.

    Args:
        record: the CSV file.
        answers: what the user has already stated.
        to: the file to write; None for `case.toml` in the folder of the record.
        force: overwrite an existing file.
        ask: asks the user for missing values; with None a missing value is an error.

    Returns:
        The case, loaded from the new file.

    Raises:
        InputError: a value is missing, no file is written; or the case that was written cannot be used.
    """
    record = Path(record)
    target = record.parent / "case.toml" if to is None else Path(to)
    check_target(target, force)
    answers = answers or Answers()
    detected = detect_columns(record, answers.file_format, answers.time)
    answers = _complete(record, answers, detected, ask)
    record_path = Path(os.path.relpath(record.resolve(), target.resolve().parent)).as_posix()
    while True:
        try:
            text = _valid_text(record, record_path, answers, detected)
            case = case_of(text.encode(), target)
        except InputError as error:
            fault = str(error)
        else:
            write_case_file(target, text)
            return case
        changed = None
        if ask is not None:
            with suppress(InputError):  # the user has stopped: the answers are kept in the file
                changed = ask_again(answers, detected, ask, fault)
        if changed is None:
            write_case_file(target, write_toml(record_path, answers, {}, 3.0, fault=fault))
            raise InputError(
                f"{target} is written and cannot be used yet: {fault}. Edit it, then `wallid check {target}`"
            )
        answers = changed


def check_target(target: Path, force: bool) -> None:
    """Raise an error before the first question where the answers could not be written."""
    if target.exists() and not force:
        raise InputError(f"{target} exists; --force writes over it, --to FILE writes another")
    if not target.parent.is_dir():
        raise InputError(f"{target}: there is no folder {target.parent}; make it first")
    if target.is_dir() or not os.access(target.parent, os.W_OK):
        raise InputError(f"{target}: cannot be written; --to FILE writes another")


def _valid_text(record: Path, record_path: str, answers: Answers, detected: DetectedColumns) -> str:
    """The text of the case, after the record has been read as the answers say."""
    answers = replace(answers, file_format=_with_unit(answers, detected))
    units = _sensor_units(answers, detected)
    return write_toml(record_path, answers, units, _window_days(_read(record, answers, units)))


def write_case_file(target: Path, text: str) -> None:
    """Write the text by way of a temporary file, so that an existing file is replaced as a whole."""
    draft = target.with_name(f".wallid-{os.getpid()}-{target.name}")
    with signals_held():
        try:
            draft.write_text(text, encoding="utf-8")
            os.replace(draft, target)
        except OSError as error:
            draft.unlink(missing_ok=True)
            raise InputError(f"{target}: cannot be written ({error.strerror or error})") from error
        written(f"{target} was written")


def _read(path: Path, answers: Answers, units: dict[str, str]) -> Record:
    assert answers.time and answers.left and answers.right
    return read_record(
        path,
        time=answers.time,
        left=answers.left,
        right=answers.right,
        sensors=list(answers.sensors or ()),
        regressors=dict(answers.regressors),
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
    for name in answers.columns:
        known = [column.name for column in detected.columns]
        if name not in known:
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
    if not answers.has_channel:
        missing.append("--sensor NAME=POSITION (m from the left face), or --flux-left or --flux-right")
    if missing:
        columns = ", ".join(map(str, detected.columns))
        suggested = _suggested_options(answers, detected)
        raise InputError(
            f"{record}: no terminal for questions; give {', '.join(missing)}. The columns are {columns}"
            + (f". By their names: {' '.join(suggested)}" if suggested else "")
        )
    if answers.file_format.day_first is None and detected.ambiguous:
        raise InputError(f"{record}: dates begin with the day or the month; give --day-first or --month-first")


def _suggested_options(answers: Answers, detected: DetectedColumns) -> list[str]:
    """The options for columns whose names show their use."""
    temperatures, options = detected.of_kind("temperature", "number"), list[str]()
    left = answers.left or suggested_face(temperatures, "left", answers.right)
    right = answers.right or suggested_face(temperatures, "right", left)
    uses: dict[str, str] = {}
    for key, name in (("left", left), ("right", right)):
        if name is not None:
            uses[key] = name
    for column in detected.columns:
        use = suggested_use(column)
        if use in _COLUMN_OPTIONS and column.name not in (*uses.values(), *answers.columns):
            uses.setdefault(use, column.name)
    for key, name in uses.items():
        if getattr(answers, key, None) is None and key not in answers.regressors:
            options.append(f"--{key.replace('_', '-')} {shlex.quote(name)}")
    return options
