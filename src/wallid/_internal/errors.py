"""The error that a person can mend."""

from __future__ import annotations


class InputError(ValueError):
    """Something in the input that a person can mend; the command line answers it with exit status 2."""
