"""The options that several commands take, as typer reads them: each with its words in the help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

CaseArgument = Annotated[
    str, typer.Argument(metavar="CASE", help="A case.toml, a folder that holds one, or a packaged case's name.")
]
OUT = Path("wallid-out")
"""Where results go unless `--out` says."""
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
        "--orders", metavar="LIST", help='The orders of the figure of error against order, such as "2,4,8,16".'
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
Formats = Annotated[
    str,
    typer.Option(
        "--format", metavar="LIST", help='Of the figures\' files: png, svg or pdf; several with commas: "png,svg".'
    ),
]
