"""The command line as `python -m wallid`."""

from .cli import command

command()
