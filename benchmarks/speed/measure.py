"""One contender at one work, measured in a process of its own: first call, median of the others, peak memory, error.

A process of its own, since a compilation, a cache or a peak of memory that one contender leaves would be another's gain
or loss. What a contender must have beforehand (matrices, a record, a learned model) is prepared outside the clock.
It stays prepared as long as it may be asked again: contenders of a millisecond take turns.

The process reads a line for each time that it is asked, of how many seconds its runs may fill, and answers with a line.
"""

from __future__ import annotations

import importlib
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

FEWEST, MOST = 3, 200  # runs
_ABSENT = 3  # exit status
PACKAGES = ("wallid", "jax", "jaxlib", "equinox", "diffrax", "optimistix", "numpy", "scipy", "pymor", "pyswarms")


class AbsentError(Exception):
    """A contender that this machine does not have (no gcc, a package that is not installed)."""


@dataclass(frozen=True)
class Prepared:
    """A contender that is ready to run.

    **Arguments:** `run`: the work, its answer ready when it returns; `error`: of such an answer, against the work's
    reference, by name; `units`: how many of the work's units one run does (diffusivities, walls).
    """

    run: Callable[[], Any]
    error: Callable[[Any], dict[str, float]]
    units: int = 1
    once: bool = False  # so long that the first run is the only one
    by_children: bool = False  # the work is done by processes that a run starts


@dataclass(frozen=True)
class Measured:
    """What one contender needed: seconds (a run, the first call), MiB above the start, errors.

    `memory` is of the first call and the runs after it, of the largest process where a run starts some, None where the
    machine does not tell.
    """

    work: str
    contender: str
    seconds: float
    quartiles: tuple[float, float]
    runs: int
    units: int
    first: float
    memory: float | None
    busy: float  # cores that a run kept busy
    error: dict[str, float] = field(default_factory=dict)

    @property
    def each(self) -> float:
        """Seconds of one unit."""
        return self.seconds / self.units


_SELF = Path("/proc/self")


def _reset_peak() -> float | None:
    """Have the process's largest resident memory counted anew: what it is now, MiB; None where that cannot be."""
    try:
        (_SELF / "clear_refs").write_text("5", encoding="ascii")
    except OSError:
        return None
    return _peak()


def _peak() -> float:
    status = (_SELF / "status").read_text(encoding="ascii")
    return float(status.split("VmHWM:")[1].split()[0]) / 1024


def _peak_of_children() -> float | None:
    """The largest resident memory of a process that this one started and that has ended, MiB."""
    if not sys.platform.startswith("linux"):
        return None  # other systems count in other units
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024


def timed(run: Callable[[], Any]) -> tuple[float, Any]:
    """Wall clock of one run, and its answer."""
    began = time.perf_counter()
    answer = run()
    return time.perf_counter() - began, answer


def prepared_here(work: str, contender: str) -> Callable[[float], Measured]:
    """Prepare a contender in this process and take its first call; what measures its runs for so many seconds."""
    import jax

    import wallid

    jax.config.update("jax_enable_x64", True)
    works = importlib.import_module(f"benchmarks.speed.works.{work}")
    if contender not in getattr(works, "PLAIN", ()):
        wallid.models.prepare_xla()  # as the commands do
    prepared: Prepared = works.CONTENDERS[contender]()
    before = _reset_peak()
    first, answer = timed(prepared.run)
    memory: list[float | None] = []  # of the first time: what computes the errors comes after it

    def measure(longest: float) -> Measured:
        nonlocal answer
        taken: list[float] = [first] if prepared.once else []
        worked = time.process_time()
        while not prepared.once and (len(taken) < FEWEST or (sum(taken) < longest and len(taken) < MOST)):
            seconds, answer = timed(prepared.run)
            taken.append(seconds)
        busy = 1.0 if prepared.once else (time.process_time() - worked) / sum(taken)
        if not memory:
            own = None if before is None else _peak() - before
            memory.append(_peak_of_children() if prepared.by_children else own)
        low, middle, high = (float(level) for level in np.quantile(taken, [0.25, 0.5, 0.75]))
        error = {name: float(value) for name, value in prepared.error(answer).items()}
        runs, units = len(taken), prepared.units
        return Measured(work, contender, middle, (low, high), runs, units, first, memory[0], busy, error)

    return measure


@contextmanager
def measuring(work: str, contender: str) -> Iterator[Callable[[float], Measured]]:
    """The same in a fresh process, which ends with the context.

    What measures raises:
        AbsentError: the contender says that it cannot run here.
        RuntimeError: it failed, with the last of what it said.
    """
    command = [sys.executable, "-m", "benchmarks.speed.measure", work, contender]
    surroundings = os.environ | {"JAX_PLATFORMS": os.environ.get("JAX_PLATFORMS", "cpu")}
    surroundings.pop("JAX_COMPILATION_CACHE_DIR", None)  # a first call is one without a cache
    own = getattr(importlib.import_module(f"benchmarks.speed.works.{work}"), "SURROUNDINGS", {}).get(contender, {})
    surroundings |= {name: value.format(cores=cores()) for name, value in own.items()}
    pipe = subprocess.PIPE
    with (
        tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as said,
        subprocess.Popen(command, bufsize=0, stdin=pipe, stdout=pipe, stderr=said, env=surroundings) as process,
    ):
        asks, answers = process.stdin, process.stdout
        assert asks is not None and answers is not None

        def measure(longest: float) -> Measured:
            with suppress(BrokenPipeError):  # it has ended, and `said` knows why
                asks.write(f"{longest}\n".encode())
            answer = answers.readline().decode()
            if answer.startswith("{"):
                found = json.loads(answer)
                return Measured(**found | {"quartiles": tuple(found["quartiles"])})
            status = process.wait()
            if status == _ABSENT:
                raise AbsentError(answer.strip())
            said.seek(0)
            raise RuntimeError(f"{work}, {contender}: {said.read()[-2000:]}\nended with status {status}")

        try:
            yield measure
        except BaseException:  # Ctrl-C among them
            process.kill()
            raise


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def machine() -> dict[str, Any]:
    """What the figures were measured on and with."""
    versions = {}
    for package in PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = "absent"
    model = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        model = next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    return {
        "processor": model,
        "cores": cores(),
        "load_at_start": os.getloadavg()[0],
        "python": platform.python_version(),
        "versions": versions,
    }


def main() -> None:
    """The measuring process."""
    work, contender = sys.argv[1:3]
    # answers have a way of their own: what else is printed, here or by what a contender starts, is a message
    with os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8") as answers:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
        try:
            measure = prepared_here(work, contender)
        except AbsentError as absent:
            print(absent, file=answers)
            sys.exit(_ABSENT)
        for longest in sys.stdin:
            print(json.dumps(asdict(measure(float(longest)))), file=answers, flush=True)


if __name__ == "__main__":
    # by its own name: `AbsentError` of `__main__` would be another one than the rivals'
    from benchmarks.speed.measure import main as measured

    measured()
