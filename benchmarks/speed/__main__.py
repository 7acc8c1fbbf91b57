"""wallid beside what a user would take instead, on the same work in one run: `python -m benchmarks.speed [WORK ...]`.

Without a work all of them, in about 25 minutes on two cores. Each contender runs in a process of its own; what is
printed is the median of its runs after the first, the first call with its compilation apart, its peak memory and its
error against a reference, then what is asked and whether it is met. What is there so far lies in the folder of results
after each work. The rivals are the extra `bench`.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from benchmarks.speed.learned_models import MODELS
from benchmarks.speed.measure import AbsentError, Measured, machine, measuring
from benchmarks.speed.table import as_markdown, scaling_figure

TURNS, TURN, ALONE = 15, 0.2, 2.0  # rounds; seconds of repeated runs in one of them, and of who runs alone
WORKS = (
    "simulate", "sweep", "campaign", "learn", "orders", "estimate", "filter", "oed", "walls", "section",
    "section_reduction", "scaling", "cold",
)  # fmt: skip


def measured(works: list[str], console: Console) -> Iterator[tuple[str, dict[str, Measured], dict[str, str]]]:
    """Work after work: its contenders as measured, and why those that are missing are.

    Contenders in a work's `IN_TURNS` take milliseconds, and what is asked is their ratio: a machine's speed changes
    meanwhile. They are measured in `TURNS` rounds, and the middle one counts.
    """
    columns = SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()
    with Progress(*columns, console=console, transient=True) as progress, _shared_models():
        for work in works:
            module = importlib.import_module(f"benchmarks.speed.works.{work}")
            in_turns = getattr(module, "IN_TURNS", ())
            rounds, absent = _take_turns(work, in_turns * TURNS, TURN, progress)
            for name in module.CONTENDERS:
                if name not in in_turns:
                    alone, why = _take_turns(work, (name,), ALONE, progress)
                    rounds |= alone
                    absent |= why
            yield work, {name: _middle(rounds[name]) for name in module.CONTENDERS if name not in absent}, absent


def _take_turns(
    work: str, names: tuple[str, ...], longest: float, progress: Progress
) -> tuple[dict[str, list[Measured]], dict[str, str]]:
    """What was measured in this order, a name as often as it is there, and why some are absent."""
    rounds: dict[str, list[Measured]] = {}
    absent: dict[str, str] = {}
    with ExitStack() as processes:
        measure: dict[str, Callable[[float], Measured]] = {}
        for name in names:
            if name in absent:
                continue
            task = progress.add_task(f"{work}: {name}", total=None)
            try:
                measure[name] = measure.get(name) or processes.enter_context(measuring(work, name))
                rounds.setdefault(name, []).append(measure[name](longest))
            except (AbsentError, RuntimeError) as error:
                absent[name] = str(error)
                progress.console.print(f"{work}: {name}: {error}", style="red", markup=False)
            progress.remove_task(task)
    return rounds, absent


@contextmanager
def _shared_models() -> Iterator[None]:
    """A folder for what several contenders start from, as long as they run."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ[MODELS] = folder
        try:
            yield
        finally:
            del os.environ[MODELS]


def _middle(of: list[Measured]) -> Measured:
    return sorted(of, key=lambda one: one.seconds)[len(of) // 2]


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.speed", description=__doc__)
    parser.add_argument("works", nargs="*", metavar="WORK", help=f"one or more of: {', '.join(WORKS)} (default: all)")
    parser.add_argument(
        "--out", type=Path, default=Path("wallid-out/benchmarks"), help="folder of results.json and .md"
    )
    chosen = parser.parse_args()
    works = chosen.works or list(WORKS)
    unknown = [work for work in works if work not in WORKS]
    if unknown:
        parser.error(f"no work {unknown[0]!r}; there are {', '.join(WORKS)}")
    console = Console()
    ground = machine()
    if ground["load_at_start"] > 0.5:
        console.print(
            f"other work is running here (load {ground['load_at_start']:.1f}): times will be too long, ratios unsure",
            style="yellow",
        )
    found, absent, text = {}, {}, ""
    for work, results, reasons in measured(works, console):
        found[work], absent[work] = results, reasons
        text = as_markdown(found, absent, ground)
        _write(chosen.out, text, found, {"machine": ground, "absent": absent})
    console.print(text, markup=False, highlight=False, soft_wrap=True)


def _write(folder: Path, text: str, found: dict[str, dict[str, Measured]], also: dict[str, Any]) -> None:
    """The tables, all numbers, the figure: what there is so far."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "results.md").write_text(text, encoding="utf-8")
    results = {work: [asdict(one) for one in of.values()] for work, of in found.items()}
    (folder / "results.json").write_text(json.dumps(also | {"results": results}, indent=1), encoding="utf-8")
    if found.get("scaling"):
        scaling_figure(found["scaling"], folder / "scaling.png")


if __name__ == "__main__":
    main()
