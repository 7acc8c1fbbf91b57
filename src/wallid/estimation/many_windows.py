"""One estimate from all windows of a campaign that tell anything, and whether they agree.

The mean is that of their ln(alpha) (`pooling`). Sensors stay where they are, and so do their offsets and the plates'
calibrations: what such a constant makes of one window's estimate it makes of the others' too, and no number of windows
takes it out. With fluxes in the record the windows' conductivities, heat capacities and plates are put together alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from .._internal.errors import InputError
from ..case.case_definition import Case
from ..case.time_window import Window, window_rows
from ..inference.gls_fit import GLSFit
from ..inference.quantity import Quantity
from ..models.flux_plates import fluxes_of
from ..models.plate_model import full_order_model_with_plates
from ..models.state_space import StateSpace
from .conclusion import estimate_from_gls, gls_minima
from .diffusivity import fit_with_flux, initial_fit
from .heat_flux import ThermalProperties, pooled_thermal
from .pooled_mean import PooledMean, covariance_of, mean_of
from .result_objects import Estimate


@dataclass(frozen=True, eq=False)
class CampaignEstimate:
    """One diffusivity from all informative windows of a record.

    Args:
        windows, fits: every window and its own estimate (None: no reading in it).
        labels: when each begins.
        used: which are informative and in the mean.
        mean: of their ln(alpha); None where there is none.
        interval_95: m2/s.
        reliable, reason: as of an estimate.
        covariance: of the used ones' ln(alpha).
        thermal: what the fluxes of all used windows tell together, the average method over the whole record (its
            longest unbroken part); None without any. conduction: the mean of their ln(conductivity).
    """

    windows: tuple[Window, ...]
    fits: tuple[Estimate | None, ...] = field(repr=False)
    labels: tuple[str, ...] = field(repr=False)
    used: tuple[int, ...]
    mean: PooledMean | None
    interval_95: tuple[float, float]
    reliable: bool
    reason: str
    covariance: np.ndarray = field(repr=False)
    thermal: ThermalProperties | None = None
    conduction: PooledMean | None = None

    @property
    def value(self) -> float:
        """m2/s."""
        return math.nan if self.mean is None else math.exp(self.mean.value)

    @property
    def std(self) -> float:
        """m2/s, that of ln(alpha) times alpha."""
        return math.nan if self.mean is None else self.value * self.mean.std

    @property
    def span(self) -> Window:
        """From the first window's first row to the last one's last."""
        first, last = self.windows[0], self.windows[-1]
        return Window(first.row, last.row + last.rows - first.row)

    def __str__(self) -> str:
        low, high = self.interval_95
        found = f"{self.value:.4g} m2/s  +- {self.std:.1g}   (95 %: {low:.4g} to {high:.4g})"
        head = f"diffusivity  {found}" if self.reliable else f"diffusivity  NOT TO BE RELIED ON: {self.reason}"
        lines = [head, f"windows      {len(self.used)} of {len(self.windows)} are informative and in it"]
        if self.mean is not None and self.mean.freedom:
            lines.append(f"agreement    {self.agreement}")
        if self.thermal is not None and self.conduction is not None and self.reliable:
            lines.append(str(self.thermal))
            if self.conduction.freedom:
                lines.append(f"agreement    of the conductivity: {self.conduction.agreement}")
        for k, (fit, label) in enumerate(zip(self.fits, self.labels, strict=True)):
            if fit is None:
                lines.append(f"  from {label}   no reading of an inner sensor or a plate")
                continue
            said = f"weight {self.weight(k):+.0%}" if k in self.used else "uninformative"
            low, high = fit.interval_95
            through = "" if fit.thermal is None else f"   R = {_short(fit.thermal.resistance)}"
            lines.append(f"  from {label}   {fit.value:.4g}   (95 %: {low:.3g} to {high:.3g}){through}   {said}")
        return "\n".join(lines)

    def weight(self, window: int) -> float:
        """Of a window in the mean, 1."""
        return float(self.mean.weights[self.used.index(window)]) if self.mean and window in self.used else 0.0

    @property
    def agreement(self) -> str:
        """Whether the windows agree, in a sentence."""
        return "nothing to compare" if self.mean is None else self.mean.agreement


def campaign(
    case: Case,
    *,
    window_days: float | None = None,
    windows: Sequence[Window] | None = None,
    model: StateSpace | None = None,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> CampaignEstimate:
    """One diffusivity from all windows of a record, laid end to end, and whether they agree.

    One compiled estimate serves all windows; they are taken by the large model, which knows every window's faces, with
    the plates' fluxes where there are any.

    Args:
        window_days: None for the case's choice.
        windows: by hand, none over another; None for all that fit into the record's unbroken parts.
        model: a large model at hand, the plates after the sensors.
        progress: told how many windows are done, of how many.

    Raises:
        InputError: windows over one another, or a case with more of the wall free.
    """
    if case.choices.free:
        raise InputError(
            f"[choices] free = {list(case.choices.free)}: estimate without --all-windows, or with the diffusivity alone"
        )
    rows = window_rows(case, case.choices.window_days if window_days is None else window_days)
    laid = _laid(case, rows) if windows is None else _checked(windows)
    system = full_order_model_with_plates(case) if model is None else model
    fits, settled = [], []
    for k, window in enumerate(laid):
        progress(k, len(laid))
        found = _one(case, window, system) if _has_reading(case, window) else None
        fits.append(None if found is None else found[0])
        settled.append(None if found is None else found[1])
    used = tuple(k for k, fit in enumerate(fits) if fit is not None and fit.reliable)
    return _pooled(case, laid, fits, [(fits[k], settled[k]) for k in used], used)


def _has_reading(case: Case, window: Window) -> bool:
    """Whether an inner sensor or a plate has one in a window."""
    courses = [case.record.sensors, *(case.record.regressors[f"flux_{face}"] for face in fluxes_of(case))]
    return any(bool(np.isfinite(course[window.part]).any()) for course in courses)


def _one(case: Case, window: Window, system: StateSpace) -> tuple[Estimate, GLSFit]:
    prior, eta = case.wall.diffusivity_prior, case.choices.eta
    if fluxes_of(case):
        return fit_with_flux(case, window, system, prior, eta)
    told = initial_fit(case, window, system, prior, eta)
    settled, others = gls_minima(told, eta, True, "propagator")
    return estimate_from_gls(told, settled, others, 0), settled


def _pooled(case: Case, laid, fits, informative, used: tuple[int, ...]) -> CampaignEstimate:
    """The mean of the informative windows, and whether it can be relied on."""
    mean, interval, covariance = None, (math.nan, math.nan), np.zeros((0, 0))
    with_plates = [settled for fit, settled in informative if fit.has_flux]
    through = pooled_thermal(case, with_plates) if with_plates else (None, None)
    reason = f"none of {len(laid)} windows is informative"
    if used:
        covariance = _covariance(informative)
        values = np.log([fit.value for fit, _ in informative])
        mean = mean_of(values, covariance, max(settled.quantile for _, settled in informative))
        half = min(mean.quantile * mean.std, 300.0)
        interval = (math.exp(mean.value - half), math.exp(mean.value + half))
        factor, most = interval[1] / interval[0], case.choices.largest_interval_factor
        reason = ""
        if factor > most:
            disagree = "the windows disagree, and " if mean.between else ""
            reason = f"{disagree}its 95 % interval spans a factor of {factor:.3g}, more than {most:g}"
    return CampaignEstimate(
        windows=tuple(laid),
        fits=tuple(fits),
        labels=tuple(str(case.record.stamp(window.row)) for window in laid),
        used=used,
        mean=mean,
        interval_95=interval,
        reliable=not reason,
        reason=reason,
        covariance=covariance,
        thermal=through[0],
        conduction=through[1],
    )


def _covariance(informative: Sequence[tuple[Estimate, GLSFit]]) -> np.ndarray:
    """Of the windows' ln(alpha)."""
    shared, stds = [], []
    for fit, settled in informative:
        # an interval by the profile is wider than the curvature says
        half = 0.5 * math.log(fit.interval_95[1] / fit.interval_95[0]) / settled.quantile
        stds.append(max(half, settled.log_std))
        shared.append(settled.of_constants(np.eye(1 + settled.names.count)[0]))
    return covariance_of(np.array(stds), np.stack(shared))


def _short(quantity: Quantity) -> str:
    """A quantity with its standard error."""
    return f"{quantity.value:.4g} +- {quantity.std:.2g} {quantity.unit}"


def _laid(case: Case, rows: int) -> list[Window]:
    """Windows end to end in each unbroken part of the record."""
    return [
        Window(row, rows) for first, part in case.record.unbroken for row in range(first, first + part - rows + 1, rows)
    ]


def _checked(windows: Sequence[Window]) -> list[Window]:
    """In their order, none over another.

    Raises:
        InputError: two that share rows, or none at all.
    """
    laid = sorted(windows, key=lambda window: window.row)
    if not laid:
        raise InputError("windows: none was given")
    for one, two in pairwise(laid):
        if one.row + one.rows > two.row:
            raise InputError(
                f"windows: the one from row {two.row} begins before the one from row {one.row} ends; "
                "they would share readings"
            )
    return laid
