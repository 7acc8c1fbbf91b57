"""Reading of a logger's CSV file as a table of cells: encoding, separator, decimal mark, header and rows of units."""

from __future__ import annotations

import csv
import io
import os
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from .._internal.errors import InputError
from .._internal.validation import format_value, spelling_hint
from .file_format import SEPARATORS, FileFormat
from .file_signatures import foreign_format

_HEAD_LINES = 60  # in which header, separator and rows of units are searched
_HEAD_BYTES = 1 << 18
_MAX_UNIT_ROWS = 3
NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$")
_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?$")
POINT = re.compile(r"[+-]?\d*\.\d+([eE][+-]?\d+)?$")
_WESTERN_LETTERS = "°µ²³·ºª–’“”äöüÄÖÜßéèêëàâçîïôûùñáíóúåæøÅÆØ€×±¹¼½¾«»\xa0"
"""Letters beside ASCII with which a file that is not UTF-8 is read as cp1252; with others its encoding is unknown."""


@dataclass(frozen=True, eq=False)
class RawTable:
    """The cells of a file.

    Args:
        file: its path.
        header: the column names.
        cells: the requested columns as a data frame, numeric where every cell is a number; the index is the line in
            the file.
        units: for each requested column the text below its name in rows of units.
        encoding, separator, decimal: of the file.
        header_line: line number of the header.
        unit_rows: number of rows of units below the header.
    """

    file: str
    header: list[str]
    cells: Any
    units: dict[str, str]
    encoding: str
    separator: str
    decimal: str
    header_line: int
    unit_rows: int


def read_raw_table(path: str | os.PathLike[str], wanted: Sequence[str], file_format: FileFormat) -> RawTable:
    """Read columns of a CSV file.

    Args:
        path: of the file.
        wanted: the requested columns; the first is that of the times.
        file_format: of the file; what it does not set is detected.

    Raises:
        InputError: the file is not a table, or a column is missing.
    """
    file, wanted = str(path), list(dict.fromkeys(wanted))
    content, encoding = decode_file(file, file_format)
    head = first_lines(content)
    separator, header_row, header = _find_header(file, head, wanted, file_format)
    if head[header_row].count('"') % 2 and not set(wanted) <= set(header):
        raise InputError(f"{file}: line {header_row + 1}: a quotation mark is not closed; close or delete it")
    one_column = file_format.separator and len(header) == 1
    hint = f"; check separator = {format_value(file_format.separator)}" if one_column else ""
    indices = column_indices(file, header, wanted, hint)
    rows = split_cells(head[header_row + 1 :], separator)
    unit_rows = _count_unit_rows(rows, indices)
    decimal = file_format.decimal or _find_decimal(rows[unit_rows:], indices)
    width = _width(rows[unit_rows:], len(header))
    cells = _read_cells(file, content, separator, decimal, header_row + 1 + unit_rows, width, len(header))
    cells = cells.iloc[:, indices].set_axis(wanted, axis=1)
    cells.index += header_row + 2 + unit_rows
    units = {
        name: " ".join(row[index].strip() for row in rows[:unit_rows] if index < len(row)).strip()
        for name, index in zip(wanted, indices, strict=True)
    }
    return RawTable(file, header, cells, units, encoding, separator, decimal, header_row + 1, unit_rows)


def column_indices(file: str, header: Sequence[str], wanted: Sequence[str], hint: str = "") -> list[int]:
    """The index of each wanted column in the header.

    Raises:
        InputError: a column is missing, or several have its name.
    """
    for name in wanted:
        count = header.count(name)
        if not count:
            columns = ", ".join(header)
            raise InputError(
                f'{file}: no column "{name}"; the columns are {columns}{spelling_hint(name, header)}{hint}'
            )
        if count > 1:
            raise InputError(f'{file}: {count} columns are called "{name}"; names must differ')
    return [header.index(name) for name in wanted]


def decode_file(file: str, file_format: FileFormat) -> tuple[str, str]:
    """Read a file's text and detect its encoding where the format does not set it.

    Raises:
        InputError: the file cannot be opened, is not text, or its encoding is unknown.
    """
    try:
        with open(file, "rb") as stream:
            raw = stream.read()
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:  # an invalid file name
        raise InputError(f"{file!r}: cannot be read: {error}") from error
    if foreign := foreign_format(raw):
        kind, remedy = foreign
        raise InputError(f"{file}: this is {kind}; a record must be a CSV file: {remedy}")
    encoding = file_format.encoding or _guess_encoding(raw)
    try:
        content = raw.decode(encoding)
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(
            f"{file}: line {line}: not {encoding.upper()}; save the file as UTF-8, or set its encoding "
            '([record] encoding = "cp1252")'
        ) from error
    if file_format.encoding is None and encoding == "cp1252":
        _check_western(file, content)
    content = content.removeprefix("\ufeff")
    if "\0" in content:
        line = content.count("\n", 0, content.index("\0")) + 1
        raise InputError(f"{file}: line {line}: not text; a record must be a CSV file (export it as text)")
    return content, encoding


def _guess_encoding(raw: bytes) -> str:
    """UTF-8, UTF-16 by its byte order mark or its zero bytes, or else cp1252."""
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    head = raw[:4096]
    if len(head) >= 4 and head.count(0) > 0.3 * len(head):
        return "utf-16-le" if head[1::2].count(0) > head[::2].count(0) else "utf-16-be"
    try:
        raw.decode("utf-8")
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8"


def _check_western(file: str, content: str) -> None:
    """Raise an error for a file that is not UTF-8 and has other letters than cp1252 usually has."""
    for letter in re.finditer(r"[^\x00-\x7f]", content):
        if letter[0] not in _WESTERN_LETTERS:
            line = content.count("\n", 0, letter.start()) + 1
            raise InputError(
                f"{file}: line {line}: not UTF-8; it has {format_value(letter[0])} if read as cp1252; save the file as "
                'UTF-8, or set its encoding ([record] encoding = "cp1252")'
            )


def first_lines(content: str) -> list[str]:
    """The first lines of a file."""
    lines = re.split(r"\r\n|\n|\r", content[:_HEAD_BYTES])
    if len(content) > _HEAD_BYTES:
        lines.pop()
    return lines[:_HEAD_LINES]


def split_cells(lines: Sequence[str], separator: str) -> list[list[str]]:
    """The cells of each line; each line is split alone, so that an unclosed quotation mark does not join lines."""
    rows = []
    for line in lines:
        try:
            cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
        except csv.Error:
            cells = line.split(separator)
        rows.append([cell.strip() for cell in cells])
    return rows


def _find_header(
    file: str, head: Sequence[str], wanted: Sequence[str], file_format: FileFormat
) -> tuple[str, int, list[str]]:
    """Separator, index and names of the header: the first line with all requested columns, or else the first line."""
    candidates = SEPARATORS if file_format.separator is None else (file_format.separator,)
    tried = []
    for separator in candidates:
        rows = split_cells(head, separator)
        for index, row in enumerate(rows):
            if all(name in row for name in wanted):
                return separator, index, row
        first = rows[0] if rows else []
        tried.append((sum(name in first for name in wanted), len(first), separator, first))
    if not head or not head[0].strip():
        raise InputError(f"{file}: line 1 is empty; it must be a header of column names")
    _, _, separator, first = max(tried, key=lambda candidate: candidate[:2])
    return separator, 0, first


def _count_unit_rows(rows: Sequence[Sequence[str]], indices: Sequence[int]) -> int:
    """Number of lines below the header that have text in place of times and numbers."""
    count = 0
    for row in rows[:_MAX_UNIT_ROWS]:
        cells = [row[index] for index in indices if index < len(row)]
        if not any(cells) or (len(cells) > 0 and re.match(r"[+-]?\d", cells[0])) or any(map(NUMBER.match, cells[1:])):
            break
        count += 1
    return count if count < len(rows) else 0


def _find_decimal(rows: Sequence[Sequence[str]], indices: Sequence[int]) -> str:
    """A comma if more numbers have a comma than a point, else a point."""
    cells = [row[index] for row in rows for index in indices[1:] if index < len(row)]
    return "," if sum(map(bool, map(_COMMA.match, cells))) > sum(map(bool, map(POINT.match, cells))) else "."


def _width(rows: Sequence[Sequence[str]], columns: int) -> int:
    """Number of cells in a row: that of the header, or more where the additional cells are empty."""
    widest = max((len(row) for row in rows if not any(row[columns:])), default=columns)
    return max(widest, columns)


def _read_cells(file: str, content: str, separator: str, decimal: str, skip: int, width: int, columns: int) -> Any:
    """All columns as a data frame, numeric where every cell is a number."""
    import pandas as pd

    try:
        with warnings.catch_warnings():
            # pandas only warns where every row is longer than the header, and cuts the rows
            warnings.simplefilter("error", pd.errors.ParserWarning)
            return pd.read_csv(
                io.StringIO(content),
                sep=separator,
                decimal=decimal,
                header=None,
                names=list(range(width)),
                skiprows=skip,
                keep_default_na=False,
                na_values=[""],
                low_memory=False,
                skip_blank_lines=False,
                skipinitialspace=True,
                index_col=False,
            )
    except pd.errors.EmptyDataError:
        return pd.DataFrame({index: [] for index in range(width)}, dtype=float)
    except pd.errors.ParserWarning as error:
        raise _too_many_cells(file, skip + 1, columns) from error
    except pd.errors.ParserError as error:
        detail = str(error).replace("Error tokenizing data. C error: ", "").strip()
        if found := re.search(r"Expected \d+ fields in line (\d+), saw \d+", detail):
            raise _too_many_cells(file, int(found[1]), columns) from error
        if found := re.search(r"EOF inside string starting at row (\d+)", detail):
            line = 1 + int(found[1])
            raise InputError(f"{file}: line {line}: a quotation mark is not closed; close or delete it") from error
        raise InputError(f"{file}: {detail}; every row must have one cell for each column of the header") from error


def _too_many_cells(file: str, line: int, columns: int) -> InputError:
    return InputError(
        f"{file}: line {line}: more cells than the header's {columns} columns; every row must have one cell for each "
        "column of the header (if commas are both decimal mark and separator, export with semicolons or decimal points)"
    )
