"""Mutilated records thrown at `wallid check` and `run`: each must end with status 0, 1 or 2 and leave nothing broken.

python -m benchmarks.stress.fuzz [--files 2000] [--command run] [--seconds 3600]
"""

from __future__ import annotations

import argparse
import json
import os
import random
import tempfile
import time
from collections import Counter
from functools import cache
from pathlib import Path

import numpy as np

os.environ.setdefault("JAX_ENABLE_X64", "1")

import jax

from benchmarks.stress.mutilations import ENCODINGS, LINES, RECORD_KEYS, mutilate

ROWS = 120
_KEPT = 100  # files, whose compiled programs are kept
_CASE = """
[wall]
length = 0.3
diffusivity_prior = 6e-7
[record]
file = "record.csv"
time = "time"
left = "T_left"
right = "T_right"
{extra}
[[sensor]]
name = "T1"
position = 0.1
noise_std = 0.05
[[sensor]]
name = "T2"
position = 0.2
noise_std = 0.05
offset_std = 0.1
[choices]
window_days = 2
model = "lom"
nodes = 21
"""


@cache
def plain_record() -> str:
    """Five hourly days of a wall: two waves that go in from the left face, in a half-space, and a steady slope."""
    hours = np.arange(ROWS)
    noise = np.random.default_rng(5).normal(0.0, 0.05, (ROWS, 4))
    found = []
    for column, x in enumerate((0.0, 0.3, 0.1, 0.2)):
        temperature = 8.0 + 30.0 * x + 0.0 * hours
        for amplitude, period in ((6.0, 24.0), (3.0, 67.0)):
            depth = np.sqrt(8e-7 * period * 3600.0 / np.pi)
            temperature += amplitude * np.exp(-x / depth) * np.cos(2 * np.pi * hours / period - x / depth)
        found.append(temperature + noise[:, column])
    stamps = np.datetime64("2020-03-05T00:00", "s") + hours * np.timedelta64(3600, "s")
    rows = [f"{stamp},{a:.2f},{b:.2f},{c:.2f},{d:.2f}" for stamp, a, b, c, d in zip(stamps, *found, strict=True)]
    return "\n".join(["time,T_left,T_right,T1,T2", *rows, ""])


def write_case(folder: Path, content: bytes, extra: str) -> None:
    """A case whose record has this content, with one more line under [record]."""
    (folder / "record.csv").write_bytes(content)
    (folder / "case.toml").write_text(_CASE.format(extra=extra), encoding="utf-8")


def examine(folder: Path) -> int:
    """What `wallid check` does in one process, its figure apart; the status it ends with.

    Raises:
        AssertionError: something is not as it must be.
    """
    from wallid import InputError, load
    from wallid.case.record_check import check
    from wallid.report import writer as report
    from wallid.workflow import Run

    try:
        case = load(folder)
    except InputError as error:
        message = str(error)
        assert "\n" not in message and len(message) < 2000, message
        assert "record.csv" in message or "[record]" in message or "choices" in message, message
        return 2
    record, found = case.record, check(case)
    text = report.result_as_json(Run(case, check=found))
    json.loads(text, parse_constant=_refuse_constant)
    assert str(case) and str(found)
    assert record.faces.shape == (record.rows, 2) and np.isfinite(record.faces).all()
    assert record.sensors.shape == (record.rows, 2) and not np.isinf(record.sensors).any()
    assert (np.diff(record.time) > 0).all() and np.allclose(np.diff(record.time), record.step, rtol=3e-3)
    assert record.fill_std is None or (record.fill_std >= 0).all()
    assert sum(rows for _, rows in record.unbroken_parts) + record.broken.sum() == record.rows
    return 1 if found.stops else 0


def outcome(folder: Path, command: str) -> int:
    """A command on the case in a folder; the status it ends with.

    Raises:
        AssertionError: something is not as it must be.
    """
    from typer.testing import CliRunner

    from wallid.cli.commands import app

    out = folder / "out"
    before = sorted(folder.iterdir())
    ended = CliRunner().invoke(app, [command, str(folder), "--json", "--out", str(out)])
    assert ended.exception is None or isinstance(ended.exception, SystemExit), repr(ended.exception)
    assert ended.exit_code in (0, 1, 2), ended.exit_code
    assert "Traceback" not in ended.stderr, ended.stderr
    if ended.exit_code == 2:
        assert ended.stdout == "" and sorted(folder.iterdir()) == before
        assert ended.stderr.startswith("wallid: ") and ended.stderr.count("\n") == 1, ended.stderr
        return 2
    result = (out / "result.json").read_text(encoding="utf-8")
    assert json.loads(result, parse_constant=_refuse_constant)["schema"] == 1
    assert json.loads(ended.stdout) == json.loads(result)
    assert not [file for file in out.iterdir() if file.name.startswith(".") or file.stat().st_size == 0]
    return ended.exit_code


def _refuse_constant(name: str) -> None:
    raise AssertionError(f"{name} in result.json")


def draw(seed: int) -> tuple[bytes, str, str]:
    """A mutilated file, a line of [record], and what was done, in words."""
    source = random.Random(seed)
    which = [source.choice(LINES) for _ in range(source.choice([1, 1, 2, 3]))]
    encoding = source.choice(["utf-8"] * 6 + list(ENCODINGS))
    extra = source.choice(RECORD_KEYS)
    words = f"{', '.join(one.__name__ for one in which)}; {encoding}; {extra or 'plain'}"
    return mutilate(plain_record(), seed, which, encoding), extra, words


def main() -> None:
    """Throw files until they, or the time, are used up; print how they ended."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0, help="seed of the first file")
    parser.add_argument("--command", choices=["check", "run", "examine"], default="run")
    parser.add_argument("--seconds", type=float, default=3600.0)
    asked = parser.parse_args()
    began, ended, failures = time.perf_counter(), Counter[int](), 0
    for seed in range(asked.first, asked.first + asked.files):
        if time.perf_counter() - began > asked.seconds:
            break
        if seed % _KEPT == 0:  # a thousand records' programs would not fit one process
            jax.clear_caches()
        content, extra, words = draw(seed)
        with tempfile.TemporaryDirectory() as folder:
            write_case(Path(folder), content, extra)
            try:
                status = examine(Path(folder)) if asked.command == "examine" else outcome(Path(folder), asked.command)
                ended[status] += 1
            except Exception as error:
                failures += 1
                print(f"seed {seed}: {words}: {type(error).__name__}: {error}", flush=True)
    taken = time.perf_counter() - began
    print(f"{asked.command}: {sum(ended.values()) + failures} files in {taken:.0f} s; {failures} failed; {dict(ended)}")


if __name__ == "__main__":
    main()
