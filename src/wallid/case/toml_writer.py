"""The text of a new case file, with comments that explain each key."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ..records.file_format import FileFormat

DEFAULT_PRIOR = 5e-7  # m2/s, between brick and stone
DEFAULT_NOISE_STD = 0.1  # K
REGRESSOR_UNITS = {
    "irradiance": "W/m2, on the outer face",
    "air_outdoor": "degC, of the outdoor air",
    "air_indoor": "degC, of the indoor air",
    "wind": "m/s",
    "rain": "mm/h",
    "heating": "0 to 1, or W",
    "flux_left": "W/m2 at the left face, positive along +x",
    "flux_right": "W/m2 at the right face, positive along +x",
}
"""What each regressor of `[record]` is measured in."""
_WIDTH = 30  # characters of a key and its value, before the comment


@dataclass(frozen=True)
class WallAnswers:
    """The user's description of a wall; the dialogue asks for what is None.

    Args:
        length: of the wall, m.
        outside: the face outdoors, "left" or "right".
        conductivity: W/m/K; 0 where it is not known.
        prior: prior diffusivity, m2/s.
    """

    length: float | None = None
    outside: str | None = None
    conductivity: float | None = None
    prior: float = DEFAULT_PRIOR


@dataclass(frozen=True)
class Answers(WallAnswers):
    """The user's description of a wall and its record; the dialogue asks for what is None.

    Args:
        length, outside, conductivity, prior: as in `WallAnswers`.
        time, left, right: columns of the times and of the face temperatures.
        sensors: position of each sensor, m from the left face, by column.
        regressors: other columns by their key in `[record]`, such as "flux_left", "irradiance" or "air_outdoor".
        noise: standard deviation of the sensors' noise, K.
        file_format: what the file itself does not show, such as the order of day and month.
    """

    time: str | None = None
    left: str | None = None
    right: str | None = None
    sensors: Mapping[str, float] | None = None
    regressors: Mapping[str, str] = field(default_factory=dict)
    noise: float | None = None
    file_format: FileFormat = field(default_factory=FileFormat)

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns that have a use."""
        named = (self.time, self.left, self.right, *(self.sensors or ()), *self.regressors.values())
        return tuple(name for name in named if name is not None)

    @property
    def has_channel(self) -> bool:
        """Whether there is a sensor inside the wall or a heat flux, of which a case needs one."""
        return bool(self.sensors) or any(key.startswith("flux_") for key in self.regressors)


def write_toml(
    record_path: str, answers: Answers, units: Mapping[str, str], days: float, *, fault: str | None = None
) -> str:
    """The text of a case file.

    Args:
        record_path: of the record, relative to the folder of the case.
        answers: the user's description of the record.
        units: of sensors whose unit differs from that of the faces.
        days: length of the window.
        fault: why the case cannot be used as it is, for the first lines.
    """
    faults = [] if fault is None else [f"# This case must be corrected first: {' '.join(fault.split())}"]
    lines = [
        *faults,
        f"# Case for `wallid check` and `wallid run`, by `wallid new` for {json.dumps(Path(record_path).name)}.",
        *wall_lines(answers, "initial value", "heat fluxes and loads need it"),
        "",
        "[record]",
        key_line("file", record_path, "relative to the folder of this file"),
        key_line("time", answers.time, "column of times"),
        key_line("left", answers.left, "column of the face at x = 0"),
        key_line("right", answers.right, "column of the face at x = length"),
        *(key_line(key, name, REGRESSOR_UNITS[key]) for key, name in answers.regressors.items()),
        *_unused_regressor_lines(answers),
        *_format_lines(answers.file_format),
        key_line("# boundary_noise_std", 0.1, "K, noise of the face readings; default: smallest of the sensors"),
        key_line("# face_position_std", 0.002, "m, standard deviation of the face sensors' position; default 0"),
        key_line("# longest_gap", 3.0, "hours; shorter gaps of a face are interpolated, longer ones split the record"),
    ]
    noise = DEFAULT_NOISE_STD if answers.noise is None else answers.noise
    for name, position in (answers.sensors or {}).items():
        lines += [
            "",
            "[[sensor]]",
            key_line("name", name, "its column"),
            key_line("position", position, "m from the left face"),
            key_line("noise_std", noise, "K, standard deviation of a reading: see the data sheet"),
            key_line("position_std", 0.005, "m, standard deviation of the position"),
            key_line("offset_std", 0.1, "K, standard deviation of a constant offset; 0 after calibration"),
        ]
        if name in units:
            lines.append(key_line("unit", units[name], "of this column"))
    lines += [
        "",
        "[choices]",
        key_line("window_days", days, "length of the windows that the design compares"),
        key_line("# model", "mim", 'the reduced-order model; "lom": the full-order model'),
        key_line("# order", 10, "of the reduced-order model"),
        "",
    ]
    return "\n".join(lines)


def wall_lines(answers: WallAnswers, prior: str, conductivity: str) -> list[str]:
    """The lines of `[wall]`, with the units of the file above.

    Args:
        answers: the user's description of the wall.
        prior: what the prior diffusivity is, for its comment.
        conductivity: what the conductivity is for, for its comment.
    """
    return [
        "# Temperatures in degC, differences in K, everything else in SI. x = 0 is the left face.",
        "",
        "[wall]",
        key_line("length", answers.length, "m, between the two faces"),
        key_line("diffusivity_prior", answers.prior, f"m2/s, {prior}: brick 5e-7, stone 1e-6, concrete 7e-7"),
        key_line("outside", answers.outside or "left", "the face outdoors"),
        key_line(
            "conductivity" if answers.conductivity else "# conductivity",
            answers.conductivity or 1.0,
            f"W/m/K; {conductivity}",
        ),
    ]


def _unused_regressor_lines(answers: Answers) -> list[str]:
    """The other columns that `diagnose` can use."""
    unused = [key for key in REGRESSOR_UNITS if key not in answers.regressors and not key.startswith("flux_")]
    if not unused:
        return []
    first, *others = unused
    lines = [key_line(f"# {first}", "...", f"column, {REGRESSOR_UNITS[first]}; for diagnose")]
    return [*lines, f"{'#':<{_WIDTH}} # likewise {', '.join(others)}"] if others else lines


def _format_lines(file_format: FileFormat) -> list[str]:
    """The lines for the file format that differ from the default."""
    comments = {
        "separator": "between the columns",
        "decimal": "decimal mark",
        "encoding": "of the file",
        "day_first": "dates begin with the day; false: with the month",
        "timezone": "of the times, daylight saving included",
        "unit": "of every temperature column",
        "step": "s, of the uniform grid",
        "longest_gap": "hours",
    }
    stated = [(key, getattr(file_format, key), comment) for key, comment in comments.items()]
    lines = [key_line(key, value, comment) for key, value, comment in stated if value is not None]
    if file_format.missing:
        lines.append(
            key_line("missing", list(file_format.missing), "mark a missing value, in addition to the common ones")
        )
    if not file_format.clean:
        lines.append(key_line("clean", False, "spikes and stuck readings are kept"))
    if file_format.timezone is None:
        lines.append(key_line("# timezone", "Europe/Berlin", "if the clock follows daylight saving"))
    return lines


def key_line(key: str, value: object, comment: str) -> str:
    """A key, its value and its comment."""
    return f"{f'{key} = {_toml(value)}':<{_WIDTH}} # {comment}"


def _toml(value: object) -> str:
    """A value in TOML notation."""
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
