"""The position of rows in a file, for error messages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from .._internal.errors import InputError


@dataclass(frozen=True, eq=False)
class FilePosition:
    """The position of rows in a file.

    Args:
        file: its path.
        lines: line number of each row, counted from 1 at the start of the file, (time,).
    """

    file: str
    lines: np.ndarray

    def raise_at_cell(self, column: str, row: int, message: str) -> NoReturn:
        """Raise an InputError that gives file, line and column."""
        raise InputError(f'{self.file}: line {self.lines[row]}, column "{column}": {message}')

    def raise_for_column(self, column: str, message: str) -> NoReturn:
        """Raise an InputError that gives file and column."""
        raise InputError(f'{self.file}: column "{column}": {message}')
