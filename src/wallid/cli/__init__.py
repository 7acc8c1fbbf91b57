"""The command line: its commands and their options."""

from .commands import app, command

__all__ = ["app", "command"]
