"""What to do with a case: windows, models, iteration; each with a default and its limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, no_type_check

from .._internal.errors import InputError
from .._internal.units import DAY
from .._internal.validation import number, one_of, series, settle, whole
from ..records.table_columns import FEWEST_ROWS
from ..records.uniform_record import Record

FREE = ("layers", "film_left", "film_right")
_MOST_DAYS = 1e5
_MOST_NODES = 5000  # past it, the dense matrices of the large model fill the memory


@no_type_check
@dataclass(frozen=True)
class Choices:
    """What to do with a case; everything has a default.

    Args:
        window_days: length of the window that the design looks for, days.
        order: of the reduced model, or "auto".
        learning_diffusivities: that the reduced model learns from, m2/s; None lets the case take
            0.25, 1, 4 and 16 times the wall's prior.
        model: what the estimate runs, the reduced model ("mim") or the large one ("lom").
        nodes: of the large model, both faces included.
        initial_profile: degree of the polynomial fitted as the initial profile; a file that leaves
            it out gets the highest up to 2 that faces and sensors can give.
        initial_coefficients: of a known initial profile `sum_k a_k (x/L)^k` at the record's first
            row, degC.
        eta: the Gauss-Newton iteration ends where its criteria fall below.
        seed: of everything random.
        diagnose_days: of the record that the diagnosis uses; None means all.
        max_iterations: of Gauss-Newton.
        largest_interval_factor: upper over lower end of a 95 % interval past which the record is
            said not to hold the diffusivity.
        noise: "estimated": the noise's size, and the share and memory of a correlated remainder, are the
            record's where it tells them; "stated": as the case states it, white, and a misfit widens the interval;
            "robust": readings weighted as stated, the interval by the noise that is then found. None takes
            "estimated", with a heat flux "robust": what a wall's model leaves in a flux is misfit with a long
            memory, whose covariance would let the fast changes alone decide.
        free: what of the wall is estimated beside its diffusivity: "layers" (the conductivity of each beside the first
            one's), "film_left", "film_right" (that face's column is the air's temperature).

    Raises:
        InputError: a value beyond its limits.
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
    free: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        one_of("model", self.model, ("mim", "lom"))
        if self.noise is not None:
            one_of("noise", self.noise, ("estimated", "stated", "robust"))
        free = (self.free,) if isinstance(self.free, str) else tuple(self.free)
        for part in free:
            one_of("free", part, FREE)
        settle(
            self,
            free=tuple(part for part in FREE if part in free),
            window_days=number("window_days", self.window_days, "days", above=0.0, most=_MOST_DAYS),
            order="auto" if self.order == "auto" else whole("order", self.order, 1, 60, instead='or "auto"'),
            nodes=whole("nodes", self.nodes, 5, _MOST_NODES),
            initial_profile=whole("initial_profile", self.initial_profile, 0, 2),
            eta=number("eta", self.eta, above=0.0),
            seed=whole("seed", self.seed, 0),
            max_iterations=whole("max_iterations", self.max_iterations, 1),
            largest_interval_factor=number("largest_interval_factor", self.largest_interval_factor, above=1.0),
        )
        if self.diagnose_days is not None:
            settle(
                self,
                diagnose_days=number("diagnose_days", self.diagnose_days, "days", above=0.0, most=_MOST_DAYS),
            )
        if self.initial_coefficients is not None:
            coefficients = series("initial_coefficients", self.initial_coefficients, "degC")
            settle(self, initial_coefficients=coefficients)
        if self.learning_diffusivities is not None:
            name = "learning_diffusivities"
            values = series(name, self.learning_diffusivities, "m2/s", fewest=2, above=0.0)
            if len(set(values)) < 2:
                raise InputError(f"{name} = {list(values)}; at least 2 must differ")
            settle(self, learning_diffusivities=values)


def check_choices(choices: Choices, record: Record) -> None:
    """Choices that this record can serve.

    Raises:
        InputError: a window that is too short or longer than the record, a reduced model as large as
            the large one, or a profile that faces and sensors cannot give.
    """
    for name, days in (("window_days", choices.window_days), ("diagnose_days", choices.diagnose_days)):
        if days is None:
            continue
        rows, spacing = record.rows_per(days), f"rows of {record.step:g} s"
        if rows < FEWEST_ROWS:
            raise InputError(f"{name} = {days:g} makes {rows} {spacing}; it must make at least {FEWEST_ROWS}")
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
