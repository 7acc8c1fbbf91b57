"""The entire record predicted with the estimate, and the heat that flows through the wall."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from .._internal.arrays import on_device
from .._internal.errors import InputError
from .._internal.html import html_table
from .._internal.result_object import ResultObject, plain_value
from .._internal.units import DAY
from ..case.case_definition import Case
from ..case.initial_profile import fit_profile, scales
from ..case.time_window import entire_record
from ..inference.sensor_heights import height_deviations
from ..inference.weighted_least_squares import paper_sigma
from ..models.error_measures import eps_2
from ..models.finite_volume_wall import Output
from ..models.integration import simulate
from ..models.section.section_state_space import section_modes
from ..models.state_space import StateSpace
from ..models.window_inputs import WindowData, check_driven, full_order_model, sensor_outputs, window_data
from ..records.row_times import RecordStart
from .result_objects import Estimate

if TYPE_CHECKING:
    from pandas import DataFrame

_LOAD_FACTORS = (0.8, 0.9, 1.0, 1.1, 1.2)  # factors on the diffusivity, as in the paper's figure
_AT_ESTIMATE = _LOAD_FACTORS.index(1.0)


@dataclass(frozen=True)
class HeatLoads(ResultObject):
    """Heat through the inner face at fixed conductivity, with heat capacity `c = k/alpha`.

    Args:
        flux: j = -k dT/dx at the inner face, positive along +x, W/m2, `(time,)`; NaN in the first row, where a jump
            between face temperature and initial profile makes it depend on the mesh.
        factors: on the estimated diffusivity, `(factor,)`.
        energy: E, the integral of j from the second row on, signed, J/m2, `(factor,)`.
        conductivity: k, W/m/K.
    """

    flux: np.ndarray = field(repr=False)
    factors: np.ndarray
    energy: np.ndarray
    conductivity: float

    @property
    def energy_at_estimate(self) -> float:
        """E at the estimated diffusivity, J/m2."""
        return float(self.energy[_AT_ESTIMATE])

    @property
    def relative_change(self) -> np.ndarray:
        """E divided by its value at the estimate, minus one."""
        return self.energy / self.energy_at_estimate - 1.0

    def to_dict(self) -> dict[str, Any]:
        """Conductivity, factors and energies as plain numbers; no time series."""
        return plain_value({"conductivity": self.conductivity, "factors": self.factors, "energy": self.energy})

    def to_frame(self) -> DataFrame:
        """One row for each factor on the diffusivity: `energy`, J/m2, and `relative_change`."""
        import pandas as pd

        columns = {"energy": self.energy, "relative_change": self.relative_change}
        return pd.DataFrame(columns, index=pd.Index(self.factors, name="factor"))

    def _html_title(self) -> str:
        return f"Heat through the inner face (J/m2) at {self.conductivity:g} W/m/K"


@dataclass(frozen=True)
class Prediction(ResultObject):
    """The readings of all sensors predicted with the prior diffusivity and with the estimate.

    Args:
        days: of each row since the record's start; of a record with gaps its longest unbroken part, `(time,)`.
        sensor_names: one for each column of the arrays below.
        measured, predicted_with_prior, predicted: degC, `(time, sensor)`.
        sigma: the paper's combined standard uncertainty of each reading, by noise and position, K, `(time, sensor)`.
        profile_eps_2: root mean square residual of the fitted initial profile, K; None where the profile was given.
        loads: heat through the inner face; None where the case states no conductivity.
        record_start: the origin of `days`.
    """

    days: np.ndarray = field(repr=False)
    sensor_names: tuple[str, ...]
    measured: np.ndarray = field(repr=False)
    predicted_with_prior: np.ndarray = field(repr=False)
    predicted: np.ndarray = field(repr=False)
    sigma: np.ndarray = field(repr=False)
    profile_eps_2: float | None
    loads: HeatLoads | None
    record_start: RecordStart = field(default_factory=RecordStart)

    @property
    def residual(self) -> np.ndarray:
        """Measured minus predicted with the estimate, K; NaN where missing."""
        return self.measured - self.predicted

    @property
    def residual_with_prior(self) -> np.ndarray:
        """Measured minus predicted with the prior, K; NaN where missing."""
        return self.measured - self.predicted_with_prior

    def rms_of_sensor(self, sensor: int) -> tuple[float, float, float]:
        """Root mean squares for a sensor: residual with the prior, residual with the estimate, and sigma, K."""
        measured = self.measured[:, sensor]
        prior, estimate = (eps_2(measured, model[:, sensor]) for model in (self.predicted_with_prior, self.predicted))
        return prior, estimate, float(np.sqrt(np.mean(self.sigma[:, sensor] ** 2)))

    def summary(self) -> str:
        """The root mean square residual of each sensor and the heat through the inner face, as text."""
        lines = ["whole record   rms residual, K     prior  estimate   sigma (noise and position)"]
        for s, name in enumerate(self.sensor_names):
            prior, estimate, sigma = self.rms_of_sensor(s)
            lines.append(f"  {name:<29} {prior:8.3f}  {estimate:8.3f}  {sigma:8.3f}")
        if self.loads is None:
            lines.append("heat loads     need a conductivity: put `conductivity` (W/m/K) in [wall]")
        else:
            low, high = self.loads.relative_change[0], self.loads.relative_change[-1]
            lines.append(
                f"heat loads     E = {self.loads.energy_at_estimate / 3.6e6:+.2f} kWh/m2 through the inner face; "
                f"{low:+.1%} to {high:+.1%} for -20 % to +20 % of the diffusivity"
            )
        return "\n".join(lines)

    __str__ = summary

    def to_dict(self) -> dict[str, Any]:
        """The result as plain numbers: root mean squares of each sensor, K, and the heat loads; no time series."""
        keys = ("rms_prior", "rms", "sigma")
        entries = {
            "sensors": {
                name: dict(zip(keys, self.rms_of_sensor(s), strict=True)) for s, name in enumerate(self.sensor_names)
            },
            "profile_eps_2": self.profile_eps_2,
            "loads": self.loads,
        }
        return plain_value(entries)

    def to_frame(self) -> DataFrame:
        """The readings beside the predictions, one row for each time (s since the record's start where it has s).

        The columns have two levels: the sensor, and `measured`, `prior`, `predicted`, `sigma` or `residual`, in degC
        and K; where the case states a conductivity also (`inner face`, `flux`), W/m2. A missing reading is NaN.
        """
        import pandas as pd

        kinds = {
            "measured": self.measured,
            "prior": self.predicted_with_prior,
            "predicted": self.predicted,
            "sigma": self.sigma,
            "residual": self.residual,
        }
        columns = {(name, kind): kinds[kind][:, s] for s, name in enumerate(self.sensor_names) for kind in kinds}
        if self.loads is not None:
            columns["inner face", "flux"] = self.loads.flux
        return pd.DataFrame(columns, index=self.record_start.index_after(np.round(self.days * DAY, 6)))

    def _repr_html_(self) -> str:
        rms = [self.rms_of_sensor(s) for s in range(len(self.sensor_names))]
        rows = [
            (f"rms residual of {name}", f"{estimate:.3f}", f"prior {prior:.3f}, sigma {sigma:.3f}", "K")
            for name, (prior, estimate, sigma) in zip(self.sensor_names, rms, strict=True)
        ]
        return html_table("Prediction of the entire record", rows)


def predict(case: Case, fit: Estimate, model: StateSpace | None = None) -> Prediction:
    """Predict the readings of the entire record with the prior diffusivity and with the estimate.

    For a record with gaps, its longest unbroken part is predicted. The integration is by `diffrax.diffeqsolve`.

    Args:
        fit: the estimate; its offsets are added to the prediction.
        model: the model of the sensors, for instance a reduced-order one; None for the full-order model.

    Returns:
        measured and predicted temperatures, their uncertainty, and the heat through the inner face.

    Raises:
        InputError: a reduced-order model lacks an input of the record, or materials of a section were estimated: the
            model here has the stated ones.
    """
    if "materials" in case.choices.free:
        raise InputError(
            '[choices] free = "materials": a prediction has the stated materials; state the values found, without free'
        )
    window = entire_record(case)
    inner = 0.0 if case.wall.inside == "left" else case.wall.length
    full = full_order_model(case, [*sensor_outputs(case, "gradient"), Output(inner, "flux")])
    sensors = len(case.sensors)
    model = (full if model is None else model).select(list(range(sensors)))
    check_driven(model, case, window)
    data, scale = window_data(case, window), scales(case)
    alphas = np.array([case.wall.diffusivity_prior, fit.value])
    prior, predicted = scale.celsius(np.asarray(_simulate_each(model, on_device(scale.fourier_number(alphas)), data)))
    at_heights = [_at_probable_heights(case, data, fit, alpha) for alpha in alphas]
    prior, predicted = prior + at_heights[0][0], predicted + at_heights[1][0]
    offsets = np.array([fit.offsets.get(sensor.name, (0.0, 0.0))[0] for sensor in case.sensors])
    factors = np.array(_LOAD_FACTORS)
    gradients = full.select(list(range(sensors, 2 * sensors + 1)))
    slopes = np.asarray(_simulate_each(gradients, on_device(scale.fourier_number(fit.value * factors)), data))
    slopes = slopes * scale.temperature / case.wall.length
    return Prediction(
        days=case.record.days[window.as_slice],
        sensor_names=tuple(sensor.name for sensor in case.sensors),
        measured=np.asarray(case.record.sensors)[window.as_slice],
        predicted_with_prior=prior + offsets,
        predicted=predicted + offsets,
        sigma=np.hypot(
            paper_sigma(
                np.array([sensor.noise_std for sensor in case.sensors]),
                slopes[_AT_ESTIMATE, :, :-1],
                np.array([sensor.position_std for sensor in case.sensors]),
            ),
            at_heights[1][1],
        ),
        profile_eps_2=fit_profile(case, window.row).eps_2,
        loads=_heat_loads(case, factors, slopes[:, :, -1]),
        record_start=case.record.start,
    )


def _at_probable_heights(
    case: Case, data: WindowData, fit: Estimate, diffusivity: float
) -> tuple[np.ndarray, np.ndarray]:
    """What the sensors of unknown height read more than the model has for them: mean and standard deviation, K."""
    mean, std = np.zeros((2, data.inputs.shape[0], len(case.sensors)))
    for k, sensor in enumerate(case.sensors):
        if (place := fit.sensor_places.get(sensor.name)) is not None:
            deviations = height_deviations(case, data, diffusivity, sensor, np.zeros(0)).readings
            mean[:, k] = place.probability @ deviations
            std[:, k] = np.sqrt(place.probability @ (deviations - mean[:, k]) ** 2)
    return mean, std


@eqx.filter_jit
def _simulate_each(
    system: StateSpace, fourier: Float[Array, " case"], data: WindowData
) -> Float[Array, "case time output"]:
    """Dimensionless outputs at each diffusivity."""
    return jax.lax.map(lambda fo: simulate(system, fo, data.time, data.inputs, data.initial)[0], fourier)


def _heat_loads(case: Case, factors: np.ndarray, slope: np.ndarray) -> HeatLoads | None:
    """The heat loads from `-(k/k_eff) dT/dx` at the inner face for each factor, K/m, `(factor, time)`."""
    conductivity = case.wall.effective_conductivity
    if case.section is not None:
        conductivity = section_modes(case.section).equivalent.conductivity
    if conductivity is None:
        return None
    flux = conductivity * slope
    energy = np.asarray(np.trapezoid(flux[:, 1:], dx=case.record.step, axis=1))
    flux[:, 0] = np.nan
    return HeatLoads(
        flux=flux[_AT_ESTIMATE],
        factors=factors,
        energy=energy,
        conductivity=conductivity,
    )
