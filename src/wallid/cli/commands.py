"""The command line: `wallid demo | new | check | plan | run | design | estimate | diagnose | forecast | section`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import typer

from .. import workflow
from .._internal.errors import InputError
from .._internal.interrupts import print_before_line
from ..case.toml_writer import DEFAULT_NOISE_STD, DEFAULT_PRIOR, Answers
from ..case.wizard import new_case, parse_sensor
from ..case.wizard_dialogue import parse_length
from ..case.wizard_plan import PlanAnswers, new_plan, parse_azimuth, parse_indoor
from ..records.file_format import FileFormat
from .execution import exit_with_error, run_command, run_forecast, run_plan, run_section
from .options import (
    DEFAULT_OUT,
    CaseArgument,
    Draws,
    Formats,
    Integrator,
    Json,
    Lengths,
    Model,
    Orders,
    Out,
    Quiet,
    Weights,
)
from .output import print_output

T = TypeVar("T")

app = typer.Typer(
    name="wallid",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)


@app.callback(invoke_without_command=True)
def main(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    """Estimate the thermal diffusivity of a wall from temperatures logged in and on it.

    An optimal experiment design selects the most informative days. A reduced-order model is learned for them.
    Gauss-Newton gives the diffusivity with its interval. The prediction is compared with the entire record.
    `diagnose` searches for physical effects that are missing from the model.
    Exit status 0: result. 1: result, but unreliable. 2: invalid input. 130: interrupted.
    """
    if version:
        from importlib.metadata import version as installed

        print_output(installed("wallid"))
        raise typer.Exit


@app.command()
def demo(
    model: Model = None,
    weights: Weights = "noise",
    integrator: Integrator = "propagator",
    orders: Orders = "",
    lengths: Lengths = False,
    out: Out = DEFAULT_OUT,
    json: Json = False,
    quiet: Quiet = False,
    formats: Formats = "png",
) -> None:
    """Run the method on the packaged case `saint_julien`, a synthetic twin of the old wall in the paper.

    The last step is the diagnosis of the entire record: the effect that is missing from the plain model, and the
    diffusivity of the model with this effect.
    """
    stages = (*_stages(lengths), "diagnose")
    options: dict[str, Any] = {"weights": weights, "integrator": integrator}
    run_command("saint_julien", model, stages, out, json, quiet, formats, orders=orders, **options)


@app.command()
def run(
    case: CaseArgument,
    model: Model = None,
    weights: Weights = "noise",
    integrator: Integrator = "propagator",
    orders: Orders = "",
    lengths: Lengths = False,
    bootstrap: Draws = 0,
    out: Out = DEFAULT_OUT,
    json: Json = False,
    quiet: Quiet = False,
    formats: Formats = "png",
) -> None:
    """Design, learn, estimate, and compare the prediction with the entire record.

    This command does not search for missing effects (the verdict is null): see `wallid diagnose`.
    """
    options = {"weights": weights, "integrator": integrator, "draws": bootstrap}
    run_command(case, model, _stages(lengths), out, json, quiet, formats, orders=orders, **options)


def _stages(lengths: bool) -> tuple[str, ...]:
    return (*workflow.STAGES, "lengths") if lengths else workflow.STAGES


@app.command()
def new(
    context: typer.Context,
    record: Annotated[
        Path,
        typer.Argument(metavar="RECORD", help="The logger's file: CSV with a header. With --plan: the weather file."),
    ],
    plan: Annotated[
        bool,
        typer.Option("--plan", help="Plan a campaign: RECORD is the weather of a typical year (EPW, TMY3)."),
    ] = False,
    azimuth: Annotated[
        str | None,
        typer.Option("--azimuth", help="With --plan: where the outer face looks, such as SW or 225."),
    ] = None,
    indoor: Annotated[
        str | None, typer.Option("--indoor", help='With --plan: temperature of the room, degC, or "unheated".')
    ] = None,
    sensors: Annotated[
        int | None, typer.Option("--sensors", help="With --plan: the largest number of sensors inside the wall.")
    ] = None,
    plates: Annotated[
        int | None, typer.Option("--plates", help="With --plan: number of heat flux plates, 0 to 2.")
    ] = None,
    days: Annotated[float | None, typer.Option("--days", help="With --plan: the longest campaign, days.")] = None,
    length: Annotated[str | None, typer.Option("--length", help='Thickness of the wall: 0.43 (m) or "43 cm".')] = None,
    left: Annotated[str | None, typer.Option("--left", help="The column of the face at x = 0.")] = None,
    right: Annotated[str | None, typer.Option("--right", help="The column of the face at x = length.")] = None,
    sensor: Annotated[
        list[str] | None,
        typer.Option(
            "--sensor", metavar="NAME=POSITION", help='Sensor inside the wall: T1=0.05 or "T1=5 cm"; repeatable.'
        ),
    ] = None,
    time: Annotated[str | None, typer.Option("--time", help="The column of times; default: the first one.")] = None,
    flux_left: Annotated[
        str | None, typer.Option("--flux-left", help="Column of the heat flux, W/m2, along +x.")
    ] = None,
    flux_right: Annotated[
        str | None, typer.Option("--flux-right", help="Column of the heat flux, W/m2, along +x.")
    ] = None,
    irradiance: Annotated[
        str | None, typer.Option("--irradiance", help="Column of the irradiance on the outer face, W/m2.")
    ] = None,
    air_outdoor: Annotated[
        str | None, typer.Option("--air-outdoor", help="Column of the temperature of the outdoor air.")
    ] = None,
    air_indoor: Annotated[
        str | None, typer.Option("--air-indoor", help="Column of the temperature of the indoor air.")
    ] = None,
    outside: Annotated[Literal["left", "right"] | None, typer.Option("--outside", help="The face outdoors.")] = None,
    conductivity: Annotated[
        float | None, typer.Option("--conductivity", help="Thermal conductivity, W/m/K; default: not known.")
    ] = None,
    prior: Annotated[float, typer.Option("--prior", help="Prior diffusivity, m2/s.")] = DEFAULT_PRIOR,
    noise: Annotated[
        float | None,
        typer.Option("--noise", help=f"Standard deviation of a reading, K; default {DEFAULT_NOISE_STD:g}."),
    ] = None,
    unit: Annotated[Literal["degC", "degF", "K"] | None, typer.Option("--unit", help="Of the temperatures.")] = None,
    day_first: Annotated[
        bool | None, typer.Option("--day-first/--month-first", help="Order in dates such as 03/04/2020.")
    ] = None,
    timezone: Annotated[
        str | None, typer.Option("--timezone", help='Time zone of the times, such as "Europe/Berlin".')
    ] = None,
    to: Annotated[
        Path | None, typer.Option("--to", metavar="FILE", help="Default: case.toml in the folder of RECORD.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing file.")] = False,
    quiet: Quiet = False,
) -> None:
    """Write a new case.toml for a logger's file.

    The command asks for each value that is not given as an option, and suggests columns by their names. If the
    finished case cannot be used, it says why and asks again. Without a terminal a missing value is an error; a case
    that cannot be used is written all the same, with exit status 2 and what must be edited.
    """
    _refuse_options(context, *((_OF_RECORDS, "without --plan") if plan else (_OF_PLANS, "with --plan")))
    if plan:
        answers = PlanAnswers(
            outside=outside, conductivity=conductivity, prior=prior, sensors=sensors, plates=plates, days=days
        )
        _new_plan(record, answers, length, azimuth, indoor, to, force, quiet)
        return
    columns = {
        "flux_left": flux_left, "flux_right": flux_right, "irradiance": irradiance, "air_outdoor": air_outdoor,
        "air_indoor": air_indoor,
    }  # fmt: skip
    try:
        answers = Answers(
            time=time,
            left=left,
            right=right,
            length=None if length is None else parse_length("--length", length),
            sensors=None if not sensor else dict(map(parse_sensor, sensor)),
            regressors={key: name for key, name in columns.items() if name},
            outside=outside,
            conductivity=conductivity,
            prior=prior,
            noise=noise,
            file_format=FileFormat(unit=unit, day_first=day_first, timezone=timezone),
        )
        case = new_case(record, answers, to=to, force=force, ask=_ask if _is_terminal() else None)
    except InputError as error:
        exit_with_error(error)
    if not quiet:
        wrote = f"wrote        {case.path}; now `wallid check {case.path}`, then `wallid run {case.path}`"
        print_output(f"{case}\n\n{wrote}")


_OF_PLANS = ("azimuth", "indoor", "sensors", "plates", "days")
"""Options of `new` for a campaign that is to be planned."""
_OF_RECORDS = (
    "left", "right", "sensor", "time", "flux_left", "flux_right", "irradiance", "air_outdoor", "air_indoor", "noise",
    "unit", "day_first", "timezone",
)  # fmt: skip
"""Options of `new` for a logger's file."""


def _refuse_options(context: typer.Context, names: Sequence[str], where: str) -> None:
    """End with an error where options are stated that the command would not use."""
    sources = {name: context.get_parameter_source(name) for name in names}
    given = {name for name, source in sources.items() if source is not None and source.name == "COMMANDLINE"}
    if stated := [parameter.opts[0] for parameter in context.command.params if parameter.name in given]:
        exit_with_error(InputError(f"{', '.join(stated)}: only {where}"))


def _new_plan(
    weather: Path,
    answers: PlanAnswers,
    length: str | None,
    azimuth: str | None,
    indoor: str | None,
    to: Path | None,
    force: bool,
    quiet: bool,
) -> None:
    """Write a case file for a campaign that is to be planned."""
    try:
        answers = replace(
            answers,
            length=None if length is None else parse_length("--length", length),
            azimuth=None if azimuth is None else parse_azimuth(azimuth),
            indoor=None if indoor is None else parse_indoor(indoor),
        )
        campaign = new_plan(weather, answers, to=to, force=force, ask=_ask if _is_terminal() else None)
    except InputError as error:
        exit_with_error(error)
    if not quiet:
        print_output(f"wrote        {campaign.path}; now `wallid plan {campaign.path}`")


def _is_terminal() -> bool:
    return sys.stdin.isatty()


def _ask(question: str, default: str | None, parse: Callable[[str], T]) -> T:
    """Ask at the terminal until the answer is valid; the question goes to standard error."""

    def value_of(text: str) -> T:
        try:
            return parse(text)
        except InputError as error:
            raise typer.BadParameter(str(error)) from error

    print_before_line("\n")  # at Ctrl-C the question is still on the line
    try:
        return typer.prompt(question, default=default, show_default=bool(default), err=True, value_proc=value_of)
    except typer.Abort:  # the end of the input
        raise InputError("stopped; nothing was written") from None
    finally:
        print_before_line("")


@app.command()
def check(
    case: CaseArgument, out: Out = DEFAULT_OUT, json: Json = False, quiet: Quiet = False, formats: Formats = "png"
) -> None:
    """Check the record and report how it was cleaned.

    The command counts gaps, missing and masked values, spikes and breaks, and draws them in the figure of the record.
    It takes a second or two. Exit status 1: a run is impossible.
    """
    run_command(case, None, ("check",), out, json, quiet, formats)


@app.command()
def plan(
    case: CaseArgument, out: Out = DEFAULT_OUT, json: Json = False, quiet: Quiet = False, formats: Formats = "png"
) -> None:
    """Plan a campaign before there is a record: sensors, plates, columns, days and season.

    The case has `[wall]` and `[plan]`, with the weather of a typical year (EPW or TMY3). Of each campaign the interval
    of the diffusivity (and with plates of R, U and the heat capacity) is expected, over the diffusivities that the
    wall may have. It takes about half a minute. Exit status 1: the record would more likely than not say nothing.
    """
    run_plan(case, out, json, quiet, formats)


@app.command()
def design(
    case: CaseArgument,
    criterion: Annotated[
        Literal["D", "A", "E"],
        typer.Option("--criterion", help="D: determinant, A: mean variance, E: largest variance of the estimate."),
    ] = "D",
    of: Annotated[
        Literal["diffusivity", "constants", "all"],
        typer.Option(
            "--of",
            help="Parameters in the criterion: the diffusivity (D, A and E are then equal); with it the offsets and "
            "positions of the sensors; or all estimated parameters. The last two imply --full.",
        ),
    ] = "diffusivity",
    robust: Annotated[
        Literal["no", "expected", "worst"],
        typer.Option(
            "--robust", help="Design for 0.25 to 4 times the prior diffusivity: mean (expected) or worst case."
        ),
    ] = "no",
    full: Annotated[
        bool,
        typer.Option(
            "--full",
            help="Include all nuisance parameters and noise of the estimate: face noise, positions, initial profile. "
            "(Always included for the positions of further sensors and for flux plates.)",
        ),
    ] = False,
    add: Annotated[
        int, typer.Option("--add", min=0, max=6, help="Number of further sensors to place, one after the other.")
    ] = 1,
    out: Out = DEFAULT_OUT,
    json: Json = False,
    quiet: Quiet = False,
    formats: Formats = "png",
) -> None:
    """Find the most informative days, the gain from longer windows, and the best position of a further sensor."""
    design_options = workflow.DesignOptions(criterion, of, robust, full or of != "diffusivity" or None, add)
    run_command(case, None, ("design", "lengths", "places"), out, json, quiet, formats, design_options=design_options)


@app.command()
def estimate(
    case: CaseArgument,
    model: Model = None,
    weights: Weights = "noise",
    integrator: Integrator = "propagator",
    from_row: Annotated[
        int | None,
        typer.Option(
            "--from-row", min=0, help="Start the window at this row (the first is 0), not at the best of the design."
        ),
    ] = None,
    free: Annotated[
        list[str] | None,
        typer.Option(
            "--free",
            metavar="WHAT",
            help="Estimate also: layers (conductivity of each layer), film_left, film_right (surface resistance, where "
            "the column of that face is the air temperature); repeatable.",
        ),
    ] = None,
    all_windows: Annotated[
        bool,
        typer.Option("--all-windows", help="One estimate from all informative windows of the record."),
    ] = False,
    bootstrap: Draws = 0,
    out: Out = DEFAULT_OUT,
    json: Json = False,
    quiet: Quiet = False,
    formats: Formats = "png",
) -> None:
    """Estimate the diffusivity from the best window, or from the window at --from-row."""
    options = {"weights": weights, "integrator": integrator, "draws": bootstrap}
    if all_windows:
        excluded = {
            "--from-row": from_row is not None, "--bootstrap": bootstrap > 0, "--weights none": weights == "none",
            "--free": bool(free), "--model mim": model == "mim", "--integrator diffrax": integrator == "diffrax",
        }  # fmt: skip
        if stated := [name for name, is_stated in excluded.items() if is_stated]:
            exit_with_error(
                InputError(f"--all-windows uses the full-order model in every window; leave {stated[0]} out")
            )
        run_command(case, None, ("campaign", "screening"), out, json, quiet, formats)
        return
    stages = ("design", "learn", "estimate", "screening")
    run_command(case, model, stages, out, json, quiet, formats, from_row=from_row, free=free, **options)


@app.command()
def diagnose(
    case: CaseArgument, out: Out = DEFAULT_OUT, json: Json = False, quiet: Quiet = False, formats: Formats = "png"
) -> None:
    """Find the effect that is missing from the plain model, and the diffusivity of the model with this effect.

    The command tests each effect of a library (sensors, plates, faces, materials, sources) on the entire record.
    The verdict is: an effect is missing, with its size; none is missing; two effects cannot be distinguished; or the
    missing effect is not in the library.
    It takes about a minute; `[choices] diagnose_days` shortens the record.
    """
    run_command(case, None, ("diagnose",), out, json, quiet, formats)


@app.command()
def forecast(
    case: CaseArgument,
    start: Annotated[
        str,
        typer.Option("--from", metavar="TIME", help="First row of the forecast, as in the record: 2026-01-31T12:00."),
    ],
    hours: Annotated[float, typer.Option("--hours", help="Length of the forecast.", min=0.0)] = 24.0,
    days: Annotated[
        float, typer.Option("--days", help="Days of readings before it, from which the wall is estimated.", min=0.0)
    ] = 7.0,
    faces: Annotated[
        Literal["record", "persistence"],
        typer.Option(
            "--faces",
            help="The faces after TIME: as logged (as the day before where the record ends), or as the day before.",
        ),
    ] = "record",
    out: Out = DEFAULT_OUT,
    json: Json = False,
    quiet: Quiet = False,
    formats: Formats = "png",
) -> None:
    """Forecast the readings of all sensors and plates after a time, with their standard deviations.

    The wall, the noise and heat that no column explains are estimated from the readings before. `forecast.csv` has a
    mean and a standard deviation (`NAME_std`) for each sensor and plate, row by row. Exit status 1: of the earlier
    predictions too few lie in their bands.
    """
    run_forecast(case, start, hours, days, faces, out, json, quiet, formats)


@app.command()
def section(
    case: CaseArgument,
    left: Annotated[float | None, typer.Option("--left", help="Temperature on the left, degC; with --right.")] = None,
    right: Annotated[float | None, typer.Option("--right", help="Temperature on the right, degC.")] = None,
    at: Annotated[
        str | None,
        typer.Option(
            "--at", metavar="TIME", help="Draw the temperatures at this time of the record, such as 2026-01-31T12:00."
        ),
    ] = None,
    one_dimension: Annotated[
        bool,
        typer.Option(
            "--one-dimension",
            help="What an estimate of a homogeneous wall would be off by, from the faces of the record.",
        ),
    ] = False,
    out: Out = DEFAULT_OUT,
    json: Json = False,
    quiet: Quiet = False,
    formats: Formats = "png",
) -> None:
    """Solve a section of stones and mortar in two dimensions, and draw it.

    The case has `[wall]` and `[section]`: materials, and where they are, by rectangles or by a picture. The command
    gives the equivalent homogeneous wall, and the order and error of the reduced model. With --left and --right it
    gives the steady temperatures at the sensors and the heat flow. It needs no record, except for --at and
    --one-dimension.
    """
    run_section(case, left, right, at, one_dimension, out, json, quiet, formats)
