"""The command line: `wallid demo | new | check | run | design | estimate | diagnose`."""

from __future__ import annotations

import shlex
import sys
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal, NoReturn

import jax
import typer
from threadpoolctl import threadpool_limits

from . import workflow
from ._cold import compile_quickly
from ._fields import within
from .case import Case, load
from .experiment import Window, check_unbroken, window_rows
from .record import Format
from .wall import InputError

app = typer.Typer(
    name="wallid",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)

CaseArgument = Annotated[
    str, typer.Argument(metavar="CASE", help="A case.toml, a folder that holds one, or a packaged case's name.")
]
Out = Annotated[Path, typer.Option("--out", metavar="DIR", help="Where report.html, result.json and the figures go.")]
Json = Annotated[bool, typer.Option("--json", help="Print result.json to standard output, and nothing else there.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="No progress and no summary.")]
Model = Annotated[
    Literal["mim", "lom"] | None,
    typer.Option("--model", help="The reduced or the large model, instead of the case's choice."),
]
Integrator = Annotated[
    Literal["propagator", "diffrax"],
    typer.Option(
        "--integrator", help="How every stage steps through the rows: a fast scan, or diffrax; the same numbers."
    ),
]
Weights = Annotated[
    Literal["noise", "none"],
    typer.Option("--weights", help="The readings' full covariance, or the paper's plain sum of squares and sigma."),
]
Orders = Annotated[
    str,
    typer.Option(
        "--orders", metavar="LIST", help='Also learn these orders for the figure of error against order: "2,5,10".'
    ),
]
Draws = Annotated[
    int,
    typer.Option(
        "--bootstrap",
        metavar="N",
        min=0,
        help="Check the interval by estimating again from N records that the fitted model draws (200 will do).",
    ),
]
From = Annotated[
    int | None,
    typer.Option("--from-row", min=0, help="Start the window at this row (the first is 0), not where the design says."),
]
Formats = Annotated[
    str,
    typer.Option(
        "--format", metavar="LIST", help='Of the figures\' files: png, svg or pdf; several with commas: "png,svg".'
    ),
]
OUT = Path("wallid-out")


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
    options = {"orders": orders, "weights": weights, "integrator": integrator}
    _go("saint_julien", model, stages, out, json, quiet, formats, from_row=None, free=None, **options)


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
    _go(case, model, workflow.STAGES, out, json, quiet, formats, orders=orders, **options)


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
    from .new import Answers, metres, new_case, place

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
        case = new_case(record, answers, to=to, force=force, ask=_ask if sys.stdin.isatty() else None)
    except InputError as error:
        _refuse(error)
    if not quiet:
        print(case)
        print(f"\nwrote        {case.path}; now `wallid check {case.path}`, then `wallid run {case.path}`")


def _ask(question: str, default: str | None) -> str:
    """Ask at the terminal; the question goes to standard error."""
    try:
        return str(typer.prompt(question, default=default, err=True))
    except typer.Abort:
        raise InputError("stopped; nothing was written") from None


def _refuse(error: InputError) -> NoReturn:
    """One line on standard error, and status 2."""
    print(f"wallid: {error}", file=sys.stderr)
    raise typer.Exit(2) from None


@app.command()
def check(
    case: CaseArgument, out: Out = OUT, json: Json = False, quiet: Quiet = False, formats: Formats = "png"
) -> None:
    """What the record holds, what was done to it while it was read, and what would stop a run.

    Gaps, missing and masked values, spikes, breaks, the grid that the readings were put on: counted, and
    drawn in the figure of the record. Takes a second or two. Status 1: something would stop a run.
    """
    _go(case, None, ("check",), out, json, quiet, formats)


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
            "places of further sensors always do.)",
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
    designing = workflow.Designing(criterion, of, robust, full or of != "diffusivity", add)
    _go(case, None, ("design", "lengths", "places"), out, json, quiet, formats, designing=designing)


@app.command()
def estimate(
    case: CaseArgument,
    model: Model = None,
    weights: Weights = "noise",
    integrator: Integrator = "propagator",
    from_row: From = None,
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
            _refuse(InputError(f"--all-windows goes through every window by the large model; leave {wrong[0]} out"))
        _go(case, None, ("campaign",), out, json, quiet, formats)
        return
    _go(
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
    _go(case, None, ("diagnose",), out, json, quiet, formats)


def _go(
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
    """Load, run, write, print; every message to standard error but the summary or the JSON."""
    from . import report

    try:
        with _progress(quiet or json) as progress:
            progress("reading the case", 0.0)
            wanted = report.parse_formats(formats)
            case = _load(name, model, out, free)
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
            written = report.write(done, out, shlex.join(["wallid", *sys.argv[1:]]), wanted)
    except InputError as error:
        _refuse(error)
    if json:
        print((out / "result.json").read_text("utf-8"), end="")
    elif not quiet:
        print(done)
        print(f"\nwrote        {', '.join(path.name for path in written)} to {out}")
        if done.fit is not None and done.explanation is None and case.sensors and not done.unreliable:
            print(f"next         wallid diagnose {shlex.quote(name)}: does the model miss something?")
    if done.unreliable:
        raise typer.Exit(1)


def _load(name: str, model: str | None, out: Path, free: list[str] | None = None) -> Case:
    """The case with the model asked for, and what is to be free; settings of this process, which is ours."""
    from .report import check_out

    jax.config.update("jax_enable_x64", True)
    compile_quickly()
    threadpool_limits(limits=1, user_api="blas")  # see learn_system for why
    case = load(name)
    check_out(out)
    if free:
        with within("--free"):
            case = replace(case, choices=replace(case.choices, free=tuple(free)))
    return case if model is None else replace(case, choices=replace(case.choices, model=model))


def _window(case: Case, row: int) -> Window:
    rows = window_rows(case, case.choices.window_days)
    if row + rows > case.record.rows:
        raise InputError(
            f"--from-row {row}: a window of {rows} rows from there passes the record's end; "
            f"the last start is {case.record.rows - rows}"
        )
    check_unbroken(case, Window(row, rows))
    return Window(row, rows)


def _parse_orders(text: str) -> tuple[int, ...]:
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


if __name__ == "__main__":
    app()
