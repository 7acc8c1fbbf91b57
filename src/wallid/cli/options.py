"""The command-line options that several commands share, with their help texts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

CaseArgument = Annotated[
    str, typer.Argument(metavar="CASE", help="A case.toml, a folder that holds one, or a packaged case's name.")
]
DEFAULT_OUT = Path("wallid-out")
"""The default of `--out`."""
Out = Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for report.html, result.json and the figures.")]
Json = Annotated[bool, typer.Option("--json", help="Print result.json to standard output, and nothing else there.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="No progress and no summary.")]
Model = Annotated[
    Literal["mim", "lom"] | None,
    typer.Option("--model", help="Reduced-order (mim) or full-order model (lom); default: as in the case."),
]
Integrator = Annotated[
    Literal["propagator", "diffrax"],
    typer.Option("--integrator", help="Time integration: exact propagator from row to row, or diffrax; same results."),
]
Weights = Annotated[
    Literal["noise", "none"],
    typer.Option(
        "--weights",
        help="noise: generalised least squares with the full covariance. none: ordinary least squares as in the paper.",
    ),
]
Orders = Annotated[
    str,
    typer.Option(
        "--orders", metavar="LIST", help='Orders for the figure of the error against the order, such as "2,4,8,16".'
    ),
]
Lengths = Annotated[
    bool, typer.Option("--lengths", help="Compare windows of other lengths too: criterion and computing time.")
]
Draws = Annotated[
    int,
    typer.Option(
        "--bootstrap",
        metavar="N",
        min=0,
        help="Check the interval by a parametric bootstrap with N simulated records (200 are enough).",
    ),
]
Formats = Annotated[
    str,
    typer.Option(
        "--format", metavar="LIST", help='File formats of the figures: png, svg or pdf; several with commas: "png,svg".'
    ),
]
