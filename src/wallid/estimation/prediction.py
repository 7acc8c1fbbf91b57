"""The whole record against the prediction, and what the estimate means for heat through the wall."""

from __future__ import annotations

from dataclasses import dataclass, field

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from .._internal.arrays import on_device
from ..case.case_definition import Case
from ..case.initial_profile import fit_profile, scales
from ..case.time_window import whole
from ..inference.weighted_least_squares import paper_sigma
from ..models.error_measures import eps_2
from ..models.finite_volume_wall import Output
from ..models.integration import simulate
from ..models.state_space import StateSpace
from ..models.window_inputs import WindowData, check_driven, full_order_model, window_data
from .result_objects import Estimate

_LOAD_STEPS = (0.8, 0.9, 1.0, 1.1, 1.2)  # of the diffusivity, as in the paper's figure
_AT_ESTIMATE = _LOAD_STEPS.index(1.0)


@dataclass(frozen=True)
class Loads:
    """Heat through the inner face at fixed conductivity, `c = k/alpha`.

    Args:
        flux: j = -k dT/dx at the inner face, positive along +x, W/m2; NaN in the first row, where a face
            that does not meet the initial profile makes it whatever the mesh is.
        factors: of the estimated diffusivity.
        energy: E, the integral of j from the second row on at each factor, J/m2, signed.
        conductivity: W/m/K.
    """

    flux: np.ndarray = field(repr=False)
    factors: np.ndarray
    energy: np.ndarray
    conductivity: float

    @property
    def at_estimate(self) -> float:
        """E at the estimated diffusivity, J/m2."""
        return float(self.energy[_AT_ESTIMATE])

    @property
    def change(self) -> np.ndarray:
        """E over its value at the estimate, minus one."""
        return self.energy / self.at_estimate - 1.0


@dataclass(frozen=True)
class Prediction:
    """The record's sensors predicted with the prior and with the estimate.

    Args:
        days: of the rows, from the record's first; of a broken record its longest part.
        measured, prior, predicted: degC, `(time, sensor)`.
        sigma: the paper's combined uncertainty of each reading, K, `(time, sensor)`.
        profile_eps_2: root mean square of the initial profile's fit, K; None where it was given.
        loads: None where the case states no conductivity.
    """

    days: np.ndarray = field(repr=False)
    names: tuple[str, ...]
    measured: np.ndarray = field(repr=False)
    prior: np.ndarray = field(repr=False)
    predicted: np.ndarray = field(repr=False)
    sigma: np.ndarray = field(repr=False)
    profile_eps_2: float | None
    loads: Loads | None

    @property
    def residual(self) -> np.ndarray:
        """Measured minus predicted with the estimate, K; NaN where missing."""
        return self.measured - self.predicted

    @property
    def residual_prior(self) -> np.ndarray:
        """Measured minus predicted with the prior, K; NaN where missing."""
        return self.measured - self.prior

    def sizes(self, sensor: int) -> tuple[float, float, float]:
        """Root mean squares of a sensor: residual with the prior, with the estimate, and sigma, K."""
        measured = self.measured[:, sensor]
        before, after = (eps_2(measured, model[:, sensor]) for model in (self.prior, self.predicted))
        return before, after, float(np.sqrt(np.mean(self.sigma[:, sensor] ** 2)))

    def __str__(self) -> str:
        lines = ["whole record   rms residual, K     prior  estimate   sigma (noise and position)"]
        for s, name in enumerate(self.names):
            before, after, sigma = self.sizes(s)
            lines.append(f"  {name:<29} {before:8.3f}  {after:8.3f}  {sigma:8.3f}")
        if self.loads is None:
            lines.append("heat loads     need a conductivity: put `conductivity` (W/m/K) in [wall]")
        else:
            low, high = self.loads.change[0], self.loads.change[-1]
            lines.append(
                f"heat loads     E = {self.loads.at_estimate / 3.6e6:+.2f} kWh/m2 through the inner face; "
                f"{low:+.1%} to {high:+.1%} for -20 % to +20 % of the diffusivity"
            )
        return "\n".join(lines)


def predict(case: Case, fit: Estimate, model: StateSpace | None = None) -> Prediction:
    """Predict the whole record with the prior and with the estimate, by `diffrax.diffeqsolve`.

    Of a broken record, that is its longest part.

    Args:
        model: the model to predict with, such as the reduced one; None for the large model.

    Raises:
        InputError: a reduced model that does not know what a face of the record does.
    """
    window = whole(case)
    inner = 0.0 if case.wall.inside == "left" else case.wall.length
    large = full_order_model(
        case,
        [*(Output(s.position, "gradient", f"gradient {s.name}") for s in case.sensors), Output(inner, "flux")],
    )
    sensors = len(case.sensors)
    model = (large if model is None else model).select(list(range(sensors)))
    check_driven(model, case, window)
    data, scale = window_data(case, window), scales(case)
    alphas = np.array([case.wall.diffusivity_prior, fit.value])
    prior, predicted = scale.celsius(np.asarray(_predict(model, on_device(scale.fourier(alphas)), data)))
    offsets = np.array([fit.offsets.get(sensor.name, (0.0, 0.0))[0] for sensor in case.sensors])
    factors = np.array(_LOAD_STEPS)
    extra = large.select(list(range(sensors, 2 * sensors + 1)))
    slopes = np.asarray(_predict(extra, on_device(scale.fourier(fit.value * factors)), data))
    slopes = slopes * scale.temperature / case.wall.length
    return Prediction(
        days=case.record.days[window.part],
        names=tuple(sensor.name for sensor in case.sensors),
        measured=np.asarray(case.record.sensors)[window.part],
        prior=prior + offsets,
        predicted=predicted + offsets,
        sigma=paper_sigma(
            np.array([sensor.noise_std for sensor in case.sensors]),
            slopes[_AT_ESTIMATE, :, :-1],
            np.array([sensor.position_std for sensor in case.sensors]),
        ),
        profile_eps_2=fit_profile(case, window.row).eps_2,
        loads=_loads(case, factors, slopes[:, :, -1]),
    )


@eqx.filter_jit
def _predict(system: StateSpace, fourier: Float[Array, " case"], data: WindowData) -> Float[Array, "case time output"]:
    """Dimensionless outputs at each diffusivity."""
    return jax.lax.map(lambda fo: simulate(system, fo, data.time, data.inputs, data.initial)[0], fourier)


def _loads(case: Case, factors: np.ndarray, slope: np.ndarray) -> Loads | None:
    """Flux and load at the inner face, from `-(k/k_eff) dT/dx` there at each factor, K/m."""
    conductivity = case.wall.effective_conductivity
    if conductivity is None:
        return None
    flux = conductivity * slope
    energy = np.asarray(np.trapezoid(flux[:, 1:], dx=case.record.step, axis=1))
    flux[:, 0] = np.nan
    return Loads(
        flux=flux[_AT_ESTIMATE],
        factors=factors,
        energy=energy,
        conductivity=conductivity,
    )
