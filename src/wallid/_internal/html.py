"""Result objects as HTML tables for notebooks."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from typing import Any

Row = tuple[str, str, str, str]


def interval_row(name: str, quantity: Any) -> Row:
    """The row of a quantity with `value`, `interval_95` and `unit`."""
    low, high = quantity.interval_95
    return name, f"{quantity.value:.4g}", f"{low:.4g} to {high:.4g}", quantity.unit


def html_table(title: str, rows: Iterable[Row]) -> str:
    """A table with a title and rows of name, value, uncertainty and unit; all text is escaped."""
    header = "".join(f"<th>{text}</th>" for text in ("", "value", "uncertainty", "unit"))
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><caption>{escape(title)}</caption><tr>{header}</tr>{body}</table>"
