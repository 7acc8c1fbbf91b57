"""How often `wallid.diagnose` finds what was hidden: `python -m benchmarks.accuracy.discrepancy` prints the table.

Every record is simulated, written as a case, loaded and explained in a process of its own; what the record
could show at best comes from the benchmark's own projections. Each record's outcome is appended to a log of
JSON lines, so that a long run resumes where it ended.
"""

import argparse
import json
import os
import tempfile
import time
import traceback
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from scipy.stats import beta

from benchmarks.accuracy.discrepancy.scenarios import (
    NOISES,
    SCORING,
    TUNING,
    identifiability,
    nulls,
    outside,
    pairs,
    singles,
)
from benchmarks.reference.simulator_with_effects import EFFECTS, OUTSIDE, Spec, write_case

CLEAR, SEEN, TOLD = 400.0, 40.0, 2000.0  # squared signal-to-noise
VERDICTS = ("adequate", "named", "confusable", "unnamed", "uninformative")
ALARMS = ("named", "confusable", "unnamed")


@dataclass(frozen=True)
class Job:
    """One record of the benchmark: `key` is its line's in the log, `kind` a noise, an effect or a family."""

    key: str
    family: str
    kind: str
    spec: Spec


def jobs(families: Iterable[str], records: int, seed: int) -> list[Job]:
    """Every record of some families.

    **Arguments:** `records`: of each kind of noise among the nulls, of each single effect, of each effect
    outside the library, and 5 times as many pairs.
    """
    drawn: list[tuple[str, str, list[Spec]]] = []
    for family in families:
        if family == "nulls":
            drawn += [(family, noise, nulls(noise, records, seed)) for noise in NOISES]
        elif family == "singles":
            drawn += [(family, name, singles(name, records, seed)) for name in EFFECTS]
        elif family == "pairs":
            drawn.append((family, "pairs", pairs(5 * records, seed)))
        elif family == "outside":
            specs = outside(len(OUTSIDE) * records, seed)
            drawn += [(family, kind, specs[number :: len(OUTSIDE)]) for number, kind in enumerate(OUTSIDE)]
        else:
            raise ValueError(f"unknown family {family!r}")
    # a share of every kind, then the next: a run that is stopped has seen all kinds alike
    found = [
        (number / len(specs), Job(f"{family}/{kind}/{seed}/{number}", family, kind, spec))
        for family, kind, specs in drawn
        for number, spec in enumerate(specs)
    ]
    return [job for _, job in sorted(found, key=lambda one: (one[0], one[1].key))]


# ---------------------------------------------------------------------------------------------- one record


def _ready() -> None:
    import jax

    jax.config.update("jax_enable_x64", True)


def run(job: Job, counted_only: bool = False) -> dict:
    """The outcome of one record, or `error` with the last of its traceback.

    With `counted_only` a record that no rate counts is left out: its effects are not there to be seen.
    """
    spec = job.spec
    line = {
        "key": job.key,
        "family": job.family,
        "kind": job.kind,
        "shape": [spec.days, spec.step, len(spec.positions)],
        "noise": spec.noise,
        "hidden": [[name, target, parameters] for name, target, parameters in spec.effects],
    }
    try:
        line["best"] = identifiability(spec)
        if counted_only and not counts(line):
            return line | {"left_out": True}
        with tempfile.TemporaryDirectory() as folder:
            line["truth"] = write_case(spec, folder)["truth"]["diffusivity"]
            import wallid

            case = wallid.load(folder)
            began = time.perf_counter()
            result = wallid.diagnose(case).to_dict()
            line["seconds"] = time.perf_counter() - began
        for key in ("verdict", "effects", "gap", "diffusivity", "diffusivity_before"):
            line[key] = result[key]
    except Exception as error:  # a crash is counted, and the run goes on
        line["error"] = f"{type(error).__name__}: {error}"
        line["traceback"] = traceback.format_exc()[-2000:]
    return line


# ----------------------------------------------------------------------------------------------- the table


def interval(hits: int, count: int) -> tuple[float, float]:
    """Clopper and Pearson's 95 % interval of a rate."""
    if count == 0:
        return 0.0, 1.0
    low = beta.ppf(0.025, hits, count - hits + 1) if hits else 0.0
    high = beta.ppf(0.975, hits + 1, count - hits) if hits < count else 1.0
    return float(low), float(high)


def _rate(flags: Iterable[bool]) -> dict:
    flags = [bool(flag) for flag in flags]
    low, high = interval(sum(flags), len(flags))
    return {
        "hits": sum(flags),
        "count": len(flags),
        "rate": sum(flags) / len(flags) if flags else None,
        "interval_95": [low, high],
    }


def _labels(line: dict) -> list[tuple[str, str | None]]:
    return [(effect["name"], effect["target"]) for effect in line["effects"]]


def _hidden(line: dict) -> list[tuple[str, str | None]]:
    return [(name, target) for name, target, _ in line["hidden"]]


def _names(line: dict) -> list[tuple[str, str | None]]:
    """Names and their alternatives."""
    others = [(rival["name"], rival["target"]) for effect in line["effects"] for rival in effect["alternatives"]]
    return list(dict.fromkeys(_labels(line) + others))


def named_right(line: dict) -> bool:
    """One name, and it is the right one, on the right target."""
    return line["verdict"] == "named" and _labels(line) == _hidden(line)


def first_right(line: dict) -> bool:
    """The first name is the right one and it stands alone."""
    return line["verdict"] == "named" and _labels(line)[:1] == _hidden(line)[:1]


def clear(line: dict) -> bool:
    """What is hidden can be told from every rival, each effect of it."""
    return line["best"]["rivals"] >= CLEAR


def seen(line: dict) -> bool:
    """What is hidden can be told from what is free in the plain model."""
    return line["best"]["free"] >= SEEN


def counts(line: dict) -> bool:
    """A rate of the table counts this record."""
    family = line["family"]
    return family == "nulls" or (seen(line) if family == "singles" else clear(line))


def _inside(line: dict) -> bool:
    low, high = line["diffusivity"]["interval_95"]
    return low <= line["truth"] <= high


def _excess(line: dict) -> float | None:
    """Held-out gap above the floor, after over before; None where there was none worth speaking of."""
    gap = line["gap"]
    parts = [gap[key] for key in ("held_out_before_K", "held_out_after_K", "floor_K")]
    if any(part is None for part in parts):
        return None
    before, after, floor = parts
    return max(after - floor, 0.0) / (before - floor) if before > 1.1 * floor else None


def summary(lines: list[dict]) -> dict:
    """Every figure of the table, from the log's lines."""
    tried = [line for line in lines if "left_out" not in line]
    done = [line for line in tried if "error" not in line]
    of = {family: [line for line in done if line["family"] == family] for family in Counter(x["family"] for x in done)}
    single, pair = of.get("singles", []), of.get("pairs", [])
    distinct, shown = [line for line in single if clear(line)], [line for line in single if seen(line)]
    right = [line for line in shown if named_right(line)]
    both = [line for line in pair if clear(line)]
    beyond = [line for line in of.get("outside", []) if clear(line)]
    told = [line for line in right if line["best"]["free"] <= TOLD]
    ratios = [e["expected_gain"] / e["gain"] for line in told for e in line["effects"][:1] if e["gain"]]
    excess = [value for value in map(_excess, right) if value is not None]
    named = [len(_names(line)) for line in shown if line["verdict"] in ("named", "confusable")]
    figures = {
        f"false alarm on nulls, {noise}": _rate(
            line["verdict"] in ALARMS for line in of.get("nulls", []) if line["kind"] == noise
        )
        for noise in NOISES
    }
    figures |= {
        "single effects, clear of rivals: first name right": _rate(first_right(line) for line in distinct),
        "the same, and no other name": _rate(named_right(line) for line in distinct),
        "single effects, seen: among name and alternatives": _rate(_hidden(line)[0] in _names(line) for line in shown),
        "names in the median": {"median": float(np.median(named)) if named else None, "count": len(named)},
        "both of a hidden pair, each clear": _rate(set(_hidden(line)) <= set(_labels(line)) for line in both),
        "outside the library, clear: unnamed": _rate(line["verdict"] == "unnamed" for line in beyond),
        "held-out excess, after over before": _quantiles(excess),
        "diffusivity after the right name inside its interval": _rate(map(_inside, right)),
        "expected over real gain": _quantiles(ratios),
        "seconds a record": _quantiles([line["seconds"] for line in done]),
    }
    figures["crashes"] = {"count": len(tried) - len(done), "of": len(tried)}
    return {"figures": figures, "verdicts": _verdicts(of), "confusion": _confusion(single), "clear": _by_name(distinct)}


def _quantiles(values: list[float]) -> dict:
    if not values:
        return {"median": None, "quantiles_10_90": [None, None], "count": 0}
    low, middle, high = np.quantile(values, [0.1, 0.5, 0.9])
    return {"median": float(middle), "quantiles_10_90": [float(low), float(high)], "count": len(values)}


def _width(line: dict) -> float | None:
    low, high = line["diffusivity"]["interval_95"] or (None, None)
    return None if low is None or high is None else (high - low) / line["truth"]


def _verdicts(of: dict) -> dict:
    """Of every family and verdict: rate, median relative width of the diffusivity's interval, its coverage."""
    table = {}
    for family, lines in of.items():
        for verdict in VERDICTS:
            own = [line for line in lines if line["verdict"] == verdict]
            widths = [width for width in map(_width, own) if width is not None]
            inside = [_inside(line) for line in own if _width(line) is not None]
            table[f"{family}: {verdict}"] = _rate(line["verdict"] == verdict for line in lines) | {
                "width": float(np.median(widths)) if widths else None,
                "inside": float(np.mean(inside)) if inside else None,
            }
    return table


def _said(line: dict) -> str:
    """What was answered, in a word; a wrong target is told."""
    if line["verdict"] not in ("named", "confusable"):
        return line["verdict"]
    if not line["effects"]:
        return f"{line['verdict']}, no name"
    name, target = _labels(line)[0]
    hidden = _hidden(line)[0]
    said = name if (name, target) == hidden or name != hidden[0] else f"{name}, wrong target"
    more = f" + {len(line['effects']) - 1}" if len(line["effects"]) > 1 else ""
    return f"{said}{more}{' (confusable)' if line['verdict'] == 'confusable' else ''}"


def _confusion(lines: list[dict]) -> dict:
    """What was answered to each effect that the free parameters do not hide."""
    table: dict[str, Counter] = defaultdict(Counter)
    for line in lines:
        if seen(line):
            table[line["kind"]][_said(line)] += 1
    return {name: dict(table[name].most_common()) for name in EFFECTS if name in table}


def _by_name(lines: list[dict]) -> dict:
    """First names right of each effect that is clear of rivals."""
    return {
        name: _rate(first_right(x) for x in own) for name in EFFECTS if (own := [x for x in lines if x["kind"] == name])
    }


_TARGETS = {
    "single effects, clear of rivals: first name right": ">= 97 %",
    "the same, and no other name": "-",
    "single effects, seen: among name and alternatives": ">= 95 %",
    "names in the median": "<= 3",
    "both of a hidden pair, each clear": ">= 95 %",
    "outside the library, clear: unnamed": ">= 85 %",
    "held-out excess, after over before": "<= 0.10",
    "diffusivity after the right name inside its interval": "92 to 98 %",
    "expected over real gain": "0.9 to 1.1",
    "seconds a record": "-",
    "crashes": "0",
}


def _reached(figure: dict) -> str:
    if "rate" in figure:
        return "-" if figure["rate"] is None else f"{figure['rate']:.1%}"
    if "median" in figure:
        return "-" if figure["median"] is None else f"{figure['median']:.3g}"
    return str(figure["count"])


def _spread(figure: dict) -> str:
    if figure.get("rate") is not None:
        return "{:.1%} to {:.1%}".format(*figure["interval_95"])
    if figure.get("median") is not None and "quantiles_10_90" in figure:
        return "{:.3g} to {:.3g} (10 to 90 %)".format(*figure["quantiles_10_90"])
    return ""


def _counted(figure: dict) -> str:
    return f"{figure['hits']} of {figure['count']}" if "hits" in figure else str(figure.get("of", figure["count"]))


def tables(found: dict) -> Iterator[Table]:
    """The table of targets, verdicts, and what was answered to each effect."""
    table = Table("measure", "target", "reached", "95 %", "records", title="what was hidden, and what was found")
    for name, figure in found["figures"].items():
        table.add_row(name, _TARGETS.get(name, "<= 5 %"), _reached(figure), _spread(figure), _counted(figure))
    yield table
    table = Table("family: verdict", "rate", "95 %", "records", "median width of the diffusivity's 95 %", "inside")
    for name, figure in found["verdicts"].items():
        width = "-" if figure["width"] is None else f"{figure['width']:.1%}"
        inside = "-" if figure["inside"] is None else f"{figure['inside']:.1%}"
        table.add_row(name, _reached(figure), _spread(figure), _counted(figure), width, inside)
    yield table
    table = Table("hidden alone", "first name right, clear", f"answers at {SEEN:g} and above")
    for name, answers in found["confusion"].items():
        figure = found["clear"].get(name)
        told = ", ".join(f"{answer} {count}" for answer, count in answers.items())
        table.add_row(name, _counted(figure) if figure else "-", told)
    yield table


def _log(path: Path) -> dict[str, dict]:
    """The log's lines by key; a line that was cut off is done again, and so is one that crashed."""
    found = {}
    for text in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        try:
            line = json.loads(text)
        except json.JSONDecodeError:
            continue
        if "error" not in line:
            found[line["key"]] = line
    return found


def _plain(value: object) -> object:
    """JSON of NumPy's numbers."""
    return value.item() if isinstance(value, np.generic) else str(value)


def main() -> None:
    """Run and print; see the module."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.accuracy.discrepancy", description=__doc__)
    parser.add_argument(
        "--records", type=int, default=20, help="of each kind (noise, effect); five times as many pairs"
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--family", choices=["nulls", "singles", "pairs", "outside", "all"], default="all")
    parser.add_argument("--kind", help="only records of this noise or effect")
    parser.add_argument("--seed", type=int, default=SCORING[0], help="of the scoring or the tuning seeds")
    parser.add_argument(
        "--counted", action="store_true", help="only records that a rate counts: what is hidden is there to be seen"
    )
    parser.add_argument("--tuning", action="store_true", help="the first tuning seed")
    parser.add_argument("--log", type=Path, help="JSON lines, appended to and resumed from")
    parser.add_argument("--json", type=Path, help="where to write the figures")
    chosen = parser.parse_args()
    seed = TUNING[0] if chosen.tuning else chosen.seed
    families = ("nulls", "singles", "pairs", "outside") if chosen.family == "all" else (chosen.family,)
    log = chosen.log or Path("wallid-out") / f"discrepancy-{seed}.jsonl"
    log.parent.mkdir(parents=True, exist_ok=True)
    console = Console()
    console.print(
        f"tuning seeds {TUNING[0]} to {TUNING[-1]}, scoring seeds {SCORING[0]} to {SCORING[-1]}, "
        f"this run {seed} ({'scoring' if seed in SCORING else 'tuning'}); log {log}"
    )
    wanted = [job for job in jobs(families, chosen.records, seed) if chosen.kind in (None, job.kind)]
    known = {key: line for key, line in _log(log).items() if chosen.counted or "left_out" not in line}
    lines = [known[job.key] for job in wanted if job.key in known]
    todo = [job for job in wanted if job.key not in known]

    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before the workers start: as many as cores already
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
    with (
        ProcessPoolExecutor(chosen.workers, mp_context=get_context("spawn"), initializer=_ready) as pool,
        Progress(*columns, TimeRemainingColumn(), console=console) as progress,
        open(log, "a", encoding="utf-8") as file,
    ):
        task = progress.add_task("records", total=len(wanted), completed=len(lines))
        for future in as_completed([pool.submit(run, job, chosen.counted) for job in todo]):
            line = future.result()
            lines.append(line)
            file.write(json.dumps(line, default=_plain) + "\n")
            file.flush()
            if "error" in line:
                progress.console.print(f"{line['key']}: {line['error']}", style="red", markup=False)
            progress.advance(task)
    found = summary(json.loads(json.dumps(lines, default=_plain)))
    for table in tables(found):
        console.print(table)
    if chosen.json:
        chosen.json.write_text(json.dumps(found | {"seed": seed, "records": len(lines)}, indent=1), encoding="utf-8")
