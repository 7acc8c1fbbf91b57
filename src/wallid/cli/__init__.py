"""The command line."""

from .commands import app, command

__all__ = ["app", "command"]
