"""The entry point of the program `wallid`. It imports nothing slow, so that signals have their meaning before that."""

from __future__ import annotations

from .._internal.interrupts import end_on_signals
from .output import flush_output


def command() -> None:
    """Entry point of the program `wallid`, also as `python -m wallid`.

    From here on SIGINT, SIGTERM and SIGHUP end the process with one line on standard error and status 130.
    """
    end_on_signals()
    from .commands import app

    try:
        app(prog_name="wallid")  # the name for which a shell completes, however the program was started
    finally:
        flush_output()
