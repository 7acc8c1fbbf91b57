"""Tasks in processes of their own, each outcome appended to a log of JSON lines: a long run goes on where it ended."""

import argparse
import json
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any


def count_options(document: str, log: str, records: int, of: str = "of each kind") -> argparse.ArgumentParser:
    """The options of a count that goes on where it ended: `--records`, `--first`, `--log` and `--workers`.

    Args:
        document: of the module; its first line is the help text.
        log: its usual file. records: how many there usually are. of: what is counted.
    """
    parser = argparse.ArgumentParser(description=document.splitlines()[0])
    parser.add_argument("--records", type=int, default=records, help=of)
    parser.add_argument("--first", type=int, default=0, help="number of the first: a count of another day goes on")
    parser.add_argument("--log", type=Path, default=Path(log))
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    return parser


def resumed(
    log: Path,
    tasks: Sequence[tuple],
    run: Callable[..., dict[str, Any]],
    key: Callable[..., tuple],
    keys: Sequence[str],
    workers: int | None,
) -> list[dict[str, Any]]:
    """The outcomes in the log, with those of the tasks that it does not have yet.

    Args:
        log: of earlier outcomes; new ones are appended.
        tasks: the arguments of each.
        run: a task's outcome, by its arguments.
        key: what tells a task from others, by its arguments. keys: where its parts stand in an outcome.
        workers: number of processes; None for one on each core.

    Raises:
        RuntimeError: a task failed; the tasks that had not begun are left out.
    """
    done = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
    known = {tuple(outcome[name] for name in keys) for outcome in done}
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool, log.open("a") as file:
        todo = {pool.submit(run, *task): task for task in tasks if key(*task) not in known}
        for future in as_completed(todo):
            if future.exception() is not None:
                pool.shutdown(cancel_futures=True)
                raise RuntimeError(f"no outcome of {todo[future]}") from future.exception()
            done.append(future.result())
            file.write(json.dumps(done[-1]) + "\n")
            file.flush()
    return done
