"""What a process of its own asks of Python's collector of garbage.

A command imports a quarter of a million objects, all of which stay. Each search for cycles goes through them, and so do
the last ones at the process's end, when the system takes everything back: a second of a command's twenty.
"""

from __future__ import annotations

import atexit
import gc


def leave_what_stays() -> None:
    """Have it not search what is imported by now, nor, at the process's end, all that is left."""
    gc.freeze()
    atexit.register(gc.freeze)
