"""Writing of `result.json`, `report.html`, the figures and the reduced-order model of a run: all of them, or none."""

from __future__ import annotations

import io
import json
import os
import re
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._internal.errors import InputError
from .._internal.interrupts import give_up_if_interrupted, signals_held, written
from ..workflow import Run
from .result_json import SCHEMA, result_entries

if TYPE_CHECKING:
    from .single_page import SinglePage
    from .svg import DrawnFigure

FORMATS = ("png", "svg", "pdf")
"""Formats of figure files."""
COMMANDS = ("demo", "run", "check", "design", "estimate", "diagnose", "plan", "forecast", "section")
"""Commands that write a report; each keeps the report of another command in its folder."""
_COMMAND = re.compile(rf"wallid (?P<name>{'|'.join(COMMANDS)})\b")


def result_as_json(run: Run) -> str:
    """result.json of a run as text."""
    return _as_json(result_entries(run))


def _as_json(entries: dict[str, Any]) -> str:
    return json.dumps(entries, indent=2, allow_nan=False)


def parse_formats(text: str) -> tuple[str, ...]:
    """The figure formats in a comma-separated list.

    Args:
        text: such as "png,svg".

    Raises:
        InputError: no format, or one that is not in `FORMATS`.
    """
    formats = tuple(dict.fromkeys(part.strip().lower() for part in text.split(",") if part.strip()))
    if not formats or not set(formats) <= set(FORMATS):
        raise InputError(f'--format {text!r}: must be png, svg or pdf, or several with commas, such as "png,svg"')
    return formats


def write_report(run: Run, out: str | Path, command: str = "", formats: Sequence[str] = ("png",)) -> list[Path]:
    """Write result.json, report.html, the figures and the reduced-order model into a folder: all of them, or none.

    Args:
        run: with its results.
        out: the folder; it is created where it does not exist.
        command: command line of the run, for the report.
        formats: of the figure files, among `FORMATS`.

    Returns:
        Paths of the files.

    Raises:
        InputError: the folder cannot be created or written.
    """
    with _errors_name_the_folder(Path(out)):  # drawing a figure may use the disk too
        return write_files(_contents(run, command, formats), out, command)


def write_page(page: SinglePage, out: str | Path, command: str = "", formats: Sequence[str] = ("png",)) -> list[Path]:
    """Write result.json, report.html, the figures and further files of a result into a folder: all of them, or none.

    Args:
        page: what the result is written as (`plan_page`, `forecast_page`, `section_page`).
        out, command, formats: as in `write_report`.

    Returns:
        Paths of the files.

    Raises:
        InputError: the folder cannot be created or written.
    """
    with _errors_name_the_folder(Path(out)):
        return write_files(_contents_of_page(page, command, formats), out, command)


def _figure_files(figures: Sequence[DrawnFigure]) -> dict[str, bytes]:
    """The contents of the figures' files by name."""
    return {f"{one.stem}.{kind}": content for one in figures for kind, content in one.files.items()}


def write_files(files: dict[str, bytes], out: str | Path, command: str) -> list[Path]:
    """Write the files of a command into a folder: all of them, or none; those of another command are kept.

    Raises:
        InputError: the folder cannot be created or written.
    """
    out, own_name = Path(out), _command_name(command)
    with _errors_name_the_folder(out), signals_held(), _work_folder(out) as folder:
        others = _files_of_others(out, own_name)
        files |= _other_reports(out, files, own_name)
        for name, content in files.items():
            (folder / name).write_bytes(content)
        give_up_if_interrupted()
        for name in _replaced(out, files, others):
            os.replace(out / name, out / _renamed(name, _earlier_command(out)))
        stale = _own_files(out, own_name) - set(files) - others
        for name in files:
            os.replace(folder / name, out / name)
        for name in stale:
            (out / name).unlink(missing_ok=True)
        written(f"all files were written to {out}")
    return [out / name for name in files]


def _files_in(result: Path) -> set[str]:
    """Names of the files of the command whose numbers are in a file; all that a run may write where it lists none."""
    try:
        entries = json.loads(result.read_text("utf-8"))
        return set(entries["files"]) if "files" in entries else _possible_files()
    except (OSError, ValueError, TypeError):
        return set()


def _own_files(out: Path, name: str) -> set[str]:
    """Files in a folder that an earlier run of the same command wrote; of any command where its name is unknown."""
    own = _kept_names(name) if name else ()
    files = _files_in(out / own[1]) | set(own) if own else set()
    return files | _files_in(out / "result.json") if _earlier_command(out) in ("", name) else files


def _files_of_others(out: Path, name: str) -> set[str]:
    """Files in a folder that other commands wrote."""
    if not name:
        return set()
    kept = [_kept_names(other)[1] for other in COMMANDS if other != name]
    earlier = ["result.json"] if _earlier_command(out) not in ("", name) else []
    return set().union(*(_files_in(out / result) for result in (*kept, *earlier))) - {"result.json", "report.html"}


def _replaced(out: Path, files: dict[str, bytes], others: set[str]) -> list[str]:
    """Figures and models of another command that would be replaced by others with the same names."""
    if _earlier_command(out) == "":
        return []
    both = [name for name in files if name in others and (out / name).exists()]
    return [name for name in both if (out / name).read_bytes() != files[name]]


def _renamed(name: str, command: str) -> str:
    """The name under which a command's file is kept."""
    path = Path(name)
    return f"{path.stem}-{command}{path.suffix}"


def _command_name(command: str) -> str:
    """Name of the command in a command line; empty where it is not in `COMMANDS`."""
    match = _COMMAND.match(command)
    return match["name"] if match else ""


def _kept_names(name: str) -> tuple[str, str]:
    """File names under which the report and the numbers of another command are kept."""
    return f"report-{name}.html", f"result-{name}.json"


def _other_reports(out: Path, files: dict[str, bytes], name: str) -> dict[str, bytes]:
    """The report of another command in `out` under its own name, and the page of this one with links to all others."""
    from .page import with_links

    earlier = _earlier_command(out)
    kept: dict[str, bytes] = {}
    if earlier not in ("", name) and name:
        page, numbers = _kept_names(earlier)
        text = with_links((out / "report.html").read_text("utf-8"), {"report.html": f"Made later by wallid {name}"})
        kept = {page: text.encode(), numbers: (out / "result.json").read_bytes()}
    others = [
        other
        for other in sorted(COMMANDS, key=lambda other: other != earlier)
        if other != name and (_kept_names(other)[0] in kept or (out / _kept_names(other)[0]).exists())
    ]
    links = {_kept_names(other)[0]: f"Made earlier by wallid {other}" for other in others}
    return kept | {"report.html": with_links(files["report.html"].decode(), links).encode()}


def _earlier_command(out: Path) -> str:
    """The command whose report is in a folder; empty where there is no report, or its command is unknown."""
    try:
        entries = json.loads((out / "result.json").read_text("utf-8"))
        return _command_name(entries["command"]) if (out / "report.html").exists() else ""
    except (OSError, ValueError, KeyError, TypeError):
        return ""


def _possible_files() -> set[str]:
    """Names of all files that a run may write; those of an earlier run that this run does not write are removed."""
    from .figures import STEMS

    figures = (f"{stem}.{kind}" for stem in STEMS for kind in FORMATS)
    return {"result.json", "report.html", "model.npz", *figures}


def check_output_folder(out: str | Path) -> None:
    """Check that a folder can be written, before a long computation; nothing is left in it.

    Raises:
        InputError: the folder cannot be created or written.
    """
    out = Path(out)
    with _errors_name_the_folder(out), signals_held():
        missing = _missing_folders(out)
        with _work_folder(out):
            pass
        for folder in missing:
            folder.rmdir()


def _missing_folders(out: Path) -> list[Path]:
    """The folder and its parents that do not exist, the deepest first."""
    return [folder for folder in (out, *out.parents) if not folder.exists()]


@contextmanager
def _work_folder(out: Path) -> Iterator[Path]:
    """A temporary folder inside `out`, so that moving a file to `out` is one operation of the file system.

    `out` is created; where the block fails, what was created is removed.
    """
    missing = _missing_folders(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=out, prefix=".wallid-") as folder:
            yield Path(folder)
    except BaseException:
        for created in missing:
            with suppress(OSError):  # it was not created, or somebody else has written into it
                created.rmdir()
        raise


@contextmanager
def _errors_name_the_folder(out: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"--out {out}: cannot write there ({error.strerror or error})") from error


def _contents(run: Run, command: str, formats: Sequence[str]) -> dict[str, bytes]:
    """The contents of all files by name, `result.json` last. Nothing is on the disk before all of them are ready."""
    from .figures import diagnosis_figures, stage_figures
    from .page import render_page
    from .svg import draw_figure

    figures = [*stage_figures(run), *(diagnosis_figures(run.diagnosis) if run.diagnosis is not None else ())]
    drawn_figures = [draw_figure(stem, figure, formats) for stem, figure in figures]
    files = _figure_files(drawn_figures)
    names = [*files, "report.html", *(("model.npz",) if run.learned is not None else ()), "result.json"]
    entries = result_entries(run) | ({"command": command} if command else {}) | {"files": names}
    files["report.html"] = render_page(run, entries, drawn_figures, command).encode()
    if run.learned is not None:
        model = io.BytesIO()
        run.learned.system.save(model)
        files["model.npz"] = model.getvalue()
    files["result.json"] = (_as_json(entries) + "\n").encode()
    return files


def _contents_of_page(page: SinglePage, command: str, formats: Sequence[str]) -> dict[str, bytes]:
    """The contents of all files of a page by name, `result.json` last."""
    from .svg import draw_figure

    drawn = [draw_figure(stem, figure, formats) for stem, figure in page.draw()]
    files = _figure_files(drawn) | dict(page.files)
    entries: dict[str, Any] = {"schema": SCHEMA, "case": page.case, "diffusivity": None, "verdict": None}
    entries |= dict(page.entries) | ({"command": command} if command else {})
    entries["files"] = [*files, "report.html", "result.json"]
    files["report.html"] = page.render(drawn, command).encode()
    files["result.json"] = (_as_json(entries) + "\n").encode()
    return files
