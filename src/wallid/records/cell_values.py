"""Conversion of cells to numbers: missing-value markers, other texts, units, and physically impossible values."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._internal.validation import format_value
from .cleaning_log import CleaningStep
from .file_format import FileFormat, to_celsius
from .file_position import FilePosition
from .logger_file import POINT

_KELVIN_MEDIANS = (200.0, 400.0)  # a column in degC with a median in this range is in kelvin
_LOWEST, _HIGHEST = -100.0, 150.0  # degC: a value outside is a fault, or has another unit
_NO_VALUE = {"nan", "na", "n/a", "n.a.", "#n/a", "null", "none", "nil", "missing", "nodata", "no-data", "no data"}
_SYMBOLS = {".", "...", "*", "**", "***", "?", "??", *("-" * count for count in range(1, 9))}
_FAULTS = {"err", "error", "#err", "fault", "fail", "bad", "invalid", "open", "short", "nc", "n.c.", "open circuit"}
_RANGE = {"ol", "o.l", "o.l.", "ovl", "ov", "over", "+over", "-over", "overflow", "ul", "under", "out of range"}
_RANGE |= {f"{side}{mark}range" for side in ("over", "under") for mark in ("", "-", "_", " ")}
_SPREADSHEET_ERRORS = {"#value!", "#wert!", "#div/0!", "#ref!", "#num!", "#name?"}
_MARKERS = frozenset(_NO_VALUE | _SYMBOLS | _FAULTS | _RANGE | _SPREADSHEET_ERRORS)
"""Texts that loggers write for a missing reading, in lower case."""
_COMMA = re.compile(r"[+-]?\d*,\d+$")
_UNITS = {
    "degF": (re.compile(r"°\s?F|\bdeg\.?\s?F\b|fahrenheit", re.IGNORECASE), re.compile(r"^\W*F\W*$")),
    "K": (re.compile(r"\bkelvin\b|°\s?K", re.IGNORECASE), re.compile(r"^\W*K\W*$")),
    "degC": (re.compile(r"°\s?C|\bdeg\.?\s?C\b|celsius", re.IGNORECASE), re.compile(r"^\W*C\W*$")),
}
"""Patterns of units: with a degree sign or a word, and as a single letter, which counts in a row of units only."""


@dataclass(frozen=True, eq=False)
class CellColumn:
    """A column of a file as it was read.

    Args:
        name: as in the header.
        cells: a pandas series of numbers or texts, (time,).
        location: of the rows in the file.
        decimal: the decimal mark.
        unit_row: the text below the column's name in rows of units.
    """

    name: str
    cells: Any
    location: FilePosition
    decimal: str
    unit_row: str


@dataclass(frozen=True, eq=False)
class ParsedColumn:
    """The cells of a column as numbers.

    Args:
        values: NaN where the cell is no finite number, (time,).
        empty: which cells are empty, (time,).
        marked: which cells have a missing-value marker, (time,).
        text: which cells have another text, (time,).
        infinite: which cells have an infinite value, (time,).
    """

    values: np.ndarray
    empty: np.ndarray
    marked: np.ndarray
    text: np.ndarray
    infinite: np.ndarray


def parse_numbers(column: CellColumn, file_format: FileFormat) -> ParsedColumn:
    """Convert a column of numbers and texts to numbers.

    Raises:
        InputError: the column has both decimal commas and decimal points.
    """
    cells = column.cells
    empty = cells.isna().to_numpy()
    if cells.dtype.kind in "iuf":
        values, marked, text = cells.to_numpy(float, copy=True), np.zeros(len(empty), bool), np.zeros(len(empty), bool)
    else:
        values, marked, text = _parse_texts(column, empty, file_format)
    infinite = np.isinf(values)
    for marker in file_format.missing:
        if not isinstance(marker, str):
            marked = marked | (values == marker)
    values[infinite | marked] = np.nan
    return ParsedColumn(values, empty, marked, text, infinite)


def _parse_texts(column: CellColumn, empty: np.ndarray, file_format: FileFormat):
    """Values of a column of texts, and which cells are markers or other texts; each distinct text is parsed once."""
    import pandas as pd

    cells = column.cells
    codes, distinct = pd.factorize(cells.where(~empty, "").astype(str).str.strip())
    texts: Any = pd.Series(np.asarray(distinct, dtype=object), dtype=str)
    with_points = texts if column.decimal == "." else texts.str.replace(column.decimal, ".", regex=False)
    numbers = np.array(pd.to_numeric(with_points, errors="coerce"), float)
    markers = _MARKERS | {str(marker).casefold() for marker in file_format.missing if isinstance(marker, str)}
    lower = texts.str.casefold()
    is_marker = (lower.isin(markers) | lower.str.fullmatch(r"#+")).to_numpy(bool)
    numbers[is_marker | (texts == "").to_numpy(bool)] = np.nan
    commas, points = (texts.str.fullmatch(mark.pattern).to_numpy(bool) & ~is_marker for mark in (_COMMA, POINT))
    if commas.any() and ((file_format.decimal is None and points.any()) or file_format.decimal == "."):
        rare_points = file_format.decimal is None and points[codes].sum() < commas[codes].sum()
        rare, usual_mark = (points, "comma") if rare_points else (commas, "point")
        row = int(rare[codes].argmax())
        column.location.raise_at_cell(
            column.name,
            row,
            f"found {format_value(str(cells.iloc[row]))}; other numbers in this file have a decimal {usual_mark}; "
            'write all numbers alike, or set [record] decimal = ","',
        )
    with_comma = commas & np.isnan(numbers)
    numbers[with_comma] = texts[with_comma].str.replace(",", ".", regex=False).astype(float)
    is_text = np.isnan(numbers) & ~is_marker
    return numbers[codes], is_marker[codes] & ~empty, is_text[codes] & ~empty


def read_numbers(column: CellColumn, file_format: FileFormat) -> tuple[np.ndarray, list[CleaningStep]]:
    """Convert a column to numbers and mask all other cells.

    Returns:
        The values, NaN where masked, (time,), and the cleaning steps.

    Raises:
        InputError: the column has no number, or mostly text.
    """
    parsed, location, name, cells = parse_numbers(column, file_format), column.location, column.name, column.cells
    text_count, filled = int(parsed.text.sum()), int((~parsed.empty & ~parsed.marked).sum())
    if text_count and 2 * text_count > filled:
        row = int(parsed.text.argmax())
        example = format_value(str(cells.iloc[row]))
        location.raise_at_cell(
            name,
            row,
            f"found {example}; it must be a number, and {text_count} of the column's {filled} filled cells are not; "
            f"use another column, or set the text of missing values: [record] missing = [{example}]",
        )
    if np.isnan(parsed.values).all():
        if parsed.infinite.any():
            row = int(parsed.infinite.argmax())
            location.raise_at_cell(
                name, row, "found an infinite value, and the column has no finite number; use another column"
            )
        location.raise_for_column(name, "has no value; it must contain numbers, or be removed from the case")
    steps = []
    for kind, mask in (("marked", parsed.marked), ("text", parsed.text), ("infinite", parsed.infinite)):
        if mask.any():
            row = int(mask.argmax())
            example, line = format_value(str(cells.iloc[row])), int(location.lines[row])
            # a marker stands for a missing value: nothing was masked
            masked_lines = None if kind == "marked" else location.lines[mask]
            steps.append(CleaningStep(name, kind, int(mask.sum()), line, example, masked_lines))
    return parsed.values, steps


def read_temperatures(
    column: CellColumn, file_format: FileFormat, *, unit: str | None
) -> tuple[np.ndarray, list[CleaningStep]]:
    """Convert a column of temperatures to degC and mask physically impossible values.

    Args:
        column: of temperatures.
        file_format: of the file.
        unit: stated by the user; None means degC, and then the file must not state another.

    Returns:
        The temperatures, degC, NaN where masked, (time,), and the cleaning steps.

    Raises:
        InputError: the unit differs from the stated one, or most values are impossible.
    """
    location, name = column.location, column.name
    if unit is None and (found_unit := stated_unit(column.unit_row, name)) not in (None, "degC"):
        location.raise_for_column(
            name,
            f'the unit in {format_value(column.unit_row or name)} is {found_unit}; set [record] unit = "{found_unit}", '
            f'or unit = "{found_unit}" in its [[sensor]] (unit = "degC" if the file is wrong)',
        )
    unit = unit or "degC"
    raw, steps = read_numbers(column, file_format)
    values = np.array(to_celsius(raw, unit), float)
    if unit != "degC":
        steps.append(CleaningStep(name, "converted", int(np.isfinite(values).sum()), None, unit))
    median = float(np.nanmedian(values))
    if unit == "degC" and _KELVIN_MEDIANS[0] < median < _KELVIN_MEDIANS[1]:
        location.raise_for_column(
            name,
            f"the median is {median:.6g}, so the values are probably in kelvin; temperatures must be in degC, or their "
            'unit be set: [record] unit = "K", or unit = "K" in its [[sensor]]',
        )
    impossible = (values < _LOWEST) | (values > _HIGHEST)
    if impossible.any():
        row, finite = int(impossible.argmax()), int(np.isfinite(values).sum())
        if 2 * impossible.sum() > finite:
            location.raise_at_cell(
                name,
                row,
                f"found {raw[row]:.6g}; {impossible.sum()} of {finite} values are outside {_LOWEST:g} to {_HIGHEST:g} "
                "degC; check [record] unit",
            )
        steps.append(CleaningStep.masking(name, "impossible", location.lines, impossible, f"{raw[row]:.6g}"))
        values[impossible] = np.nan
    return values, steps


def stated_unit(unit_row: str, name: str = "") -> str | None:
    """The unit of temperature that a row of units or the column's name states; None where neither does."""
    for unit, (pattern, letter) in _UNITS.items():
        if pattern.search(unit_row) or letter.search(unit_row):
            return unit
    return next((unit for unit, (pattern, _) in _UNITS.items() if pattern.search(name)), None)
