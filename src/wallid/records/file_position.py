"""Where rows stand in a file, so that every refusal can name it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from .._internal.errors import InputError


@dataclass(frozen=True, eq=False)
class Place:
    """Where rows stand in a file.

    Args:
        file: its path.
        lines: of each row; the header is line 1 where nothing stands above it, (time,).
    """

    file: str
    lines: np.ndarray

    def refuse(self, column: str, row: int, message: str) -> NoReturn:
        """Raise an InputError that names file, line and column."""
        raise InputError(f'{self.file}: line {self.lines[row]}, column "{column}": {message}')

    def refuse_column(self, column: str, message: str) -> NoReturn:
        """Raise an InputError that names file and column."""
        raise InputError(f'{self.file}: column "{column}": {message}')
