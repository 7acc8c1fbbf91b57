"""What a command prints. A reader that stops reading (`| head -1`) is no error: the command goes on to its end."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import TextIO

from .._internal.interrupts import whole_line


def print_output(text: str, end: str = "\n") -> None:
    """Print on standard output."""
    try:
        print(text, end=end, flush=True)
    except BrokenPipeError:
        _discard_further(sys.stdout)


def print_message(text: str) -> None:
    """Print a line on standard error."""
    with whole_line():
        try:
            print(text, file=sys.stderr, flush=True)
        except BrokenPipeError:
            _discard_further(sys.stderr)


def flush_output() -> None:
    """Write what standard output still holds, such as a help text."""
    with suppress(AttributeError):  # there is no standard output
        try:
            sys.stdout.flush()
        except BrokenPipeError:
            _discard_further(sys.stdout)


def _discard_further(stream: TextIO) -> None:
    """Let a stream lead to nowhere: Python would complain about the closed pipe when it ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)
