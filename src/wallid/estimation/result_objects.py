"""What an estimate is: a value, its interval, how it was found, and whether it can be relied on."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ..case.initial_profile import Profile
from ..case.time_window import Window
from ..inference.identifiability import Identifiability
from ..inference.parametric_bootstrap import Bootstrap
from ..inference.quantity import Quantity
from .heat_flux import ThermalProperties

_WORDS = {"film_left": "left film", "film_right": "right film"}


@dataclass(frozen=True)
class Estimate:
    """A diffusivity with its interval, and how it was found.

    Args:
        value, std: m2/s. `std` is that of ln(alpha) times alpha: from the noise of sensors and faces, and from
            offsets, position errors and the initial profile within their priors. With `weights="none"` from
            the paper's simple sigma, and wider by the square root of the reduced chi-square where that is above 1.
        interval_95: m2/s; `interval_kind` is "normal" (symmetric in ln(alpha)), or "profile likelihood" where the
            cost is no parabola.
        offsets: per sensor with an `offset_std`: name -> (value, std), K. `positions`: per sensor with a
            `position_std`: name -> (true place minus stated, std), m. `face_positions`: the same of "left" and "right"
            where there is a `face_position_std`.
        result: "converged", or what stopped the iteration.
        reliable: False where the record gives no number to rely on; `reason` says why.
        iterations: Gauss-Newton steps of the paper's iteration; `evaluations` counts halved tries too. `rounds`: of
            Gauss-Newton again, under the covariance found.
        history: per iterate: diffusivity, cost, gamma_1, gamma_2; of the paper's iteration, then of the rounds.
        reduced_chi_square: the cost under the noise as stated, over its degrees of freedom.
        noise: what the record says of the noise, in words; `shares`: what each kind of error makes of the
            variance, 1.
        predicted, residual: degC and K (measured minus predicted; NaN where missing),
            `(time, sensor)`, all that is free included.
        covariance: of (ln alpha, offsets, positions, faces' places, profile), those in units of their prior.
        singular_values: of the weighted sensitivity, largest first.
        model_shift: relative change of the estimate that a reduced model's error against the large
            model makes; 0 for the large model. It is counted in `std`.
        profile: the initial profile that the window starts from.
        model: what was fitted, in words.
        bootstrap: a check of `std` and interval by drawn readings; None where none was asked for.
        thermal: what heat fluxes told; None without any. `predicted` and `residual` then hold the plates' columns
            after the sensors', W/m2, and there is no paper's iteration: `iterations` are of the rounds.
        identifiability: which parameters the record tells apart; None for the paper's cost, or where the diffusivity
            is alone.
        structure: what else of the wall was free (`[choices] free`): "layer 1" and so on, m2/s; "film_left",
            "film_right", conductivity over film coefficient, m.
    """

    value: float
    std: float
    interval_95: tuple[float, float]
    offsets: dict[str, tuple[float, float]]
    result: str
    reliable: bool
    reason: str
    iterations: int
    evaluations: int
    history: dict[str, np.ndarray] = field(repr=False)
    reduced_chi_square: float
    predicted: np.ndarray = field(repr=False)
    residual: np.ndarray = field(repr=False)
    covariance: np.ndarray = field(repr=False)
    singular_values: np.ndarray = field(repr=False)
    model_shift: float
    profile: Profile
    model: str
    window: Window
    positions: dict[str, tuple[float, float]] = field(default_factory=dict)
    face_positions: dict[str, tuple[float, float]] = field(default_factory=dict)
    interval_kind: Literal["normal", "profile likelihood"] = "normal"
    rounds: int = 0
    noise: str = "the paper's simple sigma"
    shares: dict[str, float] = field(default_factory=dict)
    bootstrap: Bootstrap | None = None
    thermal: ThermalProperties | None = None
    identifiability: Identifiability | None = None
    structure: dict[str, Quantity] = field(default_factory=dict)

    def __str__(self) -> str:
        low, high = self.interval_95
        by = "" if self.interval_kind == "normal" else f", by the {self.interval_kind}"
        found = f"{self.value:.4g} m2/s  +- {self.std:.1g}   (95 %: {low:.4g} to {high:.4g}{by})"
        lines = [f"diffusivity  {found}"]
        if not self.reliable:
            lines = [f"diffusivity  NOT TO BE RELIED ON: {self.reason}", f"             the search ended at {found}"]
        rounds = f", {self.rounds} rounds under the full covariance" if self.rounds else ""
        lines += [
            f"model        {self.model}; {self.result} after {self.iterations} Gauss-Newton steps{rounds}",
            f"residual     {self._left()} root mean square, "
            f"reduced chi-square {self.reduced_chi_square:.2f}; {self.noise}",
        ]
        if self.thermal is not None:  # plain averages stand by themselves, what follows from the estimate does not
            lines += [str(self.thermal)] if self.reliable else [str(average) for average in self.thermal.averages]
        lines += [f"{_WORDS.get(name, name):<12} {one}" for name, one in self.structure.items()]
        if self.identifiability is not None and len(self.identifiability.names) > 1:
            lines.append(f"told apart   {self.identifiability}")
        if self.shares:
            lines.append("variance     " + ", ".join(f"{name} {share:.0%}" for name, share in self.shares.items()))
        if self.bootstrap is not None:
            lines.append(str(self.bootstrap))
        if self.profile.eps_2 is not None:
            degree = len(self.profile.coefficients) - 1
            fit = f"eps_2 {self.profile.eps_2:.2g} K" if self.profile.eps_2 > 1e-9 else "through all its readings"
            lines.append(f"profile      initial polynomial of degree {degree}, {fit}")
        lines += [f"offset       {name} {value:+.3f} +- {std:.3f} K" for name, (value, std) in self.offsets.items()]
        lines += [
            f"position     {name} {1e3 * value:+.1f} +- {1e3 * std:.1f} mm"
            for name, (value, std) in (
                self.positions | {f"{side} face": one for side, one in self.face_positions.items()}
            ).items()
        ]
        return "\n".join(lines)

    @property
    def sensors(self) -> int:
        """How many columns of `residual` are temperatures."""
        return self.residual.shape[1] - (0 if self.thermal is None else len(self.thermal.gains))

    @property
    def has_flux(self) -> bool:
        """Whether a flux told anything."""
        return bool(np.isfinite(self.residual[:, self.sensors :]).any())

    def _left(self) -> str:
        """The residual's size."""
        parts = (self.residual[:, : self.sensors], "K"), (self.residual[:, self.sensors :], "W/m2")
        return " and ".join(f"{np.sqrt(np.nanmean(part**2)):.3g} {unit}" for part, unit in parts if part.size)
