"""What every command on a case does: load it, run with a progress bar, write, print, and end with a status."""

from __future__ import annotations

import shlex
import sys
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import jax
import typer
from threadpoolctl import threadpool_limits

from .. import workflow
from .._internal.errors import InputError
from .._internal.validation import within
from .._internal.xla_options import prepare_xla
from ..case.case_definition import Case
from ..case.case_file import load
from ..case.time_window import Window, check_unbroken, window_rows


def carry_out(
    name: str,
    model: str | None,
    stages: tuple[str, ...],
    out: Path,
    json: bool,
    quiet: bool,
    formats: str,
    *,
    from_row: int | None = None,
    free: list[str] | None = None,
    orders: str = "",
    **choices: str | int | workflow.Designing,
) -> None:
    """Load, run, write, print; every message to standard error but the summary or the JSON.

    Args:
        name: of the case, as the user gave it.
        model, from_row, free, orders, out, json, quiet, formats: the options of that name (`_options`).
        choices: passed on to `workflow.run`.

    Raises:
        typer.Exit: status 1 where the record gives no number to rely on, 2 for bad input.
    """
    from ..report import writer as report

    try:
        wanted = report.parse_formats(formats)
        with _progress(quiet or json) as progress:
            progress("reading the case", 0.0)
            _set_up()
            case = _chosen(load(name), model, free)
            report.check_out(out)
            window = None if from_row is None else _window(case, from_row)
            done = workflow.run(
                case,
                stages=stages,
                window=window,
                orders=_parse_orders(orders),
                progress=lambda stage, share: progress(stage, 0.05 + 0.8 * share),
                **choices,  # pyright: ignore[reportArgumentType] (typer has checked the words)
            )
            progress("figures", 0.9)
            written = report.write(done, out, shlex.join(["wallid", *sys.argv[1:]]), formats=wanted)
    except InputError as error:
        refuse(error)
    if json:
        print((out / "result.json").read_text("utf-8"), end="")
    elif not quiet:
        _summarise(done, name, written)
    if done.unreliable:
        raise typer.Exit(1)


def _summarise(done: workflow.Run, name: str, written: list[Path]) -> None:
    """What was found, where it lies, and what to ask next."""
    print(done)
    print(f"\nwrote        {', '.join(path.name for path in written)} to {written[0].parent}")
    if kept := [path.name for path in written if path.name.startswith("report-")]:
        print(f"kept         the report of an earlier command there, as {kept[0]}")
    if done.fit is not None and done.diagnosis is None and done.case.sensors and not done.unreliable:
        print(f"next         wallid diagnose {shlex.quote(name)}: does the model miss something?")


def refuse(error: InputError) -> NoReturn:
    """One line on standard error, and status 2."""
    print(f"wallid: {error}", file=sys.stderr)
    raise typer.Exit(2) from None


def _set_up() -> None:
    """Settings of the whole process, which a command has to itself."""
    jax.config.update("jax_enable_x64", True)
    prepare_xla()
    threadpool_limits(limits=1, user_api="blas")  # `mim` says why


def _chosen(case: Case, model: str | None, free: list[str] | None) -> Case:
    """The case with the model that `--model` asks for, and what `--free` adds to the estimate."""
    if free:
        with within("--free"):
            case = replace(case, choices=replace(case.choices, free=tuple(free)))
    return case if model is None else replace(case, choices=replace(case.choices, model=model))


def _window(case: Case, row: int) -> Window:
    """The case's window from `--from-row` on."""
    rows = window_rows(case, case.choices.window_days)
    if row + rows > case.record.rows:
        raise InputError(
            f"--from-row {row}: a window of {rows} rows from there passes the record's end; "
            f"the last start is {case.record.rows - rows}"
        )
    check_unbroken(case, Window(row, rows))
    return Window(row, rows)


def _parse_orders(text: str) -> tuple[int, ...]:
    """The orders that `--orders` lists with commas."""
    try:
        return tuple(int(part) for part in text.split(",") if part.strip())
    except ValueError:
        raise InputError(f'--orders {text!r}: whole numbers with commas are wanted, such as "2,5,10"') from None


@contextmanager
def _progress(silent: bool):
    """A progress bar on standard error: told (stage, share of the work done)."""
    if silent:

        def say_nothing(stage: str, share: float) -> None:
            return

        yield say_nothing
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description:<45}"), BarColumn(), TimeElapsedColumn())
    console = Console(stderr=True)
    # a file or a pipe wants messages, not a bar
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=1.0)

        def say(stage: str, share: float) -> None:
            bar.update(task, description=stage, completed=share)

        yield say
