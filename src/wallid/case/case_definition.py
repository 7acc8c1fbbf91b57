"""A case: the wall, its sensors, the record and the options, checked against each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, no_type_check

import numpy as np

from .._internal.errors import InputError
from .._internal.html import Row, html_table
from .._internal.result_object import ResultObject, plain_value
from .._internal.validation import error_context, number, number_tuple, set_fields, spelling_hint
from ..records.dataframe_table import with_time_column
from ..records.reading_pipeline import PLATES
from ..records.uniform_record import Record
from .case_tables import RECORD_OPTIONS, parse_choices, parse_record, parse_sensors, parse_wall, sensor_tables
from .options import Choices, check_choices
from .planned_campaign import CampaignSettings, PlannedCampaign, first_or_typical
from .section.section_definition import Section
from .section.section_tables import check_heights
from .wall_and_sensors import Sensor, Wall, check_sensors

if TYPE_CHECKING:
    from pandas import DataFrame

_LEARNING_FACTORS = (0.25, 1.0, 4.0, 16.0)  # times the prior, which may be wrong by a factor of several


@no_type_check
@dataclass(frozen=True, eq=False)
class LearningSignal:
    """A training signal: one simulation of the full-order model from which the reduced-order model is learned.

    Args:
        diffusivity: m2/s.
        time: s from the first row, at a uniform step, (time,).
        faces: left and right face temperature, degC, (time, 2).
        coefficients: of the initial profile `sum_k a_k (x/L)^k`, degC.

    Raises:
        InputError: the diffusivity is not above 0, or a coefficient is not a number.
    """

    diffusivity: float
    time: np.ndarray = field(repr=False)
    faces: np.ndarray = field(repr=False)
    coefficients: tuple[float, ...]

    def __post_init__(self) -> None:
        set_fields(
            self,
            diffusivity=number("diffusivity", self.diffusivity, "m2/s", above=0.0),
            coefficients=number_tuple("initial_coefficients", self.coefficients, "degC"),
        )


@dataclass(frozen=True)
class Case(ResultObject):
    """A wall, the record of its temperatures, and the options of the method.

    `load` reads a case from a TOML file, `Case.from_dataframe` takes a DataFrame. All that the file can state can also
    be stated in Python:

    | in the file | in Python |
    |---|---|
    | `[wall]`, `[[wall.layer]]` | `Wall`, with `layers` a sequence of `Layer` |
    | `[record]`: columns | arguments of `from_dataframe` or of `read_record` |
    | `[record]`: standard deviations | fields of `Record`; keyword arguments of `from_dataframe` and `read_record` |
    | `[record]`: file format | `records.FileFormat`; keyword arguments of `from_dataframe` |
    | `[[sensor]]` | `Sensor` |
    | `[choices]` | `case.Choices`; keyword arguments of `from_dataframe` |
    | `[learning]`, `[[learning.signal]]` | a sequence of `case.LearningSignal` |
    | `[case]` | `name`, `description` |

    Args:
        name: title in tables and reports.
        path: of the TOML file, for messages.
        wall: the wall.
        sensors: one per sensor inside the wall, in the order of the record's columns.
        record: the logged temperatures and regressors.
        choices: the options; `learning_diffusivities` of None follow from the wall's prior.
        learning: training signals to use instead of those derived from the record; may be empty.
        description: one line.
        plan: where the wall stands and its typical weather, where the case states it.
        section: through the wall, where it is not the same at all heights.

    Raises:
        InputError: the parts do not fit each other.
    """

    name: str
    path: Path
    wall: Wall
    sensors: tuple[Sensor, ...]
    record: Record
    choices: Choices = field(default_factory=Choices)
    learning: tuple[LearningSignal, ...] = ()
    description: str = ""
    plan: CampaignSettings | None = field(default=None, repr=False)
    section: Section | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        set_fields(self, sensors=tuple(self.sensors), learning=tuple(self.learning))
        check_sensors(self.wall, self.sensors, self.section is not None)
        check_heights(self.section, self.sensors)
        self._check_section()
        names = tuple(sensor.name for sensor in self.sensors)
        if self.record.names != names:
            in_record, in_case = (", ".join(group) or "none" for group in (self.record.names, names))
            raise InputError(f"the record's sensors are {in_record}; they must be the case's, {in_case}")
        if not self.sensors and not self.record.regressors.keys() & set(PLATES):
            raise InputError("no [[sensor]] and no flux; at least one sensor, flux_left or flux_right is needed")
        with error_context("[choices]"):
            check_choices(self.choices, self.record)
            self._check_free()
        if self.choices.learning_diffusivities is None:
            diffusivities = tuple(factor * self.wall.diffusivity_prior for factor in _LEARNING_FACTORS)
            set_fields(self, choices=replace(self.choices, learning_diffusivities=diffusivities))

    def in_one_dimension(self) -> Case:
        """The same case with a homogeneous wall in place of its section."""
        sensors = tuple(replace(sensor, height=None, height_std=0.0) for sensor in self.sensors)
        return replace(self, section=None, sensors=sensors, choices=replace(self.choices, free=()))

    def _check_section(self) -> None:
        """Refuse what the model of a section does not have."""
        if self.section is None:
            return
        if abs(self.section.length - self.wall.length) > 1e-9 * self.wall.length:
            raise InputError(
                f"the section is {self.section.length:g} m long; it must be the wall's {self.wall.length:g} m"
            )
        if self.wall.layers:
            raise InputError("the wall has layers, and there is a section; the section says what is where")
        low, high = self.section.conductivity_bounds
        if self.wall.conductivity is not None and not 0.999 * low <= self.wall.conductivity <= 1.001 * high:
            raise InputError(
                f"[wall] conductivity = {self.wall.conductivity:g} W/m/K; with these materials it must lie between "
                f"{low:.4g} and {high:.4g}; leave it out, the section says it"
            )

    def _check_free(self) -> None:
        """Refuse free parameters that the wall does not have."""
        free = self.choices.free
        if self.section is None:
            if "layers" in free and len(self.wall.layers) < 2:
                raise InputError('free = "layers": the wall has no layers; state two [[wall.layer]] at least')
            if "materials" in free:
                raise InputError('free = "materials": the case has no [section]; for layers take free = "layers"')
        elif others := [name for name in free if name != "materials"]:
            raise InputError(f'free = "{others[0]}": a case with a [section] estimates no layers or films')
        elif free and not any(material.uncertainty for material in self.section.materials):
            raise InputError('free = "materials": every material has uncertainty = 0, so that none is estimated')

    @classmethod
    def from_dataframe(
        cls,
        data: DataFrame,
        *,
        left: str,
        right: str,
        time: str | None = None,
        wall: Wall | None = None,
        length: float | None = None,
        diffusivity_prior: float | None = None,
        sensors: Mapping[str, float] | Sequence[Sensor] = (),
        noise_std: float | None = None,
        regressors: Mapping[str, str] | None = None,
        section: Section | None = None,
        learning: Sequence[LearningSignal] = (),
        name: str = "DataFrame",
        description: str = "",
        **options: Any,
    ) -> Case:
        """A case from a pandas DataFrame, with the same checks and messages as a case from a file.

            case = Case.from_dataframe(
                data, left="T_left", right="T_right", length=0.43, diffusivity_prior=5e-7,
                sensors={"T1": 0.05, "T2": 0.3}, noise_std=0.05, window_days=2.0,
            )

        Messages count lines as in the file that `data.to_csv` writes: the first row is line 2.

        Args:
            data: the readings, degC, one row for each time.
            left, right: columns of the face temperatures at x = 0 and x = length.
            time: the column of times (datetimes, ISO 8601 or s); None for the index.
            wall: the wall; or None, with `length` (m) and `diffusivity_prior` (m2/s).
            sensors: position (m from the left face) by column, or a sequence of `Sensor`.
            noise_std: K, of the readings of sensors that are given by position.
            regressors: the column for each regressor, such as {"flux_left": "q1"}.
            section: through the wall, where it is not the same at all heights.
            learning, name, description: as in `Case`.
            options: any option of `[record]` (`boundary_noise_std`, `face_position_std`, `flux_noise_std`,
                `flux_gain_std`, or a field of `FileFormat` such as `unit` or `timezone`) or of `[choices]`.

        Raises:
            InputError: a value, a column or an option is missing or invalid.
        """
        if wall is None:
            values = {"length": length, "diffusivity_prior": diffusivity_prior}
            prior = None if section is None else section.diffusivity_prior
            wall = parse_wall({key: value for key, value in values.items() if value is not None}, prior)
        elif length is not None or diffusivity_prior is not None:
            raise InputError("wall is given; length and diffusivity_prior must then be left out")
        if isinstance(sensors, Mapping):
            sensors = parse_sensors(sensor_tables(sensors, noise_std))
        elif noise_std is not None:
            raise InputError("noise_std is for sensors given as {column: position}; each Sensor has its own")
        check_sensors(wall, sensors, section is not None)
        known = (*RECORD_OPTIONS, *(one.name for one in fields(Choices)))
        for key in options:
            if key not in known:
                hint = spelling_hint(key, known) or f"; known are {', '.join(known)}"
                raise InputError(f'unknown option "{key}"{hint}')
        choices = parse_choices({k: value for k, value in options.items() if k not in RECORD_OPTIONS}, sensors)
        data, time = with_time_column(data, time)
        stated = {key: value for key, value in options.items() if key in RECORD_OPTIONS}
        table = parse_record({**(regressors or {}), **stated, "time": time, "left": left, "right": right})
        record = table.with_noise(table.read(data, sensors), sensors)
        path = Path(record.file)
        return cls(name, path, wall, tuple(sensors), record, choices, tuple(learning), description, section=section)

    @property
    def planned_campaign(self) -> PlannedCampaign:
        """The wall and its `plan`, without the record.

        Raises:
            InputError: the case has no plan.
        """
        if self.plan is None:
            raise InputError(f"{self.path}: has no [plan]")
        sensor = first_or_typical(self.sensors)
        return PlannedCampaign(self.name, self.path, self.wall, self.plan, sensor, self.choices, self.description)

    def to_dict(self) -> dict[str, Any]:
        """Wall, sensors, options and a description of the record, as plain values."""
        names = ("name", "description", "wall", "sensors", "record", "choices")
        return plain_value({name: getattr(self, name) for name in names})

    def to_frame(self) -> DataFrame:
        """The readings, one row for each time, as in `Record.to_frame`."""
        return self.record.to_frame()

    def _repr_html_(self) -> str:
        wall, record = self.wall, self.record
        rows: list[Row] = [
            ("wall, length", f"{wall.length:g}", "", "m"),
            ("prior diffusivity", f"{wall.diffusivity_prior:.3g}", "", "m2/s"),
            ("outside", f"on the {wall.outside}", "", ""),
        ]
        rows += [
            (f"layer {k + 1}", f"{one.thickness:g}", f"{one.conductivity:g} W/m/K, {one.heat_capacity:g} J/m3/K", "m")
            for k, one in enumerate(wall.layers)
        ]
        rows += [
            (
                f"sensor {one.name}",
                f"{one.position:g}",
                f"position ± {1e3 * one.position_std:g} mm, noise {one.noise_std:g} K",
                "m",
            )
            for one in self.sensors
        ]
        rows += [
            ("rows of the record", str(record.rows), f"one every {record.step:g} s", ""),
            ("first row", str(record.stamp(0)), "", ""),
            ("last row", str(record.stamp(record.rows - 1)), "", ""),
        ]
        rows += [("regressors", ", ".join(record.regressors), "", "")] if record.regressors else []
        rows += [("changes while reading", str(len(record.cleaning.steps)), "see case.record.cleaning", "")]
        return html_table(self.name + (f": {self.description}" if self.description else ""), rows)

    def __str__(self) -> str:
        wall, choices = self.wall, self.choices
        order = f" of order {choices.order}" if choices.model == "mim" else ""
        layers = f", {len(wall.layers)} layers" if wall.layers else ""
        section = ""
        if self.section is not None:
            section = f", section of {', '.join(one.name for one in self.section.materials)}"
        sensors = ", ".join(f"{sensor.name} at {sensor.position:g} m" for sensor in self.sensors)
        if self.sensors:
            sensors += f"; noise {_range_text([s.noise_std for s in self.sensors])} K"
            sensors += f", position +-{_range_text([1e3 * s.position_std for s in self.sensors])} mm"
        faces = self.record.face_position_std
        lines = [
            f"{self.name}{self.description and f': {self.description}'}",
            f"wall      {wall.length:g} m{layers}{section}, outside on the {wall.outside}, "
            f"prior diffusivity {wall.diffusivity_prior:.3g} m2/s"
            + (f"; the faces' sensors +-{1e3 * faces:.3g} mm" if faces else ""),
            f"sensors   {sensors or 'none'}",
            f"record    {self.record.summary()}",
            f"choices   windows of {choices.window_days:g} d, model {choices.model}{order}, {choices.nodes} nodes",
        ]
        return "\n".join(lines).replace("\n", "\n  ")


def _range_text(values: Sequence[float]) -> str:
    low, high = min(values), max(values)
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"
