"""The options of a case: windows, models, iteration, noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, no_type_check

from .._internal.errors import InputError
from .._internal.units import DAY
from .._internal.validation import integer, number, number_tuple, one_of, set_fields, some_of
from ..records.table_columns import MIN_ROWS
from ..records.uniform_record import Record

ACTIONS = ("sensor", "flux_plate", "column", "longer", "season", "shade", "swap", "heating")
"""Kinds of action that a diagnosis can propose."""
FREE_PARAMETERS = ("layers", "film_left", "film_right", "materials")
_MAX_DAYS = 1e5
_MAX_NODES = 5000  # more nodes: the dense matrices of the full-order model fill the memory


@no_type_check
@dataclass(frozen=True)
class Choices:
    """The options of the method; each has a default.

    Args:
        window_days: length of the windows that the experiment design compares, days.
        order: of the reduced-order model, or "auto".
        learning_diffusivities: diffusivities of the training signals, m2/s; None gives 0.25, 1, 4 and 16 times the
            prior of the wall.
        model: for the estimate, the reduced-order model ("mim") or the full-order model ("lom").
        nodes: of the full-order model, both faces included.
        initial_profile: degree (0, 1 or 2) of the polynomial fitted as the initial profile. Where a case file leaves
            it out, it is the highest degree up to 2 that the number of faces and sensors permits.
        initial_coefficients: of a known initial profile `sum_k a_k (x/L)^k` at the first row of the record, degC.
        eta: the Gauss-Newton iteration stops where its criteria are below this value.
        seed: of all random numbers.
        diagnose_days: length of the part of the record that the diagnosis uses, days; None for the entire record.
        max_iterations: of Gauss-Newton.
        largest_interval_factor: largest ratio of the upper to the lower end of the 95 % interval for which the record
            counts as informative.
        noise: the noise model. "estimated": standard deviation, share and correlation time of autocorrelated noise
            are estimated from the residual where it is informative. "stated": white noise as the case states it, and a
            misfit widens the interval. "robust": readings are weighted with the stated noise, and the interval is
            computed with the noise estimated from the residual. None gives "estimated".
        disturbance: heat that the model does not know, as a random process in a part of the wall. "none"; "auto": it is
            used where the record has evidence for it; "on": it is always used. Its size, time constant and place are
            estimated, and the interval contains their uncertainty. It needs noise that is estimated. None gives "auto"
            for a record with a heat flux and estimated noise, else "none".
        free: parameters of the wall that are estimated in addition to the diffusivity: "layers" (the conductivity of
            each layer relative to that of the first), "film_left", "film_right" (the surface resistance, where the
            column of that face is the air temperature), "materials" (conductivity and heat capacity of each material of
            a section, within the priors that its `uncertainty` gives).
        efforts: of kinds of action that a diagnosis proposes, such as {"sensor": 5.0}, relative to that of logging one
            more column; kept as pairs. Kinds that are left out have their defaults.

    Raises:
        InputError: a value is outside its limits.
    """

    window_days: float = 3.0
    order: int | Literal["auto"] = 10
    learning_diffusivities: tuple[float, ...] | None = None
    model: Literal["mim", "lom"] = "mim"
    nodes: int = 101
    initial_profile: int = 2
    initial_coefficients: tuple[float, ...] | None = None
    eta: float = 1e-10
    seed: int = 0
    diagnose_days: float | None = None
    max_iterations: int = 100
    largest_interval_factor: float = 3.0
    noise: Literal["estimated", "stated", "robust"] | None = None
    disturbance: Literal["none", "auto", "on"] | None = None
    free: tuple[str, ...] = ()
    efforts: Mapping[str, float] | tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        one_of("model", self.model, ("mim", "lom"))
        if self.noise is not None:
            one_of("noise", self.noise, ("estimated", "stated", "robust"))
        if self.disturbance is not None:
            one_of("disturbance", self.disturbance, ("none", "auto", "on"))
        if self.noise in ("stated", "robust") and self.disturbance in ("auto", "on"):
            raise InputError(
                f'noise = "{self.noise}" and disturbance = "{self.disturbance}": a disturbance is found beside noise '
                "whose size is estimated; state only one of them"
            )
        free = some_of("free", self.free, FREE_PARAMETERS)
        if not isinstance(self.efforts, Mapping | tuple):
            raise InputError(f"efforts = {self.efforts!r}; it must be a table such as {{ sensor = 5.0 }}")
        efforts = dict(self.efforts)
        for kind in efforts:
            one_of("efforts", kind, ACTIONS)
        set_fields(
            self,
            efforts=tuple((kind, number(f"efforts.{kind}", one, minimum=0.0)) for kind, one in efforts.items()),
            free=free,
            window_days=number("window_days", self.window_days, "days", above=0.0, maximum=_MAX_DAYS),
            order="auto" if self.order == "auto" else integer("order", self.order, 1, 60, alternative='or "auto"'),
            nodes=integer("nodes", self.nodes, 5, _MAX_NODES),
            initial_profile=integer("initial_profile", self.initial_profile, 0, 2),
            eta=number("eta", self.eta, above=0.0),
            seed=integer("seed", self.seed, 0),
            max_iterations=integer("max_iterations", self.max_iterations, 1),
            largest_interval_factor=number("largest_interval_factor", self.largest_interval_factor, above=1.0),
        )
        if self.diagnose_days is not None:
            set_fields(
                self,
                diagnose_days=number("diagnose_days", self.diagnose_days, "days", above=0.0, maximum=_MAX_DAYS),
            )
        if self.initial_coefficients is not None:
            coefficients = number_tuple("initial_coefficients", self.initial_coefficients, "degC")
            set_fields(self, initial_coefficients=coefficients)
        if self.learning_diffusivities is not None:
            name = "learning_diffusivities"
            values = number_tuple(name, self.learning_diffusivities, "m2/s", min_count=2, above=0.0)
            if len(set(values)) < 2:
                raise InputError(f"{name} = {list(values)}; at least 2 must differ")
            set_fields(self, learning_diffusivities=values)


def check_choices(choices: Choices, record: Record) -> None:
    """Check the options against a record.

    Raises:
        InputError: a window is too short or longer than the record, the reduced-order model is as large as the
            full-order model, or there are too few faces and sensors for the initial profile.
    """
    for name, days in (("window_days", choices.window_days), ("diagnose_days", choices.diagnose_days)):
        if days is None:
            continue
        rows, spacing = record.rows_in_days(days), f"rows of {record.step:g} s"
        if rows < MIN_ROWS:
            raise InputError(f"{name} = {days:g} makes {rows} {spacing}; it must make at least {MIN_ROWS}")
        if rows > record.rows:
            longest = record.rows * record.step / DAY
            raise InputError(
                f"{name} = {days:g} is longer than the record of {record.rows} {spacing}; "
                f"it must be at most {longest:.6g} (days)"
            )
    if choices.model == "mim" and choices.order != "auto" and choices.order >= choices.nodes - 1:
        raise InputError(f"order = {choices.order}; it must be less than nodes - 1 = {choices.nodes - 1}")
    points = 2 + len(record.names)
    if choices.initial_profile >= points:
        raise InputError(
            f"initial_profile = {choices.initial_profile}; it must be below the number of faces and sensors, {points}"
        )
