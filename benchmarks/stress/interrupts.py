"""Signals sent to `wallid run` at moments spread over its whole duration: each must end it at once and leave nothing.

python -m benchmarks.stress.interrupts [--moments 50] [--signals INT TERM HUP] [--case CASE] [--cache]

A moment is a computing time of the command, so that other work on the machine does not move it to another stage. A run
that was complete when the signal came is counted apart: its files must then all be there.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

LINE = "wallid: interrupted; nothing was written"
COMPLETE = "wallid: interrupted after all files were written to "
FIRST_MOMENT = 0.1  # s of computing; before it Python itself starts, and its own handlers end it
LONGEST_END = 5.0  # s from the signal to the end
_CACHE = {"JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
_REPORTED = 10  # runs from one line about all so far to the next


@dataclass(frozen=True)
class Ending:
    """How a command ended after a signal.

    Args:
        kind: "interrupted", "complete" (all files were written before the signal), "early" (it ended before the
            signal) or "failed".
        seconds: from the signal to its end.
        fault: what is wrong where it failed.
    """

    kind: str
    seconds: float
    fault: str = ""


def start_command(case: str | Path, out: Path, *options: str, **environment: str) -> subprocess.Popen[str]:
    """`wallid run` in a session of its own, with the signals' usual meaning."""
    return subprocess.Popen(
        [sys.executable, "-m", "wallid", "run", str(case), "--out", str(out), *options],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env=os.environ | environment,
        preexec_fn=_default_signals,
    )


def _default_signals() -> None:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def end_command(process: subprocess.Popen[str], number: signal.Signals, folder: Path, out: Path) -> Ending:
    """Send a signal to a command and say how it ended.

    Args:
        process: from `start_command`.
        number: the signal.
        folder: that is empty where nothing was written.
        out: of the command, in `folder`.
    """
    early = process.poll() is not None
    began = time.perf_counter()
    if not early:
        os.killpg(process.pid, number)  # as a terminal does: to every process of the command
    try:
        output, errors = process.communicate(timeout=LONGEST_END)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return Ending("failed", LONGEST_END, f"still there after {LONGEST_END:g} s")
    seconds = time.perf_counter() - began
    if early:
        return Ending("early", 0.0)
    left = sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))
    lines = errors.splitlines()
    last = lines[-1] if lines else ""
    faults = [] if process.returncode == 130 else [f"status {process.returncode}"]
    if "Traceback" in errors or sum(line.startswith("wallid:") for line in lines) != 1:
        faults.append(f"standard error {errors[-300:]!r}")
    with suppress(ProcessLookupError):
        os.killpg(process.pid, 0)
        faults.append("a process of it goes on")
    if process.returncode in (0, 1) and (out / "result.json").exists():  # the signal came while Python ended
        return Ending("complete", seconds, errors[-300:] if "Traceback" in errors else _missing_files(out))
    if last.startswith(COMPLETE):
        return Ending("failed" if faults else "complete", seconds, "; ".join(faults) or _missing_files(out))
    faults += [f"last line {last!r}"] * (last != LINE) + [f"standard output {output[:100]!r}"] * bool(output)
    faults += [f"left {left}"] * bool(left)
    return Ending("failed" if faults else "interrupted", seconds, "; ".join(faults))


def _missing_files(out: Path) -> str:
    """What is missing from the files of a complete run, or should not be there."""
    listed = set(json.loads((out / "result.json").read_text("utf-8"))["files"])
    there = {path.name for path in out.iterdir()}
    return "" if listed == there else f"files {sorted(there)} instead of {sorted(listed)}"


def write_small_case(folder: Path) -> Path:
    """A case of five days that goes through all stages of a run."""
    from benchmarks.stress.fuzz import plain_record, write_case

    write_case(folder, plain_record().encode(), "")
    path = folder / "case.toml"
    path.write_text(path.read_text("utf-8").replace('model = "lom"', 'model = "mim"\norder = 3'), "utf-8")
    return path


def duration_of(case: str | Path, **environment: str) -> float:
    """Computing time of an undisturbed run, s."""
    with tempfile.TemporaryDirectory() as folder:
        before = _seconds_of_ended()
        process = start_command(case, Path(folder) / "out", **environment)
        _, errors = process.communicate()
        if process.returncode not in (0, 1):
            raise RuntimeError(f"the run itself fails:\n{errors}")
        return _seconds_of_ended() - before


def _seconds_of_ended() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _wait_until(process: subprocess.Popen[str], moment: float) -> None:
    """Wait until a process has computed for some seconds, or has ended. It needs Linux's /proc."""
    ticks = os.sysconf("SC_CLK_TCK")
    while process.poll() is None:
        fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
        if (int(fields[11]) + int(fields[12])) / ticks >= moment:
            return
        time.sleep(0.005)


def main() -> int:
    """Send the signals, print a line for each failure and a table; the number of failures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--moments", type=int, default=50, help="for each signal")
    parser.add_argument("--signals", nargs="+", default=["INT", "TERM", "HUP"], choices=["INT", "TERM", "HUP"])
    parser.add_argument("--case", default="", help="default: a small case that goes through all stages")
    parser.add_argument("--cache", action="store_true", help="keep compiled programs from one run to the next")
    parser.add_argument("--seed", type=int, default=0, help="of the moments within their strata")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        environment = _CACHE | {"JAX_COMPILATION_CACHE_DIR": str(home / "compiled")} if asked.cache else {}
        case = asked.case or write_small_case(home)
        if asked.cache:
            duration_of(case, **environment)
        duration = duration_of(case, **environment)
        print(f"an undisturbed run computes for {duration:.1f} s", flush=True)
        moments = _moments(duration, asked.moments, asked.seed)
        tally = {name: Tally() for name in asked.signals}
        pairs = [(name, moment) for name in asked.signals for moment in moments]
        random.Random(asked.seed).shuffle(pairs)  # so that a part of the runs says something about all
        for count, (name, moment) in enumerate(pairs, start=1):
            options = ["--quiet"] if count % 2 else []
            ending = send_at(moment, signal.Signals[f"SIG{name}"], case, *options, **environment)
            tally[name].add(ending)
            if ending.fault:
                print(f"  SIG{name} after {moment:.2f} s of computing: {ending.fault}", flush=True)
            if count % _REPORTED == 0:
                print(f"  after {count} of {len(pairs)}: {sum(tally.values(), start=Tally())}", flush=True)
    for name in asked.signals:
        print(f"SIG{name:<5} {tally[name]}")
    return sum(tally.values(), start=Tally()).kinds["failed"]


class Tally:
    """How many runs ended in each way, and the longest time from a signal to the end."""

    def __init__(self, kinds: Counter[str] | None = None, longest: float = 0.0):
        self.kinds, self.longest = kinds or Counter[str](), longest

    def add(self, ending: Ending) -> None:
        self.kinds["failed" if ending.fault else ending.kind] += 1
        self.longest = max(self.longest, ending.seconds)

    def __add__(self, other: Tally) -> Tally:
        return Tally(self.kinds + other.kinds, max(self.longest, other.longest))

    def __str__(self) -> str:
        shown = ", ".join(f"{self.kinds[kind]} {kind}" for kind in ("interrupted", "complete", "early", "failed"))
        return f"{shown}; at most {self.longest:.2f} s to the end"


def _moments(duration: float, count: int, seed: int) -> np.ndarray:
    """One moment in each of `count` equal parts of the run, s of computing."""
    inside = (np.arange(count) + np.random.default_rng(seed).random(count)) / count
    return FIRST_MOMENT + inside * (duration - FIRST_MOMENT)


def send_at(moment: float, number: signal.Signals, case: str | Path, *options: str, **environment: str) -> Ending:
    """Send a signal to a new run at a moment, and say how it ended."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "new" / "out"
        process = start_command(case, out, *options, **environment)
        _wait_until(process, moment)
        return end_command(process, number, Path(folder), out)


if __name__ == "__main__":
    sys.exit(min(main(), 1))
