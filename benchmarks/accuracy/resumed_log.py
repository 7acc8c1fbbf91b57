"""Tasks in processes of their own, each outcome appended to a log of JSON lines: a long run goes on where it ended."""

import json
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any


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
    """
    done = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
    known = {tuple(outcome[name] for name in keys) for outcome in done}
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool, log.open("a") as file:
        todo = [pool.submit(run, *task) for task in tasks if key(*task) not in known]
        for future in as_completed(todo):
            done.append(future.result())
            file.write(json.dumps(done[-1]) + "\n")
            file.flush()
    return done
