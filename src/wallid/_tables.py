"""Every number of result.json as tables that a person can read: words for keys, units, columns for series."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from ._numbers import number, quantity, unit

_LONG = 30  # rows: a longer table is closed on the screen, and stays so in print
_WIDE = 6  # columns: a wider table is turned over
_OWN = ("ranked", "untestable")  # have tables of their own on the page

_WORDS = {
    "schema": "version of result.json's format",
    "command": "made by",
    "case": "case",
    "verdict": "verdict on missing effects",
    "diffusivity_before": "diffusivity by the plain model",
    "iterations": "Gauss-Newton steps",
    "model_shift": "shift of the estimate by the reduced model's error, relative",
    "reason": "why there is no number to rely on",
    "gap": "gap between model and readings (root mean square)",
    "before_K": "plain model (K)",
    "after_K": "final model (K)",
    "floor_K": "what noise alone would leave (K)",
    "held_out_before_K": "days held out, plain model (K)",
    "held_out_after_K": "days held out, final model (K)",
    "eps_2_K": "root mean square of its fit (K)",
    "coefficients_degC": "coefficients of powers of x/L (°C)",
    "positions": "position errors (true place minus stated)",
    "offsets": "sensor offsets (reading minus truth)",
    "interval": "how the interval was found",
    "variance_shares": "share of the variance from",
    "history": "convergence of the estimate, step by step",
    "gamma_1": "change of the cost, relative",
    "gamma_2": "change of the diffusivity, relative",
    "starts": "criterion by start day",
    "design": "design: which days tell most",
    "diffusivities": "at diffusivities (m²/s)",
    "expected_relative_std": "expected standard error, relative",
    "lengths": "what a longer window gives and costs",
    "seconds": "seconds taken",
    "orders": "error of the reduced model by order (dimensionless)",
    "eps_inf_u": "largest error, temperature (dimensionless)",
    "eps_inf_theta": "largest error, sensitivity (dimensionless)",
    "eps_2_u": "root mean square error, temperature (dimensionless)",
    "eps_2_theta": "root mean square error, sensitivity (dimensionless)",
    "reliability": "whole record against the prediction",
    "rms_prior_K": "rms residual with the prior (K)",
    "rms_K": "rms residual with the estimate (K)",
    "noise_K": "what the stated noise would leave (K)",
    "sigma_K": "uncertainty by noise and position (K)",
    "loads": "heat through the inner face",
    "diffusivity_factor": "diffusivity over the estimate",
    "energy_J_per_m2": "energy (J/m²)",
    "plate_gains": "calibration errors of the flux plates (relative)",
    "iso_9869": "average method (ISO 9869-1)",
    "p_value": "p-value",
    "step_s": "step (s)",
    "rms_W_per_m2": "root mean square (W/m²)",
    "coverage_95": "share within the 95 % interval",
    "effects": "effects named",
    "expected_gain": "expected drop of −2 log L",
    "gain": "drop of −2 log L",
    "noise": "noise",
    "over_stated": "size over the stated",
    "lasting_share": "share of variance that lasts from row to row",
    "correlation": "correlation from row to row",
    "left_over": "omnibus test of what is left",
    "p_before": "p-value, plain model",
    "p_after": "p-value, final model",
    "smallest": "smallest size that would have shown",
    "read_as": "read as",
    "done": "done while reading",
    "parts": "unbroken parts",
    "end": "end (the row after the last)",
    "missing": "readings missing",
    "alternatives": "cannot be told from",
    "conductivity_stated": "conductivity, as stated (W/m/K)",
}
_UNITS = {("loads", "conductivity"): "W/m/K", ("windows", "days"): "days", ("lengths", "days"): "days"}
_UNITS |= {("starts", "day"): "days after the record's start", ("history", "diffusivity"): "m²/s"}
_UNITS |= {("lengths", "seconds_per_estimate"): "s", ("places", "m"): "from the left face"}
_SHARED = ("resistance", "resistance_without_stored_heat", "std", "interval_95", "place", "size")
"""What a unit that stands beside several numbers is the unit of."""


@dataclass(frozen=True)
class Table:
    """A table of numbers.

    Arguments:
        title: what it is of.
        head: of its columns.
        rows: cells, the first of each names the row.
    """

    title: str
    head: tuple[str, ...]
    rows: list[tuple[str, ...]]

    @property
    def long(self) -> bool:
        """Whether it is closed until asked for."""
        return len(self.rows) > _LONG


def tables(result: dict[str, Any]) -> list[Table]:
    """Every number of result.json: one table of what has no parts, and those of each of its parts."""
    plain: list[tuple[str, str]] = []
    parts: list[Table] = []
    for key, value in result.items():
        if key in _OWN:
            continue
        if not isinstance(value, dict | list) or value == []:
            plain.append((words(key), _said(key, value)))
        elif isinstance(value, dict) and {"value", "unit"} <= set(value):
            plain.append((words(key), quantity(value)))
        else:
            parts += _of_part(key, words(key), value)
    return [Table("overview", ("quantity", "value"), [*plain]), *parts]


def _said(key: str, value: Any) -> str:
    """A plain value; a verdict that was not asked for says so."""
    return "not asked for (wallid diagnose)" if key == "verdict" and value is None else number(value)


def _of_part(key: str, title: str, value: Any) -> Iterator[Table]:
    """The tables of a part: its own numbers, then what is better read in columns."""
    rows: list[tuple[str, str]] = []
    further: list[Table] = []
    _collect(key, title, "", value, rows, further)
    if rows:
        yield Table(title, ("quantity", "value"), [*rows])
    yield from further


def _collect(key: str, title: str, name: str, value: Any, rows: list[tuple[str, str]], further: list[Table]) -> None:
    """Put a value among the rows under its name, or among the further tables."""
    if isinstance(value, dict) and {"value", "unit"} <= set(value):
        rows.append((name, quantity(value)))
    elif (columns := _columns(key, value)) is not None:
        further.append(Table(f"{title}: {name}" if name else title, *columns))
    elif isinstance(value, dict):
        shared = value.get("unit")
        series = _series(value)
        if series:
            head = tuple(words(one, key) for one in series)
            cells = [tuple(number(item) for item in row) for row in zip(*(value[one] for one in series), strict=True)]
            further.append(Table(f"{title}: {name}" if name else title, head, [*cells]))
        for one, item in value.items():
            if one in series or (one == "unit" and shared is not None):
                continue
            label = words(one, key) + (f" ({unit(shared)})" if shared and one in _SHARED and unit(shared) else "")
            if one == "p_value" and sum(size is not None for size in value.get("size", (0, 0))) < 2:
                item = None  # what one window alone tells is the same as nothing else
            if one == "correlations" and "parameters" in value:
                names = tuple(value["parameters"])
                cells = [(own, *(number(x, 2) for x in row)) for own, row in zip(names, item, strict=True)]
                further.append(Table("correlations of the parameters", ("", *names), [*cells]))
            else:
                _collect(one, title, f"{name} {label}".strip(), item, rows, further)
    elif isinstance(value, list) and any(isinstance(item, dict) for item in value):
        for count, item in enumerate(value, start=1):
            label = str(item.get("label") or item.get("name") or count).replace("_", " ")
            target = f" of {item['target']}" if item.get("target") else ""
            rest = {k: v for k, v in item.items() if k not in ("label", "name", "target")}
            _collect(key, title, f"{name} {label}{target}".strip(), rest, rows, further)
    else:
        rows.append((name, number(value)))


def _series(value: dict[str, Any]) -> list[str]:
    """The keys of a dict whose lists of numbers go side by side, as long as each other; none where fewer than two."""
    lists = {
        one: len(item)
        for one, item in value.items()
        if isinstance(item, list) and len(item) > 1 and all(isinstance(x, int | float | str | None) for x in item)
    }
    size = max(lists.values(), default=0)
    found = [one for one, count in lists.items() if count == size and one not in ("interval_95", "parameters")]
    return found if len(found) > 1 else []


def _columns(key: str, value: Any) -> tuple[tuple[str, ...], list[tuple[str, ...]]] | None:
    """Head and rows of what is a table already: parts that all have the same plain entries."""
    if isinstance(value, list) and len(value) > 0:
        named = [("", item) for item in value]
    elif isinstance(value, dict) and len(value) > 0:
        named = [(name.replace("_", " "), item) for name, item in value.items()]
    else:
        return None
    if not all(isinstance(item, dict) and "value" not in item for _, item in named):
        return None
    keys = list(named[0][1])
    if any(list(item) != keys or not all(_plain(x) for x in item.values()) for _, item in named):
        return None
    shared = named[0][1].get("unit")
    shown = [one for one in keys if one != "unit"]
    head = [words(one, key) + (f" ({unit(shared)})" if shared and one in _SHARED else "") for one in shown]
    rows = [tuple(quantity(x) if isinstance(x, dict) else number(x) for x in map(item.get, shown)) for _, item in named]
    if isinstance(value, dict) and len(head) > _WIDE:
        return ("", *(name for name, _ in named)), [*zip(head, *rows, strict=True)]
    if isinstance(value, dict):
        return ("", *head), [(name, *cells) for (name, _), cells in zip(named, rows, strict=True)]
    return tuple(head), [*rows]


def _plain(value: Any) -> bool:
    """Whether a value fits into one cell."""
    if isinstance(value, dict):
        return {"value", "unit"} <= set(value)
    return not isinstance(value, list) or not any(isinstance(item, dict | list) for item in value)


def words(key: str, part: str = "") -> str:
    """A key of result.json in words, its unit at the end in parentheses.

    Arguments:
        part: the key that it stands under.
    """
    if part == "effects" and key == "parameters":
        return ""
    if (own := _UNITS.get((part, key))) is not None:
        return f"{key.replace('_', ' ')} ({own})"
    if key in _WORDS and part != "parameters":  # an effect's own names mean other things
        return _WORDS[key]
    match = re.fullmatch(r"(.*)_(K|J_per_m2|W_per_m2|degC)", key)
    stem, found = match.groups() if match else (key, "")
    shown = {"J_per_m2": "J/m²", "W_per_m2": "W/m²", "degC": "°C"}.get(found, found)
    return stem.replace("_", " ") + (f" ({shown})" if shown else "")
