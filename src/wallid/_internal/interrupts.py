"""The end of a command by a signal: Ctrl-C, a request to end, or the end of the terminal.

All threads block the signals, and one thread waits for them. So a signal does not stop code at an arbitrary place. The
waiting thread prints one line and ends the process at once, also while XLA compiles. Files are written in one short
section at the end of a command. A signal in that section waits until the section is over.

Only a command calls `end_on_signals`. In a notebook nothing of this has an effect.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import NoReturn

STATUS = 130
"""Exit status of a command that was interrupted, as shells have it for Ctrl-C."""
NOTHING_WRITTEN = "interrupted; nothing was written"
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
_PATIENCE = 0.5  # s, for another thread's line, or for a pipe that nobody empties

_files = threading.Lock()  # held while files are written
_line = threading.Lock()  # held while a line is printed on standard error
_requested = threading.Event()
_message = NOTHING_WRITTEN
_before_line = ""


class _GivenUp(BaseException):
    """The files are not written, because a signal came before the first was in its place."""


def end_on_signals() -> None:
    """End the process at the next of the signals, with one line on standard error and status 130.

    Call it before other threads start. Signals that the process was started to ignore (`nohup`, a job in the
    background of a script) are ignored further.
    """
    known = [getattr(signal, name) for name in _SIGNALS if hasattr(signal, name)]
    awaited = {number for number in known if signal.getsignal(number) is not signal.SIG_IGN}
    if not awaited:
        return
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_BLOCK, awaited)
        threading.Thread(target=_wait_for, args=(awaited,), daemon=True, name="signals").start()
        return
    for number in awaited:  # Windows: Python calls a handler as soon as its main thread can
        signal.signal(number, lambda number, frame: threading.Thread(target=_end_process, daemon=True).start())


@contextmanager
def signals_held() -> Iterator[None]:
    """Let a signal wait until the block is over; then it ends the process."""
    with suppress(_GivenUp), _files:
        yield
    if _requested.is_set():
        threading.Event().wait()  # the other thread is about to end the process


def give_up_if_interrupted() -> None:
    """Leave the block of `signals_held` if a signal waits."""
    if _requested.is_set():
        raise _GivenUp


def written(what: str) -> None:
    """Say from now on, at a signal, what was written before it; call it in a block of `signals_held`."""
    global _message
    _message = f"interrupted after {what}"


@contextmanager
def whole_line() -> Iterator[None]:
    """Let a signal wait until a line is printed on standard error."""
    with _line:
        yield


def print_before_line(text: str) -> None:
    """Print this before the line about the signal, to remove a progress bar or to leave the line of a question."""
    global _before_line
    _before_line = text


def _wait_for(awaited: set[signal.Signals]) -> None:
    signal.sigwait(awaited)
    _end_process()


def _end_process() -> NoReturn:
    """Print the line and end the process without cleaning up: other threads may be anywhere in compiled code."""
    _requested.set()
    _files.acquire()  # never released: nothing is written any more
    _line.acquire(timeout=_PATIENCE)
    with suppress(OSError, ValueError, AttributeError):
        error = sys.stderr.fileno()
        if os.name == "nt" or select.select([], [error], [], _PATIENCE)[1]:
            os.write(error, f"{_before_line}wallid: {_message}\n".encode())
    os._exit(STATUS)
