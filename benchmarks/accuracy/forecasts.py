"""Whether the 95 % bands of forecasts hold the readings, where heat enters the wall that no column explains.

`python -m benchmarks.accuracy.forecasts`

The records are those of `benchmarks.accuracy.disturbance`, by other seeds: two sensors, or two plates; heat in the
whole wall or behind a face, with a memory of 3 hours or 2 days. A day of each is forecast from a week before it, as
`wallid forecast` does by default, given the faces; with `--days` from fewer. What is counted are the readings 1, 6 and
24 hours after the origin. Two hours of record follow: at a record's last row the slope of a face, and so the flux, is
known from one side only.

Each origin's outcome is appended to a log of JSON lines, so that a long run goes on where it ended.
"""

import argparse
import os
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path

import numpy as np

from benchmarks.accuracy.discrepancy.score import interval
from benchmarks.accuracy.disturbance import KEYS, MEMORIES, STEP, Kind, case_of, key_of
from benchmarks.accuracy.resumed_log import resumed

HOURS = (1.0, 6.0, 24.0)
FIRST = 400_000  # number of the first record: none of them was estimated before; 100_000 to 300_000 were looked at
LEFT = 2.0  # h of record after the last reading that is counted


@dataclass(frozen=True)
class Forecast(Kind):
    """Records of one kind, with so many days before the origin."""

    days: float = 7.0

    @property
    def rows(self) -> int:
        return round(((self.days + 1.0) * 86400.0 + LEFT * 3600.0) / STEP[self.logged])


def kinds(days: float) -> list[Forecast]:
    """The kinds of records, with so many days before the origin."""
    logged = ("sensors", "wall"), ("plates", "face")
    return [Forecast(*one, memory, days=days) for one, memory in product(logged, MEMORIES)]


def forecast(kind: Forecast, number: int) -> dict:
    """The errors over their standard deviations at some hours after one origin."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import wallid

    case, step = case_of(kind, FIRST + number), STEP[kind.logged]
    found = wallid.forecast(case, kind.days * 86400.0, HOURS[-1], days=kind.days)
    measured = np.asarray(found.measured)[found.first :]
    z = (measured - found.mean) / found.std
    rows = {hours: min(round(hours * 3600.0 / step), len(z)) - 1 for hours in HOURS}
    return asdict(kind) | {
        "number": number,
        "disturbance": found.disturbance is not None,
        "z": {f"{hours:g}": z[row].tolist() for hours, row in rows.items()},
        "day": float(np.mean(np.abs(z) <= 1.96)),
    }


def _key_of(kind: Forecast, number: int) -> tuple:
    """The values of `KEYS` of a record, and the days before its origin."""
    return *key_of(kind, number), kind.days


def summary(outcomes: list[dict], days: float) -> str:
    """The share of readings in their bands, by hours after the origin, and of the whole day."""
    lines = []
    for kind in (*kinds(days), None):
        own = [o for o in outcomes if kind is None or all(o[key] == value for key, value in asdict(kind).items())]
        if not own:
            continue
        texts = []
        for hours in HOURS:
            z = np.concatenate([o["z"][f"{hours:g}"] for o in own])
            hits = int(np.sum(np.abs(z) <= 1.96))
            low, high = interval(hits, len(z))
            texts.append(f"{hours:g} h {hits / len(z):.1%} ({low:.1%} to {high:.1%}; spread of z {z.std():.2f})")
        name = "all" if kind is None else f"{kind.logged}, {kind.heat}, {kind.memory:g} h"
        day = np.mean([o["day"] for o in own])
        lines.append(f"{name:<22} {len(own):4d} origins: {'; '.join(texts)}; the day {day:.1%}")
    return "\n".join(lines)


def main() -> None:
    """Run what the log does not have yet, and print the summary."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--origins", type=int, default=400)
    parser.add_argument("--days", type=float, default=7.0, help="of readings before each origin")
    parser.add_argument("--log", type=Path, default=Path("forecasts.jsonl"))
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    arguments = parser.parse_args()
    of_each = kinds(arguments.days)
    tasks = [(kind, number) for number in range(-(-arguments.origins // len(of_each))) for kind in of_each]
    done = resumed(arguments.log, tasks, forecast, _key_of, (*KEYS, "days"), arguments.workers)
    print(summary(done, arguments.days))


if __name__ == "__main__":
    main()
