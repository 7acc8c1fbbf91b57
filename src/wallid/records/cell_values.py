"""Cells as numbers: texts that stand for nothing, other texts, units, values that no wall can have."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._internal.validation import show
from .cleaning_log import Noted, Notes
from .file_format import Format, celsius
from .file_position import Place
from .logger_file import POINT

KELVIN = (200.0, 400.0)  # degC: a median between them was logged in kelvin
COLDEST, HOTTEST = -100.0, 150.0  # degC: beyond them stands a fault, or another unit
_NOTHING = {"nan", "na", "n/a", "n.a.", "#n/a", "null", "none", "nil", "missing", "nodata", "no-data", "no data"}
_SIGNS = {".", "...", "*", "**", "***", "?", "??", *("-" * count for count in range(1, 9))}
_FAULTS = {"err", "error", "#err", "fault", "fail", "bad", "invalid", "open", "short", "nc", "n.c.", "open circuit"}
_RANGE = {"ol", "o.l", "o.l.", "ovl", "ov", "over", "+over", "-over", "overflow", "ul", "under", "out of range"}
_RANGE |= {f"{side}{mark}range" for side in ("over", "under") for mark in ("", "-", "_", " ")}
_SHEETS = {"#value!", "#wert!", "#div/0!", "#ref!", "#num!", "#name?"}
_MARKERS = frozenset(_NOTHING | _SIGNS | _FAULTS | _RANGE | _SHEETS)
"""What loggers write, in lower case, where there is no reading."""
_COMMA = re.compile(r"[+-]?\d*,\d+$")
_UNITS = {
    "degF": (re.compile(r"°\s?F|\bdeg\.?\s?F\b|fahrenheit", re.IGNORECASE), re.compile(r"^\W*F\W*$")),
    "K": (re.compile(r"\bkelvin\b|°\s?K", re.IGNORECASE), re.compile(r"^\W*K\W*$")),
    "degC": (re.compile(r"°\s?C|\bdeg\.?\s?C\b|celsius", re.IGNORECASE), re.compile(r"^\W*C\W*$")),
}
"""How units are written: plainly, and as a letter that is one only where units stand."""


@dataclass(frozen=True, eq=False)
class Numbers:
    """A column's cells as numbers.

    Args:
        values: NaN where a cell is empty or masked, (time,).
        empty, marked, text, infinite: which cells hold nothing, a sign for a missing value, another
            text, an infinite value, (time,).
        texts: the cells as they stand, for messages.
    """

    values: np.ndarray
    empty: np.ndarray
    marked: np.ndarray
    text: np.ndarray
    infinite: np.ndarray
    texts: Any


def as_numbers(place: Place, column: str, cells: Any, form: Format, decimal: str) -> Numbers:
    """A series of numbers and texts as numbers.

    Raises:
        InputError: numbers with decimal commas beside others with decimal points.
    """
    empty = cells.isna().to_numpy()
    none = np.zeros(len(empty), bool)
    if cells.dtype.kind in "iuf":
        values, text, marked = cells.to_numpy(float, copy=True), none, none
    else:
        values, marked, text = _parse(place, column, cells, empty, form, decimal)
    infinite = np.isinf(values)
    for marker in form.missing:
        if not isinstance(marker, str):
            marked = marked | (values == marker)
    values[infinite | marked] = np.nan
    return Numbers(values, empty, marked, text, infinite, cells)


def _parse(place: Place, column: str, cells: Any, empty: np.ndarray, form: Format, decimal: str):
    """Values of a column of texts, and which are markers or other texts; each different text is read once."""
    import pandas as pd

    codes, different = pd.factorize(cells.where(~empty, "").astype(str).str.strip())
    kinds: Any = pd.Series(np.asarray(different, dtype=object), dtype=str)
    plain = kinds if decimal == "." else kinds.str.replace(decimal, ".", regex=False)
    numbers = np.array(pd.to_numeric(plain, errors="coerce"), float)
    words = {str(marker).casefold() for marker in form.missing if isinstance(marker, str)}
    lower = kinds.str.casefold()
    is_marker = (lower.isin(_MARKERS | words) | lower.str.fullmatch(r"#+")).to_numpy(bool)
    numbers[is_marker | (kinds == "").to_numpy(bool)] = np.nan
    commas, points = (kinds.str.fullmatch(mark.pattern).to_numpy(bool) & ~is_marker for mark in (_COMMA, POINT))
    mixed = form.decimal is None and points.any()
    if commas.any() and (mixed or form.decimal == "."):
        few_points = mixed and points[codes].sum() < commas[codes].sum()
        odd, others = (points, "comma") if few_points else (commas, "point")
        row = int(odd[codes].argmax())
        place.refuse(
            column,
            row,
            f"found {show(str(cells.iloc[row]))}; it must be a number with a decimal {others} as others in this file "
            'are; write all alike, or state [record] decimal = ","',
        )
    unread = commas & np.isnan(numbers)
    numbers[unread] = kinds[unread].str.replace(",", ".", regex=False).astype(float)
    is_text = np.isnan(numbers) & ~is_marker
    return numbers[codes], is_marker[codes] & ~empty, is_text[codes] & ~empty


def readings(place: Place, column: str, cells: Any, form: Format, decimal: str, notes: Notes) -> np.ndarray:
    """A column of any numbers, with all that is none masked and noted.

    Raises:
        InputError: a column without a number, or mostly text.
    """
    found = as_numbers(place, column, cells, form, decimal)
    text, filled = int(found.text.sum()), int((~found.empty & ~found.marked).sum())
    if text and 2 * text > filled:
        row = int(found.text.argmax())
        place.refuse(
            column,
            row,
            f"found {show(str(cells.iloc[row]))}; it must be a number, and {text} of the column's {filled} filled "
            "cells are not; name another column, or list what stands for a missing value in [record] missing = "
            f"[{show(str(cells.iloc[row]))}]",
        )
    if np.isnan(found.values).all():
        if found.infinite.any():
            place.refuse(
                column,
                int(found.infinite.argmax()),
                "found an infinite value, and no finite number in the whole column; name another column",
            )
        place.refuse_column(column, "holds no value; it must hold numbers, or be left out of the case")
    for kind, which in (("marked", found.marked), ("text", found.text), ("infinite", found.infinite)):
        if which.any():
            row = int(which.argmax())
            noted = Noted(column, kind, int(which.sum()), int(place.lines[row]), show(str(cells.iloc[row])))
            notes.note(noted, None if kind == "marked" else which)  # a sign for a missing value hides none
    return found.values


def temperatures(
    place: Place,
    column: str,
    cells: Any,
    form: Format,
    decimal: str,
    notes: Notes,
    *,
    unit: str | None,
    written: str = "",
) -> np.ndarray:
    """A column of temperatures in degC, with all that no wall can have masked and noted.

    Args:
        unit: declared; None for degC, which the file must not contradict.
        written: what stands under the column's name in rows of units.

    Raises:
        InputError: a unit that is not the declared one, or mostly impossible values.
    """
    if unit is None and (known := unit_of(written, column)) not in (None, "degC"):
        place.refuse_column(
            column,
            f"{show(written or column)} says that it is in {known}; state it: [record] unit = "
            f'"{known}", or unit = "{known}" in its [[sensor]] (or "degC" if that is what it is)',
        )
    unit = unit or "degC"
    raw = readings(place, column, cells, form, decimal, notes)
    values = np.array(celsius(raw, unit), float)
    if unit != "degC":
        notes.note(Noted(column, "converted", int(np.isfinite(values).sum()), None, unit))
    median = float(np.nanmedian(values))
    if unit == "degC" and KELVIN[0] < median < KELVIN[1]:
        place.refuse_column(
            column,
            f"the median is {median:.6g}, which looks like kelvin; temperatures must be in degC, or their unit stated: "
            '[record] unit = "K", or unit = "K" in its [[sensor]]',
        )
    extreme = (values < COLDEST) | (values > HOTTEST)
    if extreme.any():
        row, count = int(extreme.argmax()), int(extreme.sum())
        if 2 * count > np.isfinite(values).sum():
            place.refuse(
                column,
                row,
                f"found {raw[row]:.6g}, and {count} of {np.isfinite(values).sum()} values are not between {COLDEST:g} "
                f"and {HOTTEST:g} degC; is [record] unit right?",
            )
        notes.note(Noted(column, "impossible", count, int(place.lines[row]), f"{raw[row]:.6g}"), extreme)
        values[extreme] = np.nan
    return values


def unit_of(written: str, name: str = "") -> str | None:
    """The unit of temperature that a text under a column's name says, or else the name itself, in words or degrees."""
    for known, (sure, letter) in _UNITS.items():
        if sure.search(written) or letter.search(written):
            return known
    return next((known for known, (sure, _) in _UNITS.items() if sure.search(name)), None)
