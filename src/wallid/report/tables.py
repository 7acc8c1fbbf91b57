"""Every number of result.json as tables that a person can read: words for keys, units, columns for series."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from .._internal.number_formats import number, quantity, unit

_LONG = 30  # rows: a longer table is closed on the screen, and stays so in print
_WIDE = 6  # columns: a wider table is turned over
_HEAD = ("quantity", "value")
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
    "face_positions": "position errors of the faces' sensors (true place minus stated)",
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
    "reduced_model": "reduced model (errors dimensionless)",
    "eps_inf_u": "largest error, temperature",
    "eps_inf_theta": "largest error, sensitivity",
    "eps_2_u": "root mean square error, temperature",
    "eps_2_theta": "root mean square error, sensitivity",
    "reliability": "whole record against the prediction",
    "rms_prior_K": "rms residual with the prior (K)",
    "rms_K": "rms residual with the estimate (K)",
    "noise_K": "what the stated noise would leave (K)",
    "sigma_K": "uncertainty by noise and position (K)",
    "loads": "heat through the inner face",
    "diffusivity_factor": "diffusivity over the estimate",
    "energy_J_per_m2": "energy (J/m²)",
    "flux_gap": "gap between model and fluxes (root mean square)",
    "after_W_per_m2": "final model (W/m²)",
    "floor_W_per_m2": "what noise alone would leave (W/m²)",
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
    "each": "one by one",
    "alternatives": "cannot be told from",
    "seconds_per_estimate": "time of one estimate (s)",
    "sentence": "in words",
}
_UNITS = {("loads", "conductivity"): "W/m/K", ("history", "diffusivity"): "m²/s", ("places", "m"): "from the left face"}
_SHARED = ("resistance", "resistance_without_stored_heat", "std", "interval_95", "place", "size")
"""What a unit that stands beside several numbers is the unit of."""


@dataclass(frozen=True)
class Table:
    """A table of numbers.

    Args:
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
    plain: list[tuple[str, ...]] = []
    parts: list[Table] = []
    for key, value in result.items():
        if key in _OWN:
            continue
        if isinstance(value, dict | list) and value and not _is_quantity(value):
            parts += _Part(key, value).tables()
        else:
            plain.append((words(key), _said(key, value)))
    return [Table("overview", _HEAD, plain), *parts]


def _said(key: str, value: Any) -> str:
    """A plain value; a verdict that was not asked for says so."""
    return "not asked for (wallid diagnose)" if key == "verdict" and value is None else _cell(value)


class _Part:
    """What a part of result.json becomes: a table of its own numbers, and further ones of what stands in columns."""

    def __init__(self, key: str, value: Any):
        self.title = words(key)
        self.rows: list[tuple[str, ...]] = []
        self.further: list[Table] = []
        self._add(key, "", value)

    def tables(self) -> list[Table]:
        own = [Table(self.title, _HEAD, self.rows)] if self.rows else []
        return [*own, *self.further]

    def _add(self, key: str, name: str, value: Any) -> None:
        """Put a value under its name among the rows, or among the further tables."""
        if (columns := _columns(key, value)) is not None:
            self._stand(name, *columns)
        elif isinstance(value, dict) and not _is_quantity(value):
            self._add_entries(key, name, value)
        elif isinstance(value, list) and any(isinstance(item, dict) for item in value):
            for count, item in enumerate(value, start=1):
                label = str(item.get("label") or item.get("name") or count).replace("_", " ")
                target = f" of {item['target']}" if item.get("target") else ""
                rest = {k: v for k, v in item.items() if k not in ("label", "name", "target")}
                self._add(key, f"{name} {label}{target}".strip(), rest)
        else:
            self.rows.append((name, _cell(value)))

    def _add_entries(self, key: str, name: str, value: dict[str, Any]) -> None:
        """The entries of a dict, those that go side by side as a table."""
        series, names = _series(value), tuple(value.get("parameters", ()))
        if series:
            rows = zip(*(value[one] for one in series), strict=True)
            self._stand(name, tuple(words(one, key) for one in series), [tuple(map(number, row)) for row in rows])
        for one, item in value.items():
            if one in series or one == "unit":
                continue
            if one == "correlations":
                rows = [(own, *(number(x, 2) for x in row)) for own, row in zip(names, item, strict=True)]
                self._stand("correlations of the parameters", ("", *names), rows)
            else:
                self._add(one, f"{name} {_label(one, key, value)}".strip(), item)

    def _stand(self, name: str, head: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
        """A table of its own."""
        self.further.append(Table(f"{self.title}: {name}" if name else self.title, head, rows))


def _is_quantity(value: Any) -> bool:
    return isinstance(value, dict) and {"value", "unit"} <= set(value)


def _cell(value: Any) -> str:
    return quantity(value) if _is_quantity(value) else number(value)


def _label(key: str, part: str, beside: dict[str, Any]) -> str:
    """A key in words, with the unit that stands beside it where it is its own."""
    shared = unit(beside.get("unit") or "-") if key in _SHARED else ""
    return words(key, part) + (f" ({shared})" if shared else "")


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
    if not isinstance(value, dict | list) or not value:
        return None
    named = value if isinstance(value, dict) else {str(count): item for count, item in enumerate(value)}
    parts: list[dict[str, Any]] = [item for item in named.values() if isinstance(item, dict) and not _is_quantity(item)]
    if len(parts) < len(named) or any(list(part) != list(parts[0]) for part in parts):
        return None
    if not all(_plain(item) for part in parts for item in part.values()):
        return None
    shown = [one for one in parts[0] if one != "unit"]
    head = [_label(one, key, parts[0]) for one in shown]
    rows = [[_cell(part[one]) for one in shown] for part in parts]
    if isinstance(value, list):
        return tuple(head), [tuple(row) for row in rows]
    names = [name.replace("_", " ") for name in named]
    whole = [["", *head], *([name, *row] for name, row in zip(names, rows, strict=True))]
    turned = [tuple(row) for row in (zip(*whole, strict=True) if len(head) > _WIDE else whole)]
    return turned[0], turned[1:]


def _plain(value: Any) -> bool:
    """Whether a value fits into one cell."""
    if isinstance(value, dict):
        return _is_quantity(value)
    return not isinstance(value, list) or not any(isinstance(item, dict | list) for item in value)


def words(key: str, part: str = "") -> str:
    """A key of result.json in words, its unit at the end in parentheses.

    Args:
        part: the key that it stands under.
    """
    if part == "effects" and key == "parameters":
        return ""
    if (own := _UNITS.get((part, key))) is not None:
        return f"{key.replace('_', ' ')} ({own})"
    if key in _WORDS and part not in ("parameters", "variance_shares"):  # names there are a person's already
        return _WORDS[key]
    match = re.fullmatch(r"(.*)_(K|J_per_m2|W_per_m2|degC)", key)
    stem, found = match.groups() if match else (key, "")
    shown = {"J_per_m2": "J/m²", "W_per_m2": "W/m²", "degC": "°C"}.get(found, found)
    return stem.replace("_", " ") + (f" ({shown})" if shown else "")
