"""The result of an estimate from one window."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import scipy

from .._internal.errors import InputError
from .._internal.html import html_table, interval_row
from .._internal.number_formats import value_and_interval, value_and_std
from .._internal.result_object import ResultObject, plain_value
from ..case.case_definition import Case
from ..case.initial_profile import InitialProfile
from ..case.time_window import Window
from ..inference.disturbance_search import Disturbance
from ..inference.identifiability import Identifiability
from ..inference.material_values import MaterialValues
from ..inference.parametric_bootstrap import Bootstrap
from ..inference.quantity import NORMAL_95, Quantity, normal, quantity_frame
from ..inference.sensor_places import SensorPlace
from ..models.flux_plates import fluxes_of
from ..records.row_times import time_index
from .heat_flux import ThermalProperties

if TYPE_CHECKING:
    from pandas import DataFrame

_LABELS = {"film_left": "left film", "film_right": "right film"}


@dataclass(frozen=True)
class Estimate(ResultObject):
    """The diffusivity of a wall with its uncertainty, and how it was obtained.

    Args:
        value, std: diffusivity and its standard error (that of ln(alpha) times alpha), m2/s. The standard error counts
            the noise of sensors and faces and, within their priors, offsets, position errors and the initial profile.
            With `weights="none"` it comes from the paper's simple sigma, times the square root of the reduced
            chi-square where that is above 1.
        interval_95: m2/s.
        offsets: for each sensor with an `offset_std`: name -> (value, std), K.
        message: "converged", or why the iteration stopped.
        reliable: whether the record determines the diffusivity; if not, `reason` says why.
        iterations: Gauss-Newton steps of the paper's iteration. `evaluations`: of the cost, step halvings included.
        history: diffusivity, cost, gamma_1 and gamma_2 of each iterate; the paper's iteration, then the GLS rounds.
        reduced_chi_square: the cost with the stated noise divided by its degrees of freedom.
        predicted, residual: prediction, degC, and measured minus predicted, K, `(time, sensor)`; all estimated
            nuisance parameters included; the residual is NaN where a reading is missing. With flux plates their columns
            follow the sensors', W/m2.
        covariance: of ln(alpha), offsets, positions, face positions and initial profile; all but the first in units of
            their prior standard deviation.
        singular_values: of the weighted Jacobian, largest first.
        model_shift: relative change of the estimate caused by the error of a reduced-order model; 0 for the full-order
            model. Included in `std`.
        profile: the initial profile of the window.
        model_description: the fitted model, as text.
        window: rows of the record.
        positions: for each sensor with a `position_std`: name -> (true minus stated position, std), m.
        face_positions: the same for the sensors of the "left" and "right" face with a `face_position_std`.
        interval_kind: "normal" (symmetric in ln(alpha)), or "profile likelihood" where the cost is not quadratic.
        rounds: rounds of GLS, each with the noise covariance estimated from the last residual.
        noise_description: the noise that the interval is based on, as text.
        noise_ratio: standard deviation of the noise found in the residual over the stated one; NaN where the noise was
            not estimated.
        noise_rms: root mean square that the stated noise alone gives each output, K or W/m2, the noise of the faces
            included, which goes through the wall; empty with `weights="none"`.
        advice: what to check or to state otherwise in the case, although the estimate is reliable.
        variance_shares: share of each source of error in the variance, dimensionless.
        bootstrap: parametric bootstrap of `std` and interval; None if not requested.
        thermal: the thermal properties from heat fluxes; None without fluxes. With fluxes the paper's iteration is
            omitted, and `iterations` counts GLS steps.
        identifiability: which parameters the record distinguishes; None for `weights="none"`, or if the diffusivity is
            the only parameter.
        parameters: every nuisance parameter that was estimated, by name: (value, standard error), in its own unit.
        wall_parameters: the other estimated parameters of the wall (`[choices] free`): "layer 1" and so on, m2/s;
            "film_left" and "film_right", conductivity over film coefficient, m; of a section "conductivity of stone",
            W/m/K, "heat_capacity of stone", J/m3/K, and so on.
        materials: what the record determines of a section's materials; None where they are not estimated.
        sensor_places: of each sensor of unknown height in a section: in which material it probably is.
        disturbance: heat that the model does not know, as the interval counts it; None where none was found or asked
            for.
    """

    value: float
    std: float
    interval_95: tuple[float, float]
    offsets: dict[str, tuple[float, float]]
    message: str
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
    profile: InitialProfile
    model_description: str
    window: Window
    positions: dict[str, tuple[float, float]] = field(default_factory=dict)
    face_positions: dict[str, tuple[float, float]] = field(default_factory=dict)
    interval_kind: Literal["normal", "profile likelihood"] = "normal"
    rounds: int = 0
    noise_description: str = "the paper's simple sigma"
    noise_ratio: float = math.nan
    noise_rms: tuple[float, ...] = ()
    advice: tuple[str, ...] = ()
    variance_shares: dict[str, float] = field(default_factory=dict)
    bootstrap: Bootstrap | None = None
    thermal: ThermalProperties | None = None
    identifiability: Identifiability | None = None
    wall_parameters: dict[str, Quantity] = field(default_factory=dict)
    parameters: dict[str, tuple[float, float]] = field(default_factory=dict, repr=False)
    disturbance: Disturbance | None = None
    sensor_places: dict[str, SensorPlace] = field(default_factory=dict)
    materials: MaterialValues | None = None

    def conf_int(self, level: float = 0.95) -> tuple[float, float]:
        """The confidence interval of the diffusivity at a level, m2/s.

        At 0.95 it is `interval_95`. At another level each end's distance from ln(value) is scaled by the ratio of the
        normal quantiles, `ln(end) = ln(value) + (z_level / z_0.95) ln(end_95 / value)`.

        Args:
            level: confidence level, between 0 and 1.

        Raises:
            InputError: the level is not between 0 and 1.
        """
        if not 0.0 < level < 1.0:
            raise InputError(f"level = {level}; it must lie between 0 and 1")
        if level == 0.95:
            return self.interval_95
        scale = float(scipy.special.ndtri(0.5 + 0.5 * level)) / NORMAL_95
        low, high = (self.value * (end / self.value) ** scale for end in self.interval_95)
        return low, high

    def summary(self) -> str:
        """Value, interval, fit and all estimated parameters, as text."""
        by = "" if self.interval_kind == "normal" else f", by the {self.interval_kind}"
        value = value_and_interval(self.value, self.std, self.interval_95, "m2/s", by)
        flux_only = self.thermal is not None and not self.sensor_count
        lines = [f"diffusivity  {value}"]
        if flux_only and self.thermal is not None and self.reliable:
            lines = [*self.thermal.property_lines, f"diffusivity  {value}, for the stated length"]
        if not self.reliable:
            lines = [f"diffusivity  NOT TO BE RELIED ON: {self.reason}", f"             the search ended at {value}"]
        rounds = f", {self.rounds} rounds under the full covariance" if self.rounds else ""
        lines += [
            f"model        {self.model_description}; {self.message} after {self.iterations} Gauss-Newton steps{rounds}",
            f"residual     {self._residual_rms()}; "
            f"reduced chi-square {self.reduced_chi_square:.2f} "
            f"(about 1 where the stated noise explains it); {self.noise_description}",
        ]
        lines += [] if self.disturbance is None else [f"disturbance  {self.disturbance}"]
        if self.sensor_places:
            lines.append("heights      " + ", ".join(f"{name} {place}" for name, place in self.sensor_places.items()))
        lines += [f"advice       {text}" for text in self.advice]
        if self.thermal is not None:  # the average method does not depend on the estimate
            lines += self.thermal.property_lines if self.reliable and not flux_only else []
            lines += (
                self.thermal.evidence_lines
                if self.reliable
                else [str(average) for average in self.thermal.average_methods]
            )
        if self.materials is None:
            lines += [f"{_LABELS.get(name, name):<12} {one}" for name, one in self.wall_parameters.items()]
        else:
            lines.append(str(self.materials))
        if self.identifiability is not None and len(self.identifiability.names) > 1:
            lines.append(f"parameters   {self.identifiability}")
        if self.variance_shares:
            shares = ", ".join(f"{name} {share:.0%}" for name, share in self.variance_shares.items())
            lines.append(f"variance     {'of the diffusivity: ' if self.thermal is not None else ''}{shares}")
        if self.bootstrap is not None:
            lines.append(str(self.bootstrap))
        if self.profile.eps_2 is not None:
            degree = len(self.profile.coefficients) - 1
            misfit = self.profile.eps_2
            fit = f"{misfit:.2g} K rms from the readings" if misfit > 1e-9 else "through all its readings"
            lines.append(f"profile      initial polynomial of degree {degree}, {fit}")
        lines += [f"offset       {name} {value_and_std(*offset, 'K')}" for name, offset in self.offsets.items()]
        lines += [
            f"position     {name} {value_and_std(value, std, 'm')}"
            for name, (value, std) in (
                self.positions | {f"{side} face": one for side, one in self.face_positions.items()}
            ).items()
        ]
        return "\n".join(lines)

    __str__ = summary

    def to_dict(self) -> dict[str, Any]:
        """The result as plain numbers, strings, lists and dicts, without the time series."""
        constants = {"offsets": "K", "positions": "m", "face_positions": "m"}
        entries = {
            **Quantity(self.value, self.std, self.interval_95, "m2/s").result(),
            "interval_kind": self.interval_kind,
            "reliable": self.reliable,
            "reason": self.reason,
            "message": self.message,
            "iterations": self.iterations,
            "rounds": self.rounds,
            "reduced_chi_square": self.reduced_chi_square,
            "noise": self.noise_description,
            "noise_ratio": self.noise_ratio,
            "advice": list(self.advice),
            "variance_shares": dict(self.variance_shares),
            "model": self.model_description,
            "model_shift": self.model_shift,
            "window": {"row": self.window.row, "rows": self.window.rows},
            **{
                kind: {
                    name: {"value": value, "std": std, "unit": unit}
                    for name, (value, std) in getattr(self, kind).items()
                }
                for kind, unit in constants.items()
            },
            "wall_parameters": {name: one.result() for name, one in self.wall_parameters.items()},
            "thermal": self.thermal,
            "disturbance": self.disturbance,
            "materials": self.materials,
            "sensor_places": {name: place.to_dict() for name, place in self.sensor_places.items()},
        }
        return plain_value(entries)

    @property
    def quantities(self) -> dict[str, Quantity]:
        """All that was estimated, by name: diffusivity, other parameters of the wall, sensor errors."""
        named = {"diffusivity": Quantity(self.value, self.std, self.interval_95, "m2/s")} | self.wall_parameters
        named |= {} if self.thermal is None else self.thermal.quantities
        named |= {f"offset of {name}": normal(*one, "K") for name, one in self.offsets.items()}
        positions = self.positions | {f"{side} face": one for side, one in self.face_positions.items()}
        return named | {f"position error of {name}": normal(*one, "m") for name, one in positions.items()}

    def to_frame(self) -> DataFrame:
        """One row for each estimated quantity: `value`, `std`, `low` and `high` of the 95 % interval, `unit`."""
        return quantity_frame(self.quantities)

    def readings_to_frame(self, case: Case) -> DataFrame:
        """The readings of the window beside the fitted model, one row for each time.

        The columns have two levels: the sensor (or `flux_left`, `flux_right`), and `measured`, `predicted` or
        `residual`, in degC and K (a flux in W/m2). A missing reading is NaN; so is the residual of one that is not
        used, such as the flux of the first row.

        Args:
            case: the case of this estimate, for the times and the names of the sensors.

        Raises:
            InputError: a case with other sensors or fewer rows.
        """
        import pandas as pd

        names = [sensor.name for sensor in case.sensors]
        names += [f"flux_{face}" for face in fluxes_of(case)] if self.thermal is not None else []
        if len(names) != self.residual.shape[1] or self.window.row + self.window.rows > case.record.rows:
            raise InputError(
                f"case: it has the readings {', '.join(names)} in {case.record.rows} rows; it must be the case of this "
                f"estimate, with {self.residual.shape[1]} columns in rows up to {self.window.row + self.window.rows}"
            )
        index = time_index(case.record.stamps[self.window.as_slice], case.record.zone)
        record, rows = case.record, self.window.as_slice
        fluxes = [record.regressors[name][rows] for name in names[len(case.sensors) :]]
        measured = np.column_stack([record.sensors[rows], *fluxes])
        kinds = {"measured": measured, "predicted": self.predicted, "residual": self.residual}
        columns = {(name, kind): kinds[kind][:, k] for k, name in enumerate(names) for kind in kinds}
        return pd.DataFrame(columns, index=index)

    def _repr_html_(self) -> str:
        quantities = {"diffusivity": Quantity(self.value, self.std, self.interval_95, "m2/s")} | self.wall_parameters
        quantities |= self.thermal.quantities if self.thermal is not None and self.reliable else {}
        rows = [interval_row(_LABELS.get(name, name), one) for name, one in quantities.items()]
        rows += [(f"offset of {name}", f"{x:+.3f}", f"± {std:.3f}", "K") for name, (x, std) in self.offsets.items()]
        positions = (self.positions | self.face_positions).items()
        rows += [(f"position of {name}", f"{1e3 * x:+.1f}", f"± {1e3 * std:.1f}", "mm") for name, (x, std) in positions]
        return html_table("Diffusivity" if self.reliable else f"Not to be relied on: {self.reason}", rows)

    @property
    def sensor_count(self) -> int:
        """The number of columns of `residual` that are temperatures; the others are fluxes."""
        return self.residual.shape[1] - (0 if self.thermal is None else len(self.thermal.plate_gains))

    @property
    def has_flux(self) -> bool:
        """Whether any flux reading was used."""
        return bool(np.isfinite(self.residual[:, self.sensor_count :]).any())

    def _residual_rms(self) -> str:
        """The root mean square of the residual, as text."""
        parts = [f"{self.rms(flux=flux):.3g} {'W/m2' if flux else 'K'}" for flux in self._kinds_of_outputs]
        noise = [f"{self.expected_rms(flux=flux):.2g}" for flux in self._kinds_of_outputs if self.noise_rms]
        text = f"{' and '.join(parts)} root mean square"
        return text + (f", {' and '.join(noise)} expected from the stated noise" if noise else "")

    @property
    def _kinds_of_outputs(self) -> list[bool]:
        """Which outputs there are: False for temperatures, True for fluxes."""
        return [flux for flux in (False, True) if self.residual[:, self._outputs(flux)].size]

    def _outputs(self, flux: bool) -> slice:
        """The columns of `residual` that are fluxes, or temperatures."""
        return slice(self.sensor_count, None) if flux else slice(self.sensor_count)

    def rms(self, *, flux: bool = False) -> float:
        """Root mean square of the residual at the inner sensors, K; or at the flux plates, W/m2."""
        return float(np.sqrt(np.nanmean(self.residual[:, self._outputs(flux)] ** 2)))

    def expected_rms(self, *, flux: bool = False) -> float:
        """The same that the stated noise alone would give, that of the faces included; NaN where it is not known."""
        columns = self._outputs(flux)
        count = np.isfinite(self.residual[:, columns]).sum(axis=0)
        variance = np.square(self.noise_rms[columns])
        return float(np.sqrt(variance[count > 0] @ count[count > 0] / count.sum())) if len(variance) else math.nan
