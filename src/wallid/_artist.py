"""Who draws a run's figures: this process, and beside a diagnosis a second one.

Matplotlib is Python, and so is most of what JAX does before anything is computed: threads would take turns. A figure
that is put together is a small thing to send to another process; drawing it takes ten times as long. Matplotlib is
imported where it is needed: a command that ends early does without.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from typing import TYPE_CHECKING

from threadpoolctl import threadpool_limits

from ._collector import leave_what_stays

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ._drawing import Drawn, Rendered
    from .workflow import Run


@dataclass
class _Sketch:
    """A figure that is put together, and what a helper makes of it where there is one."""

    stem: str
    made: Figure
    helped: Future[Rendered] | None


class Artist:
    """Draws the figures of one run.

    Arguments:
        formats: of the figures' files.
        helper: another process; None to draw everything here.
    """

    def __init__(self, formats: Sequence[str] = (), helper: Executor | None = None):
        self.formats, self._helper = tuple(formats), helper
        self._begun: list[_Sketch] = []

    def begin(self, run: Run) -> None:
        """Have the figures of the stages drawn, so that they are there when the diagnosis is; a helper does."""
        if self._helper is not None:
            self._begun = self._of_stages(run)

    def finish(self, run: Run) -> list[Drawn]:
        """All figures that the run has the numbers for, as soon as two can draw what is left of them."""
        from .figures import diagnosis

        sketches = self._begun or self._of_stages(run)
        if run.explanation is not None:
            sketches += self._sketch(diagnosis(run.explanation))
        # from the last on: the helper begins with the first
        return [self._drawn(sketch) for sketch in reversed(sketches)][::-1]

    def _of_stages(self, run: Run) -> list[_Sketch]:
        from .figures import of_stages

        return self._sketch(of_stages(run))

    def _sketch(self, figures: Iterable[tuple[str, Figure]]) -> list[_Sketch]:
        return [_Sketch(stem, made, self._ask(stem, made)) for stem, made in figures]

    def _ask(self, stem: str, made: Figure) -> Future[Rendered] | None:
        from ._drawing import render

        try:
            return None if self._helper is None else self._helper.submit(render, stem, made, self.formats)
        except BrokenProcessPool:
            return None

    def _drawn(self, sketch: _Sketch) -> Drawn:
        """By the helper if it has begun, here if it has not, or if it has died."""
        from ._drawing import Drawn, draw

        stem, made, helped = sketch.stem, sketch.made, sketch.helped
        if helped is not None and not helped.cancel():
            try:
                return Drawn(stem, made, *helped.result())
            except BrokenProcessPool:
                pass
        return draw(stem, made, self.formats)


@contextmanager
def artist(formats: Sequence[str], *, helped: bool) -> Iterator[Artist]:
    """An artist for a run.

    Arguments:
        helped: whether a second process is worth its start; it is none on a single core.
    """
    cores = os.cpu_count() or 1
    if not helped or cores < 2:
        yield Artist(formats)
        return
    # not forked: JAX's threads would hold locks in the copy; begun when it is first asked, so not where input is bad
    helper = ProcessPoolExecutor(1, get_context("spawn"), _prepare)
    try:
        # a core is the helper's: LAPACK's threads would keep it busy with waiting
        import scipy.linalg  # noqa: F401 (its LAPACK is another than NumPy's)

        with threadpool_limits(cores - 1, user_api="blas"):
            yield Artist(formats, helper)
    finally:
        helper.shutdown(cancel_futures=True)  # waited for, or both end at once, and one finds the other's pipe closed


def _prepare() -> None:
    """Ctrl-C reaches both processes; the first one ends the second."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    leave_what_stays()
