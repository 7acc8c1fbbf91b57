"""One estimate from all windows of a campaign that tell anything, and whether they agree.

With `y_i` the estimates of ln(alpha), `C` their covariance and one mean `m`::

    m = (1' V^-1 1)^-1 1' V^-1 y,     V = C + tau^2 1,     X^2 = (y - m)' C^-1 (y - m) on n - 1 degrees of freedom
    C_ij = sum_c b_ic b_jc for i != j,      b_ic = dy_i / dc

Sensors stay where they are, and so do their offsets: what a constant c, one standard deviation of its prior, makes of
one window's estimate it makes of the others' too, and no number of windows takes it out. Where the windows disagree
(p under 5 %), `tau^2` is the variance between windows that makes `X^2` what it should be, and Student's quantile with
n - 1 degrees of freedom stands for the normal one.

Source: R. C. Paule, J. Mandel, J. Res. NBS 87 (1982), 377; G. Knapp, J. Hartung, Stat. Med. 22 (2003), 2693.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.special import chdtrc, stdtrit

from .case import Case
from .conclude import conclude, settled_minima
from .estimate import plain_fit
from .estimated import Estimate
from .experiment import Window, large_model, window_rows
from .free import fluxes_of
from .quantity import NORMAL_95
from .settled import Settled
from .statespace import StateSpace
from .wall import InputError

DISAGREE = 0.05  # p under which windows do not agree


@dataclass(frozen=True)
class Mean:
    """The mean of correlated values.

    Arguments:
        value, std: of the mean; std with the variance between them. quantile: 97.5 %, in `std`.
        chi_square, freedom, p_value: of their agreement; p is NaN for a single value.
        between: standard deviation between them beyond their own, 0 where they agree.
        weights: of each value.
    """

    value: float
    std: float
    quantile: float
    chi_square: float
    freedom: int
    p_value: float
    between: float
    weights: np.ndarray


def mean_of(values: np.ndarray, covariance: np.ndarray, quantile: float = NORMAL_95) -> Mean:
    """The generalised least-squares mean of values, widened where they disagree.

    Arguments:
        quantile: of each value's own interval, 97.5 %.
    """
    count, freedom = len(values), len(values) - 1

    def mean(between: float) -> tuple[float, float, float, np.ndarray]:
        V = covariance + between**2 * np.eye(count)
        solved = np.linalg.solve(V, np.ones(count))
        weights = solved / solved.sum()
        m = float(weights @ values)
        return m, float(1.0 / solved.sum()), float((values - m) @ np.linalg.solve(V, values - m)), weights

    m, variance, chi_square, weights = mean(0.0)
    p_value = float(chdtrc(freedom, chi_square)) if freedom else math.nan
    if not p_value < DISAGREE:
        return Mean(m, math.sqrt(variance), quantile, chi_square, freedom, p_value, 0.0, weights)
    from scipy.optimize import brentq  # a quarter of a second, and only windows that disagree need it

    top = 2.0 * float(np.ptp(values)) + 1e-12
    while mean(top)[2] > freedom:
        top *= 2.0
    between = float(
        brentq(lambda tau: mean(float(tau))[2] - freedom, 0.0, top, xtol=1e-9 * top, full_output=True)[1].root
    )
    m, variance, _, weights = mean(between)
    wide = max(quantile, float(stdtrit(freedom, 0.975)))
    return Mean(m, math.sqrt(variance), wide, chi_square, freedom, p_value, between, weights)


@dataclass(frozen=True, eq=False)
class Pooled:
    """One diffusivity from all informative windows of a record.

    Arguments:
        windows, fits: every window and its own estimate (None: no reading in it).
        labels: when each begins.
        used: which are informative and in the mean.
        mean: of their ln(alpha); None where there is none.
        interval_95: m2/s.
        reliable, reason: as of an estimate.
        covariance: of the used ones' ln(alpha).
    """

    windows: tuple[Window, ...]
    fits: tuple[Estimate | None, ...] = field(repr=False)
    labels: tuple[str, ...] = field(repr=False)
    used: tuple[int, ...]
    mean: Mean | None
    interval_95: tuple[float, float]
    reliable: bool
    reason: str
    covariance: np.ndarray = field(repr=False)

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
        for k, (fit, label) in enumerate(zip(self.fits, self.labels, strict=True)):
            if fit is None:
                lines.append(f"  from {label}   no reading of an inner sensor")
                continue
            said = f"weight {self.weight(k):+.0%}" if k in self.used else "uninformative"
            low, high = fit.interval_95
            lines.append(f"  from {label}   {fit.value:.4g}   (95 %: {low:.3g} to {high:.3g})   {said}")
        return "\n".join(lines)

    def weight(self, window: int) -> float:
        """Of a window in the mean, 1."""
        return float(self.mean.weights[self.used.index(window)]) if self.mean and window in self.used else 0.0

    @property
    def agreement(self) -> str:
        """Whether the windows agree, in a sentence."""
        mean = self.mean
        if mean is None or not mean.freedom:
            return "nothing to compare"
        tested = f"chi-square {mean.chi_square:.3g} on {mean.freedom} degrees of freedom, p = {mean.p_value:.2g}"
        if not mean.between:
            return f"{tested}: the windows agree"
        return (
            f"{tested}: the windows DISAGREE beyond their intervals; a variance between windows of {mean.between:.1%} "
            "is counted, and the interval is by Student's quantile"
        )


def campaign(
    case: Case,
    *,
    window_days: float | None = None,
    windows: Sequence[Window] | None = None,
    model: StateSpace | None = None,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> Pooled:
    """One diffusivity from all windows of a record, laid end to end, and whether they agree.

    One compiled estimate serves all windows; they are taken by the large model, which knows every window's faces.

    Arguments:
        window_days: None for the case's choice.
        windows: by hand, none over another; None for all that fit into the record's unbroken parts.
        model: a large model at hand.
        progress: told how many windows are done, of how many.

    Raises:
        InputError: windows over one another, or a case with heat flux or more of the wall free.
    """
    if case.choices.free:
        raise InputError(
            f"[choices] free = {list(case.choices.free)}: estimate without --all-windows, or with the diffusivity alone"
        )
    if fluxes_of(case):
        raise InputError("fluxes are estimated from the whole record at once: estimate without --all-windows")
    rows = window_rows(case, case.choices.window_days if window_days is None else window_days)
    laid = _laid(case, rows) if windows is None else _checked(windows)
    system = large_model(case) if model is None else model
    fits, settled = [], []
    for k, window in enumerate(laid):
        progress(k, len(laid))
        there = np.isfinite(case.record.sensors[window.part]).any()
        found = _one(case, window, system) if there else None
        fits.append(None if found is None else found[0])
        settled.append(None if found is None else found[1])
    used = tuple(k for k, fit in enumerate(fits) if fit is not None and fit.reliable)
    return _pooled(case, laid, fits, [(fits[k], settled[k]) for k in used], used)


def _one(case: Case, window: Window, system: StateSpace) -> tuple[Estimate, Settled]:
    told = plain_fit(case, window, system, case.wall.diffusivity_prior, case.choices.eta)
    settled, others = settled_minima(told, case.choices.eta, True, "propagator")
    return conclude(told, settled, others, 0), settled


def _pooled(case: Case, laid, fits, informative, used: tuple[int, ...]) -> Pooled:
    """The mean of the informative windows, and whether it can be relied on."""
    mean, interval, covariance = None, (math.nan, math.nan), np.zeros((0, 0))
    reason = f"none of {len(laid)} windows is informative"
    if used:
        covariance = covariance_of(informative)
        values = np.log([fit.value for fit, _ in informative])
        mean = mean_of(values, covariance, max(settled.quantile for _, settled in informative))
        half = min(mean.quantile * mean.std, 300.0)
        interval = (math.exp(mean.value - half), math.exp(mean.value + half))
        factor, most = interval[1] / interval[0], case.choices.largest_interval_factor
        reason = ""
        if factor > most:
            disagree = "the windows disagree, and " if mean.between else ""
            reason = f"{disagree}its 95 % interval spans a factor of {factor:.3g}, more than {most:g}"
    return Pooled(
        windows=tuple(laid),
        fits=tuple(fits),
        labels=tuple(str(case.record.stamp(window.row)) for window in laid),
        used=used,
        mean=mean,
        interval_95=interval,
        reliable=not reason,
        reason=reason,
        covariance=covariance,
    )


def covariance_of(informative: Sequence[tuple[Estimate, Settled]]) -> np.ndarray:
    """Of the windows' ln(alpha): each one's own, and what the same constants make of all of them."""
    shared = np.stack([settled.of_constants for _, settled in informative])
    covariance = shared @ shared.T
    for k, (fit, settled) in enumerate(informative):
        # an interval by the profile is wider than the curvature says
        half = 0.5 * math.log(fit.interval_95[1] / fit.interval_95[0]) / settled.quantile
        covariance[k, k] = max(half, settled.log_std) ** 2
    return covariance


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
