"""The text of a new case, with what may be changed in its comments."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ..records.file_format import Format

PRIOR = 5e-7  # m2/s: between brick and stone
NOISE = 0.1  # K
_WIDTH = 30  # of a key and its value, before the comment


@dataclass(frozen=True)
class Answers:
    """What a person says of a record; None is asked for.

    Args:
        time, left, right: columns.
        length: m.
        sensors: position of each, m from the left face, by column.
        fluxes: column by "flux_left" and "flux_right".
        outside: "left" or "right".
        prior: m2/s. noise: K.
        form: how the file is written, as far as it does not show.
    """

    time: str | None = None
    left: str | None = None
    right: str | None = None
    length: float | None = None
    sensors: Mapping[str, float] | None = None
    fluxes: Mapping[str, str] = field(default_factory=dict)
    outside: str | None = None
    prior: float = PRIOR
    noise: float = NOISE
    form: Format = field(default_factory=Format)


def write_toml(where: str, answers: Answers, units: Mapping[str, str], days: float) -> str:
    """The text of a case.

    Args:
        where: the record, from the case's folder.
        units: of sensors that are not in the format's.
        days: of the window.
    """
    lines = [
        f"# A case for `wallid check` and `wallid run`, begun by `wallid new` from {json.dumps(Path(where).name)}.",
        "# Temperatures in degC, differences in K, everything else in SI. x = 0 is the left face.",
        "",
        "[wall]",
        _line("length", answers.length, "m, between the two faces"),
        _line("diffusivity_prior", answers.prior, "m2/s, a start: brick 5e-7, stone 1e-6, concrete 7e-7"),
        _line("outside", answers.outside or "left", "which face is outdoors"),
        _line("# conductivity", 1.0, "W/m/K; heat fluxes and loads need it"),
        "",
        "[record]",
        _line("file", where, "from this file's folder"),
        _line("time", answers.time, "column of times"),
        _line("left", answers.left, "column of the face at x = 0"),
        _line("right", answers.right, "column of the face at x = length"),
        *(_line(key, name, "W/m2, positive along +x") for key, name in answers.fluxes.items()),
        _line("# irradiance", "...", "column, W/m2 on the outer face; for diagnose, as are"),
        f"{'#':<{_WIDTH}} # air_outdoor, air_indoor (degC), wind (m/s), rain (mm/h), heating",
        *_format_lines(answers.form),
        _line("# boundary_noise_std", 0.1, "K, of the faces' readings; default: the sensors' smallest"),
        _line("# face_position_std", 0.002, "m, how well the faces' sensors are in their places; default 0"),
        _line("# longest_gap", 3.0, "hours; a face is interpolated across less, the record split at more"),
    ]
    for name, position in (answers.sensors or {}).items():
        lines += [
            "",
            "[[sensor]]",
            _line("name", name, "its column"),
            _line("position", position, "m from the left face"),
            _line("noise_std", answers.noise, "K, scatter of a reading: see the sensor's data sheet"),
            _line("position_std", 0.005, "m, how well its place is known"),
            _line("offset_std", 0.1, "K, constant error between sensors; 0 where they were compared"),
        ]
        if name in units:
            lines.append(_line("unit", units[name], "of this column"))
    lines += [
        "",
        "[choices]",
        _line("window_days", days, "length of the window that the design looks for"),
        _line("# model", "mim", 'the reduced model; "lom": the large one'),
        _line("# order", 10, "of the reduced model"),
        "",
    ]
    return "\n".join(lines)


def _format_lines(form: Format) -> list[str]:
    """The keys of a format that do not show in the file."""
    words = {
        "separator": "between the columns",
        "decimal": "mark of decimals",
        "encoding": "of the file",
        "day_first": "dates begin with the day; false: with the month",
        "timezone": "whose wall clock the times are, daylight saving included",
        "unit": "of every temperature column",
        "step": "s, of the grid that the readings are put on",
        "longest_gap": "hours",
    }
    stated = [(key, getattr(form, key), comment) for key, comment in words.items()]
    lines = [_line(key, value, comment) for key, value, comment in stated if value is not None]
    if form.missing:
        lines.append(_line("missing", list(form.missing), "stand for a missing value, beside the common ones"))
    if not form.clean:
        lines.append(_line("clean", False, "spikes and stuck readings stay"))
    if form.timezone is None:
        lines.append(_line("# timezone", "Europe/Berlin", "where the clock follows daylight saving"))
    return lines


def _line(key: str, value: object, comment: str) -> str:
    """A key, its value and its comment."""
    return f"{f'{key} = {_toml(value)}':<{_WIDTH}} # {comment}"


def _toml(value: object) -> str:
    """A value as TOML writes it."""
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
