"""What a run leaves behind: `result.json`, `report.html`, figures and the reduced model, written all or not at all."""

from __future__ import annotations

import json
import os
import re
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .._internal.errors import InputError
from ..workflow import Run
from .result_json import result

FORMATS = ("png", "svg", "pdf")
"""In which figures can be written."""
COMMANDS = ("demo", "run", "check", "design", "estimate", "diagnose")
"""That write a report; each keeps what another one left in its folder."""
_COMMAND = re.compile(rf"wallid (?P<name>{'|'.join(COMMANDS)})\b")


def dumps(run: Run) -> str:
    """result.json as text."""
    return _text(result(run))


def _text(found: dict[str, Any]) -> str:
    return json.dumps(found, indent=2, allow_nan=False)


def parse_formats(text: str) -> tuple[str, ...]:
    """The formats of figures that a list with commas names.

    Raises:
        InputError: none, or one that is not written.
    """
    found = tuple(dict.fromkeys(part.strip().lower() for part in text.split(",") if part.strip()))
    if not found or not set(found) <= set(FORMATS):
        raise InputError(f'--format {text!r}: png, svg or pdf are wanted, several with commas, such as "png,svg"')
    return found


def write(run: Run, out: str | Path, command: str = "", formats: Sequence[str] = ("png",)) -> list[Path]:
    """Write result.json, report.html, the figures and the reduced model into a folder: all of them, or none.

    Args:
        command: that makes them again, for the report.
        formats: of the figures' files, among `FORMATS`.

    Raises:
        InputError: the folder cannot be made or written.
    """
    out, own = Path(out), _name_of(command)
    with _folder(out) as made:
        names = _fill(run, made, command, formats)
        names += _keep(out, made, own)
        for name in names:
            os.replace(made / name, out / name)
    stale = _written() - set(names)
    if own:
        stale |= set(_kept_names(own)) - set(names)
    for name in stale:
        (out / name).unlink(missing_ok=True)
    return [out / name for name in names]


def _name_of(command: str) -> str:
    """Which of the commands a line is; empty where it is none of them."""
    found = _COMMAND.match(command)
    return found["name"] if found else ""


def _kept_names(name: str) -> tuple[str, str]:
    """The files that another command's report and numbers are kept as, by its name."""
    return f"report-{name}.html", f"result-{name}.json"


def _keep(out: Path, made: Path, name: str) -> list[str]:
    """What another command left in `out`, under its own name, and links from page to page; the files' names."""
    from .page import linked

    earlier = _earlier(out)
    names: list[str] = []
    if earlier not in ("", name) and name:
        names += _kept_names(earlier)
        (made / names[1]).write_text((out / "result.json").read_text("utf-8"), encoding="utf-8")
        text = linked((out / "report.html").read_text("utf-8"), {"report.html": f"Made later by wallid {name}"})
        (made / names[0]).write_text(text, encoding="utf-8")
    there = [
        other
        for other in sorted(COMMANDS, key=lambda other: other != earlier)
        if other != name and (_kept_names(other)[0] in names or (out / _kept_names(other)[0]).exists())
    ]
    page = made / "report.html"
    links = {_kept_names(other)[0]: f"Made earlier by wallid {other}" for other in there}
    page.write_text(linked(page.read_text("utf-8"), links), encoding="utf-8")
    return names


def _earlier(out: Path) -> str:
    """Which command left report and numbers in a folder; empty where there is none, or nothing says which."""
    try:
        told = json.loads((out / "result.json").read_text("utf-8"))
        return _name_of(told["command"]) if (out / "report.html").exists() else ""
    except (OSError, ValueError, KeyError, TypeError):
        return ""


def _written() -> set[str]:
    """What a run may write: what an earlier one left of these and this one did not write is not its result."""
    from .figures import STEMS

    figures = (f"{stem}.{kind}" for stem in STEMS for kind in FORMATS)
    return {"result.json", "report.html", "model.npz", *figures}


def check_out(out: str | Path) -> None:
    """Refuse a folder that cannot be written before anything long begins, and leave no trace.

    Raises:
        InputError: the folder cannot be made or written.
    """
    out = Path(out)
    missing = [folder for folder in (out, *out.parents) if not folder.exists()]
    with _folder(out):
        pass
    for folder in missing:
        folder.rmdir()


@contextmanager
def _folder(out: Path) -> Iterator[Path]:
    """A folder for work in progress, inside `out`: each move out of it is one step of the file system."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=out, prefix=".wallid-") as made:
            yield Path(made)
    except OSError as error:
        raise InputError(f"--out {out}: cannot write there ({error.strerror or error})") from error


def _fill(run: Run, folder: Path, command: str, formats: Sequence[str]) -> list[str]:
    """Write all of it into a folder; the files' names, `result.json` last."""
    from .figures import diagnosis, of_stages
    from .page import page
    from .svg import draw

    figures = [*of_stages(run), *(diagnosis(run.diagnosis) if run.diagnosis is not None else ())]
    names, drawn = [], [draw(stem, figure, formats) for stem, figure in figures]
    for one in drawn:
        for kind, content in one.files.items():
            names.append(f"{one.stem}.{kind}")
            (folder / names[-1]).write_bytes(content)
    found = result(run) | ({"command": command} if command else {})
    names.append("report.html")
    (folder / names[-1]).write_text(page(run, found, drawn, command), encoding="utf-8")
    if run.learned is not None:
        names.append("model.npz")
        run.learned.system.save(folder / names[-1])
    names.append("result.json")
    (folder / names[-1]).write_text(_text(found) + "\n", encoding="utf-8")
    return names
