"""A year of a row a minute from eight sensors: how long `wallid check` and `estimate` take, and how much memory.

    python -m benchmarks.speed.year [--days 365]

The record is synthetic: a Crank-Nicolson scheme of its own between two faces, 525,600 rows, written as CSV.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.linalg import solve_banded

LENGTH, DIFFUSIVITY, NODES, SENSORS, STEP = 0.43, 1.0e-6, 44, 8, 60.0
_CASE = """
[wall]
length = 0.43
diffusivity_prior = 5e-7
[record]
file = "record.csv"
time = "time"
left = "T_left"
right = "T_right"
"""
_SENSOR = """
[[sensor]]
name = "T{count}"
position = {position:.4f}
noise_std = 0.05
"""
_CHILD = """
import json, resource, sys
from wallid.cli import app
try:
    app(sys.argv[1:])
except SystemExit as end:
    used = resource.getrusage(resource.RUSAGE_SELF)
    told = {"kib": used.ru_maxrss, "cpu": used.ru_utime + used.ru_stime, "status": end.code}
    print(json.dumps(told), file=sys.stderr)
"""


def temperatures(rows: int) -> np.ndarray:
    """Both faces and the sensors between them, degC, (row, 2 + sensor)."""
    seconds = STEP * np.arange(rows)
    day, year = 2 * np.pi * seconds / 86400, 2 * np.pi * seconds / (365 * 86400)
    left = 10 - 8 * np.cos(year) + 5 * np.cos(day) + 2 * np.cos(day / 4.3)
    right = 20 + 0.5 * np.cos(day + 1)
    ratio = DIFFUSIVITY * STEP / (LENGTH / (NODES - 1)) ** 2 / 2
    bands = np.tile([[-ratio], [1 + 2 * ratio], [-ratio]], (1, NODES - 2))
    field = np.linspace(left[0], right[0], NODES)
    places = np.linspace(4, NODES - 5, SENSORS).astype(int)
    found = np.empty((rows, 2 + SENSORS))
    for row in range(rows):
        if row:
            known = field[1:-1] + ratio * (field[2:] - 2 * field[1:-1] + field[:-2])
            known[0] += ratio * left[row]
            known[-1] += ratio * right[row]
            field = np.concatenate([[left[row]], solve_banded((1, 1), bands, known), [right[row]]])
        found[row] = [left[row], right[row], *field[places]]
    return found + np.random.default_rng(0).normal(0, 0.05, found.shape)


def write(folder: Path, days: int) -> None:
    """The record and its case."""
    rows = days * 1440
    names = ["T_left", "T_right", *(f"T{k + 1}" for k in range(SENSORS))]
    frame = pd.DataFrame(np.round(temperatures(rows), 3), columns=names)
    frame.insert(0, "time", np.datetime_as_string(np.datetime64("2021-01-01T00:00", "s") + 60 * np.arange(rows)))
    frame.to_csv(folder / "record.csv", index=False)
    places = np.linspace(4, NODES - 5, SENSORS).astype(int) * LENGTH / (NODES - 1)
    sensors = [_SENSOR.format(count=k + 1, position=x) for k, x in enumerate(places)]
    (folder / "case.toml").write_text(_CASE + "".join(sensors), encoding="utf-8")


def measure(folder: Path, command: str) -> str:
    """A command in a fresh process: its wall clock, largest memory and result."""
    words = [sys.executable, "-c", _CHILD, command, str(folder), "--json", "--out", str(folder / "out")]
    began = time.perf_counter()
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    taken = time.perf_counter() - began
    told = json.loads(done.stderr.splitlines()[-1])
    result = json.loads(done.stdout)
    value = (result["diffusivity"] or {}).get("value")
    return (
        f"{command:<9} {taken:5.1f} s (processors' time {told['cpu']:.1f} s), {told['kib'] / 2**20:.2f} GiB, "
        f"status {told['status']}, "
        f"diffusivity {value}, stages {result['seconds']}"
    )


def main() -> None:
    """Write the record, then time both commands."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--days", type=int, default=365)
    days = parser.parse_args().days
    print(f"{days * 1440} rows, {SENSORS} sensors, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder), days)
        for command in ("check", "estimate"):
            print(measure(Path(folder), command), flush=True)


if __name__ == "__main__":
    main()
