"""One estimate from all informative windows of a record, and a test of whether the windows agree.

The result is the GLS mean of the windows' ln(alpha) (`pooled_mean`). Sensor positions, offsets and the plates'
calibrations are the same in all windows, so their errors are fully correlated between windows and do not average out.
With fluxes, conductivities, heat capacities and calibration errors are pooled in the same way.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from .._internal.blas_threads import one_blas_thread
from .._internal.errors import InputError
from .._internal.html import html_table, interval_row
from .._internal.number_formats import value_and_interval, value_and_std
from .._internal.progress import Progress, shown_progress
from .._internal.result_object import ResultObject, plain_value
from ..case.case_definition import Case
from ..case.time_window import Window, window_rows
from ..inference.gls_fit import GLSFit
from ..inference.physical_bounds import clip_to_physical
from ..inference.quantity import Quantity
from ..inference.sensor_heights import has_uncertain_height
from ..models.flux_plates import fluxes_of, full_order_model_with_plates
from ..models.state_space import StateSpace
from .diffusivity import estimate_by_gls
from .heat_flux import ThermalProperties, pooled_thermal_properties
from .pooled_mean import PooledMean, covariance_with_shared_errors, pooled_mean
from .result_objects import Estimate

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, eq=False)
class CampaignEstimate(ResultObject):
    """One diffusivity from all informative windows of a record.

    Args:
        windows, fits: every window and its own estimate (None where it has no reading).
        labels: time stamp of each window's first row.
        used: indices of the informative windows, which are in the mean.
        mean: of their ln(alpha); None if no window is informative.
        interval_95: m2/s.
        reliable, reason: as in `Estimate`.
        covariance: of ln(alpha) of the used windows, `(window, window)`.
        thermal: pooled thermal properties from the fluxes of the used windows; the average method is over the whole
            record, or its longest unbroken part. None without fluxes.
        conductivity_mean: the mean of the windows' ln(conductivity); None without fluxes.
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
    conductivity_mean: PooledMean | None = None

    @property
    def value(self) -> float:
        """The diffusivity, m2/s."""
        return math.nan if self.mean is None else math.exp(self.mean.value)

    @property
    def std(self) -> float:
        """Its standard error, that of ln(alpha) times alpha, m2/s."""
        return math.nan if self.mean is None else self.value * self.mean.std

    @property
    def span(self) -> Window:
        """The rows from the first window's start to the last window's end."""
        first, last = self.windows[0], self.windows[-1]
        return Window(first.row, last.row + last.rows - first.row)

    def summary(self) -> str:
        """The pooled value, the agreement of the windows and each window's estimate, as text."""
        value = value_and_interval(self.value, self.std, self.interval_95, "m2/s")
        head = f"diffusivity  {value}" if self.reliable else f"diffusivity  NOT TO BE RELIED ON: {self.reason}"
        lines = [head, f"windows      {len(self.used)} of {len(self.windows)} are informative and in it"]
        if self.mean is not None and self.mean.degrees_of_freedom:
            lines.append(f"agreement    {self.agreement}")
        if self.thermal is not None and self.conductivity_mean is not None and self.reliable:
            lines.append(str(self.thermal))
            lines += [f"advice       {self.thermal.disagreement}"] if self.thermal.disagreement else []
            if self.conductivity_mean.degrees_of_freedom:
                lines.append(f"agreement    of the conductivity: {self.conductivity_mean.agreement}")
        for k, (fit, label) in enumerate(zip(self.fits, self.labels, strict=True)):
            if fit is None:
                lines.append(f"  from {label}   no reading of an inner sensor or a plate")
                continue
            weight = f"weight {self.weight(k):+.0%}" if k in self.used else "uninformative"
            low, high = fit.interval_95
            resistance = "" if fit.thermal is None else f"   R = {_value_and_std(fit.thermal.resistance)}"
            lines.append(f"  from {label}   {fit.value:.4g}   (95 %: {low:.3g} to {high:.3g}){resistance}   {weight}")
        return "\n".join(lines)

    __str__ = summary

    def to_dict(self) -> dict[str, Any]:
        """The result as plain numbers, strings, lists and dicts; None where there is no value."""
        mean = self.mean
        entries = {
            **self._quantity.result(),
            "reliable": self.reliable,
            "reason": self.reason,
            "chi_square": None if mean is None else mean.chi_square,
            "degrees_of_freedom": None if mean is None else mean.degrees_of_freedom,
            "p_value": None if mean is None else mean.p_value,
            "between_std": None if mean is None else mean.between_std,
            "windows": [
                {"start": label, "weight": self.weight(k), "estimate": fit}
                for k, (fit, label) in enumerate(zip(self.fits, self.labels, strict=True))
            ],
            "thermal": self.thermal,
        }
        return plain_value(entries)

    def to_frame(self) -> DataFrame:
        """One row for each window: `value`, `std`, `low`, `high` (m2/s), `weight` in the mean, `reliable`, `reason`.

        With fluxes also `resistance` and `resistance_std`, m2 K/W. The index is the window's start.
        """
        import pandas as pd

        rows = []
        for k, fit in enumerate(self.fits):
            if fit is None:
                rows.append({"weight": 0.0, "reliable": False, "reason": "no reading"})
                continue
            row = {"value": fit.value, "std": fit.std, "low": fit.interval_95[0], "high": fit.interval_95[1]}
            row |= {"weight": self.weight(k), "reliable": fit.reliable, "reason": fit.reason}
            if fit.thermal is not None:
                row |= {"resistance": fit.thermal.resistance.value, "resistance_std": fit.thermal.resistance.std}
            rows.append(row)
        columns = ["value", "std", "low", "high", "weight", "reliable", "reason"]
        columns += [] if self.thermal is None else ["resistance", "resistance_std"]
        return pd.DataFrame(rows, index=pd.Index(self.labels, name="start"), columns=columns)

    @property
    def quantities(self) -> dict[str, Quantity]:
        """The diffusivity and, with fluxes, the thermal properties, by name; of all windows together."""
        return {"diffusivity": self._quantity} | ({} if self.thermal is None else self.thermal.quantities)

    def _repr_html_(self) -> str:
        rows = [interval_row("diffusivity", self._quantity)]
        rows += [
            interval_row(f"window from {label}", Quantity(fit.value, fit.std, fit.interval_95, "m2/s"))
            for fit, label in zip(self.fits, self.labels, strict=True)
            if fit is not None
        ]
        return html_table("Diffusivity" if self.reliable else f"Not to be relied on: {self.reason}", rows)

    @property
    def _quantity(self) -> Quantity:
        return Quantity(self.value, self.std, self.interval_95, "m2/s")

    def weight(self, window: int) -> float:
        """The weight of a window in the mean; 0 for one that is not used."""
        return float(self.mean.weights[self.used.index(window)]) if self.mean and window in self.used else 0.0

    @property
    def agreement(self) -> str:
        """The result of the test of agreement, as text."""
        return "nothing to compare" if self.mean is None else self.mean.agreement


@one_blas_thread
def campaign(
    case: Case,
    *,
    window_days: float | None = None,
    windows: Sequence[Window] | None = None,
    model: StateSpace | None = None,
    progress: Progress | None = None,
) -> CampaignEstimate:
    """Estimate one diffusivity from all windows of a record.

    All windows have the same length and use the full-order model, so one compilation serves them all. Contact
    resistances at plates are estimated in all windows where one of them shows some. The pooled value is the GLS mean of
    ln(alpha) over the informative windows, see `PooledMean`.

    Args:
        window_days: window length, days; None for the one in the case's `[choices]`.
        windows: windows that do not overlap; None for consecutive ones in each unbroken part of the record.
        model: a full-order model to use instead of a new one, with the plates' fluxes after the sensors.
        progress: called as `progress(text, share)` with the step that begins and the completed share, 0 to 1;
            None for a bar in a notebook, and nothing elsewhere.

    Returns:
        the pooled diffusivity, the estimate of each window, and the test of agreement.

    Raises:
        InputError: windows overlap, there are none, the case has other free wall parameters, or sensors of unknown
            height.

    Source: R. C. Paule, J. Mandel, J. Res. NBS 87 (1982), 377.
    """
    if case.choices.free:
        raise InputError(
            f"[choices] free = {list(case.choices.free)}: estimate without --all-windows, or with the diffusivity alone"
        )
    if any(has_uncertain_height(case, sensor) for sensor in case.sensors):
        raise InputError(
            "[[sensor]] height is not known: it is the same in all windows, which the average does not count; estimate "
            "without --all-windows"
        )
    rows = window_rows(case, case.choices.window_days if window_days is None else window_days)
    windows = _consecutive_windows(case, rows) if windows is None else _sorted_windows(windows)
    system = full_order_model_with_plates(case) if model is None else model
    prior, eta = case.wall.diffusivity_prior, case.choices.eta
    results: list[tuple[Estimate, GLSFit] | None] = []
    with shown_progress(progress) as report:
        for k, window in enumerate(windows):
            report(f"estimate: window {k + 1} of {len(windows)}", k / len(windows))
            results.append(estimate_by_gls(case, window, system, prior, eta) if _has_reading(case, window) else None)
        if any(one is not None and one[1].contacts for one in results):  # the wall is the same in all windows
            for k, one in enumerate(results):
                if one is not None and not one[1].contacts:
                    report(f"estimate: window {k + 1} of {len(windows)} with contact resistances", 0.99)
                    results[k] = estimate_by_gls(case, windows[k], system, prior, eta, with_contacts=True)
        return _pool(case, windows, results)


def _has_reading(case: Case, window: Window) -> bool:
    """Whether an inner sensor or a plate has a reading in a window."""
    readings = [case.record.sensors, *(case.record.regressors[f"flux_{face}"] for face in fluxes_of(case))]
    return any(bool(np.isfinite(array[window.as_slice]).any()) for array in readings)


def _pool(case: Case, windows: Sequence[Window], results: Sequence[tuple[Estimate, GLSFit] | None]) -> CampaignEstimate:
    """The pooled estimate from the results of each window."""
    used = tuple(k for k, one in enumerate(results) if one is not None and one[0].reliable)
    informative = [one for one in results if one is not None and one[0].reliable]
    mean, interval, covariance = None, (math.nan, math.nan), np.zeros((0, 0))
    with_plates = [gls for fit, gls in informative if fit.has_flux]
    thermal, conductivity_mean = pooled_thermal_properties(case, with_plates) if with_plates else (None, None)
    reason = f"none of {len(windows)} windows is informative"
    if used:
        covariance = _log_alpha_covariance(informative)
        values = np.log([fit.value for fit, _ in informative])
        mean = pooled_mean(values, covariance, max(gls.quantile for _, gls in informative))
        half = min(mean.quantile * mean.std, 300.0)
        interval = clip_to_physical(math.exp(mean.value - half), math.exp(mean.value + half), "m2/s")
        factor, largest = interval[1] / interval[0], case.choices.largest_interval_factor
        reason = ""
        if factor > largest:
            disagree = "the windows disagree, and " if mean.between_std else ""
            reason = f"{disagree}its 95 % interval spans a factor of {factor:.3g}, more than {largest:g}"
    return CampaignEstimate(
        windows=tuple(windows),
        fits=tuple(None if one is None else one[0] for one in results),
        labels=tuple(str(case.record.stamp(window.row)) for window in windows),
        used=used,
        mean=mean,
        interval_95=interval,
        reliable=not reason,
        reason=reason,
        covariance=covariance,
        thermal=thermal,
        conductivity_mean=conductivity_mean,
    )


def _log_alpha_covariance(informative: Sequence[tuple[Estimate, GLSFit]]) -> np.ndarray:
    """The covariance of the windows' ln(alpha)."""
    shared, stds = [], []
    for fit, gls in informative:
        # an interval by the profile likelihood is wider than the one from the curvature
        half = 0.5 * math.log(fit.interval_95[1] / fit.interval_95[0]) / gls.quantile
        stds.append(max(half, gls.log_std))
        shared.append(list(gls.instrument_error_effects(np.eye(len(gls.names))[0]).values()))
    return covariance_with_shared_errors(np.array(stds), np.stack(shared))


def _value_and_std(quantity: Quantity) -> str:
    """A quantity with its standard error, as text."""
    return value_and_std(quantity.value, quantity.std, quantity.unit)


def _consecutive_windows(case: Case, rows: int) -> list[Window]:
    """Consecutive windows in each unbroken part of the record."""
    return [
        Window(row, rows)
        for first, part in case.record.unbroken_parts
        for row in range(first, first + part - rows + 1, rows)
    ]


def _sorted_windows(windows: Sequence[Window]) -> list[Window]:
    """The windows in the order of their first rows.

    Raises:
        InputError: two windows overlap, or there are none.
    """
    ordered = sorted(windows, key=lambda window: window.row)
    if not ordered:
        raise InputError("windows: none was given")
    for one, two in pairwise(ordered):
        if one.row + one.rows > two.row:
            raise InputError(
                f"windows: the one from row {two.row} begins before the one from row {one.row} ends; "
                "they would share readings"
            )
    return ordered
