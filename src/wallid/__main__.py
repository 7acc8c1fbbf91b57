"""`python -m wallid`: the command line."""

from .cli import command

command()
