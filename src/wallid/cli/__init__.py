"""The command line."""

from typing import TYPE_CHECKING, Any

from .entry_point import command

if TYPE_CHECKING:
    from .commands import app

__all__ = ["app", "command"]


def __getattr__(name: str) -> Any:
    """Import the commands at their first use: `command` must be there before the slow imports."""
    if name == "app":
        from .commands import app

        return app
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
