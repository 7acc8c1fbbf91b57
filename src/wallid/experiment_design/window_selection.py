"""Optimal experiment design: the window of a record with the largest information on the diffusivity.

For the window of rows `W` and the readings' standard deviations `sigma`::

    I(W) = S_aa - S_ab (S_bb + diag(1/sigma_b^2))^-1 S_ba,      S_pq = sum_s sum_t dT/dp dT/dq / sigma_s^2

with `dT/dalpha = theta T_ref t_ref / L^2`. The nuisance parameters b are the constant offsets of the sensors with an
`offset_std` sigma_b; their effect on the fitted initial profile is included. They are projected out. Flux plates are
further outputs, and b then also holds ln(conductivity) and each calibration error. With one parameter the criteria D, A
and E all equal I. The paper integrates over time with one sigma; here the sum is over readings. With `full=True` the
full covariance of the estimate's interval is used (`fisher_information`).

Source: Berger and Kadoch, Section 4.1; Ucinski, Optimal Measurement Methods (2004).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from jax.sharding import Mesh

from .._internal.arrays import on_device
from .._internal.blas_threads import one_blas_thread
from .._internal.errors import InputError
from .._internal.html import html_table
from .._internal.progress import Progress, shown_progress
from .._internal.result_object import ResultObject, plain_value
from .._internal.units import DAY
from .._internal.validation import one_of
from ..case.case_definition import Case
from ..case.initial_profile import scales
from ..case.time_window import Window, window_rows
from ..models.batching import Sweep
from ..models.flux_plates import plate_outputs
from ..models.integration import Integrator
from ..models.state_space import StateSpace
from ..models.window_inputs import full_order_model
from ..records.row_times import RecordStart
from ..records.uniform_record import Record
from .fisher_information import (
    UNINFORMATIVE_STD,
    Criterion,
    ParametersOfInterest,
    Robust,
    check_choices,
    design_diffusivities,
    relative_criterion,
)
from .window_information import (
    PlateSettings,
    full_covariance_criterion,
    information_from_one_run,
    initial_profiles,
    record_with_plates,
    uses_full_covariance,
    window_information,
)

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True)
class ExpectedErrors:
    """Relative standard errors of an estimate from the best window, with the full covariance of its interval.

    Args:
        diffusivity: dimensionless.
        resistance: dimensionless; NaN without flux plates.
    """

    diffusivity: float
    resistance: float = math.nan

    def __str__(self) -> str:
        diffusivity = f"{self.diffusivity:.2%} of the diffusivity"
        if math.isnan(self.resistance):
            return diffusivity
        return f"{self.resistance:.2%} of the resistance R (a little less of U) and of {diffusivity}"


@dataclass(frozen=True)
class Design(ResultObject):
    """The criterion of every candidate window, and the best window.

    Args:
        rows: length of each window.
        starts: first rows of the candidates, `(window,)`.
        diffusivities: at which the criterion was evaluated, m2/s.
        information: expected information on alpha, (m2/s)^-2, `(diffusivity, window)`; its inverse square root is the
            expected standard error.
        best: the window with the largest `relative_criterion`.
        restart: whether theta starts at 0 in each window, as in the estimate, or is cut from one simulation.
        step: of the record, s.
        labels: first and last time stamp of the best window.
        criterion_name, of, robust, full: as given to `design`.
        criterion_values: the criterion, `(diffusivity, window)`; None where it is `information`.
        record_start: the origin of `start_days`.
        errors: the expected errors of an estimate from the best window; None where they were not computed.
    """

    rows: int
    starts: np.ndarray = field(repr=False)
    diffusivities: tuple[float, ...]
    information: np.ndarray = field(repr=False)
    best: Window
    restart: bool
    step: float
    labels: tuple[str, str]
    criterion_name: Criterion = "D"
    of: ParametersOfInterest = "diffusivity"
    robust: Robust = "no"
    full: bool = False
    criterion_values: np.ndarray | None = field(default=None, repr=False)
    record_start: RecordStart = field(default_factory=RecordStart)
    errors: ExpectedErrors | None = None

    @property
    def criterion(self) -> np.ndarray:
        """The criterion divided by its largest value at each diffusivity, `(diffusivity, window)`."""
        values = self.information if self.criterion_values is None else self.criterion_values
        largest = values.max(axis=1, keepdims=True)
        return values / np.where(largest > 0, largest, 1.0)

    @property
    def relative_criterion(self) -> np.ndarray:
        """The criterion by which the best window is chosen, over the diffusivities as `robust` says, `(window,)`."""
        values = relative_criterion(self.criterion, self.robust)
        return values / values.max() if values.max() > 0 else values

    @property
    def start_days(self) -> np.ndarray:
        """The candidates' starts, days after the record's start."""
        return self.starts * self.step / DAY

    @property
    def expected_relative_std(self) -> float:
        """The expected relative standard error of the diffusivity in the best window, at the first diffusivity."""
        best = float(self.information[0, int(np.argmax(self.relative_criterion))])
        return float(1.0 / np.sqrt(best) / self.diffusivities[0]) if best > 0 else np.inf

    @property
    def informative(self) -> bool:
        """Whether any window has information on the diffusivity; if not, no estimate needs to be tried.

        The threshold is low, since the prior diffusivity may be far from the true one.
        """
        return self.expected_relative_std < UNINFORMATIVE_STD

    def summary(self) -> str:
        """The best window, the criterion and the expected standard error, as text."""
        if not self.informative:
            return (
                f"no window of {self.rows} rows has information on the diffusivity: the face temperatures are "
                "constant, or no inner sensor or plate has a reading while they change"
            )
        near = int(np.sum(self.relative_criterion >= 0.98))
        criterion = criterion_text(self.criterion_name, self.of, self.robust, self.diffusivities)
        errors = self.errors or ExpectedErrors(self.expected_relative_std)
        counted = (
            "the full covariance of the estimate"
            if self.full or self.errors is not None
            else "the readings' noise alone"
        )
        return (
            f"best window  {self.labels[0]} to {self.labels[1]} ({self.rows} rows), of {len(self.starts)} candidates\n"
            f"criterion    {criterion}; {near} candidate(s) within 2 % of the largest\n"
            f"expected     a standard error of {errors}, from {counted}"
        )

    __str__ = summary

    def to_dict(self) -> dict[str, Any]:
        """The result as plain numbers, lists and strings."""
        entries = {
            "start": self.labels[0],
            "end": self.labels[1],
            "row": self.best.row,
            "rows": self.rows,
            "expected_relative_std": self.expected_relative_std,
            "informative": self.informative,
            "criterion": self.criterion_name,
            "of": self.of,
            "robust": self.robust,
            "full": self.full,
            "diffusivities": list(self.diffusivities),
            "starts": self.starts,
            "relative_criterion": self.relative_criterion,
        }
        return plain_value(entries)

    def to_frame(self) -> DataFrame:
        """One row for each candidate window.

        The index is its start (s since the record's start where the record has s). Columns: `row` and `rows`, the
        `relative_criterion`, and the `expected_relative_std` of the diffusivity at the first diffusivity.
        """
        import pandas as pd

        columns = {
            "row": self.starts,
            "rows": np.full(len(self.starts), self.rows),
            "relative_criterion": self.relative_criterion,
            "expected_relative_std": self._relative_stds,
        }
        return pd.DataFrame(columns, index=self.record_start.index_after(self.starts * self.step))

    @property
    def _relative_stds(self) -> np.ndarray:
        """The expected relative standard error in each window, at the first diffusivity."""
        with np.errstate(divide="ignore"):
            return 1.0 / np.sqrt(self.information[0]) / self.diffusivities[0]

    def _repr_html_(self) -> str:
        rows = [
            ("first row", str(self.best.row), "", ""),
            ("rows", str(self.rows), "", ""),
            ("diffusivity", f"{self.diffusivities[0]:.3g}", f"expected {self.expected_relative_std:.2%}", "m2/s"),
        ]
        return html_table(f"Best window: {self.labels[0]} to {self.labels[1]}", rows)


@one_blas_thread
def design(
    case: Case,
    *,
    window_days: float | None = None,
    diffusivities: Sequence[float] | None = None,
    every_rows: int | None = None,
    restart: bool = True,
    sweep: Sweep = "map",
    mesh: Mesh | None = None,
    integrator: Integrator = "propagator",
    model: StateSpace | None = None,
    criterion: Criterion = "D",
    of: ParametersOfInterest = "diffusivity",
    robust: Robust = "no",
    full: bool | None = None,
    progress: Progress | None = None,
) -> Design:
    """The best window of a case's record, by the full-order model at the prior diffusivity.

    Args:
        window_days: window length, days; None for the one in the case's `[choices]`.
        diffusivities: m2/s; None for the prior, and for a robust design also a quarter to four times the prior. Without
            `robust` the best window is that of the first one.
        every_rows: rows between the starts of two candidates; None for one candidate a day, or three candidates where
            the record is hardly longer than the window.
        restart: True for theta = 0 and a fitted initial profile at each window's start, as in the estimate; False to
            cut theta from one simulation of the entire record, as in the paper (linear across a gap).
        sweep, mesh: how the windows are distributed, as in `wallid.models.sweep`; the numbers are the same.
        integrator: time integration within the windows.
        model: a full-order model to use instead of a new one, with the plates' fluxes after the sensors.
        criterion: "D", "A" or "E".
        of: the parameters of the criterion: the "diffusivity" alone (D, A and E agree), with the "constants" (offsets
            and position errors), or "all" parameters of the estimate, initial profile included; the last two need
            `full`.
        robust: "no", or "expected" or "worst" over the diffusivities of each window's criterion relative to the best
            window's.
        full: use the full covariance of the estimate's interval: also face noise (as stated, white), position errors
            and the initial profile. False counts the readings' own noise, offsets and calibration errors only. None
            for True where the case has flux plates.
        progress: called as `progress(text, share)` with the step that begins and the completed share, 0 to 1;
            None for a bar in a notebook, and nothing elsewhere.

    Returns:
        the criterion of every candidate window, and the best window.

    Raises:
        InputError: a window does not fit into the record, an option is unknown, options contradict each other, or the
            case has neither a sensor nor a plate.

    Example:
        `window = wallid.design(case, window_days=3.0).best`

    Source: Berger and Kadoch, Section 4.1; Ucinski, Optimal Measurement Methods (2004).
    """
    one_of("sweep", sweep, ("map", "vmap"))
    check_choices(criterion, of, robust)
    full = uses_full_covariance(case, full) and (restart or full is not None)
    if (of != "diffusivity" and not full) or (full and not restart):
        raise InputError(
            f'of = "{of}" needs full = True: only then are the other parameters counted'
            if not full
            else "full = True needs restart = True: it counts the initial profile of each window"
        )
    record = case.record
    days = case.choices.window_days if window_days is None else window_days
    rows = window_rows(case, days)
    if every_rows is not None and every_rows < 1:
        raise InputError(f"every_rows = {every_rows}; it must be at least 1")
    starts = candidate_starts(record, rows, every_rows)
    alphas = design_diffusivities(case, diffusivities, robust)
    with shown_progress(progress) as report:
        report(f"design: the information of {len(starts)} windows", 0.0)
        values, information = _information(
            case, starts, rows, alphas, restart, sweep, mesh, integrator, model, criterion, of, full
        )
    if values is None and robust != "no":  # information on ln(alpha), which is comparable between diffusivities
        values = information * np.square(alphas)[:, None]
    best = int(np.argmax(relative_criterion(information if values is None else values, robust)))
    row = int(starts[best])
    return Design(
        rows=rows,
        starts=starts,
        diffusivities=alphas,
        information=information,
        best=Window(row, rows),
        restart=restart,
        step=record.step,
        labels=(str(record.stamp(row)), str(record.stamp(row + rows))),
        criterion_name=criterion,
        of=of,
        robust=robust,
        full=full,
        criterion_values=values,
        record_start=record.start,
    )


def _information(
    case: Case,
    starts: np.ndarray,
    rows: int,
    alphas: tuple[float, ...],
    restart: bool,
    sweep: Sweep,
    mesh: Mesh | None,
    integrator: Integrator,
    model: StateSpace | None,
    criterion: Criterion,
    of: ParametersOfInterest,
    full: bool,
) -> tuple[np.ndarray | None, np.ndarray]:
    """The criterion, None where it is the information, and the information on alpha; `(diffusivity, window)` each."""
    values = None
    system = full_order_model(case, plate_outputs(case)) if model is None else model
    scale = scales(case)
    data, plates = record_with_plates(case), PlateSettings.of_case(case, (rows,))
    fourier = on_device(scale.fourier_number(np.asarray(alphas)))
    per_alpha = scale.fourier_number(1.0) * scale.temperature
    if full:
        arrays = full_covariance_criterion(case, starts, (rows,), alphas, criterion, of)
        values, log_information = (array[:, :, 0] for array in arrays)
        information = log_information / np.square(alphas)[:, None]
    elif restart:
        profiles = initial_profiles(case, starts)
        info = window_information(
            system,
            fourier,
            data,
            on_device(starts),
            profiles,
            plates,
            rows=(rows,),
            sweep=sweep,
            integrator=integrator,
            mesh=mesh,
        )
        information = np.asarray(info)[:, :, 0] * per_alpha**2
    else:
        info = information_from_one_run(
            system, fourier, data, on_device(starts), plates, rows=rows, integrator=integrator
        )
        information = np.asarray(info) * per_alpha**2
    return values, information


def criterion_text(kind: Criterion, of: ParametersOfInterest, robust: Robust, diffusivities: Sequence[float]) -> str:
    """The criterion, its parameters and its diffusivities, as text."""
    parameters = {
        "diffusivity": "of the diffusivity (one parameter: D, A and E agree)",
        "constants": f"{kind}, of diffusivity, offsets and positions",
        "all": f"{kind}, of all estimated parameters",
    }[of]
    if robust == "no":
        return f"{parameters}, at alpha = {diffusivities[0]:.3g} m2/s"
    how = "on average" if robust == "expected" else "at worst"
    return f"{parameters}, {how} from alpha = {min(diffusivities):.3g} to {max(diffusivities):.3g} m2/s"


def candidate_starts(record: Record, rows: int, every_rows: int | None) -> np.ndarray:
    """First rows of candidate windows of `rows` rows, `every_rows` apart (None: about a day), none across a gap."""
    spare = record.longest_part[1] - rows
    if every_rows is None:
        every_rows = min(max(1, round(DAY / record.step)), max(1, spare // 2))
    return np.concatenate(
        [np.arange(first, first + part - rows + 1, every_rows) for first, part in record.unbroken_parts]
    )
