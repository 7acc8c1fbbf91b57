"""The execution of a command: load the case, run the stages, write the files, print, and set the exit status."""

from __future__ import annotations

import os
import shlex
import sys
import time as clock
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NoReturn

import jax
import typer
from threadpoolctl import threadpool_limits

from .. import workflow
from .._internal.errors import InputError
from .._internal.number_formats import terminal_text
from .._internal.progress import part_of
from .._internal.validation import error_context, number
from .._internal.xla_options import prepare_xla
from ..case.case_definition import Case
from ..case.case_file import load, load_campaign, load_section
from ..case.time_window import Window, check_unbroken, row_at, window_rows
from ..estimation.forecast_result import Forecast
from ..experiment_design.campaign_plan.plan_result import CampaignPlan
from ..models.section.section_solution import SectionSolution
from .output import print_message, print_output
from .progress import ProgressDisplay, progress_display
from .stage_lines import key_result, stage_line

_LIKELY = 0.5  # chance of an uninformative record from which a plan has status 1


def run_command(
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
    **run_options: str | int | workflow.DesignOptions,
) -> None:
    """Load a case, run the stages, write the files and print a summary.

    Only the summary or the JSON goes to standard output. The lines of the stages and all other messages go to standard
    error.

    Args:
        name: of the case, as the user stated it.
        model, from_row, free, orders, out, json, quiet, formats: the options with these names.
        run_options: passed on to `workflow.run`.

    Raises:
        typer.Exit: status 1 if the result is unreliable, 2 for invalid input.
    """
    from ..report import writer as report

    try:
        figure_formats = report.parse_formats(formats)
        with progress_display(quiet or json) as display:
            display.step("reading the case", 0.0)
            start = clock.perf_counter()
            _configure_process()
            case = _with_options(load(name), model, free)
            report.check_output_folder(out)
            record = f"{case.record.rows} rows, one every {case.record.step:g} s"
            display.line(stage_line("record", record, clock.perf_counter() - start))
            window = None if from_row is None else _window(case, from_row)
            result = workflow.run(
                case,
                stages=stages,
                window=window,
                orders=_parse_orders(orders),
                progress=lambda text, share: display.step(text, 0.05 + 0.8 * share),
                finished=lambda run, stage: display.line(stage_line(stage, key_result(run, stage), run.seconds[stage])),
                **run_options,  # pyright: ignore[reportArgumentType] (typer has checked the values)
            )
            written = _written(display, partial(report.write_report, result, out, formats=figure_formats))
    except InputError as error:
        exit_with_error(error)
    if json:
        print_output((out / "result.json").read_text("utf-8"), end="")
    elif not quiet:
        _print_summary(result, name, written)
    if result.unreliable_reason:
        raise typer.Exit(1)


def run_plan(name: str, out: Path, json: bool, quiet: bool, formats: str) -> None:
    """Load a planned campaign, plan it, write the files and print a summary.

    Args:
        name: of the case, as the user stated it.
        out, json, quiet, formats: the options with these names.

    Raises:
        typer.Exit: status 1 if the record would more likely than not be uninformative, 2 for invalid input.
    """
    from ..discrepancy.next_measurement.plan_with_columns import plan
    from ..report import writer as report
    from ..report.plan_page import plan_page

    try:
        figure_formats = report.parse_formats(formats)
        with progress_display(quiet or json) as display:
            display.step("reading the case", 0.0)
            _configure_process()
            campaign = load_campaign(name)
            report.check_output_folder(out)
            start = clock.perf_counter()
            result = plan(campaign, progress=part_of(display.step, 0.05, 0.9))
            places = ", ".join(f"{x:.3g} m" for x in result.positions)
            days = f"{result.days:g} days, {f'sensors at {places}' if places else 'no sensor inside'}"
            display.line(stage_line("plan", days, clock.perf_counter() - start))
            written = _written(display, partial(report.write_page, plan_page(result), out, formats=figure_formats))
    except InputError as error:
        exit_with_error(error)
    _print_result(result, written, json, quiet)
    if result.uninformative > _LIKELY:
        raise typer.Exit(1)


def run_forecast(
    name: str, start: str, hours: float, days: float, faces: str, out: Path, json: bool, quiet: bool, formats: str
) -> None:
    """Load a case, forecast its readings, write the files and print a summary.

    Args:
        name: of the case, as the user stated it.
        start, hours, days, faces: as for `forecast`.
        out, json, quiet, formats: the options with these names.

    Raises:
        typer.Exit: status 1 where earlier predictions missed their bands, 2 for invalid input.
    """
    from ..estimation.forecasting import forecast
    from ..report import writer as report
    from ..report.forecast_page import forecast_page

    try:
        figure_formats = report.parse_formats(formats)
        with progress_display(quiet or json) as display:
            display.step("reading the case", 0.0)
            _configure_process()
            case = load(name)
            report.check_output_folder(out)
            began = clock.perf_counter()
            progress = part_of(display.step, 0.05, 0.9)
            result = forecast(case, start, hours, days=days, faces=faces, progress=progress)  # pyright: ignore[reportArgumentType] (typer has checked it)
            display.line(
                stage_line("forecast", f"{result.hours:.3g} h from {result.start}", clock.perf_counter() - began)
            )
            page = forecast_page(result)
            written = _written(display, partial(report.write_page, page, out, formats=figure_formats))
    except InputError as error:
        exit_with_error(error)
    _print_result(result, written, json, quiet)
    if result.unreliable_reason:
        raise typer.Exit(1)


def run_section(
    name: str,
    left: float | None,
    right: float | None,
    at: str | None,
    one_dimension: bool,
    out: Path,
    json: bool,
    quiet: bool,
    formats: str,
) -> None:
    """Load the section of a case, solve it, write the files and print a summary.

    Args:
        name: of the case, as the user stated it.
        left, right, at, one_dimension: the options with these names.
        out, json, quiet, formats: the options with these names.

    Raises:
        typer.Exit: status 2 for invalid input.
    """
    from ..estimation.one_dimension import cost_of_one_dimension
    from ..models.section.section_fields import temperatures_at
    from ..models.section.section_solution import solve_section
    from ..report import writer as report
    from ..report.section_page import section_page

    try:
        figure_formats = report.parse_formats(formats)
        if (left is None) != (right is None):
            raise InputError("--left and --right belong together: a steady state needs both temperatures")
        for option, value in (("--left", left), ("--right", right)):
            if value is not None:
                number(option, value, "degC")
        with progress_display(quiet or json) as display:
            display.step("reading the case", 0.0)
            _configure_process()
            section = load_section(name)
            temperatures = cost = None
            if at is not None or one_dimension:
                with error_context("--at" if at is not None else "--one-dimension"):
                    case = load(name)
                if at is not None:
                    temperatures = temperatures_at(case, row_at(case.record, "--at", at))
                if one_dimension:
                    display.step("section: the cost of one dimension", 0.02)
                    cost = cost_of_one_dimension(case)
            report.check_output_folder(out)
            began = clock.perf_counter()
            result = solve_section(section, left, right, progress=part_of(display.step, 0.05, 0.8))
            result = replace(result, temperatures=temperatures, one_dimension=cost)
            cells = f"{result.cells} cells, reduced to order {result.order}"
            display.line(stage_line("section", cells, clock.perf_counter() - began))
            written = _written(display, partial(report.write_page, section_page(result), out, formats=figure_formats))
    except InputError as error:
        exit_with_error(error)
    _print_result(result, written, json, quiet)


def _print_result(
    result: CampaignPlan | Forecast | SectionSolution, written: list[Path], json: bool, quiet: bool
) -> None:
    """Print what a command found: its result.json, or its summary, or nothing."""
    if json:
        print_output((written[0].parent / "result.json").read_text("utf-8"), end="")
    elif not quiet:
        print_output("\n".join(_summary(result, written)))


def _written(display: ProgressDisplay, write: Callable[..., list[Path]]) -> list[Path]:
    """Write the files of a command, and show the line of this stage.

    Args:
        display: of the command.
        write: writes them; it takes the command line.
    """
    display.step("figures", 0.9)
    start = clock.perf_counter()
    written = write(command=shlex.join(["wallid", *sys.argv[1:]]))
    display.line(stage_line("report", f"{len(written)} files", clock.perf_counter() - start))
    return written


def _summary(result: workflow.Run | CampaignPlan | Forecast | SectionSolution, written: list[Path]) -> list[str]:
    """The results, and the names of the written files."""
    text = terminal_text(str(result), sys.stdout.encoding)
    lines = [text, f"\nwrote        {', '.join(path.name for path in written)} to {written[0].parent}"]
    if previous := [path.name for path in written if path.name.startswith("report-")]:
        lines.append(f"kept         the report of an earlier command in this folder, as {previous[0]}")
    return lines


def _print_summary(result: workflow.Run, name: str, written: list[Path]) -> None:
    """Print the results, the names of the written files, and the command to run next."""
    lines = _summary(result, written)
    missing = result.screening is not None and bool(result.screening.missing)
    advice = f"next         wallid diagnose {shlex.quote(name)}:"
    if missing or "wallid diagnose" in result.unreliable_reason:
        lines.append(f"{advice} name the missing effect, and correct the diffusivity")
    elif result.fit is not None and result.diagnosis is None and not result.unreliable_reason:
        lines.append(f"{advice} search for effects that are missing from the model")
    print_output("\n".join(lines))


def exit_with_error(error: InputError) -> NoReturn:
    """Print the message on standard error and exit with status 2."""
    print_message(f"wallid: {error}")
    raise typer.Exit(2) from None


def _configure_process() -> None:
    """Set JAX, XLA and BLAS for the process of the command.

    The models are small and step through time: a graphics processor takes several times as long as the processor. It is
    used only where the environment variable JAX_PLATFORMS asks for it.
    """
    jax.config.update("jax_enable_x64", True)
    if not os.environ.get("JAX_PLATFORMS"):
        jax.config.update("jax_platforms", "cpu")
    prepare_xla()
    threadpool_limits(limits=1, user_api="blas")  # threads of LAPACK only wait for each other on thin matrices


def _with_options(case: Case, model: str | None, free: list[str] | None) -> Case:
    """The case with the values of `--model` and `--free`."""
    if free:
        with error_context("--free"):
            case = replace(case, choices=replace(case.choices, free=tuple(free)))
    return case if model is None else replace(case, choices=replace(case.choices, model=model))


def _window(case: Case, row: int) -> Window:
    """The window of the case that starts at `--from-row`."""
    rows = window_rows(case, case.choices.window_days)
    if row + rows > case.record.rows:
        raise InputError(
            f"--from-row {row}: a window of {rows} rows from there passes the record's end; "
            f"the last start is {case.record.rows - rows}"
        )
    check_unbroken(case, Window(row, rows))
    return Window(row, rows)


def _parse_orders(text: str) -> tuple[int, ...]:
    """The orders in the list of `--orders`."""
    try:
        return tuple(int(part) for part in text.split(",") if part.strip())
    except ValueError:
        raise InputError(f'--orders {text!r}; it must be integers separated by commas, such as "2,5,10"') from None
