"""Result objects as HTML tables for notebooks."""

from __future__ import annotations

import math
from collections.abc import Iterable
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from pandas import DataFrame

Row = tuple[str, str, str, str]


def interval_row(name: str, quantity: Any) -> Row:
    """The row of a quantity with `value`, `interval_95` and `unit`."""
    low, high = quantity.interval_95
    interval = "–" if math.isnan(low) or math.isnan(high) else f"{low:.4g} to {high:.4g}"
    return name, _cell(float(quantity.value)), interval, quantity.unit


def html_table(title: str, rows: Iterable[Row]) -> str:
    """A table with a title and rows of name, value, uncertainty and unit; all text is escaped."""
    header = "".join(f"<th>{text}</th>" for text in ("", "value", "uncertainty", "unit"))
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><caption>{escape(title)}</caption><tr>{header}</tr>{body}</table>"


def html_text(text: str) -> str:
    """A paragraph of escaped text."""
    return f"<p>{escape(text)}</p>"


def html_frame(title: str, frame: DataFrame, *, most_rows: int = 20) -> str:
    """A DataFrame as a table with a title; all text is escaped.

    Args:
        title: above the table.
        frame: its index is the first column, unless it only counts the rows.
        most_rows: of the table; a last line says how many more there are.
    """
    counted = frame.index.name is None and frame.index.dtype.kind == "i"
    shown = frame.head(most_rows)
    names = [*([] if counted else [frame.index.name or ""]), *(_column_name(name) for name in frame.columns)]
    labels = [[] if counted else [label] for label in shown.index]
    cells = [label + list(row) for label, row in zip(labels, shown.itertuples(index=False, name=None), strict=True)]
    header = "".join(f"<th>{escape(str(name))}</th>" for name in names)
    body = "".join("<tr>" + "".join(f"<td>{escape(_cell(cell))}</td>" for cell in row) + "</tr>" for row in cells)
    if (more := len(frame) - len(shown)) > 0:
        body += f'<tr><td colspan="{len(names)}">and {more} more rows: to_frame() has all</td></tr>'
    return f"<table><caption>{escape(title)}</caption><tr>{header}</tr>{body}</table>"


def _column_name(name: Any) -> str:
    return " ".join(str(part) for part in (name if isinstance(name, tuple) else (name,))).replace("_", " ")


def _cell(value: Any) -> str:
    """A cell as text: four digits of a number, a dash for a missing value."""
    if value is None or str(value) in ("nan", "<NA>", "NaT"):
        return "–"
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list | tuple):
        return ", ".join(_cell(item) for item in value)
    return str(value)
