"""From a logger's file to a table of cells: its encoding, separator, decimal mark, header and unit rows."""

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
from .._internal.validation import nearest, show
from .file_format import SEPARATORS, Format

_HEAD_LINES = 60  # that are looked at for header, separator and unit rows
_HEAD_BYTES = 1 << 18
_MOST_UNIT_ROWS = 3
NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$")
_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?$")
POINT = re.compile(r"[+-]?\d*\.\d+([eE][+-]?\d+)?$")
_WESTERN = "°µ²³·ºª–’“”äöüÄÖÜßéèêëàâçîïôûùñáíóúåæøÅÆØ€×±¹¼½¾«»\xa0"
"""What a western logger writes beside ASCII; other text in a file that is not UTF-8 could be in any encoding."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """The cells of a file.

    Args:
        file: its path.
        header: the column names.
        cells: the wanted columns as a data frame, each as numbers where every cell is one; its index is
            the cells' line in the file.
        units: what stands under each wanted column's name in rows of units.
        encoding, separator, decimal: as the file has them.
        header_line: 1 unless other lines stand above it.
        unit_rows: how many lines of units were skipped.
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


def read_sheet(path: str | os.PathLike[str], wanted: Sequence[str], form: Format) -> Sheet:
    """The wanted columns of a file; the first of them is that of times.

    Raises:
        InputError: a file that cannot be read as a table, or a column that is missing.
    """
    file, wanted = str(path), list(dict.fromkeys(wanted))
    content, encoding = read_text(file, form)
    head = head_of(content)
    separator, at, header = _find_header(file, head, wanted, form)
    if head[at].count('"') % 2 and not set(wanted) <= set(header):
        raise InputError(f"{file}: line {at + 1}: a quotation mark is not closed; close or delete it")
    for name in wanted:
        count = header.count(name)
        if not count:
            there = ", ".join(header)
            hint = f"; is separator = {show(form.separator)} right?" if form.separator and len(header) == 1 else ""
            raise InputError(f'{file}: no column "{name}"; the columns are {there}{nearest(name, header)}{hint}')
        if count > 1:
            raise InputError(f'{file}: {count} columns are called "{name}"; names must differ')
    places = [header.index(name) for name in wanted]
    rows = split_cells(head[at + 1 :], separator)
    unit_rows = _count_unit_rows(rows, places)
    decimal = form.decimal or _find_decimal(rows[unit_rows:], places)
    width = _width(rows[unit_rows:], len(header))
    cells = _read_cells(file, content, separator, decimal, at + 1 + unit_rows, width, len(header))
    cells = cells.iloc[:, places].set_axis(wanted, axis=1)
    cells.index += at + 2 + unit_rows
    units = {
        name: " ".join(row[place].strip() for row in rows[:unit_rows] if place < len(row)).strip()
        for name, place in zip(wanted, places, strict=True)
    }
    return Sheet(file, header, cells, units, encoding, separator, decimal, at + 1, unit_rows)


def read_text(file: str, form: Format) -> tuple[str, str]:
    """A file's text and its encoding.

    Raises:
        InputError: it cannot be opened, or its encoding is not plain.
    """
    try:
        with open(file, "rb") as stream:
            raw = stream.read()
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:  # a name that no file can have
        raise InputError(f"{file!r}: cannot be read: {error}") from error
    encoding = form.encoding or _guess_encoding(raw)
    try:
        content = raw.decode(encoding)
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(
            f"{file}: line {line}: not {encoding.upper()}; save the file as UTF-8, or state its encoding "
            '([record] encoding = "cp1252")'
        ) from error
    if form.encoding is None and encoding == "cp1252":
        _check_western(file, content)
    content = content.removeprefix("\ufeff")
    if "\0" in content:
        line = content.count("\n", 0, content.index("\0")) + 1
        raise InputError(f"{file}: line {line}: not text; a record must be CSV (export it anew as text)")
    return content, encoding


def _guess_encoding(raw: bytes) -> str:
    """UTF-8, UTF-16 by its mark or its zeros, or else the western code page."""
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
    """Refuse a file that is not UTF-8 unless all its letters are what a western logger writes."""
    for found in re.finditer(r"[^\x00-\x7f]", content):
        if found[0] not in _WESTERN:
            line = content.count("\n", 0, found.start()) + 1
            raise InputError(
                f"{file}: line {line}: not UTF-8, and {show(found[0])} if read as cp1252; save the file as UTF-8, or "
                'state its encoding ([record] encoding = "cp1252")'
            )


def head_of(content: str) -> list[str]:
    """The first lines."""
    lines = re.split(r"\r\n|\n|\r", content[:_HEAD_BYTES])
    if len(content) > _HEAD_BYTES:
        lines.pop()
    return lines[:_HEAD_LINES]


def split_cells(lines: Sequence[str], separator: str) -> list[list[str]]:
    """Each line's cells; a quotation mark that is not closed takes no other line with it."""
    rows = []
    for line in lines:
        try:
            cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
        except csv.Error:
            cells = line.split(separator)
        rows.append([cell.strip() for cell in cells])
    return rows


def _find_header(file: str, head: Sequence[str], wanted: Sequence[str], form: Format) -> tuple[str, int, list[str]]:
    """Separator, line (from 0) and names of the header: the first line with every wanted column, or line 1."""
    candidates = SEPARATORS if form.separator is None else (form.separator,)
    tried = []
    for separator in candidates:
        rows = split_cells(head, separator)
        for at, row in enumerate(rows):
            if all(name in row for name in wanted):
                return separator, at, row
        first = rows[0] if rows else []
        tried.append((sum(name in first for name in wanted), len(first), separator, first))
    if not head or not head[0].strip():
        raise InputError(f"{file}: line 1 is empty; it must be a header of column names")
    _, _, separator, first = max(tried, key=lambda one: one[:2])
    return separator, 0, first


def _count_unit_rows(rows: Sequence[Sequence[str]], places: Sequence[int]) -> int:
    """How many lines under the header hold words where times and numbers must be."""
    count = 0
    for row in rows[:_MOST_UNIT_ROWS]:
        cells = [row[place] for place in places if place < len(row)]
        if not any(cells) or (len(cells) > 0 and re.match(r"[+-]?\d", cells[0])) or any(map(NUMBER.match, cells[1:])):
            break
        count += 1
    return count if count < len(rows) else 0


def _find_decimal(rows: Sequence[Sequence[str]], places: Sequence[int]) -> str:
    """A comma where more numbers have commas than points."""
    cells = [row[place] for row in rows for place in places[1:] if place < len(row)]
    return "," if sum(map(bool, map(_COMMA.match, cells))) > sum(map(bool, map(POINT.match, cells))) else "."


def _width(rows: Sequence[Sequence[str]], columns: int) -> int:
    """How many cells a row has: those of the header, or more where what is past them is empty."""
    widest = max((len(row) for row in rows if not any(row[columns:])), default=columns)
    return max(widest, columns)


def _read_cells(file: str, content: str, separator: str, decimal: str, skip: int, width: int, columns: int) -> Any:
    """All columns as a data frame, each as numbers where every cell is one; its index counts lines."""
    import pandas as pd

    try:
        with warnings.catch_warnings():
            # every row longer than the header: pandas would cut them and only warn
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
        return pd.DataFrame({place: [] for place in range(width)}, dtype=float)
    except pd.errors.ParserWarning as error:
        raise _too_long(file, skip + 1, columns) from error
    except pd.errors.ParserError as error:
        detail = str(error).replace("Error tokenizing data. C error: ", "").strip()
        if found := re.search(r"Expected \d+ fields in line (\d+), saw \d+", detail):
            raise _too_long(file, int(found[1]), columns) from error
        if found := re.search(r"EOF inside string starting at row (\d+)", detail):
            line = 1 + int(found[1])
            raise InputError(f"{file}: line {line}: a quotation mark is not closed; close or delete it") from error
        raise InputError(f"{file}: {detail}; every row must have one cell for each column of the header") from error


def _too_long(file: str, line: int, columns: int) -> InputError:
    return InputError(
        f"{file}: line {line}: more cells than the header's {columns} columns; every row must have one cell for each "
        "column of the header (decimal commas between separating commas? export with semicolons, or with points)"
    )
