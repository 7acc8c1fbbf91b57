"""What a command shows on standard error while it works: a line for each stage, and on a terminal a bar below them."""

from __future__ import annotations

import sys
import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from .._internal.interrupts import print_before_line, whole_line
from .._internal.number_formats import terminal_text
from .output import print_message

_LONG = 5.0  # s without a line, after which the next step of a stage has a line too
_REMOVE_BAR = "\r\x1b[2K\x1b[?25h"  # the line of the bar is erased, and the cursor is shown again


class ProgressDisplay:
    """Shows finished stages and begun steps.

    Args:
        print_line: prints a line.
        move_bar: takes the text of a step and the completed share of the work; None where there is no bar.
    """

    def __init__(self, print_line: Callable[[str], None], move_bar: Callable[[str, float], None] | None = None):
        self._print_line, self._move_bar = print_line, move_bar
        self._latest = clock.monotonic()

    def step(self, text: str, share: float) -> None:
        """Show the beginning of a step, after this share of the work.

        Without a bar, the step has a line if the latest line is some seconds old.
        """
        if self._move_bar is not None:
            self._move_bar(text, share)
        elif share < 1.0 and clock.monotonic() - self._latest > _LONG:
            self.line(f"  {text}")

    def line(self, text: str) -> None:
        """Print a line, such as that of a finished stage."""
        self._latest = clock.monotonic()
        self._print_line(terminal_text(text, getattr(sys.stderr, "encoding", None)))


@contextmanager
def progress_display(silent: bool) -> Iterator[ProgressDisplay]:
    """The display on standard error; nothing where it is silent."""
    if silent:
        yield ProgressDisplay(lambda text: None, lambda text, share: None)
        return
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        yield ProgressDisplay(print_message)
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description:<45}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        print_before_line(_REMOVE_BAR)
        task = bar.add_task("", total=1.0)

        def print_line(text: str) -> None:
            with whole_line():
                bar.console.print(text, markup=False, highlight=False, soft_wrap=True)

        yield ProgressDisplay(print_line, lambda text, share: bar.update(task, description=text, completed=share))
    print_before_line("")
