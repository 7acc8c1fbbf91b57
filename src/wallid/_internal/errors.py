"""The error for invalid input."""

from __future__ import annotations


class InputError(ValueError):
    """The input is invalid and the user can correct it; the command line then ends with exit status 2."""
