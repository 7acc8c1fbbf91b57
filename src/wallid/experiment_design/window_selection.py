"""The optimal experiment design: which days of a record tell most about the diffusivity.

For the window of rows `W` and the readings' standard deviations `sigma`::

    I(W) = S_aa - S_ab (S_bb + diag(1/sigma_b^2))^-1 S_ba,      S_pq = sum_s sum_t dT/dp dT/dq / sigma_s^2

with `dT/dalpha = theta T_ref t_ref / L^2` and b the constant offsets of the sensors whose case states
an `offset_std` sigma_b: they are projected out, and with them what they make of the initial profile,
which is fitted through the readings. Flux plates are outputs like any other, and b holds ln(conductivity)
and each one's calibration beside the offsets. With one parameter the D-criterion `det F` is I, and so
are A and E. The paper integrates over time where readings are what counts, and takes one sigma. With
`full=True` everything counts that the estimate's interval counts (`information`).

Source: Berger and Kadoch, Section 4.1; Ucinski, Optimal Measurement Methods (2004).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jax.sharding import Mesh

from .._internal.arrays import on_device
from .._internal.errors import InputError
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
from ..records.uniform_record import Record
from .fisher_information import HOPELESS, Criterion, Of, Robust, alphas_of, check_words, merit
from .window_information import (
    Plates,
    counts_all,
    cut_information,
    full_sizes,
    start_profiles,
    watched,
    window_information,
)


@dataclass(frozen=True)
class Design:
    """The criterion of every candidate window.

    Args:
        rows: of each window.
        starts: first rows of the candidates.
        diffusivities: at which the criterion was taken, m2/s.
        information: expected information on alpha, (m2/s)^-2, `(diffusivity, window)`; its inverse
            square root is the standard error that the noise alone would leave.
        best: the window with the largest `merit`.
        restart: theta starts at 0 in each window, as in the estimate; else cut from one run.
        kind, of, robust, full: which criterion, of which parameters, over several diffusivities or at one, and with
            all that the interval counts or with the readings' own noise and offsets.
        sizes: the criterion of the information on ln(alpha), or on all parameters; None where that is `information`.
    """

    rows: int
    starts: np.ndarray = field(repr=False)
    diffusivities: tuple[float, ...]
    information: np.ndarray = field(repr=False)
    best: Window
    restart: bool
    step: float
    labels: tuple[str, str]
    kind: Criterion = "D"
    of: Of = "diffusivity"
    robust: Robust = "no"
    full: bool = False
    sizes: np.ndarray | None = field(default=None, repr=False)

    @property
    def criterion(self) -> np.ndarray:
        """The criterion over its largest value, per diffusivity and window, 1."""
        sizes = self.information if self.sizes is None else self.sizes
        largest = sizes.max(axis=1, keepdims=True)
        return sizes / np.where(largest > 0, largest, 1.0)

    @property
    def merit(self) -> np.ndarray:
        """By which the best window is the best: `criterion` at the first diffusivity, or over all of them, 1."""
        found = merit(self.information if self.sizes is None else self.sizes, self.robust)
        return found / found.max() if found.max() > 0 else found

    @property
    def start_days(self) -> np.ndarray:
        """The candidates' starts in days after the record's."""
        return self.starts * self.step / DAY

    @property
    def expected_error(self) -> float:
        """The relative standard error that the noise leaves in the best window at the first diffusivity, 1."""
        most = float(self.information[0, int(np.argmax(self.merit))])
        return float(1.0 / np.sqrt(most) / self.diffusivities[0]) if most > 0 else np.inf

    @property
    def informative(self) -> bool:
        """Whether any window holds information at all; an estimate need not be tried where none does.

        The bar is low, since the prior diffusivity may be far off.
        """
        return self.expected_error < HOPELESS

    def __str__(self) -> str:
        if not self.informative:
            return (
                f"no window of {self.rows} rows tells anything about the diffusivity: the faces stand still, "
                "or no inner sensor or plate has a reading while they move"
            )
        near = int(np.sum(self.merit >= 0.98))
        counted = "all that the interval counts" if self.full else "the readings' noise alone"
        return (
            f"best window  {self.labels[0]} to {self.labels[1]} ({self.rows} rows), of {len(self.starts)} candidates\n"
            f"criterion    {self._words()}; {near} candidate(s) within 2 % of the largest\n"
            f"expected     a relative standard error of {self.expected_error:.2%} from {counted}"
        )

    def _words(self) -> str:
        """Which criterion, at which diffusivity."""
        return criterion_words(self.kind, self.of, self.robust, self.diffusivities)


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
    of: Of = "diffusivity",
    robust: Robust = "no",
    full: bool | None = None,
) -> Design:
    """The best window of a case's record, by the large model at the prior diffusivity.

    Args:
        window_days: None for the case's choice.
        diffusivities: None for the prior alone (a robust design: a quarter to four times as much); the best window is
            the first one's.
        every_rows: distance of the candidates' starts; None for one a day, or three where the record is
            hardly longer than the window.
        restart: theta from 0 and a profile fitted at each window's start, as the estimate sees it;
            False cuts one theta of the whole record, as the paper does (across a break of the record it
            goes along a straight line).
        sweep, mesh: how the windows are gone through, see `wallid.sweep`; the same numbers.
        integrator: how the windows' rows are stepped through.
        model: a large model at hand, to spare building it; the plates' fluxes after the sensors.
        criterion, of: one number for the information on the "diffusivity", for which D, A and E are the same, on it
            and the "constants" (offsets and position errors), or on "all" that the estimate leaves free, the initial
            profile too; the last two need `full`.
        robust: "expected" or "worst" over the diffusivities, each window's criterion over the best one's at each.
        full: count all that the estimate's interval counts, the faces' noise, positions and the initial profile too
            (as stated, white), and not the readings' own noise and constants alone; None for where there are plates.

    Raises:
        InputError: a window that the record does not hold, an unknown choice, choices that do not go together, or
            neither a sensor nor a plate.
    """
    one_of("sweep", sweep, ("map", "vmap"))
    check_words(criterion, of, robust)
    full = counts_all(case, full) and (restart or full is not None)
    if (of != "diffusivity" and not full) or (full and not restart):
        raise InputError(
            f'of = "{of}" needs full = True: only then are the other parameters counted'
            if not full
            else "full = True counts the initial profile of each window, which restart = False does not have"
        )
    record = case.record
    days = case.choices.window_days if window_days is None else window_days
    rows = window_rows(case, days)
    if every_rows is not None and every_rows < 1:
        raise InputError(f"every_rows = {every_rows}; it must be at least 1")
    starts = candidate_starts(record, rows, every_rows)
    alphas = alphas_of(case, diffusivities, robust)
    sizes = None
    system = full_order_model(case, plate_outputs(case)) if model is None else model
    scale = scales(case)
    data, plates = watched(case), Plates.of(case, (rows,))
    fourier = on_device(scale.fourier(np.asarray(alphas)))
    per_alpha = scale.fourier(1.0) * scale.temperature
    if full:
        sizes, on_log = (found[:, :, 0] for found in full_sizes(case, starts, (rows,), alphas, criterion, of))
        information = on_log / np.square(alphas)[:, None]
    elif restart:
        profiles = start_profiles(case, starts)
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
        info = cut_information(system, fourier, data, on_device(starts), plates, rows=rows, integrator=integrator)
        information = np.asarray(info) * per_alpha**2
    if sizes is None and robust != "no":  # on ln(alpha), as diffusivities are compared
        sizes = information * np.square(alphas)[:, None]
    best = int(np.argmax(merit(information if sizes is None else sizes, robust)))
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
        kind=criterion,
        of=of,
        robust=robust,
        full=full,
        sizes=sizes,
    )


def criterion_words(kind: Criterion, of: Of, robust: Robust, diffusivities: Sequence[float]) -> str:
    """Which criterion, of which parameters, at which diffusivities."""
    named = {
        "diffusivity": "of the diffusivity (one parameter: D, A and E agree)",
        "constants": f"{kind}, of diffusivity, offsets and positions",
        "all": f"{kind}, of all that is free",
    }[of]
    if robust == "no":
        return f"{named}, at alpha = {diffusivities[0]:.3g} m2/s"
    how = "on average" if robust == "expected" else "at worst"
    return f"{named}, {how} from alpha = {min(diffusivities):.3g} to {max(diffusivities):.3g} m2/s"


def candidate_starts(record: Record, rows: int, every: int | None) -> np.ndarray:
    """First rows of windows of `rows` rows inside a record, `every` rows (None: about a day) apart, none on a break."""
    spare = record.longest_part[1] - rows
    if every is None:
        every = min(max(1, round(DAY / record.step)), max(1, spare // 2))
    return np.concatenate([np.arange(first, first + part - rows + 1, every) for first, part in record.unbroken])
