"""The command line: `wallid demo | new | check | run | design | estimate | diagnose`."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import typer

from .. import workflow
from .._internal.errors import InputError
from ..records.file_format import Format
from .execution import carry_out, refuse
from .options import OUT, CaseArgument, Draws, Formats, Integrator, Json, Model, Orders, Out, Quiet, Weights

T = TypeVar("T")

app = typer.Typer(
    name="wallid",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)


@app.callback(invoke_without_command=True)
def main(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    """From temperatures logged in and on a wall to its thermal diffusivity, by the whole method:

    an optimal experiment design picks the days that tell most, a reduced model is learned for them,
    Gauss-Newton gives the diffusivity with its interval, and the whole record is held against it.
    Where the record says that something is missing from that model, `diagnose` looks for what it is.
    Status 0: done. 1: done, but the record gives no number to rely on. 2: bad input.
    """
    if version:
        from importlib.metadata import version as installed

        print(installed("wallid"))
        raise typer.Exit


@app.command()
def demo(
    model: Model = None,
    weights: Weights = "noise",
    integrator: Integrator = "propagator",
    orders: Orders = "",
    out: Out = OUT,
    json: Json = False,
    quiet: Quiet = False,
    formats: Formats = "png",
) -> None:
    """The whole method on the packaged case `saint_julien`, a synthetic twin of the paper's old wall.

    It ends with the diagnosis of the whole record: which effect the plain model misses there, and the
    diffusivity with it in.
    """
    stages = (*workflow.STAGES, "diagnose")
    options: dict[str, Any] = {"weights": weights, "integrator": integrator}
    carry_out("saint_julien", model, stages, out, json, quiet, formats, orders=orders, **options)


@app.command()
def run(
    case: CaseArgument,
    model: Model = None,
    weights: Weights = "noise",
    integrator: Integrator = "propagator",
    orders: Orders = "",
    bootstrap: Draws = 0,
    out: Out = OUT,
    json: Json = False,
    quiet: Quiet = False,
    formats: Formats = "png",
) -> None:
    """Design, learn, estimate, and hold the whole record against the result.

    Whether an effect is missing from the model is not asked here (the verdict stays null): see
    `wallid diagnose`.
    """
    options = {"weights": weights, "integrator": integrator, "draws": bootstrap}
    carry_out(case, model, workflow.STAGES, out, json, quiet, formats, orders=orders, **options)


@app.command()
def new(
    record: Annotated[Path, typer.Argument(metavar="RECORD", help="The logger's file: CSV with a header.")],
    length: Annotated[str | None, typer.Option("--length", help='Between the faces: 0.43 (m) or "43 cm".')] = None,
    left: Annotated[str | None, typer.Option("--left", help="The column of the face at x = 0.")] = None,
    right: Annotated[str | None, typer.Option("--right", help="The column of the face at x = length.")] = None,
    sensor: Annotated[
        list[str] | None,
        typer.Option("--sensor", metavar="NAME=POSITION", help='One inside the wall: T1=0.05 or "T1=5 cm"; repeat it.'),
    ] = None,
    time: Annotated[str | None, typer.Option("--time", help="The column of times (else the first one).")] = None,
    flux_left: Annotated[str | None, typer.Option("--flux-left", help="A column of W/m2, positive along +x.")] = None,
    flux_right: Annotated[str | None, typer.Option("--flux-right", help="A column of W/m2, positive along +x.")] = None,
    outside: Annotated[Literal["left", "right"] | None, typer.Option("--outside", help="The face outdoors.")] = None,
    prior: Annotated[float, typer.Option("--prior", help="A handbook's diffusivity, m2/s.")] = 5e-7,
    noise: Annotated[float, typer.Option("--noise", help="Scatter of the sensors' readings, K.")] = 0.1,
    unit: Annotated[Literal["degC", "degF", "K"] | None, typer.Option("--unit", help="Of the temperatures.")] = None,
    day_first: Annotated[
        bool | None, typer.Option("--day-first/--month-first", help="How dates such as 03/04/2020 are meant.")
    ] = None,
    timezone: Annotated[
        str | None, typer.Option("--timezone", help='Whose wall clock the times are: "Europe/Berlin".')
    ] = None,
    to: Annotated[Path | None, typer.Option("--to", metavar="FILE", help="Default: case.toml beside RECORD.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Write over a file that is there.")] = False,
    quiet: Quiet = False,
) -> None:
    """Start a case: look at a logger's file, ask what its columns are, and write a case.toml that runs.

    What is not given as an option is asked for; without a terminal it is refused, with the options to give.
    """
    from ..case.toml_writer import Answers
    from ..case.wizard import new_case, place
    from ..case.wizard_dialogue import metres

    try:
        answers = Answers(
            time=time,
            left=left,
            right=right,
            length=None if length is None else metres("--length", length),
            sensors=None if not sensor else dict(place(one) for one in sensor),
            fluxes={key: one for key, one in (("flux_left", flux_left), ("flux_right", flux_right)) if one is not None},
            outside=outside,
            prior=prior,
            noise=noise,
            form=Format(unit=unit, day_first=day_first, timezone=timezone),
        )
        case = new_case(record, answers, to=to, force=force, ask=_asker())
    except InputError as error:
        refuse(error)
    if not quiet:
        print(case)
        print(f"\nwrote        {case.path}; now `wallid check {case.path}`, then `wallid run {case.path}`")


def _asker() -> Callable[..., Any] | None:
    """Somebody to ask, where there is a terminal."""
    return _ask if sys.stdin.isatty() else None


def _ask(question: str, default: str | None, read: Callable[[str], T]) -> T:
    """Ask at the terminal until the answer is one; the question goes to standard error."""

    def taken(text: str) -> T:
        try:
            return read(text)
        except InputError as error:
            raise typer.BadParameter(str(error)) from error

    try:
        return typer.prompt(question, default=default, show_default=bool(default), err=True, value_proc=taken)
    except typer.Abort:
        raise InputError("stopped; nothing was written") from None


@app.command()
def check(
    case: CaseArgument, out: Out = OUT, json: Json = False, quiet: Quiet = False, formats: Formats = "png"
) -> None:
    """What the record holds, what was done to it while it was read, and what would stop a run.

    Gaps, missing and masked values, spikes, breaks, the grid that the readings were put on: counted, and
    drawn in the figure of the record. Takes a second or two. Status 1: something would stop a run.
    """
    carry_out(case, None, ("check",), out, json, quiet, formats)


@app.command()
def design(
    case: CaseArgument,
    criterion: Annotated[
        Literal["D", "A", "E"],
        typer.Option("--criterion", help="Of the information: determinant, mean variance, or the worst direction."),
    ] = "D",
    of: Annotated[
        Literal["diffusivity", "constants", "all"],
        typer.Option(
            "--of",
            help="What the criterion is of: the diffusivity (where D, A and E agree), with it offsets and positions, "
            "or all that the estimate leaves free. The last two count in full.",
        ),
    ] = "diffusivity",
    robust: Annotated[
        Literal["no", "expected", "worst"],
        typer.Option(
            "--robust", help="Choose for a quarter to four times the prior diffusivity: on average, or at worst."
        ),
    ] = "no",
    full: Annotated[
        bool,
        typer.Option(
            "--full",
            help="Count what the interval counts: the faces' noise, positions and the initial profile, too. (The "
            "places of further sensors, and designs with flux plates, always do.)",
        ),
    ] = False,
    add: Annotated[
        int, typer.Option("--add", min=0, max=6, help="Further sensors to find places for, one after the other.")
    ] = 1,
    out: Out = OUT,
    json: Json = False,
    quiet: Quiet = False,
    formats: Formats = "png",
) -> None:
    """Which days of the record tell most, what longer windows would give, and where a further sensor would help."""
    designing = workflow.Designing(criterion, of, robust, full or of != "diffusivity" or None, add)
    carry_out(case, None, ("design", "lengths", "places"), out, json, quiet, formats, designing=designing)


@app.command()
def estimate(
    case: CaseArgument,
    model: Model = None,
    weights: Weights = "noise",
    integrator: Integrator = "propagator",
    from_row: Annotated[
        int | None,
        typer.Option(
            "--from-row", min=0, help="Start the window at this row (the first is 0), not where the design says."
        ),
    ] = None,
    free: Annotated[
        list[str] | None,
        typer.Option(
            "--free",
            metavar="WHAT",
            help="Estimate this too: layers (each one's diffusivity), film_left, film_right (that face reads the air); "
            "repeat it.",
        ),
    ] = None,
    all_windows: Annotated[
        bool,
        typer.Option("--all-windows", help="One estimate from every window of the record that tells anything."),
    ] = False,
    bootstrap: Draws = 0,
    out: Out = OUT,
    json: Json = False,
    quiet: Quiet = False,
    formats: Formats = "png",
) -> None:
    """The diffusivity from the best window (or from one that you name), without the rest."""
    options = {"weights": weights, "integrator": integrator, "draws": bootstrap}
    if all_windows:
        given = {
            "--from-row": from_row is not None, "--bootstrap": bootstrap > 0, "--weights none": weights == "none",
            "--free": bool(free), "--model mim": model == "mim", "--integrator diffrax": integrator == "diffrax",
        }  # fmt: skip
        if wrong := [name for name, there in given.items() if there]:
            refuse(InputError(f"--all-windows goes through every window by the large model; leave {wrong[0]} out"))
        carry_out(case, None, ("campaign",), out, json, quiet, formats)
        return
    carry_out(
        case, model, ("design", "learn", "estimate"), out, json, quiet, formats, from_row=from_row, free=free, **options
    )


@app.command()
def diagnose(
    case: CaseArgument, out: Out = OUT, json: Json = False, quiet: Quiet = False, formats: Formats = "png"
) -> None:
    """What the plain model misses in the whole record, and the diffusivity with it in.

    Each effect of a library (sensors, faces, materials, sources) is tried: the verdict names the one that is
    missing with its size, or says that none is, that two cannot be told apart, or that it is none of these.
    Takes about a minute; `[choices] diagnose_days` shortens the record.
    """
    carry_out(case, None, ("diagnose",), out, json, quiet, formats)


def command() -> None:
    """`wallid` as a process of its own."""
    app()
