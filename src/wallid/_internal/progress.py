"""Progress of long work: a callable `progress(text, share)`, and a bar in a notebook where none is given.

`text` says what begins, `share` is the completed share of the work, 0 to 1. The last call is `progress("done", 1.0)`.
"""

from __future__ import annotations

import sys
import threading
import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from html import escape
from typing import Any

Progress = Callable[[str, float], None]
"""Called at the beginning of each step with its text and the completed share of the work, 0 to 1."""

_FIRST_SHOWN = 1.5  # s; shorter work shows no bar, which would leave an empty line
_INTERVAL = 0.5  # s between two updates of the seconds
_bar_is_open: ContextVar[bool] = ContextVar("bar_is_open", default=False)


def no_progress(text: str, share: float) -> None:
    """Show nothing."""


def part_of(progress: Progress, low: float, high: float) -> Progress:
    """The progress of a part of the work, which goes from one share of the whole to another; it ends without "done"."""

    def report(text: str, share: float) -> None:
        if text != "done":
            progress(text, low + share * (high - low))

    return report


@contextmanager
def shown_progress(progress: Progress | None) -> Iterator[Progress]:
    """The callable to report to: the given one; for None a bar in a notebook, and nothing elsewhere.

    Work within work that already has a bar gets no bar of its own. At the end the callable is called with "done".
    """
    if progress is None and (_bar_is_open.get() or not _in_notebook()):
        yield no_progress
        return
    bar = _NotebookBar() if progress is None else None
    report = bar or progress
    assert report is not None
    token = _bar_is_open.set(True)
    try:
        yield report
        report("done", 1.0)
    finally:
        _bar_is_open.reset(token)
        if bar is not None:
            bar.close()


def _in_notebook() -> bool:
    """Whether the code runs in a Jupyter kernel, which can display HTML."""
    if "IPython" not in sys.modules:
        return False
    shell = sys.modules["IPython"].get_ipython()
    return any(base.__name__ == "ZMQInteractiveShell" for base in type(shell).__mro__)


class _NotebookBar:
    """A bar below the cell with the text of the step and the seconds so far; it is empty again at the end.

    A thread shows it, because a step such as a compilation takes seconds without a call.
    """

    def __init__(self) -> None:
        self.text, self.share = "", 0.0
        self.began = clock.perf_counter()
        self.handle: Any = None
        self.ended = threading.Event()
        self.thread = threading.Thread(target=copy_context().run, args=(self._show_until_end,), daemon=True)
        self.thread.start()

    def __call__(self, text: str, share: float) -> None:
        """Note the step that begins; the thread shows it."""
        self.text, self.share = text, share

    def close(self) -> None:
        """Take the bar away."""
        self.ended.set()
        self.thread.join()

    def _show_until_end(self) -> None:
        wait = _FIRST_SHOWN
        while not self.ended.wait(wait):
            wait = _INTERVAL
            self._show(
                f'<progress value="{self.share:.3f}" max="1"></progress> '
                f"{escape(self.text)} ({clock.perf_counter() - self.began:.0f} s)"
            )
        if self.handle is not None:
            self._show("")

    def _show(self, html: str) -> None:
        from IPython.display import HTML, display  # pyright: ignore[reportMissingImports]

        if self.handle is None:
            self.handle = display(HTML(html), display_id=True)
        else:
            self.handle.update(HTML(html))
