"""Tables of every number of result.json, with names and units instead of keys."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from .._internal.number_formats import format_number, format_quantity, format_unit

_LONG = 30  # rows; a longer table is closed until a reader opens it
_WIDE = 6  # columns; a wider table is transposed
_HEAD = ("quantity", "value")
_SHOWN_ELSEWHERE = ("ranked", "untestable", "files")  # the template has its own tables for these keys

_NAMES = {
    "schema": "version of result.json's format",
    "command": "command",
    "case": "case",
    "verdict": "verdict on missing effects",
    "diffusivity_before": "diffusivity, plain model",
    "iterations": "Gauss-Newton steps",
    "model_shift": "shift of the estimate by the error of the reduced-order model, relative",
    "reason": "why there is no reliable value",
    "gap": "residual at the inner sensors (root mean square)",
    "before_K": "plain model (K)",
    "after_K": "final model (K)",
    "floor_K": "expected from noise alone (K)",
    "held_out_before_K": "on days left out of the fit, plain model (K)",
    "held_out_after_K": "on days left out of the fit, final model (K)",
    "eps_2_K": "residual of its fit, root mean square (K)",
    "coefficients_degC": "coefficients of powers of x/L (°C)",
    "positions": "position errors (true position minus stated)",
    "face_positions": "position errors of the face sensors (true position minus stated)",
    "offsets": "sensor offsets (reading minus truth)",
    "interval": "method of the interval",
    "variance_shares": "share of the variance:",
    "history": "convergence of the estimate, step by step",
    "gamma_1": "change of the cost, relative",
    "gamma_2": "change of the diffusivity, relative",
    "starts": "criterion by start day",
    "design": "experiment design",
    "diffusivities": "at diffusivities (m²/s)",
    "expected_relative_std": "expected standard error of the diffusivity, relative",
    "expected_relative_std_of_resistance": "expected standard error of the resistance, relative",
    "lengths": "criterion and computing time by window length",
    "seconds": "computing time (s)",
    "orders": "error of the reduced-order model by order (dimensionless)",
    "reduced_model": "reduced-order model (errors dimensionless)",
    "eps_inf_u": "largest error, temperature",
    "eps_inf_theta": "largest error, sensitivity",
    "eps_2_u": "root mean square error, temperature",
    "eps_2_theta": "root mean square error, sensitivity",
    "reliability": "prediction over the entire record",
    "rms_prior_K": "rms residual with the prior (K)",
    "rms_K": "rms residual with the estimate (K)",
    "noise_K": "expected from the stated noise alone (K)",
    "sigma_K": "standard uncertainty from noise and position (K)",
    "loads": "heat load through the inner face",
    "diffusivity_factor": "diffusivity over the estimate",
    "energy_J_per_m2": "energy (J/m²)",
    "flux_gap": "residual of the fluxes (root mean square)",
    "after_W_per_m2": "final model (W/m²)",
    "floor_W_per_m2": "expected from noise alone (W/m²)",
    "plate_gains": "calibration errors of the flux plates (relative)",
    "mean_residuals_W_per_m2": "mean of measured minus simulated flux (W/m²)",
    "resistance_shares": "share of the resistance's variance",
    "iso_9869": "average method (ISO 9869-1)",
    "averaged_days": "whole days averaged",
    "unmet_rules": "stopping rules not met",
    "p_value": "p-value",
    "time_constant": "time constant (s)",
    "step_s": "step (s)",
    "rms_W_per_m2": "root mean square (W/m²)",
    "coverage_95": "share within the 95 % interval",
    "effects": "identified effects",
    "expected_gain": "expected gain (decrease of −2 log L)",
    "gain": "gain (decrease of −2 log L)",
    "noise": "noise",
    "over_stated": "standard deviation over the stated one",
    "lasting_share": "autocorrelated share of the variance",
    "correlation": "correlation between consecutive rows",
    "left_over": "omnibus test of the residual",
    "p_before": "p-value, plain model",
    "p_after": "p-value, final model",
    "smallest": "smallest detectable size of each effect",
    "read_as": "format of the file",
    "done": "cleaning steps",
    "parts": "unbroken parts",
    "end": "end (the row after the last)",
    "missing": "readings missing",
    "each": "single windows",
    "alternatives": "rival effects (indistinguishable)",
    "seconds_per_estimate": "computing time of an estimate (s)",
    "sentence": "summary",
    "structure": "further wall parameters",
    "collinearity": "collinearity index of parameter sets (above 10: not identifiable together)",
}
_UNITS = {("loads", "conductivity"): "W/m/K", ("history", "diffusivity"): "m²/s", ("places", "m"): "from the left face"}
_SHARED = ("resistance", "resistance_without_stored_heat", "std", "interval_95", "place", "size")
"""Keys to which the unit of their dict applies."""
_OF_NAMES = ("parameters", "variance_shares", "resistance_shares")
"""Entries that contain names, not keys."""


@dataclass(frozen=True)
class Table:
    """A table of numbers.

    Args:
        title: of the table.
        head: names of the columns.
        rows: cells; the first of each row is its name.
    """

    title: str
    head: tuple[str, ...]
    rows: list[tuple[str, ...]]

    @property
    def long(self) -> bool:
        """Whether the table is closed until a reader opens it."""
        return len(self.rows) > _LONG


def number_tables(result: dict[str, Any], diffusivity: str = "") -> list[Table]:
    """Tables of every number of result.json.

    Args:
        result: contents of result.json.
        diffusivity: name of the final diffusivity, which states its data and model.

    Returns:
        A table of the plain entries, then the tables of each nested entry.
    """
    plain: list[tuple[str, ...]] = []
    parts: list[Table] = []
    for key, value in result.items():
        if key in _SHOWN_ELSEWHERE:
            continue
        if isinstance(value, dict | list) and value and not _is_quantity(value):
            parts += _Part(key, value).tables()
        elif key == "verdict" and value is None:
            plain.append((key_as_text(key), "not requested (wallid diagnose)"))
        else:
            name = diffusivity if key == "diffusivity" and diffusivity else key_as_text(key)
            plain.append((name, _cell(value)))
    return [Table("overview", _HEAD, plain), *parts]


class _Part:
    """The tables of a nested entry of result.json: one of its single values, and one for each of its series."""

    def __init__(self, key: str, value: Any):
        self.title = key_as_text(key)
        self.rows: list[tuple[str, ...]] = []
        self.further: list[Table] = []
        self._add(key, "", value)

    def tables(self) -> list[Table]:
        own = [Table(self.title, _HEAD, self.rows)] if self.rows else []
        return [*own, *self.further]

    def _add(self, key: str, name: str, value: Any) -> None:
        """Add a value to the rows, or as further tables."""
        if (columns := _columns(key, value)) is not None:
            self._add_table(name, *columns)
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
        """Add the entries of a dict; series of equal length become the columns of one table."""
        series, names = _series(value), tuple(value.get("parameters", ()))
        if series:
            rows = zip(*(value[one] for one in series), strict=True)
            self._add_table(
                name, tuple(key_as_text(one, key) for one in series), [tuple(map(format_number, row)) for row in rows]
            )
        for one, item in value.items():
            if one in series or one == "unit":
                continue
            if one == "correlations":
                rows = [(own, *(format_number(x, 2) for x in row)) for own, row in zip(names, item, strict=True)]
                self._add_table("correlations of the parameters", ("", *names), rows)
            else:
                self._add(one, f"{name} {_label(one, key, value)}".strip(), item)

    def _add_table(self, name: str, head: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
        """Add a further table."""
        self.further.append(Table(f"{self.title}: {name}" if name else self.title, head, rows))


def _is_quantity(value: Any) -> bool:
    return isinstance(value, dict) and {"value", "unit"} <= set(value)


def _cell(value: Any) -> str:
    return format_quantity(value) if _is_quantity(value) else format_number(value)


def _label(key: str, part: str, entries: dict[str, Any]) -> str:
    """Name of a key, with the unit of its dict where that unit applies to it."""
    has_unit = key in _SHARED and not isinstance(entries.get(key), str)
    shared = format_unit(entries.get("unit") or "-") if has_unit else ""
    return key_as_text(key, part) + (f" ({shared})" if shared else "")


def _series(value: dict[str, Any]) -> list[str]:
    """Keys of a dict whose lists of numbers are equally long; none where there are fewer than two."""
    lists = {
        one: len(item)
        for one, item in value.items()
        if isinstance(item, list) and len(item) > 1 and all(isinstance(x, int | float | str | None) for x in item)
    }
    size = max(lists.values(), default=0)
    keys = [one for one, count in lists.items() if count == size and one not in ("interval_95", "parameters")]
    return keys if len(keys) > 1 else []


def _columns(key: str, value: Any) -> tuple[tuple[str, ...], list[tuple[str, ...]]] | None:
    """Head and rows of an entry whose parts all have the same plain entries; None for any other entry."""
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
    table = [["", *head], *([name, *row] for name, row in zip(names, rows, strict=True))]
    oriented = [tuple(row) for row in (zip(*table, strict=True) if len(head) > _WIDE else table)]
    return oriented[0], oriented[1:]


def _plain(value: Any) -> bool:
    """Whether a value fits into one cell."""
    if isinstance(value, dict):
        return _is_quantity(value)
    return not isinstance(value, list) or not any(isinstance(item, dict | list) for item in value)


def key_as_text(key: str, part: str = "") -> str:
    """Name of a key of result.json, with its unit in parentheses.

    Args:
        part: key of the entry that contains it.
    """
    if part == "effects" and key == "parameters":
        return ""
    if (own := _UNITS.get((part, key))) is not None:
        return f"{key.replace('_', ' ')} ({own})"
    if key in _NAMES and part not in _OF_NAMES:
        return _NAMES[key]
    match = re.fullmatch(r"(.*)_(K|J_per_m2|W_per_m2|degC)", key)
    stem, unit = match.groups() if match else (key, "")
    shown = {"J_per_m2": "J/m²", "W_per_m2": "W/m²", "degC": "°C"}.get(unit, unit)
    return stem.replace("_", " ") + (f" ({shown})" if shown else "")
